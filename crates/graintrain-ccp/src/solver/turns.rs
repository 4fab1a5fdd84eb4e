//! Exact Coulomb friction by projected gradients and Gauss-Seidel sweeps in turn.

use super::apgd::Apgd;
use super::driver::{Best, Limits};
use super::first_order::FirstOrder;
use super::gauss_seidel::GaussSeidel;
use super::{CcpSolver, SolveReport, SolveSettings, Status};
use crate::problem::{Ccp, CcpError};

/// Over-relaxation of the sweeps.
const RELAXATION: f64 = 1.3;

/// Projected gradients with momentum ([`Apgd`]), then sweeps ([`GaussSeidel`]) from their best impulses, half of the iterations
/// each.
///
/// The exact problem has no objective, and either method may circle where the other one gets on: in a sheared packing gradients
/// stand at residuals of 1e-3 to 1e-5 where sweeps reach 1e-6, in a settled one it is the other way round.
pub(super) struct Turns {
    gradients: FirstOrder<Apgd>,
    sweeps: FirstOrder<GaussSeidel>,
    /// Which of them have seen N and mu of the last call.
    ready: [bool; 2],
}

impl Turns {
    pub fn new() -> Self {
        let sweeps = GaussSeidel { relaxation: RELAXATION };
        Self {
            gradients: FirstOrder::new(Apgd::default()),
            sweeps: FirstOrder::new(sweeps),
            ready: [false; 2],
        }
    }

    /// The next call has another N or mu, whatever it says.
    pub fn forget(&mut self) {
        self.ready = [false; 2];
    }

    /// One turn of each, as [`CcpSolver::solve_exact`]; the best impulses are returned.
    pub fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
        again: bool,
    ) -> Result<SolveReport, CcpError> {
        let limits = Limits::start(settings, usize::MAX);
        let share = limits.iterations_left(0).div_ceil(2);
        let mut best = Best::default();
        let (mut iterations, mut products, mut status) = (0, 0, Status::IterationLimit);
        let mut names = Vec::new();
        if !again {
            self.forget();
        }
        let members: [&mut dyn CcpSolver; 2] = [&mut self.gradients, &mut self.sweeps];
        for (solver, ready) in members.into_iter().zip(&mut self.ready) {
            let turn = SolveSettings {
                max_iterations: Some(share.min(limits.iterations_left(iterations))),
                max_time: limits.time_left(),
                ..settings.clone()
            };
            let Some(report) = solver.solve_exact(problem, impulse, &turn, *ready)? else { continue };
            *ready = true;
            (iterations, products) = (iterations + report.iterations, products + report.products);
            status = report.status;
            names.push(report.solver);
            best.offer(impulse, report.residual.max);
            best.restore(impulse);
            if matches!(status, Status::Converged | Status::Stopped) {
                break;
            }
        }
        let report = limits.report(&names.join(", "), problem, impulse, status, iterations, 0);
        Ok(SolveReport { products, ..report })
    }
}
