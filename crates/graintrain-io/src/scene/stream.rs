//! Streams and outlets as a scene asks for them.

use super::error::{Location, SceneError, SceneErrorKind};
use super::file::grains;
use super::measure::PlaneSpec;
use super::model::{GrainSpec, PartSpec, SHAPE};
use super::names;
use super::radius::RADIUS;
use super::reader::Reader;
use super::region::{REGION, region};
use super::table::{Spec, table};
use graintrain::load::Region;
use serde::Serialize;

table! {
    pub(super) static STREAM: "`[stream.NAME]`",
        at most one of ["radius", "shape", "parts"],
        at most one of ["rate", "mass_rate"] {
        /// Bodies enter completely inside, at random positions without overlap; if there is none, the
        /// insertion is delayed
        region = Table(&REGION), "required",
            "{ cylinder = { base = [0, 0, 1], radius = 0.1, height = 0.1 } }";
        /// Radius of spheres: one value, or a distribution
        radius = QuantityOr(D::LENGTH, &RADIUS), "one of radius, shape, parts", "\"5 mm\"", Positive;
        /// Shape of the bodies
        shape = Table(&SHAPE), "one of radius, shape, parts", "{ box = { size = [0.01, 0.01, 0.02] } }";
        /// Several shapes in each body (clumps)
        parts = Tables(PartSpec::TABLE),
            "one of radius, shape, parts",
            "[{ shape = { sphere = { radius = 1 } } }, { shape = { sphere = { radius = 1 } }, position = [1, 0, 0] }]";
        /// Random orientations
        random_rotation = Flag, "false", "true";
        /// Material
        material = Text, "the only material", "\"glass\"";
        /// Initial velocity
        velocity = Vector(D::SPEED), "[0, 0, 0]", "[0, 0, \"-1 m/s\"]";
        /// Bodies keep their orientation
        lock_rotation = Flag, "false", "true";
        /// Bodies per second; delayed bodies enter later
        rate = Quantity(D::RATE), "as many as fit", "\"200/s\"", Positive;
        /// Mass per second, instead of `rate`
        mass_rate = Quantity(D::MASS_RATE), "as many as fit", "\"0.5 kg/s\"", Positive;
        /// Maximum number of bodies
        count = Count, "no limit", "500";
        /// Maximum total mass
        mass = Quantity(D::MASS), "no limit", "\"2 kg\"", Positive;
        /// When it begins; with `stage` relative to the beginning of that stage
        start = Quantity(D::TIME), "0", "\"0.1 s\"", NotNegative;
        /// When it ends, likewise
        end = Quantity(D::TIME), "no limit", "\"2 s\"", Positive;
        /// Active only in the stage of this name
        stage = Text, "all stages", "\"fill\"";
        /// Seed of this stream
        seed = Count, "seed of the scene + number of the stream + 1000", "7";
    }
}

/// A stream of bodies.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StreamSpec {
    /// Where bodies enter.
    pub region: Region,
    /// The bodies.
    #[serde(flatten)]
    pub grains: GrainSpec,
    /// Bodies per second.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<f64>,
    /// kg/s
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass_rate: Option<f64>,
    /// Bodies after which it ends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub count: Option<u64>,
    /// Mass that it does not go beyond, kg.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    /// s
    pub start: f64,
    /// s
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end: Option<f64>,
    /// Name of the stage; `None`: all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stage: Option<String>,
    /// Seed.
    pub seed: u64,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}

table! {
    pub(super) static OUTLET: "`[outlet.NAME]`", at most one of ["behind", "outside", "inside"] {
        /// Bodies of packings and streams leave when their centre of mass is on the side of the plane to
        /// which its normal points
        behind = Table(&BEHIND), "one of behind, outside, inside",
            "{ point = [0, 0, -0.1], normal = [0, 0, -1] }";
        /// They leave when it is outside the region
        outside = Table(&REGION), "one of behind, outside, inside",
            "{ box = { min = [-1, -1, -1], max = [1, 1, 1] } }";
        /// They leave when it is inside the region
        inside = Table(&REGION), "one of behind, outside, inside",
            "{ box = { min = [-1, -1, -1], max = [1, 1, 0] } }";
    }
}

table! {
    static BEHIND: "`outlet.NAME.behind`" {
        /// A point of the plane
        point = Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"-10 cm\"]";
        /// Its normal, of any length
        normal = Direction, "[0, 0, -1]", "[1, 0, 0]";
    }
}

/// A way out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OutletSpec {
    /// Where.
    #[serde(flatten)]
    pub exit: ExitSpec,
}

/// Where bodies leave.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ExitSpec {
    /// On the side of a plane to which its normal points.
    Behind(PlaneSpec),
    /// Outside of a region.
    Outside(Region),
    /// Inside of a region.
    Inside(Region),
}

/// Most bodies of a stream; more would not fit into memory.
const MOST_BODIES: u64 = 100_000_000;

/// Reads a stream of a scene.
pub(super) fn read(reader: &Reader, default_seed: u64) -> Result<StreamSpec, SceneError> {
    reader.check_alternatives()?;
    let spec = StreamSpec {
        region: reader.field("region")?,
        grains: grains(reader)?,
        rate: reader.quantity("rate")?,
        mass_rate: reader.quantity("mass_rate")?,
        count: reader.count("count")?,
        mass: reader.quantity("mass")?,
        start: reader.field("start")?,
        end: reader.quantity("end")?,
        stage: names::stage(reader, "stage")?,
        seed: reader.count("seed")?.unwrap_or(default_seed),
        location: reader.location().clone(),
    };
    let endless = spec.count.is_none() && spec.mass.is_none() && spec.end.is_none();
    if endless && spec.rate.is_none() && spec.mass_rate.is_none() {
        let problem = format!(
            "nothing ends `{}`, which has no rate either: give it `rate` or `mass_rate`, or `count`, `mass` or `end`",
            reader.path
        );
        return Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
    }
    if let Some(count) = spec.count.filter(|count| *count > MOST_BODIES) {
        return Err(reader.out_of_range("count", &format!("at most {MOST_BODIES}"), count));
    }
    if let Some(end) = spec.end.filter(|end| *end <= spec.start) {
        return Err(reader.out_of_range(
            "end",
            &format!("after start ({} s)", spec.start),
            format!("{end} s"),
        ));
    }
    Ok(spec)
}

/// Reads an outlet.
pub(super) fn read_outlet(reader: &Reader) -> Result<OutletSpec, SceneError> {
    let (form, inner) = reader.form()?;
    let exit = match form {
        "behind" => ExitSpec::Behind(PlaneSpec::read(&inner)?),
        "outside" => ExitSpec::Outside(region(&inner)?),
        _ => ExitSpec::Inside(region(&inner)?),
    };
    Ok(OutletSpec { exit })
}
