//! What the phases of one solve share: the problem as given and scaled, when to stop, and the best iterate.

use super::super::driver::{Best, Limits};
use super::super::history::History;
use super::super::infeasible::{self, Certificate};
use super::super::report::Status;
use super::iterate::Work;
use super::scaled::Scaled;
use crate::newton::driver::NewtonDriver;
use crate::problem::Ccp;
use crate::residual::{FrictionModel, ResidualScale};
use graintrain_linalg::parallel::dot;

/// One solve. Iterations are Newton systems.
pub(crate) struct SolveContext<'a> {
    /// The problem as given.
    problem: &'a Ccp,
    /// The problem scaled.
    pub scaled: &'a Scaled,
    residual_scale: &'a ResidualScale,
    limits: &'a Limits<'a>,
    friction: FrictionModel,
    /// Newton systems so far.
    pub iterations: usize,
    /// Every residual that was measured.
    pub history: History,
    best: Best<f64>,
    /// What the search for a proof that there is no solution found, once it has been made.
    found: Option<Certificate>,
    physical: Vec<f64>,
    velocity: Vec<f64>,
}

impl<'a> SolveContext<'a> {
    pub fn new(
        problem: &'a Ccp,
        scaled: &'a Scaled,
        residual_scale: &'a ResidualScale,
        limits: &'a Limits<'a>,
        friction: FrictionModel,
    ) -> Self {
        let zeros = vec![0.0; 3 * problem.num_contacts()];
        let (physical, velocity) = (zeros.clone(), zeros);
        let best = Best::default();
        Self {
            problem,
            scaled,
            residual_scale,
            limits,
            friction,
            iterations: 0,
            history: History::default(),
            best,
            found: None,
            physical,
            velocity,
        }
    }

    /// Residual of impulses g of the scaled problem, given N g, in the metric of the problem as given and as
    /// the settings ask for it. The best iterate is kept.
    pub fn measure(&mut self, g: &[f64], ng: &[f64]) -> f64 {
        for k in 0..g.len() {
            self.physical[k] = self.scaled.impulse_unit[k / 3] * g[k];
            self.velocity[k] = self.scaled.velocity_unit[k / 3] * (ng[k] + self.scaled.problem.r[k]);
        }
        let scale = self.residual_scale;
        let found = scale.residual(self.problem, &self.physical, &self.velocity, self.friction);
        self.history.record(self.iterations, self.limits.seconds(), found);
        let residual = self.limits.measured(found);
        self.best.offer(&self.physical, residual);
        residual
    }

    /// Why to stop at this residual, if it is time to.
    pub fn status(&self, residual: f64) -> Option<Status> {
        self.limits.status(self.iterations, residual)
    }

    /// Whether impulses of the scaled problem, given N g, look like those of a problem without a solution and
    /// the search for a proof, made once, leaves no doubt.
    pub fn runs_away(&mut self, newton: &mut NewtonDriver, g: &[f64], ng: &[f64]) -> bool {
        let r = &self.scaled.problem.r;
        self.found.is_none()
            && infeasible::is_suspicious(dot(r, g), dot(g, ng), dot(r, r))
            && self.search(newton) >= infeasible::CERTAIN
    }

    /// What a solve ends with that did so with `status`: [`Status::Infeasible`] where it stalled and there is
    /// a proof.
    pub fn verdict(&mut self, newton: &mut NewtonDriver, status: Status) -> Status {
        let stalled = status == Status::Stalled && self.best.residual() > infeasible::GOOD_ENOUGH;
        if stalled && self.search(newton) >= infeasible::PROBABLE { Status::Infeasible } else { status }
    }

    /// The velocity that a solution needs, as far as it is proved.
    fn search(&mut self, newton: &mut NewtonDriver) -> f64 {
        let Self { problem, scaled, limits, iterations, found, .. } = self;
        found
            .get_or_insert_with(|| infeasible::search(newton, problem, scaled, limits, iterations))
            .needed_velocity
    }

    /// What the search has for a solution, if it was made and has one.
    pub fn take_solution(&mut self) -> Option<Vec<f64>> {
        self.found.as_mut().and_then(|found| found.solution.take())
    }

    /// The best iterate, in the units of the problem as given.
    pub fn best(&self, impulse: &mut [f64]) {
        self.best.restore(impulse);
    }

    /// Forgets the best iterate: what follows solves another problem.
    pub fn forget(&mut self) {
        self.best = Best::default();
    }

    /// Gives the iterate the impulses of the problem as given, projected on their cones, and N g.
    pub fn hand_over(&self, impulse: &[f64], work: &mut Work) {
        self.scale(impulse, &mut work.g);
        work.project(&self.scaled.problem);
        work.multiply(&self.scaled.problem);
    }

    /// Impulses of the scaled problem.
    pub fn scale(&self, impulse: &[f64], g: &mut [f64]) {
        for (k, (g, impulse)) in g.iter_mut().zip(impulse).enumerate() {
            *g = impulse / self.scaled.impulse_unit[k / 3];
        }
    }
}
