//! What can be wrong with a world: shapes, materials, motions, bodies.

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
    /// A body that forces are to move but that has no mass.
    #[error(
        "body {body}: its geometry has no volume (planes and meshes are boundaries), so all of its motion must be prescribed"
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

/// `Err` unless all components are finite.
pub(crate) fn finite(what: &str, values: &[f64]) -> Result<(), ModelError> {
    match values.iter().find(|value| !value.is_finite()) {
        None => Ok(()),
        Some(&value) => Err(ModelError::Value { what: what.to_string(), value, expected: "finite" }),
    }
}
