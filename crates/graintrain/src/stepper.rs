//! One time step: settings and report.

use crate::math::Vec3;
use graintrain_ccp::{FrictionModel, SolveReport, SolverSpec};
use serde::{Deserialize, Serialize};

/// How steps are made.
#[derive(Clone, Debug)]
pub struct StepSettings {
    /// Time step dt, s.
    pub step: f64,
    /// Contact envelope delta, m: pairs with a gap up to this become contacts.
    pub envelope: f64,
    /// Solver of the contact problem.
    pub solver: SolverSpec,
    /// Residual at which it stops.
    pub tolerance: f64,
    /// Iteration limit; `None` is the solver's own.
    pub max_iterations: Option<usize>,
    /// Relaxed cone complementarity or exact Coulomb friction.
    pub friction: FrictionModel,
}

/// Wall-clock seconds of the phases of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PhaseSeconds {
    /// Broad and narrow phase.
    pub collide: f64,
    /// Building the contact problem.
    pub assemble: f64,
    /// Solving it.
    pub solve: f64,
    /// Velocities, positions, rotations.
    pub integrate: f64,
}

/// Force and torque that contacts exert on a body that is not free, averaged over the step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Wrench {
    /// Index of the body.
    pub body: u32,
    /// N.
    pub force: Vec3,
    /// About the body's centre, N m.
    pub torque: Vec3,
}

/// What a step did.
#[derive(Clone, Debug)]
pub struct StepReport {
    /// Contacts in the envelope.
    pub contacts: usize,
    /// Contacts whose normal impulse exceeds a millionth of the mean.
    pub contacts_with_force: usize,
    /// The solver's own report.
    pub solve: SolveReport,
    /// Deepest overlap after the step's collision detection, m; zero if nothing overlaps.
    pub penetration_max: f64,
    /// Kinetic energy of the free bodies after the step, J.
    pub kinetic_energy: f64,
    /// Seconds per phase.
    pub phases: PhaseSeconds,
    /// One entry per body that is not free.
    pub wrenches: Vec<Wrench>,
}
