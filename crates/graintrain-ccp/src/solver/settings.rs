//! When a solver stops, and which problem it solves.

use super::ranks::Ranks;
use crate::residual::{Criterion, FrictionModel};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// When a solver stops.
#[derive(Clone, Debug)]
pub struct SolveSettings {
    /// Stop when the residual, measured by `criterion`, is at most this. Default 1e-4.
    pub tolerance: f64,
    /// Which number of the residual counts. Default [`Criterion::Maximum`].
    pub criterion: Criterion,
    /// Stop after this many iterations; `None` is the solver's own limit. Where several methods take part,
    /// they are those of projected gradients: see the [cascade](super::cascade).
    pub max_iterations: Option<usize>,
    /// With exact friction: what the search for a proof that there is no solution, and the finish, of a solve
    /// that ended far from the tolerance may cost each beyond `max_iterations`, in the same unit. See the
    /// [cascade](super::cascade). Default 0: none.
    pub finish: usize,
    /// Stop after this time.
    pub max_time: Option<Duration>,
    /// Relaxed CCP or exact Coulomb friction.
    pub friction: FrictionModel,
    /// [`SolveReport::curvature`](super::SolveReport::curvature) of the solve of a similar problem: that of
    /// the step before. `apgd` then needs no power iterations for its first step.
    pub curvature: Option<f64>,
    /// Stop as soon as this is set (Ctrl-C), with the best iterate.
    pub stop: Option<Arc<AtomicBool>>,
    /// The ranks that solve this problem together, each with the same problem and start. Methods that cannot
    /// share their work do it on all ranks alike. `stop` has to be [theirs](Ranks::stop), and `max_time`
    /// `None`: clocks differ.
    pub ranks: Option<Arc<Ranks>>,
}

impl Default for SolveSettings {
    fn default() -> Self {
        Self {
            tolerance: 1e-4,
            criterion: Criterion::Maximum,
            max_iterations: None,
            finish: 0,
            max_time: None,
            friction: FrictionModel::Relaxed,
            curvature: None,
            stop: None,
            ranks: None,
        }
    }
}

impl SolveSettings {
    /// Whether a solve begun at `start` has to stop now because of time or a stop request.
    pub fn out_of_time(&self, start: Instant) -> bool {
        self.max_time.is_some_and(|limit| start.elapsed() >= limit)
            || self.stop.as_ref().is_some_and(|stop| stop.load(Ordering::Relaxed))
    }
}
