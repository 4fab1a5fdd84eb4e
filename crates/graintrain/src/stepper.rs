//! One time step: settings, the step itself, report.

use crate::assemble::{assemble, warm_start};
use crate::collide::Collider;
use crate::contact::ContactSet;
use crate::error::{ModelError, positive};
use crate::integrate::{advance, free_velocity};
use crate::math::Vec3;
use crate::world::World;
use graintrain_ccp::{
    Ccp, CcpError, CcpSolver, Delassus, FrictionModel, Judge, Residual, SolveReport, SolveSettings,
    SolverSpec, Status,
};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// How steps are made.
#[derive(Clone, Debug)]
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
    /// Kinetic energy of the bodies with a dynamic degree of freedom after the step, J.
    pub kinetic_energy: f64,
    /// Seconds per phase.
    pub phases: PhaseSeconds,
    /// One entry per body that is not free.
    pub wrenches: Vec<Wrench>,
}

/// Why a step could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// A setting out of its range.
    #[error(transparent)]
    Settings(#[from] ModelError),
    /// The solver cannot treat the problem, or is not known.
    #[error(transparent)]
    Solver(#[from] CcpError),
    /// A body's state is NaN or infinite. The world is left as it was before the step.
    #[error(
        "step {step} (time {time} s): the {what} of body {body} is {value}; the state before this step was kept. \
         A shorter time step or a deeper look at initial overlaps may help"
    )]
    NotFinite {
        /// Name or index of the body.
        body: String,
        /// Which part of its state.
        what: &'static str,
        /// The offending number.
        value: f64,
        /// Number of the step, from 0.
        step: u64,
        /// Time at its start, s.
        time: f64,
    },
    /// The stop flag was set during the solve. The world is left as it was before the step, since a solve cut short
    /// depends on when that was.
    #[error("stopped before the end of a step")]
    Stopped,
}

/// Makes time steps; owns the solver and everything that is kept between steps apart from the state.
pub struct Stepper {
    settings: StepSettings,
    solver: Box<dyn CcpSolver>,
    collider: Collider,
    last: Option<(Ccp, Vec<f64>)>,
    stop: Option<Arc<AtomicBool>>,
}

impl Stepper {
    /// A stepper with these settings.
    ///
    /// # Errors
    /// [`StepError::Settings`] unless step and tolerance are positive and the envelope is not negative;
    /// [`StepError::Solver`] for an unknown solver.
    pub fn new(settings: StepSettings) -> Result<Self, StepError> {
        positive("the time step", settings.step)?;
        positive("the solver's tolerance", settings.tolerance)?;
        if !(settings.envelope.is_finite() && settings.envelope >= 0.0) {
            let what = "the contact envelope".to_string();
            let expected = "finite and not negative";
            return Err(ModelError::Value { what, value: settings.envelope, expected }.into());
        }
        let solver = settings.solver.build()?;
        Ok(Self { settings, solver, collider: Collider::default(), last: None, stop: None })
    }

    /// The settings.
    pub fn settings(&self) -> &StepSettings {
        &self.settings
    }

    /// Stops a step whose solve is under way as soon as the flag is set: it then ends with [`StepError::Stopped`].
    pub fn stop_on(&mut self, stop: Arc<AtomicBool>) {
        self.stop = Some(stop);
    }

    /// The contact problem of the last step and the impulses found (length 3 N_c, contact frames, N s).
    pub fn last_problem(&self) -> Option<(&Ccp, &[f64])> {
        self.last.as_ref().map(|(problem, impulse)| (problem, impulse.as_slice()))
    }

    /// One step of semi-implicit Euler with contact:
    ///
    /// ```text
    /// contacts with gap <= envelope, or closing within the step; v* = v + M^-1 (dt f + G); solve the CCP of N = D^T M^-1 D, r = b + D^T v*
    /// v+ = v* + M^-1 D g;   x+ = x + dt u+;   Q+ = exp(dt w+ / 2) Q
    /// ```
    ///
    /// A solve that misses its tolerance is no error: see [`StepReport::solve`].
    ///
    /// # Errors
    /// [`StepError::NotFinite`], [`StepError::Solver`] or [`StepError::Stopped`]; the world is left unchanged.
    pub fn step(&mut self, world: &mut World) -> Result<StepReport, StepError> {
        let step = self.settings.step;
        let begin = Instant::now();
        check_state(world)?;
        let contacts = self.collider.contacts(world, self.settings.envelope, step);
        let collided = Instant::now();
        let free = free_velocity(world, step);
        let problem = assemble(world, &contacts, &free, step);
        let mut impulse = warm_start(&problem, &contacts, &world.contacts, world.bodies.len());
        let assembled = Instant::now();
        let solve = self.solve(&problem, &mut impulse)?;
        if solve.status == Status::Stopped {
            return Err(StepError::Stopped);
        }
        let solved = Instant::now();

        let (velocity, world_impulse) = velocity_after(&problem, &impulse, free);
        check_velocity(world, &velocity)?;
        let world_impulse: Vec<Vec3> = world_impulse.chunks_exact(3).map(Vec3::from_slice).collect();
        let normal_sum: f64 = impulse.iter().step_by(3).sum();
        let threshold = 1e-6 * normal_sum / contacts.len().max(1) as f64;
        let contacts_with_force = impulse.iter().step_by(3).filter(|&&g| g > threshold).count();
        let penetration_max = contacts.iter().map(|contact| -contact.gap).fold(0.0, f64::max);
        let set = ContactSet { contacts, impulse: world_impulse, friction: problem.friction.clone() };
        let wrenches = wrenches(world, &set, step);
        advance(world, &velocity, step);
        world.contacts = set;
        world.time += step;
        world.step += 1;
        let report = StepReport {
            contacts: problem.num_contacts(),
            contacts_with_force,
            solve,
            penetration_max,
            kinetic_energy: world.kinetic_energy(),
            phases: PhaseSeconds {
                collide: (collided - begin).as_secs_f64(),
                assemble: (assembled - collided).as_secs_f64(),
                solve: (solved - assembled).as_secs_f64(),
                integrate: solved.elapsed().as_secs_f64(),
            },
            wrenches,
        };
        self.last = Some((problem, impulse));
        Ok(report)
    }

    fn solve(&mut self, problem: &Ccp, impulse: &mut [f64]) -> Result<SolveReport, CcpError> {
        if problem.num_contacts() == 0 {
            return Ok(SolveReport {
                solver: self.solver.name(),
                status: Status::Converged,
                iterations: 0,
                linear_iterations: 0,
                products: 0,
                residual: Residual::default(),
                residual_relaxed: Residual::default(),
                residual_coulomb: Residual::default(),
                residual_paper: 0.0,
                objective: 0.0,
                seconds: 0.0,
                newton: Vec::new(),
                remark: None,
            });
        }
        let settings = SolveSettings {
            tolerance: self.settings.tolerance,
            judge: self.settings.judge,
            max_iterations: self.settings.max_iterations,
            friction: self.settings.friction,
            stop: self.stop.clone(),
            ..SolveSettings::default()
        };
        self.solver.solve(problem, impulse, &settings)
    }
}

/// v+ = free + M^-1 D g, six numbers per body, and the impulses D g in world axes, three per contact.
fn velocity_after(problem: &Ccp, impulse: &[f64], free: Vec<f64>) -> (Vec<f64>, Vec<f64>) {
    let mut velocity = free;
    let mut world_impulse = vec![0.0; impulse.len()];
    if let Delassus::Rigid(rigid) = &problem.delassus {
        rigid.world_impulse(impulse, &mut world_impulse);
        let mut change = vec![0.0; velocity.len()];
        rigid.velocity_change(&world_impulse, &mut change);
        for (v, dv) in velocity.iter_mut().zip(&change) {
            *v += dv;
        }
    }
    (velocity, world_impulse)
}

fn not_finite(world: &World, body: usize, what: &'static str, value: f64) -> StepError {
    let (step, time) = (world.step, world.time);
    StepError::NotFinite { body: world.bodies.label(body), what, value, step, time }
}

fn check_state(world: &World) -> Result<(), StepError> {
    let bodies = &world.bodies;
    let lists = [
        ("position", &bodies.position),
        ("velocity", &bodies.velocity),
        ("angular velocity", &bodies.angular_velocity),
    ];
    for (what, list) in lists {
        if let Some(body) = list.iter().position(|v| !v.is_finite()) {
            let value = list[body].to_array().into_iter().find(|x| !x.is_finite()).unwrap_or(f64::NAN);
            return Err(not_finite(world, body, what, value));
        }
    }
    match bodies.orientation.iter().position(|q| !q.is_finite()) {
        Some(body) => Err(not_finite(world, body, "orientation", f64::NAN)),
        None => Ok(()),
    }
}

fn check_velocity(world: &World, velocity: &[f64]) -> Result<(), StepError> {
    match velocity.iter().position(|v| !v.is_finite()) {
        Some(k) => {
            let what = if k % 6 < 3 { "velocity" } else { "angular velocity" };
            Err(not_finite(world, k / 6, what, velocity[k]))
        }
        None => Ok(()),
    }
}

/// Impulses on every body that is not free, divided by the step; torques about the body's centre at the step's start.
fn wrenches(world: &World, set: &ContactSet, step: f64) -> Vec<Wrench> {
    let bodies = world.bodies.len();
    let mut slot = vec![usize::MAX; bodies];
    let mut wrenches: Vec<Wrench> = Vec::new();
    for body in (0..bodies).filter(|&body| !world.is_free(body)) {
        slot[body] = wrenches.len();
        wrenches.push(Wrench { body: body as u32, ..Wrench::default() });
    }
    for (contact, &impulse) in set.contacts.iter().zip(&set.impulse) {
        for (body, sign) in [(contact.body_a as usize, 1.0), (contact.body_b as usize, -1.0)] {
            if let Some(wrench) = wrenches.get_mut(slot[body]) {
                let force = sign / step * impulse;
                wrench.force += force;
                wrench.torque += (contact.point - world.bodies.position[body]).cross(force);
            }
        }
    }
    wrenches
}
