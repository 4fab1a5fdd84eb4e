//! Stands in for `hdf5` where the feature `fclib` is off: every HDF5 file is refused, naming the feature.

use super::error::{Defect, ProblemFileError};
use super::raw::Stated;
use graintrain_ccp::Ccp;
use std::path::Path;

const REMEDY: &str = "build graintrain-io with its feature `fclib`; the command line has it";

/// Refuses the file.
pub(super) fn parse(_bytes: Vec<u8>) -> Result<Stated, Defect> {
    let what =
        "an HDF5 file, which is read only with the feature `fclib`, and this program was built without it";
    Err(Defect::unsupported(what, REMEDY))
}

/// Writes a problem as an FCLIB file, which this build cannot.
///
/// # Errors
/// Always [`ProblemFileError::Unsupported`]: the feature `fclib` is off.
pub fn write(path: &Path, _problem: &Ccp, _title: &str) -> Result<(), ProblemFileError> {
    let what = "problems are written as HDF5 files, which takes the feature `fclib`, and this program was built without it";
    Err(Defect::unsupported(what, REMEDY).in_file(path))
}
