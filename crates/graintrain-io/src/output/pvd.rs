//! ParaView's list of frames over time (`.pvd`).

use crate::files::{OutputError, is_file_name, keep_damaged, write_atomically};
use crate::mark::{Loss, Mark, mark_of};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A `.pvd` file. It is rewritten whole, so that a run that is killed leaves a valid one: after each of the
/// first frames, then as soon as there are a 32nd more, and by [`Self::write`]. So a run writes some 32 times
/// the length of its list, not the square of it.
#[derive(Clone, Debug)]
pub struct FrameList {
    path: PathBuf,
    entries: Vec<Entry>,
    /// How many of them the file has; none where that is not known.
    written: usize,
    /// What an earlier run had written and is not there any more.
    loss: Option<Loss>,
}

/// By one part in so many a list grows before it is rewritten.
const LATER: usize = 32;

/// One frame: time in s, and its files relative to the list's folder.
#[derive(Clone, Debug, PartialEq)]
struct Entry {
    time: f64,
    files: Vec<String>,
}

impl FrameList {
    /// An empty list, not yet written.
    pub fn new(path: PathBuf) -> Self {
        Self { path, entries: Vec::new(), written: 0, loss: None }
    }

    /// Goes on with a list that held `mark` at the time `until` (s): frames after it are dropped. One that
    /// does not hold that any more is kept beside what is readable of it, and a missing one begins anew: see
    /// [`Self::loss`]. So does, without a mark, one that had not begun by then.
    ///
    /// # Errors
    /// Where the file exists and cannot be read.
    pub fn reopen(path: PathBuf, until: f64, mark: Option<Mark>) -> Result<Self, OutputError> {
        let mut list = Self::new(path);
        let Some(mark) = mark else { return Ok(list) };
        let bytes = match std::fs::read(&list.path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                list.loss = Some(Loss::Missing(list.path.clone()));
                return Ok(list);
            }
            Err(error) => return Err(OutputError::new("read", &list.path, error)),
        };
        let text = String::from_utf8(bytes).unwrap_or_default();
        if let Ok(document) = roxmltree::Document::parse(&text) {
            for node in document.descendants().filter(|node| node.has_tag_name("DataSet")) {
                let time = node.attribute("timestep").and_then(|time| time.parse::<f64>().ok());
                if let (Some(time), Some(file)) = (time, node.attribute("file"))
                    && time <= until
                    && file.split('/').all(is_file_name)
                {
                    list.insert(time, file.to_string());
                }
            }
        }
        if list.mark() != Some(mark) {
            list.loss = Some(keep_damaged(&list.path)?);
        }
        Ok(list)
    }

    /// What the file holds now; `None` where there is none yet.
    pub fn mark(&self) -> Option<Mark> {
        (!self.is_empty()).then(|| mark_of(&self.text()))
    }

    fn insert(&mut self, time: f64, file: String) {
        match self.entries.last_mut() {
            Some(last) if last.time == time => last.files.push(file),
            _ => self.entries.push(Entry { time, files: vec![file] }),
        }
    }

    /// Adds a frame, and rewrites the file if it is time.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn push(&mut self, time: f64, files: &[String]) -> Result<(), OutputError> {
        let known = self.len();
        self.entries.retain(|entry| entry.time < time);
        if self.len() < known {
            self.written = 0;
        }
        self.entries.push(Entry { time, files: files.to_vec() });
        if self.len() > self.written + self.written / LATER { self.write() } else { Ok(()) }
    }

    /// Rewrites the file, unless it has all frames.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn write(&mut self) -> Result<(), OutputError> {
        if self.len() != self.written {
            write_atomically(&self.path, self.text().as_bytes())?;
            self.written = self.len();
        }
        Ok(())
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

    /// What was there of the list and is not any more, found when it was reopened.
    pub fn loss(&self) -> Option<&Loss> {
        self.loss.as_ref()
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
        let mut marks = Vec::new();
        for k in 0..4 {
            let time = 0.1 * f64::from(k);
            list.push(time, &[format!("frames/a_{k}.vtp"), format!("frames/b_{k}.vtp")]).unwrap();
            marks.push(list.mark());
        }
        let whole = std::fs::read_to_string(&path).unwrap();
        let mut again = FrameList::reopen(path.clone(), 0.2, marks[2]).unwrap();
        assert_eq!((again.len(), again.loss()), (3, None));
        assert_eq!(again.entries, list.entries[..3]);
        again.push(0.1 * 3.0, &["frames/a_3.vtp".to_string(), "frames/b_3.vtp".to_string()]).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), whole);
    }

    #[test]
    fn long_lists_are_written_seldom_and_in_the_end_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bodies.pvd");
        let mut list = FrameList::new(path.clone());
        let (mut bytes, mut before) = (0, String::new());
        for k in 0..2000 {
            list.push(f64::from(k), &[format!("frames/a_{k}.vtp")]).unwrap();
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(roxmltree::Document::parse(&text).is_ok());
            assert!(33 * text.lines().count() >= 32 * list.len(), "after frame {k}");
            if text != before {
                (bytes, before) = (bytes + text.len(), text);
            }
        }
        list.write().unwrap();
        let whole = std::fs::read_to_string(&path).unwrap();
        assert_eq!(mark_of(&whole), list.mark().unwrap());
        assert!(bytes < 40 * whole.len(), "{bytes}");
    }

    #[test]
    fn damaged_and_missing_lists_are_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bodies.pvd");
        let mut list = FrameList::new(path.clone());
        list.push(0.0, &["frames/a_0.vtp".to_string()]).unwrap();
        list.push(1.0, &["frames/a_1.vtp".to_string()]).unwrap();
        let (mark, whole) = (list.mark(), std::fs::read_to_string(&path).unwrap());
        let reopen = || FrameList::reopen(path.clone(), 1.0, mark).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert_eq!(reopen().loss(), Some(&Loss::Missing(path.clone())));
        assert!(FrameList::reopen(path.clone(), 1.0, None).unwrap().loss().is_none());
        // Cut, without a frame, with one that lies elsewhere: how many frames are left.
        let line = whole.lines().nth(4).unwrap();
        let damaged = [
            ("<VTKFile><Coll".to_string(), 0, ".bad"),
            (whole.replace(line, ""), 1, ".bad2"),
            (whole.replace("frames/a_1.vtp", "../a_1.vtp"), 1, ".bad3"),
        ];
        for (text, left, ending) in damaged {
            std::fs::write(&path, &text).unwrap();
            let list = reopen();
            let kept = PathBuf::from(format!("{}{ending}", path.display()));
            assert_eq!((list.len(), list.loss()), (left, Some(&Loss::Damaged(kept.clone()))));
            assert_eq!(std::fs::read_to_string(kept).unwrap(), text);
        }
    }
}
