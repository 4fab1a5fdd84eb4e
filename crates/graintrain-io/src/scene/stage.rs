//! Stages as a scene asks for them.

use super::error::{Location, SceneError, SceneErrorKind};
use super::file::motion;
use super::model::{FunctionSpec, MotionSpec};
use super::reader::{Range, Reader};
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
        let ends = stage.time.is_some() || stage.kinetic_energy.is_some() || stage.unbalanced_force.is_some();
        if !ends && number < last {
            let problem = format!(
                "nothing ends the stage `{}`, so that the next one never begins: give it `time`, `kinetic_energy` or `unbalanced_force`",
                stage.name
            );
            return Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
        }
        stages.push(stage);
    }
    Ok(stages)
}

fn one(reader: &Reader, names: &Names<'_>) -> Result<StageSpec, SceneError> {
    let known = |key: &str, what: &str, name: &str, known: &[&str]| match known.contains(&name) {
        true => Ok(()),
        false => Err(reader.unknown_name(key, what, name, known.iter().copied())),
    };
    let materials = reader.named("material")?.into_iter().map(|(name, inner)| {
        known("material", "material", &name, names.materials)?;
        let friction = inner.quantity("friction", Range::NotNegative)?;
        let restitution = inner.quantity("restitution", Range::ZeroToOne)?;
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
        time: reader.quantity("time", Range::Positive)?,
        at_least: reader.quantity("at_least", Range::NotNegative)?.unwrap_or(0.0),
        kinetic_energy: reader.quantity("kinetic_energy", Range::Positive)?,
        unbalanced_force: reader.quantity("unbalanced_force", Range::Positive)?,
        loads,
        gravity: reader.functions("gravity")?,
        materials: materials.collect::<Result<_, SceneError>>()?,
        bodies: bodies.collect::<Result<_, SceneError>>()?,
        location: reader.location().clone(),
    })
}
