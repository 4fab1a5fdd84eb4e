//! Motors with a limit and stops as contacts without friction, in one problem with those of bodies.
//!
//! A motor of the limit L that wants the rate w of its coordinate s exerts f = L - p with p in [0, 2 L]: all
//! that it can, less what a clutch takes, whose disc turns at x,
//!
//! ```text
//! 0 <= p perpendicular to x - s' >= 0,      0 <= q perpendicular to x - w >= 0,      m (x - w) = p + q - 2 L
//! ```
//!
//! with impulses for forces. As long as q > 0 the disc turns at w and holds s' there, p < 2 L; where it is
//! drawn along, p = 2 L but for its mass m. A row that holds s' = w knows no limit, and where it presses
//! rigid bodies together such a problem has no solution; with clutches there is one, whatever bodies touch.
//! What it says of motors and stops is then held as rows, as exact as joints are.

use super::{Mechanism, Mechanisms, Role};
use crate::joint::kinematics::{Row, coordinate, last};
use crate::joint::{Limits, Motor};
use graintrain_ccp::{BodyInverseMass, Ccp, CoupledBodies, Delassus, FIXED, RigidContact, RigidDelassus};
use std::sync::Arc;

/// The disc of a motor that its load draws along is that much faster than all other rates, at the most: by
/// one over that the force of the motor is beyond its limit then.
const FASTEST: f64 = 1e3;

/// A coordinate, in metres, that has to stay below a rate.
pub(crate) struct Bound {
    mechanism: usize,
    joint: usize,
    /// Of a stop the side, of a motor 0.
    side: i8,
    row: Row,
    /// m/s.
    rate: f64,
    /// 2 L, N s.
    slips: f64,
    /// The impulse p to start from, N s.
    start: f64,
}

impl Mechanisms<'_> {
    fn limit(&self, joint: usize) -> Option<f64> {
        match &self.world.joints[joint].joint.motor {
            Some(Motor::Speed { limit: Some(limit), .. }) => Some(self.step * self.mean(limit).max(0.0)),
            _ => None,
        }
    }

    /// Whether a motor with a limit is a row.
    fn is_held(&self, mechanism: &Mechanism) -> bool {
        mechanism.rows.iter().any(|row| row.role == Role::Motor && self.limit(row.joint).is_some())
    }

    /// Lets go the stops of mechanisms where a motor with a limit is a row, or that are undecided, and makes
    /// of these motors what they can do at the most: returned is what bounds them. They start from these
    /// contact impulses.
    pub(crate) fn loosen(&mut self, impulse: &[f64]) -> Vec<Bound> {
        let mut bounds = Vec::new();
        for index in 0..self.mechanisms.len() {
            let mechanism = &self.mechanisms[index];
            if !(self.is_held(mechanism) || mechanism.is_undecided) {
                continue;
            }
            let solution = self.solve(mechanism, impulse);
            let exerts = |joint: usize, role: Role| {
                let of = mechanism.rows.iter().zip(&solution.impulse);
                of.filter(|(row, _)| row.joint == joint && row.role == role).map(|(_, f)| *f).sum::<f64>()
            };
            let joints = mechanism.joints.clone();
            for &joint in &joints {
                let forces = [Role::Motor, Role::Stop].map(|role| exerts(joint, role));
                bounds.extend(self.bounds_of(index, joint, forces));
            }
            for joint in joints {
                let saturated = self.limit(joint).map_or(0, |_| 1);
                let state = &mut self.states[joint];
                (state.saturated, state.stopped) = (saturated, 0);
            }
            self.rearrange(index);
        }
        bounds
    }

    /// The bounds of a joint whose motor and stop, where they are rows, exert these impulses.
    fn bounds_of(&self, mechanism: usize, joint: usize, [motor, stop]: [f64; 2]) -> Vec<Bound> {
        let (joints, own) = (&self.world.joints, &self.world.joints[joint].joint);
        let Some(along) = coordinate(joints, joint, &|body| self.world.pose(body), &last(joints)) else {
            return Vec::new();
        };
        let length = if along.angular { self.lengths[joint] } else { 1.0 };
        let bound = |side: i8, sign: f64, rate: f64, [slips, start]: [f64; 2]| {
            let (rate, slips, start) = (rate * length, slips / length, start / length);
            Bound { mechanism, joint, side, row: along.clone().times(sign * length), rate, slips, start }
        };
        let mut bounds = Vec::new();
        if let (Some(most), Some(Motor::Speed { speed, .. })) = (self.limit(joint), &own.motor) {
            let now = motor + f64::from(self.states[joint].saturated) * most;
            let start = (most - now).clamp(0.0, 2.0 * most);
            bounds.push(bound(0, 1.0, self.mean(speed), [2.0 * most, start]));
        }
        let Limits { lower, upper } = own.limits.unwrap_or_default();
        for (side, _) in [(-1, lower), (1, upper)].into_iter().filter(|(_, at)| at.is_some()) {
            let (sign, room) = (f64::from(side), self.room(joint, side, along.value));
            bounds.push(bound(side, sign, room / self.step, [0.0, (-sign * stop).max(0.0)]));
        }
        bounds
    }

    /// A contact problem with those of these bounds after its own contacts, and impulses of them to start
    /// from: p, of a body whose velocity is the rate of the row, and of motors q of the disc.
    pub(crate) fn bounded(&self, problem: &Ccp, free: &[f64], bounds: &[Bound]) -> Option<(Ccp, Vec<f64>)> {
        let Delassus::Rigid(rigid) = &*problem.delassus else { return None };
        let (mut all, mut start) = (problem.clone(), Vec::new());
        let (mut rows, mut masses) = (rigid.contacts().to_vec(), rigid.inverse_mass().to_vec());
        let mut coupled = rigid.coupled().to_vec();
        // Rates as they are without what motors push.
        let rates = bounds.iter().flat_map(|bound| [bound.rate, bound.row.rate(&self.free)]);
        let fastest = rates.fold(self.scale, |fastest, rate| fastest.max(rate.abs()));
        all.velocity_scale = Some(all.velocity_scale.unwrap_or(0.0).max(fastest));
        for bound in bounds {
            let mobility = follow(&mut coupled[bound.mechanism], masses.len() as u32, &bound.row);
            let (body, own) = (masses.len() as u32, bound.rate - bound.row.rate(free));
            let is_motor = bound.side == 0;
            let disc = if is_motor { body + 1 } else { FIXED };
            // Of the mass of what it brakes, if that can move, and so heavy that what draws it along does not
            // hide the rest.
            let light = if mobility > 0.0 { mobility } else { 1.0 };
            let drawn = (bound.slips * light).min(FASTEST * fastest);
            let light = if bound.slips > 0.0 { drawn / bound.slips } else { light };
            let inverse = |linear: f64| BodyInverseMass { linear: [linear, 0.0, 0.0], angular: [0.0; 9] };
            masses.extend([inverse(0.0), inverse(light)]);
            let slips = (disc, FIXED, -drawn, bound.slips - bound.start);
            let pair = [(disc, body, own - drawn, bound.start), slips];
            for (body_a, body_b, r, first) in pair.into_iter().take(1 + usize::from(is_motor)) {
                let at = 3 * rows.len();
                let (frame, none) = ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0; 3]);
                rows.push(RigidContact { body_a, body_b, frame, arm_a: none, arm_b: none });
                all.r.splice(at..at, [r, 0.0, 0.0]);
                all.friction.push(0.0);
                all.points.push(none);
                all.identity.push(u64::MAX - at as u64);
                start.extend([first.max(0.0), 0.0, 0.0]);
            }
        }
        let mut compliance = rigid.compliance().to_vec();
        if !compliance.is_empty() {
            compliance.resize(rows.len(), 0.0);
        }
        let turning = rigid.turning().to_vec();
        let rigid = RigidDelassus::new(rows, masses).with_turning(turning).with_coupled(coupled);
        all.delassus = Arc::new(Delassus::Rigid(rigid.with_compliance(compliance)));
        Some((all, start))
    }

    /// Takes motors and stops for what they are in this problem, whose contacts from `at` on are those of
    /// their bounds, with these impulses: of a contact that is solved to a tolerance the impulse or the
    /// velocity is the larger part.
    pub(crate) fn hold(&mut self, bounds: &[Bound], (problem, at): (&Ccp, usize), impulse: &[f64]) {
        let mut u = vec![0.0; impulse.len()];
        problem.delassus.multiply(impulse, &mut u, &mut problem.delassus.work());
        let Delassus::Rigid(rigid) = &*problem.delassus else { return };
        let acts = |k: usize| rigid.diagonal()[k][0] * impulse[3 * k] > u[3 * k] + problem.r[3 * k];
        let mut acts = (at..).map(acts);
        for bound in bounds {
            let (state, p) = (&mut self.states[bound.joint], acts.next().unwrap_or(false));
            if bound.side == 0 {
                let q = acts.next().unwrap_or(false);
                state.saturated = if p { -i8::from(!q) } else { 1 };
            } else if p {
                state.stopped = bound.side;
            }
        }
        let mut touched: Vec<usize> = bounds.iter().map(|bound| bound.mechanism).collect();
        touched.dedup();
        for index in touched {
            self.mechanisms[index].is_straight = false;
            self.rearrange(index);
        }
    }
}

/// Takes a body into a group whose velocity along x is the rate of this row; returned is its mobility, 1/kg.
fn follow(group: &mut CoupledBodies, body: u32, row: &Row) -> f64 {
    let mut rate = vec![0.0; 6 * group.degrees];
    for (own, [linear, angular]) in &row.ends {
        let Ok(place) = group.bodies.binary_search(&(*own as u32)) else { continue };
        for (axis, x) in linear.to_array().into_iter().chain(angular.to_array()).enumerate() {
            let motion = &group.factor[(6 * place + axis) * group.degrees..];
            rate.iter_mut().zip(&motion[..group.degrees]).for_each(|(rate, y)| *rate += x * y);
        }
    }
    let mobility = rate.iter().map(|y| y * y).sum();
    group.bodies.push(body);
    group.factor.extend(rate);
    mobility
}
