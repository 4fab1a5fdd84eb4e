//! What motors with a limit and stops do, and the corrections that keep bodies on the paths of their joints:
//! round by round, until all agree.

use super::{ActiveRow, Correction, Mechanism, Mechanisms, Role, Row, Solution};
use crate::handle::BodyId;
use crate::joint::drift::allowed;
use crate::joint::kinematics::{Placed, coordinate, last};
use crate::joint::{JointState, Motor};
use crate::math::{Vec3, rotation_exponential};

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
const STUCK: f64 = 1e-6;

/// A path on which a mechanism would move so many times as fast as straight on is another one.
const LEAP: f64 = 2.0;

/// Forces that differ by less than this share stiffen swings alike.
const SAME_FORCES: f64 = 0.1;

/// A motor that misses this fraction of its speed while a stop is active works against the stop.
const DRIVEN: f64 = 0.1;

/// A force beyond its limit, or a rate on the wrong side, counts from this fraction on.
pub(super) const CLEAR: f64 = 1e-9;

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
        let (poses, velocity) = (|body: usize| world.pose(body), &solution.velocity);
        let (moved, near) = (self.moved(mechanism, velocity), self.near(mechanism, velocity));
        let is_stopped = mechanism.joints.iter().any(|&joint| self.states[joint].stopped != 0);
        let mut states = self.states.clone();
        for &joint in mechanism.joints.iter().filter(|joint| limited(joint)) {
            let own = &world.joints[joint].joint;
            let Some(along) = coordinate(&world.joints, joint, &poses, &last(&world.joints)) else {
                continue;
            };
            let straight = along.rate_of(|body| self.velocity_of(mechanism, velocity, body));
            let after = coordinate(&world.joints, joint, &moved, &near);
            let rate = self.rate_of(mechanism, &along, after.as_ref(), velocity);
            let end = along.value + self.step * rate;
            let scale = self.scale / if along.angular { self.lengths[joint] } else { 1.0 };
            let of = |role: Role| {
                let own = |row: &ActiveRow| row.joint == joint && row.role == role;
                let place = mechanism.rows.iter().position(own)?;
                Some((&mechanism.rows[place], solution.impulse[place]))
            };
            let mut state = self.states[joint];
            if let Some(limits) = own.limits {
                // What it changes of the rate of free bodies tells a pull from rounding.
                let pulls = of(Role::Stop).is_some_and(|(row, impulse)| {
                    f64::from(state.stopped) * impulse * row.norm * row.norm > CLEAR * scale
                });
                state.stopped = match state.stopped {
                    0 => limits.met_at(end, CLEAR * scale * self.step + allowed(world, joint, along.angular)),
                    _ if pulls => 0,
                    side => side,
                };
            }
            if let Some(Motor::Speed { speed, limit: Some(limit) }) = &own.motor {
                let most = self.step * self.mean(limit).max(0.0);
                let wanted = self.mean(speed);
                match state.saturated {
                    // One coordinate has one rate: at a stop it is that of the stop, and the motor pushes
                    // with all its force to the side on which its speed is.
                    _ if state.stopped != 0 => {
                        let room = self.room(joint, state.stopped, along.value);
                        let ahead = f64::from(state.stopped) * wanted >= room / self.step;
                        state.saturated = if ahead { state.stopped } else { -state.stopped };
                    }
                    // What it was while the stop held tells nothing of what it does without.
                    _ if self.states[joint].stopped != 0 => {}
                    0 => {
                        let (row, impulse) = of(Role::Motor).unzip();
                        let (impulse, target) = (impulse.unwrap_or(0.0), row.map_or(0.0, |row| row.target));
                        let missing = target - straight;
                        if is_stopped && missing.abs() > (DRIVEN * wanted.abs()).max(CLEAR * scale) {
                            // Against the stop of another joint its row may depend on that of the stop: it
                            // gets no rate at any force, and its own force says nothing.
                            state.saturated = if missing > 0.0 { 1 } else { -1 };
                        } else if impulse.abs() > most * (1.0 + CLEAR) {
                            state.saturated = if impulse > 0.0 { 1 } else { -1 };
                        }
                    }
                    side if f64::from(side) * (rate - wanted) > CLEAR * scale => state.saturated = 0,
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

    /// Stiffens swings as joints draw in this step rather than in the last one, and then where they draw
    /// harder: whether it did. What was stiff in this step stays so: stiffness takes forces away, and both
    /// would be found in turn for ever.
    fn restiffen(&mut self, index: usize, solution: &Solution) -> bool {
        let mechanism = &self.mechanisms[index];
        let poses = |body: usize| self.world.pose(body);
        let forces = self.forces(mechanism, &solution.impulse);
        if forces.iter().any(|force| !force.is_finite()) || self.lost(mechanism, solution).is_some() {
            return false;
        }
        let foreseen = mechanism.is_foreseen;
        let pulls =
            mechanism.joints.iter().zip(forces).zip(&mechanism.forces).map(|((&joint, new), &old)| {
                let placed = Placed::of(&self.world.joints[joint], &poses);
                let [by_new, by_old] = [new, old].map(|force| placed.pull(force));
                if foreseen || by_new > by_old {
                    (new, by_new.max(by_old), (by_new - by_old).abs())
                } else {
                    (old, by_old, 0.0)
                }
            });
        let pulls: Vec<(Vec3, f64, f64)> = pulls.collect();
        let largest = |of: fn(&(Vec3, f64, f64)) -> f64| pulls.iter().map(of).fold(0.0, f64::max);
        if largest(|pull| pull.2) <= SAME_FORCES * largest(|pull| pull.1) {
            return false;
        }
        let mut mechanism = std::mem::take(&mut self.mechanisms[index]);
        let was_stiff = mechanism.is_stiff();
        mechanism.is_foreseen = false;
        mechanism.forces = pulls.into_iter().map(|(force, ..)| force).collect();
        self.stiffen(&mut mechanism);
        let mut changes = was_stiff;
        if was_stiff || mechanism.is_stiff() {
            let corrected = mechanism.corrected.take();
            self.arrange(&mut mechanism);
            changes |= mechanism.is_stiff();
            if !changes {
                mechanism.corrected = corrected;
            }
        }
        self.mechanisms[index] = mechanism;
        changes
    }

    /// One round of a mechanism: whether anything changed under these contact impulses. Rows are corrected
    /// where they open faster than `accuracy` (m/s), if they may be; else motors and stops change, one at a
    /// time where `one` is asked for.
    fn round(&mut self, index: usize, impulse: &[f64], accuracy: f64, correct: bool, one: bool) -> Change {
        let solution = self.solve(&self.mechanisms[index], impulse);
        let mechanism = &self.mechanisms[index];
        let after = self.rows_after(mechanism, &solution.velocity);
        let rates = self.rates_of(mechanism, &after, &solution.velocity);
        // A rate that is no number is open.
        let closed = |(row, &rate): (&ActiveRow, &f64)| self.opening(row, rate) <= accuracy.max(row.noise);
        let is_open = !mechanism.rows.iter().zip(&rates).all(closed);
        // The forces of a path that is being sought say nothing, unless nothing else is known.
        let is_known = mechanism.forces.iter().any(|force| *force != Vec3::ZERO);
        if !(mechanism.is_straight || is_open && is_known) && self.restiffen(index, &solution) {
            return Change::Rows;
        }
        if is_open && correct {
            return self.correct(index, &solution, (&after, &rates));
        }
        if let Some(states) = self.switched(index, &solution, one) {
            self.states = states;
            self.rearrange(index);
            return Change::Rows;
        }
        if is_open { self.correct(index, &solution, (&after, &rates)) } else { Change::None }
    }

    /// Moves the right-hand sides by what the rates of their rows miss, as Newton's method does: the forces
    /// act along the rows at the start of the step, and what they change is seen by the rows at its end. A
    /// correction that opens joints further throws light bodies across: they are made as stiff as its forces
    /// ask for, and if they are, it is halved.
    fn correct(
        &mut self,
        index: usize,
        solution: &Solution,
        (after, rates): (&[Option<Row>], &[f64]),
    ) -> Change {
        let mechanism = &mut self.mechanisms[index];
        let corrected = mechanism.corrected.take();
        let mechanism = &self.mechanisms[index];
        let openings = mechanism.rows.iter().zip(rates).map(|(row, &rate)| self.opening(row, rate));
        let open = openings.map(|opening| opening * opening).sum::<f64>();
        let (changes, open) = match corrected {
            Some(Correction { changes, open: least }) if open.is_nan() || open > least => {
                self.move_targets(index, &changes, -1.0);
                if self.restiffen(index, solution) {
                    return Change::Rows;
                }
                (changes.iter().map(|change| 0.5 * change).collect(), least)
            }
            _ => (self.changes(index, solution, (after, rates)), open),
        };
        self.move_targets(index, &changes, 1.0);
        self.mechanisms[index].corrected = Some(Correction { changes, open });
        Change::Targets
    }

    fn move_targets(&mut self, index: usize, changes: &[f64], share: f64) {
        for (row, change) in self.mechanisms[index].rows.iter_mut().zip(changes) {
            row.target += share * change;
        }
    }

    /// Newton's correction of the right-hand sides.
    fn changes(
        &self,
        index: usize,
        solution: &Solution,
        (after, rates): (&[Option<Row>], &[f64]),
    ) -> Vec<f64> {
        let mechanism = &self.mechanisms[index];
        let half = |body: usize| {
            let v = self.velocity_of(mechanism, &solution.velocity, body);
            rotation_exponential(-0.5 * self.step * Vec3::from_slice(&v[3..]))
        };
        let seen = |row: Row| {
            let seen = |(body, [linear, angular]): (usize, [Vec3; 2])| (body, [linear, half(body) * angular]);
            Row { ends: row.ends.into_iter().map(seen).collect(), ..row }
        };
        let seen: Vec<Option<Row>> = after.iter().map(|row| row.clone().map(seen)).collect();
        let missing: Vec<f64> =
            mechanism.rows.iter().zip(rates).map(|(row, rate)| row.wanted - rate).collect();
        mechanism.changes(&seen, &missing)
    }

    /// Finds what motors and stops do and how paths bend, as if contacts exerted these impulses (six numbers
    /// per body; empty: none).
    pub(crate) fn predict(&mut self, impulse: &[f64]) {
        let fine = FINE * self.scale;
        for index in 0..self.mechanisms.len() {
            let Mechanism { forces, is_foreseen, .. } = &self.mechanisms[index];
            let before = (self.states.clone(), forces.clone(), *is_foreseen);
            let mut settles = self.settle(index, impulse, fine);
            let is_lost = !settles && self.is_open(index, impulse, STUCK * self.scale);
            let leaps = !is_lost && self.leaps(index, impulse);
            if leaps {
                let mut mechanism = std::mem::take(&mut self.mechanisms[index]);
                (self.states, mechanism.forces, mechanism.is_foreseen) = before;
                self.stiffen(&mut mechanism);
                self.arrange(&mut mechanism);
                self.mechanisms[index] = mechanism;
            }
            if is_lost || leaps {
                // Corrections that lead nowhere, or somewhere else, must not drive it.
                let mechanism = &mut self.mechanisms[index];
                mechanism.is_straight = true;
                mechanism.rows.iter_mut().for_each(|row| row.target = row.wanted);
                settles = self.settle(index, impulse, fine);
            }
            self.mechanisms[index].is_undecided = !settles;
        }
    }

    /// Whether the path of a mechanism is not the one on which it is: it would get energy from what only
    /// holds (closed by a whole turn more, with contacts that press as that asks for), or some body would
    /// have to move much faster than all do as its rows at the start of the step let them, in the frame of
    /// what holds it, or in which it rests as a whole.
    fn leaps(&mut self, index: usize, impulse: &[f64]) -> bool {
        let mechanism = &mut self.mechanisms[index];
        let targets: Vec<f64> = mechanism.rows.iter().map(|row| row.target).collect();
        if mechanism.is_straight || mechanism.rows.iter().all(|row| row.target == row.wanted) {
            return false;
        }
        let on_path = self.solve(&self.mechanisms[index], impulse);
        if self.gained(&self.mechanisms[index], &on_path).is_some() {
            return true;
        }
        self.mechanisms[index].rows.iter_mut().for_each(|row| row.target = row.wanted);
        let straight = self.solve(&self.mechanisms[index], impulse).velocity;
        self.mechanisms[index].rows.iter_mut().zip(targets).for_each(|(row, target)| row.target = target);
        let Mechanism { bodies, joints, .. } = &self.mechanisms[index];
        let parts = |v: &[f64]| [0, 3].map(|first| Vec3::from_slice(&v[first..first + 3]));
        let of = |&joint: &usize| self.world.joints[joint].joint.bodies;
        let is_free = |end: Option<BodyId>| end.is_some_and(|b| bodies.contains(&(b.index() as u32)));
        // A gear has no bodies of its own.
        let frame = if joints.iter().map(of).all(|ends| ends == [None; 2] || ends.into_iter().all(is_free)) {
            let masses = bodies.iter().map(|&body| self.world.bodies.mass[body as usize]);
            let sums = straight.chunks_exact(6).zip(masses).map(|(v, mass)| (mass * parts(v)[0], mass));
            let (momentum, mass) = sums.fold((Vec3::ZERO, 0.0), |(p, m), (q, n)| (p + q, m + n));
            momentum / mass
        } else {
            Vec3::ZERO
        };
        let length = joints.iter().map(|&joint| self.lengths[joint]).fold(0.0, f64::max);
        let fastest = |velocity: &[f64]| {
            let speeds = velocity.chunks_exact(6).map(|v| {
                let [u, w] = parts(v);
                (u - frame).length().max(length * w.length())
            });
            speeds.fold(0.0, f64::max)
        };
        fastest(&on_path.velocity) > LEAP * fastest(&straight) + STUCK * self.yardstick
    }

    /// Whether of some mechanism it was not found what its motors and stops do.
    pub(crate) fn are_undecided(&self) -> bool {
        self.mechanisms.iter().any(|mechanism| mechanism.is_undecided)
    }

    /// Rounds of a mechanism until nothing changes: whether that came to be.
    fn settle(&mut self, index: usize, impulse: &[f64], accuracy: f64) -> bool {
        // What was corrected under other impulses says nothing here.
        self.mechanisms[index].corrected = None;
        let (mut corrections, mut changes) = (0, 0);
        (0..ROUNDS).any(|_| {
            let change = self.round(index, impulse, accuracy, corrections < CORRECTIONS, changes >= TOGETHER);
            match change {
                Change::Targets => corrections += 1,
                Change::Rows => (corrections, changes) = (0, changes + 1),
                Change::None => {}
            }
            change == Change::None
        })
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
        (0..self.mechanisms.len()).all(|index| {
            self.mechanisms[index].corrected = None;
            self.round(index, impulse, accuracy, false, true) == Change::None
        })
    }
}
