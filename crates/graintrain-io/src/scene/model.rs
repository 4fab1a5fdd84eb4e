//! A scene with every value resolved to SI units: what the reader makes, the builder uses and `to_toml`
//! writes. Each table that has a place of its own in a scene file has a module.

mod function;
mod load;
mod material;
mod motion;
mod packing;
mod shape;

pub use function::{FunctionFile, FunctionSpec};
pub use load::{CentralSpec, DragSpec, LoadSpec, PressureSpec};
pub use material::{MaterialSpec, PairRule, PairSpec};
pub(crate) use motion::MOTIONS;
pub use motion::{MotionSpec, SpinSpec, TranslationSpec};
pub use packing::{
    DropSpec, FileSpec, GrainSpec, LatticeSpec, PackingFormat, PackingSource, PackingSpec, PoissonSpec,
    RadiusDistribution, RadiusSpec,
};
pub use shape::{HullSpec, LengthsSpec, MeshSpec, ShapeSpec};

use super::error::Location;
use crate::settings::Precision;
use graintrain::assemble::OverlapCorrection;
use graintrain::math::{Quat, Vec3};
use serde::{Serialize, Serializer};

/// Time step and number of steps.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct TimeSpec {
    /// Time step, s.
    pub step: f64,
    /// Number of steps.
    pub steps: u64,
}

/// Contact detection and overlap; `None` until the builder knows the bodies.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ContactSpec {
    /// Contact envelope, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub envelope: Option<f64>,
    /// Overlap accepted at the start, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub allowed_overlap: Option<f64>,
    /// Whether bodies that overlap by more are moved apart before the run.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub relax: bool,
    /// What becomes of overlap.
    pub overlap: OverlapCorrection,
    /// Friction of pairs that are not named.
    pub friction_rule: PairRule,
    /// Restitution of pairs that are not named.
    pub restitution_rule: PairRule,
}

/// What a run writes, and when.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OutputSpec {
    /// Simulated time between frames, s.
    pub every: f64,
    /// Whether bodies are written.
    pub bodies: bool,
    /// Whether contacts are written.
    pub contacts: bool,
    /// Precision of frames.
    pub precision: Precision,
    /// Simulated time between checkpoints, s.
    pub checkpoint_every: f64,
}

/// A single body.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BodySpec {
    /// Its form: one part for a plain shape, none for a body that touches nothing.
    pub parts: Vec<PartSpec>,
    /// Name of its material.
    pub material: String,
    /// Origin of its frame, m.
    pub position: Vec3,
    /// Rotation of its frame.
    pub rotation: RotationSpec,
    /// Velocity of the centre of mass, m/s.
    pub velocity: Vec3,
    /// rad/s
    pub angular_velocity: Vec3,
    /// kg; `None` follows from density and volume.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    /// Moments of inertia about the axes of the body's frame, kg m^2; `None` follows from mass and shape.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inertia: Option<Vec3>,
    /// Entries xy, xz, yz of the tensor of inertia, kg m^2; with `inertia`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub products: Option<Vec3>,
    /// Centre of mass in the body's frame, m; `None`: that of its shapes. With `inertia`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub centre: Option<Vec3>,
    /// kg/m^3; `None` is the material's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density: Option<f64>,
    /// How it moves.
    pub motion: MotionSpec,
    /// Names of bodies above it that it passes through.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ignores: Vec<String>,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}

/// A shape placed in a body's frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartSpec {
    /// The shape.
    pub shape: ShapeSpec,
    /// m
    pub position: Vec3,
    /// Rotation in the body's frame.
    pub rotation: RotationSpec,
}

/// A rotation, written as a quaternion x, y, z, w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotationSpec(pub Quat);

impl Serialize for RotationSpec {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Form {
            quaternion: [f64; 4],
        }
        Form { quaternion: self.0.to_array() }.serialize(serializer)
    }
}
