//! What joints exert.

use super::{ActiveRow, Mechanism, Mechanisms, Role, Solution};
use crate::joint::kinematics::{Placed, coordinate, last};
use crate::joint::{JointKind, JointState};
use crate::math::Vec3;
use graintrain_ccp::Residual;

/// What only holds gives a mechanism no more than this share of its energy, or of that of a free fall.
const GAINED: f64 = 0.1;

/// What joints did in a step.
#[derive(Clone, Debug, Default)]
pub(crate) struct JointReactions {
    /// One per joint of the world; coordinates still those before the step.
    pub states: Vec<JointState>,
    /// Impulses on bodies and their moments about the centres, world axes.
    pub impulses: Vec<(usize, [Vec3; 2])>,
    /// Rates at which joints open, over the velocity scale.
    pub residual: Residual,
    /// The joint that opens most.
    pub worst: usize,
    /// Rate at which it does, m/s.
    pub opening: f64,
    /// A joint of a mechanism that got energy from what only holds, and how much, J ([`Mechanisms::gained`]).
    pub gained: Option<(usize, f64)>,
    /// Of some joints forces are not known ([`Mechanisms::lost`]): they are reported as none.
    pub is_lost: bool,
}

impl Mechanisms<'_> {
    /// What joints did, under these contact impulses (N s and N m s, six numbers per body).
    pub(crate) fn reactions(&self, impulse: &[f64]) -> JointReactions {
        let mut found = JointReactions { states: self.states.clone(), ..JointReactions::default() };
        for state in &mut found.states {
            (state.force, state.torque) = (Vec3::ZERO, Vec3::ZERO);
            (state.rate, state.drive) = (0.0, 0.0);
        }
        if self.is_empty() {
            return found;
        }
        let poses = |body: usize| self.world.pose(body);
        let (mut squares, mut count) = (0.0, 0);
        for mechanism in &self.mechanisms {
            let solution = self.solve(mechanism, impulse);
            let moved = self.moved(mechanism, &solution.velocity);
            let near = self.near(mechanism, &solution.velocity);
            let joints = &self.world.joints;
            for &joint in &mechanism.joints {
                if let Some(along) = coordinate(joints, joint, &poses, &last(joints)) {
                    let after = coordinate(joints, joint, &moved, &near);
                    found.states[joint].rate =
                        self.rate_of(mechanism, &along, after.as_ref(), &solution.velocity);
                }
            }
            let rates = self.rates(mechanism, &solution.velocity);
            let lost = self.lost(mechanism, &solution);
            found.gained = found.gained.or(self.gained(mechanism, &solution));
            for (joint, row, impulse, holds) in mechanism.exerted(&solution.impulse) {
                found
                    .impulses
                    .extend(row.ends.iter().map(|(body, parts)| (*body, parts.map(|part| impulse * part))));
                let own = &self.world.joints[joint];
                let state = &mut found.states[joint];
                let is_gear = matches!(own.joint.kind, JointKind::Gear { .. });
                if !holds || is_gear {
                    state.drive += impulse / self.step;
                }
                if !is_gear {
                    let [force, torque] = Placed::of(own, &poses).wrench(row);
                    state.force += impulse / self.step * force;
                    state.torque += impulse / self.step * torque;
                }
            }
            found.impulses.extend(self.of_swings(mechanism, &solution));
            for (row, &rate) in mechanism.rows.iter().zip(&rates) {
                // What positions round to is none.
                let opening = self.opening(row, rate);
                let opening = if opening <= row.noise { 0.0 } else { opening };
                if opening.is_nan() || opening > found.opening {
                    (found.opening, found.worst) = (opening, row.joint);
                }
                squares += (opening / self.yardstick).powi(2);
                // Springs never open.
                count += i32::from(row.compliance <= 0.0);
            }
            if let Some((joint, change)) = lost {
                // Such numbers are rounding, and nothing is to be stiffened by them.
                for &joint in &mechanism.joints {
                    let state = &mut found.states[joint];
                    (state.force, state.torque, state.drive) = (Vec3::ZERO, Vec3::ZERO, 0.0);
                }
                found.is_lost = true;
                if change > found.opening {
                    (found.opening, found.worst) = (change, joint);
                }
                squares += (change / self.yardstick).powi(2);
                count += 1;
            }
        }
        let rms = (squares / f64::from(count.max(1))).sqrt();
        found.residual = Residual { max: found.opening / self.yardstick, rms };
        found
    }

    /// The joint whose impulse rounds to the largest velocity, m/s, where that is more than velocities are
    /// measured by: where a motor without a limit drives a linkage over a dead point, or two of them against
    /// each other, joints would hold by forces beyond all bounds.
    pub(super) fn lost(&self, mechanism: &Mechanism, solution: &Solution) -> Option<(usize, f64)> {
        let change = |(row, impulse): (&ActiveRow, &f64)| {
            let length = if row.row.angular { self.lengths[row.joint] } else { 1.0 };
            (row.joint, f64::EPSILON * length * (impulse * row.norm * row.norm).abs())
        };
        let changes = mechanism.rows.iter().zip(&solution.impulse).map(change);
        changes.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, change)| *change > self.yardstick)
    }

    /// The energy, J, that what only holds gave a mechanism without motors that turn it and without springs,
    /// where that is more than [`GAINED`] allows, and the joint with the largest part in it. Paths that bend,
    /// and stiffness that comes and goes, give and take in turn; where light links that whirl go taut under a
    /// heavy load within a step, they may give more than there is.
    pub(super) fn gained(&self, mechanism: &Mechanism, solution: &Solution) -> Option<(usize, f64)> {
        if mechanism.rows.iter().any(|row| matches!(row.role, Role::Motor | Role::Spring)) {
            return None;
        }
        let halved = |(before, after): (&f64, &f64)| 0.5 * (before + after);
        let mean = |&body: &u32, after: &[f64]| -> Vec<f64> {
            self.before[6 * body as usize..].iter().zip(after).map(halved).collect()
        };
        let velocities = mechanism.bodies.iter().zip(solution.velocity.chunks_exact(6));
        let mean: Vec<f64> = velocities.clone().flat_map(|(body, after)| mean(body, after)).collect();
        let energy = |body: u32, v: &[f64]| {
            let v = [0, 3].map(|first| Vec3::from_slice(&v[first..first + 3]));
            let [p, l] = self.momentum(body as usize, v);
            0.5 * (p.dot(v[0]) + l.dot(v[1]))
        };
        let mut sums = [0.0; 3];
        for (&body, after) in velocities {
            sums[0] += energy(body, &self.before[6 * body as usize..]);
            sums[1] += energy(body, after);
            sums[2] += 0.5 * self.world.bodies.mass[body as usize] * self.scale * self.scale;
        }
        let work = |(row, impulse): (&ActiveRow, &f64)| {
            (row.joint, impulse * row.row.rate_of(|body| self.velocity_of(mechanism, &mean, body)))
        };
        let works: Vec<(usize, f64)> = mechanism.rows.iter().zip(&solution.impulse).map(work).collect();
        let of_swings = self.of_swings(mechanism, solution).into_iter().map(|(body, [f, m])| {
            let v = self.velocity_of(mechanism, &mean, body);
            f.dot(Vec3::from_slice(&v[..3])) + m.dot(Vec3::from_slice(&v[3..]))
        });
        let all = works.iter().map(|(_, work)| work).sum::<f64>() + of_swings.sum::<f64>();
        let worst = works.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?.0;
        (all > GAINED * sums.into_iter().fold(0.0, f64::max)).then_some((worst, all))
    }

    /// The impulses of stiffened swings on bodies: M (v+ - v*) less those of joints and contacts.
    fn of_swings(&self, mechanism: &Mechanism, solution: &Solution) -> Vec<(usize, [Vec3; 2])> {
        if !mechanism.is_stiff() {
            return Vec::new();
        }
        let angular = |v: &[f64], body: usize| Vec3::from_slice(&v[6 * body + 3..6 * body + 6]);
        let impulse = |(k, &body): (usize, &u32)| {
            let body = body as usize;
            let damped = match solution.held.get(6 * k..) {
                Some(held) if !held.is_empty() => mechanism.roots[k].times(held),
                _ => [Vec3::ZERO; 2],
            };
            let turned = damped[1] - angular(&solution.velocity, k) + angular(&self.before, body);
            let [linear, moment] = self.momentum(body, damped);
            (body, [linear, moment + mechanism.swings[k] * turned])
        };
        mechanism.bodies.iter().enumerate().map(impulse).collect()
    }
}
