//! Half-spaces.

use super::{Distance, Form, Shape, Surface};
use crate::error::ModelError;
use crate::math::{Mat3, Vec3};
use serde::{Deserialize, Serialize};

/// Half-space z <= 0; the outward normal is +z. A boundary: it has no mass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HalfSpace;

impl Form for HalfSpace {
    fn validate(&self) -> Result<(), ModelError> {
        Ok(())
    }

    fn scaled(&self, _factor: f64) -> Shape {
        Shape::Plane(Self)
    }

    fn volume(&self) -> f64 {
        0.0
    }

    fn unit_inertia(&self) -> Mat3 {
        Mat3::ZERO
    }

    fn half_thickness(&self) -> f64 {
        f64::INFINITY
    }

    fn inscribed_radius(&self) -> f64 {
        0.0
    }

    fn inscribed_half_axes(&self) -> Option<Vec3> {
        None
    }

    fn bounding_radius(&self) -> f64 {
        f64::INFINITY
    }

    fn reach(&self, _direction: Vec3) -> f64 {
        f64::INFINITY
    }

    fn surface(&self) -> Option<Surface> {
        None
    }

    fn signed_distance(&self, c: Vec3) -> Distance {
        Distance { value: c.z, normal: Vec3::Z }
    }
}
