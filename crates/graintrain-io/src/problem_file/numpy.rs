//! Problems in NumPy's `.npz` archives.
//!
//! | arrays | problem |
//! |---|---|
//! | `W`, `q`, `mu` | u = W r + q |
//! | `M`, `H`, `f`, `w`, `mu` | M v = H r + f, u = H^T v + w |
//! | `D`, `Minv`, `p` (or `r`), `mu` | the same with M = diag(Minv)^-1, H = D, f = 0, w = p |
//!
//! A matrix is a two-dimensional array, or compressed columns as SciPy has them: `W_data`, `W_indices`,
//! `W_indptr`, `W_shape`, and `W_format` = `csr` for compressed rows.
//!
//! Source: numpy.org, module `numpy.lib.format`; PKWARE's APPNOTE.TXT for the archive.

use super::error::{COPY_AGAIN, Defect, WRITE_AGAIN};
use super::matrix::{Entry, Matrix};
use super::raw::{GlobalForm, LocalForm, RawProblem};
use flate2::Crc;
use flate2::read::DeflateDecoder;
use std::collections::HashMap;
use std::io::Read;

/// Bytes that a member may expand to, per byte of the archive; arrays of numbers shrink to a tenth.
const MOST_EXPANDED: u64 = 300;

/// An array: its shape and numbers row by row; texts as their characters.
struct Array {
    shape: Vec<usize>,
    values: Vec<f64>,
}

/// Whether this is an archive.
pub(super) fn is_npz(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04")
}

/// Reads the problem of an archive.
pub(super) fn parse(bytes: &[u8]) -> Result<RawProblem, Defect> {
    let archive = Archive(members(bytes)?);
    let friction = archive.vector(&["mu"])?;
    if archive.has_matrix("W") {
        let (w, q) = (archive.matrix("W")?, archive.vector(&["q"])?);
        return Ok(RawProblem::Local(LocalForm { w, q, friction, rolling: None, equalities: None }));
    }
    let (m, h, f, w) = if archive.has_matrix("M") {
        let (f, w) = (archive.vector(&["f"])?, archive.vector(&["w"])?);
        (archive.matrix("M")?, archive.matrix("H")?, f, w)
    } else if archive.has_matrix("D") {
        let inverse = archive.vector(&["Minv"])?;
        if let Some(row) = inverse.iter().position(|x| !(x.is_finite() && *x > 0.0)) {
            let what = format!("entry {row} is {}, but masses are positive", inverse[row]);
            return Err(Defect::damaged("Minv", what, WRITE_AGAIN));
        }
        let size = inverse.len();
        let entries = inverse.iter().enumerate().map(|(k, x)| Entry { row: k, column: k, value: 1.0 / x });
        let m = Matrix::new("Minv", size, size, entries.collect())?;
        (m, archive.matrix("D")?, vec![0.0; size], archive.vector(&["p", "r"])?)
    } else {
        let mut names: Vec<&str> = archive.0.keys().map(String::as_str).collect();
        names.sort_unstable();
        let what = format!("it has no matrix W, M or D; its arrays are {}", names.join(", "));
        return Err(Defect::damaged("the archive", what, WRITE_AGAIN));
    };
    Ok(RawProblem::Global(GlobalForm { m, h, f, w, friction, rolling: None, equalities: None }))
}

struct Archive(HashMap<String, Array>);

impl Archive {
    fn has_matrix(&self, name: &str) -> bool {
        self.0.contains_key(name) || self.0.contains_key(&format!("{name}_data"))
    }

    fn array(&self, name: &str) -> Result<&Array, Defect> {
        self.0.get(name).ok_or_else(|| Defect::damaged(name, "there is no such array", WRITE_AGAIN))
    }

    /// The first of these arrays that is there.
    fn vector(&self, names: &[&str]) -> Result<Vec<f64>, Defect> {
        let name = names.iter().find(|name| self.0.contains_key(**name)).unwrap_or(&names[0]);
        Ok(self.array(name)?.values.clone())
    }

    fn indices(&self, name: &str) -> Result<Vec<usize>, Defect> {
        let values = &self.array(name)?.values;
        match values.iter().find(|x| !(x.fract() == 0.0 && (0.0..9e15).contains(*x))) {
            Some(x) => Err(Defect::damaged(name, format!("{x} is no index"), WRITE_AGAIN)),
            None => Ok(values.iter().map(|&x| x as usize).collect()),
        }
    }

    fn matrix(&self, name: &str) -> Result<Matrix, Defect> {
        if let Some(dense) = self.0.get(name) {
            let &[rows, columns] = dense.shape.as_slice() else {
                let what = format!("it has {} dimensions, a matrix has two", dense.shape.len());
                return Err(Defect::damaged(name, what, WRITE_AGAIN));
            };
            let entry = |(k, &value)| Entry { row: k / columns, column: k % columns, value };
            return Matrix::new(name, rows, columns, dense.values.iter().enumerate().map(entry).collect());
        }
        let part = |field: &str| format!("{name}_{field}");
        let (data, shape) = (&self.array(&part("data"))?.values, self.indices(&part("shape"))?);
        let (minors, starts) = (self.indices(&part("indices"))?, self.indices(&part("indptr"))?);
        let by_row = self.0.get(&part("format")).is_some_and(|text| {
            text.values.iter().map(|&c| c as u8 as char).collect::<String>().starts_with("csr")
        });
        let &[rows, columns] = shape.as_slice() else {
            return Err(Defect::damaged(part("shape"), "it is no pair of numbers", WRITE_AGAIN));
        };
        let majors = if by_row { rows } else { columns };
        let is_sound = starts.len() == majors.saturating_add(1)
            && starts[0] == 0
            && starts.is_sorted()
            && starts[majors] <= minors.len().min(data.len());
        if !is_sound {
            let what = format!("{} starts do not fit {majors} rows or columns", starts.len());
            return Err(Defect::damaged(part("indptr"), what, WRITE_AGAIN));
        }
        let mut entries = Vec::with_capacity(starts[majors]);
        for major in 0..majors {
            for k in starts[major]..starts[major + 1] {
                let (row, column) = if by_row { (major, minors[k]) } else { (minors[k], major) };
                entries.push(Entry { row, column, value: data[k] });
            }
        }
        Matrix::new(name, rows, columns, entries)
    }
}

/// The arrays of an archive, by its central directory.
fn members(bytes: &[u8]) -> Result<HashMap<String, Array>, Defect> {
    let broken = |what: &str| Defect::damaged("the archive", what.to_string(), COPY_AGAIN);
    let at16 = |at: usize| bytes.get(at..at + 2).map(|b| u16::from_le_bytes([b[0], b[1]]) as usize);
    let at32 =
        |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let end = bytes.len().checked_sub(22).and_then(|last| {
        (last.saturating_sub(1 << 16)..=last).rev().find(|&at| bytes[at..].starts_with(b"PK\x05\x06"))
    });
    let end = end.ok_or_else(|| broken("it has no end of its directory: it was cut short"))?;
    let (count, mut at) = (at16(end + 10).unwrap_or(0), at32(end + 16).unwrap_or(0));
    let mut found = HashMap::new();
    for _ in 0..count {
        let entry = || {
            bytes.get(at..at + 4).filter(|head| *head == b"PK\x01\x02")?;
            let (method, packed, plain) = (at16(at + 10)?, at32(at + 20)?, at32(at + 24)?);
            let checksum = at32(at + 16)?;
            let [name, extra, comment] = [at16(at + 28)?, at16(at + 30)?, at16(at + 32)?];
            let local = at32(at + 42)?;
            let text = bytes.get(at + 46..at + 46 + name)?;
            // The local header has lengths of its own.
            let start = local + 30 + at16(local + 26)? + at16(local + 28)?;
            let next = at + 46 + name + extra + comment;
            Some((
                String::from_utf8_lossy(text).into_owned(),
                method,
                bytes.get(start..start + packed)?,
                plain,
                checksum,
                next,
            ))
        };
        let (name, method, packed, plain, checksum, next) =
            entry().ok_or_else(|| broken("its directory is damaged"))?;
        at = next;
        let Some(name) = name.strip_suffix(".npy") else { continue };
        let content = match method {
            0 => packed.to_vec(),
            8 => {
                let most = (plain as u64).min(MOST_EXPANDED * bytes.len() as u64 + (1 << 20));
                let mut content = Vec::new();
                let read = DeflateDecoder::new(packed).take(most).read_to_end(&mut content);
                read.map_err(|error| Defect::damaged(name, error.to_string(), COPY_AGAIN))?;
                content
            }
            other => {
                let what = format!("{name} is compressed by method {other}");
                return Err(Defect::unsupported(what, "write it by numpy.savez or savez_compressed"));
            }
        };
        let mut sum = Crc::new();
        sum.update(&content);
        if sum.sum() as usize != checksum {
            return Err(Defect::damaged(name, "its checksum is wrong".to_string(), COPY_AGAIN));
        }
        found.insert(name.to_string(), array(name, &content)?);
    }
    Ok(found)
}

/// An array in NumPy's format.
fn array(name: &str, bytes: &[u8]) -> Result<Array, Defect> {
    let broken = |what: String| Defect::damaged(name, what, COPY_AGAIN);
    let header = || {
        let rest = bytes.strip_prefix(b"\x93NUMPY")?;
        let (length, begin): (usize, usize) = match rest.first()? {
            1 => (u16::from_le_bytes([*rest.get(2)?, *rest.get(3)?]) as usize, 4),
            _ => {
                (u32::from_le_bytes([*rest.get(2)?, *rest.get(3)?, *rest.get(4)?, *rest.get(5)?]) as usize, 6)
            }
        };
        let text = std::str::from_utf8(rest.get(begin..begin.checked_add(length)?)?).ok()?;
        Some((text, &rest[begin + length..]))
    };
    let (header, data) = header().ok_or_else(|| broken("it is no array of NumPy".into()))?;
    let value = |key: &str| Some(header.split_once(&format!("'{key}':"))?.1.trim_start());
    let kind =
        value("descr").and_then(|text| text.strip_prefix('\'')?.split('\'').next()).unwrap_or_default();
    let by_column = value("fortran_order").is_some_and(|text| text.starts_with("True"));
    let shape = value("shape").and_then(|text| text.strip_prefix('(')?.split(')').next());
    let shape = shape.map(|text| text.split(',').map(str::trim).filter(|word| !word.is_empty()));
    let shape: Option<Vec<usize>> = shape.and_then(|words| words.map(|word| word.parse().ok()).collect());
    let shape = shape.ok_or_else(|| broken(format!("its header is damaged: {}", header.trim())))?;
    let count = shape.iter().try_fold(1_usize, |product, &n| product.checked_mul(n));
    fn numbers<const N: usize>(data: &[u8], value: impl Fn([u8; N]) -> f64) -> Vec<f64> {
        data.as_chunks::<N>().0.iter().map(|&chunk| value(chunk)).collect()
    }
    let mut values = match kind {
        "<f8" => numbers(data, f64::from_le_bytes),
        "<f4" => numbers(data, |b| f64::from(f32::from_le_bytes(b))),
        "<i8" => numbers(data, |b| i64::from_le_bytes(b) as f64),
        "<i4" => numbers(data, |b| f64::from(i32::from_le_bytes(b))),
        "<u8" => numbers(data, |b| u64::from_le_bytes(b) as f64),
        "<u4" => numbers(data, |b| f64::from(u32::from_le_bytes(b))),
        text if text.starts_with("|S") => data.iter().map(|&byte| f64::from(byte)).collect(),
        text if text.starts_with("<U") => numbers(data, |b| f64::from(u32::from_le_bytes(b))),
        other => {
            let what = format!("{name} holds numbers of the kind `{other}`");
            return Err(Defect::unsupported(what, "write it as float64 or int64, little endian"));
        }
    };
    if kind.starts_with("|S") || kind.starts_with("<U") {
        return Ok(Array { shape, values });
    }
    if count != Some(values.len()) {
        return Err(broken(format!("it holds {} numbers, its shape is {shape:?}", values.len())));
    }
    if let (true, &[rows, columns]) = (by_column, shape.as_slice()) {
        values = (0..rows * columns).map(|k| values[k / columns + rows * (k % columns)]).collect();
    }
    Ok(Array { shape, values })
}
