//! Circular cones and frusta.

use super::frustum::{Frustum, of_frustum};
use super::library::Convex;
use super::{Corners, Distance, Form, Length, Lengths, Shape, Surface};
use crate::error::{ModelError, length, not_negative};
use crate::math::{Mat3, Vec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Circular cone about the z axis, its tip upwards, or a frustum where it has a top; the origin is its centre
/// of mass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cone {
    /// From the base to the tip or top, m.
    pub height: f64,
    /// Radius of the base, m.
    pub radius: f64,
    /// Radius of the top, m: zero for a cone with a tip.
    pub top_radius: f64,
}

pub(super) const LENGTHS: Lengths = Lengths {
    name: "cone",
    heading: "`shape.cone`",
    meaning: "Cone along z, tip upwards, or a frustum, about its centre of mass",
    example: "{ length = 2, radius = 1 }",
    lengths: &[
        Length::required("length", "\"4 cm\"", "Height"),
        Length::required("radius", "\"1 cm\"", "Radius of the base"),
        Length { name: "top_radius", meaning: "Radius of the top", example: "\"5 mm\"", is_required: false },
    ],
    make: |lengths| Shape::Cone(Cone { height: lengths[0], radius: lengths[1], top_radius: lengths[2] }),
};

impl Cone {
    /// Integrals over the radius squared rho^2 = ((1 - t) R + t r)^2 from t = 0 to 1: times 1, t and t^2.
    fn square_moments(&self) -> [f64; 3] {
        let (square, product, top_square) =
            (self.radius * self.radius, self.radius * self.top_radius, self.top_radius * self.top_radius);
        [
            (square + product + top_square) / 3.0,
            (square + 2.0 * product + 3.0 * top_square) / 12.0,
            (square + 3.0 * product + 6.0 * top_square) / 30.0,
        ]
    }

    fn frustum(&self) -> Frustum {
        let [sum, first, _] = self.square_moments();
        let centre = self.height * first / sum;
        Frustum::new([-centre, self.height - centre], [self.radius, self.top_radius])
    }
}

impl Form for Cone {
    fn validate(&self) -> Result<(), ModelError> {
        length("the height of a cone", self.height)?;
        length("the radius of a cone", self.radius)?;
        not_negative("the radius of a cone's top", self.top_radius)
    }

    fn scaled(&self, factor: f64) -> Shape {
        Shape::Cone(Self {
            height: factor * self.height,
            radius: factor * self.radius,
            top_radius: factor * self.top_radius,
        })
    }

    fn volume(&self) -> f64 {
        PI * self.height * self.square_moments()[0]
    }

    /// Discs of radius rho have pi rho^4 / 2 about the axis, half as much about a diameter.
    fn unit_inertia(&self) -> Mat3 {
        let (base, top) = (self.radius, self.top_radius);
        let fourth = (0..5).map(|k| base.powi(4 - k) * top.powi(k)).sum::<f64>() / 5.0;
        let along = 0.5 * PI * self.height * fourth;
        let [sum, first, second] = self.square_moments();
        let spread = PI * self.height.powi(3) * (second - first * first / sum);
        Mat3::from_diagonal(Vec3::new(0.5 * along + spread, 0.5 * along + spread, along))
    }

    fn half_thickness(&self) -> f64 {
        -self.signed_distance(Vec3::ZERO).value
    }

    of_frustum!();
}
