//! VTK XML polygonal data (`.vtp`) that ParaView and OVITO both read.
//!
//! OVITO's reader is the stricter one and sets the rules: arrays inline (ASCII or base64, never appended,
//! never compressed), as many vertex cells as points in particle files, and `FieldData` after the `Piece`.

use super::exchange::PeriodicBox;
pub use crate::settings::Precision;
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use graintrain::math::Vec3;
use rayon::prelude::*;
use std::io::{self, Write};

/// Values of an array, one entry per component.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// 32-bit integers.
    Int32(Vec<i32>),
    /// 64-bit integers.
    Int64(Vec<i64>),
    /// Real numbers, written in the file's [`Precision`].
    Real(Vec<f64>),
}

/// A named array over points or cells.
#[derive(Clone, Debug, PartialEq)]
pub struct DataArray {
    /// Name under which programs show it.
    pub name: &'static str,
    /// Components per point or cell.
    pub components: usize,
    /// Point by point (or cell by cell), its components together.
    pub values: Values,
}

impl DataArray {
    /// One real number per point or cell.
    pub fn scalar(name: &'static str, values: Vec<f64>) -> Self {
        Self { name, components: 1, values: Values::Real(values) }
    }

    /// One vector per point or cell.
    pub fn vector(name: &'static str, values: impl IntoIterator<Item = Vec3>) -> Self {
        let values = values.into_iter().flat_map(|v| v.to_array()).collect();
        Self { name, components: 3, values: Values::Real(values) }
    }

    /// One 32-bit integer per point or cell.
    pub fn int32(name: &'static str, values: Vec<i32>) -> Self {
        Self { name, components: 1, values: Values::Int32(values) }
    }

    /// One 64-bit integer per point or cell.
    pub fn int64(name: &'static str, values: Vec<i64>) -> Self {
        Self { name, components: 1, values: Values::Int64(values) }
    }

    /// One flag per point or cell: 0 or 1, as a 32-bit integer since OVITO reads no bytes.
    pub fn flags(name: &'static str, values: impl IntoIterator<Item = bool>) -> Self {
        Self::int32(name, values.into_iter().map(i32::from).collect())
    }
}

/// What the cells of a file are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellKind {
    /// Vertices: particles.
    Verts,
    /// Polylines.
    Lines,
    /// Polygons.
    Polys,
}

/// Cells of one kind: cell k joins the points `connectivity[ends[k-1]..ends[k]]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    /// Their kind.
    pub kind: CellKind,
    /// Point indices.
    pub connectivity: Vec<i64>,
    /// End of each cell in `connectivity`.
    pub ends: Vec<i64>,
}

impl Cells {
    /// No cells yet.
    pub fn new(kind: CellKind) -> Self {
        Self { kind, connectivity: Vec::new(), ends: Vec::new() }
    }

    /// One vertex per point.
    pub fn verts(points: usize) -> Self {
        let count = points as i64;
        Self { kind: CellKind::Verts, connectivity: (0..count).collect(), ends: (1..=count).collect() }
    }

    /// Adds a cell.
    pub fn push(&mut self, points: impl IntoIterator<Item = i64>) {
        self.connectivity.extend(points);
        self.ends.push(self.connectivity.len() as i64);
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }
}

/// One frame.
#[derive(Clone, Debug, PartialEq)]
pub struct PolyData {
    /// Points, m.
    pub points: Vec<Vec3>,
    /// Cells over the points.
    pub cells: Cells,
    /// Arrays with one entry per point.
    pub point_data: Vec<DataArray>,
    /// Arrays with one entry per cell.
    pub cell_data: Vec<DataArray>,
}

impl PolyData {
    /// Writes the frame, with its time (s) as the field `TimeValue`, and a periodic cell as the fields
    /// `cell_origin` (m), `cell_vectors` (m, the edges one after the other; zero along axes that do not
    /// repeat) and `cell_periodic` (which axes repeat).
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write(
        &self,
        out: &mut impl Write,
        time: f64,
        cell: Option<&PeriodicBox>,
        precision: Precision,
    ) -> io::Result<()> {
        let count = |kind| if self.cells.kind == kind { self.cells.len() } else { 0 };
        writeln!(out, r#"<?xml version="1.0"?>"#)?;
        writeln!(
            out,
            r#"<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">"#
        )?;
        writeln!(out, "<PolyData>")?;
        writeln!(
            out,
            r#"<Piece NumberOfPoints="{}" NumberOfVerts="{}" NumberOfLines="{}" NumberOfStrips="0" NumberOfPolys="{}">"#,
            self.points.len(),
            count(CellKind::Verts),
            count(CellKind::Lines),
            count(CellKind::Polys),
        )?;
        write_group(out, "PointData", &self.point_data, precision)?;
        write_group(out, "CellData", &self.cell_data, precision)?;
        let points = DataArray::vector("Points", self.points.iter().copied());
        write_group(out, "Points", std::slice::from_ref(&points), precision)?;
        let tag = match self.cells.kind {
            CellKind::Verts => "Verts",
            CellKind::Lines => "Lines",
            CellKind::Polys => "Polys",
        };
        writeln!(out, "<{tag}>")?;
        write_array(out, "connectivity", 1, "Int64", &encode(&self.cells.connectivity, i64::to_le_bytes))?;
        write_array(out, "offsets", 1, "Int64", &encode(&self.cells.ends, i64::to_le_bytes))?;
        writeln!(out, "</{tag}>\n</Piece>")?;
        write!(
            out,
            r#"<FieldData><DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="ascii">{time:?}</DataArray>"#
        )?;
        if let Some(PeriodicBox { origin, vectors, periodic }) = cell {
            let mut field = |kind: &str, name: &str, numbers: Vec<String>| {
                writeln!(
                    out,
                    "\n<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"3\" NumberOfTuples=\"{}\" format=\"ascii\">{}</DataArray>",
                    numbers.len() / 3,
                    numbers.join(" ")
                )
            };
            let text = |v: &Vec3| v.to_array().map(|x| format!("{x:?}"));
            field("Float64", "cell_origin", text(origin).to_vec())?;
            field("Float64", "cell_vectors", vectors.iter().flat_map(text).collect())?;
            field("Int32", "cell_periodic", periodic.iter().map(|p| u8::from(*p).to_string()).collect())?;
        }
        writeln!(out, "</FieldData>")?;
        writeln!(out, "</PolyData>\n</VTKFile>")
    }
}

fn write_group(
    out: &mut impl Write,
    tag: &str,
    arrays: &[DataArray],
    precision: Precision,
) -> io::Result<()> {
    writeln!(out, "<{tag}>")?;
    for array in arrays {
        let (kind, text) = match &array.values {
            Values::Int32(values) => ("Int32", encode(values, i32::to_le_bytes)),
            Values::Int64(values) => ("Int64", encode(values, i64::to_le_bytes)),
            Values::Real(values) => match precision {
                Precision::Single => ("Float32", encode(values, |value| (value as f32).to_le_bytes())),
                Precision::Double => ("Float64", encode(values, f64::to_le_bytes)),
            },
        };
        write_array(out, array.name, array.components, kind, &text)?;
    }
    writeln!(out, "</{tag}>")
}

fn write_array(
    out: &mut impl Write,
    name: &str,
    components: usize,
    kind: &str,
    text: &[u8],
) -> io::Result<()> {
    write!(
        out,
        r#"<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" format="binary">"#
    )?;
    out.write_all(text)?;
    writeln!(out, "</DataArray>")
}

/// Values or groups of three bytes that a thread encodes at a time.
const PIECE: usize = 1 << 14;

/// Base64 of the number of bytes (as UInt64) and the bytes themselves, encoded together.
fn encode<T: Copy + Sync, const N: usize>(values: &[T], bytes_of: impl Fn(T) -> [u8; N] + Sync) -> Vec<u8> {
    let mut bytes = vec![0; 8 + N * values.len()];
    let (count, content) = bytes.split_at_mut(8);
    count.copy_from_slice(&((N * values.len()) as u64).to_le_bytes());
    content.par_chunks_mut(N * PIECE).zip(values.par_chunks(PIECE)).for_each(|(bytes, values)| {
        for (bytes, &value) in bytes.chunks_exact_mut(N).zip(values) {
            bytes.copy_from_slice(&bytes_of(value));
        }
    });
    // Pieces of whole groups need no padding, so that their texts are that of the whole.
    let mut text = vec![0; 4 * bytes.len().div_ceil(3)];
    text.par_chunks_mut(4 * PIECE).zip(bytes.par_chunks(3 * PIECE)).for_each(|(text, bytes)| {
        let written = BASE64.encode_slice(bytes, text);
        debug_assert!(written.is_ok(), "four characters per group of three bytes");
    });
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Decodes a binary array of the file, found by name, without any code of the writer.
    fn decode(text: &str, name: &str) -> (String, Vec<u8>) {
        let document = roxmltree::Document::parse(text).expect("well-formed XML");
        let node =
            document.descendants().find(|node| node.attribute("Name") == Some(name)).expect("the array");
        assert_eq!(node.attribute("format"), Some("binary"));
        let bytes = BASE64.decode(node.text().expect("text")).expect("base64");
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap());
        assert_eq!(length as usize, bytes.len() - 8, "the header counts the bytes that follow");
        (node.attribute("type").unwrap().to_string(), bytes[8..].to_vec())
    }

    fn particles() -> PolyData {
        PolyData {
            points: vec![Vec3::new(0.0, 0.0, 0.1), Vec3::new(1.0, -2.0, 3.0)],
            cells: Cells::verts(2),
            point_data: vec![
                DataArray::int64("id", vec![100, 101]),
                DataArray::scalar("radius", vec![0.1, 0.25]),
                DataArray::flags("sliding", [true, false]),
            ],
            cell_data: vec![],
        }
    }

    fn text(precision: Precision) -> String {
        let mut out = Vec::new();
        particles().write(&mut out, 0.025, None, precision).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn arrays_read_back_to_the_bit() {
        let text = text(Precision::Double);
        let (kind, bytes) = decode(&text, "radius");
        assert_eq!(kind, "Float64");
        let values: Vec<f64> =
            bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect();
        assert_eq!(values, [0.1, 0.25]);
        let (kind, bytes) = decode(&text, "Points");
        assert_eq!((kind.as_str(), bytes.len()), ("Float64", 6 * 8));
        let (kind, bytes) = decode(&text, "id");
        assert_eq!((kind.as_str(), &bytes[..8]), ("Int64", &100_i64.to_le_bytes()[..]));
        assert_eq!(decode(&text, "sliding"), ("Int32".to_string(), vec![1, 0, 0, 0, 0, 0, 0, 0]));
        let (kind, bytes) = decode(&self::text(Precision::Single), "radius");
        assert_eq!((kind.as_str(), bytes[..4].to_vec()), ("Float32", 0.1_f32.to_le_bytes().to_vec()));
    }

    /// Lengths around those at which pieces end, against an encoder that knows no pieces.
    #[test]
    fn pieces_join_to_the_base64_of_the_whole() {
        for length in [0, 1, 2, PIECE - 1, PIECE, PIECE + 1, 3 * PIECE / 4, 2 * PIECE + 5] {
            let values: Vec<i32> =
                (0..length as i32).map(|k| k.wrapping_mul(0x9e37_79b1_u32 as i32)).collect();
            let mut bytes = (4 * length as u64).to_le_bytes().to_vec();
            bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
            assert_eq!(encode(&values, i32::to_le_bytes), BASE64.encode(bytes).into_bytes(), "{length}");
        }
    }

    #[test]
    fn cells_are_fields() {
        let mut out = Vec::new();
        let vectors = [Vec3::new(2.0, 0.0, 0.0), Vec3::new(-0.5, 1.0, 0.0), Vec3::ZERO];
        let cell = PeriodicBox { origin: Vec3::new(-1.0, 0.0, 0.5), vectors, periodic: [true, true, false] };
        particles().write(&mut out, 0.0, Some(&cell), Precision::Single).unwrap();
        let text = String::from_utf8(out).unwrap();
        let document = roxmltree::Document::parse(&text).unwrap();
        let field = |name: &str| {
            let node = document.descendants().find(|node| node.attribute("Name") == Some(name)).unwrap();
            assert_eq!(node.parent().unwrap().tag_name().name(), "FieldData");
            node.text().unwrap().to_string()
        };
        assert_eq!(field("cell_origin"), "-1.0 0.0 0.5");
        assert_eq!(field("cell_vectors"), "2.0 0.0 0.0 -0.5 1.0 0.0 0.0 0.0 0.0");
        assert_eq!(field("cell_periodic"), "1 1 0");
    }

    #[test]
    fn particle_files_follow_the_rules_of_the_stricter_reader() {
        let text = text(Precision::Single);
        assert!(text.contains(r#"NumberOfPoints="2" NumberOfVerts="2" NumberOfLines="0""#));
        assert!(!text.contains("appended") && !text.contains("compressor"));
        assert!(text.find("</Piece>").unwrap() < text.find("<FieldData>").unwrap());
        assert!(text.contains(r#"Name="TimeValue" NumberOfTuples="1" format="ascii">0.025<"#));
    }
}
