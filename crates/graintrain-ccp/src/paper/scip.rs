//! `scip`: the symmetric cone interior point.
//!
//! Source: J. Kleinert, B. Simeon, M. Obermayr, "An inexact interior point method for the large-scale
//! simulation of granular material", Computer Methods in Applied Mechanics and Engineering 278:567-598, 2014.
//! The Jordan algebra behind it: S. Schmieta, F. Alizadeh, "Extension of primal-dual interior point
//! algorithms to symmetric cones", Mathematical Programming 96:409-438, 2003; the wide neighbourhood for
//! infeasible iterates: B. Rangarajan, "Polynomial convergence of infeasible-interior-point methods over
//! symmetric cones", SIAM Journal on Optimization 16:1211-1229, 2006.
//!
//! With g = T x and y = N g + r = T^-1 s the friction cones become second-order cones, the cones of squares
//! of the Jordan product x o s = (x^T s, x_0 s_t + s_0 x_t). The central path x o s = tau e is followed
//! with **one** Newton step per iteration, aimed at sigma tau:
//!
//! ```text
//! r_d = N g + r - y,                                      W s = W^-1 x = lambda   (Nesterov and Todd's scaling)
//! lambda o (W^-1 dx + W ds) = sigma tau e - lambda o lambda,       N dg - dy = -r_d
//! (N + T^-1 W^-2 T^-1) dg = -r_d + T^-1 W^-1 (sigma tau lambda^-1 - lambda)
//! ```
//!
//! Steps end in the wide neighbourhood of the path, where every eigenvalue of P(x^(1/2)) s (P the quadratic
//! representation) is at least gamma tau; for a second-order cone these are x^T s -+ sqrt((x^T s)^2 - det x
//! det s). The linear systems are solved *inexactly*, to a fraction of the residual of the problem: what is
//! left of them only adds to r_d. What sets the method apart from [`ipm`](crate::solver::ipm): one right-hand
//! side per matrix, no predictor, no second-order corrector, no polishing.

use crate::newton::NewtonSolver;
use crate::newton::driver::NewtonDriver;
use crate::problem::{Ccp, CcpError};
use crate::residual::ResidualScale;
use crate::solver::driver::{Limits, Progress, check_start};
use crate::solver::interface::CcpSolver;
use crate::solver::ipm::cone::product;
use crate::solver::ipm::context::SolveContext;
use crate::solver::ipm::iterate::Work;
use crate::solver::ipm::pair::Pair;
use crate::solver::ipm::scaled::{Scaled, ScaledMatrix};
use crate::solver::report::{SolveReport, Status};
use crate::solver::settings::SolveSettings;

/// Iterations allowed where the settings name no limit.
const ITERATIONS: usize = 200;
/// gamma of the neighbourhood.
const NEIGHBOURHOOD: f64 = 1e-2;
/// Part of the way to the boundary that a step may go at most.
const FRACTION: f64 = 0.99;
/// Bounds of sigma: the shorter the last step, the more the next one goes back to the central path.
const CENTRING: [f64; 2] = [0.05, 0.9];
/// Iterations without a better residual before giving up.
const PATIENCE: usize = 20;
/// Steps shorter than this lead nowhere.
const SHORTEST: f64 = 1e-8;
/// Barrier of a start from zero, in the scaled problem.
const COLD_BARRIER: f64 = 1e4;
/// Bounds of the barrier of a warm start.
const WARM_BARRIER: [f64; 2] = [1e-4, 1.0];

/// The symmetric cone interior point, see the [module](self).
///
/// Jammed bodies (no bounded solution) are reported as [`Status::Infeasible`], with the iterate of least
/// residual.
pub struct Scip {
    newton: NewtonDriver,
    /// The scaled N of the last problem.
    scaled: Option<ScaledMatrix>,
}

impl Scip {
    /// With a linear solver of one's own.
    pub fn with_solver(linear: Box<dyn NewtonSolver>) -> Self {
        Self { newton: NewtonDriver::new(linear), scaled: None }
    }
}

/// The smaller eigenvalue of P(x^(1/2)) s; both are tau on the central path.
fn least_eigenvalue(pair: &Pair) -> f64 {
    match pair {
        Pair::Cone { x, s } => {
            let (half_sum, product) = (x.dot(s), x.determinant() * s.determinant());
            product / (half_sum + (half_sum * half_sum - product).max(0.0).sqrt())
        }
        Pair::Line { x, s } => x * s,
    }
}

/// Goes as far as the cones allow, at most 1, and back until the neighbourhood is met; returns the step, 0
/// where none was found. `before` is room for the pairs.
fn advance(work: &mut Work, before: &mut [Pair]) -> f64 {
    before.copy_from_slice(&work.pairs);
    let mut alpha = (FRACTION * work.longest_step()).min(1.0);
    while alpha > SHORTEST {
        work.advance(alpha);
        let bound = NEIGHBOURHOOD * work.barrier();
        if work.pairs.iter().all(|pair| least_eigenvalue(pair) >= bound) {
            return alpha;
        }
        work.pairs.copy_from_slice(before);
        alpha *= 0.8;
    }
    0.0
}

impl Scip {
    /// Runs from `impulse`; the best iterate is left with the context.
    fn run(&mut self, context: &mut SolveContext<'_>, impulse: &[f64]) -> Status {
        let inner = &context.scaled.problem;
        let mut work = Work::new(inner, 0.0);
        context.hand_over(impulse, &mut work);
        // The path starts inside the cones: impulses handed over that are better must not be lost on the way.
        let residual = context.measure(&work.g, &work.ng);
        if let Some(status) = context.status(residual) {
            return status;
        }
        let barrier = if work.g.iter().any(|&g| g != 0.0) {
            work.distance(inner, &inner.r).clamp(WARM_BARRIER[0], WARM_BARRIER[1])
        } else {
            COLD_BARRIER
        };
        work.start(inner, &inner.r, barrier);
        let mut before = work.pairs.clone();
        let mut progress = Progress::new(PATIENCE);
        let mut last_step = 0.0_f64;
        loop {
            work.impulses_from_pairs();
            work.multiply(inner);
            work.update_dual_residual(&inner.r);
            let residual = context.measure(&work.g, &work.ng);
            if let Some(status) = context.status(residual) {
                return status;
            }
            if progress.has_ended(residual) {
                return Status::Stalled;
            }
            if context.runs_away(&mut self.newton, &work.g, &work.ng) {
                return Status::Infeasible;
            }
            work.update_blocks();
            if self.newton.refresh(inner, work.blocks(), context.iterations, residual).is_err() {
                return Status::Stalled;
            }
            let sigma = (1.0 - last_step).powi(2).clamp(CENTRING[0], CENTRING[1]);
            let target = sigma * work.barrier();
            work.right_hand_side(1.0, |_, lambda| {
                let square = product(lambda, lambda);
                [square[0] - target, square[1], square[2]]
            });
            let tolerance = (1e-2 * residual).clamp(1e-12, 1e-3);
            work.solve(|blocks, b, z| {
                self.newton.solve(inner, blocks, b, z, tolerance);
            });
            last_step = advance(&mut work, &mut before);
            self.newton.end_iteration(last_step);
            context.iterations += 1;
            if last_step == 0.0 {
                return Status::Stalled;
            }
        }
    }
}

impl CcpSolver for Scip {
    fn name(&self) -> String {
        match self.newton.linear_name().as_str() {
            "cholesky" => "scip".to_string(),
            linear => format!("scip+{linear}"),
        }
    }

    fn iteration_limit(&self) -> usize {
        ITERATIONS
    }

    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        self.capabilities().require(&self.name(), problem)?;
        let limits = Limits::start(settings, ITERATIONS);
        check_start(problem, impulse)?;
        let scale = ResidualScale::new(problem);
        if problem.num_contacts() == 0 {
            return Ok(limits.report(&self.name(), problem, impulse, Status::Converged, 0, 0));
        }
        let scaled = Scaled::new(problem, &scale, &mut self.scaled);
        self.newton.set_patience(limits.patience());
        self.newton.begin(&scaled.problem);
        let mut context = SolveContext::new(problem, &scaled, &scale, &limits, settings.friction);
        let status = self.run(&mut context, impulse);
        let status = context.verdict(&mut self.newton, status);
        context.best(impulse);
        let (iterations, history) = (context.iterations, context.history.into_samples());
        let report =
            limits.report_with(&self.name(), problem, impulse, status, iterations, &mut self.newton)?;
        Ok(SolveReport { history, ..report })
    }
}
