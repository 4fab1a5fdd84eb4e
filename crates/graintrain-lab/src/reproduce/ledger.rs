//! Finished cells of a reproduction, one JSON line each, so that a killed one goes on where it was.

use super::ReproduceError;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::HashMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Results by key, backed by a file that grows by a line per result.
pub struct Ledger {
    path: PathBuf,
    file: File,
    cells: HashMap<String, serde_json::Value>,
    /// Whole lines that could not be read. The file as it was is kept with `.damaged` added to its name.
    pub damaged: usize,
}

impl Ledger {
    /// Opens or begins the ledger, for this process alone. A last line that a kill cut short is removed;
    /// other lines that cannot be read are left out, and the file as it was is kept beside.
    ///
    /// # Errors
    /// [`ReproduceError::File`] where the file cannot be read or written, [`ReproduceError::Busy`] where
    /// another process has it.
    pub fn open(path: &Path) -> Result<Self, ReproduceError> {
        let failed = |source| ReproduceError::File { path: path.to_path_buf(), source };
        let mut file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(path)
            .map_err(failed)?;
        file.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => ReproduceError::Busy { path: path.to_path_buf() },
            TryLockError::Error(source) => failed(source),
        })?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(failed)?;
        let mut cells = HashMap::new();
        let (mut whole, mut damaged) = (Vec::new(), 0);
        for line in bytes.split_inclusive(|&byte| byte == b'\n').filter(|line| line.ends_with(b"\n")) {
            match serde_json::from_slice::<(String, serde_json::Value)>(line) {
                Ok((key, value)) => {
                    cells.insert(key, value);
                    whole.extend_from_slice(line);
                }
                Err(_) => damaged += 1,
            }
        }
        if damaged > 0 {
            let mut kept = path.as_os_str().to_owned();
            kept.push(".damaged");
            std::fs::write(PathBuf::from(kept), &bytes).map_err(failed)?;
            // In place, since the lock belongs to this file.
            file.seek(SeekFrom::Start(0)).and_then(|_| file.write_all(&whole)).map_err(failed)?;
        }
        file.set_len(whole.len() as u64).map_err(failed)?;
        file.seek(SeekFrom::End(0)).map_err(failed)?;
        Ok(Self { path: path.to_path_buf(), file, cells, damaged })
    }

    /// The result of a cell, if it is there and readable.
    pub fn get<T: DeserializeOwned>(&self, key: &str) -> Option<T> {
        self.cells.get(key).and_then(|value| T::deserialize(value).ok())
    }

    /// All results of one kind, in no order.
    pub fn all<T: DeserializeOwned>(&self) -> impl Iterator<Item = T> + '_ {
        self.cells.values().filter_map(|value| T::deserialize(value).ok())
    }

    /// Adds a result.
    ///
    /// # Errors
    /// [`ReproduceError::File`] where it cannot be written.
    pub fn put<T: Serialize>(&mut self, key: &str, result: &T) -> Result<(), ReproduceError> {
        let failed = |source| ReproduceError::File { path: self.path.clone(), source };
        let value = serde_json::to_value(result).map_err(|error| failed(error.into()))?;
        let mut line = serde_json::to_string(&(key, &value)).map_err(|error| failed(error.into()))?;
        line.push('\n');
        self.file.write_all(line.as_bytes()).and_then(|()| self.file.sync_data()).map_err(failed)?;
        self.cells.insert(key.to_string(), value);
        Ok(())
    }
}
