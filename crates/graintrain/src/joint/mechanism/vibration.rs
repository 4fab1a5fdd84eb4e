//! How fast springs let the bodies of a mechanism vibrate, and which lengths their forces are of.

use super::{Mechanism, Mechanisms};
use crate::joint::elimination::{Elimination, SparseRow, dot};
use crate::joint::kinematics::{Row, coordinate, held, last};
use crate::joint::rows::{made_unit, row_over};

/// The force of a spring is that of the length s - a dt ds/dt- + b dt ds/dt+, with s at the start of the step
/// and its rates before and after: a and b, from the square of w dt with the rate w of the vibration of its
/// bodies ([`Mechanisms::vibrations`]). Resolved vibrations (w dt up to 1) have the mean (s- + 2 s + s+) / 4,
/// which keeps their energy; faster ones more and more the length at the end, which takes it: what a step
/// moves a body by before the spring acts would be energy from nowhere.
pub(super) fn spring_shares(square: f64) -> [f64; 2] {
    let unresolved = 1.0 - 1.0 / square.max(1.0);
    [0.25 * (1.0 - unresolved), 0.25 + 0.75 * unresolved]
}

impl Mechanisms<'_> {
    /// Bounds of (w dt)^2 of the vibrations of every spring of a mechanism, by joint: with its rates a_i of
    /// unit mass, along what joints hold, `dt^2 sum_j sqrt(k_i k_j) |a_i . a_j|` (S. Gershgorin).
    pub(super) fn vibrations(&self, mechanism: &Mechanism) -> Vec<(usize, f64)> {
        let joints = &self.world.joints;
        let poses = |body: usize| self.world.pose(body);
        let length = 6 * mechanism.bodies.len();
        let over = |row: &Row| row_over(row, &mechanism.bodies, &mechanism.roots);
        let mut springs: Vec<(usize, Vec<f64>)> = Vec::new();
        for &joint in &mechanism.joints {
            if let Some(spring) = &joints[joint].joint.spring
                && let Some(along) = coordinate(joints, joint, &poses, &last(joints))
            {
                let root = self.step * spring.stiffness.sqrt();
                let mut own = vec![0.0; length];
                over(&along).into_iter().for_each(|(place, x)| own[place] = root * x);
                springs.push((joint, own));
            }
        }
        let bounds = |springs: &[(usize, Vec<f64>)]| -> Vec<(usize, f64)> {
            let sum = |own: &[f64]| springs.iter().map(|(_, other)| dot(own, other).abs()).sum();
            springs.iter().map(|(joint, own)| (*joint, sum(own))).collect()
        };
        let alone = bounds(&springs);
        if alone.iter().all(|(_, square)| *square <= 1.0) {
            return alone;
        }
        let rows = mechanism.joints.iter().flat_map(|&joint| held(joints, joint, &poses, &last(joints)));
        let mut rows: Vec<SparseRow> = rows.map(|row| over(&row)).collect();
        rows.iter_mut().for_each(|row| _ = made_unit(row));
        let none = vec![0.0; rows.len()];
        let elimination = Elimination::new(mechanism.bodies.len(), length, &rows);
        springs.iter_mut().for_each(|(_, own)| elimination.project(own, &none));
        bounds(&springs)
    }
}
