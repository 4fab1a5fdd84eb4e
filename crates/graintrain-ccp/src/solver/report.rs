//! What a solve did.

use super::history::{History, ResidualSample};
use crate::newton::NewtonRecord;
use crate::residual::Residual;

/// Why a solver stopped. Not reaching the tolerance is a status, not an error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// The residual, as measured, is at most the tolerance.
    #[default]
    Converged,
    /// No further progress is possible (round-off, breakdown of a linear solve).
    Stalled,
    /// The iteration limit was reached.
    IterationLimit,
    /// The time limit was reached or a stop was requested.
    Stopped,
    /// The problem has no solution: the bodies are jammed (see the solver's documentation for what is
    /// returned).
    Infeasible,
}

impl Status {
    /// Its name in files: `converged`, `stalled`, `iteration-limit`, `stopped`, `infeasible`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::Stalled => "stalled",
            Self::IterationLimit => "iteration-limit",
            Self::Stopped => "stopped",
            Self::Infeasible => "infeasible",
        }
    }
}

/// What a stage of a [cascade](super::cascade) did.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct StageRecord {
    /// The method.
    pub solver: String,
    /// What it started from: `best`, `last` or `zero`.
    pub start: String,
    /// Its iterations.
    pub iterations: usize,
    /// Residual of what it returned.
    pub residual: Residual,
    /// Why it ended.
    pub status: Status,
}

/// What a solve did, by default nothing, where there was nothing to do. The impulses returned are the best
/// iterate found, converged or not.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct SolveReport {
    /// Name of the solver, with its linear solver where it has one.
    pub solver: String,
    /// Why it stopped.
    pub status: Status,
    /// Iterations of the outer method.
    pub iterations: usize,
    /// Iterations of linear solvers, summed.
    pub linear_iterations: usize,
    /// Products with N that a first-order method's iterations made (a sweep of Gauss-Seidel is one); 0 for
    /// other methods.
    #[serde(default)]
    pub products: usize,
    /// What `apgd` remembers for the next solve: the largest curvature d^T N' d / |d|^2 of its scaled N along
    /// the steps that it made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curvature: Option<f64>,
    /// Residual of the returned impulses in the friction model asked for.
    pub residual: Residual,
    /// Residual of the returned impulses as a relaxed CCP.
    pub residual_relaxed: Residual,
    /// Residual of the returned impulses as exact Coulomb friction.
    pub residual_coulomb: Residual,
    /// 1/2 g^T N g + r^T g, J.
    pub objective: f64,
    /// Wall-clock seconds.
    pub seconds: f64,
    /// What the linear solver of a second-order method did, one record per Newton iteration.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub newton: Vec<NewtonRecord>,
    /// The residual in the friction model asked for, at every check that the solver made: iteration, seconds,
    /// rms, max. Where there were more than 256 checks they are thinned evenly; the last one is always there.
    /// A check looks at the solver's own iterate, in its own arithmetic: the impulses returned are the best
    /// ones, and `residual` is theirs, evaluated afresh.
    ///
    /// ```
    /// use graintrain_ccp::{Ccp, SolveSettings, SolverSpec};
    /// let entries: Vec<_> = (0..6).map(|k| (k, k, 1.0 + k as f64)).collect();
    /// let r = vec![-1.0, 0.1, 0.0, -0.5, 0.0, 0.2];
    /// let problem = Ccp::from_triplets(&entries, r, vec![0.3; 2])?;
    /// let settings = SolveSettings { tolerance: 1e-8, ..SolveSettings::default() };
    /// let report = SolverSpec::default().build()?.solve(&problem, &mut [0.0; 6], &settings)?;
    /// let least = report.history.iter().map(|sample| sample.max).fold(f64::INFINITY, f64::min);
    /// assert!(report.converged() && least <= 1e-8);
    /// # Ok::<(), graintrain_ccp::CcpError>(())
    /// ```
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub history: Vec<ResidualSample>,
    /// Who worked, in this order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<StageRecord>,
    /// What is to be said beside the status: why a linear solver gave up, where that ended the solve, or
    /// which other method than the one named ended it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remark: Option<String>,
}

impl SolveReport {
    /// The report of a solve that went on where an earlier one had ended: the work of both.
    #[must_use]
    pub fn after(mut self, earlier: &Self) -> Self {
        let mut history = History::default();
        history.append(&earlier.history, 0, 0.0);
        history.append(&self.history, earlier.iterations, earlier.seconds);
        self.history = history.into_samples();
        self.iterations += earlier.iterations;
        self.linear_iterations += earlier.linear_iterations;
        self.products += earlier.products;
        self.curvature = self.curvature.or(earlier.curvature);
        self.seconds += earlier.seconds;
        let own = std::mem::replace(&mut self.newton, earlier.newton.clone());
        self.newton.extend(own);
        self.stages.splice(0..0, earlier.stages.iter().cloned());
        self
    }

    /// Whether the tolerance was reached.
    pub fn converged(&self) -> bool {
        self.status == Status::Converged
    }
}
