//! Stages as a scene asks for them.

use super::error::{Location, SceneError, SceneErrorKind};
use super::file::{motion, region};
use super::measure::MeasureSpec;
use super::model::{FunctionSpec, MotionSpec};
use super::names;
use super::periodic::{self, DriveSpec};
use super::reader::Reader;
use super::stream::StreamSpec;
use graintrain::load::Region;
use serde::Serialize;

/// A stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageSpec {
    /// Its name.
    pub name: String,
    /// Longest duration, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time: Option<f64>,
    /// Shortest duration, s.
    pub at_least: f64,
    /// J per body.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kinetic_energy: Option<f64>,
    /// Share of the mean contact force.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unbalanced_force: Option<f64>,
    /// Whether it ends when all streams have given all.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub filled: bool,
    /// A measured quantity that is steady.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steady: Option<SteadySpec>,
    /// Bodies that grow.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub growth: Option<GrowthSpec>,
    /// What drives the periodic cell.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub periodic: Option<DriveSpec>,
    /// Names of the loads that act.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub loads: Option<Vec<String>>,
    /// m/s^2
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gravity: Option<[FunctionSpec; 3]>,
    /// Changes of materials by name.
    #[serde(rename = "material", serialize_with = "super::in_order", skip_serializing_if = "Vec::is_empty")]
    pub materials: Vec<(String, StageMaterial)>,
    /// Changes of bodies by name.
    #[serde(rename = "body", serialize_with = "super::in_order", skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<(String, StageBody)>,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}

/// A measured quantity that is steady.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SteadySpec {
    /// Name of the measurement.
    pub measure: String,
    /// Column of its table.
    pub column: String,
    /// s
    pub over: f64,
    /// Relative to the mean.
    pub change: f64,
    /// In the unit of the column.
    pub within: f64,
}

/// Bodies that grow to a porosity.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GrowthSpec {
    /// Names of packings; without these and streams all bodies that can move.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub packings: Vec<String>,
    /// Names of streams.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub streams: Vec<String>,
    /// 1/s
    pub rate: f64,
    /// Porosity at which it ends.
    pub porosity: f64,
    /// Where porosity is taken.
    pub region: Region,
}

/// What changes of a material.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageMaterial {
    /// Coefficient of friction with itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Coefficient of restitution with itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
}

/// What changes of a body.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageBody {
    /// How it moves.
    pub motion: MotionSpec,
}

/// What stages may name.
pub(super) struct Names<'a> {
    pub materials: &'a [&'a str],
    pub bodies: &'a [&'a str],
    pub loads: &'a [&'a str],
    pub packings: &'a [&'a str],
    pub streams: &'a [&'a str],
    pub measures: &'a [&'a str],
}

/// Reads the stages of a scene.
pub(super) fn read(scene: &Reader, names: &Names<'_>) -> Result<Vec<StageSpec>, SceneError> {
    let tables = scene.tables("stage")?;
    let last = tables.len().saturating_sub(1);
    let mut stages: Vec<StageSpec> = Vec::new();
    for (number, reader) in tables.iter().enumerate() {
        let stage = one(reader, names)?;
        if stages.iter().any(|known| known.name == stage.name) {
            let problem = format!("there are two stages named `{}`", stage.name);
            return Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
        }
        let ends = stage.time.is_some()
            || stage.kinetic_energy.is_some()
            || stage.unbalanced_force.is_some()
            || stage.filled
            || stage.steady.is_some()
            || stage.growth.is_some();
        if stage.filled && names.streams.is_empty() {
            let problem =
                format!("the stage `{}` ends when streams have given all, but there are none", stage.name);
            return Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
        }
        if !ends && number < last {
            let problem = format!(
                "nothing ends the stage `{}`, so that the next one never begins: give it `time`, `kinetic_energy`, `unbalanced_force`, \
                 `filled`, `steady` or `growth`",
                stage.name
            );
            return Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
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

fn steady(reader: &Reader, names: &Names<'_>) -> Result<SteadySpec, SceneError> {
    let measure = reader.text("measure")?.ok_or_else(|| reader.missing("measure"))?;
    if !names.measures.contains(&measure.as_str()) {
        return Err(reader.unknown_name("measure", "measure", &measure, names.measures.iter().copied()));
    }
    Ok(SteadySpec {
        measure,
        column: reader.text("column")?.ok_or_else(|| reader.missing("column"))?,
        over: reader.required("over")?,
        change: reader.quantity("change")?.unwrap_or(0.01),
        within: reader.quantity("within")?.unwrap_or(0.0),
    })
}

fn growth(reader: &Reader, names: &Names<'_>) -> Result<GrowthSpec, SceneError> {
    let porosity = reader.required("porosity")?;
    if porosity >= 1.0 {
        return Err(reader.out_of_range("porosity", "between 0 and 1", porosity));
    }
    Ok(GrowthSpec {
        packings: names::list(reader, "packings", "packing", names.packings)?,
        streams: names::list(reader, "streams", "stream", names.streams)?,
        rate: reader.required("rate")?,
        porosity,
        region: region(&reader.required_child("region")?)?,
    })
}

fn one(reader: &Reader, names: &Names<'_>) -> Result<StageSpec, SceneError> {
    let known = |key: &str, what: &str, name: &str, known: &[&str]| match known.contains(&name) {
        true => Ok(()),
        false => Err(reader.unknown_name(key, what, name, known.iter().copied())),
    };
    let materials = reader.named("material")?.into_iter().map(|(name, inner)| {
        known("material", "material", &name, names.materials)?;
        let friction = inner.quantity("friction")?;
        let restitution = inner.quantity("restitution")?;
        Ok((name, StageMaterial { friction, restitution }))
    });
    let bodies = reader.named("body")?.into_iter().map(|(name, inner)| {
        known("body", "body", &name, names.bodies)?;
        if inner.get("motion").is_none() {
            return Err(inner.missing("motion"));
        }
        Ok((name, StageBody { motion: motion(&inner, false)? }))
    });
    let loads = reader.texts("loads")?;
    for name in loads.iter().flatten() {
        known("loads", "load", name, names.loads)?;
    }
    Ok(StageSpec {
        name: reader.text("name")?.ok_or_else(|| reader.missing("name"))?,
        time: reader.quantity("time")?,
        at_least: reader.quantity("at_least")?.unwrap_or(0.0),
        kinetic_energy: reader.quantity("kinetic_energy")?,
        unbalanced_force: reader.quantity("unbalanced_force")?,
        filled: reader.flag("filled")?.unwrap_or(false),
        steady: reader.child("steady")?.map(|inner| steady(&inner, names)).transpose()?,
        growth: reader.child("growth")?.map(|inner| growth(&inner, names)).transpose()?,
        periodic: reader.child("periodic")?.map(|inner| periodic::drive(&inner)).transpose()?,
        loads,
        gravity: reader.functions("gravity")?,
        materials: materials.collect::<Result<_, SceneError>>()?,
        bodies: bodies.collect::<Result<_, SceneError>>()?,
        location: reader.location().clone(),
    })
}
