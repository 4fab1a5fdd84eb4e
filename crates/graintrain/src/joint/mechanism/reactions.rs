//! What joints exert.

use super::{Mechanism, Mechanisms, Solution};
use crate::joint::kinematics::{Placed, coordinate, last};
use crate::joint::{JointKind, JointState};
use crate::math::Vec3;
use graintrain_ccp::Residual;

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
            if lost > 0.0 {
                // Nothing is to be stiffened by forces that are rounding.
                for &joint in &mechanism.joints {
                    found.states[joint].force = Vec3::ZERO;
                }
            }
            for (row, &rate) in mechanism.rows.iter().zip(&rates) {
                // What positions round to is none.
                let opening = self.opening(row, rate);
                let opening = if opening <= row.noise { 0.0 } else { opening };
                let opening = if lost > 0.0 { opening.max(lost) } else { opening };
                if opening.is_nan() || opening > found.opening {
                    (found.opening, found.worst) = (opening, row.joint);
                }
                squares += (opening / self.yardstick).powi(2);
                // Springs never open.
                count += i32::from(row.compliance <= 0.0);
            }
        }
        let rms = (squares / f64::from(count.max(1))).sqrt();
        found.residual = Residual { max: found.opening / self.yardstick, rms };
        found
    }

    /// Velocity that rounding makes of the impulses of a mechanism, m/s, where that is more than velocities
    /// are measured by: where a motor without a limit drives a linkage over a dead point, or two of them
    /// against each other, joints hold by forces beyond all bounds. Else 0.
    pub(super) fn lost(&self, mechanism: &Mechanism, solution: &Solution) -> f64 {
        let rows = mechanism.rows.iter().zip(&solution.impulse);
        let changes = rows.map(|(row, impulse)| (impulse * row.norm * row.norm).abs());
        let lost = f64::EPSILON * changes.fold(0.0, f64::max);
        if lost > self.yardstick { lost } else { 0.0 }
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
