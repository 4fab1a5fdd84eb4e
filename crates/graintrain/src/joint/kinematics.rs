//! Values of the rows of joints and their derivatives.
//!
//! With a place on each body (x_A, x_B; axes t1, t2, a that turn with it) and d = x_B - x_A, rows are
//!
//! ```text
//! translation along an axis n of A:  n . d,            d/dt = n . (u_B + w_B x r_B) - n . (u_A + w_A x (r_A + d))
//! axes b of B and n of A square:     b . n,            d/dt = (w_B - w_A) . (b x n)
//! distance:                          |d|
//! angle:                             atan2(t1_B . t2_A, t1_B . t1_A) + whole turns
//! ```
//!
//! Forces of a translation row act on both bodies in one point, x_B: they make no torque of their own. Those
//! of a distance act at its ends.

use super::{Coordinate, JointKind, PlacedJoint};
use crate::math::{Quat, Vec3, tangents};
use graintrain_linalg::real;
use std::f64::consts::TAU;

/// Where the body of this index is.
pub(crate) type Poses<'a> = dyn Fn(usize) -> (Vec3, Quat) + 'a;

/// About what angle a joint is expected to have, rad.
pub(crate) type Near<'a> = dyn Fn(usize) -> f64 + 'a;

/// A scalar function of the places of bodies with its derivative.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    /// m, or rad.
    pub value: f64,
    /// Bodies with the derivatives by their translation and rotation. A body may be named twice.
    pub ends: Vec<(usize, [Vec3; 2])>,
    /// Whether the value is an angle.
    pub angular: bool,
}

impl Row {
    /// Sum of the derivatives over these velocities (six numbers per body).
    pub(crate) fn rate(&self, velocity: &[f64]) -> f64 {
        self.rate_of(|body| &velocity[6 * body..6 * body + 6])
    }

    /// The same with the velocity of a body given by a function.
    pub(crate) fn rate_of<'v>(&self, velocity: impl Fn(usize) -> &'v [f64]) -> f64 {
        self.ends
            .iter()
            .map(|(body, [linear, angular])| {
                let v = velocity(*body);
                linear.dot(Vec3::from_slice(&v[..3])) + angular.dot(Vec3::from_slice(&v[3..]))
            })
            .sum()
    }

    /// This row times a factor.
    pub(crate) fn times(mut self, factor: f64) -> Self {
        self.value *= factor;
        for (_, parts) in &mut self.ends {
            *parts = parts.map(|part| factor * part);
        }
        self
    }
}

/// The places of a joint in the world.
pub(crate) struct Placed {
    bodies: [Option<usize>; 2],
    /// x_A and x_B, m.
    points: [Vec3; 2],
    /// From the centres of both bodies to where forces act on them, m: x_B, but on the A of a distance x_A.
    arms: [Vec3; 2],
    /// Columns t1, t2, a of A and of B.
    frames: [[Vec3; 3]; 2],
}

impl Placed {
    pub(crate) fn of(placed: &PlacedJoint, poses: &Poses) -> Self {
        let bodies = placed.joint.bodies.map(|body| body.map(|body| body.index()));
        let world = |k: usize| {
            let (point, frame) = placed.places[k];
            match bodies[k] {
                Some(body) => {
                    let (position, orientation) = poses(body);
                    (position + orientation * point, orientation * frame, position)
                }
                None => (point, frame, Vec3::ZERO),
            }
        };
        let [a, b] = [world(0), world(1)];
        // A rod draws at its own end; all else is one point on both.
        let at = if matches!(placed.joint.kind, JointKind::Distance { .. }) { a.0 } else { b.0 };
        Self {
            bodies,
            points: [a.0, b.0],
            arms: [at - a.2, b.0 - b.2],
            frames: [a.1, b.1].map(|frame| [frame * Vec3::X, frame * Vec3::Y, frame * Vec3::Z]),
        }
    }

    /// Force on B and its torque about x_B of a unit of a row of this joint, which is no gear.
    pub(crate) fn wrench(&self, row: &Row) -> [Vec3; 2] {
        let (sign, arm) = if self.bodies[1].is_some() { (1.0, self.arms[1]) } else { (-1.0, self.arms[0]) };
        let Some((_, [force, moment])) = row.ends.last() else { return [Vec3::ZERO; 2] };
        [sign * *force, sign * (*moment - arm.cross(*force))]
    }

    /// Bodies with the force on each and its arm, of this force on B.
    pub(crate) fn forces(&self, force: Vec3) -> impl Iterator<Item = (usize, Vec3, Vec3)> + '_ {
        let both = self.bodies.into_iter().zip(self.arms).zip([-force, force]);
        both.filter_map(|((body, arm), force)| Some((body?, arm, force)))
    }

    fn row(&self, value: f64, linear: Vec3, turns: [Vec3; 2], angular: bool) -> Row {
        let ends = [(self.bodies[0], [-linear, -turns[0]]), (self.bodies[1], [linear, turns[1]])];
        let ends = ends.into_iter().filter_map(|(body, parts)| Some((body?, parts))).collect();
        Row { value, ends, angular }
    }

    fn translation(&self, along: Vec3) -> Row {
        let value = along.dot(self.points[1] - self.points[0]);
        self.row(value, along, self.arms.map(|arm| arm.cross(along)), false)
    }

    fn turn(&self, value: f64, about: Vec3) -> Row {
        self.row(value, Vec3::ZERO, [about; 2], true)
    }

    fn dot(&self, of_b: usize, of_a: usize) -> Row {
        let (b, a) = (self.frames[1][of_b], self.frames[0][of_a]);
        self.turn(b.dot(a), b.cross(a))
    }

    fn distance(&self) -> Row {
        let d = self.points[1] - self.points[0];
        let length = d.length();
        let along = if length > 0.0 { d / length } else { Vec3::X };
        Row { value: length, ..self.translation(along) }
    }

    /// By how much this force on B draws it to A, N.
    pub(crate) fn tension(&self, force: Vec3) -> f64 {
        -force.dot((self.points[1] - self.points[0]).normalize_or_zero())
    }

    /// By how much this force on B draws at the arms of both bodies and at the rod between them, N m.
    pub(crate) fn pull(&self, force: Vec3) -> f64 {
        let arms = self.forces(force).map(|(_, arm, force)| arm.dot(force).max(0.0)).sum::<f64>();
        arms + (self.points[0] - self.points[1]).dot(force).max(0.0)
    }

    /// The distance and the two rows across it: how fast one end passes the other.
    pub(crate) fn across(&self) -> (f64, [Row; 2]) {
        let d = self.points[1] - self.points[0];
        let length = d.length();
        let directions = if length > 0.0 { tangents(d / length) } else { (Vec3::Y, Vec3::Z) };
        (length, [self.translation(directions.0), self.translation(directions.1)])
    }

    fn angle(&self, near: f64) -> Row {
        let [[t1, t2, axis], [b, ..]] = self.frames;
        let principal = real::atan2(b.dot(t2), b.dot(t1));
        let value = principal + TAU * ((near - principal) / TAU).round();
        self.turn(value, axis)
    }
}

/// The coordinates that joints had at the end of the last step.
pub(crate) fn last(joints: &[PlacedJoint]) -> impl Fn(usize) -> f64 + '_ {
    |joint| joints[joint].state.coordinate
}

/// The rows that a joint holds at zero. A distance and a gear hold theirs at [`PlacedJoint::start`]; angles
/// are those within half a turn of what `near` says of their joints.
pub(crate) fn held(joints: &[PlacedJoint], joint: usize, poses: &Poses, near: &Near) -> Vec<Row> {
    let own = &joints[joint];
    if let JointKind::Gear { .. } = own.joint.kind {
        let row = coordinate(joints, joint, poses, near);
        return row.map(|row| Row { value: row.value - own.start, ..row }).into_iter().collect();
    }
    let placed = Placed::of(own, poses);
    match own.joint.kind {
        JointKind::Pair { pair, .. } => {
            let along = pair.held_along().iter().map(|&axis| placed.translation(placed.frames[0][axis]));
            let square = pair.held_square().iter().map(|&[of_b, of_a]| placed.dot(of_b, of_a));
            along.chain(square).collect()
        }
        JointKind::Distance { .. } => {
            let joint = &own.joint;
            let is_rod = joint.motor.is_none() && joint.spring.is_none() && joint.limits.is_none();
            let row = placed.distance();
            is_rod.then_some(Row { value: row.value - own.start, ..row }).into_iter().collect()
        }
        JointKind::Gear { .. } => Vec::new(),
    }
}

/// The coordinate of a joint, if it has one, with angles within half a turn of what `near` says of their
/// joints.
pub(crate) fn coordinate(joints: &[PlacedJoint], joint: usize, poses: &Poses, near: &Near) -> Option<Row> {
    let own = &joints[joint];
    let placed = || Placed::of(own, poses);
    match &own.joint.kind {
        JointKind::Pair { pair, coordinate, .. } => Some(match pair.coordinate(*coordinate)? {
            Coordinate::Turn => placed().angle(near(joint)),
            Coordinate::Slide => {
                let placed = placed();
                placed.translation(placed.frames[0][2])
            }
        }),
        JointKind::Distance { .. } => Some(placed().distance()),
        JointKind::Gear { joints: pair, ratio } => {
            let [first, second] = pair.map(|other| coordinate(joints, other.index(), poses, near));
            let (first, second) = (first?.times(-ratio), second?);
            let angular = second.angular;
            let ends = first.ends.into_iter().chain(second.ends).collect();
            Some(Row { value: first.value + second.value, ends, angular })
        }
    }
}
