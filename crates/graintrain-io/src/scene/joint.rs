//! Joints as scenes write them.

use super::error::{Location, SceneError, SceneErrorKind};
use super::file::names_of;
use super::model::FunctionSpec;
use super::reader::Reader;
use graintrain::joint::Coordinate;
use graintrain::math::Vec3;
use serde::Serialize;

/// A joint.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JointSpec {
    /// `fixed`, `revolute`, `prismatic`, `cylindrical`, `spherical`, `distance` or `gear`.
    pub kind: &'static str,
    /// Names of A and B; of one body alone: B, held by the world. None of a gear.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<String>,
    /// m
    #[serde(skip_serializing_if = "Option::is_none")]
    pub point: Option<Vec3>,
    /// Unit direction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis: Option<Vec3>,
    /// m
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ends: Option<[Vec3; 2]>,
    /// Names of the two joints of a gear.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub joints: Vec<String>,
    /// Of a gear.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ratio: Option<f64>,
    /// Of a cylindrical joint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub along: Option<Coordinate>,
    /// On an angle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motor: Option<MotorSpec>,
    /// On a slide or distance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub actuator: Option<ActuatorSpec>,
    /// On an angle, N m/rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torsion_spring: Option<SpringSpec>,
    /// On a slide or distance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spring: Option<SpringSpec>,
    /// Of an angle, rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angles: Option<StopsSpec>,
    /// Of a slide or distance, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub travel: Option<StopsSpec>,
    /// Whether its bodies collide; a gear has none of its own.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub collide: bool,
    /// Where it is written.
    #[serde(skip)]
    pub location: Location,
}

/// What drives an angle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MotorSpec {
    /// rad/s
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed: Option<FunctionSpec>,
    /// N m: the largest, or without speed the torque itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque: Option<FunctionSpec>,
}

/// What drives a slide or distance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ActuatorSpec {
    /// m/s
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed: Option<FunctionSpec>,
    /// N: the largest, or without speed the force itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force: Option<FunctionSpec>,
}

/// A spring and damper: N/m and N s/m, or N m/rad and N m s/rad.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpringSpec {
    /// Force or torque per length or angle.
    pub stiffness: f64,
    /// Per speed.
    pub damping: f64,
    /// m or rad; `None`: where it is at time 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rest: Option<FunctionSpec>,
}

/// Stops, m or rad.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StopsSpec {
    /// Smallest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lower: Option<f64>,
    /// Largest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub upper: Option<f64>,
}

impl JointSpec {
    /// One of this kind that holds nothing yet.
    pub(super) fn new(kind: &'static str, location: Location) -> Self {
        Self {
            kind,
            bodies: Vec::new(),
            point: None,
            axis: None,
            ends: None,
            joints: Vec::new(),
            ratio: None,
            along: None,
            motor: None,
            actuator: None,
            torsion_spring: None,
            spring: None,
            angles: None,
            travel: None,
            collide: false,
            location,
        }
    }

    /// What it holds, for people.
    pub fn about(&self) -> String {
        let held = match (self.bodies.as_slice(), self.joints.as_slice()) {
            ([body], _) => format!("{body} and the world"),
            (_, [first, second]) => format!("{first} and {second}"),
            (bodies, _) => bodies.join(" and "),
        };
        let parts = [
            ("motor", self.motor.is_some() || self.actuator.is_some()),
            ("spring", self.spring.is_some() || self.torsion_spring.is_some()),
            ("stops", self.angles.is_some() || self.travel.is_some()),
        ];
        let parts: Vec<&str> = parts.into_iter().filter(|(_, given)| *given).map(|(name, _)| name).collect();
        let with = if parts.is_empty() { String::new() } else { format!(", with {}", parts.join(", ")) };
        format!("{} between {held}{with}", self.kind)
    }

    /// Its functions of time.
    pub(super) fn functions(&mut self) -> impl Iterator<Item = &mut FunctionSpec> {
        let motor = self.motor.iter_mut().flat_map(|motor| [&mut motor.speed, &mut motor.torque]);
        let actuator = self.actuator.iter_mut().flat_map(|motor| [&mut motor.speed, &mut motor.force]);
        let springs = [&mut self.torsion_spring, &mut self.spring].into_iter().flatten();
        motor.chain(actuator).chain(springs.map(|spring| &mut spring.rest)).flatten()
    }

    /// Whether motors and springs act on an angle; `None` where the joint has no coordinate.
    fn turns(&self) -> Option<bool> {
        match self.kind {
            "revolute" => Some(true),
            "cylindrical" => Some(self.along != Some(Coordinate::Slide)),
            "prismatic" | "distance" => Some(false),
            _ => None,
        }
    }
}

/// Coordinates of a cylindrical joint.
pub(super) const ALONG: &[(&str, Coordinate)] = &[("turn", Coordinate::Turn), ("slide", Coordinate::Slide)];

/// Kinds of joints.
pub(super) const KINDS: &[(&str, &str)] = &[
    ("fixed", "fixed"),
    ("revolute", "revolute"),
    ("prismatic", "prismatic"),
    ("cylindrical", "cylindrical"),
    ("spherical", "spherical"),
    ("distance", "distance"),
    ("gear", "gear"),
];

/// Keys that a kind of joint needs, and which it may not have.
fn geometry_keys(kind: &str) -> (&'static [&'static str], &'static [&'static str]) {
    match kind {
        "fixed" | "spherical" => (&["bodies", "point"], &["axis", "ends", "joints", "ratio", "along"]),
        "revolute" | "prismatic" => (&["bodies", "point", "axis"], &["ends", "joints", "ratio", "along"]),
        "cylindrical" => (&["bodies", "point", "axis"], &["ends", "joints", "ratio"]),
        "distance" => (&["bodies", "ends"], &["point", "axis", "joints", "ratio", "along"]),
        _ => (&["joints", "ratio"], &["bodies", "point", "axis", "ends", "along", "collide"]),
    }
}

const OF_ANGLES: &[&str] = &["motor", "torsion_spring", "angles"];
const OF_SLIDES: &[&str] = &["actuator", "spring", "travel"];

/// Reads a joint; `known` are those above it.
pub(super) fn read(
    reader: &Reader,
    bodies: &[&str],
    known: &[(String, JointSpec)],
) -> Result<JointSpec, SceneError> {
    let kind = reader.choice("kind", KINDS)?.ok_or_else(|| reader.missing("kind"))?;
    let (needed, useless) = geometry_keys(kind);
    let refuse =
        |problem: String| Err(SceneError::at(SceneErrorKind::Contradiction(problem), reader.location()));
    if let Some(key) = needed.iter().find(|key| reader.get(key).is_none()) {
        return Err(reader.missing(key));
    }
    if let Some(key) = useless.iter().find(|key| reader.get(key).is_some()) {
        return refuse(format!(
            "`{}` has no meaning for a joint that is {kind}: remove it",
            reader.full(key)
        ));
    }
    let names: Vec<&str> = known.iter().map(|(name, _)| name.as_str()).collect();
    let pair =
        |rows: Vec<[f64; 3]>| <[[f64; 3]; 2]>::try_from(rows).ok().map(|ends| ends.map(Vec3::from_array));
    let ends = match reader.rows("ends")? {
        None => None,
        Some(rows) => {
            let found = rows.len();
            Some(pair(rows).ok_or_else(|| reader.out_of_range("ends", "two points", found))?)
        }
    };
    let spec = JointSpec {
        kind,
        bodies: names_of(reader, "bodies", "body", bodies)?,
        point: reader.vector("point")?,
        axis: reader.direction("axis")?,
        ends,
        joints: names_of(reader, "joints", "joint above this one", &names)?,
        ratio: reader.quantity("ratio")?,
        along: reader.choice("along", ALONG)?,
        motor: reader.child("motor")?.as_ref().map(motor).transpose()?,
        actuator: reader.child("actuator")?.as_ref().map(actuator).transpose()?,
        torsion_spring: reader.child("torsion_spring")?.as_ref().map(spring).transpose()?,
        spring: reader.child("spring")?.as_ref().map(spring).transpose()?,
        angles: reader.child("angles")?.as_ref().map(stops).transpose()?,
        travel: reader.child("travel")?.as_ref().map(stops).transpose()?,
        collide: reader.flag("collide")?.unwrap_or(false),
        location: reader.location().clone(),
    };
    if !spec.joints.is_empty() && spec.joints.len() != 2 {
        return Err(reader.out_of_range("joints", "two names", spec.joints.len()));
    }
    if spec.bodies.len() > 2 {
        return Err(reader.out_of_range("bodies", "one or two names", spec.bodies.len()));
    }
    for (keys, is_turn, what, other) in
        [(OF_ANGLES, true, "an angle", OF_SLIDES), (OF_SLIDES, false, "a slide or distance", OF_ANGLES)]
    {
        let given = keys.iter().position(|key| reader.get(key).is_some());
        if let Some(place) = given.filter(|_| spec.turns() != Some(is_turn)) {
            let remedy = match spec.turns() {
                Some(_) => format!("use `{}`", other[place]),
                None => "it has neither that these could act on".to_string(),
            };
            let key = reader.full(keys[place]);
            return refuse(format!("`{key}` acts on {what}, but this joint is {kind}: {remedy}"));
        }
    }
    Ok(spec)
}

pub(super) fn motor(reader: &Reader) -> Result<MotorSpec, SceneError> {
    let spec = MotorSpec { speed: reader.function("speed")?, torque: reader.function("torque")? };
    if spec.speed.is_none() && spec.torque.is_none() { Err(reader.missing("speed")) } else { Ok(spec) }
}

pub(super) fn actuator(reader: &Reader) -> Result<ActuatorSpec, SceneError> {
    let spec = ActuatorSpec { speed: reader.function("speed")?, force: reader.function("force")? };
    if spec.speed.is_none() && spec.force.is_none() { Err(reader.missing("speed")) } else { Ok(spec) }
}

pub(super) fn spring(reader: &Reader) -> Result<SpringSpec, SceneError> {
    let coefficient = |key: &str| Ok(reader.quantity(key)?.unwrap_or(0.0));
    let spec = SpringSpec {
        stiffness: coefficient("stiffness")?,
        damping: coefficient("damping")?,
        rest: reader.function("rest")?,
    };
    if spec.stiffness == 0.0 && spec.damping == 0.0 { Err(reader.missing("stiffness")) } else { Ok(spec) }
}

pub(super) fn stops(reader: &Reader) -> Result<StopsSpec, SceneError> {
    let spec = StopsSpec { lower: reader.quantity("lower")?, upper: reader.quantity("upper")? };
    if spec.lower.is_none() && spec.upper.is_none() { Err(reader.missing("lower")) } else { Ok(spec) }
}
