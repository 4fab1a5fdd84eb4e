//! What motors with a limit and stops do, and the corrections that keep bodies on the paths of their joints:
//! round by round, until all agree.

use super::{ActiveRow, Mechanisms, Role, Solution};
use crate::joint::kinematics::{coordinate, last};
use crate::joint::{JointState, Motor};
use crate::math::Vec3;

/// Corrections of the right-hand side, and changes of motors and stops, between two solves of the contacts.
const ROUNDS: usize = 60;

/// Corrections before motors and stops are looked at: the sign of the impulse of a new stop is that of rows
/// on their paths. Rows that contradict each other never get there.
const CORRECTIONS: usize = 6;

/// After so many changes motors and stops change one by one.
const TOGETHER: usize = 8;

/// Rates that joints are solved to between solves of the contacts, over the velocity scale.
const FINE: f64 = 1e-11;

/// Joints that open faster than this, over the velocity scale, after all corrections are stuck.
const STUCK: f64 = 1e-3;

/// Forces that differ by less than this share stiffen swings alike.
const SAME_FORCES: f64 = 0.1;

/// A motor that misses this fraction of its speed while a stop is active works against the stop.
const DRIVEN: f64 = 0.1;

/// A force beyond its limit, or a rate on the wrong side, counts from this fraction on.
const CLEAR: f64 = 1e-9;

/// What separates rounds: whether motors or stops changed, or targets.
#[derive(PartialEq)]
enum Change {
    Rows,
    Targets,
    None,
}

impl Mechanisms<'_> {
    /// The states of all joints with those changed whose motors and stops disagree with their forces or
    /// rates, of several the first alone where `one` is asked for; `None` where all agree.
    fn switched(&self, index: usize, solution: &Solution, one: bool) -> Option<Vec<JointState>> {
        let mechanism = &self.mechanisms[index];
        let world = self.world;
        let limited = |joint: &usize| {
            let own = &world.joints[*joint].joint;
            own.limits.is_some() || matches!(own.motor, Some(Motor::Speed { limit: Some(_), .. }))
        };
        if !mechanism.joints.iter().any(limited) {
            return None;
        }
        let poses = |body: usize| world.pose(body);
        let velocity = &solution.velocity;
        let (moved, near) = (self.moved(mechanism, velocity), self.near(mechanism, velocity));
        let is_stopped = mechanism.joints.iter().any(|&joint| self.states[joint].stopped != 0);
        let mut states = self.states.clone();
        for &joint in mechanism.joints.iter().filter(|joint| limited(joint)) {
            let own = &world.joints[joint].joint;
            let Some(along) = coordinate(&world.joints, joint, &poses, &last(&world.joints)) else {
                continue;
            };
            // As rows have it: that of the positions, not of the velocities.
            let end =
                coordinate(&world.joints, joint, &moved, &near).map_or(along.value, |after| after.value);
            let rate = (end - along.value) / self.step;
            let scale = self.scale / if along.angular { self.lengths[joint] } else { 1.0 };
            let of = |role: Role| {
                let own = |row: &ActiveRow| row.joint == joint && row.role == role;
                let place = mechanism.rows.iter().position(own)?;
                Some((&mechanism.rows[place], solution.impulse[place]))
            };
            let mut state = self.states[joint];
            if let Some(Motor::Speed { speed, limit: Some(limit) }) = &own.motor {
                let most = self.step * self.mean(limit).max(0.0);
                let wanted = self.mean(speed);
                match state.saturated {
                    0 => {
                        let (row, impulse) = of(Role::Motor).unzip();
                        let (impulse, target) = (impulse.unwrap_or(0.0), row.map_or(0.0, |row| row.target));
                        let missing =
                            target - along.rate_of(|body| self.velocity_of(mechanism, velocity, body));
                        if is_stopped && missing.abs() > (DRIVEN * wanted.abs()).max(CLEAR * scale) {
                            // Against a stop its row depends on that of the stop: it gets no rate at any
                            // force, and its own force says nothing.
                            state.saturated = if missing > 0.0 { 1 } else { -1 };
                        } else if impulse.abs() > most * (1.0 + CLEAR) {
                            state.saturated = if impulse > 0.0 { 1 } else { -1 };
                        }
                    }
                    side if f64::from(side) * (rate - wanted) > CLEAR * scale => state.saturated = 0,
                    _ => {}
                }
            }
            if let Some(limits) = own.limits {
                let beyond = CLEAR * scale * self.step;
                match state.stopped {
                    0 if limits.lower.is_some_and(|lower| end < lower - beyond) => state.stopped = -1,
                    0 if limits.upper.is_some_and(|upper| end > upper + beyond) => state.stopped = 1,
                    // What it changes of the rate of free bodies tells a pull from rounding.
                    side if of(Role::Stop).is_some_and(|(row, impulse)| {
                        f64::from(side) * impulse * row.norm * row.norm > CLEAR * scale
                    }) =>
                    {
                        state.stopped = 0;
                    }
                    _ => {}
                }
            }
            states[joint] = state;
            if one && state != self.states[joint] {
                break;
            }
        }
        (states != self.states).then_some(states)
    }

    /// Takes the stiffness of swings anew where the forces of joints differ from those that it was made of:
    /// whether it did.
    fn restiffen(&mut self, index: usize, solution: &Solution) -> bool {
        let mechanism = &self.mechanisms[index];
        let forces = self.forces(mechanism, &solution.impulse);
        let largest = |of: &mut dyn Iterator<Item = Vec3>| of.map(Vec3::length).fold(0.0, f64::max);
        let change = largest(&mut forces.iter().zip(&mechanism.forces).map(|(new, old)| *new - *old));
        if change <= SAME_FORCES * largest(&mut forces.iter().chain(&mechanism.forces).copied()) {
            return false;
        }
        let mut mechanism = std::mem::take(&mut self.mechanisms[index]);
        let was_stiff = mechanism.is_stiff();
        mechanism.forces = forces;
        self.stiffen(&mut mechanism);
        let changes = was_stiff || mechanism.is_stiff();
        if changes {
            self.arrange(&mut mechanism);
        }
        self.mechanisms[index] = mechanism;
        changes
    }

    /// One round of a mechanism: whether anything changed under these contact impulses. Rows are corrected
    /// where they open faster than `accuracy` (m/s), if they may be; else motors and stops change, one at a
    /// time where `one` is asked for.
    fn round(&mut self, index: usize, impulse: &[f64], accuracy: f64, correct: bool, one: bool) -> Change {
        let solution = self.solve(&self.mechanisms[index], impulse);
        if self.restiffen(index, &solution) {
            return Change::Rows;
        }
        let mechanism = &self.mechanisms[index];
        let rates = self.rates(mechanism, &solution.velocity);
        let open = |(row, &rate): (&ActiveRow, &f64)| self.opening(row, rate) > accuracy.max(row.noise);
        let is_open = mechanism.rows.iter().zip(&rates).any(open);
        if is_open && correct {
            self.correct(index, &rates);
            return Change::Targets;
        }
        if let Some(states) = self.switched(index, &solution, one) {
            self.states = states;
            let mut mechanism = std::mem::take(&mut self.mechanisms[index]);
            self.arrange(&mut mechanism);
            self.mechanisms[index] = mechanism;
            return Change::Rows;
        }
        if is_open {
            self.correct(index, &rates);
            return Change::Targets;
        }
        Change::None
    }

    /// Moves the right-hand sides by what the rates of their rows miss.
    fn correct(&mut self, index: usize, rates: &[f64]) {
        for (row, rate) in self.mechanisms[index].rows.iter_mut().zip(rates) {
            row.target -= rate - row.wanted;
        }
    }

    /// Finds what motors and stops do and how paths bend, as if contacts exerted these impulses (six numbers
    /// per body; empty: none).
    pub(crate) fn predict(&mut self, impulse: &[f64]) {
        let fine = FINE * self.scale;
        for index in 0..self.mechanisms.len() {
            let (mut corrections, mut changes) = (0, 0);
            let settled = (0..ROUNDS).any(|_| {
                let change = self.round(index, impulse, fine, corrections < CORRECTIONS, changes >= TOGETHER);
                match change {
                    Change::Targets => corrections += 1,
                    Change::Rows => (corrections, changes) = (0, changes + 1),
                    Change::None => {}
                }
                change == Change::None
            });
            if !settled && self.is_open(index, impulse, STUCK * self.scale) {
                // Corrections that lead nowhere, as in a linkage that is stuck, must not drive it.
                self.mechanisms[index].rows.iter_mut().for_each(|row| row.target = row.wanted);
            }
        }
    }

    /// Whether a row of a mechanism opens faster than this (m/s).
    fn is_open(&self, index: usize, impulse: &[f64], accuracy: f64) -> bool {
        let mechanism = &self.mechanisms[index];
        let solution = self.solve(mechanism, impulse);
        let rates = self.rates(mechanism, &solution.velocity);
        let closed = |(row, &rate): (&ActiveRow, &f64)| self.opening(row, rate) <= accuracy.max(row.noise);
        !mechanism.rows.iter().zip(&rates).all(closed)
    }

    /// Whether joints are what the contact problem took them for, to this residual, now that contacts exert
    /// these impulses; else [`Self::predict`] with them, and the contact problem again.
    pub(crate) fn agree(&mut self, impulse: &[f64], tolerance: f64) -> bool {
        let accuracy = tolerance * self.scale;
        (0..self.mechanisms.len())
            .all(|index| self.round(index, impulse, accuracy, false, true) == Change::None)
    }
}
