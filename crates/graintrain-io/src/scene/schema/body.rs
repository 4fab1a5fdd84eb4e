//! Keys of bodies: parts, shapes, motions.

use super::Kind::{self, Count, Flag, List, Quantity, Rows, Tables, Text, TextOr, Texts, Vector};
use super::{D, Key, Range, Table, key, names};
use crate::scene::model::{MOTIONS, MotionSpec};
use crate::scene::table::Spec;
use graintrain::shape::{Lengths, Shape};

pub(super) static BODY: Table = Table {
    heading: "`[body.NAME]`",
    alternatives: &[&["shape", "parts"], &["mass", "density"]],
    keys: &[
        key(
            "shape",
            Kind::Table(&SHAPE),
            "one of shape, parts",
            "{ sphere = { radius = \"1 cm\" } }",
            "Shape",
        ),
        key(
            "parts",
            Tables(&PART),
            "one of shape, parts",
            "[{ shape = { plane = {} } }]",
            "Several shapes in one rigid body; overlapping volume counts once. `[]`: a body without contacts, with given mass and inertia",
        ),
        key("material", Text, "the only material", "\"glass\"", "Material"),
        key(
            "position",
            Vector(D::LENGTH),
            "[0, 0, 0]",
            "[0, 0, \"5 cm\"]",
            "Origin of the body's frame in the world",
        ),
        key(
            "rotation",
            Kind::Table(&ROTATION),
            "none",
            "{ axis = [0, 1, 0], angle = \"30 deg\" }",
            "Rotation of the body's frame",
        ),
        key(
            "velocity",
            Vector(D::SPEED),
            "[0, 0, 0]",
            "[\"1 m/s\", 0, 0]",
            "Initial velocity of the centre of mass (in a periodic cell relative to its deformation)",
        ),
        key(
            "angular_velocity",
            Vector(D::ANGULAR_SPEED),
            "[0, 0, 0]",
            "[0, 0, \"12 rpm\"]",
            "Initial angular velocity",
        ),
        key("mass", Quantity(D::MASS), "density x volume", "\"3 kg\"", "Mass").within(Range::Positive),
        key(
            "inertia",
            Vector(D::new(2, 1, 0, 0)),
            "from mass and shape",
            "[0.2, 0.3, \"0.2 kg m^2\"]",
            "Moments of inertia about the axes of the body's frame through its centre of mass (of a mesh: its origin); only with mass",
        ).within(Range::Positive),
        key(
            "products",
            Vector(D::new(2, 1, 0, 0)),
            "[0, 0, 0]",
            "[0, 0, \"0.01 kg m^2\"]",
            "Entries xy, xz, yz of the inertia tensor; only with inertia",
        ),
        key(
            "centre",
            Vector(D::LENGTH),
            "that of the shapes",
            "[0, 0, \"2 cm\"]",
            "Centre of mass in the body's frame; only with inertia",
        ),
        key("density", Quantity(D::DENSITY), "the material's", "\"7800 kg/m^3\"", "Density of this body").within(Range::Positive),
        key(
            "motion",
            TextOr(MotionSpec::TABLE),
            "free; fixed for planes and meshes",
            "\"fixed\"",
            "free, fixed, or a table of prescribed motions",
        ).one_of(|| names(MOTIONS)),
        key(
            "ignores",
            Texts,
            "[]",
            "[\"base\"]",
            "Bodies defined above it with which it has no contacts. For the two bodies of a joint this is the default",
        ),
    ],
};

pub(super) static PART: Table = Table {
    heading: "Part of a body, `parts`",
    alternatives: &[],
    keys: &[
        key("shape", Kind::Table(&SHAPE), "required", "{ box = { size = [1, 1, 1] } }", "Shape"),
        key("position", Vector(D::LENGTH), "[0, 0, 0]", "[\"1 m\", 0, 0]", "Position in the body's frame"),
        key(
            "rotation",
            Kind::Table(&ROTATION),
            "none",
            "{ axis = [0, 0, 1], angle = \"90 deg\" }",
            "Rotation in the body's frame",
        ),
    ],
};

pub(super) static ROTATION: Table = Table {
    heading: "`rotation`",
    alternatives: &[&["angle", "quaternion"], &["axis", "quaternion"]],
    keys: &[
        key("axis", Vector(D::NONE), "[0, 0, 1]", "[0, 1, 0]", "Axis; any length"),
        key("angle", Quantity(D::ANGLE), "0", "\"30 deg\"", "Angle about it"),
        key(
            "quaternion",
            List(D::NONE),
            "from axis and angle",
            "[0, 0, 0, 1]",
            "The same as a quaternion x, y, z, w",
        ),
    ],
};

pub(super) static SHAPE: Table =
    Table { heading: "`shape`", alternatives: &[SHAPE_NAMES], keys: &SHAPE_KEYS };

/// Names of all shapes.
pub const SHAPE_NAMES: &[&str] = &{
    let mut names = [""; SHAPE_KEYS.len()];
    let mut number = 0;
    while number < names.len() {
        names[number] = SHAPE_KEYS[number].name;
        number += 1;
    }
    names
};

const SHAPE_KEYS: [Key; OTHERS.len() + BY_LENGTHS.len()] = {
    let mut keys = [OTHERS[0]; OTHERS.len() + BY_LENGTHS.len()];
    let mut number = 0;
    while number < keys.len() {
        keys[number] = if number < BY_LENGTHS.len() {
            let form = BY_LENGTHS[number];
            key(form.name, Kind::Table(&LENGTHS_TABLES[number]), "one of", form.example, form.meaning)
        } else {
            OTHERS[number - BY_LENGTHS.len()]
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
    let mut all = [[OTHERS[0]; MOST]; BY_LENGTHS.len()];
    let mut form = 0;
    while form < all.len() {
        let mut number = 0;
        while number < BY_LENGTHS[form].lengths.len() {
            let length = &BY_LENGTHS[form].lengths[number];
            let (default, range) =
                if length.is_required { ("required", Range::Positive) } else { ("0", Range::NotNegative) };
            all[form][number] =
                key(length.name, Quantity(D::LENGTH), default, length.example, length.meaning).within(range);
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

/// The shapes that lengths alone do not describe.
const OTHERS: [Key; 4] = [
    key("box", Kind::Table(&BOX), "one of", "{ size = [1, 2, 3] }", "Box centred at the origin"),
    key(
        "plane",
        Kind::Table(&PLANE),
        "one of",
        "{ normal = [0, 0, 1] }",
        "Half-space below the plane through the origin; a massless boundary",
    ),
    key("hull", Kind::Table(&HULL), "one of", "{ file = \"stone.stl\" }", "Convex hull of points"),
    key(
        "mesh",
        Kind::Table(&MESH),
        "one of",
        "{ file = \"hopper.stl\" }",
        "Triangle mesh: a massless boundary, or a solid",
    ),
];

static BOX: Table = Table {
    heading: "`shape.box`",
    alternatives: &[],
    keys: &[key("size", Vector(D::LENGTH), "required", "[\"1 m\", \"2 m\", \"3 m\"]", "Edge lengths")
        .within(Range::Positive)],
};

static PLANE: Table = Table {
    heading: "`shape.plane`",
    alternatives: &[],
    keys: &[key("normal", Vector(D::NONE), "[0, 0, 1]", "[1, 0, 0]", "Outward normal; any length")],
};

static HULL: Table = Table {
    heading: "`shape.hull`",
    alternatives: &[&["file", "points"]],
    keys: &[
        key(
            "file",
            Text,
            "one of file, points",
            "\"stone.stl\"",
            "STL, OBJ, COLLADA, or a table of nine coordinates per triangle: the hull of its vertices",
        ),
        key(
            "points",
            Rows,
            "one of file, points",
            "[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]",
            "Points that enclose a volume; those inside, or outside by less than 1e-6 of the extent, are not vertices",
        ),
        key(
            "scale",
            Kind::VectorOrQuantity(D::NONE),
            "1",
            "0.001",
            "Factor for all coordinates, e.g. for a file in mm, or one for each axis; negative factors mirror",
        ),
        key(
            "corners",
            Count,
            "all, at most 256",
            "64",
            "Maximum number of vertices: if there are more, the farthest point outside the hull is added until it has so many",
        )
        .within(Range::Positive),
    ],
};

static MESH: Table = Table {
    heading: "`shape.mesh`",
    alternatives: &[&["file", "vertices"], &["file", "triangles"]],
    keys: &[
        key(
            "file",
            Text,
            "one of file, vertices",
            "\"hopper.stl\"",
            "STL, OBJ, COLLADA, or a table of nine coordinates per triangle",
        ),
        key("vertices", Rows, "one of file, vertices", "[[0, 0, 0], [1, 0, 0], [0, 1, 0]]", "Vertices"),
        key(
            "triangles",
            Rows,
            "required with vertices",
            "[[0, 1, 2]]",
            "Three vertex numbers (from 0) per triangle, counter-clockwise seen from outside",
        ),
        key(
            "scale",
            Kind::VectorOrQuantity(D::NONE),
            "1",
            "0.001",
            "Factor for all coordinates, e.g. for a file in mm, or one for each axis",
        )
        .within(Range::Positive),
        key(
            "solid",
            Flag,
            "false",
            "true",
            "A closed surface, counter-clockwise seen from outside, with the mass of its interior",
        ),
    ],
};
