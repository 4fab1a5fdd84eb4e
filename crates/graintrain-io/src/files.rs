//! Writing files so that whatever happens, what was computed stays readable.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// An output that could not be written or read.
#[derive(Debug, thiserror::Error)]
#[error("cannot {action} {}: {}", path.display(), reason(source))]
pub struct OutputError {
    action: &'static str,
    path: PathBuf,
    source: io::Error,
}

/// The operating system's reason, in plain words for the common ones.
fn reason(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::StorageFull => "the disk is full".to_string(),
        io::ErrorKind::QuotaExceeded => "the disk quota is used up".to_string(),
        io::ErrorKind::FileTooLarge => "the file would exceed the size that the system allows".to_string(),
        io::ErrorKind::PermissionDenied => "permission denied".to_string(),
        io::ErrorKind::ReadOnlyFilesystem => "the file system is read-only".to_string(),
        io::ErrorKind::NotADirectory => "a part of the path is a file, not a folder".to_string(),
        _ => error.to_string(),
    }
}

impl OutputError {
    /// `action` is a verb: "write", "read".
    pub fn new(action: &'static str, path: &Path, source: io::Error) -> Self {
        Self { action, path: path.to_path_buf(), source }
    }

    /// The file or folder concerned.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the user can do.
    pub fn remedy(&self) -> &'static str {
        match self.source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => {
                "make room, or write fewer frames; what was written before is complete, and `graintrain resume` goes on from the last checkpoint"
            }
            io::ErrorKind::ResourceBusy => {
                "wait until the other run has ended, or choose another folder with --out"
            }
            _ => "choose another folder with --out",
        }
    }
}

/// Makes a folder and its parents.
///
/// # Errors
/// Where the system refuses.
pub fn make_folder(path: &Path) -> Result<(), OutputError> {
    fs::create_dir_all(path).map_err(|error| OutputError::new("make the folder", path, error))
}

/// Writes a whole file under a temporary name and renames it: readers see the old file or the new one, never a part.
///
/// # Errors
/// Where the system refuses; the temporary file is then removed.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    replace(path, |file| file.write_all(bytes))
}

/// As [`write_atomically`], and on the disk before the rename, so that even a power failure leaves a whole file.
///
/// # Errors
/// Where the system refuses; the temporary file is then removed.
pub fn write_durably(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    replace(path, |file| {
        file.write_all(bytes)?;
        file.sync_all()
    })
}

fn replace(path: &Path, write: impl FnOnce(&mut File) -> io::Result<()>) -> Result<(), OutputError> {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".part");
    let temporary = path.with_file_name(name);
    let result = File::create(&temporary)
        .and_then(|mut file| write(&mut file))
        .and_then(|()| fs::rename(&temporary, path));
    result.map_err(|error| {
        // The part is of no use, and on a full disk the room is: a failure to remove it changes nothing.
        let _ = fs::remove_file(&temporary);
        OutputError::new("write", path, error)
    })
}

/// A table in CSV form to which records are appended, each written and handed to the system at once.
#[derive(Debug)]
pub struct Table {
    path: PathBuf,
    file: File,
    /// Bytes of complete records.
    length: u64,
}

impl Table {
    /// A new table, replacing any old one.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn create(path: PathBuf, header: &str) -> Result<Self, OutputError> {
        let file = File::create(&path).map_err(|error| OutputError::new("write", &path, error))?;
        let mut table = Self { path, file, length: 0 };
        table.append(header)?;
        Ok(table)
    }

    /// Reopens a table and drops the records after step `last_step` (the first column) and a record cut short; a new
    /// table where there is none or its header differs.
    ///
    /// # Errors
    /// Where the file cannot be read or written.
    pub fn reopen(path: PathBuf, header: &str, last_step: u64) -> Result<Self, OutputError> {
        let mut file = match OpenOptions::new().read(true).write(true).open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Self::create(path, header),
            Err(error) => return Err(OutputError::new("open", &path, error)),
        };
        let mut text = String::new();
        // Text that is not UTF-8 is no table of ours: begin anew.
        if file.read_to_string(&mut text).is_err() || text.lines().next() != Some(header) {
            return Self::create(path, header);
        }
        let kept: usize = text
            .split_inclusive('\n')
            .enumerate()
            .take_while(|(line, record)| {
                record.ends_with('\n') && (*line == 0 || step_of(record) <= last_step)
            })
            .map(|(_, record)| record.len())
            .sum();
        let mut table = Self { path, file, length: kept as u64 };
        table.cut().map_err(|error| OutputError::new("write", &table.path, error))?;
        Ok(table)
    }

    /// Appends one record (without its newline).
    ///
    /// # Errors
    /// Where the system refuses; the part that was written is then taken back.
    pub fn append(&mut self, record: &str) -> Result<(), OutputError> {
        let line = format!("{record}\n");
        if let Err(error) = self.file.write_all(line.as_bytes()) {
            // Without the half-written record the table stays readable; should that fail too, the first error tells.
            let _ = self.cut();
            return Err(OutputError::new("write", &self.path, error));
        }
        self.length += line.len() as u64;
        Ok(())
    }

    fn cut(&mut self) -> io::Result<()> {
        self.file.set_len(self.length)?;
        self.file.seek(SeekFrom::End(0)).map(|_| ())
    }
}

/// First column of a record; a record without one comes after everything.
fn step_of(record: &str) -> u64 {
    record.split(',').next().and_then(|step| step.parse().ok()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reopened_table_drops_later_and_broken_records() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("steps.csv");
        let mut table = Table::create(path.clone(), "step,time").unwrap();
        for step in 1..=5 {
            table.append(&format!("{step},{}", 0.1 * f64::from(step))).unwrap();
        }
        drop(table);
        let mut file = OpenOptions::new().append(true).open(&path).unwrap();
        file.write_all(b"6,0.").unwrap();
        let mut table = Table::reopen(path.clone(), "step,time", 3).unwrap();
        table.append("4,again").unwrap();
        assert_eq!(
            fs::read_to_string(&path).unwrap(),
            "step,time\n1,0.1\n2,0.2\n3,0.30000000000000004\n4,again\n"
        );
        let _ = Table::reopen(path.clone(), "step,time", 9).unwrap();
        assert!(fs::read_to_string(&path).unwrap().ends_with("4,again\n"));
        let _ = Table::reopen(path.clone(), "step,time,more", 9).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "step,time,more\n");
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_part() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        write_atomically(&path, b"old").unwrap();
        let failed = replace(&path, |_| Err(io::Error::from(io::ErrorKind::StorageFull))).unwrap_err();
        assert!(failed.to_string().contains("the disk is full"), "{failed}");
        assert!(failed.remedy().contains("resume"));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        let in_file = write_atomically(&path.join("b"), b"").unwrap_err();
        assert!(in_file.to_string().contains("is a file, not a folder"), "{in_file}");
    }
}
