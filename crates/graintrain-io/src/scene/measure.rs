//! Measurements as a scene asks for them.

use super::error::{Location, SceneError, SceneErrorKind};
use super::file::region;
use super::names;
use super::reader::Reader;
use crate::measure::MOST_BINS;
use graintrain::load::Region;
use graintrain::math::Vec3;
use graintrain::measure::profile::Along;
use serde::Serialize;

fn no(flag: &bool) -> bool {
    !*flag
}

/// A measurement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeasureSpec {
    /// Names of single bodies; without these and packings all bodies that can move.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<String>,
    /// Names of packings.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub packings: Vec<String>,
    /// Names of streams.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub streams: Vec<String>,
    /// Where.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<Region>,
    /// Name of the stage; `None`: all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stage: Option<String>,
    /// s
    pub start: f64,
    /// s
    pub every: f64,
    /// The stress tensor.
    #[serde(skip_serializing_if = "no")]
    pub stress: bool,
    /// Coordination.
    #[serde(skip_serializing_if = "no")]
    pub coordination: bool,
    /// Bodies with fewer neighbours are rattlers.
    pub rattlers_below: u64,
    /// The fabric tensor.
    #[serde(skip_serializing_if = "no")]
    pub fabric: bool,
    /// Porosity.
    #[serde(skip_serializing_if = "no")]
    pub porosity: bool,
    /// Normal forces.
    #[serde(skip_serializing_if = "no")]
    pub forces: bool,
    /// The periodic cell.
    #[serde(skip_serializing_if = "no")]
    pub cell: bool,
    /// Energies.
    #[serde(skip_serializing_if = "no")]
    pub energy: bool,
    /// Centre of mass.
    #[serde(skip_serializing_if = "no")]
    pub motion: bool,
    /// Bodies that come and leave.
    #[serde(skip_serializing_if = "no")]
    pub exchange: bool,
    /// Force on bodies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force: Option<ForceSpec>,
    /// What passes a plane.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plane: Option<PlaneSpec>,
    /// Lacey's index.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mixing: Option<MixingSpec>,
    /// A shear box.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shear_box: Option<ShearBoxSpec>,
    /// A wheel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wheel: Option<WheelSpec>,
    /// The angle of a slope.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repose: Option<ReposeSpec>,
    /// Fields in bins.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile: Option<ProfileSpec>,
    /// Distribution of forces.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub histogram: Option<HistogramSpec>,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}

/// Force on bodies together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ForceSpec {
    /// Their names.
    pub bodies: Vec<String>,
    /// m
    pub point: Vec3,
}

/// A plane.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlaneSpec {
    /// m
    pub point: Vec3,
    /// Unit normal.
    pub normal: Vec3,
}

/// Lacey's index.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MixingSpec {
    /// Packings of the first kind.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub packings: Vec<String>,
    /// Streams of the first kind.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub streams: Vec<String>,
    /// m
    pub cell: f64,
}

/// A shear box.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ShearBoxSpec {
    /// The body that is moved.
    pub sheared: String,
    /// The body that presses.
    pub pressing: String,
    /// Unit direction.
    pub direction: Vec3,
    /// Unit direction.
    pub normal: Vec3,
    /// m^2
    pub area: f64,
    /// m
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plane: Option<Vec3>,
}

/// A wheel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WheelSpec {
    /// The body.
    pub body: String,
    /// m
    pub radius: f64,
    /// Unit vector along its axis.
    pub axis: Vec3,
}

/// The angle of a slope.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReposeSpec {
    /// x, y, z or radius.
    pub along: AlongSpec,
    /// m
    pub centre: Vec3,
    /// m
    pub width: f64,
}

/// Fields in bins.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProfileSpec {
    /// x, y, z or radius.
    pub along: AlongSpec,
    /// m
    pub centre: Vec3,
    /// m
    pub from: f64,
    /// m
    pub to: f64,
    /// Number of bins.
    pub bins: u64,
}

/// Distribution of forces.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HistogramSpec {
    /// Number of bins.
    pub bins: u64,
    /// Largest ratio to the mean.
    pub most: f64,
}

/// Along what bins lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum AlongSpec {
    /// x
    X,
    /// y
    Y,
    /// z
    Z,
    /// Distance from an upright line.
    Radius,
}

impl AlongSpec {
    pub(super) const NAMES: &[(&str, Self)] =
        &[("x", Self::X), ("y", Self::Y), ("z", Self::Z), ("radius", Self::Radius)];

    /// With the point that a radius counts from.
    pub fn from(self, centre: Vec3) -> Along {
        match self {
            Self::X => Along::Axis(0),
            Self::Y => Along::Axis(1),
            Self::Z => Along::Axis(2),
            Self::Radius => Along::Radius(centre),
        }
    }
}

/// Keys of which a measurement has at least one, those that stand alone first.
const QUANTITIES: &[&str] = &[
    "profile",
    "histogram",
    "stress",
    "coordination",
    "fabric",
    "porosity",
    "forces",
    "cell",
    "energy",
    "motion",
    "exchange",
    "force",
    "plane",
    "mixing",
    "shear_box",
    "wheel",
    "repose",
];

/// How many of these stand alone.
const ALONE: usize = 2;

/// What measurements may name.
pub(super) struct Names<'a> {
    pub bodies: &'a [&'a str],
    pub packings: &'a [&'a str],
    pub streams: &'a [&'a str],
    pub stages: &'a [&'a str],
}

/// Reads a measurement of a scene with this time step (s).
pub(super) fn read(reader: &Reader, step: f64, names: &Names<'_>) -> Result<MeasureSpec, SceneError> {
    let Names { bodies, packings, streams, stages } = *names;
    let given = |key: &&&str| -> Result<bool, SceneError> {
        match reader.get(key) {
            Some(node) if node.entries().is_none() => Ok(reader.flag(key)?.unwrap_or(false)),
            node => Ok(node.is_some()),
        }
    };
    let mut found = Vec::new();
    for key in QUANTITIES {
        if given(&key)? {
            found.push(*key);
        }
    }
    let one_of = |keys: &[&str], found: String| {
        let kind =
            SceneErrorKind::OneOf { table: format!("`{}`", reader.path), keys: keys.join(", "), found };
        SceneError::at(kind, reader.location())
    };
    if found.is_empty() {
        return Err(one_of(QUANTITIES, "none".into()));
    }
    if QUANTITIES[..ALONE].contains(&found[0]) && found.len() > 1 {
        let problem = format!(
            "`{}` has records of bins, so that it cannot share a table with `{}`: give it a measure of its own",
            found[0], found[1]
        );
        return Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
    }
    let chooses =
        ["bodies", "packings", "streams", "region"].into_iter().find(|key| reader.get(key).is_some());
    if let (true, Some(key)) = (found.contains(&"exchange"), chooses) {
        let problem = format!(
            "`exchange` counts all that comes and goes, whatever `{key}` chooses: give it a measure of its own, without `{key}`"
        );
        return Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
    }
    let flag = |key: &str| Ok::<bool, SceneError>(reader.flag(key)?.unwrap_or(false));
    let spec = MeasureSpec {
        bodies: names::list(reader, "bodies", "body", bodies)?,
        packings: names::list(reader, "packings", "packing", packings)?,
        streams: names::list(reader, "streams", "stream", streams)?,
        region: reader.child("region")?.as_ref().map(region).transpose()?,
        stage: match reader.text("stage")? {
            Some(name) if !stages.contains(&name.as_str()) => {
                return Err(reader.unknown_name("stage", "stage", &name, stages.iter().copied()));
            }
            stage => stage,
        },
        start: reader.quantity("start")?.unwrap_or(0.0),
        every: reader.quantity("every")?.unwrap_or(step),
        stress: flag("stress")?,
        coordination: flag("coordination")?,
        rattlers_below: reader.count("rattlers_below")?.unwrap_or(2),
        fabric: flag("fabric")?,
        porosity: flag("porosity")?,
        forces: flag("forces")?,
        cell: flag("cell")?,
        energy: flag("energy")?,
        motion: flag("motion")?,
        exchange: flag("exchange")?,
        force: match reader.child("force")? {
            None => None,
            Some(inner) => Some(ForceSpec {
                bodies: required_names(&inner, "bodies", "body", bodies)?,
                point: inner.vector("point")?.unwrap_or(Vec3::ZERO),
            }),
        },
        plane: match reader.child("plane")? {
            None => None,
            Some(inner) => Some(PlaneSpec {
                point: inner.vector("point")?.unwrap_or(Vec3::ZERO),
                normal: inner.direction("normal")?.unwrap_or(Vec3::Z),
            }),
        },
        mixing: match reader.child("mixing")? {
            None => None,
            Some(inner) if inner.get("packings").is_none() && inner.get("streams").is_none() => {
                return Err(inner.missing("packings"));
            }
            Some(inner) => Some(MixingSpec {
                packings: names::list(&inner, "packings", "packing", packings)?,
                streams: names::list(&inner, "streams", "stream", streams)?,
                cell: inner.required("cell")?,
            }),
        },
        shear_box: reader.child("shear_box")?.map(|inner| shear_box(&inner, bodies)).transpose()?,
        wheel: match reader.child("wheel")? {
            None => None,
            Some(inner) => Some(WheelSpec {
                body: body_of(&inner, "body", bodies)?,
                radius: inner.required("radius")?,
                axis: inner.direction("axis")?.unwrap_or(Vec3::Y),
            }),
        },
        repose: match reader.child("repose")? {
            None => None,
            Some(inner) => Some(ReposeSpec {
                along: inner.choice("along", AlongSpec::NAMES)?.unwrap_or(AlongSpec::Radius),
                centre: inner.vector("centre")?.unwrap_or(Vec3::ZERO),
                width: inner.required("width")?,
            }),
        },
        profile: reader.child("profile")?.map(|inner| profile(&inner)).transpose()?,
        histogram: match reader.child("histogram")? {
            None => None,
            Some(inner) => Some(HistogramSpec {
                bins: bins(&inner, Some(20))?,
                most: inner.quantity("most")?.unwrap_or(5.0),
            }),
        },
        location: reader.location().clone(),
    };
    Ok(spec)
}

fn required_names(reader: &Reader, key: &str, what: &str, known: &[&str]) -> Result<Vec<String>, SceneError> {
    let names = names::list(reader, key, what, known)?;
    if names.is_empty() { Err(reader.missing(key)) } else { Ok(names) }
}

/// The name of a body.
fn body_of(reader: &Reader, key: &str, bodies: &[&str]) -> Result<String, SceneError> {
    let name = reader.text(key)?.ok_or_else(|| reader.missing(key))?;
    match bodies.contains(&name.as_str()) {
        true => Ok(name),
        false => Err(reader.unknown_name(key, "body", &name, bodies.iter().copied())),
    }
}

fn shear_box(reader: &Reader, bodies: &[&str]) -> Result<ShearBoxSpec, SceneError> {
    Ok(ShearBoxSpec {
        sheared: body_of(reader, "sheared", bodies)?,
        pressing: body_of(reader, "pressing", bodies)?,
        direction: reader.direction("direction")?.unwrap_or(Vec3::X),
        normal: reader.direction("normal")?.unwrap_or(Vec3::Z),
        area: reader.required("area")?,
        plane: reader.vector("plane")?,
    })
}

fn profile(reader: &Reader) -> Result<ProfileSpec, SceneError> {
    let (from, to) = (reader.required("from")?, reader.required("to")?);
    if to <= from {
        return Err(reader.out_of_range("to", &format!("above from ({from} m)"), format!("{to} m")));
    }
    let along = reader.choice("along", AlongSpec::NAMES)?.unwrap_or(AlongSpec::Z);
    if along == AlongSpec::Radius && from < 0.0 {
        return Err(reader.out_of_range("from", "zero or positive along a radius", format!("{from} m")));
    }
    let centre = reader.vector("centre")?.unwrap_or(Vec3::ZERO);
    Ok(ProfileSpec { along, centre, from, to, bins: bins(reader, None)? })
}

fn bins(reader: &Reader, default: Option<u64>) -> Result<u64, SceneError> {
    match reader.count("bins")?.or(default) {
        None => Err(reader.missing("bins")),
        Some(count) if (1..=MOST_BINS as u64).contains(&count) => Ok(count),
        Some(count) => Err(reader.out_of_range("bins", &format!("from 1 to {MOST_BINS}"), count)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use std::path::Path;

    #[test]
    fn a_record_of_bins_fits_into_memory() {
        let read = |bins: usize| {
            let text = format!("[time]\nstep = 1\nsteps = 1\n[measure.m]\nhistogram = {{ bins = {bins} }}\n");
            Scene::parse("a", "a.toml", &text, Path::new(""), &[]).map_err(|error| error.to_string())
        };
        assert!(read(MOST_BINS).is_ok());
        assert!(read(MOST_BINS + 1).unwrap_err().contains("from 1 to 100000"));
    }
}
