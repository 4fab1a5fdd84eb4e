//! Shapes.

use super::super::error::{Location, SceneError};
use super::super::reader::Reader;
use super::super::schema::{D, Key, Kind, Range, Table};
use super::super::table::{Field, Spec, table};
use graintrain::math::Vec3;
use graintrain::shape::{Lengths, Shape};
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A shape. Lengths in m.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ShapeSpec {
    /// Box.
    Box(BoxSpec),
    /// Half-space.
    Plane(HalfSpaceSpec),
    /// Convex hull.
    Hull(HullSpec),
    /// Triangles.
    Mesh(MeshSpec),
    /// A shape of lengths alone.
    #[serde(untagged)]
    Lengths(LengthsSpec),
}

/// A shape of lengths alone: a sphere, a capsule, a cylinder, a cone.
#[derive(Clone, Debug)]
pub struct LengthsSpec {
    /// Which.
    pub form: &'static Lengths,
    /// The lengths, in its order.
    pub lengths: Vec<f64>,
}

impl PartialEq for LengthsSpec {
    fn eq(&self, other: &Self) -> bool {
        self.form.name == other.form.name && self.lengths == other.lengths
    }
}

impl Serialize for LengthsSpec {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let names = self.form.lengths.iter().map(|length| length.name);
        let lengths: BTreeMap<&str, f64> = names.zip(self.lengths.iter().copied()).collect();
        BTreeMap::from([(self.form.name, lengths)]).serialize(serializer)
    }
}

table! {
    /// A box.
    pub struct BoxSpec: "`shape.box`" {
        /// Edge lengths
        size: Vec3 = Vector(D::LENGTH), "required", "[\"1 m\", \"2 m\", \"3 m\"]", Positive;
    }
}

table! {
    /// A half-space.
    pub struct HalfSpaceSpec: "`shape.plane`" {
        /// Outward normal; any length
        normal: Vec3 = Direction, "[0, 0, 1]", "[1, 0, 0]";
    }
}

table! {
    /// Points of a convex hull, from a file of triangles or written in the scene.
    pub struct HullSpec: "`shape.hull`", at most one of ["file", "points"], checked by is_hull {
        /// STL, OBJ, COLLADA, or a table of nine coordinates per triangle: the hull of its vertices
        file: Option<PathBuf> = Text, "one of file, points", "\"stone.stl\"";
        /// Points that enclose a volume; those inside, or outside by less than 1e-6 of the extent, are not
        /// vertices
        #[serde(skip_serializing_if = "Vec::is_empty")]
        points: Vec<Vec3> = Rows, "one of file, points", "[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]";
        /// Factor for all coordinates, e.g. for a file in mm, or one for each axis; negative factors mirror
        scale: Vec3 = VectorOrQuantity(D::NONE), "1", "0.001";
        /// Maximum number of vertices: if there are more, the farthest point outside the hull is added until
        /// it has so many
        corners: Option<u64> = Count, "all, at most 256", "64", Positive;
        location of file, points
    }
}

table! {
    /// Triangles from a file or written in the scene.
    pub struct MeshSpec: "`shape.mesh`",
        at most one of ["file", "vertices"],
        at most one of ["file", "triangles"],
        checked by is_mesh {
        /// STL, OBJ, COLLADA, or a table of nine coordinates per triangle
        file: Option<PathBuf> = Text, "one of file, vertices", "\"hopper.stl\"";
        /// Vertices
        #[serde(skip_serializing_if = "Vec::is_empty")]
        vertices: Vec<Vec3> = Rows, "one of file, vertices", "[[0, 0, 0], [1, 0, 0], [0, 1, 0]]";
        /// Three vertex numbers (from 0) per triangle, counter-clockwise seen from outside
        #[serde(skip_serializing_if = "Vec::is_empty")]
        triangles: Vec<[u32; 3]> = Rows, "required with vertices", "[[0, 1, 2]]" => triangles;
        /// Factor for all coordinates, e.g. for a file in mm, or one for each axis
        scale: Vec3 = VectorOrQuantity(D::NONE), "1", "0.001", Positive;
        /// A closed surface, counter-clockwise seen from outside, with the mass of its interior
        solid: bool = Flag, "false", "true";
        location of file
    }
}

impl ShapeSpec {
    /// The shape of this name with these lengths.
    pub(crate) fn of_lengths(form: &'static Lengths, lengths: Vec<f64>) -> Self {
        Self::Lengths(LengthsSpec { form, lengths })
    }

    /// The file that the shape is read from, and where the scene names it.
    pub(crate) fn file_mut(&mut self) -> Option<(&mut PathBuf, &Location)> {
        match self {
            Self::Mesh(MeshSpec { file: Some(path), location, .. })
            | Self::Hull(HullSpec { file: Some(path), location, .. }) => Some((path, location)),
            _ => None,
        }
    }

    /// Whether the shape is a boundary without mass.
    pub fn is_boundary(&self) -> bool {
        matches!(self, Self::Plane(_) | Self::Mesh(MeshSpec { solid: false, .. }))
    }
}

pub(in crate::scene) static SHAPE: Table =
    Table { heading: "`shape`", alternatives: &[SHAPE_NAMES], keys: &SHAPE_KEYS };

/// Names of all shapes.
const SHAPE_NAMES: &[&str] = &{
    let mut names = [""; SHAPE_KEYS.len()];
    let mut number = 0;
    while number < names.len() {
        names[number] = SHAPE_KEYS[number].name;
        number += 1;
    }
    names
};

const SHAPE_KEYS: [Key; OTHERS.keys.len() + BY_LENGTHS.len()] = {
    let mut keys = [OTHERS.keys[0]; OTHERS.keys.len() + BY_LENGTHS.len()];
    let mut number = 0;
    while number < keys.len() {
        keys[number] = if number < BY_LENGTHS.len() {
            let form = BY_LENGTHS[number];
            Key {
                name: form.name,
                kind: Kind::Table(&LENGTHS_TABLES[number]),
                example: form.example,
                about: form.meaning,
                ..OTHERS.keys[0]
            }
        } else {
            OTHERS.keys[number - BY_LENGTHS.len()]
        };
        number += 1;
    }
    keys
};

const BY_LENGTHS: &[&Lengths] = Shape::BY_LENGTHS;

/// Lengths of a shape at most.
const MOST: usize = 3;

/// The keys of each shape of lengths; behind them the first one again.
const LENGTH_KEYS: [[Key; MOST]; BY_LENGTHS.len()] = {
    let mut all = [[OTHERS.keys[0]; MOST]; BY_LENGTHS.len()];
    let mut form = 0;
    while form < all.len() {
        let mut number = 0;
        while number < BY_LENGTHS[form].lengths.len() {
            let length = &BY_LENGTHS[form].lengths[number];
            let (default, range) =
                if length.is_required { ("required", Range::Positive) } else { ("0", Range::NotNegative) };
            all[form][number] = Key {
                name: length.name,
                kind: Kind::Quantity(D::LENGTH),
                range,
                default,
                example: length.example,
                about: length.meaning,
                ..OTHERS.keys[0]
            };
            number += 1;
        }
        form += 1;
    }
    all
};

static LENGTHS_TABLES: [Table; BY_LENGTHS.len()] = {
    const KEYS: &[[Key; MOST]; BY_LENGTHS.len()] = &LENGTH_KEYS;
    let mut tables = [const { Table { heading: "", alternatives: &[], keys: &[] } }; BY_LENGTHS.len()];
    let mut form = 0;
    while form < tables.len() {
        tables[form].heading = BY_LENGTHS[form].heading;
        tables[form].keys = KEYS[form].split_at(BY_LENGTHS[form].lengths.len()).0;
        form += 1;
    }
    tables
};

table! {
    /// The shapes that lengths alone do not describe.
    static OTHERS: "`shape`" {
        /// Box centred at the origin
        box = Table(BoxSpec::TABLE), "one of", "{ size = [1, 2, 3] }";
        /// Half-space below the plane through the origin; a massless boundary
        plane = Table(HalfSpaceSpec::TABLE), "one of", "{ normal = [0, 0, 1] }";
        /// Convex hull of points
        hull = Table(HullSpec::TABLE), "one of", "{ file = \"stone.stl\" }";
        /// Triangle mesh: a massless boundary, or a solid
        mesh = Table(MeshSpec::TABLE), "one of", "{ file = \"hopper.stl\" }";
    }
}

impl Field for ShapeSpec {
    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        reader.child(key)?.as_ref().map(shape).transpose()
    }
}

fn shape(reader: &Reader) -> Result<ShapeSpec, SceneError> {
    let (form, inner) = reader.form()?;
    if let Some(form) = Shape::BY_LENGTHS.iter().find(|lengths| lengths.name == form) {
        let lengths = form.lengths.iter().map(|length| inner.field(length.name)).collect::<Result<_, _>>()?;
        return Ok(ShapeSpec::Lengths(LengthsSpec { form, lengths }));
    }
    Ok(match form {
        "box" => ShapeSpec::Box(BoxSpec::read(&inner)?),
        "plane" => ShapeSpec::Plane(HalfSpaceSpec::read(&inner)?),
        "hull" => ShapeSpec::Hull(HullSpec::read(&inner)?),
        _ => ShapeSpec::Mesh(MeshSpec::read(&inner)?),
    })
}

/// Rows of three numbers.
impl Field for Vec<Vec3> {
    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        let rows = reader.rows(key)?.unwrap_or_default();
        Ok(Some(rows.into_iter().map(Vec3::from_array).collect()))
    }
}

fn is_hull(hull: &HullSpec, reader: &Reader) -> Result<(), SceneError> {
    reader.which()?;
    if hull.scale.to_array().contains(&0.0) {
        return Err(reader.out_of_range("scale", "a factor other than zero", hull.scale));
    }
    match hull.corners {
        Some(corners) if corners < 4 => Err(reader.out_of_range("corners", "at least 4", corners)),
        _ => Ok(()),
    }
}

fn is_mesh(_: &MeshSpec, reader: &Reader) -> Result<(), SceneError> {
    reader.which().map(|_| ())
}

/// The triangles of a mesh whose vertices the scene gives.
fn triangles(reader: &Reader, key: &str) -> Result<Vec<[u32; 3]>, SceneError> {
    let Some(vertices) = reader.rows("vertices")? else { return Ok(Vec::new()) };
    let vertex = |number: f64| {
        let is_one = number.fract() == 0.0 && (0.0..vertices.len() as f64).contains(&number);
        is_one.then_some(number as u32).ok_or_else(|| {
            let requirement = format!("made of vertex numbers from 0 to {}", vertices.len() as i64 - 1);
            reader.out_of_range(key, &requirement, number)
        })
    };
    let rows = reader.rows(key)?.ok_or_else(|| reader.missing(key))?;
    let triangle = |&[a, b, c]: &[f64; 3]| Ok([vertex(a)?, vertex(b)?, vertex(c)?]);
    let triangles: Vec<_> = rows.iter().map(triangle).collect::<Result<_, SceneError>>()?;
    if triangles.is_empty() { Err(reader.out_of_range(key, "at least one", "none")) } else { Ok(triangles) }
}
