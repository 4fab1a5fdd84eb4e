//! The interior point itself: along the central path to the solution.

use super::super::driver::Progress;
use super::super::report::Status;
use super::context::SolveContext;
use super::iterate::Work;
use super::mehrotra;
use crate::newton::driver::NewtonDriver;

/// Iterations without a better residual before giving up.
const PATIENCE: usize = 15;
/// Barrier of a cold start: impulses in force chains are a few times larger than those of single contacts.
const COLD_BARRIER: f64 = 1e3;
/// Bounds of the barrier of a warm start.
const WARM_BARRIER: [f64; 2] = [1e-4, 1.0];

/// Runs on the scaled problem with some compliance added to N, from `impulse` (of the problem as given).
pub(super) fn run(
    newton: &mut NewtonDriver,
    context: &mut SolveContext<'_>,
    impulse: &[f64],
    compliance: f64,
) -> Status {
    let inner = &context.scaled.problem;
    let mut work = Work::new(inner, compliance);
    context.hand_over(impulse, &mut work);
    // The path starts inside the cones: impulses handed over that are good enough must not be lost on the
    // way.
    let residual = context.measure(&work.g, &work.ng);
    if let Some(status) = context.status(residual) {
        return status;
    }
    let warm = impulse.iter().any(|&g| g != 0.0);
    let distance = work.distance(inner, &inner.r);
    let barrier = if warm { distance.clamp(WARM_BARRIER[0], WARM_BARRIER[1]) } else { COLD_BARRIER };
    work.start(inner, &inner.r, barrier);

    let mut progress = Progress::new(PATIENCE);
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
        if compliance == 0.0 && context.runs_away(newton, &work.g, &work.ng) {
            return Status::Infeasible;
        }
        work.update_blocks();
        if newton.refresh(inner, work.blocks(), context.iterations, residual).is_err() {
            return Status::Stalled;
        }
        // Errors of the linear solves must stay below the residual reached, more so near the end.
        let tolerance = (1e-3 * residual).clamp(1e-13, 1e-6);
        let alpha = mehrotra::step(&mut work, |blocks, b, z| {
            newton.solve(inner, blocks, b, z, tolerance);
        });
        newton.end_iteration(alpha);
        context.iterations += 1;
        if !alpha.is_finite() || alpha < 1e-10 {
            return Status::Stalled;
        }
    }
}
