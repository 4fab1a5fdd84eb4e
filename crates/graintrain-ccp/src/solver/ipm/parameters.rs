//! The tuned constants of `ipm`.

use super::mehrotra::Correctors;

/// What the interior point [`Ipm`](super::Ipm) is tuned by: the whole, its start, the path, Newton on the
/// projection.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// Newton systems allowed where the settings name no limit.
    pub iterations: usize,
    /// Compliance relative to eta that makes an infeasible problem solvable.
    pub compliance: f64,
    /// Residual that the start is asked for.
    pub start_tolerance: f64,
    /// Iterations of the start beside one per contact.
    pub start_iterations: usize,
    /// One Cholesky factorisation of a settled packing takes as long as so many of these per contact.
    pub system_iterations: f64,
    /// Newton systems without which it is not worth a start.
    pub least_iterations: usize,
    /// Iterations without a better residual before giving up.
    pub path_patience: usize,
    /// Barrier of a cold start: impulses in force chains are a few times larger than those of single
    /// contacts.
    pub cold_barrier: f64,
    /// Bounds of the barrier of a warm start.
    pub warm_barrier: [f64; 2],
    /// sigma times the natural map: how far, in units of impulse, an error of the velocities may move the
    /// argument of P.
    pub reach: f64,
    /// Range of sigma, in units of the scaled problem (trace N_ii = 3).
    pub sigma_range: [f64; 2],
    /// Growth of sigma from one anchor to the next: at least, where the minimum was found in few systems, and
    /// at most.
    pub sigma_growth: [f64; 2],
    /// So many systems are few.
    pub easy_systems: usize,
    /// Factor on sigma where Newton's method does not find the minimum quickly.
    pub sigma_retreat: f64,
    /// Newton systems allowed per anchor.
    pub systems_per_anchor: usize,
    /// A step shorter than this tells that sigma is too large.
    pub short_step: f64,
    /// The anchor moves when the error of the minimum is this fraction of what sigma leaves.
    pub anchor_error: f64,
    /// Newton systems allowed for a tenth of the residual.
    pub stall_systems: usize,
    /// Relative residual of the linear solves.
    pub linear_tolerance: f64,
    /// A line search ends where the slope along the direction has fallen to this fraction.
    pub line_search_slope: f64,
    /// Evaluations of a line search.
    pub line_search_trials: usize,
    /// Gondzio's correctors per step along the path.
    pub correctors: Correctors,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            iterations: 300,
            compliance: 1e-6,
            start_tolerance: 1e-6,
            start_iterations: 500,
            system_iterations: 0.07,
            least_iterations: 10,
            path_patience: 15,
            cold_barrier: 1e3,
            warm_barrier: [1e-4, 1.0],
            reach: 10.0,
            sigma_range: [1.0, 1e9],
            sigma_growth: [10.0, 100.0],
            easy_systems: 3,
            sigma_retreat: 0.03,
            systems_per_anchor: 6,
            short_step: 0.05,
            anchor_error: 0.3,
            stall_systems: 10,
            linear_tolerance: 1e-10,
            line_search_slope: 0.5,
            line_search_trials: 30,
            correctors: Correctors::default(),
        }
    }
}
