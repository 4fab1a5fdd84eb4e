//! Replay of a run as one self-contained HTML page.
//!
//! The page needs no network and no library: it holds the frames (16-bit positions relative to the box around
//! the motion, differences from frame to frame, gzip, base64) and a WebGL 2 program that draws spheres as
//! exact balls, other shapes as meshes and contact forces as tubes, with light and shadow, cuts, picking, and
//! the figures of the run.
//!
//! | module | holds |
//! |---|---|
//! | [`run_folder`] | a run's folder as a sequence of worlds |
//! | [`vtp_file`] | the reader of the run's own frame files |
//! | [`pack`] | frames as bytes, and back |
//! | [`tables`] | tables of a run |
//! | [`live`] | the same page of a run under way |
//! | [`model`] | what is seen of a world |
//! | `page` | the HTML |
//! | [`mod@usd`] | the same frames for Blender, Omniverse and others |

pub mod live;
pub mod model;
pub mod pack;
pub mod page;
pub mod run_folder;
pub mod tables;
pub mod usd;
pub mod vtp_file;

pub use page::{ViewSettings, page};
pub use run_folder::RunFolder;
pub use usd::usd;

use graintrain_io::checkpoint::CheckpointError;
use std::path::{Path, PathBuf};

/// Why a run cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// There is no usable checkpoint: geometries are unknown.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file is not what the run wrote.
    #[error("{} is damaged: {what}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The run wrote no frames.
    #[error("{} holds no frames: run the scene with frames of the bodies switched on", folder.display())]
    NoFrames {
        /// The run's folder.
        folder: PathBuf,
    },
    /// The frames do not fit into memory or a page.
    #[error("the page cannot be made: {0}")]
    Pack(#[from] std::io::Error),
}

fn read_text(path: &Path) -> Result<String, ViewError> {
    std::fs::read_to_string(path).map_err(|source| ViewError::Read { path: path.to_path_buf(), source })
}

#[cfg(test)]
mod tests;
