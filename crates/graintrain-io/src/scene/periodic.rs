//! Periodic cells as a scene asks for them.

use super::error::SceneError;
use super::model::FunctionSpec;
use super::names;
use super::reader::Reader;
use super::table::{Spec, table};
use graintrain::cell::NAMES;
use graintrain::math::Vec3;

table! {
    /// A cell that repeats.
    pub struct PeriodicSpec: "`[periodic]`", at most one of ["pressure", "stress"], checked by is_cell {
        /// Lower corner of the cell
        min: Vec3 = Vector(D::LENGTH), "required", "[0, 0, 0]";
        /// Upper corner of the cell
        max: Vec3 = Vector(D::LENGTH), "required", "[\"10 cm\", \"10 cm\", \"20 cm\"]";
        /// Periodic axes
        axes: Vec<String> = Texts, "[\"x\", \"y\", \"z\"]", "[\"x\", \"y\"]" in DIRECTIONS => axes;
        /// What drives it.
        #[serde(flatten)]
        drive: DriveSpec => Spec::read;
        keys of DriveSpec::TABLE;
        location
    }
}

table! {
    /// What drives a cell; components that are not named are held.
    pub struct DriveSpec: "`stage.periodic`", at most one of ["pressure", "stress"], checked by is_drive {
        /// Velocity gradient by components, ij is du_i/dx_j: positive xx, yy, zz stretch; xy, xz, yz shear
        #[serde(serialize_with = "super::in_order", skip_serializing_if = "Vec::is_empty")]
        rate: Vec<(String, FunctionSpec)> = Table(&RATE_COMPONENTS), "zero without a stress",
            "{ xx = \"-0.1/s\", xy = \"0.5/s\" }" => components;
        /// Imposed mean stress by components without a rate, compression positive: the cell deforms until the
        /// contact stress equals it
        #[serde(serialize_with = "super::in_order", skip_serializing_if = "Vec::is_empty")]
        stress: Vec<(String, FunctionSpec)> = Table(&STRESS_COMPONENTS), "none",
            "{ zz = \"10 kPa\" }" => stress;
        /// The same value for the stresses xx, yy and zz, each imposed independently
        pressure = Function(D::PRESSURE, &PRESSURE), "none", "\"10 kPa\"";
        /// Largest deformation rate due to imposed stresses, only with `stress` or `pressure`; without this
        /// limit a loose sample contracts ever faster
        fastest: Option<f64> = Quantity(D::RATE), "no limit", "\"1/s\"", Positive;
    }
}

macro_rules! components {
    ($name:ident, $heading:literal, $dimension:expr, $table:ident, $example:literal) => {
        table! {
            static $name: $heading {
                #[doc = "Component xx"]
                xx = Function($dimension, &$table), "not imposed", $example;
                #[doc = "Component yy"]
                yy = Function($dimension, &$table), "not imposed", $example;
                #[doc = "Component zz"]
                zz = Function($dimension, &$table), "not imposed", $example;
                #[doc = "Component xy"]
                xy = Function($dimension, &$table), "not imposed", $example;
                #[doc = "Component xz"]
                xz = Function($dimension, &$table), "not imposed", $example;
                #[doc = "Component yz"]
                yz = Function($dimension, &$table), "not imposed", $example;
            }
        }
    };
}

components!(RATE_COMPONENTS, "`periodic.rate`", D::RATE, RATE, "\"0.1/s\"");
components!(STRESS_COMPONENTS, "`periodic.stress`", D::PRESSURE, PRESSURE, "\"10 kPa\"");

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
const DIRECTIONS: &[(&str, ())] = &[("x", ()), ("y", ()), ("z", ())];

fn axes(reader: &Reader, key: &str) -> Result<Vec<String>, SceneError> {
    let directions = super::schema::names(DIRECTIONS);
    let axes = reader.texts(key)?.unwrap_or_else(|| directions.iter().copied().map(String::from).collect());
    axes.iter().try_for_each(|axis| names::check(reader, key, "axis", axis, &directions))?;
    if let Some((_, twice)) = axes.iter().enumerate().find(|(k, axis)| axes[..*k].contains(axis)) {
        return Err(reader.out_of_range(key, "every axis once", format!("`{twice}` twice")));
    }
    if axes.is_empty() {
        return Err(reader.out_of_range(key, "at least one axis", "none"));
    }
    Ok(axes)
}

fn is_cell(cell: &PeriodicSpec, reader: &Reader) -> Result<(), SceneError> {
    if cell.min.cmplt(cell.max).all() {
        return Ok(());
    }
    Err(reader.out_of_range("max", "above `min` along every axis", cell.max))
}

/// Functions of time by the names of components.
fn components(reader: &Reader, key: &str) -> Result<Vec<(String, FunctionSpec)>, SceneError> {
    let Some(inner) = reader.child(key)? else { return Ok(Vec::new()) };
    let read = |name: &str| Ok(inner.function(name)?.map(|function| (name.to_string(), function)));
    NAMES.into_iter().filter_map(|name| read(name).transpose()).collect()
}

fn stress(reader: &Reader, key: &str) -> Result<Vec<(String, FunctionSpec)>, SceneError> {
    let Some(pressure) = reader.function("pressure")? else { return components(reader, key) };
    Ok(NAMES[..3].iter().map(|name| (name.to_string(), pressure.clone())).collect())
}

fn is_drive(DriveSpec { rate, stress, fastest }: &DriveSpec, reader: &Reader) -> Result<(), SceneError> {
    if let Some((name, _)) = stress.iter().find(|(name, _)| rate.iter().any(|(other, _)| other == name)) {
        let problem = format!("the component {name} of the cell has a rate and a stress: impose one of them");
        return Err(reader.refuse(problem));
    }
    if fastest.is_some() && stress.is_empty() {
        let problem = "`fastest` limits what a stress does to the cell, but none is imposed: add `stress` or `pressure`, or leave it out";
        return Err(reader.refuse(problem));
    }
    Ok(())
}
