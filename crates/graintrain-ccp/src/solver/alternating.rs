//! Exact Coulomb friction by projected gradients and Gauss-Seidel sweeps in turn.

use super::apgd::Apgd;
use super::driver::{Best, Limits};
use super::first_order::FirstOrder;
use super::gauss_seidel::GaussSeidel;
use super::history::History;
use super::interface::{CELL_CONTACTS, CcpSolver};
use super::report::{SolveReport, Status};
use super::settings::SolveSettings;
use crate::problem::{Ccp, CcpError};

/// What [`Alternating`] is tuned by.
#[derive(Clone, Debug)]
pub(super) struct Parameters {
    /// With more contacts across the boundary of a cell that gives way there are no sweeps, which go through N as a matrix.
    pub cell_contacts: usize,
    /// Over-relaxation of the sweeps.
    pub relaxation: f64,
    /// Factor by which the memory of the bold gradients grows and shrinks.
    pub bold: f64,
}

impl Default for Parameters {
    fn default() -> Self {
        Self { cell_contacts: CELL_CONTACTS, relaxation: 1.3, bold: 4.0 }
    }
}

/// Projected gradients with momentum ([`Apgd`]), the same with a momentum that grows and shrinks boldly, and sweeps
/// ([`GaussSeidel`]), a third of the iterations each. Each goes on where the one before ended.
///
/// The exact problem has no objective, and any of these methods may circle where another gets on: sheared packings want short
/// momenta or sweeps, which creep in settled boxes and in stacks of bricks, where the impulses have a long way to go at
/// residuals of 1e-5 and long momenta carry them.
pub(super) struct Alternating {
    cell_contacts: usize,
    /// The sweeps last.
    members: [Box<dyn CcpSolver>; 3],
}

impl Alternating {
    pub fn new() -> Self {
        let Parameters { cell_contacts, relaxation, bold } = Parameters::default();
        let bold = Apgd { longer: bold, shorter: bold, ..Apgd::default() };
        let sweeps = GaussSeidel { relaxation };
        Self {
            cell_contacts,
            members: [
                Box::new(FirstOrder::new(Apgd::default())),
                Box::new(FirstOrder::new(bold)),
                Box::new(FirstOrder::new(sweeps)),
            ],
        }
    }

    /// One turn of each, as [`CcpSolver::solve_exact`]; the best impulses are returned.
    pub fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        last: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        let limits = Limits::start(settings, usize::MAX);
        let is_wide = problem.contacts_across() > self.cell_contacts;
        let count = self.members.len() - usize::from(is_wide);
        let share = limits.iterations_left(0).div_ceil(count);
        let mut best = Best::default();
        let (mut iterations, mut products, mut status) = (0, 0, Status::IterationLimit);
        let mut names: Vec<String> = Vec::new();
        let mut history = History::default();
        for solver in &mut self.members[..count] {
            let turn = SolveSettings {
                max_iterations: Some(share.min(limits.iterations_left(iterations))),
                max_time: limits.time_left(),
                ..settings.clone()
            };
            let begun = limits.seconds();
            let Some(report) = solver.solve_exact(problem, impulse, last, &turn)? else { continue };
            history.append(&report.history, iterations, begun);
            (iterations, products) = (iterations + report.iterations, products + report.products);
            status = report.status;
            if names.last() != Some(&report.solver) {
                names.push(report.solver);
            }
            best.offer(impulse, limits.judged(report.residual));
            if matches!(status, Status::Converged | Status::Stopped) {
                break;
            }
        }
        best.restore(impulse);
        let report = limits.report(&names.join(", "), problem, impulse, status, iterations, 0);
        Ok(SolveReport { products, history: history.into_samples(), ..report })
    }
}
