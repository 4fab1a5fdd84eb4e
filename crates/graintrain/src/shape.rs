//! Shapes, and geometries made of one or more shapes.

use crate::math::{Mat3, Quat, Vec3};
use serde::{Deserialize, Serialize};

/// A solid or boundary shape in its own frame, lengths in m.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Shape {
    /// Ball about the origin.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// Box with edges along the axes.
    Box {
        /// Half edge lengths.
        half: Vec3,
    },
    /// Half-space z <= 0; the outward normal is +z. A boundary: it has no mass.
    Plane,
    /// Points within `radius` of the segment from (0, 0, -half_length) to (0, 0, half_length).
    Capsule {
        /// Half length of the segment.
        half_length: f64,
        /// Radius.
        radius: f64,
    },
    /// Circular cylinder about the z axis with flat ends at z = +-half_length.
    Cylinder {
        /// Half height.
        half_length: f64,
        /// Radius.
        radius: f64,
    },
    /// Surface of triangles. A boundary: it has no mass.
    Mesh {
        /// Corner points.
        vertices: Vec<Vec3>,
        /// Three vertex indices per triangle, counter-clockwise seen from outside.
        triangles: Vec<[u32; 3]>,
    },
}

/// A shape placed in a body's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// The shape.
    pub shape: Shape,
    /// Origin of the shape in the body's frame, m.
    pub position: Vec3,
    /// Rotation from the shape's frame to the body's frame.
    pub orientation: Quat,
}

/// Rigid union of parts; shared by all bodies of the same form. Parts are assumed not to overlap.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Geometry {
    /// The parts, in a frame whose origin is the centre of mass (geometries without volume: any origin).
    pub parts: Vec<Part>,
    /// Volume, m^3; zero for boundaries.
    pub volume: f64,
    /// Inertia about the centre of mass per unit density, body axes, m^5.
    pub unit_inertia: Mat3,
}
