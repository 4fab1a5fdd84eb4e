//! Saving and loading trains: a small versioned binary container.
//!
//! Little-endian: the 8 bytes `GTTRAIN1`; the number of index groups g (u64: 1 for a vector, 2 for a matrix)
//! and of cores d (u64); g lists of d sizes (u64); d + 1 ranks (u64); the numbers of the cores (f64), core by
//! core, first index fastest; nothing after them. Numbers that are not finite are refused. Any serde format
//! works too: the types implement `Serialize` and `Deserialize`.

use crate::vector::Core;
use crate::{TtError, TtMatrix, TtVector};
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;

const MAGIC: &[u8; 8] = b"GTTRAIN1";
/// Sizes above this are taken for damage, not for data.
const LARGEST_SIZE: u64 = 1 << 32;

impl TtVector {
    /// Writes the train to a file.
    ///
    /// # Errors
    /// [`TtError::File`] if the file cannot be written.
    pub fn save(&self, file: &Path) -> Result<(), TtError> {
        write(file, &[self.modes()], self)
    }

    /// Reads a train from a file.
    ///
    /// # Errors
    /// [`TtError::File`] if it cannot be read, [`TtError::Format`] if it is not a train of a vector.
    pub fn load(file: &Path) -> Result<Self, TtError> {
        Ok(read(file, 1)?.1)
    }
}

impl TtMatrix {
    /// Writes the train to a file.
    ///
    /// # Errors
    /// [`TtError::File`] if the file cannot be written.
    pub fn save(&self, file: &Path) -> Result<(), TtError> {
        write(file, &[self.rows.clone(), self.columns.clone()], &self.train)
    }

    /// Reads a train from a file.
    ///
    /// # Errors
    /// [`TtError::File`] if it cannot be read, [`TtError::Format`] if it is not a train of a matrix.
    pub fn load(file: &Path) -> Result<Self, TtError> {
        let (sizes, train) = read(file, 2)?;
        Self::from_vector(train, &sizes[0], &sizes[1])
    }
}

fn write(file: &Path, sizes: &[Vec<usize>], train: &TtVector) -> Result<(), TtError> {
    let fault = |source| TtError::File { file: file.display().to_string(), source };
    let mut out = BufWriter::new(File::create(file).map_err(fault)?);
    let mut put = |bytes: &[u8]| out.write_all(bytes).map_err(fault);
    put(MAGIC)?;
    let header = [sizes.len(), train.num_cores()];
    for n in header.iter().chain(sizes.iter().flatten()).chain(&train.ranks()) {
        put(&(*n as u64).to_le_bytes())?;
    }
    for core in train.cores() {
        core.data().iter().try_for_each(|x| put(&x.to_le_bytes()))?;
    }
    out.flush().map_err(fault)
}

/// A file being read, with the position for messages.
struct Input<'a> {
    file: &'a Path,
    reader: BufReader<File>,
    offset: u64,
}

impl Input<'_> {
    fn take(&mut self, what: &str) -> Result<[u8; 8], TtError> {
        let mut bytes = [0; 8];
        match self.reader.read_exact(&mut bytes) {
            Ok(()) => {
                self.offset += 8;
                Ok(bytes)
            }
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
                Err(self.fault(format!("the file ends inside {what}; it is incomplete")))
            }
            Err(source) => Err(TtError::File { file: self.file.display().to_string(), source }),
        }
    }

    /// Nothing may follow.
    fn end(&mut self) -> Result<(), TtError> {
        match self.reader.read(&mut [0]) {
            Ok(0) => Ok(()),
            Ok(_) => Err(self.fault("there is more after the last core; the file is damaged".to_owned())),
            Err(source) => Err(TtError::File { file: self.file.display().to_string(), source }),
        }
    }

    fn fault(&self, what: String) -> TtError {
        TtError::Format { file: self.file.display().to_string(), offset: self.offset, what }
    }

    fn size(&mut self, what: &str) -> Result<usize, TtError> {
        let n = u64::from_le_bytes(self.take(what)?);
        if n == 0 || n > LARGEST_SIZE {
            return Err(self.fault(format!("{what} is {n}, expected 1 to {LARGEST_SIZE}")));
        }
        Ok(n as usize)
    }

    fn sizes(&mut self, count: usize, what: &str) -> Result<Vec<usize>, TtError> {
        (0..count).map(|_| self.size(what)).collect()
    }
}

fn read(file: &Path, groups: usize) -> Result<(Vec<Vec<usize>>, TtVector), TtError> {
    let opened =
        File::open(file).map_err(|source| TtError::File { file: file.display().to_string(), source })?;
    let mut input = Input { file, reader: BufReader::new(opened), offset: 0 };
    let magic = input.take("the header")?;
    if &magic != MAGIC {
        return Err(input.fault("not a tensor train (expected the bytes GTTRAIN1)".to_owned()));
    }
    let found = input.size("the number of index groups")?;
    if found != groups {
        return Err(input.fault(format!("{found} index groups, expected {groups} (1 vector, 2 matrix)")));
    }
    let d = input.size("the number of cores")?;
    let sizes = (0..groups).map(|_| input.sizes(d, "a mode size")).collect::<Result<Vec<_>, _>>()?;
    let ranks = input.sizes(d + 1, "a rank")?;
    let mut cores = Vec::new();
    for k in 0..d {
        let mode = sizes.iter().fold(1usize, |product, list| product.saturating_mul(list[k]));
        let numbers = ranks[k].saturating_mul(mode).saturating_mul(ranks[k + 1]);
        // Grows with what is really in the file: a damaged size cannot ask for all memory.
        let mut data = Vec::new();
        for _ in 0..numbers {
            let number = f64::from_le_bytes(input.take("a core")?);
            if !number.is_finite() {
                return Err(input.fault(format!("core {} holds {number}, expected finite numbers", k + 1)));
            }
            data.push(number);
        }
        cores.push(Core::new(ranks[k], mode, ranks[k + 1], data)?);
    }
    input.end()?;
    Ok((sizes, TtVector::from_cores(cores)?))
}
