//! `apgd`: accelerated projected gradient descent with adaptive step and restart.
//!
//! Source: H. Mazhar, T. Heyn, D. Negrut, A. Tasora, "Using Nesterov's method to accelerate multibody dynamics with
//! friction and contact", ACM Transactions on Graphics 34(3):32, 2015, after Nesterov (1983) and, for the restart,
//! O'Donoghue and Candes (2015).

use super::driver::{Best, Limits, check_start};
use super::lanes::{Batch, add_scaled, dot, project, sub};
use super::scaling::{Here, Kernel, ScaledProblem};
use super::sweep::Tally;
use super::{CcpSolver, SolveReport, SolveSettings};
use crate::problem::{Ccp, CcpError};
use crate::residual::ResidualScale;

/// Accelerated projected gradient on the scaled problem:
///
/// ```text
/// x+ = P( y - t (N' y + r') ),   y+ = x+ + beta (x+ - x)
/// ```
///
/// t shrinks where the curvature met along a step, d^T N' d / |d|^2 with d = x+ - y, exceeds 1/t, and grows slowly
/// otherwise; beta restarts from zero where the step points uphill, (y - x+)^T (x+ - x) > 0.
///
/// One iteration is one fused pass over the contacts and one over the bodies: because images are linear,
/// N' x+ = N' y + N' d needs no product of its own.
#[derive(Clone, Debug)]
pub struct Apgd {
    /// Factor by which the step grows per iteration.
    pub growth: f64,
}

impl Default for Apgd {
    fn default() -> Self {
        Self { growth: 1.01 }
    }
}

/// previous <- x+ = P(y - t u) with y = x + beta (x - previous); returns d = x+ - y, tallies |d|^2 and d^T (x+ - x).
struct Step {
    step: f64,
    beta: f64,
}

impl Kernel<2> for Step {
    #[inline(always)]
    fn at(&self, here: Here, u: &Batch, [x, previous]: [&mut Batch; 2], tally: &mut Tally) -> Batch {
        let y = add_scaled(x, self.beta, &sub(x, previous));
        let new = project(here.mu, &add_scaled(&y, -self.step, u));
        let d = sub(&new, &y);
        tally.sum[0] += dot(&d, &d);
        tally.sum[1] += dot(&d, &sub(&new, x));
        *previous = new;
        d
    }
}

/// Iterations between two evaluations of the residual.
const CHECK: usize = 10;

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
        let scaled = ScaledProblem::new(problem, &ResidualScale::new(problem));
        let mut work = scaled.work();
        let zero = scaled.zero_image();
        let mut x = scaled.zeros();
        let mut previous = scaled.zeros();
        let (mut image_x, mut image_y, mut image_d) = (zero.clone(), zero.clone(), zero.clone());
        scaled.pack(impulse, &mut x);
        let mut step = 1.0 / scaled.largest_curvature(&mut previous, &mut image_d, &mut work);
        previous.copy_from_slice(&x);
        scaled.image_of(&mut x, &mut image_x, &zero, &mut work);
        image_y.copy_from_slice(&image_x);
        let mut best = Best::default();
        let (mut theta, mut beta) = (1.0_f64, 0.0);
        let mut iterations = 0;
        let status = loop {
            if iterations % CHECK == 0 {
                let residual = scaled.residual(&mut x, &image_x, &mut work);
                best.offer(&x, residual);
                if let Some(status) = limits.status(iterations, residual) {
                    break status;
                }
            }
            iterations += 1;
            let kernel = Step { step, beta };
            let (totals, curvature) =
                scaled.pass(&image_y, [&mut x, &mut previous], &mut image_d, &mut work, &kernel);
            std::mem::swap(&mut x, &mut previous);
            let [length, downhill, ..] = totals.sum;
            if curvature * step > length {
                step = 0.9 * length / curvature;
            } else {
                step *= self.growth;
            }
            if downhill < 0.0 {
                (theta, beta) = (1.0, 0.0);
            } else {
                let next = 0.5 * (1.0 + (1.0 + 4.0 * theta * theta).sqrt());
                (theta, beta) = (next, (theta - 1.0) / next);
            }
            // image of x+ and of the next y = x+ + beta (x+ - x).
            for ((x, y), d) in image_x.iter_mut().zip(&mut image_y).zip(&image_d) {
                let new = *y + d;
                *y = new + beta * (new - *x);
                *x = new;
            }
        };
        best.restore(&mut x);
        scaled.unpack(&x, impulse);
        Ok(limits.report("apgd", problem, impulse, status, iterations, 0))
    }
}

/// Makes the solver by name; it has no linear solver.
pub(super) fn build(linear: Option<&str>) -> Result<Box<dyn CcpSolver>, CcpError> {
    super::without_linear_solver("apgd", linear)?;
    Ok(Box::new(Apgd::default()))
}
