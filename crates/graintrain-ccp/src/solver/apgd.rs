//! `apgd`: accelerated projected gradient descent with adaptive step and restart.
//!
//! Source: H. Mazhar, T. Heyn, D. Negrut, A. Tasora, "Using Nesterov's method to accelerate multibody dynamics with
//! friction and contact", ACM Transactions on Graphics 34(3):32, 2015, after Nesterov (1983) and, for the restart,
//! O'Donoghue and Candes (2015).

use super::driver::{Best, Limits, check_start};
use super::{CcpSolver, SolveReport, SolveSettings};
use crate::problem::{Ccp, CcpError};
use crate::residual::{FrictionModel, ResidualScale};
use graintrain_linalg::parallel::sum_chunks;

/// Accelerated projected gradient in the metric of eta_i = trace(N_ii) / 3, one scalar per contact, which leaves
/// every cone as it is:
///
/// ```text
/// g+_i = P_i( y_i - t (N y + r)_i / eta_i ),   y = g+ + beta (g+ - g)
/// ```
///
/// t shrinks where the curvature met along a step exceeds 1/t and grows slowly otherwise; beta restarts from zero
/// where the step points uphill.
#[derive(Clone, Debug, Default)]
pub struct Apgd {
    _private: (),
}

impl CcpSolver for Apgd {
    fn name(&self) -> String {
        "apgd".to_string()
    }

    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        let limits = Limits::start(settings, 100_000);
        check_start(problem, impulse)?;
        let scale = ResidualScale::new(problem);
        let contacts = problem.num_contacts();
        let size = 3 * contacts;
        let mut work = problem.delassus.work();
        for i in 0..contacts {
            let x = problem.cone(i).project(std::array::from_fn(|k| impulse[3 * i + k]));
            impulse[3 * i..3 * i + 3].copy_from_slice(&x);
        }
        let mut x = impulse.to_vec();
        let mut nx = vec![0.0; size];
        problem.delassus.multiply(&x, &mut nx, &mut work);
        let mut y = x.clone();
        let mut ny = nx.clone();
        let mut x_new = vec![0.0; size];
        let mut nx_new = vec![0.0; size];
        let mut u = vec![0.0; size];
        let mut best = Best::default();
        let mut step = 1.0;
        let mut theta = 1.0_f64;
        let mut iterations = 0;
        let status = loop {
            for k in 0..size {
                u[k] = nx[k] + problem.r[k];
            }
            let residual = scale.residual(problem, &x, &u, FrictionModel::Relaxed).max;
            best.offer(&x, residual);
            if let Some(status) = limits.status(iterations, residual) {
                break status;
            }
            iterations += 1;
            // Backtrack until the quadratic model with curvature 1/step majorises the objective along the step:
            // (x+ - y)^T N (x+ - y) <= |x+ - y|_eta^2 / step. N is linear, so this needs no further product.
            loop {
                for i in 0..contacts {
                    let s = step / scale.eta[i];
                    let p = problem.cone(i).project(std::array::from_fn(|k| {
                        y[3 * i + k] - s * (ny[3 * i + k] + problem.r[3 * i + k])
                    }));
                    x_new[3 * i..3 * i + 3].copy_from_slice(&p);
                }
                problem.delassus.multiply(&x_new, &mut nx_new, &mut work);
                let curvature =
                    sum_chunks(size, |range| range.map(|k| (x_new[k] - y[k]) * (nx_new[k] - ny[k])).sum());
                let length = sum_chunks(size, |range| {
                    range.map(|k| scale.eta[k / 3] * (x_new[k] - y[k]).powi(2)).sum()
                });
                if curvature * step <= length * (1.0 + 1e-9) || step < 1e-12 {
                    break;
                }
                step = (0.95 * length / curvature).min(0.9 * step);
            }
            let uphill = sum_chunks(size, |range| {
                range.map(|k| scale.eta[k / 3] * (y[k] - x_new[k]) * (x_new[k] - x[k])).sum()
            });
            let beta = if uphill > 0.0 {
                theta = 1.0;
                0.0
            } else {
                let next = 0.5 * (1.0 + (1.0 + 4.0 * theta * theta).sqrt());
                let beta = (theta - 1.0) / next;
                theta = next;
                beta
            };
            for k in 0..size {
                y[k] = x_new[k] + beta * (x_new[k] - x[k]);
                ny[k] = nx_new[k] + beta * (nx_new[k] - nx[k]);
            }
            std::mem::swap(&mut x, &mut x_new);
            std::mem::swap(&mut nx, &mut nx_new);
            step *= 1.02;
        };
        best.restore(impulse);
        Ok(limits.report("apgd", problem, impulse, status, iterations, 0))
    }
}

/// Makes the solver by name; it has no linear solver.
pub(super) fn build(linear: Option<&str>) -> Result<Box<dyn CcpSolver>, CcpError> {
    super::without_linear_solver("apgd", linear)?;
    Ok(Box::new(Apgd::default()))
}
