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

/// 1 + dt^2/4 Y^T K Y in its Cholesky factor, where swings are not resolved.
#[derive(Clone, Debug)]
pub(super) struct Stiffening {
    /// Basis of the free motions in the coordinates of the elimination.
    pub motions: Vec<Vec<f64>>,
    /// Lower triangle by rows, all columns stored.
    lower: Vec<f64>,
}

impl Stiffening {
    /// With the free motions, their turns (rad/s per unit, one per body) and the stiffness of every body. `None` where the step resolves all
    /// swings.
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
        for i in 0..degrees {
            for j in 0..=i {
                let before: f64 = (0..j).map(|k| matrix[i * degrees + k] * matrix[j * degrees + k]).sum();
                let rest = matrix[i * degrees + j] - before;
                // At least 1: the stiffness has no negative eigenvalues.
                matrix[i * degrees + j] =
                    if i == j { rest.max(1.0).sqrt() } else { rest / matrix[j * degrees + j] };
            }
        }
        Some(Self { motions, lower: matrix })
    }

    /// x <- L^-1 x.
    pub(super) fn forward(&self, x: &mut [f64]) {
        let degrees = x.len();
        for i in 0..degrees {
            let before: f64 = (0..i).map(|k| self.lower[i * degrees + k] * x[k]).sum();
            x[i] = (x[i] - before) / self.lower[i * degrees + i];
        }
    }

    /// x <- L^-T x.
    fn backward(&self, x: &mut [f64]) {
        let degrees = x.len();
        for i in (0..degrees).rev() {
            let after: f64 = (i + 1..degrees).map(|k| self.lower[k * degrees + i] * x[k]).sum();
            x[i] = (x[i] - after) / self.lower[i * degrees + i];
        }
    }

    /// Adds to z what the stiffness makes of the change `before` + Q^T z in the free motions.
    pub(super) fn hold(&self, before: &[f64], z: &mut [f64]) {
        let project = |motion: &Vec<f64>| motion.iter().zip(&*z).map(|(m, z)| m * z).sum::<f64>();
        let change: Vec<f64> =
            before.iter().zip(&self.motions).map(|(b, motion)| b + project(motion)).collect();
        let mut held = change.clone();
        self.forward(&mut held);
        self.backward(&mut held);
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
}
