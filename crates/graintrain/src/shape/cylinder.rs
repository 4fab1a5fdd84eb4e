//! Circular cylinders.

use super::frustum::{Frustum, of_frustum};
use super::library::Convex;
use super::{Corners, Distance, Form, Length, Lengths, Shape, Surface};
use crate::error::{ModelError, length};
use crate::math::{Mat3, Vec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Circular cylinder about the z axis with flat ends at z = +-half_length.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cylinder {
    /// Half height, m.
    pub half_length: f64,
    /// Radius, m.
    pub radius: f64,
}

pub(super) const LENGTHS: Lengths = Lengths {
    name: "cylinder",
    heading: "`shape.cylinder`",
    meaning: "Cylinder along z",
    example: "{ length = 2, radius = 1 }",
    lengths: &[
        Length::required("length", "\"4 cm\"", "Height"),
        Length::required("radius", "\"1 cm\"", "Radius"),
    ],
    make: |lengths| Shape::Cylinder(Cylinder { half_length: 0.5 * lengths[0], radius: lengths[1] }),
};

impl Cylinder {
    fn frustum(&self) -> Frustum {
        Frustum::cylinder(self.half_length, self.radius)
    }
}

impl Form for Cylinder {
    fn validate(&self) -> Result<(), ModelError> {
        length("the half length of a cylinder", self.half_length)?;
        length("the radius of a cylinder", self.radius)
    }

    fn scaled(&self, factor: f64) -> Shape {
        Shape::Cylinder(Self { half_length: factor * self.half_length, radius: factor * self.radius })
    }

    fn volume(&self) -> f64 {
        2.0 * PI * self.radius * self.radius * self.half_length
    }

    fn unit_inertia(&self) -> Mat3 {
        let (h2, r2) = (self.half_length * self.half_length, self.radius * self.radius);
        let across = r2 / 4.0 + h2 / 3.0;
        Mat3::from_diagonal(self.volume() * Vec3::new(across, across, r2 / 2.0))
    }

    fn half_thickness(&self) -> f64 {
        self.radius.min(self.half_length)
    }

    fn inscribed_half_axes(&self) -> Option<Vec3> {
        Some(Vec3::new(self.radius, self.radius, self.half_length))
    }

    of_frustum!();

    fn half_axis(&self) -> Option<f64> {
        Some(self.half_length)
    }
}
