//! Bodies that hang in joints under load swing about them: a heavy weight on a light chain makes it stiff
//! across, as a taut string is.
//!
//! The force F of a joint on a body, r from its centre, turns against a rotation theta across r with the
//! torque -K theta,
//!
//! ```text
//! K = max(r . F, 0) (1 - r r^T / |r|^2)
//! ```
//!
//! (geometric stiffness; what drives away is left out, and so is what F has across r, which has no part in a
//! rotation about r: the twist of a link stays free). Joints act in the places where bodies are when a step
//! begins; the swing about them is stable as long as dt times its rate is below 2. A chain of links of 0.1 kg
//! with a weight of 100 t swings ten times as fast. So swings take the mean of the torque over three steps,
//! as springs do ([`super::Spring`]): with kappa = dt^2 K / 4 of every body, and v* without,
//!
//! ```text
//! (M + kappa) (v+ - v-) = M (v* - v-) + J^T lambda + D g
//! ```
//!
//! which is a mechanism of bodies with more inertia: what the joints, motors and contacts of a step see. It
//! keeps the energy of one swing and is stable for any load and step. The ends of a rod of length l that
//! bears the tension T are held across it by T / l in the same way, as by a spring between them. Mechanisms
//! are left alone where the step resolves the swings that their joints leave free: with stiffness that comes
//! and goes with the forces a pendulum would swing higher every time. The forces are those of the same step,
//! found with it (`Mechanisms::restiffen`).
//!
//! Swings far beyond the step would keep for ever what the first step under a new load gave them, and their
//! least change of direction works against the whole load; and stiffness that changes from step to step makes
//! energy. In the motions Y that joints leave free, `Y^T (M + kappa) Y = 1` and `S = Y^T kappa Y` (between 0,
//! resolved, and 1), they are damped by
//!
//! ```text
//! Y^T (M + kappa) (v+ - v) = -D Y^T kappa (3 v+ + v-),
//! D = S^2 q^4 / (1 + q^4),     q = 4 S / RESOLVED = 8 S
//! ```
//!
//! with v from the equation before: where S is 1 this is next to implicit Euler, and the swing is over in one
//! step. A swing, or a bob whirled on a joint, with dt times its rate of 0.4 loses 1e-6 of itself in a step,
//! one of 0.6 2e-4, one of 1 1.4 %, one of 2 20 %; nothing below 0.7, unless faster ones are beside it. With
//! D = S^4 random mechanisms of one to five bodies gain up to twice the energy that they have in 30 s at 10
//! and 20 ms, here 4 %; with S^2 alone those of 0.4 lose 6e-5.
//!
//! Source: M. Tournier, M. Nesme, B. Gilles, F. Faure, "Stable constrained dynamics", ACM Transactions on
//! Graphics 34(4):132, 2015, there with an implicit step, which damps; the mean: N. M. Newmark, "A method of
//! computation for structural dynamics", Journal of the Engineering Mechanics Division 85(3):67-94, 1959.

use super::JointKind;
use super::elimination::dot;
use super::kinematics::{Placed, Row};
use super::rows::{Root, row_over};
use crate::math::{Mat3, Vec3};
use crate::world::World;

/// Mechanisms all of whose swings, as the root of the sum of their squares, have a (dt rate)^2 below this are
/// left alone.
const RESOLVED: f64 = 0.5;

/// The restoring stiffness of a force at an arm, N m/rad.
fn restoring(arm: Vec3, force: Vec3) -> Mat3 {
    let length = arm.length();
    let unit = if length > 0.0 { arm / length } else { Vec3::ZERO };
    let outer = Mat3::from_cols(unit.x * unit, unit.y * unit, unit.z * unit);
    arm.dot(force).max(0.0) * (Mat3::IDENTITY - outer)
}

/// What these forces of joints (on B) make the bodies and rods of a mechanism stiff by, times a factor:
/// kappa of every body, and of the rods that are taut, by joint; nothing where all swings are resolved.
pub(super) fn stiffness(
    world: &World,
    (bodies, roots): (&[u32], &[Root]),
    (joints, forces): (&[usize], &[Vec3]),
    factor: f64,
) -> (Vec<Mat3>, Vec<(usize, f64)>) {
    let poses = |body: usize| world.pose(body);
    let (mut swings, mut taut) = (vec![Mat3::ZERO; bodies.len()], Vec::new());
    let mut fastest = 0.0;
    for (&joint, &force) in joints.iter().zip(forces).filter(|(_, force)| **force != Vec3::ZERO) {
        let placed = Placed::of(&world.joints[joint], &poses);
        if let JointKind::Distance { .. } = world.joints[joint].joint.kind {
            let (length, rows) = placed.across();
            let kappa = factor * placed.tension(force) / length;
            if kappa > 0.0 && kappa.is_finite() {
                taut.push((joint, kappa));
                let mobility = |row: &Row| {
                    let row = row_over(row, bodies, roots);
                    row.iter().map(|(_, x)| x * x).sum::<f64>()
                };
                fastest += kappa * rows.iter().map(mobility).sum::<f64>();
            }
        }
        for (body, arm, force) in placed.forces(force) {
            if let Ok(k) = bodies.binary_search(&(body as u32)) {
                swings[k] += factor * restoring(arm, force);
            }
        }
    }
    // The fastest that one body alone could swing: mostly that decides.
    fastest += swings.iter().zip(roots).map(|(k, root)| root.turned(*k)).sum::<f64>();
    if 4.0 * fastest <= RESOLVED {
        return (vec![Mat3::ZERO; bodies.len()], Vec::new());
    }
    (swings, taut)
}

/// The damping of swings that are not resolved.
#[derive(Clone, Debug)]
pub(super) struct Stiffening {
    /// Basis of the free motions in the coordinates of the elimination.
    pub motions: Vec<Vec<f64>>,
    /// Turns of every body in each of them.
    pub turns: Vec<Vec<Vec3>>,
    /// D, by rows.
    damping: Vec<f64>,
    /// Cholesky factor of 1 + 3 S D.
    factor: Lower,
}

/// A Cholesky factor, lower triangle by rows, all columns stored.
#[derive(Clone, Debug)]
struct Lower {
    degrees: usize,
    entries: Vec<f64>,
}

impl Lower {
    /// Of the lower triangle of a symmetric matrix whose eigenvalues are at least 1.
    fn of(matrix: &[f64], degrees: usize) -> Self {
        let mut entries = vec![0.0; degrees * degrees];
        for i in 0..degrees {
            for j in 0..=i {
                let rows = [i, j].map(|k| &entries[k * degrees..k * degrees + j]);
                let before = dot(rows[0], rows[1]);
                let rest = matrix[i * degrees + j] - before;
                entries[i * degrees + j] =
                    if i == j { rest.max(1.0).sqrt() } else { rest / entries[j * degrees + j] };
            }
        }
        Self { degrees, entries }
    }

    /// x <- L^-1 x.
    fn forward(&self, x: &mut [f64]) {
        for (i, row) in self.entries.chunks_exact(self.degrees.max(1)).enumerate() {
            let before = dot(&row[..i], &x[..i]);
            x[i] = (x[i] - before) / row[i];
        }
    }

    /// x <- L^-T x.
    fn backward(&self, x: &mut [f64]) {
        for (i, row) in self.entries.chunks_exact(self.degrees.max(1)).enumerate().rev() {
            x[i] /= row[i];
            let known = x[i];
            row[..i].iter().zip(&mut *x).for_each(|(l, x)| *x -= l * known);
        }
    }
}

/// The symmetric matrix with these entries at and below the diagonal.
fn symmetric(degrees: usize, entry: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    let mut matrix = vec![0.0; degrees * degrees];
    for i in 0..degrees {
        for j in 0..=i {
            let entry = entry(i, j);
            (matrix[i * degrees + j], matrix[j * degrees + i]) = (entry, entry);
        }
    }
    matrix
}

/// Of symmetric matrices that commute.
fn product(a: &[f64], b: &[f64], degrees: usize) -> Vec<f64> {
    symmetric(degrees, |i, j| dot(&a[i * degrees..(i + 1) * degrees], &b[j * degrees..(j + 1) * degrees]))
}

impl Stiffening {
    /// With the free motions, their turns (rad/s per unit, one per body), kappa of every body and the
    /// coordinates of taut rods. `None` where the step resolves all swings. Cost: six products of square
    /// matrices of as many rows as there are motions.
    pub(super) fn new(
        motions: Vec<Vec<f64>>,
        turns: Vec<Vec<Vec3>>,
        swings: &[Mat3],
        rods: &[usize],
    ) -> Option<Self> {
        let degrees = motions.len();
        // Turns as these matrices make them, and what rods are stretched by.
        let over = |matrices: &dyn Fn(usize) -> Mat3| -> Vec<Vec<f64>> {
            let of = |(turns, motion): (&Vec<Vec3>, &Vec<f64>)| {
                let turns = turns.iter().enumerate().flat_map(|(k, &turn)| (matrices(k) * turn).to_array());
                turns.chain(rods.iter().map(|&place| motion[place])).collect()
            };
            turns.iter().zip(&motions).map(of).collect()
        };
        let (own, held) = (over(&|_| Mat3::IDENTITY), over(&|k| swings[k]));
        let share = symmetric(degrees, |i, j| dot(&own[i], &held[j]));
        let size = share.iter().map(|x| x * x).sum::<f64>().sqrt();
        if 4.0 * size <= RESOLVED {
            return None;
        }
        let unit = |at: usize| f64::from(u8::from(at / degrees == at % degrees));
        let square = product(&share, &share, degrees);
        // q^4, and 1 + q^4.
        let scaled: Vec<f64> = square.iter().map(|x| x * (4.0 / RESOLVED).powi(2)).collect();
        let fourth = product(&scaled, &scaled, degrees);
        let more: Vec<f64> = fourth.iter().enumerate().map(|(at, x)| unit(at) + x).collect();
        let lower = Lower::of(&more, degrees);
        let mut damping = product(&square, &fourth, degrees);
        damping.chunks_exact_mut(degrees).for_each(|row| {
            lower.forward(row);
            lower.backward(row);
        });
        let along = product(&share, &damping, degrees);
        let whole: Vec<f64> = along.iter().enumerate().map(|(at, d)| unit(at) + 3.0 * d).collect();
        Some(Self { motions, turns, damping, factor: Lower::of(&whole, degrees) })
    }

    /// x <- L^-1 x with L L^T = 1 + 3 S D.
    pub(super) fn forward(&self, x: &mut [f64]) {
        self.factor.forward(x);
    }

    /// Y^T (M + kappa) (v+ - v), where `spins` are Y^T kappa (3 v + v-).
    pub(super) fn damped(&self, spins: &[f64]) -> Vec<f64> {
        let row = |row: &[f64]| -row.iter().zip(spins).map(|(d, y)| d * y).sum::<f64>();
        let mut change: Vec<f64> = self.damping.chunks_exact(spins.len().max(1)).map(row).collect();
        self.factor.forward(&mut change);
        self.factor.backward(&mut change);
        change
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rotation_exponential;

    /// Against the torque of a force on a body that is turned: all of it for a force along the arm, none for
    /// one that pushes, and none about the arm.
    #[test]
    fn the_stiffness_is_what_a_small_turn_shows() {
        let arm = Vec3::new(0.3, 0.1, 0.5);
        for force in [16.0 * arm, Vec3::ZERO] {
            let stiffness = restoring(arm, force);
            for turn in [Vec3::X, Vec3::Y, Vec3::Z, arm.normalize()].map(|axis| 1e-6 * axis) {
                let torque = (rotation_exponential(turn) * arm).cross(force);
                assert!((torque + stiffness * turn).length() <= 1e-10 * force.length(), "{torque}");
            }
        }
        assert_eq!(restoring(arm, -arm), Mat3::ZERO);
        let oblique = restoring(arm, Vec3::new(-0.2, 2.0, 8.0));
        assert!((oblique * arm).length() < 1e-15 * oblique.x_axis.length());
    }

    /// One swing of this rate (dt = 1) without damping: the velocity after a step from place q and velocity
    /// v, and its motion with unit inertia.
    fn swing(rate: f64, q: f64, v: f64) -> (f64, f64) {
        let swings = 0.25 * rate * rate;
        (v - rate * rate * q / (1.0 + swings), 1.0 / (1.0 + swings).sqrt())
    }

    /// What a step makes of one swing keeps its energy where the step resolves it, and ends it where it does
    /// not.
    #[test]
    fn fast_swings_are_damped_and_slow_ones_are_not() {
        for (rate, loss) in [(0.7_f64, 0.0_f64), (1.0, 0.02), (2.0, 0.21), (1e3, 1.0)] {
            let swings = 0.25 * rate * rate;
            let after = |q: f64, v: f64| {
                let (free, motion) = swing(rate, q, v);
                let turns = vec![vec![motion * Vec3::X]];
                let kappa = Mat3::from_diagonal(Vec3::new(swings, 0.0, 0.0));
                let change = Stiffening::new(vec![vec![motion]], turns, &[kappa], &[])
                    .map_or(0.0, |own| own.damped(&[motion * swings * (3.0 * free + v)])[0]);
                let v = free + motion * change;
                [q + v, v]
            };
            let [a, b] = [after(1.0, 0.0), after(0.0, 1.0)];
            let determinant: f64 = a[0] * b[1] - b[0] * a[1];
            let is_kept = (determinant - 1.0).abs() < 1e-15;
            assert_eq!(is_kept, loss == 0.0, "{rate} {determinant}");
            assert!(determinant > (1.0 - loss).powi(2) - 1e-15 && determinant < 1.0 + 1e-15);
            if rate > 100.0 {
                assert!(a.iter().chain(&b).all(|x| x.abs() < 3e-4 || (x + 1.0).abs() < 3e-4), "{a:?} {b:?}");
                assert!(a[0].abs() < 3e-4 && b[0].abs() < 3e-4, "{a:?} {b:?}");
            }
        }
    }

    /// Two motions at once: the change obeys its equation, with S from its eigenvectors.
    #[test]
    fn the_damping_of_coupled_swings_is_that_of_their_eigenvectors() {
        let (angle, shares) = (0.6_f64, [0.3_f64, 0.9]);
        let axes = [[angle.cos(), angle.sin()], [-angle.sin(), angle.cos()]];
        let entry = |power: i32, i: usize, j: usize| -> f64 {
            (0..2).map(|k| axes[k][i] * axes[k][j] * shares[k].powi(power)).sum()
        };
        // D S^power.
        let damped = |power: i32, i: usize, j: usize| -> f64 {
            let of = |s: f64| s.powi(2 + power) * (8.0 * s).powi(4) / (1.0 + (8.0 * s).powi(4));
            (0..2).map(|k| axes[k][i] * axes[k][j] * of(shares[k])).sum()
        };
        let stiffness = Mat3::from_cols(
            Vec3::new(entry(1, 0, 0), entry(1, 1, 0), 0.0),
            Vec3::new(entry(1, 0, 1), entry(1, 1, 1), 0.0),
            Vec3::ZERO,
        );
        let motions = vec![vec![1.0, 0.0], vec![0.0, 1.0]];
        let own = Stiffening::new(motions, vec![vec![Vec3::X], vec![Vec3::Y]], &[stiffness], &[]).unwrap();
        let spins = [0.4, -1.1];
        let change = own.damped(&spins);
        for i in 0..2 {
            let left: f64 = (0..2).map(|j| 3.0 * damped(1, i, j) * change[j]).sum::<f64>() + change[i];
            let right: f64 = -(0..2).map(|j| damped(0, i, j) * spins[j]).sum::<f64>();
            assert!((left - right).abs() < 1e-13, "{left} {right}");
        }
    }
}
