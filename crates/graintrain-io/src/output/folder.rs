//! The folder of a run, held by one process at a time.

use crate::checkpoint;
use crate::files::{OutputError, make_folder, refuse_link};
use std::fs::{File, TryLockError};
use std::io::{BufRead, BufReader, ErrorKind};
use std::path::{Path, PathBuf};

/// A folder that holds something else, where a run should go.
#[derive(Debug, thiserror::Error)]
#[error("{} is not empty", folder.display())]
pub struct Occupied {
    /// The folder.
    pub folder: PathBuf,
}

/// What stands in the way of a new run's folder.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// There is something in it.
    #[error(transparent)]
    Occupied(#[from] Occupied),
    /// The system refuses.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Files of a run, directly in its folder.
const FILES: &[&str] = &[
    "all.pvd",
    "bodies.pvd",
    "surfaces.pvd",
    "contacts.pvd",
    "steps.csv",
    "wrench.csv",
    "joints.csv",
    "newton.csv",
    "columns.json",
    "summary.json",
    "scene.toml",
];
/// Folders of a run, and what is in them.
const FOLDERS: &[(&str, &str)] = &[
    ("frames", "vtp"),
    ("frames", "vtm"),
    ("checkpoints", "ckpt"),
    ("problems", "hdf5"),
    ("measures", "csv"),
    ("plots", "svg"),
];

/// Who holds this file locked writes into its folder.
const LOCK: &str = ".lock";

/// Locks the folder's file.
fn lock(folder: &Path) -> Result<Option<File>, OutputError> {
    let path = folder.join(LOCK);
    let refuse = |error| OutputError::new("take the folder", folder, error);
    refuse_link(&path)?;
    let file = File::options().create(true).append(true).open(&path).map_err(refuse)?;
    match file.try_lock() {
        Ok(()) => Ok(Some(file)),
        Err(TryLockError::WouldBlock) => {
            let why = "another process is writing results into it";
            Err(refuse(std::io::Error::new(std::io::ErrorKind::ResourceBusy, why)))
        }
        // A file system that knows no locks.
        Err(TryLockError::Error(_)) => Ok(None),
    }
}

/// The folder of a run, taken for this process until it is dropped: two runs in one folder would write into
/// each other's tables.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    _lock: Option<File>,
}

impl RunFolder {
    /// Makes the folder of a new run, or takes one in which a run was ended before it made a step. With
    /// `force`, the files of an earlier run are removed from it, and nothing else.
    ///
    /// # Errors
    /// [`PrepareError::Occupied`] where the folder holds something and `force` is not set;
    /// [`PrepareError::Output`] where another process writes into it, or a folder in it is a link.
    pub fn create(path: &Path, force: bool) -> Result<Self, PrepareError> {
        make_folder(path)?;
        let refuse = || if force { Ok(()) } else { refuse_occupied(path) };
        // Nothing is written into a folder that is refused; whoever held it may have filled it meanwhile.
        refuse()?;
        let folder = Self::open(path)?;
        refuse()?;
        clear(path)?;
        Ok(folder)
    }

    /// Takes the folder of an earlier run.
    ///
    /// # Errors
    /// Where it is not there, another process writes into it, or a folder in it is a link.
    pub fn open(path: &Path) -> Result<Self, OutputError> {
        for (inner, _) in FOLDERS {
            refuse_link(&path.join(inner))?;
        }
        Ok(Self { _lock: lock(path)?, path: path.to_path_buf() })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

fn entries(folder: &Path) -> Result<std::fs::ReadDir, OutputError> {
    std::fs::read_dir(folder).map_err(|error| OutputError::new("read the folder", folder, error))
}

/// That a folder is there and free for results.
///
/// # Errors
/// [`PrepareError::Occupied`] where it holds something; [`PrepareError::Output`] where it cannot be read.
pub fn refuse_occupied(folder: &Path) -> Result<(), PrepareError> {
    match is_occupied(folder)? {
        true => Err(PrepareError::from(Occupied { folder: folder.to_path_buf() })),
        false => Ok(()),
    }
}

/// Whether a folder holds anything but the beginning of a run that had not written its first checkpoint,
/// which it does before its first step.
fn is_occupied(folder: &Path) -> Result<bool, OutputError> {
    let of_begun = |name: &str| FILES.contains(&name) || FOLDERS.iter().any(|(inner, _)| *inner == name);
    let is_known = |name: &str| name == LOCK || of_begun(name.strip_suffix(".part").unwrap_or(name));
    let has_others =
        entries(folder)?.flatten().any(|entry| !entry.file_name().to_str().is_some_and(is_known));
    // Somebody may have removed the checkpoints and kept the rest.
    let has_step = match File::open(folder.join("steps.csv")) {
        Ok(file) => BufReader::new(file).lines().nth(1).is_some(),
        Err(error) => error.kind() != ErrorKind::NotFound,
    };
    let is_kept = folder.join("summary.json").exists() || checkpoint::is_in(&folder.join("checkpoints"));
    Ok(has_others || has_step || is_kept)
}

/// Removes the files of an earlier run.
fn clear(folder: &Path) -> Result<(), OutputError> {
    let remove = |path: &Path| match std::fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(OutputError::new("replace", path, error))
        }
        _ => Ok(()),
    };
    for file in FILES {
        remove(&folder.join(file))?;
    }
    for (name, extension) in FOLDERS {
        let inner = folder.join(name);
        if !inner.is_dir() {
            continue;
        }
        for entry in entries(&inner)?.flatten() {
            let path = entry.path();
            if path.extension().is_some_and(|found| found == *extension) {
                remove(&path)?;
            }
        }
    }
    Ok(())
}
