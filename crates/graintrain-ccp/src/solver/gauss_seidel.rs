//! `pgs`: projected Gauss-Seidel with over-relaxation (SOR).
//!
//! Source: A. Tasora, M. Anitescu, "A matrix-free cone complementarity approach for solving large-scale, nonsmooth,
//! rigid body dynamics", Computer Methods in Applied Mechanics and Engineering 200:439-453, 2011.

use super::driver::{Best, Limits, check_start};
use super::{CcpSolver, SolveReport, SolveSettings};
use crate::delassus::{Delassus, FIXED, RigidDelassus};
use crate::problem::{Ccp, CcpError};
use crate::residual::{FrictionModel, ResidualScale};
use graintrain_linalg::block3::Block;

/// Projected Gauss-Seidel: contacts one after the other,
///
/// ```text
/// g_i <- P_i( g_i - omega u_i / lambda_i ),   u_i = (N g + r)_i with the newest g,   lambda_i = largest eigenvalue of N_ii
/// ```
///
/// Over bodies the velocities v = M^-1 D g are kept and changed after every contact, so that a sweep costs about one
/// product with N; with a sparse N a sweep is one pass over its rows. The objective falls at every contact for
/// 0 < omega < 2. The contacts are visited in their order by one thread: the result does not depend on threads.
#[derive(Clone, Debug)]
pub struct GaussSeidel {
    /// Over-relaxation omega in (0, 2); default 1.
    pub relaxation: f64,
}

impl Default for GaussSeidel {
    fn default() -> Self {
        Self { relaxation: 1.0 }
    }
}

/// Sweeps between two evaluations of the residual.
const SWEEPS_PER_CHECK: usize = 10;

impl CcpSolver for GaussSeidel {
    fn name(&self) -> String {
        "pgs".to_string()
    }

    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        let limits = Limits::start(settings, 20_000);
        check_start(problem, impulse)?;
        let scale = ResidualScale::new(problem);
        let contacts = problem.num_contacts();
        for i in 0..contacts {
            let g = problem.cone(i).project(std::array::from_fn(|k| impulse[3 * i + k]));
            impulse[3 * i..3 * i + 3].copy_from_slice(&g);
        }
        let step: Vec<f64> = (0..contacts)
            .map(|i| {
                let largest = largest_eigenvalue(&problem.delassus.diagonal_block(i));
                // A contact between immovable bodies: any positive step leads to its solution or to infinity.
                self.relaxation / if largest > 0.0 { largest } else { scale.eta[i] }
            })
            .collect();
        let mut work = problem.delassus.work();
        let mut u = vec![0.0; 3 * contacts];
        let mut velocity = vec![0.0; 6 * problem.delassus.num_bodies()];
        let mut best = Best::default();
        let mut iterations = 0;
        let status = loop {
            // Recomputing v from g at every check keeps rounding from piling up.
            problem.delassus.multiply(impulse, &mut u, &mut work);
            if let Delassus::Rigid(_) = problem.delassus {
                velocity.copy_from_slice(work.body_velocity());
            }
            for (u, r) in u.iter_mut().zip(&problem.r) {
                *u += r;
            }
            let residual = scale.residual(problem, impulse, &u, FrictionModel::Relaxed).max;
            best.offer(impulse, residual);
            if let Some(status) = limits.status(iterations, residual) {
                break status;
            }
            for _ in 0..SWEEPS_PER_CHECK.min(limits.iterations_left(iterations)) {
                match &problem.delassus {
                    Delassus::Rigid(rigid) => sweep_bodies(problem, rigid, &step, impulse, &mut velocity),
                    Delassus::Sparse(matrix) => {
                        for i in 0..contacts {
                            let u = matrix.row_times(i, impulse);
                            relax(problem, i, u, step[i], impulse);
                        }
                    }
                }
                iterations += 1;
            }
        };
        best.restore(impulse);
        let report = limits.report("pgs", problem, impulse, status, iterations, 0);
        Ok(SolveReport { products: iterations, ..report })
    }
}

/// Projects contact i given (N g)_i and returns the change of its impulse.
#[inline]
fn relax(problem: &Ccp, i: usize, ng: [f64; 3], step: f64, g: &mut [f64]) -> [f64; 3] {
    let old = [g[3 * i], g[3 * i + 1], g[3 * i + 2]];
    let new =
        problem.cone(i).project(std::array::from_fn(|k| old[k] - step * (ng[k] + problem.r[3 * i + k])));
    g[3 * i..3 * i + 3].copy_from_slice(&new);
    std::array::from_fn(|k| new[k] - old[k])
}

/// One sweep over all contacts that keeps v = M^-1 D g.
fn sweep_bodies(problem: &Ccp, rigid: &RigidDelassus, step: &[f64], g: &mut [f64], v: &mut [f64]) {
    for i in 0..rigid.num_contacts() {
        let change = relax(problem, i, rigid.contact_velocity(i, v), step[i], g);
        if change == [0.0; 3] {
            continue;
        }
        let contact = &rigid.contacts()[i];
        let [n, t1, t2] = &contact.frame;
        let p: [f64; 3] = std::array::from_fn(|k| n[k] * change[0] + t1[k] * change[1] + t2[k] * change[2]);
        for (body, sign, arm) in [(contact.body_a, 1.0, contact.arm_a), (contact.body_b, -1.0, contact.arm_b)]
        {
            if body == FIXED {
                continue;
            }
            let inverse = &rigid.inverse_mass()[body as usize];
            let moment =
                [arm[1] * p[2] - arm[2] * p[1], arm[2] * p[0] - arm[0] * p[2], arm[0] * p[1] - arm[1] * p[0]];
            let v = &mut v[6 * body as usize..6 * body as usize + 6];
            for k in 0..3 {
                v[k] += sign * inverse.linear[k] * p[k];
                let row = &inverse.angular[3 * k..3 * k + 3];
                v[3 + k] += sign * (row[0] * moment[0] + row[1] * moment[1] + row[2] * moment[2]);
            }
        }
    }
}

/// Largest eigenvalue of a symmetric 3x3 block, by the trigonometric formula for the roots of its characteristic
/// polynomial (Smith 1961); the antisymmetric part is ignored.
fn largest_eigenvalue(a: &Block) -> f64 {
    let mean = (a[0] + a[4] + a[8]) / 3.0;
    let (xy, xz, yz) = (0.5 * (a[1] + a[3]), 0.5 * (a[2] + a[6]), 0.5 * (a[5] + a[7]));
    let (x, y, z) = (a[0] - mean, a[4] - mean, a[8] - mean);
    let p = ((x * x + y * y + z * z + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0).sqrt();
    if p == 0.0 {
        return mean;
    }
    let determinant = x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz);
    let half = (determinant / (2.0 * p * p * p)).clamp(-1.0, 1.0);
    mean + 2.0 * p * (half.acos() / 3.0).cos()
}

/// Makes the solver by name; it has no linear solver.
pub(super) fn build(linear: Option<&str>) -> Result<Box<dyn CcpSolver>, CcpError> {
    super::without_linear_solver("pgs", linear)?;
    Ok(Box::new(GaussSeidel::default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn largest_eigenvalue_of_known_blocks() {
        // Eigenvalues 1, 2, 3 and (rotated by 45 degrees about z) 1, 3, 2.
        assert!((largest_eigenvalue(&[1.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 2.0]) - 3.0).abs() < 1e-14);
        assert!((largest_eigenvalue(&[2.0, 1.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 2.0]) - 3.0).abs() < 1e-14);
        assert_eq!(largest_eigenvalue(&[5.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 5.0]), 5.0);
    }
}
