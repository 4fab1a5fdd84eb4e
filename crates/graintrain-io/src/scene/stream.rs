//! Streams and outlets as a scene asks for them.

use super::error::{Location, SceneError, SceneErrorKind};
use super::file::grains;
use super::measure::PlaneSpec;
use super::model::GrainSpec;
use super::names;
use super::reader::Reader;
use super::region::region;
use graintrain::load::Region;
use graintrain::math::Vec3;
use serde::Serialize;

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
    reader.at_most_one_of(&["rate", "mass_rate"])?;
    let spec = StreamSpec {
        region: region(&reader.required_child("region")?)?,
        grains: grains(reader)?,
        rate: reader.quantity("rate")?,
        mass_rate: reader.quantity("mass_rate")?,
        count: reader.count("count")?,
        mass: reader.quantity("mass")?,
        start: reader.quantity("start")?.unwrap_or(0.0),
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
    let form = reader.one_of(&["behind", "outside", "inside"])?;
    let inner = reader.required_child(form)?;
    let exit = match form {
        "behind" => ExitSpec::Behind(PlaneSpec {
            point: inner.vector("point")?.unwrap_or(Vec3::ZERO),
            normal: inner.direction("normal")?.unwrap_or(Vec3::NEG_Z),
        }),
        "outside" => ExitSpec::Outside(region(&inner)?),
        _ => ExitSpec::Inside(region(&inner)?),
    };
    Ok(OutletSpec { exit })
}
