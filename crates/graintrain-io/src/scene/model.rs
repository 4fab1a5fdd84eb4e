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

use super::error::{Location, SceneError};
use super::reader::Reader;
use super::table::{Choice, table};
use crate::settings::Precision;
use graintrain::assemble::OverlapCorrection;
use graintrain::math::{Quat, Vec3};
use serde::{Serialize, Serializer};

table! {
    pub(super) static TIME: "`[time]`", at most one of ["end", "steps"] {
        /// Time step
        step = Quantity(D::TIME), "required", "\"25 ms\"", Positive;
        /// Simulated time; rounded up to whole steps
        end = Quantity(D::TIME), "one of end, steps", "\"2 s\"", Positive;
        /// Number of steps
        steps = Count, "one of end, steps", "120", Positive;
    }
}

/// Time step and number of steps.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct TimeSpec {
    /// Time step, s.
    pub step: f64,
    /// Number of steps.
    pub steps: u64,
}

table! {
    /// Contact detection and overlap; `None` until the builder knows the bodies.
    pub struct ContactSpec: "`[contact]`" {
        /// Pairs closer than this become contacts
        envelope: Option<f64> = Quantity(D::LENGTH), "0.05 x the smallest radius", "\"3 cm\"", Positive;
        /// Largest initial overlap of rigid contacts
        allowed_overlap: Option<f64> = Quantity(D::LENGTH), "0.01 x the smallest radius",
            "\"0.1 mm\"", NotNegative;
        /// Larger initial overlap is removed by displacements before the run, instead of being an error: for
        /// packings of programs with soft contacts
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        relax: bool = Flag, "false", "true";
        /// How overlap is removed: position (by displacements, without kinetic energy) or velocity (bodies
        /// separate with the velocity -gap / step and keep it: the paper's scheme)
        overlap: OverlapCorrection = Text, "\"position\"", "\"velocity\"";
        /// Friction (sliding, rolling, spinning) of a pair without a `pair` table, from both materials:
        /// minimum, maximum, mean, geometric-mean
        friction_rule: PairRule = Text, "\"minimum\"", "\"geometric-mean\"";
        /// Restitution of such a pair
        restitution_rule: PairRule = Text, "\"minimum\"", "\"mean\"";
    }
}

table! {
    /// What a run writes, and when.
    pub struct OutputSpec: "`[output]`" {
        /// Simulated time between frames; rounded to whole steps
        every: f64 = Quantity(D::TIME), "end / 100, at least a step", "\"0.1 s\"", Positive => hundredth;
        /// Write the bodies of each frame
        bodies: bool = Flag, "true", "false";
        /// Write the contacts of each frame
        contacts: bool = Flag, "true", "false";
        /// Floating-point numbers of the frames: single (for pictures) or double
        precision: Precision = Text, "\"single\"", "\"double\"";
        /// Simulated time between checkpoints
        checkpoint_every: f64 = Quantity(D::TIME), "end / 10, at least a step", "\"1 s\"", Positive => tenth;
    }
}

impl Choice for OverlapCorrection {
    const NAMES: &'static [(&'static str, Self)] =
        &[("position", Self::Position), ("velocity", Self::Velocity)];
}

impl Choice for Precision {
    const NAMES: &'static [(&'static str, Self)] = &[("single", Self::Single), ("double", Self::Double)];
}

/// A hundredth of the run, s.
fn hundredth(reader: &Reader, key: &str) -> Result<f64, SceneError> {
    share(reader, key, 100)
}

/// A tenth of the run, s.
fn tenth(reader: &Reader, key: &str) -> Result<f64, SceneError> {
    share(reader, key, 10)
}

/// A share of the run in whole steps, s, unless the key says another time.
fn share(reader: &Reader, key: &str, parts: u64) -> Result<f64, SceneError> {
    let TimeSpec { step, steps } = reader.context.time;
    Ok(reader.quantity(key)?.unwrap_or((steps / parts).max(1) as f64 * step))
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
