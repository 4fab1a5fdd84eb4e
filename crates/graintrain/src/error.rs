//! What can be wrong with a world: shapes, materials, motions, bodies.

use crate::math::Vec3;

/// A defect of a shape, material, motion or body, with the number that is wrong and what it should be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// A number out of its range.
    #[error("{what} is {value}; it must be {expected}")]
    Value {
        /// Which quantity.
        what: String,
        /// The offending number.
        value: f64,
        /// The range.
        expected: &'static str,
    },
    /// An index that names nothing.
    #[error("there is no {what} {index}; the world has {len}, counted from 0")]
    Index {
        /// Kind of thing.
        what: &'static str,
        /// The index given.
        index: usize,
        /// How many there are.
        len: usize,
    },
    /// Lists of which one is too short or too long.
    #[error("there are {found} {what}, but there should be {expected}")]
    Length {
        /// Kind of thing.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error(
        "triangle {triangle} of the mesh names vertex {vertex}, but the mesh has {len} vertices, counted from 0"
    )]
    MeshVertex {
        /// Index of the triangle.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// How many there are.
        len: usize,
    },
    /// A triangle whose corners lie on a line.
    #[error("triangle {triangle} of the mesh has no area; remove it")]
    MeshArea {
        /// Index of the triangle.
        triangle: usize,
    },
    /// A mesh that is to be solid but does not close.
    #[error(
        "the mesh is not closed: {edges} edges belong to one triangle only, the first from {from} to {to} (triangle {triangle}); close \
         the holes, or give the body a mass and an inertia"
    )]
    MeshOpen {
        /// How many edges.
        edges: usize,
        /// A triangle with such an edge.
        triangle: usize,
        /// Where that edge begins.
        from: Vec3,
        /// Where it ends.
        to: Vec3,
    },
    /// A mesh that is to be solid whose triangles are not all turned alike.
    #[error(
        "triangles {other} and {triangle} of the mesh go along a common edge in the same direction: one is turned the wrong way round, or \
         more than two share the edge"
    )]
    MeshTurned {
        /// Index of a triangle.
        triangle: usize,
        /// Index of another.
        other: usize,
    },
    /// A mesh that is to be solid whose triangles all look inward.
    #[error(
        "the mesh is inside out: it encloses {volume} m^3; turn all triangles round (counter-clockwise seen from outside)"
    )]
    MeshInsideOut {
        /// m^3, not positive.
        volume: f64,
    },
    /// A solid mesh in a compound with other masses.
    #[error("a solid mesh has to be the only part with a mass: what it shares with other parts is not known")]
    MeshJoined,
    /// Points that span no volume.
    #[error(
        "the {points} points of a convex hull lie in a plane, or are fewer than four; give points that enclose a volume"
    )]
    HullFlat {
        /// How many points.
        points: usize,
    },
    /// Points whose hull is too large or too small for its inertia to be a number.
    #[error(
        "the points of a convex hull span {extent:e} m; {smallest:e} m to {largest:e} m are possible: is the scale that of the file?"
    )]
    HullExtent {
        /// Largest of its three sizes, m.
        extent: f64,
        /// The smallest possible, m.
        smallest: f64,
        /// The largest possible, m.
        largest: f64,
    },
    /// Points whose hull has faces too narrow for rounded numbers.
    #[error(
        "the convex hull of {points} points could not be built: faces are too narrow for their normals; leave out points that nearly \
         coincide, or are nearly in line"
    )]
    HullFailed {
        /// How many points.
        points: usize,
    },
    /// A hull that is finer than contacts are made for.
    #[error(
        "the convex hull has {corners} corners; at most {most} are possible: give fewer points, or a coarser mesh"
    )]
    HullCorners {
        /// How many it has.
        corners: usize,
        /// How many it may have.
        most: usize,
    },
    /// A geometry without parts, or a mesh without triangles.
    #[error("{what} is empty")]
    Empty {
        /// Which thing.
        what: &'static str,
    },
    /// Two materials of the same name.
    #[error("there are two materials named '{name}'")]
    DuplicateMaterial {
        /// The name.
        name: String,
    },
    /// A table or formula that is not a function of time.
    #[error("{what}")]
    Table {
        /// What is wrong with it.
        what: String,
    },
    /// An inertia that no body has.
    #[error(
        "the inertia of body {body} is that of no body: it has to be symmetric and positive definite, with no principal moment above the sum of the others"
    )]
    Inertia {
        /// Name or index of the body.
        body: String,
    },
    /// A joint that holds nothing, or cannot do what it is asked for.
    #[error("{joint}: {what}")]
    Joint {
        /// Its name or index.
        joint: String,
        /// What is wrong with it, and the remedy.
        what: String,
    },
    /// A periodic cell that cannot be, or bodies that do not fit into it.
    #[error("the periodic cell: {what}")]
    Cell {
        /// What is wrong, and the remedy.
        what: String,
    },
    /// A body that forces are to move but that has no mass.
    #[error(
        "body {body}: its geometry has no volume (planes, and meshes that are not solid, are boundaries), so all of its motion must be prescribed, or its mass given"
    )]
    Massless {
        /// Name or index of the body.
        body: String,
    },
}

/// `Err` unless the value is finite and positive.
pub(crate) fn positive(what: impl Into<String>, value: f64) -> Result<(), ModelError> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(ModelError::Value { what: what.into(), value, expected: "finite and positive" })
}

/// Longest and shortest length, m, whose powers in volumes and inertias are numbers.
const LENGTHS: std::ops::RangeInclusive<f64> = 1e-50..=1e50;

/// `Err` unless the length, m, is positive and neither so long nor so short that collision and inertia
/// overflow.
pub(crate) fn length(what: &str, value: f64) -> Result<(), ModelError> {
    positive(what, value)?;
    if LENGTHS.contains(&value) {
        return Ok(());
    }
    Err(ModelError::Value { what: what.to_string(), value, expected: "between 1e-50 and 1e50 m" })
}

/// `Err` unless all components, m, are finite and none so far off that collision overflows.
pub(crate) fn place(what: &str, values: &[f64]) -> Result<(), ModelError> {
    finite(what, values)?;
    match values.iter().find(|value| value.abs() > *LENGTHS.end()) {
        None => Ok(()),
        Some(&value) => {
            Err(ModelError::Value { what: what.to_string(), value, expected: "between -1e50 and 1e50 m" })
        }
    }
}

/// `Err` unless finite and zero or above, m.
pub(crate) fn not_negative(what: &str, value: f64) -> Result<(), ModelError> {
    if value == 0.0 { Ok(()) } else { length(what, value) }
}

/// `Err` unless the value is finite and not negative.
pub(crate) fn not_below_zero(what: impl Into<String>, value: f64) -> Result<(), ModelError> {
    if value.is_finite() && value >= 0.0 {
        return Ok(());
    }
    Err(ModelError::Value { what: what.into(), value, expected: "finite and not negative" })
}

/// `Err` unless there are more than `index` of these.
pub(crate) fn index(what: &'static str, index: usize, len: usize) -> Result<(), ModelError> {
    if index < len { Ok(()) } else { Err(ModelError::Index { what, index, len }) }
}

/// `Err` unless all components are finite.
pub(crate) fn finite(what: &str, values: &[f64]) -> Result<(), ModelError> {
    match values.iter().find(|value| !value.is_finite()) {
        None => Ok(()),
        Some(&value) => Err(ModelError::Value { what: what.to_string(), value, expected: "finite" }),
    }
}
