//! Loads.

use super::super::error::{SceneError, SceneErrorKind};
use super::super::names;
use super::super::reader::Reader;
use super::super::region::RegionSpec;
use super::super::table::{Choice, table};
use super::FunctionSpec;
use graintrain::load::Region;
use graintrain::math::Vec3;
use graintrain::motion::Axes;

table! {
    /// Forces, torques and fields on some bodies.
    pub struct LoadSpec: "`[load.NAME]`", checked by check {
        /// Bodies by name
        #[serde(skip_serializing_if = "Vec::is_empty")]
        bodies: Vec<String> = Texts, "all bodies, or those of packings", "[\"wheel\"]" => names::bodies;
        /// All bodies of packings by name
        #[serde(skip_serializing_if = "Vec::is_empty")]
        packings: Vec<String> = Texts, "all bodies, or those of bodies", "[\"grains\"]" => names::packings;
        /// Acts only on bodies whose centre of mass is inside
        region: Option<Region> = Table(RegionSpec::TABLE), "everywhere",
            "{ box = { min = [0, 0, 0], max = [1, 1, 1] } }";
        /// Force on each body; components are functions of time, `t` is the time of the run
        force: Option<[FunctionSpec; 3]> = Functions(D::FORCE, &FORCE), "none",
            "[0, 0, \"2 kN * sin(2*pi*t/4 s)\"]";
        /// Point of application in the body's frame
        point: Option<Vec3> = Vector(D::LENGTH), "the centre of mass", "[0, 0, \"5 cm\"]";
        /// Torque on each body
        torque: Option<[FunctionSpec; 3]> = Functions(D::ENERGY, &TORQUE), "none", "[0, \"3 N m\", 0]";
        /// Axes of force and torque: world, or body (rotating with it)
        axes: Axes = Text, "\"world\"", "\"body\"";
        /// Force of a stress on an area, for a wall that is free in its direction
        pressure: Option<PressureSpec> = Table(PressureSpec::TABLE), "none",
            "{ stress = \"10 kPa\", area = 0.04, direction = [0, 0, -1] }";
        /// Uniform field: the same acceleration for every body
        acceleration: Option<[FunctionSpec; 3]> = Functions(D::ACCELERATION, &ACCELERATION), "none",
            "[\"0.3 m/s^2 * sin(2*pi*t/1 s)\", 0, 0]";
        /// Central field
        central: Option<CentralSpec> = Table(CentralSpec::TABLE), "none",
            "{ point = [0, 0, 0], strength = 9.81, distance = 1 }";
        /// Drag of a medium, -(linear + quadratic |u|) u with the velocity u relative to it
        drag: Option<DragSpec> = Table(DragSpec::TABLE), "none", "{ linear = \"0.2 N s/m\" }";
        location
    }
}

table! {
    /// A stress on an area.
    pub struct PressureSpec: "`pressure`" {
        /// Stress, a function of time
        stress: FunctionSpec = Function(D::PRESSURE, &PRESSURE), "required", "\"10 kPa\"";
        /// Area on which it acts
        area: f64 = Quantity(D::AREA), "required", "\"400 cm^2\"", Positive;
        /// Direction of the force in the world; any length
        direction: Vec3 = Direction, "required", "[0, 0, -1]";
    }
}

table! {
    /// A central field.
    pub struct CentralSpec: "`central`" {
        /// The centre
        point: Vec3 = Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"-1 m\"]";
        /// Acceleration towards the centre at `distance`; negative: away from it
        strength: f64 = Quantity(D::ACCELERATION), "required", "9.81";
        /// Distance at which the acceleration is `strength`
        distance: f64 = Quantity(D::LENGTH), "1", "\"6371 km\"", Positive;
        /// Exponent of the distance
        power: f64 = Quantity(D::NONE), "-2", "1";
    }
}

table! {
    /// Drag of a medium.
    pub struct DragSpec: "`drag`" {
        /// Force over velocity
        linear: f64 = Quantity(D::new(0, 1, -1, 0)), "0", "\"0.2 N s/m\"", NotNegative;
        /// Force over velocity squared: 1/2 density c_d area
        quadratic: f64 = Quantity(D::new(-1, 1, 0, 0)), "0",
            "\"0.5 * 1.2 kg/m^3 * 0.47 * 12 cm^2\"", NotNegative;
        /// Torque over angular velocity
        angular: f64 = Quantity(D::new(2, 1, -1, 0)), "0", "\"0.01 N m s\"", NotNegative;
        /// Velocity of the medium
        medium: Vec3 = Vector(D::SPEED), "[0, 0, 0]", "[\"5 m/s\", 0, 0]";
    }
}

impl Choice for Axes {
    const NAMES: &'static [(&'static str, Self)] = &[("world", Self::World), ("body", Self::Body)];
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

/// What a load can do to bodies.
const ACTIONS: &[&str] = &["force", "torque", "pressure", "acceleration", "central", "drag"];

fn check(load: &LoadSpec, reader: &Reader) -> Result<(), SceneError> {
    if ACTIONS.iter().all(|action| reader.get(action).is_none()) {
        let kind = SceneErrorKind::OneOf {
            table: format!("`{}`", reader.path),
            keys: ACTIONS.join(", "),
            found: "none".into(),
        };
        return Err(SceneError::at(kind, reader.location()));
    }
    if load.point.is_some() && load.force.is_none() { Err(reader.missing("force")) } else { Ok(()) }
}
