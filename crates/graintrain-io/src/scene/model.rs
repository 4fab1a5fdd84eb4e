//! A scene with every value resolved to SI units: what the reader makes, the builder uses and `to_toml` writes.

use super::error::Location;
use super::expression::formula_text;
use super::quantity::Dimension;
pub use crate::radii::RadiusDistribution;
use crate::settings::Precision;
use graintrain::assemble::OverlapCorrection;
use graintrain::load::Region;
use graintrain::material::TurningResistance;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::{Axes, Profile};
use serde::{Serialize, Serializer};
use std::path::PathBuf;

/// Time step and number of steps.
#[derive(Clone, Debug, PartialEq, Serialize)]
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

/// How a property of a pair follows from those of its two materials.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PairRule {
    /// The smaller.
    Minimum,
    /// The larger.
    Maximum,
    /// Their arithmetic mean.
    Mean,
    /// The root of their product.
    GeometricMean,
}

impl PairRule {
    pub(crate) const NAMES: &[(&str, Self)] = &[
        ("minimum", Self::Minimum),
        ("maximum", Self::Maximum),
        ("mean", Self::Mean),
        ("geometric-mean", Self::GeometricMean),
    ];

    /// The pair's property.
    pub fn combine(self, first: f64, second: f64) -> f64 {
        match self {
            Self::Minimum => first.min(second),
            Self::Maximum => first.max(second),
            Self::Mean => 0.5 * (first + second),
            Self::GeometricMean => (first * second).sqrt(),
        }
    }

    /// The pair's resistance to turning. `None` where one is a ratio and the other a length: neither says what the pair's is.
    pub fn combine_turning(
        self,
        first: TurningResistance,
        second: TurningResistance,
    ) -> Option<TurningResistance> {
        use TurningResistance::{Length, Ratio};
        match (first, second) {
            (Ratio(a), Ratio(b)) => Some(Ratio(self.combine(a, b))),
            (Length(a), Length(b)) => Some(Length(self.combine(a, b))),
            (Ratio(zero), Length(b)) | (Length(b), Ratio(zero)) if zero == 0.0 => {
                Some(Length(self.combine(b, zero)))
            }
            (Ratio(a), Length(zero)) | (Length(zero), Ratio(a)) if zero == 0.0 => {
                Some(Ratio(self.combine(a, zero)))
            }
            _ => None,
        }
    }
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

/// A material.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MaterialSpec {
    /// kg/m^3
    pub density: f64,
    /// With itself.
    pub friction: f64,
    /// With itself.
    pub restitution: f64,
    /// Resistance to rolling on itself.
    #[serde(skip_serializing_if = "TurningResistance::is_none", serialize_with = "as_written")]
    pub rolling_friction: TurningResistance,
    /// Resistance to spinning on itself.
    #[serde(skip_serializing_if = "TurningResistance::is_none", serialize_with = "as_written")]
    pub spinning_friction: TurningResistance,
    /// Of contacts with itself, N/m; zero: rigid.
    #[serde(skip_serializing_if = "is_zero")]
    pub stiffness: f64,
    /// Of contacts with itself, N s/m.
    #[serde(skip_serializing_if = "is_zero")]
    pub damping: f64,
    /// Pull on itself, N.
    #[serde(skip_serializing_if = "is_zero")]
    pub cohesion: f64,
}

/// Whether a number is left out where it is its own default.
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// A resistance to turning as scenes write it: a number, or a text with a length.
fn as_written<S: Serializer>(resistance: &TurningResistance, serializer: S) -> Result<S::Ok, S::Error> {
    match resistance {
        TurningResistance::Ratio(ratio) => serializer.serialize_f64(*ratio),
        TurningResistance::Length(length) => serializer.serialize_str(&format!("{length:e} m")),
    }
}

/// The same of a pair; left out where it follows the rule.
fn as_written_of_pair<S: Serializer>(
    resistance: &Option<TurningResistance>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    match resistance {
        Some(resistance) => as_written(resistance, serializer),
        None => serializer.serialize_none(),
    }
}

/// Properties of a pair of materials.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairSpec {
    /// Their names.
    pub materials: [String; 2],
    /// Coefficient of friction; `None` follows the rule.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Coefficient of restitution; `None` follows the rule.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
    /// Resistance to rolling on each other; `None` follows the rule of friction.
    #[serde(skip_serializing_if = "Option::is_none", serialize_with = "as_written_of_pair")]
    pub rolling_friction: Option<TurningResistance>,
    /// Resistance to spinning on each other; `None` follows the rule of friction.
    #[serde(skip_serializing_if = "Option::is_none", serialize_with = "as_written_of_pair")]
    pub spinning_friction: Option<TurningResistance>,
    /// Stiffness of contacts, N/m; `None` follows from both materials.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<f64>,
    /// Damping of contacts, N s/m; `None` follows from both materials.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub damping: Option<f64>,
    /// Pull on each other, N; `None` is the smaller of both.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cohesion: Option<f64>,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}

/// A single body.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BodySpec {
    /// Its form: one part for a plain shape.
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
    /// kg/m^3; `None` is the material's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density: Option<f64>,
    /// How it moves.
    pub motion: MotionSpec,
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

/// A shape. Lengths in m.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ShapeSpec {
    /// Ball.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// Box.
    Box {
        /// Edge lengths.
        size: Vec3,
    },
    /// Half-space.
    Plane {
        /// Outward unit normal.
        normal: Vec3,
    },
    /// Capsule along z.
    Capsule {
        /// Distance between the centres of the half balls.
        length: f64,
        /// Radius.
        radius: f64,
    },
    /// Cylinder along z.
    Cylinder {
        /// Height.
        length: f64,
        /// Radius.
        radius: f64,
    },
    /// Convex hull.
    Hull(HullSpec),
    /// Triangles.
    Mesh(MeshSpec),
}

/// Points of a convex hull, from a file of triangles or written in the scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HullSpec {
    /// The file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// The points, m, before scaling.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<Vec3>,
    /// Factor on all coordinates.
    pub scale: f64,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}

/// Triangles from a file or written in the scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshSpec {
    /// The file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// Corner points, m, before scaling.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub vertices: Vec<Vec3>,
    /// Vertex numbers.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub triangles: Vec<[u32; 3]>,
    /// Factor on all coordinates.
    pub scale: f64,
    /// Whether it bounds a solid with a mass.
    pub solid: bool,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}

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
    /// A point of the axis in the world, m; `None`: the axis goes through the origin of the body's frame and moves with it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub point: Option<Vec3>,
    /// Unit direction.
    pub axis: Vec3,
    /// rad/s
    pub speed: FunctionSpec,
}

/// A function of time.
#[derive(Clone, Debug, PartialEq)]
pub enum FunctionSpec {
    /// As it is.
    Profile(Profile),
    /// From a file.
    File {
        /// The file.
        file: FunctionFile,
    },
}

/// A file with times and values.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FunctionFile {
    /// The file.
    pub path: PathBuf,
    /// Column of the times.
    pub time: String,
    /// Column of the values.
    pub value: String,
    /// Dimension of the values.
    #[serde(skip)]
    pub dimension: Dimension,
    /// Where the path is written.
    #[serde(skip)]
    pub location: Location,
}

impl FunctionSpec {
    /// The same at all times.
    pub fn constant(value: f64) -> Self {
        Self::Profile(Profile::Constant(value))
    }
}

impl Serialize for FunctionSpec {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        #[serde(rename_all = "snake_case")]
        enum Form<'a> {
            Sinusoidal { amplitude: f64, period: f64, phase: f64 },
            Table { times: &'a [f64], values: &'a [f64] },
            File(&'a FunctionFile),
        }
        match self {
            Self::File { file } => Form::File(file).serialize(serializer),
            Self::Profile(Profile::Constant(value)) => serializer.serialize_f64(*value),
            Self::Profile(Profile::Formula(formula)) => serializer.serialize_str(&formula_text(formula)),
            Self::Profile(Profile::Sinusoidal { amplitude, period, phase }) => {
                Form::Sinusoidal { amplitude: *amplitude, period: *period, phase: *phase }
                    .serialize(serializer)
            }
            Self::Profile(Profile::Table { times, values }) => {
                Form::Table { times, values }.serialize(serializer)
            }
            // The scene delays whole motions, not functions: see `MotionSpec::start`.
            Self::Profile(Profile::Delayed { profile, .. }) => {
                Self::Profile((**profile).clone()).serialize(serializer)
            }
        }
    }
}

/// Forces, torques and fields on some bodies.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LoadSpec {
    /// Names of single bodies; without these and packings all bodies.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<String>,
    /// Names of packings.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub packings: Vec<String>,
    /// Where it acts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<Region>,
    /// N
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force: Option<[FunctionSpec; 3]>,
    /// Where the force acts in the body's frame, m; `None`: at the centre of mass.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub point: Option<Vec3>,
    /// N m
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque: Option<[FunctionSpec; 3]>,
    /// Axes of force and torque.
    pub axes: Axes,
    /// Stress on an area.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure: Option<PressureSpec>,
    /// Uniform field, m/s^2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceleration: Option<[FunctionSpec; 3]>,
    /// Central field.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub central: Option<CentralSpec>,
    /// Drag.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drag: Option<DragSpec>,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}

impl LoadSpec {
    /// What acts on what, for people.
    pub fn about(&self) -> String {
        let actions = [
            ("force", self.force.is_some()),
            ("torque", self.torque.is_some()),
            ("pressure", self.pressure.is_some()),
            ("acceleration", self.acceleration.is_some()),
            ("central field", self.central.is_some()),
            ("drag", self.drag.is_some()),
        ];
        let actions: Vec<&str> =
            actions.into_iter().filter(|(_, given)| *given).map(|(name, _)| name).collect();
        let names: Vec<&str> = self.bodies.iter().chain(&self.packings).map(String::as_str).collect();
        let on = if names.is_empty() { "all bodies".to_string() } else { names.join(", ") };
        let where_ = if self.region.is_some() { " in a region" } else { "" };
        format!("{} on {on}{where_}", actions.join(", "))
    }
}

/// A stress on an area.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PressureSpec {
    /// Pa
    pub stress: FunctionSpec,
    /// m^2
    pub area: f64,
    /// Unit direction of the force.
    pub direction: Vec3,
}

/// A central field.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CentralSpec {
    /// m
    pub point: Vec3,
    /// m/s^2
    pub strength: f64,
    /// m
    pub distance: f64,
    /// Exponent.
    pub power: f64,
}

/// Drag of a medium.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DragSpec {
    /// N s/m
    pub linear: f64,
    /// N s^2/m^2
    pub quadratic: f64,
    /// N m s
    pub angular: f64,
    /// m/s
    pub medium: Vec3,
}

/// Many bodies at once.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PackingSpec {
    /// Where they come from.
    #[serde(flatten)]
    pub source: PackingSource,
    /// Radius of the spheres; for a file, `None` is the file's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius: Option<RadiusSpec>,
    /// Shape, if not spheres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<ShapeSpec>,
    /// Several shapes in each body.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<PartSpec>,
    /// Whether bodies are turned at random.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub random_rotation: bool,
    /// Name of their material.
    pub material: String,
    /// Initial velocity, m/s.
    pub velocity: Vec3,
    /// Whether they keep their orientation.
    pub lock_rotation: bool,
    /// Seed.
    pub seed: u64,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}

/// Where the bodies of a packing come from.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PackingSource {
    /// Perturbed cubic lattice.
    Lattice(LatticeSpec),
    /// Random places.
    Drop(DropSpec),
    /// Places of a least distance.
    Poisson(PoissonSpec),
    /// A file.
    File(FileSpec),
}

/// Perturbed cubic lattice.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LatticeSpec {
    /// Bodies along x, y, z.
    pub counts: [u64; 3],
    /// Distance of neighbours, m.
    pub pitch: Vec3,
    /// Lower corner, m.
    pub origin: Vec3,
    /// Largest move of each coordinate, m.
    pub jitter: f64,
}

/// Random places.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DropSpec {
    /// Number of bodies.
    pub count: usize,
    /// Region.
    #[serde(flatten)]
    pub region: Region,
}

/// Places of a least distance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoissonSpec {
    /// Least distance of two centres, m.
    pub distance: f64,
    /// Region.
    #[serde(flatten)]
    pub region: Region,
}

/// A packing file and what to take from it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FileSpec {
    /// The file.
    pub path: PathBuf,
    /// Its form.
    pub format: PackingFormat,
    /// Frame of a file with several, from 0; `None`: the last.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<u64>,
    /// Lines left out at the end.
    pub skip_last: usize,
    /// Factor on all lengths.
    pub scale: f64,
    /// Added to all positions, m.
    pub offset: Vec3,
    /// Lower corner of what is kept, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keep_min: Option<Vec3>,
    /// Upper corner of what is kept, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keep_max: Option<Vec3>,
    /// Smallest radius kept, m.
    pub radius_min: f64,
    /// Largest radius kept, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius_max: Option<f64>,
    /// Where the path is written.
    #[serde(skip)]
    pub location: Location,
}

/// Form of a packing file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PackingFormat {
    /// VTU or VTP.
    Vtk,
    /// Comma-separated, with a header line.
    Csv,
    /// Separated by blanks, with a header line.
    Table,
    /// Text dumps of LAMMPS and LIGGGHTS.
    Lammps,
    /// Extended XYZ.
    Xyz,
    /// YADE's text.
    Yade,
    /// Data and restart files of MercuryDPM.
    Mercury,
}

impl PackingFormat {
    pub(crate) const NAMES: &[(&str, Self)] = &[
        ("vtk", Self::Vtk),
        ("csv", Self::Csv),
        ("table", Self::Table),
        ("lammps", Self::Lammps),
        ("xyz", Self::Xyz),
        ("yade", Self::Yade),
        ("mercury", Self::Mercury),
    ];
}

/// Radius of the spheres of a packing, m.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum RadiusSpec {
    /// The same for all.
    Single(f64),
    /// A distribution.
    #[serde(serialize_with = "radius_table")]
    Distribution(RadiusDistribution),
}

/// The table that a scene has for a distribution, with what its shares count beside it.
fn radius_table<S: serde::Serializer>(
    distribution: &RadiusDistribution,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct RadiusTable<'a> {
        #[serde(flatten)]
        distribution: &'a RadiusDistribution,
        #[serde(skip_serializing_if = "Option::is_none")]
        by: Option<&'static str>,
    }
    let table = match distribution {
        RadiusDistribution::ByMass(inner) => RadiusTable { distribution: inner, by: Some("mass") },
        by_number => RadiusTable { distribution: by_number, by: None },
    };
    table.serialize(serializer)
}

impl ShapeSpec {
    /// The file that the shape is read from, and where the scene names it.
    pub(crate) fn file_mut(&mut self) -> Option<(&mut PathBuf, &Location)> {
        match self {
            Self::Mesh(MeshSpec { file: Some(path), location, .. })
            | Self::Hull(HullSpec { file: Some(path), location, .. }) => Some((path, location)),
            _ => None,
        }
    }

    /// Whether the shape is a boundary without mass.
    pub fn is_boundary(&self) -> bool {
        matches!(self, Self::Plane { .. } | Self::Mesh(MeshSpec { solid: false, .. }))
    }
}

impl PackingSpec {
    /// Where the bodies come from, for people.
    pub fn kind(&self) -> String {
        match &self.source {
            PackingSource::Lattice(lattice) => {
                let [x, y, z] = lattice.counts;
                format!("lattice of {x} x {y} x {z}")
            }
            PackingSource::Drop(drop) => format!("{} at random places", drop.count),
            PackingSource::Poisson(poisson) => format!("at random places {} m apart", poisson.distance),
            PackingSource::File(file) => format!("from {}", file.path.display()),
        }
    }
}
