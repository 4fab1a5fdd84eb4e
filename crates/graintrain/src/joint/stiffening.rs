//! Bodies that hang in joints under load swing about them: a heavy weight on a light chain makes it stiff across, as a taut string is.
//!
//! The force F of a joint on a body, r from its centre, turns against a rotation theta with the torque -K theta,
//!
//! ```text
//! K = (r . F) 1 - (r F^T + F r^T) / 2
//! ```
//!
//! (geometric stiffness). Joints act in the places where bodies are when a step begins; the swing about them is stable as long as dt times its
//! rate is below 2. A chain of links of 0.1 kg with a weight of 100 t swings ten times as fast. So the part of K that restores (its
//! eigenvalues above zero) takes the mean over three steps in the motions that joints leave free, as springs do ([`super::Spring`]): with the
//! basis Y of these motions, `Y^T M Y = 1`,
//!
//! ```text
//! (1 + dt^2 / 4 Y^T K Y) Y^T M (v+ - v-) = Y^T M (v - v-)
//! ```
//!
//! where v would be the velocities without. It keeps energy and is stable for any load and step; mechanisms whose swings the step resolves
//! are left alone. Forces are those of the step before.
//!
//! Swings far beyond the step would keep for ever what the first step under a new load gave them, and their least change of direction works
//! against the whole load. With `C = 1 + dt^2 / 4 Y^T K Y` they are damped by
//!
//! ```text
//! D = (C - 1) (1 - C^-1)^4,      (C + D) Y^T M (v+ - v-) = Y^T M (v - v-) - D Y^T M v-
//! ```
//!
//! D is a function of the stiffness: a swing, or a bob whirled on a joint, with dt times its rate of 0.5 loses 4e-7 of itself in a step, one
//! of 1 2e-4, one of 2 3 %, and the fastest ones 30 %.
//!
//! Source: M. Tournier, M. Nesme, B. Gilles, F. Faure, "Stable constrained dynamics", ACM Transactions on Graphics 34(4):132, 2015, there
//! with an implicit step, which damps; the mean: N. M. Newmark, "A method of computation for structural dynamics", Journal of the
//! Engineering Mechanics Division 85(3):67-94, 1959.

use crate::math::{Mat3, Vec3};

/// Swings with (dt rate)^2 below this are left alone.
pub(super) const RESOLVED: f64 = 0.1;

/// The restoring part of the stiffness of a force at an arm, N m/rad.
pub(super) fn restoring(arm: Vec3, force: Vec3) -> Mat3 {
    let (r, f) = (arm.length(), force.length());
    if r <= 0.0 || f <= 0.0 {
        return Mat3::ZERO;
    }
    let (unit, along) = (arm / r, force / f);
    let (dot, size) = (arm.dot(force), r * f);
    let outer = |e: Vec3| Mat3::from_cols(e.x * e, e.y * e, e.z * e);
    let across = unit.cross(along);
    if across.length() < 1e-9 {
        return if dot > 0.0 { dot * (Mat3::IDENTITY - outer(unit)) } else { Mat3::ZERO };
    }
    // Eigenvectors: the normal of the plane of both, and their difference; that of their sum drives away.
    let difference = (unit - along).normalize();
    dot.max(0.0) * outer(across.normalize()) + 0.5 * (dot + size) * outer(difference)
}

/// C + D, where swings are not resolved.
#[derive(Clone, Debug)]
pub(super) struct Stiffening {
    /// Basis of the free motions in the coordinates of the elimination.
    pub motions: Vec<Vec<f64>>,
    /// D, by rows.
    damping: Vec<f64>,
    /// Cholesky factor of C + D.
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
                let before: f64 = rows[0].iter().zip(rows[1]).map(|(a, b)| a * b).sum();
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
            let before: f64 = row[..i].iter().zip(&*x).map(|(l, x)| l * x).sum();
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

    /// (L L^T)^-1, all entries.
    fn inverse(&self) -> Vec<f64> {
        let mut inverse = vec![0.0; self.degrees * self.degrees];
        for (k, column) in inverse.chunks_exact_mut(self.degrees.max(1)).enumerate() {
            column[k] = 1.0;
            self.forward(column);
            self.backward(column);
        }
        inverse
    }
}

/// Of symmetric matrices that commute.
fn product(a: &[f64], b: &[f64], degrees: usize) -> Vec<f64> {
    let row = |of: &[f64], k: usize, l: usize| of[k * degrees + l];
    let entry = |at: usize| (0..degrees).map(|l| row(a, at / degrees, l) * row(b, at % degrees, l)).sum();
    (0..a.len()).map(entry).collect()
}

impl Stiffening {
    /// With the free motions, their turns (rad/s per unit, one per body) and the stiffness of every body. `None` where the step resolves all
    /// swings. Cost: a few products of square matrices of as many rows as there are motions.
    pub(super) fn new(
        motions: Vec<Vec<f64>>,
        turns: &[Vec<Vec3>],
        stiffness: &[Mat3],
        step: f64,
    ) -> Option<Self> {
        let degrees = motions.len();
        let mut matrix = vec![0.0; degrees * degrees];
        let mut square = 0.0;
        for i in 0..degrees {
            for j in 0..=i {
                let bodies = stiffness.iter().zip(turns[i].iter().zip(&turns[j]));
                let entry: f64 = bodies.map(|(k, (a, b))| a.dot(*k * *b)).sum();
                square += if i == j { 1.0 } else { 2.0 } * entry * entry;
                matrix[i * degrees + j] = 0.25 * step * step * entry + f64::from(u8::from(i == j));
            }
        }
        if step * step * square.sqrt() <= RESOLVED {
            return None;
        }
        let unit = |at: usize| f64::from(u8::from(at / degrees == at % degrees));
        let whole =
            |at: usize| matrix[(at / degrees).max(at % degrees) * degrees + (at / degrees).min(at % degrees)];
        let excess: Vec<f64> = (0..matrix.len()).map(|at| whole(at) - unit(at)).collect();
        let inverse = Lower::of(&matrix, degrees).inverse();
        let share: Vec<f64> = inverse.iter().enumerate().map(|(at, x)| unit(at) - x).collect();
        let square = product(&share, &share, degrees);
        let damping = product(&excess, &product(&square, &square, degrees), degrees);
        matrix.iter_mut().zip(&damping).for_each(|(c, d)| *c += d);
        Some(Self { motions, damping, factor: Lower::of(&matrix, degrees) })
    }

    /// x <- L^-1 x with L L^T = C + D.
    pub(super) fn forward(&self, x: &mut [f64]) {
        self.factor.forward(x);
    }

    /// Adds to z what the stiffness makes of the motions `before` = Y^T M v-, which forces changed by `change` + Q^T z.
    pub(super) fn hold(&self, before: &[f64], change: &[f64], z: &mut [f64]) {
        let degrees = before.len();
        let project = |motion: &Vec<f64>| motion.iter().zip(&*z).map(|(m, z)| m * z).sum::<f64>();
        let change: Vec<f64> =
            change.iter().zip(&self.motions).map(|(c, motion)| c + project(motion)).collect();
        let damped = |row: &[f64]| row.iter().zip(before).map(|(d, y)| d * y).sum::<f64>();
        let rows = self.damping.chunks_exact(degrees.max(1));
        let mut held: Vec<f64> = change.iter().zip(rows).map(|(c, row)| c - damped(row)).collect();
        self.factor.forward(&mut held);
        self.factor.backward(&mut held);
        for ((held, change), motion) in held.iter().zip(&change).zip(&self.motions) {
            z.iter_mut().zip(motion).for_each(|(z, m)| *z += (held - change) * m);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The restoring part and the symmetric stiffness differ by what drives away: one negative eigenvalue, or all where force and arm are
    /// opposed.
    #[test]
    fn the_restoring_part_is_the_positive_one() {
        let pairs = [
            (Vec3::new(0.0, 0.0, 0.5), Vec3::new(0.0, 0.0, 8.0)),
            (Vec3::new(0.3, 0.1, 0.5), Vec3::new(-0.2, 2.0, 8.0)),
            (Vec3::new(0.3, 0.1, 0.5), Vec3::new(-0.2, -2.0, -8.0)),
            (Vec3::new(0.0, 0.0, -0.5), Vec3::new(0.0, 0.0, 8.0)),
        ];
        for (arm, force) in pairs {
            let outer = |a: Vec3, b: Vec3| Mat3::from_cols(b.x * a, b.y * a, b.z * a);
            let whole = arm.dot(force) * Mat3::IDENTITY - 0.5 * (outer(arm, force) + outer(force, arm));
            let positive = restoring(arm, force);
            let negative = positive - whole;
            let size = arm.length() * force.length();
            for direction in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE, Vec3::new(1.0, -2.0, 0.3)] {
                assert!(direction.dot(positive * direction) > -1e-14 * size);
                assert!(direction.dot(negative * direction) > -1e-14 * size);
            }
            let product = positive * negative;
            assert!(product.to_cols_array().iter().all(|x| x.abs() < 1e-13 * size * size), "{product}");
        }
    }

    /// D of one motion is (C - 1)^5 / C^4, and what is held is the answer of the scalar equation.
    #[test]
    fn fast_swings_are_damped_and_slow_ones_are_not() {
        for (rate, loss) in [(0.4, 1e-7), (2.0, 0.032), (1e6, 1.0)] {
            let stiffness = Mat3::from_diagonal(Vec3::new(rate * rate, 0.0, 0.0));
            let held = Stiffening::new(vec![vec![1.0]], &[vec![Vec3::X]], &[stiffness], 1.0).unwrap();
            let c = 1.0 + 0.25 * rate * rate;
            let d = (c - 1.0).powi(5) / c.powi(4);
            assert!((held.damping[0] - d).abs() < 1e-14 * c, "{} {d}", held.damping[0]);
            assert!(d <= 1.01 * loss * c, "{rate}: {}", d / c);
            let mut z = [0.7];
            held.hold(&[2.0], &[0.3], &mut z);
            assert!((z[0] + 0.3 - (1.0 - 2.0 * d) / (c + d)).abs() < 1e-13, "{z:?}");
        }
    }

    /// Two motions at once: (C + D) times what came of it is what went in, with D from C by its eigenvectors.
    #[test]
    fn the_damping_of_coupled_swings_is_that_of_their_eigenvectors() {
        let (angle, rates) = (0.6_f64, [0.9_f64, 7.0]);
        let axes = [[angle.cos(), angle.sin()], [-angle.sin(), angle.cos()]];
        let function = |f: &dyn Fn(f64) -> f64, i: usize, j: usize| -> f64 {
            (0..2).map(|k| axes[k][i] * axes[k][j] * f(1.0 + 0.25 * rates[k] * rates[k])).sum()
        };
        let entry = |i, j| 4.0 * function(&|c| c - 1.0, i, j);
        let stiffness = Mat3::from_cols(
            Vec3::new(entry(0, 0), entry(1, 0), 0.0),
            Vec3::new(entry(0, 1), entry(1, 1), 0.0),
            Vec3::ZERO,
        );
        let motions = vec![vec![1.0, 0.0], vec![0.0, 1.0]];
        let turns = [vec![Vec3::X], vec![Vec3::Y]];
        let held = Stiffening::new(motions, &turns, &[stiffness], 1.0).unwrap();
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let damping = function(&|c| (c - 1.0).powi(5) / c.powi(4), i, j);
            assert!((held.damping[2 * i + j] - damping).abs() < 1e-13, "{i} {j}");
        }
        let (before, change, mut z) = ([0.4, -1.1], [0.2, 0.5], [0.0, 0.0]);
        held.hold(&before, &change, &mut z);
        for i in 0..2 {
            let whole = |j| function(&|c| c + (c - 1.0).powi(5) / c.powi(4), i, j);
            let damped = |j: usize| held.damping[2 * i + j] * before[j];
            let left = (0..2).map(|j| whole(j) * (z[j] + change[j]) + damped(j)).sum::<f64>();
            assert!((left - change[i]).abs() < 1e-12, "{left}");
        }
    }
}
