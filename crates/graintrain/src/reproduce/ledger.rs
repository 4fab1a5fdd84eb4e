//! Finished cells of a reproduction, one JSON line each, so that a killed one goes on where it was.

use super::ReproduceError;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Results by key, backed by a file that grows by a line per result.
pub struct Ledger {
    path: PathBuf,
    file: File,
    cells: HashMap<String, serde_json::Value>,
}

impl Ledger {
    /// Opens or begins the ledger. A last line that a kill cut short is removed.
    ///
    /// # Errors
    /// [`ReproduceError::File`] where the file cannot be read or written.
    pub fn open(path: &Path) -> Result<Self, ReproduceError> {
        let failed = |source| ReproduceError::File { path: path.to_path_buf(), source };
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => return Err(failed(error)),
        };
        let mut cells = HashMap::new();
        let mut whole = 0;
        for line in text.split_inclusive('\n').take_while(|line| line.ends_with('\n')) {
            let Ok((key, value)) = serde_json::from_str::<(String, serde_json::Value)>(line) else { break };
            cells.insert(key, value);
            whole += line.len();
        }
        let mut file =
            OpenOptions::new().create(true).truncate(false).write(true).open(path).map_err(failed)?;
        file.set_len(whole as u64).map_err(failed)?;
        std::io::Seek::seek(&mut file, std::io::SeekFrom::End(0)).map_err(failed)?;
        Ok(Self { path: path.to_path_buf(), file, cells })
    }

    /// The result of a cell, if it is there and readable.
    pub fn get<T: DeserializeOwned>(&self, key: &str) -> Option<T> {
        self.cells.get(key).and_then(|value| T::deserialize(value).ok())
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
