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
pub(super) use packing::SIZES;
pub use packing::{
    DropSpec, FileSpec, GrainSpec, LatticeSpec, PackingFormat, PackingSource, PackingSpec, PoissonSpec,
    RadiusDistribution, RadiusSpec,
};
pub(super) use shape::SHAPE;
pub use shape::{BoxSpec, HalfSpaceSpec, HullSpec, LengthsSpec, MeshSpec, ShapeSpec};

use super::error::SceneError;
use super::names;
use super::reader::Reader;
use super::table::{Choice, Field, Spec, table};
use crate::settings::Precision;
use graintrain::assemble::OverlapCorrection;
use graintrain::math::{Quat, Vec3};
use serde::{Serialize, Serializer};

table! {
    /// Time step and number of steps.
    #[derive(Default)]
    pub struct TimeSpec: "`[time]`", at most one of ["end", "steps"] {
        /// Time step
        step: f64 = Quantity(D::TIME), "required", "\"25 ms\"", Positive;
        /// Simulated time; rounded up to whole steps
        end = Quantity(D::TIME), "one of end, steps", "\"2 s\"", Positive;
        /// Number of steps
        steps: u64 = Count, "one of end, steps", "120", Positive => steps;
    }
}

/// Largest number of steps of a run.
const MOST_STEPS: f64 = 1e12;

/// The number of steps, by the end where the scene names that.
fn steps(reader: &Reader, key: &str) -> Result<u64, SceneError> {
    if reader.which()? == key {
        return reader.field(key);
    }
    let ratio = reader.field::<f64>("end")? / reader.field::<f64>("step")?;
    if ratio > MOST_STEPS {
        return Err(reader.out_of_range("end", "at most 1e12 steps", format!("{ratio:.3e} steps")));
    }
    // Whole steps up to round-off: 2 s in steps of 0.1 s are 20, not 21.
    Ok(((ratio * (1.0 - 1e-12)).ceil() as u64).max(1))
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

table! {
    /// A single body.
    pub struct BodySpec: "`[body.NAME]`",
        at most one of ["shape", "parts"],
        at most one of ["mass", "density"],
        checked by is_body {
        /// Shape
        shape = Table(&SHAPE), "one of shape, parts", "{ sphere = { radius = \"1 cm\" } }";
        /// Several shapes in one rigid body; overlapping volume counts once. `[]`: a body without contacts,
        /// with given mass and inertia
        parts: Vec<PartSpec> = Tables(PartSpec::TABLE), "one of shape, parts",
            "[{ shape = { plane = {} } }]" => parts;
        /// Material
        material: String = Text, "the only material", "\"glass\"" => names::material;
        /// Origin of the body's frame in the world
        position: Vec3 = Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"5 cm\"]";
        /// Rotation of the body's frame
        rotation: RotationSpec = Table(RotationTable::TABLE), "none", "{ axis = [0, 1, 0], angle = \"30 deg\" }";
        /// Initial velocity of the centre of mass (in a periodic cell relative to its deformation)
        velocity: Vec3 = Vector(D::SPEED), "[0, 0, 0]", "[\"1 m/s\", 0, 0]";
        /// Initial angular velocity
        angular_velocity: Vec3 = Vector(D::ANGULAR_SPEED), "[0, 0, 0]", "[0, 0, \"12 rpm\"]";
        /// Mass
        mass: Option<f64> = Quantity(D::MASS), "density x volume", "\"3 kg\"", Positive;
        /// Moments of inertia about the axes of the body's frame through its centre of mass (of a mesh: its
        /// origin); only with mass
        inertia: Option<Vec3> = Vector(D::new(2, 1, 0, 0)), "from mass and shape",
            "[0.2, 0.3, \"0.2 kg m^2\"]", Positive;
        /// Entries xy, xz, yz of the inertia tensor; only with inertia
        products: Option<Vec3> = Vector(D::new(2, 1, 0, 0)), "[0, 0, 0]", "[0, 0, \"0.01 kg m^2\"]";
        /// Centre of mass in the body's frame; only with inertia
        centre: Option<Vec3> = Vector(D::LENGTH), "that of the shapes", "[0, 0, \"2 cm\"]";
        /// Density of this body
        density: Option<f64> = Quantity(D::DENSITY), "the material's", "\"7800 kg/m^3\"", Positive;
        /// free, fixed, or a table of prescribed motions
        motion: MotionSpec = TextOr(MotionSpec::TABLE), "free; fixed for planes and meshes",
            "\"fixed\"" in MOTIONS => motion;
        /// Bodies defined above it with which it has no contacts. For the two bodies of a joint this is the
        /// default
        #[serde(skip_serializing_if = "Vec::is_empty")]
        ignores: Vec<String> = Texts, "[]", "[\"base\"]";
        location
    }
}

/// The form of a body: one part for a plain shape, none for a body that touches nothing.
fn parts(reader: &Reader, key: &str) -> Result<Vec<PartSpec>, SceneError> {
    if reader.which()? == key {
        return reader.field(key);
    }
    let rotation = RotationSpec(Quat::IDENTITY);
    Ok(vec![PartSpec { shape: reader.field("shape")?, position: Vec3::ZERO, rotation }])
}

/// The motion of a body; one without volume is fixed by default.
fn motion(reader: &Reader, _: &str) -> Result<MotionSpec, SceneError> {
    MotionSpec::of_body(reader, is_boundary(&parts(reader, "parts")?))
}

fn is_boundary(parts: &[PartSpec]) -> bool {
    parts.iter().any(|part| part.shape.is_boundary())
}

fn is_body(body: &BodySpec, reader: &Reader) -> Result<(), SceneError> {
    let BodySpec { parts, inertia, products, centre, motion, .. } = body;
    if inertia.is_some() && body.mass.is_none() {
        return Err(reader.missing("mass"));
    }
    if inertia.is_none() && (parts.is_empty() || products.or(*centre).is_some()) {
        return Err(reader.missing("inertia"));
    }
    if is_boundary(parts) && inertia.is_none() && motion.free != [false; 6] {
        return Err(reader.refuse(format!(
            "`{}` has no mass (planes, and meshes that are not `solid`, are boundaries): it cannot be free unless mass and inertia are given",
            reader.path
        )));
    }
    Ok(())
}

table! {
    /// A shape placed in a body's frame.
    pub struct PartSpec: "Part of a body, `parts`" {
        /// Shape
        shape: ShapeSpec = Table(&SHAPE), "required", "{ box = { size = [1, 1, 1] } }";
        /// Position in the body's frame
        position: Vec3 = Vector(D::LENGTH), "[0, 0, 0]", "[\"1 m\", 0, 0]";
        /// Rotation in the body's frame
        rotation: RotationSpec = Table(RotationTable::TABLE), "none", "{ axis = [0, 0, 1], angle = \"90 deg\" }";
    }
}

table! {
    /// A rotation, as a scene has it.
    pub(super) struct RotationTable: "`rotation`",
        at most one of ["angle", "quaternion"],
        at most one of ["axis", "quaternion"] {
        /// Axis; any length
        axis: Vec3 = Direction, "[0, 0, 1]", "[0, 1, 0]";
        /// Angle about it
        angle: f64 = Quantity(D::ANGLE), "0", "\"30 deg\"";
        /// The same as a quaternion x, y, z, w
        quaternion: Option<Vec<f64>> = List(D::NONE), "from axis and angle", "[0, 0, 0, 1]";
    }
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

/// Without the key there is none.
impl Field for RotationSpec {
    fn given(parent: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        let Some(reader) = parent.child(key)? else { return Ok(Some(Self(Quat::IDENTITY))) };
        let RotationTable { axis, angle, quaternion } = RotationTable::read(&reader)?;
        let Some(quaternion) = quaternion else {
            return Ok(Some(Self(Quat::from_axis_angle(axis, angle))));
        };
        let &[x, y, z, w] = quaternion.as_slice() else {
            return Err(reader.out_of_range("quaternion", "four numbers", quaternion.len()));
        };
        let quaternion = Quat::from_xyzw(x, y, z, w);
        let length = quaternion.length();
        if !(length.is_finite() && length > 0.0) {
            return Err(reader.out_of_range("quaternion", "of any length but zero", quaternion));
        }
        // A unit quaternion written by `to_toml` must come back unchanged.
        let is_unit = (length - 1.0).abs() < 1e-14;
        Ok(Some(Self(if is_unit { quaternion } else { quaternion / length })))
    }
}
