//! What the files of a run held when a checkpoint was written, so that whoever goes on from it sees whether
//! they still do.

use flate2::Crc;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// What a file held: so many bytes with this check sum. Bytes behind them are no part of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mark {
    /// Bytes.
    pub length: u64,
    /// CRC-32.
    pub sum: u32,
}

/// Tables and lists of frames by name, relative to the run's folder. Those that had not begun are not among
/// them.
pub type Marks = BTreeMap<String, Mark>;

/// A mark that follows what is written.
#[derive(Debug, Default)]
pub(crate) struct Marking {
    length: u64,
    sum: Crc,
}

impl Marking {
    /// Of the first `length` bytes of a file, or of what there is of them.
    pub(crate) fn of(file: &mut impl Read, length: u64) -> io::Result<Self> {
        let (mut marking, mut part) = (Self::default(), vec![0; 1 << 16]);
        let mut file = file.take(length);
        loop {
            match file.read(&mut part) {
                Ok(0) => return Ok(marking),
                Ok(read) => marking.add(&part[..read]),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }

    /// More bytes behind the others.
    pub(crate) fn add(&mut self, bytes: &[u8]) {
        self.length += bytes.len() as u64;
        self.sum.update(bytes);
    }

    /// The mark.
    pub(crate) fn mark(&self) -> Mark {
        Mark { length: self.length, sum: self.sum.sum() }
    }
}

/// The mark of a whole text.
pub(crate) fn mark_of(text: &str) -> Mark {
    let mut marking = Marking::default();
    marking.add(text.as_bytes());
    marking.mark()
}

/// What a run had written before it was interrupted and is not there any more.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Loss {
    /// The file is not there; it begins anew.
    Missing(PathBuf),
    /// The file was cut or altered. It is kept under this name; of what is readable in it the run goes on.
    Damaged(PathBuf),
}

impl Loss {
    /// The file that is missing, or that in which a damaged one was kept.
    pub fn path(&self) -> &Path {
        match self {
            Self::Missing(path) | Self::Damaged(path) => path,
        }
    }
}

impl std::fmt::Display for Loss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Missing(path) => {
                write!(f, "{} is missing: it begins anew, without the steps so far", path.display())
            }
            Self::Damaged(path) => write!(
                f,
                "a table or list of frames was cut or altered: it is kept as {}, and what is readable of it goes on",
                path.display()
            ),
        }
    }
}
