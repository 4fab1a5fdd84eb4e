//! Reads problems from HDF5 files.

use super::error::{COPY_AGAIN, Defect};
use super::raw::Stated;
use super::{dump, fclib};

pub use super::dump::write;

/// Reads the problem of an FCLIB file or a dump.
pub(super) fn parse(bytes: Vec<u8>) -> Result<Stated, Defect> {
    let file = hdf5_pure::File::from_bytes(bytes)
        .map_err(|error| Defect::damaged("the HDF5 structure", error.to_string(), COPY_AGAIN))?;
    let fclib::Read { raw, group: form, title, remark } = fclib::read(&file)?;
    raw.check(|part| match part {
        "W" | "V" | "R" | "M" | "H" | "G" => format!("{form}/{part}"),
        vector => format!("{form}/vectors/{vector}"),
    })?;
    let extras = dump::read_extras(&file, &raw)?;
    Ok(Stated { raw, title, remark, extras })
}
