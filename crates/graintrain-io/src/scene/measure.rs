//! Measurements as a scene asks for them.

use super::error::{SceneError, SceneErrorKind};
use super::names;
use super::reader::Reader;
use super::region::RegionSpec;
use super::schema::{Table, in_order};
use super::table::{Choice, Spec, table};
use crate::measure::MOST_BINS;
use graintrain::load::Region;
use graintrain::math::Vec3;
use graintrain::measure::profile::Along;
use serde::Serialize;

table! {
    /// A measurement.
    pub struct MeasureSpec: "`[measure.NAME]`" {
        /// Bodies by name
        #[serde(skip_serializing_if = "Vec::is_empty")]
        bodies: Vec<String> = Texts, "all that can move, or those of packings",
            "[\"wheel\"]" => names::bodies;
        /// All bodies of packings by name
        #[serde(skip_serializing_if = "Vec::is_empty")]
        packings: Vec<String> = Texts, "all that can move, or those of bodies",
            "[\"grains\"]" => names::packings;
        /// All bodies of streams by name
        #[serde(skip_serializing_if = "Vec::is_empty")]
        streams: Vec<String> = Texts, "all that can move, or those of bodies and packings",
            "[\"rain\"]" => names::streams;
        /// Only bodies whose centre of mass is inside; the volume of stress, porosity and profiles (otherwise
        /// the box around the bodies)
        region: Option<Region> = Table(RegionSpec::TABLE), "everywhere",
            "{ box = { min = [0, 0, 0], max = [1, 1, 1] } }";
        /// Records only in the stage of this name
        stage: Option<String> = Text, "all stages", "\"shear\"" => names::stage;
        /// Time of the first record; crossings of planes are counted from then on
        start: f64 = Quantity(D::TIME), "0", "\"2 s\"", NotNegative;
        /// Time between records; rounded to whole steps
        every: f64 = Quantity(D::TIME), "the time step", "\"10 ms\"", Positive => every;
        /// Stress tensor by contacts, compression positive; pressure, deviator, kinetic pressure
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        stress: bool = Flag, "false", "true";
        /// Coordination number with and without rattlers, sliding fraction, hyperstaticity
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        coordination: bool = Flag, "false", "true";
        /// Bodies with fewer neighbours in loaded contact, without rattlers, are rattlers; use 4 without
        /// friction
        rattlers_below: u64 = Count, "2", "4";
        /// Fabric tensor of the loaded contacts, and its anisotropy
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        fabric: bool = Flag, "false", "true";
        /// Porosity and solid fraction
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        porosity: bool = Flag, "false", "true";
        /// Mean, standard deviation and maximum of normal forces
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        forces: bool = Flag, "false", "true";
        /// Edges, offsets, strain and rate of the periodic cell
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        cell: bool = Flag, "false", "true";
        /// Energies; work and losses of the whole world since the beginning
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        energy: bool = Flag, "false", "true";
        /// Mass, centre of mass and its velocity
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        motion: bool = Flag, "false", "true";
        /// Sum of contact forces and torques on some bodies, also walls; with a region only of contacts in it
        force: Option<ForceSpec> = Table(ForceSpec::TABLE), "none", "{ bodies = [\"floor\"] }";
        /// Mass and bodies that cross a plane (with a region only inside it), and the force through it
        plane: Option<PlaneSpec> = Table(PlaneSpec::TABLE), "none",
            "{ point = [0, 0, 0], normal = [0, 0, -1] }";
        /// Bodies, mass and kinetic energy that entered through all streams (and by growth) and left through
        /// all outlets
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        exchange: bool = Flag, "false", "true";
        /// Lacey's mixing index
        mixing: Option<MixingSpec> = Table(MixingSpec::TABLE), "none",
            "{ packings = [\"red\"], cell = \"3 cm\" }";
        /// Shear and normal stress, their ratio, displacement and dilation of a shear box
        shear_box: Option<ShearBoxSpec> = Table(ShearBoxSpec::TABLE), "none",
            "{ sheared = \"lower\", pressing = \"press\", area = 0.04 }";
        /// Slip, sinkage, drawbar pull, load and torque of a wheel; the selected bodies are the soil bed
        wheel: Option<WheelSpec> = Table(WheelSpec::TABLE), "none",
            "{ body = \"wheel\", radius = \"10 cm\" }";
        /// Angle of repose of a heap
        repose: Option<ReposeSpec> = Table(ReposeSpec::TABLE), "none",
            "{ along = \"radius\", width = \"1 cm\" }";
        /// Density, velocity and temperature in bins; the only key of its table, a record per bin
        profile: Option<ProfileSpec> = Table(ProfileSpec::TABLE), "none",
            "{ along = \"z\", from = 0, to = \"20 cm\", bins = 20 }";
        /// Distribution of normal forces over their mean; the only key of its table, a record per bin
        histogram: Option<HistogramSpec> = Table(HistogramSpec::TABLE), "none", "{ bins = 20, most = 5 }";
        location
    }
}

/// The keys of a measurement as the documentation has them: `start` before `stage`.
pub(super) static MEASURE: Table = Table {
    keys: &in_order(
        MeasureSpec::TABLE.keys,
        [0, 1, 2, 3, 5, 4, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24],
    ),
    ..*MeasureSpec::TABLE
};

table! {
    /// Force on bodies together.
    pub struct ForceSpec: "`measure.force`" {
        /// Bodies by name
        bodies: Vec<String> = Texts, "required", "[\"floor\", \"wall\"]" => some_bodies;
        /// Reference point of the torque, in the world
        point: Vec3 = Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, 1]";
    }
}

table! {
    /// A plane.
    pub struct PlaneSpec: "`measure.plane`" {
        /// A point of the plane
        point: Vec3 = Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"5 cm\"]";
        /// Positive direction; any length
        normal: Vec3 = Direction, "[0, 0, 1]", "[0, 0, -1]";
    }
}

table! {
    /// Lacey's index.
    pub struct MixingSpec: "`measure.mixing`", checked by is_chosen {
        /// Packings of the first kind; all other selected bodies are the second
        #[serde(skip_serializing_if = "Vec::is_empty")]
        packings: Vec<String> = Texts, "one of packings, streams", "[\"red\"]" => names::packings;
        /// Streams of the first kind
        #[serde(skip_serializing_if = "Vec::is_empty")]
        streams: Vec<String> = Texts, "one of packings, streams", "[\"rain\"]" => names::streams;
        /// Edge of the cells: a few bodies wide
        cell: f64 = Quantity(D::LENGTH), "required", "\"3 cm\"", Positive;
    }
}

table! {
    /// A shear box.
    pub struct ShearBoxSpec: "`measure.shear_box`" {
        /// The sheared body
        sheared: String = Text, "required", "\"lower\"" => names::body;
        /// The pressing body
        pressing: String = Text, "required", "\"press\"" => names::body;
        /// Direction of shear; any length
        direction: Vec3 = Direction, "[1, 0, 0]", "[0, 1, 0]";
        /// From the sample to the pressing body; any length
        normal: Vec3 = Direction, "[0, 0, 1]", "[0, 0, 1]";
        /// Area of the sample
        area: f64 = Quantity(D::AREA), "required", "\"0.12 m * 0.12 m\"", Positive;
        /// A point of the plane between the halves: stresses there from contacts of grains only, without
        /// walls, and with the weight above
        plane: Option<Vec3> = Vector(D::LENGTH), "none", "[0, 0, \"3 cm\"]";
    }
}

table! {
    /// A wheel.
    pub struct WheelSpec: "`measure.wheel`" {
        /// The wheel; its centre of mass is on its axis
        body: String = Text, "required", "\"wheel\"" => names::body;
        /// Radius for slip and sinkage
        radius: f64 = Quantity(D::LENGTH), "required", "\"10 cm\"", Positive;
        /// Axle; positive rotation rolls forward, in the direction axis x up; any length
        axis: Vec3 = Direction, "[0, 1, 0]", "[0, 1, 0]";
    }
}

table! {
    /// The angle of a slope.
    pub struct ReposeSpec: "`measure.repose`" {
        /// Direction in which the surface descends: x, y, z or radius
        along: AlongSpec = Text, "\"radius\"", "\"x\"";
        /// Point of the vertical axis of the radius
        centre: Vec3 = Vector(D::LENGTH), "[0, 0, 0]", "[\"5 cm\", 0, 0]";
        /// Width of the columns whose tops define the surface: one or two diameters
        width: f64 = Quantity(D::LENGTH), "required", "\"1 cm\"", Positive;
    }
}

table! {
    /// Fields in bins.
    pub struct ProfileSpec: "`measure.profile`", checked by has_bins {
        /// Direction of the bins: x, y, z or radius
        along: AlongSpec = Text, "\"z\"", "\"radius\"";
        /// Point of the vertical axis of the radius
        centre: Vec3 = Vector(D::LENGTH), "[0, 0, 0]", "[\"5 cm\", 0, 0]";
        /// Lower edge of the first bin
        from: f64 = Quantity(D::LENGTH), "required", "0";
        /// Upper edge of the last bin
        to: f64 = Quantity(D::LENGTH), "required", "\"20 cm\"";
        /// Number of bins
        bins: u64 = Count, "required", "20" => bins;
    }
}

table! {
    /// Distribution of forces.
    pub struct HistogramSpec: "`measure.histogram`" {
        /// Number of bins
        bins: u64 = Count, "20", "40" => bins;
        /// Largest ratio of a normal force to the mean
        most: f64 = Quantity(D::NONE), "5", "8", Positive;
    }
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

impl Choice for AlongSpec {
    const NAMES: &'static [(&'static str, Self)] =
        &[("x", Self::X), ("y", Self::Y), ("z", Self::Z), ("radius", Self::Radius)];
}

impl AlongSpec {
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

/// Reads a measurement, unless it is one of nothing or of what cannot share a table.
pub(super) fn read(reader: &Reader) -> Result<MeasureSpec, SceneError> {
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
        return Err(reader.refuse(format!(
            "`{}` has records of bins, so that it cannot share a table with `{}`: give it a measure of its own",
            found[0], found[1]
        )));
    }
    let chooses =
        ["bodies", "packings", "streams", "region"].into_iter().find(|key| reader.get(key).is_some());
    if let (true, Some(key)) = (found.contains(&"exchange"), chooses) {
        return Err(reader.refuse(format!(
            "`exchange` counts all that comes and goes, whatever `{key}` chooses: give it a measure of its own, without `{key}`"
        )));
    }
    MeasureSpec::read(reader)
}

/// Time between records, s.
fn every(reader: &Reader, key: &str) -> Result<f64, SceneError> {
    Ok(reader.quantity(key)?.unwrap_or(reader.context.time.step))
}

fn some_bodies(reader: &Reader, key: &str) -> Result<Vec<String>, SceneError> {
    let names = names::bodies(reader, key)?;
    if names.is_empty() { Err(reader.missing(key)) } else { Ok(names) }
}

fn is_chosen(_: &MixingSpec, reader: &Reader) -> Result<(), SceneError> {
    reader.any_of(&["packings", "streams"])
}

fn has_bins(&ProfileSpec { along, from, to, .. }: &ProfileSpec, reader: &Reader) -> Result<(), SceneError> {
    if to <= from {
        return Err(reader.out_of_range("to", &format!("above from ({from} m)"), format!("{to} m")));
    }
    if along == AlongSpec::Radius && from < 0.0 {
        return Err(reader.out_of_range("from", "zero or positive along a radius", format!("{from} m")));
    }
    Ok(())
}

fn bins(reader: &Reader, key: &str) -> Result<u64, SceneError> {
    match reader.field(key)? {
        count if (1..=MOST_BINS as u64).contains(&count) => Ok(count),
        count => Err(reader.out_of_range(key, &format!("from 1 to {MOST_BINS}"), count)),
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
