//! What every solver needs around its iteration: when to stop, the best iterate, the report.

use super::ranks::Ranks;
use super::report::{SolveReport, Status};
use super::settings::SolveSettings;
use crate::newton::NewtonError;
use crate::newton::driver::NewtonDriver;
use crate::problem::{Ccp, CcpError};
use crate::residual::{Criterion, Residual, ResidualScale};
use graintrain_linalg::patience::Patience;
use std::sync::Arc;
use std::time::Instant;

/// Said beside [`Status::Infeasible`].
const INFEASIBLE: &str = "no velocities of the bodies keep these contacts apart, which was proved: bodies are wedged in, or \
    pressed together by ones that cannot move. The impulses are those of contacts that give a little, or the best ones met; let something move, or \
    remove an overlap or a prescribed motion, for a problem that has a solution";

/// What is left of a curvature per solve that does not meet it again.
const FORGET: f64 = 0.97;

/// Clock and limits of one solve.
#[derive(Clone, Debug)]
pub struct Limits<'a> {
    settings: &'a SolveSettings,
    start: Instant,
    max_iterations: usize,
}

impl<'a> Limits<'a> {
    /// Starts the clock. `default_iterations` holds where the settings name no limit.
    pub fn start(settings: &'a SolveSettings, default_iterations: usize) -> Self {
        let max_iterations = settings.max_iterations.unwrap_or(default_iterations);
        Self { settings, start: Instant::now(), max_iterations }
    }

    /// The number of a residual that is held against the tolerance.
    pub fn measured(&self, residual: Residual) -> f64 {
        residual.measured(self.settings.criterion)
    }

    /// Which number that is.
    pub fn criterion(&self) -> Criterion {
        self.settings.criterion
    }

    /// The largest curvature of the last solve, where it is known; at least 1, because trace(N'_ii) = 3.
    pub fn curvature(&self) -> Option<f64> {
        self.settings.curvature.filter(|curvature| curvature.is_finite()).map(|curvature| curvature.max(1.0))
    }

    /// What to remember after a solve whose steps met this curvature at the most, zero where there was none:
    /// a solve of few steps does not meet the largest one there is.
    pub fn next_curvature(&self, steepest: f64) -> Option<f64> {
        let known = self.curvature().map(|known| FORGET * known);
        let met = (steepest.is_finite() && steepest > 0.0).then_some(steepest);
        known.into_iter().chain(met).reduce(f64::max)
    }

    /// The status to stop with after this many iterations with this residual, as [measured](Self::measured),
    /// if it is time to stop. A residual that is not finite is [`Status::Stalled`].
    pub fn status(&self, iterations: usize, residual: f64) -> Option<Status> {
        if residual <= self.settings.tolerance {
            Some(Status::Converged)
        } else if !residual.is_finite() {
            Some(Status::Stalled)
        } else if self.is_over() {
            Some(Status::Stopped)
        } else if iterations >= self.max_iterations {
            Some(Status::IterationLimit)
        } else {
            None
        }
    }

    /// Whether time is up, or somebody asked to stop: on all ranks alike.
    fn is_over(&self) -> bool {
        if let Some(ranks) = &self.settings.ranks {
            ranks.agree_to_stop();
        }
        self.settings.out_of_time(self.start)
    }

    /// The ranks that solve the problem together.
    pub fn ranks(&self) -> Option<&Arc<Ranks>> {
        self.settings.ranks.as_ref()
    }

    /// Iterations still allowed.
    pub fn iterations_left(&self, iterations: usize) -> usize {
        self.max_iterations.saturating_sub(iterations)
    }

    /// Time left, where there is a limit.
    pub fn time_left(&self) -> Option<std::time::Duration> {
        self.settings.max_time.map(|limit| limit.saturating_sub(self.start.elapsed()))
    }

    /// The same limits for loops inside an iteration.
    pub fn patience(&self) -> Patience {
        let deadline = self.settings.max_time.and_then(|limit| self.start.checked_add(limit));
        Patience::new(deadline, self.settings.stop.clone())
    }

    /// Seconds since the start.
    pub fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// The residual to reach.
    pub fn tolerance(&self) -> f64 {
        self.settings.tolerance
    }

    /// The report on the impulses that a solver returns. Residuals and objective are evaluated afresh with
    /// the problem's own N, so that no solver can report its own opinion: a solver that thinks it converged
    /// but is more than rounding above the tolerance gets [`Status::Stalled`], one that is below it gets
    /// [`Status::Converged`].
    pub fn report(
        &self,
        solver: &str,
        problem: &Ccp,
        impulse: &[f64],
        status: Status,
        iterations: usize,
        linear_iterations: usize,
    ) -> SolveReport {
        let scale = ResidualScale::new(problem);
        let mut velocity = vec![0.0; impulse.len()];
        problem.velocity(impulse, &mut velocity, &mut problem.delassus.work());
        let model = self.settings.friction;
        let evaluation = scale.evaluate(problem, impulse, &velocity);
        let residual = evaluation.residual(model);
        let status = if self.measured(residual) <= self.settings.tolerance {
            Status::Converged
        } else if matches!(status, Status::Converged | Status::Stalled) {
            // A linear solver that is out of time stops the method that waits for it.
            if self.settings.out_of_time(self.start) { Status::Stopped } else { Status::Stalled }
        } else {
            status
        };
        SolveReport {
            solver: solver.to_string(),
            status,
            iterations,
            linear_iterations,
            residual,
            residual_relaxed: evaluation.relaxed,
            residual_coulomb: evaluation.coulomb,
            objective: problem.objective(impulse, &velocity),
            seconds: self.seconds(),
            remark: (status == Status::Infeasible).then(|| INFEASIBLE.to_string()),
            ..SolveReport::default()
        }
    }

    /// As [`Self::report`] for a method that solved linear systems: with their records, and with the reason
    /// where the linear solver gave up.
    ///
    /// # Errors
    /// [`CcpError::Unsupported`] where the linear solver cannot treat this problem at all.
    pub fn report_with(
        &self,
        solver: &str,
        problem: &Ccp,
        impulse: &[f64],
        status: Status,
        iterations: usize,
        newton: &mut NewtonDriver,
    ) -> Result<SolveReport, CcpError> {
        let failure = newton.failure().cloned();
        if let Some(NewtonError::Unsupported { reason, .. }) = failure {
            return Err(CcpError::Unsupported { solver: solver.to_string(), reason: reason.to_string() });
        }
        let mut report =
            self.report(solver, problem, impulse, status, iterations, newton.linear_iterations());
        report.newton = newton.take_records();
        if report.status == Status::Stalled {
            report.remark = failure.map(|error| error.to_string());
        }
        Ok(report)
    }
}

/// Tells when an iteration no longer gets on.
#[derive(Clone, Debug)]
pub struct Progress {
    patience: usize,
    least: f64,
    since_better: usize,
}

impl Progress {
    /// For a method that may go this many iterations without taking a tenth off its least residual.
    pub fn new(patience: usize) -> Self {
        Self { patience, least: f64::INFINITY, since_better: 0 }
    }

    /// Counts an iteration with this residual; whether it was one too many.
    pub fn has_ended(&mut self, residual: f64) -> bool {
        if residual < 0.9 * self.least {
            (self.least, self.since_better) = (residual, 0);
        } else {
            self.since_better += 1;
        }
        self.since_better > self.patience
    }
}

/// Checks that the impulses fit the problem and replaces numbers that are not finite by zero: a warm start is
/// a guess.
///
/// # Errors
/// [`CcpError::Size`] where the length is not that of r.
pub fn check_start(problem: &Ccp, impulse: &mut [f64]) -> Result<(), CcpError> {
    let expected = 3 * problem.delassus.num_blocks();
    if impulse.len() != expected {
        return Err(CcpError::Size { what: "impulse", got: impulse.len(), expected });
    }
    for g in impulse {
        if !g.is_finite() {
            *g = 0.0;
        }
    }
    Ok(())
}

/// The iterate of least residual seen so far.
#[derive(Clone, Debug)]
pub struct Best<T> {
    iterate: Vec<T>,
    residual: Option<f64>,
}

impl<T> Default for Best<T> {
    fn default() -> Self {
        Self { iterate: Vec::new(), residual: None }
    }
}

impl<T: Copy> Best<T> {
    /// Keeps a copy of the iterate if its residual is the least so far. A residual that is not a number loses
    /// against every number, and to what was there before: the first iterate is a start, which is finite.
    pub fn offer(&mut self, iterate: &[T], residual: f64) {
        if self.residual.is_none_or(|best| residual < best || (best.is_nan() && !residual.is_nan())) {
            self.iterate.clear();
            self.iterate.extend_from_slice(iterate);
            self.residual = Some(residual);
        }
    }

    /// The least residual so far, infinity where there is none.
    pub fn residual(&self) -> f64 {
        self.residual.unwrap_or(f64::INFINITY)
    }

    /// Copies the best iterate out, if any was offered.
    pub fn restore(&self, iterate: &mut [T]) {
        if self.residual.is_some() {
            iterate.copy_from_slice(&self.iterate);
        }
    }
}
