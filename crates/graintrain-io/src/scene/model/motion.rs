//! Prescribed motions.

use super::FunctionSpec;
use graintrain::math::Vec3;
use serde::{Serialize, Serializer};

/// How a body moves.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MotionSpec {
    /// Degrees of freedom that are dynamic, by name: x, y, z, rx, ry, rz.
    #[serde(serialize_with = "degree_names")]
    pub free: [bool; 6],
    /// When the prescribed motion begins, s; speeds count their time from there.
    pub start: f64,
    /// Prescribed translations: direction and speed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub translation: Vec<TranslationSpec>,
    /// Prescribed rotation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation: Option<SpinSpec>,
}

/// Names of the degrees of freedom, in the order of [`graintrain::motion::Motion::free`].
pub(crate) const DEGREES: [&str; 6] = ["x", "y", "z", "rx", "ry", "rz"];

fn degree_names<S: Serializer>(free: &[bool; 6], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(DEGREES.iter().zip(free).filter(|(_, free)| **free).map(|(name, _)| name))
}

impl MotionSpec {
    /// All degrees of freedom dynamic.
    pub const FREE: Self = Self { free: [true; 6], start: 0.0, translation: Vec::new(), rotation: None };
    /// At rest.
    pub const FIXED: Self = Self { free: [false; 6], start: 0.0, translation: Vec::new(), rotation: None };
}

/// A prescribed translation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TranslationSpec {
    /// Unit direction.
    pub direction: Vec3,
    /// m/s
    pub speed: FunctionSpec,
}

/// A prescribed rotation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpinSpec {
    /// A point of the axis in the world, m; `None`: the axis goes through the origin of the body's frame and
    /// moves with it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub point: Option<Vec3>,
    /// Unit direction.
    pub axis: Vec3,
    /// rad/s
    pub speed: FunctionSpec,
}
