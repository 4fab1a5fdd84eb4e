//! `auto`: the solver that is likely to reach the tolerance first, and others where it does not.

use super::alternating::Alternating;
use super::apgd::Apgd;
use super::driver::{Best, Limits, check_start};
use super::first_order::FirstOrder;
use super::history::History;
use super::interface::{CELL_CONTACTS, CcpSolver};
use super::ipm::Ipm;
use super::path_following::PathFollowing;
use super::report::{SolveReport, Status};
use super::settings::SolveSettings;
use crate::problem::{Ccp, CcpError};

/// What [`Auto`] is tuned by.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// Below this tolerance the interior point goes first.
    pub tight: f64,
    /// Iterations of the first-order method while another method is left to try: about ten times what a settled packing needs
    /// for 1e-4 from a cold start, fewer where the tolerance is looser.
    pub first_order_limit: usize,
    /// Checks (one in ten iterations) that the first-order method may go without taking a tenth off its least residual while another
    /// method is left to try. Settled packings creep for hundreds of iterations, jammed ones for ever.
    pub first_order_patience: usize,
    /// With more contacts across the boundary of a cell that gives way, `ipm` is left out: N as a matrix has a block for each two of them.
    pub cell_contacts: usize,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            tight: 1e-6,
            first_order_limit: 30_000,
            first_order_patience: 500,
            cell_contacts: CELL_CONTACTS,
        }
    }
}

/// Tries `apgd` and `ipm` in the order that suits the tolerance: an iteration of `apgd` costs nanoseconds per contact and it
/// profits from a warm start, so it goes first down to 1e-6; `ipm` needs factorisations but few iterations whatever the
/// tolerance. Each next method starts from the best impulses so far, and the best impulses are returned.
/// Contacts that resist turning are for `apgd` alone, and so are large periodic cells that give way, where it goes on as long as it gains anything.
pub struct Auto {
    members: Vec<(&'static str, Box<dyn CcpSolver>)>,
    /// In the place of `ipm` where that would need too large a matrix.
    patient: FirstOrder<Apgd>,
    exact: Alternating,
    path: PathFollowing,
    /// The tuned constants.
    pub parameters: Parameters,
}

impl Default for Auto {
    fn default() -> Self {
        Self::new()
    }
}

impl Auto {
    /// With `apgd` and `ipm`.
    pub fn new() -> Self {
        let parameters = Parameters::default();
        let apgd = FirstOrder::with_patience(Apgd::default(), parameters.first_order_patience);
        let members: Vec<(_, Box<dyn CcpSolver>)> =
            vec![("apgd", Box::new(apgd)), ("ipm", Box::new(Ipm::new()))];
        let patient = FirstOrder::new(Apgd::default());
        Self { members, patient, exact: Alternating::new(), path: PathFollowing::default(), parameters }
    }
}

impl CcpSolver for Auto {
    fn name(&self) -> String {
        "auto".to_string()
    }

    /// For the first member and those after it.
    fn iteration_limit(&self) -> usize {
        2 * self.parameters.first_order_limit
    }

    fn takes_cells(&self) -> bool {
        true
    }

    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        let limits = Limits::start(settings, usize::MAX);
        check_start(problem, impulse)?;
        let is_tight = settings.tolerance < self.parameters.tight;
        self.members.sort_by_key(|(name, _)| (*name == "ipm") != is_tight);
        let mut best = Best::default();
        let (mut iterations, mut linear_iterations) = (0, 0);
        let mut status = Status::Stalled;
        let mut name = "auto".to_string();
        let (mut history, mut remark) = (History::default(), None);
        let is_wide = problem.contacts_across() > self.parameters.cell_contacts;
        let takes = |member: &str| member != "ipm" || (problem.turning.is_empty() && !is_wide);
        let mut members: Vec<(&str, &mut dyn CcpSolver)> = Vec::new();
        for (member, solver) in self.members.iter_mut().filter(|(member, _)| takes(member)) {
            members.push((member, solver.as_mut()));
        }
        if is_wide && problem.turning.is_empty() {
            members.push(("apgd", &mut self.patient));
        }
        let last = members.len() - 1;
        for (position, (member, solver)) in members.into_iter().enumerate() {
            let is_first = position < last && member == "apgd";
            let allowed = if is_first { self.parameters.first_order_limit } else { solver.iteration_limit() };
            let mine = SolveSettings {
                max_iterations: Some(limits.iterations_left(iterations).min(allowed)),
                max_time: limits.time_left(),
                ..settings.clone()
            };
            let begun = limits.seconds();
            let matrix = if solver.takes_cells() { None } else { problem.with_cell_as_matrix() };
            let report = match solver.solve(matrix.as_ref().unwrap_or(problem), impulse, &mine) {
                Ok(report) => report,
                // Another member may be able to treat it.
                Err(error) if position == last => return Err(error),
                Err(_) => continue,
            };
            history.append(&report.history, iterations, begun);
            iterations += report.iterations;
            linear_iterations += report.linear_iterations;
            status = report.status;
            name = format!("auto ({})", report.solver);
            let residual = limits.judged(report.residual);
            if report.converged() {
                // These are its impulses, evaluated afresh: once is enough.
                let (seconds, history) = (limits.seconds(), history.into_samples());
                let (products, newton) = (0, Vec::new());
                return Ok(SolveReport {
                    solver: name,
                    iterations,
                    linear_iterations,
                    products,
                    seconds,
                    newton,
                    history,
                    ..report
                });
            }
            best.offer(impulse, residual);
            remark.clone_from(&report.remark);
            // That a problem has no solution is proved; nobody after this one finds any.
            if report.status == Status::Infeasible || limits.status(iterations, residual).is_some() {
                break;
            }
            best.restore(impulse);
        }
        best.restore(impulse);
        let report = limits.report(&name, problem, impulse, status, iterations, linear_iterations);
        Ok(SolveReport { history: history.into_samples(), remark, ..report })
    }

    fn solve_exact(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        last: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<Option<SolveReport>, CcpError> {
        let report = self.exact.solve(problem, impulse, last, settings)?;
        Ok(Some(SolveReport { solver: format!("auto ({})", report.solver), ..report }))
    }

    fn path_following(&mut self) -> Option<&mut PathFollowing> {
        Some(&mut self.path)
    }
}
