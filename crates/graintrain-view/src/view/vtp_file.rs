//! Reads back the frames that runs write: VTK XML poly data with inline, uncompressed base64 arrays.

use super::ViewError;
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use graintrain::math::Vec3;
use graintrain_io::output::exchange::PeriodicBox;
use roxmltree::Document;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// The arrays of one file by name.
pub struct VtpFile {
    path: PathBuf,
    arrays: HashMap<String, Vec<f64>>,
}

impl VtpFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`ViewError`] where it cannot be read or is not such a file.
    pub fn read(path: &Path) -> Result<Self, ViewError> {
        let text = super::read_text(path)?;
        let malformed = |what: String| ViewError::Malformed { path: path.to_path_buf(), what };
        let document = Document::parse(&text).map_err(|error| malformed(error.to_string()))?;
        let mut arrays = HashMap::new();
        for node in document.descendants().filter(|node| node.attribute("format") == Some("binary")) {
            let name = node.attribute("Name").unwrap_or_default();
            let bytes = BASE64
                .decode(node.text().unwrap_or_default().trim())
                .map_err(|error| malformed(format!("array {name}: {error}")))?;
            let values = bytes
                .split_first_chunk::<8>()
                .filter(|(length, rest)| u64::from_le_bytes(**length) == rest.len() as u64)
                .and_then(|(_, rest)| decode(node.attribute("type").unwrap_or_default(), rest))
                .ok_or_else(|| malformed(format!("array {name} is damaged or of an unknown type")))?;
            arrays.insert(name.to_string(), values);
        }
        for node in document.descendants().filter(|node| node.attribute("format") == Some("ascii")) {
            let name = node.attribute("Name").unwrap_or_default();
            let words = node.text().unwrap_or_default().split_whitespace();
            let values = words.map(str::parse).collect::<Result<Vec<f64>, _>>();
            let values = values.map_err(|error| malformed(format!("array {name}: {error}")))?;
            arrays.insert(name.to_string(), values);
        }
        Ok(Self { path: path.to_path_buf(), arrays })
    }

    /// An array of numbers; integers up to 2^53 are exact.
    ///
    /// # Errors
    /// [`ViewError::Malformed`] where there is none of this name.
    pub fn numbers(&self, name: &str) -> Result<&[f64], ViewError> {
        self.arrays
            .get(name)
            .map(Vec::as_slice)
            .ok_or_else(|| self.malformed(format!("it has no array {name}")))
    }

    /// An array of indices below `limit`.
    ///
    /// # Errors
    /// [`ViewError::Malformed`] for a missing array or an index out of range.
    pub fn indices(&self, name: &str, limit: usize) -> Result<Vec<usize>, ViewError> {
        let values = self.numbers(name)?;
        match values.iter().find(|&&value| !(value >= 0.0 && value < limit as f64)) {
            Some(value) => {
                Err(self.malformed(format!("array {name} holds {value}, expected less than {limit}")))
            }
            None => Ok(values.iter().map(|&value| value as usize).collect()),
        }
    }

    /// An array of vectors.
    ///
    /// # Errors
    /// [`ViewError::Malformed`] where there is none of this name.
    pub fn vectors(&self, name: &str) -> Result<Vec<Vec3>, ViewError> {
        Ok(self.numbers(name)?.chunks_exact(3).map(Vec3::from_slice).collect())
    }

    /// The periodic cell of the frame; `None` where it has none.
    ///
    /// # Errors
    /// [`ViewError::Malformed`] where parts of it are missing.
    pub fn cell(&self) -> Result<Option<PeriodicBox>, ViewError> {
        if !self.arrays.contains_key("cell_vectors") {
            return Ok(None);
        }
        let (origin, vectors) = (self.vectors("cell_origin")?, self.vectors("cell_vectors")?);
        match (origin.as_slice(), vectors.as_slice(), self.numbers("cell_periodic")?) {
            (&[origin], &[a, b, c], &[x, y, z]) => Ok(Some(PeriodicBox {
                origin,
                vectors: [a, b, c],
                periodic: [x, y, z].map(|flag| flag != 0.0),
            })),
            _ => Err(self.malformed("its periodic cell is incomplete".into())),
        }
    }

    /// An error about this file.
    pub fn malformed(&self, what: String) -> ViewError {
        ViewError::Malformed { path: self.path.clone(), what }
    }
}

fn decode(kind: &str, bytes: &[u8]) -> Option<Vec<f64>> {
    fn all<const N: usize>(bytes: &[u8], value: impl Fn([u8; N]) -> f64) -> Option<Vec<f64>> {
        let (chunks, rest) = bytes.as_chunks::<N>();
        rest.is_empty().then(|| chunks.iter().map(|&chunk| value(chunk)).collect())
    }
    match kind {
        "Float32" => all(bytes, |chunk| f64::from(f32::from_le_bytes(chunk))),
        "Float64" => all(bytes, f64::from_le_bytes),
        "Int32" => all(bytes, |chunk| f64::from(i32::from_le_bytes(chunk))),
        "Int64" => all(bytes, |chunk| i64::from_le_bytes(chunk) as f64),
        "UInt8" => all(bytes, |[byte]| f64::from(byte)),
        _ => None,
    }
}
