//! How steps are made.

use crate::assemble::OverlapCorrection;
use graintrain_ccp::{FrictionModel, Judge, SolverSpec};

/// How steps are made. Its fields in their order are part of the format of checkpoints.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StepSettings {
    /// Time step dt, s.
    pub step: f64,
    /// Contact envelope delta, m: pairs with a gap up to this become contacts, and so do pairs that would close within
    /// the step.
    pub envelope: f64,
    /// Solver of the contact problem.
    pub solver: SolverSpec,
    /// Residual at which it stops, as `judge` takes it.
    pub tolerance: f64,
    /// Which number of the residual is held against the tolerance; [`Judge::Mixed`] in runs unless asked otherwise.
    pub judge: Judge,
    /// Iteration limit; `None` is the solver's own.
    pub max_iterations: Option<usize>,
    /// Relaxed cone complementarity or exact Coulomb friction.
    pub friction: FrictionModel,
    /// What becomes of overlap.
    pub overlap: OverlapCorrection,
}

impl Default for StepSettings {
    /// Steps of 1 ms, no envelope beyond what closes within the step, solver `auto` to 1e-4, relaxed friction, positions corrected.
    fn default() -> Self {
        Self {
            step: 1e-3,
            envelope: 0.0,
            solver: SolverSpec::default(),
            tolerance: 1e-4,
            judge: Judge::Mixed,
            max_iterations: None,
            friction: FrictionModel::Relaxed,
            overlap: OverlapCorrection::Position,
        }
    }
}
