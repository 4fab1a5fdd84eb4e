//! How steps are made.

use crate::assemble::OverlapCorrection;
use graintrain_ccp::{Criterion, FrictionModel, SolveSettings, SolverSpec};

/// How steps are made. Its fields in their order are part of the format of checkpoints.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StepSettings {
    /// Time step dt, s.
    pub step: f64,
    /// Contact envelope delta, m: pairs with a gap up to this become contacts, and so do pairs that would
    /// close within the step.
    pub envelope: f64,
    /// Solver of the contact problem, and what is asked of it.
    pub solver: SolverChoice,
    /// What becomes of overlap.
    pub overlap: OverlapCorrection,
}

impl Default for StepSettings {
    /// Steps of 1 ms, no envelope beyond what closes within the step, solver `auto` to 1e-4, exact friction,
    /// positions corrected.
    fn default() -> Self {
        Self {
            step: 1e-3,
            envelope: 0.0,
            solver: SolverChoice::default(),
            overlap: OverlapCorrection::Position,
        }
    }
}

/// No step is solved to less: looser tolerances save iterations, but bodies that are led into each other have
/// to be led again, which costs more than it saves (docs/mechanics.md, "The step").
pub const LOOSEST: f64 = 1e-2;

/// The solver of the contact problems of a simulation and what is asked of it: the table `[solver]` of
/// scenes. Its fields in their order are part of the format of checkpoints.
///
/// ```
/// use graintrain::ccp::FrictionModel;
/// use graintrain::stepper::{SolverChoice, StepSettings};
/// let solver = SolverChoice { tolerance: 1e-6, friction: FrictionModel::Relaxed, ..SolverChoice::default() };
/// let settings = StepSettings { step: 5e-4, solver, ..StepSettings::default() };
/// # assert_eq!(settings.solver.name.to_string(), "auto");
/// ```
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SolverChoice {
    /// The solver, with its linear solver.
    pub name: SolverSpec,
    /// Residual at which it stops, as `criterion` takes it; steps are solved to [`LOOSEST`] at least.
    pub tolerance: f64,
    /// Which number of the residual is held against the tolerance; [`Criterion::Mixed`] in runs unless asked
    /// otherwise.
    pub criterion: Criterion,
    /// Iterations that a connected part of the contacts may cost in a step, with exact friction; `None` is
    /// 12 000 of projected gradients, up to 30 000 for fewer than 1 024 contacts
    /// ([`PartParameters`](super::PartParameters)), and the own limit of methods that count something else. A
    /// step that ends so has not converged: it is made with the best impulses found, and their residual is
    /// reported.
    pub max_iterations: Option<usize>,
    /// Relaxed cone complementarity or exact Coulomb friction.
    pub friction: FrictionModel,
}

impl Default for SolverChoice {
    /// Solver `auto` to 1e-4, measured by the root mean square with a bound for the worst contact; exact
    /// friction.
    fn default() -> Self {
        Self {
            name: SolverSpec::default(),
            tolerance: 1e-4,
            criterion: Criterion::Mixed,
            max_iterations: None,
            friction: FrictionModel::Coulomb,
        }
    }
}

impl SolverChoice {
    /// The tolerance that steps are solved to: that asked for, or [`LOOSEST`].
    pub fn step_tolerance(&self) -> f64 {
        self.tolerance.min(LOOSEST)
    }

    /// What it asks of a solve.
    pub fn solve_settings(&self) -> SolveSettings {
        let Self { name: _, tolerance, criterion, max_iterations, friction } = *self;
        SolveSettings { tolerance, criterion, max_iterations, friction, ..SolveSettings::default() }
    }
}
