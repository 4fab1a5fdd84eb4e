//! Derivatives of a time step: of the velocities after it by the velocities before, the external forces and
//! torques, and the coefficients of friction.
//!
//! With v* = v*(v, f) of [`crate::integrate::free_velocity`], r = b + D^T v* and the impulses g(r, mu) of the
//! contact problem,
//!
//! ```text
//! m = v* + M^-1 D g,      v+ = V(v, m)
//! ```
//!
//! with the mean velocities m of the step and V of `crate::rotation`, which is m but for the turning of
//! bodies that are no balls. Of a number L with dL = n . dv+ (a vector-Jacobian product), k = n dV/dm, and
//! with the adjoint of g for y = D^T M^-1 k ([`graintrain_ccp::sensitivity`]): dL/dv* = k + D dL/dr, and from
//! there by the chain rule of v*(v, f); what b knows of v (`FrameTurn`) is added. Contacts, their gaps and
//! frames belong to the positions, which stay.
//!
//! There is a derivative where every contact is strictly apart, sticking or sliding. Contacts that only
//! velocities make contacts, and what else a step does by decisions, have none, and [`GradientError`] says
//! so: impacts with restitution, contacts found in the midst of the step, drag. Turns that mend overlap and
//! take the angular velocity with them are left out.

use crate::collide::Collider;
use crate::contact::Contact;
use crate::frame_turn::{FrameTurn, frame_velocity, has_led_turns};
use crate::handle::MaterialId;
use crate::integrate::{free_velocity, free_velocity_derivative, velocities};
use crate::load::Action;
use crate::math::Vec3;
use crate::rotation::{Rotor, is_fast, world_inertia};
use crate::stepper::{SolverChoice, StepError, StepSettings, Stepper};
use crate::world::World;
use graintrain_ccp::registry::Method;
use graintrain_ccp::sensitivity::{Adjoint, ContactState, Sensitivity, SensitivityError};
use graintrain_ccp::{Ccp, Criterion, Delassus, FIXED, FrictionModel, RigidDelassus, SolverSpec};
use hashbrown::HashMap;

/// Residual that the step's problem is solved to, and the largest accepted.
const TOLERANCE: (f64, f64) = (1e-11, 1e-9);

/// Why a step has no derivative.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GradientError {
    /// The step could not be made.
    #[error(transparent)]
    Step(#[from] StepError),
    /// At a contact, or in the linear system.
    #[error("{source}{}", between(.bodies))]
    Contact {
        /// What is the matter.
        source: SensitivityError,
        /// The bodies of the contact.
        bodies: Option<[String; 2]>,
    },
    /// What the step did besides, or how it is made, has no derivative here.
    #[error("this step has no derivative: {what}")]
    Unsupported {
        /// What that is.
        what: String,
    },
    /// The contact problem was not solved well enough.
    #[error(
        "the contact problem was solved to a residual of {residual:.1e}, derivatives need {TOLERANCE_ACCEPTED:.0e}: {remark}"
    )]
    Unsolved {
        /// Residual reached.
        residual: f64,
        /// What the solver says.
        remark: String,
    },
    /// A cotangent of another length.
    #[error("the cotangent has {got} numbers, expected {expected}, six per body")]
    Size {
        /// Its length.
        got: usize,
        /// The length wanted.
        expected: usize,
    },
}

const TOLERANCE_ACCEPTED: f64 = TOLERANCE.1;

fn between(bodies: &Option<[String; 2]>) -> String {
    bodies.as_ref().map_or(String::new(), |[a, b]| format!("; it is between bodies {a} and {b}"))
}

/// The step that follows a state, with what its derivatives need.
pub struct StepGradient {
    /// The state before the step.
    before: World,
    /// The state after it.
    pub after: World,
    step: f64,
    problem: Ccp,
    sensitivity: Sensitivity,
}

/// Derivatives of a number L by what goes into a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Pullback {
    /// By the velocities and angular velocities before the step, six numbers per body.
    pub velocity: Vec<f64>,
    /// By the external forces and torques, six numbers per body.
    pub force: Vec<f64>,
    /// By the coefficient of friction of each contact of the step; NaN where one is zero and the contact does
    /// not slip.
    pub friction: Vec<f64>,
}

impl StepGradient {
    /// Makes the step that follows this state, on a copy, with the contact problem solved to 1e-11.
    ///
    /// # Errors
    /// [`GradientError`] where the step cannot be made, or has no derivative.
    pub fn new(world: &World, settings: &StepSettings) -> Result<Self, GradientError> {
        let unsupported = |what: &str| Err(GradientError::Unsupported { what: what.to_string() });
        if settings.solver.friction == FrictionModel::Coulomb {
            return unsupported(
                "friction is exact, and the derivative is that of relaxed friction: ask for friction = \"relaxed\"",
            );
        }
        if world.cell().is_some() {
            return unsupported("space repeats in a periodic cell, for which derivatives are not computed");
        }
        if !world.joints().is_empty() {
            return unsupported("bodies are held by joints, whose derivatives are not computed");
        }
        if world.loads().iter().any(|load| matches!(load.action, Action::Drag { .. })) {
            return unsupported("there is drag, which depends on velocities by decisions of its own");
        }
        let name = SolverSpec::from(Method::Ipm);
        let (tolerance, accepted) = TOLERANCE;
        let friction = FrictionModel::Relaxed;
        let solver = SolverChoice {
            name,
            tolerance,
            criterion: Criterion::Maximum,
            friction,
            ..SolverChoice::default()
        };
        let strict = StepSettings { solver, ..settings.clone() };
        if world.materials.has_elastic_pairs() || world.materials.has_cohesive_pairs() {
            return unsupported("a pair of materials has a stiffness or cohesion");
        }
        if world.materials.resist_turning() {
            return unsupported("contacts with rolling or spinning friction have no derivatives yet");
        }
        let mut stepper = Stepper::new(strict)?;
        let mut after = world.clone();
        let report = stepper.step(&mut after)?;
        if report.impacts > 0 {
            return unsupported("bodies met in an impact, with restitution or alone");
        }
        if report.ledger.rest.abs() > 1e-10 * report.ledger.throughput() {
            return unsupported("contacts would have given a spin energy, and gave it less (Rotor::turn)");
        }
        if report.contacts_added > 0 {
            return unsupported("contacts were found in the midst of it; a shorter time step may do");
        }
        if after.contacts.contacts.iter().any(|contact| contact.lead != Vec3::ZERO) {
            return unsupported(
                "bodies move so fast that they meet elsewhere than they are nearest; a shorter time step may do",
            );
        }
        if report.solve.residual.max > accepted {
            let remark = report.solve.remark.unwrap_or_else(|| format!("{:?}", report.solve.status));
            return Err(GradientError::Unsolved { residual: report.solve.residual.max, remark });
        }
        let Some((problem, impulse)) = stepper.last_problem() else {
            return unsupported("it left no contact problem");
        };
        if problem.num_contacts() != after.contacts.contacts.len() {
            return unsupported("bodies are about to meet in an impact; a shorter time step may do");
        }
        // Planes of what passes lie where the velocities put them.
        let found = Collider::default().contacts(world, settings.envelope, settings.step);
        let gaps: HashMap<u64, f64> = found.iter().map(|c| (c.identity, c.gap)).collect();
        let is_moved = |c: &Contact| gaps.get(&c.identity).is_some_and(|gap| *gap != c.gap);
        let pressing =
            after.contacts.contacts.iter().zip(impulse.chunks_exact(3)).filter(|(_, g)| g[0] > 0.0);
        if pressing.into_iter().any(|(contact, _)| is_moved(contact)) {
            return unsupported(
                "a body is deflected into another one that it would pass; a shorter time step may do",
            );
        }
        let sensitivity = Sensitivity::new(problem, impulse).map_err(|source| at_contact(source, &after))?;
        let problem = problem.clone();
        Ok(Self { before: world.clone(), step: settings.step, after, problem, sensitivity })
    }

    /// The contacts of the step.
    pub fn contacts(&self) -> &[Contact] {
        &self.after.contacts.contacts
    }

    /// Their states.
    pub fn states(&self) -> impl ExactSizeIterator<Item = ContactState> + '_ {
        self.sensitivity.states()
    }

    /// Of a number L with dL = `cotangent` . dv+ (six numbers per body, velocity and angular velocity): its
    /// derivatives.
    ///
    /// # Errors
    /// [`GradientError::Size`], or [`GradientError::Contact`] where the linear system is not solved.
    pub fn pull_back(&mut self, cotangent: &[f64]) -> Result<Pullback, GradientError> {
        let expected = 6 * self.before.bodies.len();
        if cotangent.len() != expected {
            return Err(GradientError::Size { got: cotangent.len(), expected });
        }
        let Delassus::Rigid(rigid) = &*self.problem.delassus else {
            let source = SensitivityError::NoBodies;
            return Err(GradientError::Contact { source, bodies: None });
        };
        let mut y = vec![0.0; self.problem.r.len()];
        let by_mean = self.by_mean(cotangent);
        rigid.relative_velocity(&masked(rigid, &by_mean), &mut y);
        let Adjoint { r, friction } =
            self.sensitivity.adjoint(&y).map_err(|source| GradientError::Contact { source, bodies: None })?;
        let mut by_free = by_mean.clone();
        add_transposed(rigid, &r, &mut by_free);
        let (mut velocity, mut force) = (vec![0.0; expected], vec![0.0; expected]);
        let rows = velocity.chunks_exact_mut(6).zip(force.chunks_exact_mut(6));
        for (body, ((velocity, force), n)) in rows.zip(by_free.chunks_exact(6)).enumerate() {
            let (linear, by_spin, by_torque) = free_velocity_derivative(&self.before, body, self.step);
            let (u, w) = (Vec3::from_slice(&n[..3]), Vec3::from_slice(&n[3..]));
            let on_velocity = linear * u;
            velocity[..3].copy_from_slice(&on_velocity.to_array());
            let mut on_spin = by_spin.transpose() * w;
            if !self.is_fast(body) {
                let coasting = self.rotor(body).derivative(self.spin(body), self.step, |turn| turn.mean);
                let at_once = Vec3::from_slice(&by_mean[6 * body + 3..]);
                on_spin += at_once - coasting.transpose() * at_once;
            }
            velocity[3..].copy_from_slice(&on_spin.to_array());
            if on_velocity != Vec3::ZERO {
                let on_force = self.step / self.before.bodies.mass[body] * on_velocity;
                force[..3].copy_from_slice(&on_force.to_array());
            }
            force[3..].copy_from_slice(&(by_torque.transpose() * w).to_array());
        }
        self.add_by_frames(&r, &mut velocity);
        Ok(Pullback { velocity, force, friction })
    }

    /// Adds what the velocities change of r by [`FrameTurn`], of dL/dr.
    fn add_by_frames(&self, r: &[f64], velocity: &mut [f64]) {
        let Delassus::Rigid(rigid) = &*self.problem.delassus else { return };
        let before = velocities(&self.before);
        let free = free_velocity(&self.before, &before, self.step);
        let state = |body: usize| frame_velocity(&self.before, [&before, &free], body);
        for ((contact, row), r) in self.contacts().iter().zip(rigid.contacts()).zip(r.chunks_exact(3)) {
            let is_led = |body: usize| has_led_turns(&self.before, body);
            let Some(turn) = FrameTurn::of(&self.before, contact, self.step, is_led, state) else { continue };
            let [_, t1, t2] = row.frame.map(Vec3::from_array);
            let (by_motion, by_spin) = turn.derivative(r[1] * t1 + r[2] * t2);
            let sides = [(contact.body_a, by_motion, by_spin[0]), (contact.body_b, -by_motion, by_spin[1])];
            for (body, by_motion, by_spin) in sides {
                // The spin of what is driven is that of its motion.
                let by_spin = if self.before.is_prescribed(body as usize) { Vec3::ZERO } else { by_spin };
                let own = velocity[6 * body as usize..6 * body as usize + 6].iter_mut();
                let by = [by_motion, by_spin];
                own.zip(by.iter().flat_map(Vec3::to_array)).for_each(|(own, by)| *own += by);
            }
        }
    }

    /// k = n dV/dm, six numbers per body.
    fn by_mean(&self, n: &[f64]) -> Vec<f64> {
        let mut by_mean = n.to_vec();
        let bodies = &self.after.bodies;
        let turning = by_mean.chunks_exact_mut(6).enumerate();
        for (body, k) in turning.filter(|(body, _)| !self.is_fast(*body)) {
            let inertia = bodies.inertia[body];
            let momentum = world_inertia(inertia, bodies.orientation[body]) * bodies.angular_velocity[body];
            // What torques made of the spin at the start: the angular momentum stays from there on.
            let kicked = world_inertia(inertia, self.before.bodies.orientation[body]).inverse() * momentum;
            let by_kick = self.rotor(body).derivative(kicked, self.step, |turn| turn.spin);
            let turned = by_kick.transpose() * Vec3::from_slice(&k[3..]);
            k[3..].copy_from_slice(&turned.to_array());
        }
        by_mean
    }

    fn rotor(&self, body: usize) -> Rotor {
        Rotor::of(&self.before, body)
    }

    fn spin(&self, body: usize) -> Vec3 {
        self.before.bodies.angular_velocity[body]
    }

    fn is_fast(&self, body: usize) -> bool {
        is_fast(self.spin(body), self.step)
    }

    /// Sums derivatives by the contacts' coefficients to those by the coefficients of pairs of materials:
    /// entry i * len + j is that by the coefficient between i and j, the same as entry j * len + i.
    pub fn by_materials(&self, friction: &[f64]) -> Vec<f64> {
        let len = self.before.materials.len();
        let mut sums = vec![0.0; len * len];
        let material = |body: u32| MaterialId::index(self.before.bodies.material[body as usize]);
        for (contact, friction) in self.contacts().iter().zip(friction) {
            let (i, j) = (material(contact.body_a), material(contact.body_b));
            sums[i * len + j] += friction;
            if i != j {
                sums[j * len + i] += friction;
            }
        }
        sums
    }
}

fn at_contact(source: SensitivityError, world: &World) -> GradientError {
    let contact = match source {
        SensitivityError::Kink { contact, .. } | SensitivityError::Unsolved { contact } => Some(contact),
        _ => None,
    };
    let contact = contact.and_then(|contact| world.contacts.contacts.get(contact));
    let label = |body: u32| world.bodies.label(body as usize);
    GradientError::Contact { source, bodies: contact.map(|c| [label(c.body_a), label(c.body_b)]) }
}

/// M^-1 n, with zero rows for what is prescribed.
fn masked(rigid: &RigidDelassus, n: &[f64]) -> Vec<f64> {
    let mut velocity = vec![0.0; n.len()];
    for ((inverse, n), v) in
        rigid.inverse_mass().iter().zip(n.chunks_exact(6)).zip(velocity.chunks_exact_mut(6))
    {
        for k in 0..3 {
            v[k] = inverse.linear[k] * n[k];
            v[3 + k] = (0..3).map(|l| inverse.angular[3 * k + l] * n[3 + l]).sum();
        }
    }
    velocity
}

/// n += D g, six numbers per body. Fixed bodies are left alone: v* of theirs is prescribed.
fn add_transposed(rigid: &RigidDelassus, g: &[f64], n: &mut [f64]) {
    for (contact, g) in rigid.contacts().iter().zip(g.chunks_exact(3)) {
        let axes = contact.frame.map(Vec3::from_array);
        let force = g[0] * axes[0] + g[1] * axes[1] + g[2] * axes[2];
        for (body, sign, arm) in [(contact.body_a, 1.0, contact.arm_a), (contact.body_b, -1.0, contact.arm_b)]
        {
            if body != FIXED {
                let torque = Vec3::from_array(arm).cross(force);
                let n = &mut n[6 * body as usize..6 * body as usize + 6];
                for k in 0..3 {
                    n[k] += sign * force[k];
                    n[3 + k] += sign * torque[k];
                }
            }
        }
    }
}
