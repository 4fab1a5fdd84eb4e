//! MATLAB files of level 5 ("MAT-File Format", The MathWorks): a tree of data elements, compressed or not.

use super::{Bytes, doubles, open};
use crate::vector::Core;
use crate::{TtError, TtMatrix, TtVector};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

/// Bytes of the text, the version and the mark of the byte order.
const HEADER: usize = 128;
/// Types of data elements.
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;
/// Classes of arrays: structures and objects have fields; from the sixth on arrays hold numbers, up to the
/// fifteenth.
const STRUCTURE: u8 = 2;
const OBJECT: u8 = 3;
const NUMBERS: std::ops::RangeInclusive<u8> = 6..=15;
/// A variable of a level 5 file is smaller than this.
const LARGEST_VARIABLE: u64 = 1 << 31;
/// Structures within structures; trains need three.
const DEEPEST: usize = 16;

/// A train as TT-Toolbox has it.
#[derive(Clone, Debug, PartialEq)]
pub enum Stored {
    /// A `tt_tensor`.
    Vector(TtVector),
    /// A `tt_matrix`.
    Matrix(TtMatrix),
}

/// What an array holds, as far as trains need it.
enum Value {
    Numbers(Vec<f64>),
    Fields(BTreeMap<String, Value>),
    /// Cells, texts, complex numbers, arrays of structures, handles.
    Other,
}

/// One data element: its type and its bytes.
struct Element<'a> {
    kind: u32,
    data: &'a [u8],
}

fn element<'a>(input: &mut Bytes<'a>) -> Result<Element<'a>, TtError> {
    let tag = input.integer("the tag of an element")? as u32;
    if tag >> 16 != 0 {
        // A short element: its length beside its type, its data in the four bytes that follow.
        let four = input.take(4, "a short element")?;
        let length = (tag >> 16) as usize;
        let data =
            four.get(..length).ok_or_else(|| input.fault(format!("a short element of {length} bytes")))?;
        return Ok(Element { kind: tag & 0xFFFF, data });
    }
    let length = input.integer("the length of an element")? as u32 as usize;
    let data = input.take(length, "an element")?;
    // Compressed elements are not padded (so what follows may lie anywhere); the last element of a file need
    // not be.
    if tag != COMPRESSED {
        input.at = (input.at + length.next_multiple_of(8) - length).min(input.data.len());
    }
    Ok(Element { kind: tag, data })
}

/// The numbers of an element of any numeric type; none for another.
fn numbers(element: &Element<'_>) -> Option<Vec<f64>> {
    let size = match element.kind {
        1 | 2 => 1,
        3 | 4 => 2,
        5..=7 => 4,
        9 | 12 | 13 => 8,
        _ => return None,
    };
    if element.kind == 9 {
        return Some(doubles(element.data));
    }
    if element.kind == 7 {
        let single = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        return Some(element.data.chunks_exact(size).map(single).collect());
    }
    let signed = matches!(element.kind, 1 | 3 | 5 | 12);
    let number = |bytes: &[u8]| {
        let fill = if signed && bytes[size - 1] >= 0x80 { 0xFF } else { 0 };
        let mut wide = [fill; 16];
        wide[..size].copy_from_slice(bytes);
        i128::from_le_bytes(wide) as f64
    };
    Some(element.data.chunks_exact(size).map(number).collect())
}

/// Name and value of the array whose element holds these bytes.
fn array(file: &Path, data: &[u8], depth: usize) -> Result<(String, Value), TtError> {
    let mut input = Bytes { file, data, at: 0 };
    let flags = element(&mut input)?.data;
    let (Some(&class), Some(&bits)) = (flags.first(), flags.get(1)) else {
        return Err(input.fault("an array without flags".to_owned()));
    };
    if depth > DEEPEST {
        return Err(input.fault(format!("structures nested more than {DEEPEST} deep")));
    }
    let complex = bits & 8 != 0;
    let count: f64 = numbers(&element(&mut input)?).unwrap_or_default().iter().product();
    let name = String::from_utf8_lossy(element(&mut input)?.data).into_owned();
    if NUMBERS.contains(&class) && !complex {
        let value = numbers(&element(&mut input)?).map_or(Value::Other, Value::Numbers);
        return Ok((name, value));
    }
    if (class != STRUCTURE && class != OBJECT) || count != 1.0 {
        return Ok((name, Value::Other));
    }
    if class == OBJECT {
        // The name of its class.
        element(&mut input)?;
    }
    let width = numbers(&element(&mut input)?).and_then(|list| list.first().copied()).unwrap_or(0.0) as usize;
    let names = element(&mut input)?.data;
    if width == 0 {
        return Err(input.fault("field names of length 0".to_owned()));
    }
    let mut fields = BTreeMap::new();
    for field in names.chunks_exact(width) {
        let end = field.iter().position(|&b| b == 0).unwrap_or(width);
        let value = element(&mut input)?;
        let value = if value.kind == MATRIX && !value.data.is_empty() {
            array(file, value.data, depth + 1)?.1
        } else {
            Value::Other
        };
        fields.insert(String::from_utf8_lossy(&field[..end]).into_owned(), value);
    }
    Ok((name, Value::Fields(fields)))
}

/// A list of sizes among the fields; none if it is not there or not of whole positive numbers.
fn sizes(fields: &BTreeMap<String, Value>, name: &str) -> Option<Vec<usize>> {
    let Some(Value::Numbers(list)) = fields.get(name) else { return None };
    let size = |&x: &f64| (x >= 1.0 && x < 2f64.powi(52) && x.fract() == 0.0).then_some(x as usize);
    list.iter().map(size).collect()
}

/// The train of a `tt_tensor`: ranks r, modes n, 1-based starts ps of the cores among the numbers `core`.
/// None if the fields are not these; text if they contradict each other.
fn vector(fields: &BTreeMap<String, Value>) -> Option<Result<TtVector, String>> {
    let (ranks, modes, starts) = (sizes(fields, "r")?, sizes(fields, "n")?, sizes(fields, "ps")?);
    let Some(Value::Numbers(data)) = fields.get("core") else { return None };
    let d = modes.len();
    if ranks.len() != d + 1 || starts.len() != d + 1 {
        return Some(Err(format!(
            "{d} modes with {} ranks and {} starts of cores",
            ranks.len(),
            starts.len()
        )));
    }
    let core = |k: usize| {
        let numbers = data
            .get(starts[k] - 1..starts[k + 1] - 1)
            .ok_or_else(|| format!("core {k} outside its numbers"))?;
        Core::new(ranks[k], modes[k], ranks[k + 1], numbers.to_vec())
            .map_err(|error| format!("core {k}: {error}"))
    };
    let cores: Result<Vec<Core>, String> = (0..d).map(core).collect();
    Some(cores.and_then(|cores| TtVector::from_cores(cores).map_err(|error| error.to_string())))
}

/// The matrix of a `tt_matrix`: the train `tt`, row digits n, column digits m.
fn matrix(fields: &BTreeMap<String, Value>) -> Option<Result<TtMatrix, String>> {
    let (rows, columns) = (sizes(fields, "n")?, sizes(fields, "m")?);
    let Some(Value::Fields(train)) = fields.get("tt") else { return None };
    let train = vector(train)?;
    Some(
        train.and_then(|train| {
            TtMatrix::from_vector(train, &rows, &columns).map_err(|error| error.to_string())
        }),
    )
}

/// All real trains among the variables of a MATLAB file, with their names, in the order of the file; other
/// variables are passed over.
///
/// TT-Toolbox's `tt_tensor` and `tt_matrix` are read as objects (as `save` writes them) and as structures of
/// the same fields.
///
/// # Errors
/// [`TtError::File`] if the file cannot be read; [`TtError::Format`] if it is damaged, not of level 5 (files
/// of `save -v7.3` are HDF5), of the other byte order, or a train in it contradicts itself.
pub fn read_mat(file: &Path) -> Result<Vec<(String, Stored)>, TtError> {
    let data = open(file)?;
    let mut input = Bytes { file, data: &data, at: 0 };
    let header = input.take(HEADER, "the header")?;
    if !header.starts_with(b"MATLAB 5.0") || &header[126..] != b"IM" {
        input.at = 0;
        let what = "not a little-endian MATLAB file of level 5: save it with -v7 or -v6 (-v7.3 is HDF5)";
        return Err(input.fault(what.to_owned()));
    }
    let mut trains = Vec::new();
    while input.at < data.len() {
        let at = input.at;
        let part = element(&mut input)?;
        let mut inflated = Vec::new();
        let body = if part.kind == COMPRESSED {
            let decoder = flate2::read::ZlibDecoder::new(part.data);
            let source = |error: std::io::Error| TtError::Format {
                file: file.display().to_string(),
                offset: at as u64,
                what: format!("a compressed variable: {error}"),
            };
            decoder.take(LARGEST_VARIABLE).read_to_end(&mut inflated).map_err(source)?;
            element(&mut Bytes { file, data: &inflated, at: 0 })?
        } else {
            part
        };
        if body.kind != MATRIX {
            continue;
        }
        let (name, Value::Fields(fields)) = array(file, body.data, 0)? else { continue };
        let stored = match (matrix(&fields), vector(&fields)) {
            (Some(found), _) => found.map(Stored::Matrix),
            (None, Some(found)) => found.map(Stored::Vector),
            (None, None) => continue,
        };
        let fault = |what| TtError::Format {
            file: file.display().to_string(),
            offset: at as u64,
            what: format!("variable {name}: {what}"),
        };
        trains.push((name.clone(), stored.map_err(fault)?));
    }
    Ok(trains)
}
