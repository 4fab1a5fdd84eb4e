//! Joints: what holds bodies together besides contact.
//!
//! A joint ties a place on body B to a place on body A (or the world) by bilateral rows, whose impulses have
//! any sign. Rows of a joint:
//!
//! | kind | held | free |
//! |---|---|---|
//! | [`Pair`] | what its line of `pair` says | the rest |
//! | distance | the distance of two points | everything else; the distance too, where a spring, a motor or limits act on it |
//! | gear | the coordinate of a second joint is a multiple of that of a first | |
//!
//! The coordinate s of a joint (angle, slide or distance; B relative to A) may have a [`Motor`], a [`Spring`]
//! and [`Limits`]. How the rows are solved is in `mechanism`, their geometry in `kinematics`.

pub(crate) mod drift;
pub(crate) mod elimination;
pub(crate) mod kinematics;
pub(crate) mod mechanism;
mod pair;
mod rows;
mod stiffening;

use crate::error::{self, ModelError, finite, not_below_zero, positive};
use crate::handle::{BodyId, JointId};
use crate::math::{Mat3, Quat, Vec3, tangents};
use crate::motion::Profile;
use crate::world::World;
use serde::{Deserialize, Serialize};

pub use pair::Pair;

/// What a joint holds. Points and axes in the world, where the bodies are when the joint is added.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum JointKind {
    /// A point, and mostly an axis, of A and B: a hinge, a slide, a ball in a socket.
    Pair {
        /// What it holds of them.
        pair: Pair,
        /// A point of the axis, m.
        point: Vec3,
        /// Direction of the axis, any length; of no account for pairs without ([`Pair::has_axis`]).
        axis: Vec3,
        /// What motors, springs and limits act on, where the pair has it; else its own.
        coordinate: Coordinate,
    },
    /// A rod without mass between two points; with limits alone a rope, with a spring a spring, with a motor
    /// an actuator.
    Distance {
        /// Its ends on A and on B, m.
        ends: [Vec3; 2],
    },
    /// Coordinate of the second joint = ratio x coordinate of the first + a constant: gears (ratio negative
    /// where they turn against each other), a rack and its pinion (ratio in m/rad). Its bodies are those of
    /// both joints.
    Gear {
        /// The two joints, each with a coordinate.
        joints: [JointId; 2],
        /// ds_2 / ds_1.
        ratio: f64,
    },
}

/// What a pair may leave free.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Coordinate {
    /// The angle about the axis.
    #[default]
    Turn,
    /// The way along it.
    Slide,
}

/// What drives the coordinate of a joint: the force (N; torque, N m, on angles) on B along it, and the other
/// way on A.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Motor {
    /// Keeps a speed (m/s or rad/s) with whatever force that takes, up to a limit where there is one. Speed 0
    /// with a limit is dry friction in the joint.
    Speed {
        /// Speed as a function of time; steps take its mean.
        speed: Profile,
        /// Largest force, N or N m, not negative.
        limit: Option<Profile>,
    },
    /// Exerts this force (N or N m).
    Force(Profile),
}

/// A linear spring with a damper: force -k (s - rest) - c ds/dt on B along the coordinate. Stable for any
/// step: the spring takes the mean (s- + 2 s + s+) / 4 over three steps, which keeps its energy, unless it
/// vibrates faster than 1 rad per step: then it is damped; the damper the rate at the end of the step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spring {
    /// k, N/m or N m/rad, not negative.
    pub stiffness: f64,
    /// c, N s/m or N m s/rad, not negative.
    pub damping: f64,
    /// Coordinate without force, m or rad, as a function of time; `None`: where the joint is when it is
    /// added.
    pub rest: Option<Profile>,
}

/// Stops: the coordinate stays between these, as a bar of rope or a door does. Without rebound.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Smallest coordinate, m or rad.
    pub lower: Option<f64>,
    /// Largest coordinate.
    pub upper: Option<f64>,
}

impl Limits {
    /// Which of them a coordinate is beyond by more than this: -1 the lower, 1 the upper, 0 none.
    fn met_at(self, coordinate: f64, beyond: f64) -> i8 {
        if self.lower.is_some_and(|lower| coordinate < lower - beyond) {
            -1
        } else {
            i8::from(self.upper.is_some_and(|upper| coordinate > upper + beyond))
        }
    }
}

/// A joint to be added to a world. Angles and slides are zero where it is added; distances are what they are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Joint {
    /// Name; may be empty.
    pub name: String,
    /// Bodies A and B; `None` for A or B is the world. A gear has none.
    pub bodies: [Option<BodyId>; 2],
    /// What it holds.
    pub kind: JointKind,
    /// What drives it.
    pub motor: Option<Motor>,
    /// Its spring and damper.
    pub spring: Option<Spring>,
    /// Its stops.
    pub limits: Option<Limits>,
    /// Whether its two bodies collide with each other.
    pub collide: bool,
}

impl Joint {
    /// Whether a motor without a limit moves it, whatever force that takes.
    pub(crate) fn is_driven(&self) -> bool {
        matches!(self.motor, Some(Motor::Speed { limit: None, .. }))
    }

    /// A joint of this kind between two bodies, or a body and the world, without motor, spring or limits.
    pub fn new(bodies: [Option<BodyId>; 2], kind: JointKind) -> Self {
        Self { name: String::new(), bodies, kind, motor: None, spring: None, limits: None, collide: false }
    }

    /// A pair at a point, with this axis.
    pub fn pair(pair: Pair, a: Option<BodyId>, b: BodyId, (point, axis): (Vec3, Vec3)) -> Self {
        Self::new([a, Some(b)], JointKind::Pair { pair, point, axis, coordinate: Coordinate::default() })
    }

    /// Makes two bodies one.
    pub fn fixed(a: Option<BodyId>, b: BodyId, point: Vec3) -> Self {
        Self::pair(Pair::Fixed, a, b, (point, Vec3::Z))
    }

    /// A hinge about an axis through a point.
    pub fn revolute(a: Option<BodyId>, b: BodyId, point: Vec3, axis: Vec3) -> Self {
        Self::pair(Pair::Revolute, a, b, (point, axis))
    }

    /// A slide along an axis through a point.
    pub fn prismatic(a: Option<BodyId>, b: BodyId, point: Vec3, axis: Vec3) -> Self {
        Self::pair(Pair::Prismatic, a, b, (point, axis))
    }

    /// A ball and socket.
    pub fn spherical(a: Option<BodyId>, b: BodyId, point: Vec3) -> Self {
        Self::pair(Pair::Spherical, a, b, (point, Vec3::Z))
    }

    /// A rod between a point of A and a point of B.
    pub fn distance(a: Option<BodyId>, b: BodyId, ends: [Vec3; 2]) -> Self {
        Self::new([a, Some(b)], JointKind::Distance { ends })
    }

    /// Gears between two joints.
    pub fn gear(joints: [JointId; 2], ratio: f64) -> Self {
        Self::new([None, None], JointKind::Gear { joints, ratio })
    }

    /// The same with a name.
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        Self { name: name.to_string(), ..self }
    }

    /// The same with a motor.
    #[must_use]
    pub fn with_motor(self, motor: Motor) -> Self {
        Self { motor: Some(motor), ..self }
    }

    /// The same with a spring and damper.
    #[must_use]
    pub fn with_spring(self, stiffness: f64, damping: f64) -> Self {
        Self { spring: Some(Spring { stiffness, damping, rest: None }), ..self }
    }

    /// The same with stops.
    #[must_use]
    pub fn with_limits(self, lower: Option<f64>, upper: Option<f64>) -> Self {
        Self { limits: Some(Limits { lower, upper }), ..self }
    }

    /// How messages call it.
    fn label(&self, index: usize) -> String {
        if self.name.is_empty() { format!("joint {index}") } else { format!("joint '{}'", self.name) }
    }

    /// Whether it has a coordinate on which motors, springs and limits act.
    fn has_coordinate(&self) -> bool {
        match self.kind {
            JointKind::Pair { pair, .. } => !pair.coordinates().is_empty(),
            JointKind::Distance { .. } => true,
            JointKind::Gear { .. } => false,
        }
    }

    /// Point and axes (columns: two across, and the axis) on A and on B, in the world.
    fn places(&self) -> [(Vec3, Quat); 2] {
        let along = |axis: Vec3| {
            let axis = axis.normalize();
            let (t1, t2) = tangents(axis);
            Quat::from_mat3(&Mat3::from_cols(t1, t2, axis)).normalize()
        };
        match self.kind {
            JointKind::Pair { pair, point, axis, .. } => {
                [(point, if pair.has_axis() { along(axis) } else { Quat::IDENTITY }); 2]
            }
            JointKind::Distance { ends } => ends.map(|end| (end, Quat::IDENTITY)),
            JointKind::Gear { .. } => [(Vec3::ZERO, Quat::IDENTITY); 2],
        }
    }

    fn validate(&self, label: &str, world: &World, index: usize) -> Result<(), ModelError> {
        let refuse = |what: String| Err(ModelError::Joint { joint: label.to_string(), what });
        let bodies = self.bodies.iter().flatten();
        bodies.clone().try_for_each(|body| error::index("body", body.index(), world.bodies.len()))?;
        if let JointKind::Gear { joints, ratio } = &self.kind {
            joints.iter().try_for_each(|joint| error::index("joint before it", joint.index(), index))?;
            if joints[0] == joints[1] {
                return refuse("it couples a joint with itself; name two joints".to_string());
            }
            if let Some(other) =
                joints.iter().find(|joint| !world.joints[joint.index()].joint.has_coordinate())
            {
                let other = world.joints[other.index()].joint.label(other.index());
                return refuse(format!("{other} has no angle or slide that a gear could couple"));
            }
            if !(ratio.is_finite() && *ratio != 0.0) {
                let what = format!("the ratio of {label}");
                return Err(ModelError::Value { what, value: *ratio, expected: "finite and not zero" });
            }
        } else {
            match self.bodies {
                [None, None] => return refuse("it names no body".to_string()),
                [a, b] if a == b => return refuse("both its bodies are the same; name two".to_string()),
                _ => {}
            }
        }
        if let JointKind::Pair { pair, point, axis, .. } = &self.kind {
            finite(&format!("the point or axis of {label}"), &[point.to_array(), axis.to_array()].concat())?;
            if pair.has_axis() && axis.length() < 1e-12 {
                return refuse("its axis has no direction; give one that is not zero".to_string());
            }
        }
        if let JointKind::Distance { ends } = &self.kind {
            finite(&format!("an end of {label}"), &[ends[0].to_array(), ends[1].to_array()].concat())?;
            if (ends[1] - ends[0]).length() < 1e-12 {
                return refuse("both its ends are in one place; use a spherical joint for that".to_string());
            }
        }
        self.validate_drive(label)
    }

    fn validate_drive(&self, label: &str) -> Result<(), ModelError> {
        let drives = self.motor.is_some() || self.spring.is_some() || self.limits.is_some();
        if drives && !self.has_coordinate() {
            let what = "it has no single angle or slide for a motor, a spring or limits".to_string();
            return Err(ModelError::Joint { joint: label.to_string(), what });
        }
        match &self.motor {
            Some(Motor::Speed { speed, limit }) => {
                speed.validate()?;
                if let Some(limit) = limit {
                    limit.validate()?;
                    if let Profile::Constant(value) = limit
                        && *value < 0.0
                    {
                        let what = format!("the limit of the motor of {label}");
                        return Err(ModelError::Value { what, value: *value, expected: "not negative" });
                    }
                }
            }
            Some(Motor::Force(force)) => force.validate()?,
            None => {}
        }
        if let Some(Spring { stiffness, damping, rest }) = &self.spring {
            for (name, value) in [("stiffness", *stiffness), ("damping", *damping)] {
                not_below_zero(format!("the {name} of {label}"), value)?;
            }
            if *stiffness == 0.0 && *damping == 0.0 {
                positive(format!("stiffness or damping of {label}"), 0.0)?;
            }
            rest.iter().try_for_each(Profile::validate)?;
        }
        if let Some(Limits { lower, upper }) = self.limits {
            finite(&format!("a limit of {label}"), &lower.into_iter().chain(upper).collect::<Vec<_>>())?;
            if let (Some(lower), Some(upper)) = (lower, upper)
                && lower >= upper
            {
                let what = format!("its lower limit {lower} is not below its upper limit {upper}");
                return Err(ModelError::Joint { joint: label.to_string(), what });
            }
        }
        Ok(())
    }
}

/// A joint outside its limits would be thrown back to them in the first step.
fn within_limits(placed: &PlacedJoint) -> Result<(), String> {
    let Some(Limits { lower, upper }) = placed.joint.limits else { return Ok(()) };
    // Poses are rounded.
    let (start, slack) = (placed.start, 1e-9 * placed.start.abs().max(1.0));
    let outside =
        lower.filter(|&lower| start < lower - slack).or(upper.filter(|&upper| start > upper + slack));
    outside.map_or(Ok(()), |limit| Err(format!("it starts at {start}, beyond its limit {limit}")))
}

/// What a joint did in the last step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointState {
    /// Coordinate, m or rad; angles count whole turns. Of a gear the second joint's less ratio times the
    /// first's.
    pub coordinate: f64,
    /// Its rate in the last step, m/s or rad/s.
    pub rate: f64,
    /// Force on B at the joint's point (that on B) in the last step, world axes, N, of all rows: motor and
    /// spring included. Zero, as torque and drive, where nothing bounds it, in a step that did not converge.
    pub force: Vec3,
    /// Torque on B about that point, N m.
    pub torque: Vec3,
    /// Force of motor, spring and limits along the coordinate, N or N m; of a gear that on the second joint.
    pub drive: f64,
    /// How far it is open at the end of the step, m: the largest value of the rows that it holds and the way
    /// beyond its limits, angles times the joint's length (the longer of its arms and its bodies' radii of
    /// gyration); and the way that other joints kept a motor without a limit from making, where that is far.
    pub opening: f64,
    /// Whether the motor was at its limit: sign of the force.
    pub(crate) saturated: i8,
    /// Which limit held: -1 the lower, 1 the upper.
    pub(crate) stopped: i8,
}

impl JointState {
    /// What motor and stops were doing, as a number.
    pub(crate) fn switches(&self) -> u64 {
        (3 * (i64::from(self.saturated) + 1) + i64::from(self.stopped) + 1) as u64
    }
}

/// A joint of a world, with its places on both bodies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlacedJoint {
    /// What was added.
    pub joint: Joint,
    /// What it did last.
    pub state: JointState,
    /// Point, m, and axes on A and on B, in body axes from the centre of mass (or of the world).
    pub(crate) places: [(Vec3, Quat); 2],
    /// Coordinate when it was added.
    pub(crate) start: f64,
}

impl World {
    /// Adds a joint, which holds from the next step on, where its bodies are now. Angle and slide are zero
    /// here.
    ///
    /// # Errors
    /// [`ModelError`] for bodies that do not exist or cannot move, an axis without direction, a motor, spring
    /// or limits that the kind of joint has no coordinate for, or a number out of its range.
    pub fn add_joint(&mut self, joint: Joint) -> Result<JointId, ModelError> {
        let index = self.joints.len();
        joint.validate(&joint.label(index), self, index)?;
        // A later stage may hold them, but a joint that never does anything is a slip.
        let mut held = joint.bodies.iter().flatten();
        if joint.bodies != [None, None] && held.all(|body| self.is_prescribed(body.index())) {
            let what = "nothing it holds can move: all its bodies are fixed or wholly driven; `free` a degree of freedom";
            return Err(ModelError::Joint { joint: joint.label(index), what: what.to_string() });
        }
        let bodies = &self.bodies;
        let mut places = joint.places();
        for (place, body) in places.iter_mut().zip(joint.bodies) {
            if let Some(body) = body.map(BodyId::index) {
                let turn = bodies.orientation[body].conjugate();
                *place = (turn * (place.0 - bodies.position[body]), (turn * place.1).normalize());
            }
        }
        let mut placed = PlacedJoint { joint, state: JointState::default(), places, start: 0.0 };
        self.joints.push(placed.clone());
        let start = kinematics::coordinate(
            &self.joints,
            index,
            &|body| self.pose(body),
            &kinematics::last(&self.joints),
        );
        placed.start = start.map_or(0.0, |start| start.value);
        placed.state.coordinate = placed.start;
        if let Err(what) = within_limits(&placed) {
            let joint = placed.joint.label(index);
            self.joints.pop();
            return Err(ModelError::Joint { joint, what });
        }
        self.joints[index] = placed;
        Ok(JointId::from_index(index))
    }

    /// The joints, with what they did in the last step.
    pub fn joints(&self) -> &[PlacedJoint] {
        &self.joints
    }

    /// How messages call a joint.
    pub fn joint_label(&self, joint: usize) -> String {
        self.joints[joint].joint.label(joint)
    }

    /// Replaces the motor of a joint.
    ///
    /// # Errors
    /// As [`Self::add_joint`].
    pub fn set_motor(&mut self, joint: JointId, motor: Option<Motor>) -> Result<(), ModelError> {
        let index = joint.index();
        error::index("joint", index, self.joints.len())?;
        let changed = Joint { motor, ..self.joints[index].joint.clone() };
        changed.validate_drive(&changed.label(index))?;
        self.joints[index].joint = changed;
        Ok(())
    }

    /// Where a body is.
    pub(crate) fn pose(&self, body: usize) -> (Vec3, Quat) {
        (self.bodies.position[body], self.bodies.orientation[body])
    }

    /// About what coordinates joints have after a step in which they did this: however far they turn in it,
    /// within half a turn.
    pub(crate) fn expected_coordinates(
        &self,
        states: &[JointState],
        step: f64,
    ) -> impl Fn(usize) -> f64 + use<> {
        let last = self.joints.iter().map(|placed| placed.state.coordinate);
        let rates = states.iter().map(|state| state.rate).chain(std::iter::repeat(0.0));
        let expected: Vec<f64> = last.zip(rates).map(|(last, rate)| last + step * rate).collect();
        move |joint| expected[joint]
    }

    /// Takes over what joints did in a step, with the coordinates that bodies have now.
    pub(crate) fn record_joints(&mut self, states: &[JointState], step: f64) {
        let near = self.expected_coordinates(states, step);
        for (index, state) in states.iter().enumerate() {
            let along = kinematics::coordinate(&self.joints, index, &|body| self.pose(body), &near);
            let before = self.joints[index].state.coordinate;
            let strayed =
                along.as_ref().map_or(0.0, |along| drift::strayed(self, index, along, [before, near(index)]));
            let opening = drift::opening(self, index, &near).max(strayed);
            self.joints[index].state =
                JointState { coordinate: along.map_or(before, |along| along.value), opening, ..*state };
        }
    }

    /// Checks joints that were read from somewhere.
    pub(crate) fn validate_joints(&self) -> Result<(), ModelError> {
        for (index, placed) in self.joints.iter().enumerate() {
            placed.joint.validate(&placed.joint.label(index), self, index)?;
            for (point, frame) in placed.places {
                finite("a place of a joint", &point.to_array())?;
                crate::shape::unit_quaternion("the axes of a joint", frame)?;
            }
            let JointState { coordinate, rate, force, torque, drive, .. } = placed.state;
            finite("the coordinate of a joint", &[coordinate, rate, drive, placed.start])?;
            finite("the reaction of a joint", &[force.to_array(), torque.to_array()].concat())?;
        }
        Ok(())
    }

    /// Removes the joints of bodies that are gone, and gears of joints that are; the others follow their
    /// bodies.
    pub(crate) fn keep_joints(&mut self, new_index: &[Option<BodyId>]) {
        let mut kept: Vec<Option<JointId>> = Vec::new();
        for mut placed in std::mem::take(&mut self.joints) {
            let moved = placed.joint.bodies.map(|body| body.map(|body| new_index[body.index()]));
            let mut stays = moved.iter().flatten().all(Option::is_some);
            placed.joint.bodies = moved.map(Option::flatten);
            if let JointKind::Gear { joints, .. } = &mut placed.joint.kind {
                let new = joints.map(|joint| kept[joint.index()]);
                stays = new.iter().all(Option::is_some);
                *joints = std::array::from_fn(|k| new[k].unwrap_or(joints[k]));
            }
            kept.push(stays.then(|| JointId::from_index(self.joints.len())));
            if stays {
                self.joints.push(placed);
            }
        }
    }
}
