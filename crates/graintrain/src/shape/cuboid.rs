//! Boxes.

use super::library::Convex;
use super::{Distance, Form, Shape, Surface, at_plane};
use crate::error::{ModelError, length};
use crate::math::{Mat3, Vec3};
use serde::{Deserialize, Serialize};

/// Box with edges along the axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cuboid {
    /// Half edge lengths, m.
    pub half: Vec3,
}

impl Cuboid {
    /// A corner: bit k of its number tells on which side of axis k.
    fn corner(&self, number: usize) -> Vec3 {
        let sign = |axis: usize| if number >> axis & 1 == 1 { 1.0 } else { -1.0 };
        self.half * Vec3::new(sign(0), sign(1), sign(2))
    }
}

impl Form for Cuboid {
    fn validate(&self) -> Result<(), ModelError> {
        self.half.to_array().iter().try_for_each(|&half| length("a half edge length of a box", half))
    }

    fn scaled(&self, factor: f64) -> Shape {
        Shape::Box(Self { half: factor * self.half })
    }

    fn volume(&self) -> f64 {
        8.0 * self.half.x * self.half.y * self.half.z
    }

    fn unit_inertia(&self) -> Mat3 {
        let square = self.half * self.half;
        let sums = Vec3::new(square.y + square.z, square.z + square.x, square.x + square.y);
        Mat3::from_diagonal(self.volume() / 3.0 * sums)
    }

    fn half_thickness(&self) -> f64 {
        self.half.min_element()
    }

    fn inscribed_half_axes(&self) -> Option<Vec3> {
        Some(self.half)
    }

    fn bounding_radius(&self) -> f64 {
        self.half.length()
    }

    fn reach(&self, direction: Vec3) -> f64 {
        self.half.dot(direction.abs())
    }

    fn surface(&self) -> Option<Surface> {
        let mut surface =
            Surface { vertices: (0..8).map(|k| self.corner(k)).collect(), triangles: Vec::new() };
        for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            surface.quad(face);
        }
        Some(surface)
    }

    fn signed_distance(&self, c: Vec3) -> Distance {
        // Per axis: how far beyond the face (negative: how far inside).
        let beyond = c.abs() - self.half;
        let outside = beyond.max(Vec3::ZERO);
        let sign = Vec3::new(1.0_f64.copysign(c.x), 1.0_f64.copysign(c.y), 1.0_f64.copysign(c.z));
        let length = outside.length();
        if length > 0.0 {
            return Distance { value: length, normal: sign * outside / length };
        }
        let value = beyond.max_element();
        let normal = if beyond.x == value {
            Vec3::X
        } else if beyond.y == value {
            Vec3::Y
        } else {
            Vec3::Z
        };
        Distance { value, normal: sign * normal }
    }

    /// The planes of its faces.
    fn crossings(&self, centre: Vec3, half_axis: Vec3) -> Vec<f64> {
        let planes = |axis: usize| {
            [-1.0, 1.0].map(|side| at_plane(side * self.half[axis], centre[axis], half_axis[axis]))
        };
        (0..3).flat_map(planes).collect()
    }

    /// The four corners of the face that looks down most.
    fn lowest_points(&self, down: Vec3, each: &mut dyn FnMut(Vec3, f64, u64)) {
        let axis = largest_axis(down.abs());
        let sign = 1.0_f64.copysign(down[axis]);
        for corner in 0..4 {
            let mut p = self.half;
            p[axis] *= sign;
            for (bit, other) in [(axis + 1) % 3, (axis + 2) % 3].into_iter().enumerate() {
                if corner >> bit & 1 == 1 {
                    p[other] = -p[other];
                }
            }
            each(p, 0.0, (0..3).map(|k| u64::from(p[k] < 0.0) << k).sum());
        }
    }

    fn inside_face(&self, p: Vec3) -> f64 {
        let beyond = (p.abs() - self.half).to_array();
        let largest = (0..3).fold(0, |best, k| if beyond[k] > beyond[best] { k } else { best });
        (0..3).filter(|&k| k != largest).map(|k| -beyond[k]).fold(f64::INFINITY, f64::min)
    }

    fn height_over_face(&self, p: Vec3, outward: Vec3, beside: f64) -> Option<f64> {
        let axis = (0..3).find(|&k| outward[k].abs() >= 1.0 - 1e-9)?;
        let height = p[axis].copysign(p[axis] * outward[axis]) - self.half[axis];
        let over = (0..3).all(|k| k == axis || p[k].abs() <= self.half[k] + beside);
        over.then_some(height)
    }

    fn in_library(&self, unit: f64) -> Option<Convex<'_>> {
        Some(Convex::Box(parry3d_f64::shape::Cuboid::new(self.half / unit)))
    }
}

fn largest_axis(v: Vec3) -> usize {
    if v.x >= v.y && v.x >= v.z {
        0
    } else if v.y >= v.z {
        1
    } else {
        2
    }
}
