//! Surfaces of triangles from files: STL (ascii and binary), OBJ, COLLADA, and tables of nine coordinates per
//! triangle.

mod collada;

use super::packing::FileProblem;
use super::packing::table_file;
use super::quantity::Dimension;
use graintrain::math::Vec3;
use std::collections::HashMap;
use std::path::Path;

/// Corner points and triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Triangles {
    pub vertices: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}

/// Bytes before the triangles of a binary STL file: comment and count.
const STL_HEADER: usize = 84;
/// Bytes of a triangle of a binary STL file: normal, three corners, attribute.
const STL_TRIANGLE: usize = 50;

/// Reads a mesh; its form follows from the ending of the path. Triangles without area are left out.
pub(crate) fn read(path: &Path, bytes: &[u8]) -> Result<Triangles, FileProblem> {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_lowercase();
    let corners = match ending.as_str() {
        "stl" => read_stl(bytes)?,
        "obj" => read_obj(bytes)?,
        "dae" => collada::read(text(bytes)?)?,
        _ => read_table(bytes)?,
    };
    let triangles = join(&corners);
    if triangles.triangles.is_empty() {
        return Err(FileProblem::new("it holds no triangles"));
    }
    Ok(triangles)
}

/// Joins corners at the same place, and drops triangles without area.
fn join(corners: &[[Vec3; 3]]) -> Triangles {
    let mut mesh = Triangles::default();
    let mut known: HashMap<[u64; 3], u32> = HashMap::new();
    for triangle in corners {
        let [a, b, c] = *triangle;
        let longest = (b - a).length_squared().max((c - a).length_squared());
        if (b - a).cross(c - a).length() <= 1e-12 * longest {
            continue;
        }
        mesh.triangles.push(triangle.map(|corner| {
            // Adding zero makes -0 and 0 the same place.
            *known.entry((corner + Vec3::ZERO).to_array().map(f64::to_bits)).or_insert_with(|| {
                mesh.vertices.push(corner);
                mesh.vertices.len() as u32 - 1
            })
        }));
    }
    mesh
}

fn finite(corner: [f64; 3], problem: impl FnOnce() -> FileProblem) -> Result<Vec3, FileProblem> {
    let corner = Vec3::from_array(corner);
    if corner.is_finite() { Ok(corner) } else { Err(problem()) }
}

fn read_stl(bytes: &[u8]) -> Result<Vec<[Vec3; 3]>, FileProblem> {
    let announced = bytes.get(STL_HEADER - 4..STL_HEADER).and_then(|count| count.try_into().ok());
    let announced = announced.map(u32::from_le_bytes).map(|count| count as usize);
    let length = announced.map(|count| STL_HEADER + count * STL_TRIANGLE);
    if length == Some(bytes.len()) {
        return read_binary_stl(&bytes[STL_HEADER..]);
    }
    if bytes.starts_with(b"solid") {
        return read_ascii_stl(bytes);
    }
    Err(FileProblem::new(match announced {
        Some(count) => format!(
            "it is cut short: {count} triangles need {} bytes, it has {}",
            STL_HEADER + count * STL_TRIANGLE,
            bytes.len()
        ),
        None => "it is no STL file: too short".into(),
    }))
}

fn read_binary_stl(bytes: &[u8]) -> Result<Vec<[Vec3; 3]>, FileProblem> {
    let triangles = bytes.chunks_exact(STL_TRIANGLE).enumerate().map(|(index, triangle)| {
        let (numbers, _) = triangle.as_chunks::<4>();
        let number = |at: usize| f64::from(f32::from_le_bytes(numbers[at]));
        let corner = |at: usize| {
            finite([number(at), number(at + 1), number(at + 2)], || {
                FileProblem::new(format!("triangle {} has a coordinate that is not finite", index + 1))
            })
        };
        Ok([corner(3)?, corner(6)?, corner(9)?])
    });
    triangles.collect()
}

fn three_numbers<'a>(line: usize, mut words: impl Iterator<Item = &'a str>) -> Result<Vec3, FileProblem> {
    let mut number = || {
        let word = words.next().ok_or_else(|| FileProblem::at(line, "three coordinates are needed"))?;
        word.parse::<f64>().map_err(|_| FileProblem::at(line, format!("`{word:.40}` is not a number")))
    };
    let corner = [number()?, number()?, number()?];
    finite(corner, || FileProblem::at(line, "a coordinate is not finite"))
}

fn text(bytes: &[u8]) -> Result<&str, FileProblem> {
    std::str::from_utf8(bytes).map_err(|_| FileProblem::new("it is not a text file: save it as UTF-8"))
}

fn read_ascii_stl(bytes: &[u8]) -> Result<Vec<[Vec3; 3]>, FileProblem> {
    let mut corners = Vec::new();
    let mut is_complete = false;
    for (index, line) in text(bytes)?.lines().enumerate() {
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("vertex") => corners.push(three_numbers(index + 1, words)?),
            Some("endsolid") => is_complete = true,
            _ => {}
        }
    }
    let (triangles, rest) = corners.as_chunks::<3>();
    if !is_complete || !rest.is_empty() {
        return Err(FileProblem::new("it is cut short: no `endsolid` after whole triangles"));
    }
    Ok(triangles.to_vec())
}

fn read_obj(bytes: &[u8]) -> Result<Vec<[Vec3; 3]>, FileProblem> {
    let mut vertices: Vec<Vec3> = Vec::new();
    let mut triangles = Vec::new();
    for (index, line) in text(bytes)?.lines().enumerate() {
        let line_number = index + 1;
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => vertices.push(three_numbers(line_number, words)?),
            Some("f") => {
                let corner = |word: &str| {
                    // `3/1/2` is vertex 3; negative numbers count back from the last vertex.
                    let number = word.split('/').next().and_then(|number| number.parse::<i64>().ok());
                    let index = match number {
                        Some(number) if number > 0 => usize::try_from(number - 1).ok(),
                        Some(number) => usize::try_from(number.unsigned_abs())
                            .ok()
                            .and_then(|back| vertices.len().checked_sub(back)),
                        None => None,
                    };
                    index.and_then(|index| vertices.get(index).copied()).ok_or_else(|| {
                        FileProblem::at(line_number, format!("`{word:.40}` names no vertex before this line"))
                    })
                };
                let face: Vec<Vec3> = words.map(corner).collect::<Result<_, _>>()?;
                if face.len() < 3 {
                    return Err(FileProblem::at(line_number, "a face needs three corners"));
                }
                triangles.extend(face[1..].windows(2).map(|pair| [face[0], pair[0], pair[1]]));
            }
            _ => {}
        }
    }
    Ok(triangles)
}

fn read_table(bytes: &[u8]) -> Result<Vec<[Vec3; 3]>, FileProblem> {
    let table = table_file::read(bytes, None, 0)?;
    let mut columns = Vec::new();
    for corner in 1..=3 {
        for axis in ["x", "y", "z"] {
            let name = format!("vertex{corner}_{axis}");
            let column = table.column(&[&name], Dimension::LENGTH)?.ok_or_else(|| {
                FileProblem::at(table.header_line, format!("the header lacks the column `{name}`"))
            })?;
            columns.push(column);
        }
    }
    (0..table.rows.len())
        .map(|row| {
            let corner = |first: usize| {
                finite([columns[first][row], columns[first + 1][row], columns[first + 2][row]], || {
                    FileProblem::new(format!("triangle {} has a coordinate that is not finite", row + 1))
                })
            };
            Ok([corner(0)?, corner(3)?, corner(6)?])
        })
        .collect()
}
