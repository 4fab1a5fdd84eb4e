//! What joints exert.

use super::{Mechanisms, Role};
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
    /// What joints did, under these contact impulses.
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
        let mut velocity = self.free.clone();
        self.velocities(impulse, &mut velocity);
        let (mut squares, mut count) = (0.0, 0);
        for mechanism in &self.mechanisms {
            let solution = self.solve(mechanism, impulse);
            for &joint in &mechanism.joints {
                if let Some(along) = coordinate(&self.world.joints, joint, &poses, &last(&self.world.joints))
                {
                    found.states[joint].rate = along.rate(&velocity);
                }
            }
            let rates = self.rates(mechanism, &solution.velocity);
            let held = mechanism.rows.iter().zip(&solution.impulse);
            let all =
                held.map(|(row, &impulse)| (row.joint, &row.row, impulse, matches!(row.role, Role::Held(_))));
            let pushed = mechanism.pushed.iter().map(|(joint, row, impulse)| (*joint, row, *impulse, false));
            for (joint, row, impulse, holds) in all.chain(pushed) {
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
            for (k, &body) in mechanism.bodies.iter().enumerate().filter(|_| !solution.held.is_empty()) {
                let change = mechanism.roots[k].times(&solution.held[6 * k..]);
                found.impulses.push((body as usize, self.momentum(body as usize, change)));
            }
            for (row, &rate) in mechanism.rows.iter().zip(&rates) {
                let opening = self.opening(row, rate);
                if opening.is_nan() || opening > found.opening {
                    (found.opening, found.worst) = (opening, row.joint);
                }
                squares += (opening / self.yardstick).powi(2);
                count += 1;
            }
        }
        let rms = (squares / f64::from(count.max(1))).sqrt();
        found.residual = Residual { max: found.opening / self.yardstick, rms };
        found
    }
}
