//! Writing files so that whatever happens, what was computed stays readable, and nothing outside of the
//! folder is touched: links are never written through.

use crate::mark::{Loss, Mark, Marking};
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

    /// The system's reason.
    pub fn into_source(self) -> io::Error {
        self.source
    }

    /// Whether the path itself is at fault: a file stands where a folder is to be.
    pub fn is_misplaced(&self) -> bool {
        matches!(self.source.kind(), io::ErrorKind::NotADirectory | io::ErrorKind::AlreadyExists)
    }

    /// What the user can do.
    pub fn remedy(&self) -> &'static str {
        match self.source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => {
                "make room and try again; what was written before is complete, and `graintrain resume` takes a run further from its last checkpoint"
            }
            io::ErrorKind::ResourceBusy => {
                "wait until the other run has ended, or choose another folder with --out"
            }
            _ => "choose another folder with --out",
        }
    }
}

/// Bytes of a name: file systems take 255, and `NAME.csv.part` and `NAME.csv.bad12` have to fit, too.
const LONGEST_NAME: usize = 200;

/// Whether a text can be the name of a file in a run's folder: letters, digits, `-`, `_` and `.` (not first).
/// Whatever names a file and comes from a scene, a checkpoint or a list has to be such a name, or several
/// with `/` between them ([`within`]).
pub fn is_file_name(text: &str) -> bool {
    let fits = |c: char| c.is_alphanumeric() || "-_.".contains(c);
    !text.is_empty() && text.len() <= LONGEST_NAME && !text.starts_with('.') && text.chars().all(fits)
}

/// The file in a folder that a list names by its relative path; `None` for one that is outside or no such
/// path ([`is_file_name`]).
pub fn within(folder: &Path, relative: &str) -> Option<PathBuf> {
    relative.split('/').all(is_file_name).then(|| folder.join(relative))
}

/// That there is no link at this path: what is written there would come to lie elsewhere.
///
/// # Errors
/// Where there is one.
pub fn refuse_link(path: &Path) -> Result<(), OutputError> {
    if path.is_symlink() {
        let why = "it is a link, and nothing is written outside of the run's folder";
        return Err(OutputError::new("write through", path, io::Error::other(why)));
    }
    Ok(())
}

/// That at this path there is no device, pipe or socket, which a file would take the place of.
fn refuse_special(path: &Path) -> io::Result<()> {
    match path.symlink_metadata().map(|found| found.file_type()) {
        Ok(kind) if !(kind.is_file() || kind.is_dir() || kind.is_symlink()) => {
            Err(io::Error::other("it is a device, a pipe or a socket, which stays what it is"))
        }
        _ => Ok(()),
    }
}

/// A new file in the place of any old one or link.
fn create(path: &Path) -> io::Result<File> {
    refuse_special(path)?;
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    OpenOptions::new().write(true).create_new(true).open(path)
}

/// Makes a folder and its parents.
///
/// # Errors
/// Where the system refuses.
pub fn make_folder(path: &Path) -> Result<(), OutputError> {
    fs::create_dir_all(path).map_err(|error| OutputError::new("make the folder", path, error))
}

/// Writes a whole file under a temporary name and renames it: readers see the old file or the new one, never
/// a part.
///
/// # Errors
/// Where the system refuses; the temporary file is then removed.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    replace(path, |file| file.write_all(bytes))
}

/// As [`write_atomically`], and on the disk before the rename, so that even a power failure leaves a whole
/// file.
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
    let result = refuse_special(path)
        .and_then(|()| create(&temporary))
        .and_then(|mut file| write(&mut file))
        .and_then(|()| fs::rename(&temporary, path));
    result.map_err(|error| {
        // The part is of no use, and on a full disk the room is: a failure to remove it changes nothing.
        let _ = fs::remove_file(&temporary);
        OutputError::new("write", path, error)
    })
}

/// Keeps a damaged file, whole, beside what goes on of it: as `NAME.bad`, or `NAME.bad2` and so on where
/// there is one already.
///
/// # Errors
/// Where the system refuses.
pub(crate) fn keep_damaged(path: &Path) -> Result<Loss, OutputError> {
    let bad = free_name(path);
    fs::copy(path, &bad).map_err(|error| OutputError::new("set aside", path, error))?;
    Ok(Loss::Damaged(bad))
}

/// `NAME.bad`, `NAME.bad2`, ...: the first that is not there.
fn free_name(path: &Path) -> PathBuf {
    let named = |number: u32| {
        let mut name = path.file_name().unwrap_or_default().to_os_string();
        name.push(if number == 1 { ".bad".to_string() } else { format!(".bad{number}") });
        path.with_file_name(name)
    };
    // A link that leads nowhere is there, too.
    (1..).map(named).find(|name| name.symlink_metadata().is_err()).unwrap_or_else(|| named(1))
}

/// A table in CSV form to which records are appended, each written and handed to the system at once.
#[derive(Debug)]
pub struct Table {
    path: PathBuf,
    file: File,
    /// Complete records: where they end, and their check sum.
    written: Marking,
    /// What an earlier run had written and is not there any more.
    loss: Option<Loss>,
}

impl Table {
    /// A new table, replacing any old one.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn create(path: PathBuf, header: &str) -> Result<Self, OutputError> {
        let file = create(&path).map_err(|error| OutputError::new("write", &path, error))?;
        let mut table = Self { path, file, written: Marking::default(), loss: None };
        table.append(header)?;
        Ok(table)
    }

    /// Goes on with a table that held `mark` after step `last_step`: what was written after that is dropped.
    /// One that does not hold it any more is kept beside what is readable of it, and a missing one begins
    /// anew: see [`Self::loss`]. Without a mark the table had not begun by then, and begins now.
    ///
    /// # Errors
    /// Where the file cannot be read or written.
    pub fn reopen(
        path: PathBuf,
        header: &str,
        last_step: u64,
        mark: Option<Mark>,
    ) -> Result<Self, OutputError> {
        refuse_link(&path)?;
        let Some(mark) = mark else { return Self::create(path, header) };
        let mut file = match OpenOptions::new().read(true).write(true).open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let loss = Some(Loss::Missing(path.clone()));
                return Ok(Self { loss, ..Self::create(path, header)? });
            }
            Err(error) => return Err(OutputError::new("open", &path, error)),
        };
        let reading = |error| OutputError::new("read", &path, error);
        let found = Marking::of(&mut file, mark.length).map_err(reading)?;
        file.rewind().map_err(reading)?;
        let mut table = Self { path, file, written: found, loss: None };
        if table.written.mark() != mark || !table.begins_with(header)? {
            table.loss = Some(keep_damaged(&table.path)?);
            table.keep_readable(header, last_step)?;
        }
        table.cut().map_err(|error| OutputError::new("write", &table.path, error))?;
        Ok(table)
    }

    /// Whether the first line is this one.
    fn begins_with(&mut self, header: &str) -> Result<bool, OutputError> {
        let mut first = vec![0; header.len() + 1];
        let read = self.file.read_exact(&mut first);
        match read {
            Ok(()) => Ok(first.strip_suffix(b"\n") == Some(header.as_bytes())),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
            Err(error) => Err(OutputError::new("read", &self.path, error)),
        }
    }

    /// Of a damaged table the whole records up to a step (their first column) stay, up to the first damaged
    /// one.
    fn keep_readable(&mut self, header: &str, last_step: u64) -> Result<(), OutputError> {
        let bytes = fs::read(&self.path).map_err(|error| OutputError::new("read", &self.path, error))?;
        let text = String::from_utf8_lossy(&bytes);
        if !text.starts_with(&format!("{header}\n")) {
            *self = Self { loss: self.loss.take(), ..Self::create(self.path.clone(), header)? };
            return Ok(());
        }
        let columns = header.split(',').count();
        let is_whole = |record: &str| {
            // A comma in quotes (a name) only adds to the count.
            record.ends_with('\n') && record.split(',').count() >= columns && !record.contains('\u{fffd}')
        };
        let kept: usize = text
            .split_inclusive('\n')
            .enumerate()
            .take_while(|(line, record)| is_whole(record) && (*line == 0 || step_of(record) <= last_step))
            .map(|(_, record)| record.len())
            .sum();
        self.written = Marking::default();
        self.written.add(&bytes[..kept]);
        Ok(())
    }

    /// What was there of the table and is not any more, found when it was reopened.
    pub fn loss(&self) -> Option<&Loss> {
        self.loss.as_ref()
    }

    /// Where the table is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the table holds now.
    pub fn mark(&self) -> Mark {
        self.written.mark()
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
            // Without the half-written record the table stays readable; should that fail too, the first error
            // tells.
            let _ = self.cut();
            return Err(OutputError::new("write", &self.path, error));
        }
        self.written.add(line.as_bytes());
        Ok(())
    }

    fn cut(&mut self) -> io::Result<()> {
        self.file.set_len(self.written.mark().length)?;
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

    /// A table of five steps; its mark after every step, from none on.
    fn five_steps(path: &Path) -> Vec<Mark> {
        let mut table = Table::create(path.to_path_buf(), "step,time").unwrap();
        let mut marks = vec![table.mark()];
        for step in 1..=5 {
            table.append(&format!("{step},{}", 0.1 * f64::from(step))).unwrap();
            marks.push(table.mark());
        }
        marks
    }

    fn bad(path: &Path, ending: &str) -> PathBuf {
        PathBuf::from(format!("{}{ending}", path.display()))
    }

    #[cfg(unix)]
    #[test]
    fn no_file_takes_the_place_of_a_device_pipe_or_socket() {
        use std::os::unix::fs::FileTypeExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("socket");
        let _socket = std::os::unix::net::UnixListener::bind(&path).unwrap();
        assert!(write_atomically(&path, b"text").is_err() && write_durably(&path, b"text").is_err());
        assert!(Table::create(path.clone(), "step").is_err());
        assert!(path.metadata().unwrap().file_type().is_socket());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_reopened_table_drops_later_and_broken_records() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("steps.csv");
        let marks = five_steps(&path);
        let mut file = OpenOptions::new().append(true).open(&path).unwrap();
        file.write_all(b"6,0.").unwrap();
        let mut table = Table::reopen(path.clone(), "step,time", 3, Some(marks[3])).unwrap();
        assert_eq!(table.loss(), None);
        table.append("4,again").unwrap();
        let kept = "step,time\n1,0.1\n2,0.2\n3,0.30000000000000004\n4,again\n";
        assert_eq!(fs::read_to_string(&path).unwrap(), kept);
        // What goes on is marked as if it had never been interrupted.
        let mark = table.mark();
        assert_eq!(Table::reopen(path.clone(), "step,time", 4, Some(mark)).unwrap().loss(), None);
        assert_eq!(fs::read_to_string(&path).unwrap(), kept);
        let other = Table::reopen(path.clone(), "step,time,more", 9, Some(mark)).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "step,time,more\n");
        assert_eq!(other.loss(), Some(&Loss::Damaged(bad(&path, ".bad"))));
        assert!(fs::read_to_string(bad(&path, ".bad")).unwrap().ends_with("4,again\n"));
        // One that had not begun by then begins anew.
        let begun = Table::reopen(path.clone(), "step,time", 3, None).unwrap();
        assert_eq!((begun.loss(), fs::read_to_string(&path).unwrap().as_str()), (None, "step,time\n"));
    }

    #[test]
    fn damaged_tables_are_kept_beside_new_ones() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("steps.csv");
        let mark = five_steps(&path)[3];
        let whole = fs::read_to_string(&path).unwrap();
        let digit = whole.replace("2,0.2", "2,0.9");
        let begin = &whole[..whole.find("4,").unwrap()];
        // Cut within a record and behind one, a byte that is no text, no text at all, and other numbers.
        let cases: [(&[u8], &str); 5] = [
            (&whole.as_bytes()[..20], "step,time\n1,0.1\n"),
            (b"step,time\n1,0.1\n", "step,time\n1,0.1\n"),
            (b"step,time\n1,0.1\n2\xff,0.2\n3,0.3\n", "step,time\n1,0.1\n"),
            (&[0xff; 99], "step,time\n"),
            (digit.as_bytes(), &begin.replace("2,0.2", "2,0.9")),
        ];
        for (number, (damaged, kept)) in (1..).zip(cases) {
            fs::write(&path, damaged).unwrap();
            let mut table = Table::reopen(path.clone(), "step,time", 3, Some(mark)).unwrap();
            let bad = bad(&path, &if number == 1 { ".bad".to_string() } else { format!(".bad{number}") });
            assert_eq!(table.loss(), Some(&Loss::Damaged(bad.clone())));
            assert_eq!(fs::read(bad).unwrap(), damaged);
            assert_eq!(fs::read_to_string(&path).unwrap(), kept);
            table.append("4,0.4").unwrap();
            let mark = table.mark();
            assert_eq!(Table::reopen(path.clone(), "step,time", 4, Some(mark)).unwrap().loss(), None);
        }
        fs::remove_file(&path).unwrap();
        let table = Table::reopen(path.clone(), "step,time", 3, Some(mark)).unwrap();
        assert_eq!(table.loss(), Some(&Loss::Missing(path.clone())));
        assert_eq!(fs::read_to_string(&path).unwrap(), "step,time\n");
    }

    #[test]
    fn names_of_files_lead_nowhere_else() {
        for name in ["a", "shear-2.5_kPa", "naïve", &"a".repeat(LONGEST_NAME)] {
            assert!(is_file_name(name), "{name}");
        }
        let long = "a".repeat(LONGEST_NAME + 1);
        for name in ["", ".", "..", ".bashrc", "a/b", "../a", "/a", "a\\b", "C:a", "a b", "a\n", "a\0", &long]
        {
            assert!(!is_file_name(name), "{name}");
        }
        let folder = Path::new("run");
        assert_eq!(within(folder, "frames/a.vtp"), Some(folder.join("frames/a.vtp")));
        for path in ["", "/etc/passwd", "../a.vtp", "frames/../../a.vtp", "frames//a.vtp", "frames/"] {
            assert_eq!(within(folder, path), None, "{path}");
        }
    }

    /// Whatever lies in a folder, what is outside of it stays what it is.
    #[test]
    #[cfg(unix)]
    fn links_are_not_written_through() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let (outside, inside) = (folder.path().join("outside"), folder.path().join("inside"));
        let [letter, new] = ["letter", "new"].map(|name| outside.join(name));
        fs::create_dir(&outside).unwrap();
        fs::create_dir(&inside).unwrap();
        fs::write(&letter, "dear").unwrap();
        let link = |name: &str, target: &Path| symlink(target, inside.join(name)).unwrap();
        link("a", &letter);
        link("b.part", &letter);
        link("table.csv", &letter);
        link("reopened.csv", &letter);
        link("damaged.csv.bad", &new);
        write_atomically(&inside.join("a"), b"mine").unwrap();
        write_atomically(&inside.join("b"), b"mine").unwrap();
        Table::create(inside.join("table.csv"), "step").unwrap();
        let mark = Some(Mark { length: 4, sum: 0 });
        let refused = Table::reopen(inside.join("reopened.csv"), "step", 1, mark).unwrap_err();
        assert!(refused.to_string().contains("it is a link"), "{refused}");
        fs::write(inside.join("damaged.csv"), "dear").unwrap();
        let kept = keep_damaged(&inside.join("damaged.csv")).unwrap();
        assert_eq!(kept.path(), inside.join("damaged.csv.bad2"));
        assert_eq!(fs::read(&letter).unwrap(), b"dear");
        assert!(!new.exists());
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
        assert!(in_file.is_misplaced() && !failed.is_misplaced());
    }
}
