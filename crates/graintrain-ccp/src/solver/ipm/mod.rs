//! `ipm`: the second-order solver of the CCP. Projected gradients find the state of most contacts, Newton's
//! method on the projection the digits, and an interior point takes over where these two do not get on.
//!
//! 1. **Start** ([`apgd`](super::Apgd)): to a residual of 1e-6 or as many iterations as cost about ten Newton
//!    systems. In a settled packing most contacts then have their final state (open, sticking, sliding).
//! 2. **Newton's method on the projection** (`proximal`): two or three systems per two to four digits once
//!    the states are right, down to rounding. It gives up soon where they are not.
//! 3. **Interior point** (`path`), from the impulses handed over or from zero: it follows
//!    the central path and needs no guess of the states. 10 to 40 systems.
//! 4. Newton's method again, from the best iterate of the interior point. There is its floor: where an
//!    impulse and its velocity both vanish or both lie on the boundary, the distance of the central path from
//!    the solution is sqrt(tau), and rounding ends it at residuals of 1e-7 to 1e-8.
//! 5. Where all that fails, the homogeneous form of the problem ([`infeasible`](super::infeasible)): it ends
//!    with a proof that there is no solution, or with impulses from which Newton's method and the interior
//!    point try once more.
//!
//! `ipm+LINEAR` names the linear solver and leaves out the first two phases: it is the interior point itself.
//! Iterations are Newton systems; those of the start are the figure `start_iterations` of the first record.
//!
//! **Interior point.** With T_i = diag(1/mu_i, 1, 1) (up to a factor) the friction cones become second-order
//! cones: g = T x and, for the velocities y = N g + r of the dual cones, s = T y. The central path x o s =
//! tau e is followed by Mehrotra's predictor and corrector from an infeasible start. With the scaling W of
//! each cone, W s = W^-1 x = lambda, Newton's step solves
//!
//! ```text
//! (N + H) dg = -r_d + T^-1 W^-1 q,    H = T^-1 W^-2 T^-1,    r_d = N g + r - y,    lambda o q = -d_c
//! W ds = q - W^-1 dx
//! predictor:  d_c = lambda o lambda          corrector: d_c = lambda o lambda + (W^-1 dx_a) o (W ds_a) - sigma tau e
//! ```
//!
//! and d_c grows by Gondzio's correctors where they lengthen the step. Sources: Nesterov, Todd (1997);
//! Mehrotra (1992); Gondzio (1996); Vandenberghe, "The CVXOPT linear and quadratic cone program solvers"
//! (2010), for the scaling. A contact without friction is the half line g_n >= 0 with g_t = 0.
//!
//! **Infeasible problems.** Where the bodies are jammed, impulses exist that change no velocity and yet are
//! asked for: N g = 0, r^T g < 0, and the objective has no lower bound. Where impulses grow out of
//! proportion, or nothing helps, such impulses are searched for ([`infeasible`](super::infeasible)). The
//! answer returned is that of N + 1e-6 diag(eta), a little give in every contact,
//! with [`Status::Infeasible`].

pub(crate) mod cone;
pub(crate) mod context;
pub(crate) mod iterate;
pub(crate) mod mehrotra;
pub(crate) mod pair;
mod path;
mod proximal;
pub(crate) mod scaled;

use super::apgd::Apgd;
use super::driver::{Limits, check_start};
use super::first_order::FirstOrder;
use super::interface::{CcpSolver, Cost};
use super::report::{SolveReport, Status};
use super::settings::SolveSettings;
use crate::newton::direct::Direct;
use crate::newton::driver::NewtonDriver;
use crate::newton::{Form, NewtonSolver};
use crate::problem::{Ccp, CcpError};
use crate::residual::ResidualScale;
use context::SolveContext;
use scaled::{Scaled, ScaledMatrix};

/// Newton systems allowed where the settings name no limit.
const ITERATIONS: usize = 300;
/// Compliance relative to eta that makes an infeasible problem solvable.
const COMPLIANCE: f64 = 1e-6;
/// Residual that the start is asked for.
const START_TOLERANCE: f64 = 1e-6;
/// Iterations of the start beside one per contact.
const START_ITERATIONS: usize = 500;
/// One Cholesky factorisation of a settled packing takes as long as so many of these per contact.
const SYSTEM_ITERATIONS: f64 = 0.07;
/// Newton systems without which it is not worth a start.
const LEAST_ITERATIONS: usize = 10;

/// The solver.
pub struct Ipm {
    newton: NewtonDriver,
    start: Option<Box<dyn CcpSolver>>,
    /// The scaled N of the last problem.
    scaled: Option<ScaledMatrix>,
}

impl Ipm {
    /// Started by projected gradients, with sparse Cholesky factorisations: `ipm`.
    pub fn new() -> Self {
        let start: Box<dyn CcpSolver> = Box::new(FirstOrder::new(Apgd::default()));
        Self { start: Some(start), ..Self::with_solver(Box::new(Direct::default())) }
    }

    /// The interior point with a linear solver of one's own, without a start: `ipm+LINEAR`.
    pub fn with_solver(linear: Box<dyn NewtonSolver>) -> Self {
        Self { newton: NewtonDriver::new(linear), start: None, scaled: None }
    }

    /// The phases after the start, whose impulses are `started`; `given` are those handed over by the caller.
    fn phases(&mut self, context: &mut SolveContext<'_>, started: &[f64], given: &mut [f64]) -> Status {
        if self.start.is_some() {
            let status = proximal::run(&mut self.newton, context, started);
            if status != Status::Stalled {
                return status;
            }
        }
        let mut status = path::run(&mut self.newton, context, given, 0.0);
        // Blocks of Newton's method on the projection are singular: it has no plain form.
        if status == Status::Stalled && self.newton.form() == Form::Scaled {
            context.best(given);
            status = proximal::run(&mut self.newton, context, given);
        }
        status = context.verdict(&mut self.newton, status);
        if status == Status::Stalled
            && let Some(solution) = context.take_solution()
        {
            if self.newton.form() == Form::Scaled {
                status = proximal::run(&mut self.newton, context, &solution);
            }
            if status == Status::Stalled {
                status = path::run(&mut self.newton, context, &solution, 0.0);
            }
        }
        if status == Status::Infeasible {
            context.forget();
            given.fill(0.0);
            path::run(&mut self.newton, context, given, COMPLIANCE);
        }
        status
    }
}

impl Default for Ipm {
    fn default() -> Self {
        Self::new()
    }
}

impl CcpSolver for Ipm {
    fn name(&self) -> String {
        match &self.start {
            Some(_) => "ipm".to_string(),
            None => format!("ipm+{}", self.newton.linear_name()),
        }
    }

    fn iteration_limit(&self) -> usize {
        ITERATIONS
    }

    fn cost(&mut self, problem: &Ccp) -> Cost {
        let contacts = problem.num_contacts();
        let start = START_ITERATIONS + contacts;
        let iteration = 1.0 + SYSTEM_ITERATIONS * contacts as f64;
        Cost { start: start as f64, iteration, least: LEAST_ITERATIONS }
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
        if problem.num_contacts() == 0 {
            return Ok(limits.report(&self.name(), problem, impulse, Status::Converged, 0, 0));
        }
        let residual_scale = ResidualScale::new(problem);
        let mut given = impulse.to_vec();
        let mut started = None;
        if let Some(start) = &mut self.start {
            let settings = SolveSettings {
                tolerance: settings.tolerance.max(START_TOLERANCE),
                max_iterations: Some(START_ITERATIONS + problem.num_contacts()),
                max_time: limits.time_left(),
                ..settings.clone()
            };
            started = Some(start.solve(problem, impulse, &settings)?);
        }
        let scaled = Scaled::new(problem, &residual_scale, &mut self.scaled);
        self.newton.set_patience(limits.patience());
        self.newton.begin(&scaled.problem);
        let mut context = SolveContext::new(problem, &scaled, &residual_scale, &limits, settings.friction);
        if let Some(started) = &mut started {
            // Iterations are Newton systems, and the start makes none.
            started.history.iter_mut().for_each(|sample| sample.iteration = 0);
            context.history.append(&started.history, 0, 0.0);
        }
        let status = self.phases(&mut context, impulse, &mut given);
        context.best(impulse);
        let (name, iterations) = (self.name(), context.iterations);
        let history = context.history.into_samples();
        let mut report = limits.report_with(&name, problem, impulse, status, iterations, &mut self.newton)?;
        if let Some(first) = report.newton.first_mut() {
            let start_iterations = started.as_ref().map_or(0, |started| started.iterations);
            first.figures.insert("start_iterations".to_string(), start_iterations as f64);
        }
        if let Some(started) = started.filter(|_| iterations == 0 && report.converged()) {
            let SolveReport { solver, iterations, .. } = started;
            report.remark = Some(format!(
                "{solver} reached the tolerance in {iterations} iterations, before any Newton system"
            ));
        }
        Ok(SolveReport { history, ..report })
    }
}
