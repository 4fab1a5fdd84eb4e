//! `pdip`: the primal-dual interior point of Corona, Gorsich, Jayakumar and Veerapaneni (2019), after Boyd and
//! Vandenberghe (2004), section 11.7.
//!
//! Two constraints per contact, f_1 = 1/2 (g_1^2 + g_2^2 - mu^2 g_n^2) <= 0 and f_2 = -g_n <= 0, with multipliers
//! lambda > 0, and the perturbed optimality conditions
//!
//! ```text
//! r_d = N g + r + sum_k lambda_k grad f_k = 0,      r_c = -lambda_k f_k - 1/tau = 0
//! ```
//!
//! Newton's step eliminates the multipliers:
//!
//! ```text
//! S dg = -r_d + sum_k grad f_k r_c,k / (-f_k),      dlambda_k = (-r_c,k + lambda_k grad f_k . dg) / (-f_k)
//! S = N + sum_k ( lambda_k Hess f_k + lambda_k / (-f_k) grad f_k grad f_k^T )
//! ```
//!
//! The problem is scaled first: impulses by J (see [`ResidualScale`]), velocities by J times the mean of eta. S = N + H is
//! scaled from both sides with the factors of H^-1 = F F^T: (I + F^T N F) z = F^T b, dg = F z (see [`crate::newton`]). The
//! iteration is the paper's; without the scaling rounding ends it at residuals near 1e-5.

use super::driver::{Best, Limits, check_start};
use super::{CcpSolver, SolveReport, SolveSettings, Status};
use crate::delassus::DelassusWork;
use crate::newton::driver::{NewtonDriver, ScaledBlocks};
use crate::newton::{apply_blocks, apply_blocks_in_place, linear_solver};
use crate::problem::{Ccp, CcpError};
use crate::residual::ResidualScale;
use graintrain_linalg::block3::Block;

/// tau = TAU_FACTOR x (number of constraints) / eta.
const TAU_FACTOR: f64 = 10.0;
/// Fraction of the step to the boundary of lambda > 0.
const BOUNDARY: f64 = 0.99;
/// Factor by which backtracking shortens the step.
const BACKTRACK: f64 = 0.8;
/// Decrease of |(r_d, r_c)| asked of a step s: by the factor 1 - DECREASE s.
const DECREASE: f64 = 0.01;
/// Backtracking stops below this step.
const SHORTEST_STEP: f64 = 1e-10;
/// Relative residual of the linear solves at first; where no step lowers |(r_d, r_c)| it is tightened by
/// [`LINEAR_TIGHTENING`] down to [`LINEAR_FINEST`] before the method gives up.
const LINEAR_TOLERANCE: f64 = 1e-6;
/// See [`LINEAR_TOLERANCE`].
const LINEAR_TIGHTENING: f64 = 1e-3;
/// See [`LINEAR_TOLERANCE`].
const LINEAR_FINEST: f64 = 1e-13;
/// Iterations allowed where the settings name no limit.
const ITERATIONS: usize = 300;
/// Smallest mu used: with mu = 0 the cone has no interior. The error is a tangential impulse of this size.
const SMALLEST_FRICTION: f64 = 1e-7;

/// The primal-dual interior point of the paper.
pub struct Pdip {
    newton: NewtonDriver,
}

/// One contact at scaled impulse g: constraints and what Newton's matrix needs of them.
struct Constraints {
    f: [f64; 2],
    cone_gradient: [f64; 3],
}

impl Constraints {
    #[inline]
    fn new(mu: f64, g: &[f64]) -> Self {
        let m = mu * mu;
        // (|g_t| - mu g_n) (|g_t| + mu g_n) / 2 loses no digits near the boundary.
        let tangential = g[1].hypot(g[2]);
        let cone = 0.5 * (tangential - mu * g[0]) * (tangential + mu * g[0]);
        Self { f: [cone, -g[0]], cone_gradient: [-m * g[0], g[1], g[2]] }
    }

    /// H = lambda_1 Hess f_1 + sum_k lambda_k / (-f_k) grad f_k grad f_k^T with its factors.
    ///
    /// Across the tangential impulse H is lambda_1. In the plane of the normal and that impulse, with rho = |g_t| and
    /// c = (mu^2 g_n^2 + rho^2) / (-2 f_1), which is never below 1,
    ///
    /// ```text
    /// H_rr = lambda_1 c,   H_nr = -lambda_1 mu^2 g_n rho / (-f_1),   H_nn = lambda_1 mu^2 c + lambda_2 / g_n
    /// det = lambda_1^2 mu^2 + lambda_1 c lambda_2 / g_n
    /// ```
    ///
    /// No term of the determinant cancels, so that the Cholesky factor H = B L L^T B^T, rows in the order r, n, s of the basis
    /// B, has full relative accuracy next to the boundary. F = B L^-T.
    #[inline]
    fn newton_blocks(&self, mu: f64, g: &[f64], lambda: &[f64]) -> NewtonBlocks {
        let m = mu * mu;
        let rho = g[1].hypot(g[2]);
        let along = if rho > 0.0 { [g[1] / rho, g[2] / rho] } else { [1.0, 0.0] };
        let gap = -self.f[0];
        let c = ((m * g[0] * g[0] + rho * rho) / (2.0 * gap)).max(1.0);
        let other = lambda[1] / -self.f[1];
        let (rr, nr) = (lambda[0] * c, -lambda[0] * m * g[0] * rho / gap);
        let nn = lambda[0] * m * c + other;
        let determinant = lambda[0] * (lambda[0] * m + c * other);
        // L = [[p, 0, 0], [q, s, 0], [0, 0, t]] in the order r, n, s.
        let (p, t) = (rr.sqrt(), lambda[0].sqrt());
        let (q, s) = (nr / p, (determinant / rr).sqrt());
        let [x, y] = along;
        // Columns of B: r = (0, x, y), n = (1, 0, 0), s = (0, -y, x).
        NewtonBlocks {
            added: [
                nn,
                nr * x,
                nr * y,
                nr * x,
                rr * x * x + lambda[0] * y * y,
                (rr - lambda[0]) * x * y,
                nr * y,
                (rr - lambda[0]) * x * y,
                rr * y * y + lambda[0] * x * x,
            ],
            // B L^-T, L^-T = [[1/p, -q/(p s), 0], [0, 1/s, 0], [0, 0, 1/t]].
            factor: [0.0, 1.0 / s, 0.0, x / p, -x * q / (p * s), -y / t, y / p, -y * q / (p * s), x / t],
            // L^T B^T, L^T = [[p, q, 0], [0, s, 0], [0, 0, t]].
            factor_inverse: [q, p * x, p * y, s, 0.0, 0.0, 0.0, -t * y, t * x],
            // L^-1 B^T grad f_1 with the difference taken in closed form.
            gradient: [rho / p, -m * g[0] / (c * s)],
        }
    }

    /// sum_k c_k grad f_k.
    #[inline]
    fn combine(&self, c: [f64; 2]) -> [f64; 3] {
        let d = &self.cone_gradient;
        [c[0] * d[0] - c[1], c[0] * d[1], c[0] * d[2]]
    }
}

/// What one contact adds to Newton's matrix; see [`Constraints::newton_blocks`].
struct NewtonBlocks {
    /// H.
    added: Block,
    /// F.
    factor: Block,
    /// F^-1.
    factor_inverse: Block,
    /// First two components of F^T grad f_1; the third is zero.
    gradient: [f64; 2],
}

/// Scaled iterate with what is known about it.
struct Iterate {
    g: Vec<f64>,
    lambda: Vec<f64>,
    /// N g + r, scaled.
    u: Vec<f64>,
}

/// Squared norm of (r_d, r_c), or `None` where the iterate is not strictly feasible.
fn residual_square(friction: &[f64], it: &Iterate, tau: f64) -> Option<f64> {
    let mut sum = 0.0;
    for (i, &mu) in friction.iter().enumerate() {
        let constraints = Constraints::new(mu, &it.g[3 * i..3 * i + 3]);
        let lambda = [it.lambda[2 * i], it.lambda[2 * i + 1]];
        let push = constraints.combine(lambda);
        for k in 0..2 {
            if constraints.f[k] >= 0.0 || constraints.f[k].is_nan() {
                return None;
            }
            sum += (-lambda[k] * constraints.f[k] - 1.0 / tau).powi(2);
        }
        for k in 0..3 {
            sum += (it.u[3 * i + k] + push[k]).powi(2);
        }
    }
    Some(sum)
}

/// A strictly feasible start: normal impulse 1 where nothing better is known, tangential impulses inside the cone.
fn start(friction: &[f64], impulse: &[f64], scale: f64) -> Vec<f64> {
    let mut g = vec![0.0; impulse.len()];
    let known = impulse.iter().any(|&x| x != 0.0);
    for (i, &mu) in friction.iter().enumerate() {
        let (out, old) = (&mut g[3 * i..3 * i + 3], &impulse[3 * i..3 * i + 3]);
        out[0] = if known { (old[0] / scale).max(1e-2) } else { 1.0 };
        let tangential = old[1].hypot(old[2]) / scale;
        if known && tangential > 0.0 {
            let shrink = (0.5 * mu * out[0] / tangential).min(1.0) / scale;
            out[1] = shrink * old[1];
            out[2] = shrink * old[2];
        }
    }
    g
}

impl Pdip {
    /// With the linear solver of this name (see [`crate::newton`]).
    ///
    /// # Errors
    /// [`CcpError::UnknownSolver`].
    pub fn new(linear: &str) -> Result<Self, CcpError> {
        Ok(Self { newton: NewtonDriver::new(linear_solver("pdip", linear)?) })
    }
}

pub(super) fn build(linear: Option<&str>) -> Result<Box<dyn CcpSolver>, CcpError> {
    Ok(Box::new(Pdip::new(linear.unwrap_or("cholesky"))?))
}

impl CcpSolver for Pdip {
    fn name(&self) -> String {
        format!("pdip+{}", self.newton.linear_name())
    }

    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        let limits = Limits::start(settings, ITERATIONS);
        check_start(problem, impulse)?;
        self.newton.begin(problem);
        let contacts = problem.num_contacts();
        let size = 3 * contacts;
        let scale = ResidualScale::new(problem);
        let eta = scale.eta.iter().sum::<f64>() / contacts.max(1) as f64;
        let (impulse_unit, velocity_unit) = (scale.impulse, scale.impulse * eta);
        let friction: Vec<f64> = problem.friction.iter().map(|mu| mu.max(SMALLEST_FRICTION)).collect();
        let mut product = problem.delassus.work();
        // u <- (N g J + r) / (J eta).
        let velocity = |g: &[f64], u: &mut [f64], product: &mut DelassusWork| {
            problem.delassus.multiply(g, u, product);
            for (u, r) in u.iter_mut().zip(&problem.r) {
                *u = *u / eta + r / velocity_unit;
            }
        };

        let g = start(&friction, impulse, impulse_unit);
        let mut it = Iterate { g, lambda: vec![0.0; 2 * contacts], u: vec![0.0; size] };
        let mut trial = Iterate { g: vec![0.0; size], lambda: vec![0.0; 2 * contacts], u: vec![0.0; size] };
        velocity(&it.g, &mut it.u, &mut product);
        for (i, &mu) in friction.iter().enumerate() {
            let constraints = Constraints::new(mu, &it.g[3 * i..3 * i + 3]);
            for k in 0..2 {
                it.lambda[2 * i + k] = -1.0 / constraints.f[k];
            }
        }
        let (mut added, mut factor) = (vec![[0.0; 9]; contacts], vec![[0.0; 9]; contacts]);
        let (mut factor_inverse, mut gradient) = (vec![[0.0; 9]; contacts], vec![[0.0; 2]; contacts]);
        let (mut rhs, mut z) = (vec![0.0; size], vec![0.0; size]);
        let (mut dg, mut ndg) = (vec![0.0; size], vec![0.0; size]);
        let mut dlambda = vec![0.0; 2 * contacts];
        let (mut physical, mut best) = (vec![0.0; size], Best::default());
        let mut iterations = 0;
        let mut linear_tolerance = LINEAR_TOLERANCE;
        let status = loop {
            // The residual of the problem itself, in its own units.
            for (physical, g) in physical.iter_mut().zip(&it.g) {
                *physical = impulse_unit * g;
            }
            for (rhs, u) in rhs.iter_mut().zip(&it.u) {
                *rhs = velocity_unit * u;
            }
            let residual = scale.residual(problem, &physical, &rhs, settings.friction).max;
            best.offer(&physical, residual);
            if let Some(status) = limits.status(iterations, residual) {
                break status;
            }

            let mut gap = 0.0;
            for (i, &mu) in friction.iter().enumerate() {
                let constraints = Constraints::new(mu, &it.g[3 * i..3 * i + 3]);
                gap -= constraints.f[0] * it.lambda[2 * i] + constraints.f[1] * it.lambda[2 * i + 1];
            }
            let tau = TAU_FACTOR * (2 * contacts) as f64 / gap;
            for (i, &mu) in friction.iter().enumerate() {
                let constraints = Constraints::new(mu, &it.g[3 * i..3 * i + 3]);
                let lambda = &it.lambda[2 * i..2 * i + 2];
                let blocks = constraints.newton_blocks(mu, &it.g[3 * i..3 * i + 3], lambda);
                // H in units of N; F^T N F is then without units, and z that of the scaled problem.
                added[i] = blocks.added.map(|x| x * eta);
                factor[i] = blocks.factor.map(|x| x / eta.sqrt());
                factor_inverse[i] = blocks.factor_inverse.map(|x| x * eta.sqrt());
                gradient[i] = blocks.gradient.map(|x| x / eta.sqrt());
                // -r_d + sum_k grad f_k r_c,k / (-f_k), with r_c,k / (-f_k) = lambda_k + 1 / (tau f_k): lambda cancels.
                let push = constraints.combine(std::array::from_fn(|k| 1.0 / (tau * constraints.f[k])));
                for k in 0..3 {
                    rhs[3 * i + k] = eta * (push[k] - it.u[3 * i + k]);
                }
            }
            let blocks = ScaledBlocks { added: &added, factor: &factor, factor_inverse: &factor_inverse };
            if self.newton.refresh(problem, blocks, iterations, residual).is_err() {
                break Status::Stalled;
            }
            apply_blocks_in_place(&factor, &mut rhs, true);
            self.newton.solve(problem, blocks, &rhs, &mut z, linear_tolerance);
            apply_blocks(&factor, &z, &mut dg, false);
            problem.delassus.multiply(&dg, &mut ndg, &mut product);
            let mut longest = 1.0_f64;
            for (i, &mu) in friction.iter().enumerate() {
                let constraints = Constraints::new(mu, &it.g[3 * i..3 * i + 3]);
                let step = &dg[3 * i..3 * i + 3];
                let cone = gradient[i][0] * z[3 * i] + gradient[i][1] * z[3 * i + 1];
                let along = [cone, -step[0]];
                for k in 0..2 {
                    let (lambda, f) = (it.lambda[2 * i + k], constraints.f[k]);
                    let change = -lambda - 1.0 / (tau * f) - lambda * along[k] / f;
                    dlambda[2 * i + k] = change;
                    if change < 0.0 {
                        longest = longest.min(-BOUNDARY * lambda / change);
                    }
                }
            }
            let before = residual_square(&friction, &it, tau).unwrap_or(f64::INFINITY).sqrt();
            let mut step = longest;
            let accepted = loop {
                for k in 0..size {
                    trial.g[k] = it.g[k] + step * dg[k];
                    trial.u[k] = it.u[k] + step * ndg[k] / eta;
                }
                for k in 0..2 * contacts {
                    trial.lambda[k] = it.lambda[k] + step * dlambda[k];
                }
                let after = residual_square(&friction, &trial, tau);
                if after.is_some_and(|square| square.sqrt() <= (1.0 - DECREASE * step) * before) {
                    break true;
                }
                step *= BACKTRACK;
                if step < SHORTEST_STEP {
                    break false;
                }
            };
            self.newton.end_iteration(if accepted { step } else { 0.0 });
            if !accepted {
                if linear_tolerance <= LINEAR_FINEST {
                    break Status::Stalled;
                }
                linear_tolerance = (linear_tolerance * LINEAR_TIGHTENING).max(LINEAR_FINEST);
                continue;
            }
            std::mem::swap(&mut it, &mut trial);
            iterations += 1;
            if iterations % 10 == 0 {
                // Rounding in the updated velocities must not accumulate.
                velocity(&it.g, &mut it.u, &mut product);
            }
        };
        best.restore(impulse);
        let linear_iterations = self.newton.linear_iterations();
        let mut report = limits.report(&self.name(), problem, impulse, status, iterations, linear_iterations);
        report.newton = self.newton.take_records();
        Ok(report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The Lagrangian's second derivatives by central differences of its first ones.
    #[test]
    fn newton_block_matches_finite_differences_of_the_eliminated_system() {
        let (mu, g, lambda, tau) = (0.4, [1.3, 0.2, -0.3], [0.7, 0.25], 5.0);
        // With lambda eliminated by r_c = 0 linearised, the derivative of the push along dg is the block: compare
        // d/dg [ sum lambda_k(g) grad f_k(g) ] where lambda_k changes by dlambda_k = lambda_k grad f_k . dg / (-f_k).
        let push = |g: [f64; 3]| {
            let base = Constraints::new(mu, &[1.3, 0.2, -0.3]);
            let change: [f64; 2] = std::array::from_fn(|k| {
                let gradient = if k == 0 { base.cone_gradient } else { [-1.0, 0.0, 0.0] };
                let along: f64 = (0..3).map(|d| gradient[d] * (g[d] - [1.3, 0.2, -0.3][d])).sum();
                lambda[k] * along / -base.f[k]
            });
            Constraints::new(mu, &g).combine([lambda[0] + change[0], lambda[1] + change[1]])
        };
        let blocks = Constraints::new(mu, &g).newton_blocks(mu, &g, &lambda);
        let NewtonBlocks { added: block, factor, factor_inverse, gradient } = blocks;
        let unit = |r: usize, c: usize| f64::from(u8::from(r == c));
        for r in 0..3 {
            for c in 0..3 {
                let product: f64 = (0..3).map(|k| factor[3 * r + k] * factor_inverse[3 * k + c]).sum();
                assert!((product - unit(r, c)).abs() < 1e-13);
                // F^T H F = I.
                let product: f64 =
                    (0..9).map(|k| factor[3 * (k / 3) + r] * block[k] * factor[3 * (k % 3) + c]).sum();
                assert!((product - unit(r, c)).abs() < 1e-13);
            }
            let image: f64 =
                (0..3).map(|k| factor[3 * k + r] * Constraints::new(mu, &g).cone_gradient[k]).sum();
            assert!((image - [gradient[0], gradient[1], 0.0][r]).abs() < 1e-13);
        }
        let h = 1e-6;
        for c in 0..3 {
            let (mut plus, mut minus) = (g, g);
            plus[c] += h;
            minus[c] -= h;
            let (plus, minus) = (push(plus), push(minus));
            for r in 0..3 {
                let difference = (plus[r] - minus[r]) / (2.0 * h);
                assert!((block[3 * r + c] - difference).abs() < 1e-7, "({r}, {c}): {difference}");
            }
        }
        // Gradients and values of the constraints themselves.
        let constraints = Constraints::new(mu, &g);
        for c in 0..3 {
            let (mut plus, mut minus) = (g, g);
            plus[c] += h;
            minus[c] -= h;
            let (plus, minus) = (Constraints::new(mu, &plus), Constraints::new(mu, &minus));
            let cone = (plus.f[0] - minus.f[0]) / (2.0 * h);
            assert!((constraints.cone_gradient[c] - cone).abs() < 1e-8);
        }
        assert!((constraints.f[0] - 0.5 * (0.04 + 0.09 - 0.16 * 1.69)).abs() < 1e-15);
        // The step solves the linearised conditions: r_c + d r_c = 0.
        let along = 0.01;
        for k in 0..2 {
            let (l, f) = (lambda[k], constraints.f[k]);
            let change = -l - 1.0 / (tau * f) - l * along / f;
            let linearised = (-l * f - 1.0 / tau) - change * f - l * along;
            assert!(linearised.abs() < 1e-14);
        }
    }
}
