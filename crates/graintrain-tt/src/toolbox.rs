//! Trains of other programs: MATLAB files of TT-Toolbox (level 5, `save -v6` and `-v7`) and the binary files
//! of TT-Toolbox's `tt_save`, ttpy's `write` and tt-fort ("SDV").
//!
//! Both keep cores as this crate does: first index fastest, the modes of a matrix row digit fastest. Nothing
//! in a file is believed: sizes are held against what is really there before memory is asked for, and what is
//! damaged, complex or of another version is a [`TtError::Format`] that says where.
//!
//! SDV: 8 bytes `TT` and blanks; version 1, 0; four numbers; a comment of 64 bytes; eight numbers; the first
//! and the last mode l, m; modes; ranks (all i32, little-endian); cores as f64.

use crate::vector::Core;
use crate::{TtError, TtVector};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

#[cfg(feature = "mat")]
mod mat;
#[cfg(feature = "mat")]
pub use mat::{Stored, read_mat};

/// Bytes of an SDV file before the sizes.
const HEADER: usize = 8 + 4 * (2 + 4) + 64 + 4 * 8;

/// Bytes of a file with the place that is read next; every number is checked to be there.
struct Bytes<'a> {
    file: &'a Path,
    data: &'a [u8],
    at: usize,
}

impl<'a> Bytes<'a> {
    fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], TtError> {
        match self.at.checked_add(count).and_then(|end| self.data.get(self.at..end)) {
            Some(bytes) => {
                self.at += count;
                Ok(bytes)
            }
            None => Err(self.fault(format!("the file ends inside {what}; it is incomplete or damaged"))),
        }
    }

    fn fault(&self, what: String) -> TtError {
        TtError::Format { file: self.file.display().to_string(), offset: self.at as u64, what }
    }

    fn integer(&mut self, what: &str) -> Result<i32, TtError> {
        let bytes = self.take(4, what)?;
        Ok(i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }
}

fn open(file: &Path) -> Result<Vec<u8>, TtError> {
    std::fs::read(file).map_err(|source| TtError::File { file: file.display().to_string(), source })
}

/// Numbers of f64, little-endian.
fn doubles(bytes: &[u8]) -> Vec<f64> {
    let number = |b: &[u8]| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]);
    bytes.chunks_exact(8).map(number).collect()
}

/// Reads an SDV file: what TT-Toolbox's `tt_save`, ttpy's `vector.write` and tt-fort's `write` make of a real
/// train in double precision.
///
/// A matrix is saved by them as the train of its paired modes:
/// [`TtMatrix::from_vector`](crate::TtMatrix::from_vector) makes it one again.
///
/// # Errors
/// [`TtError::File`] if the file cannot be read; [`TtError::Format`] if it is damaged, of another version,
/// complex or in single precision; [`TtError::Shape`] if its outer ranks are not 1.
pub fn read_sdv(file: &Path) -> Result<TtVector, TtError> {
    let data = open(file)?;
    let mut input = Bytes { file, data: &data, at: 0 };
    if &input.take(8, "the header")?[..2] != b"TT" {
        input.at = 0;
        return Err(input.fault("not a train of TT-Toolbox or tt-fort (expected the bytes TT)".to_owned()));
    }
    let version = input.integer("the version")?;
    if version != 1 {
        return Err(input.fault(format!("version {version} (little-endian), expected 1")));
    }
    input.take(HEADER - input.at, "the header")?;
    let (first, last) = (input.integer("the first mode")?, input.integer("the last mode")?);
    let d = i64::from(last) - i64::from(first) + 1;
    if d < 1 || d > (data.len() / 8) as i64 {
        return Err(input.fault(format!("modes {first} to {last} in a file of {} bytes", data.len())));
    }
    let sizes = |input: &mut Bytes<'_>, count: usize, what: &str| -> Result<Vec<usize>, TtError> {
        let mut list = Vec::with_capacity(count);
        for _ in 0..count {
            let size = input.integer(what)?;
            list.push(
                usize::try_from(size)
                    .ok()
                    .filter(|&n| n > 0)
                    .ok_or_else(|| input.fault(format!("{what} is {size}, expected at least 1")))?,
            );
        }
        Ok(list)
    };
    let modes = sizes(&mut input, d as usize, "a mode")?;
    let ranks = sizes(&mut input, d as usize + 1, "a rank")?;
    let numbers = |k: usize| ranks[k].saturating_mul(modes[k]).saturating_mul(ranks[k + 1]);
    let total = (0..modes.len()).fold(0usize, |sum, k| sum.saturating_add(numbers(k)));
    let rest = data.len() - input.at;
    if total.checked_mul(8) != Some(rest) {
        let kind = match total.checked_mul(16) {
            Some(bytes) if bytes == rest => " (complex trains cannot be read)",
            _ => "",
        };
        return Err(input.fault(format!("{rest} bytes for {total} numbers of the cores{kind}")));
    }
    let mut cores = Vec::with_capacity(modes.len());
    for k in 0..modes.len() {
        let data = doubles(input.take(numbers(k) * 8, "a core")?);
        cores.push(Core::new(ranks[k], modes[k], ranks[k + 1], data)?);
    }
    TtVector::from_cores(cores)
}

/// Writes an SDV file of f64 for `tt_read` of TT-Toolbox, `vector.read` of ttpy and `read` of tt-fort.
///
/// # Errors
/// [`TtError::File`] if the file cannot be written, [`TtError::TooLarge`] for a size above 2^31 - 1.
pub fn write_sdv(train: &TtVector, file: &Path) -> Result<(), TtError> {
    let fault = |source| TtError::File { file: file.display().to_string(), source };
    let mut out = BufWriter::new(File::create(file).map_err(fault)?);
    let d = train.num_cores();
    // The size of an array of tt-fort's type comes first of the four numbers; first and last mode first of
    // the eight.
    let mut header = b"TT      ".to_vec();
    let put = |numbers: &[usize], bytes: &mut Vec<u8>| -> Result<(), TtError> {
        for &n in numbers {
            let n = i32::try_from(n).map_err(|_| TtError::TooLarge { entries: n as f64 })?;
            bytes.extend(n.to_le_bytes());
        }
        Ok(())
    };
    put(&[1, 0, 128, 0, 0, 0], &mut header)?;
    header.extend([b' '; 64]);
    put(&[1, d, 0, 0, 0, 0, 0, 0, 1, d], &mut header)?;
    put(&train.modes(), &mut header)?;
    put(&train.ranks(), &mut header)?;
    out.write_all(&header).map_err(fault)?;
    for x in train.cores().iter().flat_map(Core::data) {
        out.write_all(&x.to_le_bytes()).map_err(fault)?;
    }
    out.flush().map_err(fault)
}
