//! Shapes.

use super::super::error::Location;
use graintrain::math::Vec3;
use serde::Serialize;
use std::path::PathBuf;

/// A shape. Lengths in m.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ShapeSpec {
    /// Ball.
    Sphere {
        /// Radius.
        radius: f64,
    },
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
    /// Capsule along z.
    Capsule {
        /// Distance between the centres of the half balls.
        length: f64,
        /// Radius.
        radius: f64,
    },
    /// Cylinder along z.
    Cylinder {
        /// Height.
        length: f64,
        /// Radius.
        radius: f64,
    },
    /// Convex hull.
    Hull(HullSpec),
    /// Triangles.
    Mesh(MeshSpec),
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
