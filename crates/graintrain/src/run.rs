//! The run: steps one after another, watched by observers, until the end or until somebody asks to stop.

use crate::output::files::OutputError;
use crate::output::recorder::OutputSettings;
use crate::stepper::{PhaseSeconds, StepReport};
use crate::world::World;
use graintrain_ccp::FrictionModel;
use serde::{Deserialize, Serialize};

/// Everything about a run but the state: what `resume` needs to go on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunSettings {
    /// Name of the scene.
    pub scene: String,
    /// Time step, s.
    pub step: f64,
    /// Contact envelope delta, m.
    pub envelope: f64,
    /// Solver by name.
    pub solver: String,
    /// Residual at which it stops.
    pub tolerance: f64,
    /// Iteration limit; `None` is the solver's own.
    pub max_iterations: Option<usize>,
    /// Relaxed or exact friction.
    pub friction: FrictionModel,
    /// Number of the last step.
    pub steps: u64,
    /// What is written.
    pub output: OutputSettings,
}

/// Sums and extremes over the steps of a run, those before an interruption included.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunTotals {
    /// Wall-clock seconds.
    pub wall_seconds: f64,
    /// Processor seconds of all threads; `None` where the system does not tell.
    pub cpu_seconds: Option<f64>,
    /// Seconds per phase.
    pub phases: PhaseSeconds,
    /// Seconds in observers.
    pub output_seconds: f64,
    /// Seconds in observers after the last step.
    pub last_output_seconds: f64,
    /// Sum over steps of the number of contacts.
    pub contacts_sum: u64,
    /// Largest number of contacts.
    pub contacts_max: usize,
    /// Contacts of the last step.
    pub contacts_final: usize,
    /// Worst residual.
    pub residual_max: f64,
    /// Residual of the last step.
    pub residual_final: f64,
    /// Steps whose solve missed the tolerance.
    pub unconverged_steps: u64,
    /// Deepest overlap, m.
    pub penetration_max: f64,
    /// Overlap in the last step, m.
    pub penetration_final: f64,
}

impl RunTotals {
    /// Adds a step.
    fn add(&mut self, report: &StepReport) {
        let phases = &report.phases;
        self.phases.collide += phases.collide;
        self.phases.assemble += phases.assemble;
        self.phases.solve += phases.solve;
        self.phases.integrate += phases.integrate;
        self.contacts_sum += report.contacts as u64;
        self.contacts_max = self.contacts_max.max(report.contacts);
        self.contacts_final = report.contacts;
        self.residual_max = self.residual_max.max(report.solve.residual.max);
        self.residual_final = report.solve.residual.max;
        self.unconverged_steps += u64::from(!report.solve.converged());
        self.penetration_max = self.penetration_max.max(report.penetration_max);
        self.penetration_final = report.penetration_max;
    }
}

/// Watches a run: writes files, shows progress.
pub trait Observer {
    /// Called after every step with the state and what the step did.
    ///
    /// # Errors
    /// An output that cannot be written ends the run.
    fn observe(
        &mut self,
        world: &World,
        report: &StepReport,
        totals: &RunTotals,
    ) -> Result<(), OutputError>;
}
