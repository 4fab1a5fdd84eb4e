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

/// Puts a damaged file out of the way without losing it: it becomes `NAME.bad`, or `NAME.bad2` and so on where there is one already.
///
/// # Errors
/// Where the system refuses.
pub fn set_aside(path: &Path) -> Result<PathBuf, OutputError> {
    let bad = free_name(path);
    fs::rename(path, &bad).map_err(|error| OutputError::new("set aside", path, error))?;
    Ok(bad)
}

/// `NAME.bad`, `NAME.bad2`, ...: the first that is not there.
fn free_name(path: &Path) -> PathBuf {
    let named = |number: u32| {
        let mut name = path.file_name().unwrap_or_default().to_os_string();
        name.push(if number == 1 { ".bad".to_string() } else { format!(".bad{number}") });
        path.with_file_name(name)
    };
    (1..).map(named).find(|name| !name.exists()).unwrap_or_else(|| named(1))
}

/// A table in CSV form to which records are appended, each written and handed to the system at once.
#[derive(Debug)]
pub struct Table {
    path: PathBuf,
    file: File,
    /// Bytes of complete records.
    length: u64,
    /// Where a damaged table of the same name went.
    set_aside: Option<PathBuf>,
}

impl Table {
    /// A new table, replacing any old one.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn create(path: PathBuf, header: &str) -> Result<Self, OutputError> {
        let file = File::create(&path).map_err(|error| OutputError::new("write", &path, error))?;
        let mut table = Self { path, file, length: 0, set_aside: None };
        table.append(header)?;
        Ok(table)
    }

    /// Reopens a table and drops the records after step `last_step` (the first column) and a record cut short; a new
    /// table where there is none. What is damaged or has another header is kept beside it: see [`Self::set_aside`].
    ///
    /// # Errors
    /// Where the file cannot be read or written.
    pub fn reopen(path: PathBuf, header: &str, last_step: u64) -> Result<Self, OutputError> {
        let mut file = match OpenOptions::new().read(true).write(true).open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Self::create(path, header),
            Err(error) => return Err(OutputError::new("open", &path, error)),
        };
        let mut bytes = Vec::new();
        let read = file.read_to_end(&mut bytes);
        read.map_err(|error| OutputError::new("read", &path, error))?;
        let text = String::from_utf8_lossy(&bytes);
        if text.lines().next() != Some(header) {
            let bad = set_aside(&path)?;
            return Ok(Self { set_aside: Some(bad), ..Self::create(path, header)? });
        }
        let columns = header.split(',').count();
        let is_whole = |record: &str| {
            // A comma in quotes (a name) only adds to the count.
            record.ends_with('\n') && record.split(',').count() >= columns && !record.contains('\u{fffd}')
        };
        let kept: Vec<&str> = text
            .split_inclusive('\n')
            .enumerate()
            .take_while(|(line, record)| *line == 0 || is_whole(record) && step_of(record) <= last_step)
            .map(|(_, record)| record)
            .collect();
        // Records of later steps are made anew; those of earlier ones behind a damaged place would be lost.
        let is_lost = |record: &str| {
            // A record that a kill cut short is no loss: its step is made again.
            record.ends_with('\n') && (!is_whole(record) || step_of(record) <= last_step)
        };
        let lost = text.split_inclusive('\n').skip(kept.len()).any(is_lost);
        let length = kept.iter().map(|record| record.len() as u64).sum();
        let bad = if lost {
            let bad = free_name(&path);
            fs::copy(&path, &bad).map_err(|error| OutputError::new("set aside", &path, error))?;
            Some(bad)
        } else {
            None
        };
        let mut table = Self { path, file, length, set_aside: bad };
        table.cut().map_err(|error| OutputError::new("write", &table.path, error))?;
        Ok(table)
    }

    /// Where a damaged table of the same name went when this one was reopened.
    pub fn set_aside(&self) -> Option<&Path> {
        self.set_aside.as_deref()
    }

    /// Hands the table to the disk, so that not even a power failure takes it away.
    ///
    /// # Errors
    /// Where the system refuses.
    pub fn sync(&self) -> Result<(), OutputError> {
        self.file.sync_data().map_err(|error| OutputError::new("write", &self.path, error))
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
        let other = Table::reopen(path.clone(), "step,time,more", 9).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "step,time,more\n");
        assert!(fs::read_to_string(other.set_aside().unwrap()).unwrap().ends_with("4,again\n"));
    }

    #[test]
    fn damaged_tables_are_kept_beside_new_ones() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("steps.csv");
        let damaged = b"step,time\n1,0.1\n2\xff,0.2\n3,0.3\n".as_slice();
        for (name, kept) in
            [("steps.csv.bad", "step,time\n1,0.1\n"), ("steps.csv.bad2", "step,time\n1,0.1\n")]
        {
            fs::write(&path, damaged).unwrap();
            let table = Table::reopen(path.clone(), "step,time", 9).unwrap();
            assert_eq!(table.set_aside(), Some(folder.path().join(name).as_path()));
            assert_eq!(fs::read(folder.path().join(name)).unwrap(), damaged);
            assert_eq!(fs::read_to_string(&path).unwrap(), kept);
        }
        fs::write(&path, [0xff; 9]).unwrap();
        let table = Table::reopen(path.clone(), "step,time", 9).unwrap();
        assert_eq!(fs::read(table.set_aside().unwrap()).unwrap(), [0xff; 9]);
        assert_eq!(fs::read_to_string(&path).unwrap(), "step,time\n");
        // A record cut short by a kill is no damage, and neither are records of steps that are made again.
        fs::write(&path, "step,time\n1,0.1\n2,0.2\n3,0.").unwrap();
        assert!(Table::reopen(path, "step,time", 1).unwrap().set_aside().is_none());
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
