//! Meshes of triangles.

use super::{Distance, Form, Shape, Surface};
use crate::error::{ModelError, place};
use crate::math::{Mat3, Vec3};
use crate::solid_mesh::{check_closed, moments};
use serde::{Deserialize, Serialize};

/// Surface of triangles. Bodies stay on the side of it on which their centre is. It has the mass of what it
/// encloses if it is `solid`, otherwise it is a boundary without mass.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mesh {
    /// Corner points, m.
    pub vertices: Vec<Vec3>,
    /// Three vertex indices per triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Whether it bounds a solid.
    pub solid: bool,
}

impl Mesh {
    /// Largest of a number of each vertex.
    fn largest(&self, of: impl Fn(&Vec3) -> f64, at_least: f64) -> f64 {
        self.vertices.iter().map(of).fold(at_least, f64::max)
    }

    /// `Err` for a triangle of vertices that are not there, or without area.
    fn check_triangles(&self) -> Result<(), ModelError> {
        for (triangle, corners) in self.triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= self.vertices.len()) {
                return Err(ModelError::MeshVertex { triangle, vertex, len: self.vertices.len() });
            }
            let [a, b, c] = corners.map(|v| self.vertices[v as usize]);
            let scale = (b - a).length_squared().max((c - a).length_squared());
            if (b - a).cross(c - a).length() <= 1e-14 * scale {
                return Err(ModelError::MeshArea { triangle });
            }
        }
        Ok(())
    }
}

impl Form for Mesh {
    fn validate(&self) -> Result<(), ModelError> {
        if self.triangles.is_empty() {
            return Err(ModelError::Empty { what: "the mesh" });
        }
        for vertex in &self.vertices {
            place("a coordinate of a mesh vertex", &vertex.to_array())?;
        }
        self.check_triangles()?;
        if !self.solid {
            return Ok(());
        }
        // Its vertices are what touches planes.
        let mut used = vec![false; self.vertices.len()];
        self.triangles.iter().flatten().for_each(|&vertex| used[vertex as usize] = true);
        if let Some(vertex) = used.iter().position(|&used| !used) {
            let what = format!("vertex {vertex} of a solid mesh belongs to no triangle");
            return Err(ModelError::Table { what });
        }
        check_closed(&self.vertices, &self.triangles)
    }

    fn scaled(&self, factor: f64) -> Shape {
        Shape::Mesh(Self {
            vertices: self.vertices.iter().map(|vertex| factor * vertex).collect(),
            triangles: self.triangles.clone(),
            solid: self.solid,
        })
    }

    fn volume(&self) -> f64 {
        if self.solid { moments(&self.vertices, &self.triangles).0.volume } else { 0.0 }
    }

    fn unit_inertia(&self) -> Mat3 {
        if !self.solid {
            return Mat3::ZERO;
        }
        let (moments, middle) = moments(&self.vertices, &self.triangles);
        moments.inertia(-middle)
    }

    fn half_thickness(&self) -> f64 {
        if !self.solid {
            return f64::INFINITY;
        }
        let low = self.vertices.iter().fold(Vec3::INFINITY, |low, v| low.min(*v));
        let high = self.vertices.iter().fold(Vec3::NEG_INFINITY, |high, v| high.max(*v));
        0.5 * (high - low).min_element()
    }

    fn inscribed_radius(&self) -> f64 {
        if self.solid { self.half_thickness() } else { 0.0 }
    }

    fn inscribed_half_axes(&self) -> Option<Vec3> {
        None
    }

    fn bounding_radius(&self) -> f64 {
        self.largest(|v| v.length(), 0.0)
    }

    fn reach(&self, direction: Vec3) -> f64 {
        self.largest(|v| direction.dot(*v), f64::NEG_INFINITY)
    }

    fn surface(&self) -> Option<Surface> {
        Some(Surface { vertices: self.vertices.clone(), triangles: self.triangles.clone() })
    }

    fn signed_distance(&self, _c: Vec3) -> Distance {
        unreachable!("a mesh is treated triangle by triangle")
    }

    fn lowest_points(&self, _down: Vec3, each: &mut dyn FnMut(Vec3, f64, u64)) {
        for (feature, vertex) in (0..).zip(&self.vertices) {
            each(*vertex, 0.0, feature);
        }
    }
}
