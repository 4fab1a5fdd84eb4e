//! Stages as a scene asks for them.

use super::error::{SceneError, SceneErrorKind};
use super::measure::MeasureSpec;
use super::model::{FunctionSpec, MOTIONS, MotionSpec};
use super::names;
use super::periodic::DriveSpec;
use super::reader::Reader;
use super::region::RegionSpec;
use super::schema::{Table, in_order};
use super::stream::StreamSpec;
use super::table::{Spec, table};
use graintrain::load::Region;

table! {
    /// A stage.
    pub struct StageSpec: "`[[stage]]`", checked by check {
        /// Name
        name: String = Text, "required", "\"settle\"";
        /// Maximum duration of the stage
        time: Option<f64> = Quantity(D::TIME), "until `[time]` ends the run", "\"2 s\"", Positive;
        /// Minimum duration before the conditions below apply
        at_least: f64 = Quantity(D::TIME), "0", "\"50 ms\"", NotNegative;
        /// The stage ends when the kinetic energy per body that can move is below this
        kinetic_energy: Option<f64> = Quantity(D::ENERGY), "none", "\"1e-9 J\"", Positive;
        /// The stage ends when the mean net force on bodies is below this fraction of the mean contact force.
        /// With few contacts this is true at once: give `at_least`
        unbalanced_force: Option<f64> = Quantity(D::NONE), "none", "0.01", Positive;
        /// The stage ends when all streams active in it have inserted all their bodies
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        filled: bool = Flag, "false", "true";
        /// The stage ends when a measured quantity is steady
        steady: Option<SteadySpec> = Table(SteadySpec::TABLE), "none",
            "{ measure = \"cell\", column = \"tau_over_sigma\", over = \"0.5 s\" }";
        /// Bodies grow; the stage ends when the porosity is reached
        growth: Option<GrowthSpec> = Table(GrowthSpec::TABLE),
            "none",
            "{ packings = [\"sand\"], rate = 0.2, porosity = 0.4, region = { box = { min = [0, 0, 0], max = [1, 1, 1] } } }";
        /// Rates and stresses of the periodic cell from this stage on; other components have rate zero. `t`
        /// is the time since the stage began
        periodic: Option<DriveSpec> = Table(DriveSpec::TABLE), "unchanged",
            "{ pressure = \"10 kPa\", rate = { xy = \"0.1/s\" } }";
        /// The loads that act from this stage on; all others are off
        loads: Option<Vec<String>> = Texts, "unchanged", "[\"press\"]" => names::loads;
        /// Gravity from this stage on
        gravity: Option<[FunctionSpec; 3]> = Functions(D::ACCELERATION, &ACCELERATION), "unchanged",
            "[0, 0, 0]";
        /// Properties of materials from this stage on; values of `pair` tables do not change
        #[serde(serialize_with = "super::in_order", skip_serializing_if = "Vec::is_empty")]
        material: Vec<(String, StageMaterial)> = Named(StageMaterial::TABLE), "unchanged",
            "{ glass = { friction = 0 } }";
        /// Motions of bodies from this stage on
        #[serde(serialize_with = "super::in_order", skip_serializing_if = "Vec::is_empty")]
        body: Vec<(String, StageBody)> = Named(StageBody::TABLE), "unchanged",
            "{ lower = { motion = \"fixed\" } }";
        location
    }
}

/// The keys of a stage as the documentation has them: what is changed before what acts.
pub(super) static STAGE: Table = Table {
    keys: &in_order(StageSpec::TABLE.keys, [0, 1, 2, 3, 4, 5, 6, 7, 10, 11, 12, 8, 9]),
    ..*StageSpec::TABLE
};

table! {
    /// A measured quantity that is steady.
    pub struct SteadySpec: "`stage.steady`" {
        /// Name of the measurement, one without bins
        measure: String = Text, "required", "\"cell\"" => names::measure;
        /// Column of its table
        column: String = Text, "required", "\"tau_over_sigma\"";
        /// Time span of the latest records, divided into two halves; at least four records
        over: f64 = Quantity(D::TIME), "required", "\"0.5 s\"", Positive;
        /// Steady if the means of both halves differ by at most this fraction of the mean
        change: f64 = Quantity(D::NONE), "0.01", "0.02", NotNegative;
        /// Or by at most this value, in the unit of the column (SI)
        within: f64 = Quantity(D::NONE), "0", "1e-3", NotNegative;
    }
}

table! {
    /// Bodies that grow to a porosity.
    pub struct GrowthSpec: "`stage.growth`", checked by is_porosity {
        /// Packings that grow
        #[serde(skip_serializing_if = "Vec::is_empty")]
        packings: Vec<String> = Texts, "all, or those of streams", "[\"sand\"]" => names::packings;
        /// Streams whose bodies grow
        #[serde(skip_serializing_if = "Vec::is_empty")]
        streams: Vec<String> = Texts, "all, or those of packings", "[\"rain\"]" => names::streams;
        /// Relative growth rate of all lengths; growth pauses while bodies overlap by more than 1 % of their
        /// size
        rate: f64 = Quantity(D::RATE), "required", "\"0.2/s\"", Positive;
        /// Porosity at which growth and the stage end
        porosity: f64 = Quantity(D::NONE), "required", "0.4", Positive;
        /// Region in which the porosity is measured
        region: Region = Table(RegionSpec::TABLE), "required", "{ box = { min = [0, 0, 0], max = [1, 1, 1] } }";
    }
}

table! {
    /// What changes of a material.
    pub struct StageMaterial: "`stage.material.NAME`" {
        /// Coefficient of friction with itself
        friction: Option<f64> = Quantity(D::NONE), "unchanged", "0.5", NotNegative;
        /// Coefficient of restitution with itself, 0 to 1
        restitution: Option<f64> = Quantity(D::NONE), "unchanged", "0", ZeroToOne;
    }
}

table! {
    /// What changes of a body.
    pub struct StageBody: "`stage.body.NAME`" {
        /// free, fixed, or a table as for bodies; `t` is the time since the stage began
        motion: MotionSpec = TextOr(MotionSpec::TABLE), "required",
            "{ translation = [{ direction = [1, 0, 0], speed = 0.1 }] }" in MOTIONS => prescribed;
    }
}

/// Reads the stages of a scene.
pub(super) fn read(scene: &Reader) -> Result<Vec<StageSpec>, SceneError> {
    let tables = scene.tables("stage")?;
    let last = tables.len().saturating_sub(1);
    let mut stages: Vec<StageSpec> = Vec::new();
    for (number, reader) in tables.iter().enumerate() {
        let stage = StageSpec::read(reader)?;
        if stages.iter().any(|known| known.name == stage.name) {
            return Err(reader.refuse(format!("there are two stages named `{}`", stage.name)));
        }
        let ends = stage.time.is_some()
            || stage.kinetic_energy.is_some()
            || stage.unbalanced_force.is_some()
            || stage.filled
            || stage.steady.is_some()
            || stage.growth.is_some();
        if stage.filled && scene.context.names.streams.is_empty() {
            let problem =
                format!("the stage `{}` ends when streams have given all, but there are none", stage.name);
            return Err(reader.refuse(problem));
        }
        if !ends && number < last {
            return Err(reader.refuse(format!(
                "nothing ends the stage `{}`, so that the next one never begins: give it `time`, `kinetic_energy`, `unbalanced_force`, \
                 `filled`, `steady` or `growth`",
                stage.name
            )));
        }
        stages.push(stage);
    }
    Ok(stages)
}

/// Refuses stages whose end can never come, now that streams and measures are known.
pub(super) fn check_ends(
    stages: &[StageSpec],
    streams: &[(String, StreamSpec)],
    measures: &[(String, MeasureSpec)],
) -> Result<(), SceneError> {
    for stage in stages {
        let fail =
            |problem: String| Err(SceneError::at(SceneErrorKind::Contradiction(problem), &stage.location));
        let name = &stage.name;
        if let Some(time) = stage.time.filter(|time| stage.at_least > *time) {
            return fail(format!(
                "the stage `{name}` lasts at least {} s but ends after `time` = {time} s",
                stage.at_least
            ));
        }
        let flows = |stream: &&(String, StreamSpec)| stream.1.stage.as_ref().is_none_or(|only| only == name);
        if stage.filled {
            if !streams.iter().any(|stream| flows(&stream)) {
                return fail(format!(
                    "the stage `{name}` ends when it is `filled`, but no stream flows in it"
                ));
            }
            let endless = |stream: &&(String, StreamSpec)| {
                stream.1.count.is_none() && stream.1.mass.is_none() && stream.1.end.is_none()
            };
            if let Some((stream, _)) = streams.iter().filter(flows).find(endless) {
                return fail(format!(
                    "the stage `{name}` ends when it is `filled`, but the stream `{stream}` never ends: give it `count`, `mass` or `end`"
                ));
            }
        }
        let looked_at =
            stage.steady.as_ref().and_then(|steady| measures.iter().find(|(own, _)| *own == steady.measure));
        if let Some((measure, MeasureSpec { stage: Some(only), .. })) = looked_at
            && only != name
        {
            return fail(format!(
                "the stage `{name}` waits for the measure `{measure}` to be steady, which has records in the stage `{only}` alone"
            ));
        }
    }
    Ok(())
}

/// Refuses changes of what is not there.
fn check(stage: &StageSpec, reader: &Reader) -> Result<(), SceneError> {
    let known = &reader.context.names;
    let (materials, bodies) = (&stage.material, &stage.body);
    materials
        .iter()
        .try_for_each(|(name, _)| names::check(reader, "material", "material", name, &known.materials))?;
    bodies.iter().try_for_each(|(name, _)| names::check(reader, "body", "body", name, &known.bodies))
}

fn is_porosity(growth: &GrowthSpec, reader: &Reader) -> Result<(), SceneError> {
    match growth.porosity {
        below if below < 1.0 => Ok(()),
        other => Err(reader.out_of_range("porosity", "between 0 and 1", other)),
    }
}

/// The motion of a body, which has to be given.
fn prescribed(body: &Reader, key: &str) -> Result<MotionSpec, SceneError> {
    if body.get(key).is_none() { Err(body.missing(key)) } else { MotionSpec::of_body(body, false) }
}
