//! Joints as scenes write them.

use super::error::{Location, SceneError};
use super::model::FunctionSpec;
use super::names;
use super::reader::Reader;
use super::table::{Choice, Field, Spec, table};
use graintrain::handle::JointId;
use graintrain::joint::Coordinate::{self, Slide, Turn};
use graintrain::joint::{JointKind, Pair};
use graintrain::math::Vec3;
use serde::{Serialize, Serializer};

table! {
    /// A joint.
    pub struct JointSpec: "`[joint.NAME]`", checked by check {
        /// Kind:
        kind: JointForm = Text, "required", "\"revolute\"";
        /// Bodies A and B by name; a single one is B, connected to the world
        #[serde(skip_serializing_if = "Vec::is_empty")]
        bodies: Vec<String> = Texts, "required unless a gear", "[\"arm\", \"bucket\"]" => names::bodies;
        /// Position of the joint in the world at time 0
        point: Option<Vec3> = Vector(D::LENGTH), "required unless a distance or gear", "[0, 0, \"5 cm\"]";
        /// Direction of its axis in the world at time 0; any length
        axis: Option<Vec3> = Direction, "required of kinds that have one", "[0, 1, 0]";
        /// End points on A and on B, in the world at time 0
        ends: Option<[Vec3; 2]> = Rows, "required of a distance", "[[0, 0, 1], [0.5, 0, 1]]";
        /// The two joints coupled by a gear, defined above it
        #[serde(skip_serializing_if = "Vec::is_empty")]
        joints: Vec<String> = Texts, "required of a gear", "[\"pinion\", \"wheel\"]";
        /// Velocity of the second joint over that of the first (rad/s or m/s), negative for opposite rotation
        ratio: Option<f64> = Quantity(D::NONE), "required of a gear", "-0.25";
        /// For a joint with both: turn (keys `motor`, `torsion_spring`, `angles`) or slide (keys
        /// `actuator`, `spring`, `travel`)
        along: Option<Coordinate> = Text, "\"turn\"", "\"slide\"";
        /// Drives an angle: at a speed with a maximum torque, or with a torque
        motor: Option<MotorSpec> = Table(MotorSpec::TABLE), "none",
            "{ speed = \"20 rpm\", torque = \"50 N m\" }";
        /// Drives a displacement or distance: at a speed with a maximum force, or with a force
        actuator: Option<ActuatorSpec> = Table(ActuatorSpec::TABLE), "none",
            "{ speed = \"5 cm/s\", force = \"2 kN\" }";
        /// Spring and damper for an angle
        torsion_spring: Option<SpringSpec> = Table(&TORSION_SPRING), "none",
            "{ stiffness = \"30 N m/rad\" }";
        /// Spring and damper for a displacement or distance
        spring: Option<SpringSpec> = Table(SpringSpec::TABLE), "none",
            "{ stiffness = \"10 kN/m\", damping = \"200 N s/m\" }";
        /// Limits of an angle, which is zero at time 0
        angles: Option<StopsSpec> = Table(&ANGLES), "none", "{ lower = \"-30 deg\" }";
        /// Limits of a displacement, which is zero at time 0, or of a distance: with `upper` only a rope
        travel: Option<StopsSpec> = Table(StopsSpec::TABLE), "none", "{ upper = \"12 cm\" }";
        /// Whether the two bodies collide with each other
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        collide: bool = Flag, "false", "true";
        location
    }
}

table! {
    /// What drives an angle.
    pub struct MotorSpec: "`motor`", checked by drives_angle {
        /// Angular speed of B relative to A, a function of time
        speed: Option<FunctionSpec> = Function(D::ANGULAR_SPEED, &ANGULAR_SPEED), "none: the torque itself",
            "\"20 rpm\"";
        /// Largest torque; without `speed` the torque on B, a function of time
        torque: Option<FunctionSpec> = Function(D::ENERGY, &TORQUE), "no limit", "\"50 N m\"";
    }
}

table! {
    /// What drives a slide or distance.
    pub struct ActuatorSpec: "`actuator`", checked by drives_slide {
        /// Velocity of the displacement or distance, a function of time
        speed: Option<FunctionSpec> = Function(D::SPEED, &SPEED), "none: the force itself", "\"5 cm/s\"";
        /// Largest force; without `speed` the force on B, a function of time
        force: Option<FunctionSpec> = Function(D::FORCE, &FORCE), "no limit", "\"2 kN\"";
    }
}

table! {
    /// A spring and damper: of a slide or distance; of an angle in N m/rad, N m s/rad and rad.
    pub struct SpringSpec: "`spring`", checked by is_spring {
        /// Force per length
        stiffness: f64 = Quantity(D::new(0, 1, -2, 0)), "0", "\"10 kN/m\"", NotNegative;
        /// Force per speed
        damping: f64 = Quantity(D::new(0, 1, -1, 0)), "0", "\"200 N s/m\"", NotNegative;
        /// Displacement or distance without force, a function of time
        rest: Option<FunctionSpec> = Function(D::LENGTH, &LENGTH), "its value at time 0", "\"20 cm\"";
    }
}

table! {
    /// A [`SpringSpec`] of an angle.
    pub(super) static TORSION_SPRING: "`torsion_spring`" {
        /// Torque per angle
        stiffness = Quantity(D::new(2, 1, -2, -1)), "0", "\"30 N m/rad\"", NotNegative;
        /// Torque per angular speed
        damping = Quantity(D::new(2, 1, -1, -1)), "0", "\"2 N m s/rad\"", NotNegative;
        /// Angle without torque, a function of time
        rest = Function(D::ANGLE, &ANGLE), "0", "\"15 deg\"";
    }
}

table! {
    /// Stops: of a slide or distance; of an angle in rad.
    pub struct StopsSpec: "`travel`", checked by stops {
        /// Smallest displacement or distance
        lower: Option<f64> = Quantity(D::LENGTH), "none", "\"-5 cm\"";
        /// Largest displacement or distance
        upper: Option<f64> = Quantity(D::LENGTH), "none", "\"12 cm\"";
    }
}

table! {
    /// [`StopsSpec`] of an angle.
    pub(super) static ANGLES: "`angles`" {
        /// Smallest angle
        lower = Quantity(D::ANGLE), "none", "\"-30 deg\"";
        /// Largest angle
        upper = Quantity(D::ANGLE), "none", "\"1 rad\"";
    }
}

/// A kind of joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum JointForm {
    /// Of two places.
    Pair(Pair),
    /// A rod.
    Distance,
    /// Of two joints.
    Gear,
}

/// Keys that some kinds of joints may not have.
const FORM_KEYS: &[&str] = &["bodies", "point", "axis", "ends", "joints", "ratio", "along", "collide"];

impl JointForm {
    /// Its name in scenes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pair(pair) => pair.name(),
            Self::Distance => "distance",
            Self::Gear => "gear",
        }
    }

    /// Every kind, with its name.
    fn named() -> Vec<(&'static str, Self)> {
        let pairs = Pair::ALL.iter().map(|&pair| Self::Pair(pair));
        pairs.chain([Self::Distance, Self::Gear]).map(|form| (form.name(), form)).collect()
    }

    /// Keys of [`FORM_KEYS`] that it needs.
    fn needs(self) -> &'static [&'static str] {
        match self {
            Self::Pair(pair) if pair.has_axis() => &["bodies", "point", "axis"],
            Self::Pair(_) => &["bodies", "point"],
            Self::Distance => &["bodies", "ends"],
            Self::Gear => &["joints", "ratio"],
        }
    }

    /// What motors, springs and stops can act on, the default first.
    fn coordinates(self) -> &'static [Coordinate] {
        match self {
            Self::Pair(pair) => pair.coordinates(),
            Self::Distance => &[Slide],
            Self::Gear => &[],
        }
    }

    /// Whether a joint of this kind may have one of [`FORM_KEYS`].
    fn may_have(self, key: &str) -> bool {
        match key {
            "along" => self.coordinates().len() > 1,
            "collide" => self.needs().contains(&"bodies"),
            _ => self.needs().contains(&key),
        }
    }
}

impl Serialize for JointForm {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl Field for JointForm {
    fn choices() -> Vec<&'static str> {
        Self::named().into_iter().map(|(name, _)| name).collect()
    }

    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        reader.choice(key, &Self::named())
    }
}

impl Choice for Coordinate {
    const NAMES: &'static [(&'static str, Self)] = &[("turn", Turn), ("slide", Slide)];
}

/// Two points.
impl Field for [Vec3; 2] {
    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        let Some(rows) = reader.rows(key)? else { return Ok(None) };
        match rows.as_slice() {
            &[first, second] => Ok(Some([first, second].map(Vec3::from_array))),
            _ => Err(reader.out_of_range(key, "two points", rows.len())),
        }
    }
}

impl JointSpec {
    /// One of the kind of this name that holds nothing yet.
    pub(super) fn new(kind: JointForm, location: Location) -> Self {
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

    /// What it holds, with the numbers of the joints that a gear names; `None` where it is incomplete.
    pub(super) fn holds(&self, number: impl Fn(&str) -> JointId) -> Option<JointKind> {
        Some(match self.kind {
            JointForm::Pair(pair) => JointKind::Pair {
                pair,
                point: self.point?,
                axis: if pair.has_axis() { self.axis? } else { Vec3::Z },
                coordinate: self.along.unwrap_or_default(),
            },
            JointForm::Distance => JointKind::Distance { ends: self.ends? },
            JointForm::Gear => {
                let [first, second] = self.joints.as_slice() else { return None };
                JointKind::Gear { joints: [number(first), number(second)], ratio: self.ratio? }
            }
        })
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
        format!("{} between {held}{with}", self.kind.name())
    }

    /// Its functions of time.
    pub(super) fn functions(&mut self) -> impl Iterator<Item = &mut FunctionSpec> {
        let motor = self.motor.iter_mut().flat_map(|motor| [&mut motor.speed, &mut motor.torque]);
        let actuator = self.actuator.iter_mut().flat_map(|motor| [&mut motor.speed, &mut motor.force]);
        let springs = [&mut self.torsion_spring, &mut self.spring].into_iter().flatten();
        motor.chain(actuator).chain(springs.map(|spring| &mut spring.rest)).flatten()
    }
}

/// What acts on angles, and in the same order what acts on slides.
const OF_ANGLES: &[&str] = &["motor", "torsion_spring", "angles"];
const OF_SLIDES: &[&str] = &["actuator", "spring", "travel"];

/// Reads a joint; `known` are those above it.
pub(super) fn read(reader: &Reader, known: &[(String, JointSpec)]) -> Result<JointSpec, SceneError> {
    let spec = JointSpec::read(reader)?;
    let known: Vec<&str> = known.iter().map(|(name, _)| name.as_str()).collect();
    names::chosen(reader, "joints", "joint above this one", &known)?;
    if !spec.joints.is_empty() && spec.joints.len() != 2 {
        return Err(reader.out_of_range("joints", "two names", spec.joints.len()));
    }
    if spec.bodies.len() > 2 {
        return Err(reader.out_of_range("bodies", "one or two names", spec.bodies.len()));
    }
    Ok(spec)
}

/// Refuses a joint without the keys of its kind, or with those of others.
fn check(spec: &JointSpec, reader: &Reader) -> Result<(), SceneError> {
    let form = spec.kind;
    if let Some(key) = form.needs().iter().find(|key| reader.get(key).is_none()) {
        return Err(reader.missing(key));
    }
    if let Some(key) = FORM_KEYS.iter().find(|key| reader.get(key).is_some() && !form.may_have(key)) {
        let key = reader.full(key);
        let problem = format!("`{key}` has no meaning for a joint that is {}: remove it", form.name());
        return Err(reader.refuse(problem));
    }
    let coordinate = spec.along.or(form.coordinates().first().copied());
    for (keys, own, what, other) in
        [(OF_ANGLES, Turn, "an angle", OF_SLIDES), (OF_SLIDES, Slide, "a slide or distance", OF_ANGLES)]
    {
        let given = keys.iter().position(|key| reader.get(key).is_some());
        if let Some(place) = given.filter(|_| coordinate != Some(own)) {
            let remedy = match coordinate {
                Some(_) => format!("use `{}`", other[place]),
                None => "it has neither that these could act on".to_string(),
            };
            let key = reader.full(keys[place]);
            let problem = format!("`{key}` acts on {what}, but this joint is {}: {remedy}", form.name());
            return Err(reader.refuse(problem));
        }
    }
    Ok(())
}

fn drives_angle(_: &MotorSpec, reader: &Reader) -> Result<(), SceneError> {
    reader.any_of(&["speed", "torque"])
}

fn drives_slide(_: &ActuatorSpec, reader: &Reader) -> Result<(), SceneError> {
    reader.any_of(&["speed", "force"])
}

fn is_spring(spec: &SpringSpec, reader: &Reader) -> Result<(), SceneError> {
    if spec.stiffness == 0.0 && spec.damping == 0.0 { Err(reader.missing("stiffness")) } else { Ok(()) }
}

fn stops(_: &StopsSpec, reader: &Reader) -> Result<(), SceneError> {
    reader.any_of(&["lower", "upper"])
}
