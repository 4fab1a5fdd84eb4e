//! ParaView's list of frames over time (`.pvd`).

use crate::files::{OutputError, set_aside, write_atomically};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A `.pvd` file. It is rewritten whole after each frame, so that a run that is killed leaves a valid one.
#[derive(Clone, Debug)]
pub struct FrameList {
    path: PathBuf,
    entries: Vec<Entry>,
    /// Where a damaged list of the same name went.
    set_aside: Option<PathBuf>,
}

/// One frame: time in s, and its files relative to the list's folder.
#[derive(Clone, Debug, PartialEq)]
struct Entry {
    time: f64,
    files: Vec<String>,
}

impl FrameList {
    /// An empty list, not yet written.
    pub fn new(path: PathBuf) -> Self {
        Self { path, entries: Vec::new(), set_aside: None }
    }

    /// The list in the file, up to and including `until` (s); empty where there is no such file or it is damaged
    /// (the frames written from now on are then listed, and the damaged list is kept: see [`Self::set_aside`]).
    ///
    /// # Errors
    /// Where the file exists and cannot be read.
    pub fn reopen(path: PathBuf, until: f64) -> Result<Self, OutputError> {
        let mut list = Self::new(path);
        let bytes = match std::fs::read(&list.path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(list),
            Err(error) => return Err(OutputError::new("read", &list.path, error)),
        };
        let text = String::from_utf8(bytes).unwrap_or_default();
        let Ok(document) = roxmltree::Document::parse(&text) else {
            list.set_aside = Some(set_aside(&list.path)?);
            return Ok(list);
        };
        for node in document.descendants().filter(|node| node.has_tag_name("DataSet")) {
            let time = node.attribute("timestep").and_then(|time| time.parse::<f64>().ok());
            if let (Some(time), Some(file)) = (time, node.attribute("file"))
                && time <= until
            {
                list.insert(time, file.to_string());
            }
        }
        Ok(list)
    }

    fn insert(&mut self, time: f64, file: String) {
        match self.entries.last_mut() {
            Some(last) if last.time == time => last.files.push(file),
            _ => self.entries.push(Entry { time, files: vec![file] }),
        }
    }

    /// Adds a frame and rewrites the file.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn push(&mut self, time: f64, files: &[String]) -> Result<(), OutputError> {
        self.entries.retain(|entry| entry.time < time);
        self.entries.push(Entry { time, files: files.to_vec() });
        write_atomically(&self.path, self.text().as_bytes())
    }

    /// The file's text.
    fn text(&self) -> String {
        let mut text = String::from(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n<Collection>\n",
        );
        for Entry { time, files } in &self.entries {
            for (part, file) in files.iter().enumerate() {
                let _ =
                    writeln!(text, r#"<DataSet timestep="{time:?}" group="" part="{part}" file="{file}"/>"#);
            }
        }
        text.push_str("</Collection>\n</VTKFile>\n");
        text
    }

    /// Where a damaged list of the same name went when this one was reopened.
    pub fn set_aside(&self) -> Option<&Path> {
        self.set_aside.as_deref()
    }

    /// Where the file is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_after_the_point_of_resumption_are_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bodies.pvd");
        let mut list = FrameList::new(path.clone());
        for k in 0..4 {
            let time = 0.1 * f64::from(k);
            list.push(time, &[format!("frames/a_{k}.vtp"), format!("frames/b_{k}.vtp")]).unwrap();
        }
        let whole = std::fs::read_to_string(&path).unwrap();
        let mut again = FrameList::reopen(path.clone(), 0.2).unwrap();
        assert_eq!(again.len(), 3);
        assert_eq!(again.entries, list.entries[..3]);
        again.push(0.1 * 3.0, &["frames/a_3.vtp".to_string(), "frames/b_3.vtp".to_string()]).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), whole);
    }

    #[test]
    fn a_damaged_or_missing_list_starts_anew() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bodies.pvd");
        assert!(FrameList::reopen(path.clone(), 1.0).unwrap().is_empty());
        std::fs::write(&path, "<VTKFile><Coll").unwrap();
        assert!(FrameList::reopen(path, 1.0).unwrap().is_empty());
    }
}
