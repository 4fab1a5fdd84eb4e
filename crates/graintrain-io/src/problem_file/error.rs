//! What can be wrong with a problem file.

use std::path::{Path, PathBuf};

/// Why a problem file could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProblemFileError {
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file is damaged, or not a contact problem.
    #[error("{}: {place}: {what}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where in the file: an HDF5 path, or a line.
        place: String,
        /// What is wrong there.
        what: String,
        /// What the user can do about it.
        remedy: &'static str,
    },
    /// The file is sound, but holds a problem that is not solved here.
    #[error("{}: {what}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What it holds.
        what: String,
        /// What the user can do about it.
        remedy: &'static str,
    },
}

impl ProblemFileError {
    /// What the user can do about it.
    pub fn remedy(&self) -> &str {
        match self {
            Self::Io { .. } => "check the name and the permissions of the file",
            Self::Damaged { remedy, .. } | Self::Unsupported { remedy, .. } => remedy,
        }
    }
}

/// An error before the name of the file is attached.
#[derive(Debug)]
pub(super) enum Defect {
    Damaged { place: String, what: String, remedy: &'static str },
    Unsupported { what: String, remedy: &'static str },
}

/// Remedy for a file that ends early or is garbled.
pub(super) const COPY_AGAIN: &str =
    "it is truncated or no problem file (FCLIB, Siconos or graintrain): copy or download it again";
/// Remedy for numbers that the program that wrote the file got wrong.
pub(super) const WRITE_AGAIN: &str = "write the problem again with finite numbers and matching sizes";

impl Defect {
    pub(super) fn damaged(place: impl Into<String>, what: impl Into<String>, remedy: &'static str) -> Self {
        Self::Damaged { place: place.into(), what: what.into(), remedy }
    }

    pub(super) fn unsupported(what: impl Into<String>, remedy: &'static str) -> Self {
        Self::Unsupported { what: what.into(), remedy }
    }

    pub(super) fn in_file(self, path: &Path) -> ProblemFileError {
        let path = path.to_path_buf();
        match self {
            Self::Damaged { place, what, remedy } => ProblemFileError::Damaged { path, place, what, remedy },
            Self::Unsupported { what, remedy } => ProblemFileError::Unsupported { path, what, remedy },
        }
    }
}
