//! Shapes.

use super::super::error::Location;
use graintrain::math::Vec3;
use graintrain::shape::Lengths;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A shape. Lengths in m.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ShapeSpec {
    /// Box.
    Box {
        /// Edge lengths.
        size: Vec3,
    },
    /// Half-space.
    Plane {
        /// Outward unit normal.
        normal: Vec3,
    },
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

/// Points of a convex hull, from a file of triangles or written in the scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HullSpec {
    /// The file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// The points, m, before scaling.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<Vec3>,
    /// Factors on the coordinates.
    pub scale: Vec3,
    /// Corners at most; `None`: all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub corners: Option<u64>,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}

/// Triangles from a file or written in the scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshSpec {
    /// The file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// Corner points, m, before scaling.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub vertices: Vec<Vec3>,
    /// Vertex numbers.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub triangles: Vec<[u32; 3]>,
    /// Factors on the coordinates.
    pub scale: Vec3,
    /// Whether it bounds a solid with a mass.
    pub solid: bool,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
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
        matches!(self, Self::Plane { .. } | Self::Mesh(MeshSpec { solid: false, .. }))
    }
}
