//! What motors with a limit and stops do, and the corrections that keep bodies on the paths of their joints: round by round, until all agree.

use super::{ActiveRow, Mechanisms, Role, Solution};
use crate::joint::Motor;
use crate::joint::kinematics::{coordinate, last};
use crate::math::Vec3;

/// Corrections of the right-hand side, and changes of motors and stops, between two solves of the contacts.
const CORRECTIONS: usize = 40;

/// After so many, motors and stops change one by one.
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
    /// Motors and stops that disagree with their forces or rates take their other state; of several the first alone where `one` is
    /// asked for.
    fn switch(&mut self, index: usize, solution: &Solution, one: bool) -> bool {
        let mechanism = &self.mechanisms[index];
        let world = self.world;
        let limited = |joint: &usize| {
            let own = &world.joints[*joint].joint;
            own.limits.is_some() || matches!(own.motor, Some(Motor::Speed { limit: Some(_), .. }))
        };
        if !mechanism.joints.iter().any(limited) {
            return false;
        }
        let mut velocity = self.free.clone();
        for (k, &body) in mechanism.bodies.iter().enumerate() {
            velocity[6 * body as usize..6 * body as usize + 6]
                .copy_from_slice(&solution.velocity[6 * k..6 * k + 6]);
        }
        let poses = |body: usize| world.pose(body);
        let is_stopped = mechanism.joints.iter().any(|&joint| self.states[joint].stopped != 0);
        let mut changed = false;
        for &joint in mechanism.joints.iter().filter(|joint| limited(joint)) {
            let own = &world.joints[joint].joint;
            let Some(along) = coordinate(&world.joints, joint, &poses, &last(&world.joints)) else {
                continue;
            };
            let rate = along.rate(&velocity);
            let scale = self.scale / if along.angular { self.lengths[joint] } else { 1.0 };
            let impulse_of = |role: Role| {
                let own = |row: &ActiveRow| row.joint == joint && row.role == role;
                mechanism.rows.iter().position(own).map_or(0.0, |k| solution.impulse[k])
            };
            let mut state = self.states[joint];
            if let Some(Motor::Speed { speed, limit: Some(limit) }) = &own.motor {
                let most = self.step * self.mean(limit).max(0.0);
                let wanted = self.mean(speed);
                match state.saturated {
                    0 => {
                        let impulse = impulse_of(Role::Motor);
                        let missing = wanted - rate;
                        if impulse.abs() > most * (1.0 + CLEAR) {
                            state.saturated = if impulse > 0.0 { 1 } else { -1 };
                        } else if is_stopped && missing.abs() > (DRIVEN * wanted.abs()).max(CLEAR * scale) {
                            // Against a stop its row depends on that of the stop, and gets no rate at any force.
                            state.saturated = if missing > 0.0 { 1 } else { -1 };
                        }
                    }
                    side if f64::from(side) * (rate - wanted) > CLEAR * scale => state.saturated = 0,
                    _ => {}
                }
            }
            if let Some(limits) = own.limits {
                let end = along.value + self.step * rate;
                let beyond = CLEAR * scale * self.step;
                match state.stopped {
                    0 if limits.lower.is_some_and(|lower| end < lower - beyond) => state.stopped = -1,
                    0 if limits.upper.is_some_and(|upper| end > upper + beyond) => state.stopped = 1,
                    side if f64::from(side) * impulse_of(Role::Stop) > 0.0 => state.stopped = 0,
                    _ => {}
                }
            }
            if state != self.states[joint] {
                self.states[joint] = state;
                changed = true;
                if one {
                    break;
                }
            }
        }
        changed
    }

    /// Takes the stiffness of swings anew where the forces of joints differ from those that it was made of: whether it did.
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

    /// One round of a mechanism: whether anything changed under these contact impulses, to this accuracy of rates (m/s).
    fn round(&mut self, index: usize, impulse: &[f64], accuracy: f64, one: bool) -> Change {
        let solution = self.solve(&self.mechanisms[index], impulse);
        if self.switch(index, &solution, one) {
            let mut mechanism = std::mem::take(&mut self.mechanisms[index]);
            self.arrange(&mut mechanism);
            self.mechanisms[index] = mechanism;
            return Change::Rows;
        }
        if self.restiffen(index, &solution) {
            return Change::Rows;
        }
        let mechanism = &self.mechanisms[index];
        let rates = self.rates(mechanism, &solution.velocity);
        let open = |(row, &rate): (&ActiveRow, &f64)| self.opening(row, rate) > accuracy.max(row.noise);
        if !mechanism.rows.iter().zip(&rates).any(open) {
            return Change::None;
        }
        for (row, rate) in self.mechanisms[index].rows.iter_mut().zip(rates) {
            row.target -= rate - row.wanted;
        }
        Change::Targets
    }

    /// Finds what motors and stops do and how paths bend, as if contacts exerted these impulses (six numbers per body; empty: none).
    pub(crate) fn predict(&mut self, impulse: &[f64]) {
        for index in 0..self.mechanisms.len() {
            let fine = FINE * self.scale;
            let mut rounds = 0..CORRECTIONS;
            let settled =
                rounds.any(|round| self.round(index, impulse, fine, round >= TOGETHER) == Change::None);
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

    /// Whether joints are what the contact problem took them for, to this residual, now that contacts exert these impulses; else
    /// [`Self::predict`] with them, and the contact problem again.
    pub(crate) fn agree(&mut self, impulse: &[f64], tolerance: f64) -> bool {
        let accuracy = tolerance * self.scale;
        (0..self.mechanisms.len()).all(|index| self.round(index, impulse, accuracy, true) == Change::None)
    }
}
