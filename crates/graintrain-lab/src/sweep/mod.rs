//! Sweeps: a scene run at many values of its parameters, with several seeds each, and what comes out of it in
//! one table and one page.
//!
//! | module | holds |
//! |---|---|
//! | [`plan`] | which runs: grids, tables, seeds |
//! | [`execute`] | makes the runs, some at a time; a sweep that was killed goes on |
//! | [`collect`] | observables of the runs, means and errors over seeds, CSV files |
//! | [`fit`] | constants of a model from the points, with their errors |
//! | [`report`] | one page with plots |
//! | [`study`] | sweeps over the time step or the tolerance, with what follows from them |
//!
//! A sweep's folder holds `runs/NAME`, an ordinary folder of a run each, whose name is made of the values. It
//! can be extended by more values or seeds: runs that are there are kept if their scene is the same.

pub mod collect;
pub mod execute;
pub mod fit;
pub mod plan;
pub mod report;
pub mod study;

use graintrain_io::files::OutputError;
use graintrain_io::output::folder::{Occupied, PrepareError};
use graintrain_io::scene::SceneError;
use graintrain_view::view::ViewError;
use graintrain_view::view::tables::Table;
use std::path::{Path, PathBuf};

/// Why a sweep could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SweepError {
    /// The plan is no plan.
    #[error("{0}")]
    Plan(String),
    /// A point's scene is wrong.
    #[error("at {point}: {error}")]
    Scene {
        /// The values.
        point: String,
        /// What is wrong.
        error: Box<SceneError>,
    },
    /// A run of that name is there, of another scene.
    #[error(
        "{} holds a run of another scene or other settings: choose another folder, or remove it to make that run again",
        folder.display()
    )]
    Differs {
        /// The run's folder.
        folder: PathBuf,
    },
    /// A run was begun there, and its state cannot be read.
    #[error("{} holds a run that cannot be gone on with: {reason}; remove it to make that run again", folder.display())]
    Unusable {
        /// The run's folder.
        folder: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The folder holds something else.
    #[error(transparent)]
    Occupied(Occupied),
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A file cannot be read.
    #[error("cannot read {}: {reason}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// Threads could not be started.
    #[error("cannot start threads: {0}")]
    Threads(String),
    /// An observable that no run has.
    #[error("no run has the observable `{name}`; there are: {known}")]
    Observable {
        /// As asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// Somebody asked to stop; what is done is kept.
    #[error("stopped; the same command goes on")]
    Stopped,
}

impl From<PrepareError> for SweepError {
    fn from(error: PrepareError) -> Self {
        match error {
            PrepareError::Occupied(occupied) => Self::Occupied(occupied),
            PrepareError::Output(error) => Self::Output(error),
        }
    }
}

/// Reads a table.
///
/// # Errors
/// [`SweepError::Read`].
pub(crate) fn read_table(path: &Path) -> Result<Table, SweepError> {
    Table::read(path).map_err(|error| {
        // The error of a sweep names the file itself.
        let reason = match error {
            ViewError::Read { source, .. } => source.to_string(),
            error => error.to_string(),
        };
        SweepError::Read { path: path.to_path_buf(), reason }
    })
}
