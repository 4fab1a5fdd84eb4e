//! Periodic cells as a scene asks for them.

use super::error::{Location, SceneError, SceneErrorKind};
use super::model::FunctionSpec;
use super::reader::Reader;
use super::schema::Kind::{self, Function, Quantity, Texts, Vector};
use super::schema::function::{PRESSURE, RATE};
use super::schema::{D, Key, Range, Table, key};
use super::table::Field;
use graintrain::cell::NAMES;
use graintrain::math::Vec3;
use serde::Serialize;

pub(super) static PERIODIC: Table = Table {
    heading: "`[periodic]`",
    alternatives: &[&["pressure", "stress"]],
    keys: &[
        key("min", Vector(D::LENGTH), "required", "[0, 0, 0]", "Lower corner of the cell"),
        key(
            "max",
            Vector(D::LENGTH),
            "required",
            "[\"10 cm\", \"10 cm\", \"20 cm\"]",
            "Upper corner of the cell",
        ),
        key("axes", Texts, "[\"x\", \"y\", \"z\"]", "[\"x\", \"y\"]", "Periodic axes")
            .one_of(|| DIRECTIONS.to_vec()),
        RATES,
        STRESSES,
        ISOTROPIC,
        FASTEST,
    ],
};

pub(super) static STAGE_PERIODIC: Table = Table {
    heading: "`stage.periodic`",
    alternatives: &[&["pressure", "stress"]],
    keys: &[RATES, STRESSES, ISOTROPIC, FASTEST],
};

const RATES: Key = key(
    "rate",
    Kind::Table(&RATE_COMPONENTS),
    "zero without a stress",
    "{ xx = \"-0.1/s\", xy = \"0.5/s\" }",
    "Velocity gradient by components, ij is du_i/dx_j: positive xx, yy, zz stretch; xy, xz, yz shear",
);
const STRESSES: Key = key(
    "stress",
    Kind::Table(&STRESS_COMPONENTS),
    "none",
    "{ zz = \"10 kPa\" }",
    "Imposed mean stress by components without a rate, compression positive: the cell deforms until the contact stress equals it",
);
const ISOTROPIC: Key = key(
    "pressure",
    Function(D::PRESSURE, &PRESSURE),
    "none",
    "\"10 kPa\"",
    "The same value for the stresses xx, yy and zz, each imposed independently",
);
const FASTEST: Key = key(
    "fastest",
    Quantity(D::RATE),
    "no limit",
    "\"1/s\"",
    "Largest deformation rate due to imposed stresses, only with `stress` or `pressure`; without this limit a loose sample contracts ever faster",
).within(Range::Positive);

macro_rules! components {
    ($name:ident, $heading:literal, $dimension:expr, $table:ident, $example:literal) => {
        static $name: Table = Table {
            heading: $heading,
            alternatives: &[],
            keys: &[
                key("xx", Function($dimension, &$table), "not imposed", $example, "Component xx"),
                key("yy", Function($dimension, &$table), "not imposed", $example, "Component yy"),
                key("zz", Function($dimension, &$table), "not imposed", $example, "Component zz"),
                key("xy", Function($dimension, &$table), "not imposed", $example, "Component xy"),
                key("xz", Function($dimension, &$table), "not imposed", $example, "Component xz"),
                key("yz", Function($dimension, &$table), "not imposed", $example, "Component yz"),
            ],
        };
    };
}

components!(RATE_COMPONENTS, "`periodic.rate`", D::RATE, RATE, "\"0.1/s\"");
components!(STRESS_COMPONENTS, "`periodic.stress`", D::PRESSURE, PRESSURE, "\"10 kPa\"");

/// A cell that repeats.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PeriodicSpec {
    /// Lower corner, m.
    pub min: Vec3,
    /// Upper corner, m.
    pub max: Vec3,
    /// Names of the axes along which it repeats.
    pub axes: Vec<String>,
    /// What drives it.
    #[serde(flatten)]
    pub drive: DriveSpec,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}

/// What drives a cell; components that are not named are held.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DriveSpec {
    /// Velocity gradient by components, 1/s.
    #[serde(serialize_with = "super::in_order", skip_serializing_if = "Vec::is_empty")]
    pub rate: Vec<(String, FunctionSpec)>,
    /// Stress by components, Pa.
    #[serde(serialize_with = "super::in_order", skip_serializing_if = "Vec::is_empty")]
    pub stress: Vec<(String, FunctionSpec)>,
    /// Largest rate of components whose stress is imposed, 1/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fastest: Option<f64>,
}

impl PeriodicSpec {
    /// The functions of time.
    pub(super) fn functions(&mut self) -> impl Iterator<Item = &mut FunctionSpec> {
        self.drive.functions()
    }
}

impl DriveSpec {
    /// The functions of time.
    pub(super) fn functions(&mut self) -> impl Iterator<Item = &mut FunctionSpec> {
        self.rate.iter_mut().chain(&mut self.stress).map(|(_, function)| function)
    }
}

/// Axes along which a cell may repeat.
const DIRECTIONS: [&str; 3] = ["x", "y", "z"];

/// Reads the cell of a scene.
pub(super) fn read(reader: &Reader) -> Result<PeriodicSpec, SceneError> {
    let (min, max): (Vec3, Vec3) = (reader.field("min")?, reader.field("max")?);
    if !min.cmplt(max).all() {
        return Err(reader.out_of_range("max", "above `min` along every axis", max));
    }
    let axes = reader.texts("axes")?.unwrap_or_else(|| DIRECTIONS.map(String::from).to_vec());
    if let Some(unknown) = axes.iter().find(|axis| !DIRECTIONS.contains(&axis.as_str())) {
        return Err(reader.unknown_name("axes", "axis", unknown, DIRECTIONS.into_iter()));
    }
    if let Some((_, twice)) = axes.iter().enumerate().find(|(k, axis)| axes[..*k].contains(axis)) {
        return Err(reader.out_of_range("axes", "every axis once", format!("`{twice}` twice")));
    }
    if axes.is_empty() {
        return Err(reader.out_of_range("axes", "at least one axis", "none"));
    }
    Ok(PeriodicSpec { min, max, axes, drive: drive(reader)?, location: reader.location().clone() })
}

impl Field for DriveSpec {
    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        reader.child(key)?.as_ref().map(drive).transpose()
    }
}

/// Reads what drives a cell.
fn drive(reader: &Reader) -> Result<DriveSpec, SceneError> {
    reader.check_alternatives()?;
    let components = |key: &str| -> Result<Vec<(String, FunctionSpec)>, SceneError> {
        let Some(inner) = reader.child(key)? else { return Ok(Vec::new()) };
        let read = |name: &str| Ok(inner.function(name)?.map(|function| (name.to_string(), function)));
        NAMES.into_iter().filter_map(|name| read(name).transpose()).collect()
    };
    let rate = components("rate")?;
    let stress = match reader.function("pressure")? {
        Some(pressure) => NAMES[..3].iter().map(|name| (name.to_string(), pressure.clone())).collect(),
        None => components("stress")?,
    };
    if let Some((name, _)) = stress.iter().find(|(name, _)| rate.iter().any(|(other, _)| other == name)) {
        let problem = format!("the component {name} of the cell has a rate and a stress: impose one of them");
        return Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
    }
    let fastest = reader.quantity("fastest")?;
    if fastest.is_some() && stress.is_empty() {
        let problem = "`fastest` limits what a stress does to the cell, but none is imposed: add `stress` or `pressure`, or leave it out";
        return Err(SceneError::at(SceneErrorKind::Contradiction(problem.to_string()), reader.location()));
    }
    Ok(DriveSpec { rate, stress, fastest })
}
