//! Capsules.

use super::{Cylinder, Distance, Form, Length, Lengths, Shape, Sphere, Surface, at_plane};
use crate::error::{ModelError, length};
use crate::math::{Mat3, Vec3};
use graintrain_linalg::real;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI};

/// Segments from the pole to the equator of a cap that is drawn.
const CAP_SEGMENTS: u32 = 6;

/// Points within `radius` of the segment from (0, 0, -half_length) to (0, 0, half_length).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Capsule {
    /// Half length of the segment, m.
    pub half_length: f64,
    /// Radius, m.
    pub radius: f64,
}

pub(super) const LENGTHS: Lengths = Lengths {
    name: "capsule",
    heading: "`shape.capsule`",
    meaning: "Cylinder with hemispherical caps, along z",
    example: "{ length = 2, radius = 1 }",
    lengths: &[
        Length::required("length", "\"4 cm\"", "Distance between the centres of the hemispherical caps"),
        Length::required("radius", "\"1 cm\"", "Radius"),
    ],
    make: |lengths| Shape::Capsule(Capsule { half_length: 0.5 * lengths[0], radius: lengths[1] }),
};

impl Form for Capsule {
    fn validate(&self) -> Result<(), ModelError> {
        length("the half length of a capsule", self.half_length)?;
        length("the radius of a capsule", self.radius)
    }

    fn scaled(&self, factor: f64) -> Shape {
        Shape::Capsule(Self { half_length: factor * self.half_length, radius: factor * self.radius })
    }

    fn volume(&self) -> f64 {
        PI * self.radius * self.radius * (2.0 * self.half_length + 4.0 / 3.0 * self.radius)
    }

    fn unit_inertia(&self) -> Mat3 {
        let Self { half_length, radius } = *self;
        let (cylinder, ball) = (Cylinder { half_length, radius }, Sphere { radius });
        // Each half ball's own centre of mass lies 3/8 radius beyond the end of the segment.
        let shift = half_length * half_length + 0.75 * half_length * radius;
        let beyond = ball.volume() * Vec3::new(shift, shift, 0.0);
        cylinder.unit_inertia() + ball.unit_inertia() + Mat3::from_diagonal(beyond)
    }

    fn half_thickness(&self) -> f64 {
        self.radius
    }

    fn inscribed_half_axes(&self) -> Option<Vec3> {
        Some(Vec3::new(self.radius, self.radius, self.half_length + self.radius))
    }

    fn bounding_radius(&self) -> f64 {
        self.half_length + self.radius
    }

    fn reach(&self, direction: Vec3) -> f64 {
        self.radius * direction.length() + self.half_length * direction.z.abs()
    }

    fn surface(&self) -> Option<Surface> {
        let cap = |k: u32| {
            let (sin, cos) = real::sin_cos(FRAC_PI_2 * f64::from(k) / f64::from(CAP_SEGMENTS));
            (self.radius * sin, self.half_length + self.radius * cos)
        };
        let mut profile: Vec<(f64, f64)> =
            (0..=CAP_SEGMENTS).map(cap).map(|(distance, height)| (distance, -height)).collect();
        profile.extend((0..=CAP_SEGMENTS).rev().map(cap));
        Some(Surface::of_revolution(&profile))
    }

    fn signed_distance(&self, c: Vec3) -> Distance {
        let nearest = Vec3::new(0.0, 0.0, c.z.clamp(-self.half_length, self.half_length));
        Distance::to_ball(c, nearest, self.radius)
    }

    /// The end planes of its segment.
    fn crossings(&self, centre: Vec3, half_axis: Vec3) -> Vec<f64> {
        [-1.0, 1.0].map(|end| at_plane(end * self.half_length, centre.z, half_axis.z)).to_vec()
    }

    fn lowest_points(&self, _down: Vec3, each: &mut dyn FnMut(Vec3, f64, u64)) {
        for (end, feature) in [(-self.half_length, 0), (self.half_length, 1)] {
            each(end * Vec3::Z, self.radius, feature);
        }
    }

    fn is_of_revolution(&self) -> bool {
        true
    }

    fn half_axis(&self) -> Option<f64> {
        Some(self.half_length)
    }

    fn foremost_around(&self, point: Vec3, normal: Vec3) -> Option<Vec3> {
        Some(point.z.clamp(-self.half_length, self.half_length) * Vec3::Z - self.radius * normal)
    }
}
