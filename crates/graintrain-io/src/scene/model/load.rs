//! Loads.

use super::super::error::Location;
use super::FunctionSpec;
use graintrain::load::Region;
use graintrain::math::Vec3;
use graintrain::motion::Axes;
use serde::Serialize;

/// Forces, torques and fields on some bodies.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LoadSpec {
    /// Names of single bodies; without these and packings all bodies.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<String>,
    /// Names of packings.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub packings: Vec<String>,
    /// Where it acts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<Region>,
    /// N
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force: Option<[FunctionSpec; 3]>,
    /// Where the force acts in the body's frame, m; `None`: at the centre of mass.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub point: Option<Vec3>,
    /// N m
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque: Option<[FunctionSpec; 3]>,
    /// Axes of force and torque.
    pub axes: Axes,
    /// Stress on an area.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure: Option<PressureSpec>,
    /// Uniform field, m/s^2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceleration: Option<[FunctionSpec; 3]>,
    /// Central field.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub central: Option<CentralSpec>,
    /// Drag.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drag: Option<DragSpec>,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
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

/// A stress on an area.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PressureSpec {
    /// Pa
    pub stress: FunctionSpec,
    /// m^2
    pub area: f64,
    /// Unit direction of the force.
    pub direction: Vec3,
}

/// A central field.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CentralSpec {
    /// m
    pub point: Vec3,
    /// m/s^2
    pub strength: f64,
    /// m
    pub distance: f64,
    /// Exponent.
    pub power: f64,
}

/// Drag of a medium.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DragSpec {
    /// N s/m
    pub linear: f64,
    /// N s^2/m^2
    pub quadratic: f64,
    /// N m s
    pub angular: f64,
    /// m/s
    pub medium: Vec3,
}
