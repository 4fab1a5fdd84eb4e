//! Balls.

use super::{Distance, Form, Length, Lengths, Shape, Surface};
use crate::error::{ModelError, length};
use crate::math::{Mat3, Vec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Ball about the origin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sphere {
    /// Radius, m.
    pub radius: f64,
}

pub(super) const LENGTHS: Lengths = Lengths {
    name: "sphere",
    heading: "`shape.sphere`",
    meaning: "Sphere centred at the origin",
    example: "{ radius = \"1 cm\" }",
    lengths: &[Length::required("radius", "\"1 cm\"", "Radius")],
    make: |lengths| Shape::Sphere(Sphere { radius: lengths[0] }),
};

impl Form for Sphere {
    fn validate(&self) -> Result<(), ModelError> {
        length("the radius of a sphere", self.radius)
    }

    fn scaled(&self, factor: f64) -> Shape {
        Shape::Sphere(Self { radius: factor * self.radius })
    }

    fn volume(&self) -> f64 {
        4.0 / 3.0 * PI * self.radius.powi(3)
    }

    fn unit_inertia(&self) -> Mat3 {
        Mat3::from_diagonal(Vec3::splat(0.4 * self.radius * self.radius * self.volume()))
    }

    fn half_thickness(&self) -> f64 {
        self.radius
    }

    fn bounding_radius(&self) -> f64 {
        self.radius
    }

    fn reach(&self, direction: Vec3) -> f64 {
        self.radius * direction.length()
    }

    fn surface(&self) -> Option<Surface> {
        None
    }

    fn signed_distance(&self, c: Vec3) -> Distance {
        Distance::to_ball(c, Vec3::ZERO, self.radius)
    }

    fn lowest_points(&self, _down: Vec3, each: &mut dyn FnMut(Vec3, f64, u64)) {
        each(Vec3::ZERO, self.radius, 0);
    }

    fn half_axis(&self) -> Option<f64> {
        Some(0.0)
    }
}
