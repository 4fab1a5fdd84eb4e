//! What a step reports.

use crate::cell::{Cell, ends};
use crate::contact::{Contact, ContactSet};
use crate::handle::BodyId;
use crate::math::Vec3;
use crate::measure::energy::Ledger;
use crate::world::World;
use graintrain_ccp::residual::{MIXED_MAXIMUM, velocity_scale};
use graintrain_ccp::{Ccp, Delassus, Residual, SolveReport};
use graintrain_linalg::parallel::fold_chunks;
use graintrain_linalg::real;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Seconds of the phases of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PhaseSeconds {
    /// Broad and narrow phase.
    pub collide: f64,
    /// Building the contact problem.
    pub assemble: f64,
    /// Solving it, and the impacts before it.
    pub solve: f64,
    /// Velocities, positions, rotations.
    pub integrate: f64,
}

/// Processor seconds of the phases of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProcessorSeconds {
    /// Of all threads of the process.
    pub all: PhaseSeconds,
    /// Of the thread that makes the step. What it does beyond its share is serial.
    pub leading: PhaseSeconds,
}

/// Force and torque that contacts exert on a body that is not free, averaged over the step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Wrench {
    /// The body.
    pub body: BodyId,
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
    /// Connected parts of the contact graph with a problem to solve.
    pub parts: usize,
    /// The solver's own report; over several parts the worst residuals and status, the most iterations, and
    /// the sums of the rest.
    pub solve: SolveReport,
    /// Deepest overlap at the end of the step, m; zero if nothing overlaps.
    pub penetration_max: f64,
    /// Deepest overlap at the end of the step over the size of the smaller of both bodies.
    pub penetration_max_over_size: f64,
    /// Kinetic energy of the bodies with a dynamic degree of freedom after the step, J.
    pub kinetic_energy: f64,
    /// What is left of the contact problem, in physical units.
    pub errors: PhysicalErrors,
    /// Contacts that closed in an impact, over all passes of [`crate::impact`].
    pub impacts: usize,
    /// The worst residual that a solve of theirs was left with. Above the tolerance, the step counts as one
    /// that missed it.
    pub impact_residual: Residual,
    /// Connected parts in which restitution was lowered, because it would have made energy, and contacts that
    /// went on closing through all passes and met plastically.
    pub restitution_lowered: usize,
    /// Contacts that joined the problem after a solve, because their bodies would have met all the same, or
    /// whose bodies it would have led far deeper than foreseen.
    pub contacts_added: usize,
    /// Pairs of bodies found inside each other after the step that had no contact in it.
    pub contacts_missed: usize,
    /// Contacts that exerted more than the solve resolves though their bodies were, at no time of the step,
    /// nearer to each other than a twentieth of the smaller one's size.
    pub contacts_apart: usize,
    /// The largest impulse of those, N s.
    pub impulse_apart_max: f64,
    /// Largest overlap that displacements worked on in this step (see [`crate::overlap`]), m; zero where
    /// there was none to mend.
    pub overlap_corrected_max: f64,
    /// Energy that those displacements gave to bodies against gravity, J.
    pub correction_energy: f64,
    /// What changed the kinetic energy, work of loads included.
    pub ledger: Ledger,
    /// Wall-clock seconds per phase.
    pub phases: PhaseSeconds,
    /// Processor seconds per phase; `None` where the system does not tell.
    pub processor: Option<ProcessorSeconds>,
    /// One entry per body that is not free.
    pub wrenches: Vec<Wrench>,
}

/// What the solve of a step left undone, as a person would measure it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PhysicalErrors {
    /// Largest velocity at which a contact still closes faster than its gap allows, m/s.
    pub approach_max: f64,
    /// The overlap that this makes within the step, over the size of the smaller body.
    pub overlap_per_step_max_over_size: f64,
    /// Largest excess of friction over mu times the normal force, relative to that contact's force; rolling
    /// and spinning friction count likewise, their moments over the effective radius.
    pub cone_excess_max: f64,
    /// Largest angle between friction and the direction against the slip, rad, at contacts that slide (or
    /// roll, where they resist that) faster than the tolerance resolves.
    pub slip_angle_max: f64,
    /// How far the joint that is open most is so at the end of the step, m
    /// ([`crate::joint::JointState::opening`]).
    pub joint_opening_max: f64,
    /// Largest change of the angular momentum of a body that no torque made, over that momentum: of bodies
    /// that turn beyond 1 rad in the step, on which contacts or joints act.
    pub momentum_lost_max: f64,
}

impl PhysicalErrors {
    /// Those of impulses of a problem of these contacts, with the sizes of their smaller bodies (m), the
    /// velocities u at them after the step (length of r), the step (s) and the tolerance of the solve.
    pub(crate) fn of(
        contacts: &[Contact],
        size: &[f64],
        (problem, impulse): (&Ccp, &[f64]),
        u: &[f64],
        (step, tolerance): (f64, f64),
    ) -> Self {
        let Delassus::Rigid(rigid) = &*problem.delassus else { return PhysicalErrors::default() };
        let mut errors = PhysicalErrors::default();
        let resolved = MIXED_MAXIMUM * tolerance * velocity_scale(problem);
        let (u, spin) = u.split_at(3 * contacts.len());
        let moments = impulse[3 * contacts.len()..].chunks_exact(3).zip(spin.chunks_exact(3));
        for (own, (h, w)) in problem.turning.iter().zip(moments) {
            let g = &impulse[3 * own.contact as usize..3 * own.contact as usize + 3];
            let (rolling, slip) = (real::hypot(h[1], h[2]), real::hypot(w[1], w[2]));
            let force = (g[0] * g[0] + g[1] * g[1] + g[2] * g[2]).sqrt();
            if force > 0.0 {
                let excess = (rolling - own.rolling * g[0]).max(h[0].abs() - own.spinning * g[0]);
                errors.cone_excess_max = errors.cone_excess_max.max(excess / force);
            }
            if slip > resolved && rolling > 0.0 {
                let cosine = -(w[1] * h[1] + w[2] * h[2]) / (slip * rolling);
                errors.slip_angle_max = errors.slip_angle_max.max(real::acos(cosine.clamp(-1.0, 1.0)));
            }
        }
        // An angle per contact would cost as much as all the rest.
        let of_chunk = |range: Range<usize>| {
            let (mut errors, mut least_cosine) = (PhysicalErrors::default(), 1.0_f64);
            for k in range {
                let (contact, u, g) = (&contacts[k], &u[3 * k..3 * k + 3], &impulse[3 * k..3 * k + 3]);
                let is_compliant = rigid.compliance().get(k).is_some_and(|&c| c > 0.0);
                let approach = if is_compliant { 0.0 } else { -(u[0] + contact.gap.max(0.0) / step) };
                errors.approach_max = errors.approach_max.max(approach);
                errors.overlap_per_step_max_over_size =
                    errors.overlap_per_step_max_over_size.max(step * approach / size[k]);
                let (limit, friction) = (problem.friction[k] * g[0], (g[1] * g[1] + g[2] * g[2]).sqrt());
                let force = (g[0] * g[0] + friction * friction).sqrt();
                if force > 0.0 {
                    errors.cone_excess_max = errors.cone_excess_max.max((friction - limit) / force);
                }
                let slip = (u[1] * u[1] + u[2] * u[2]).sqrt();
                if slip > resolved && friction > 0.0 {
                    least_cosine = least_cosine.min(-(u[1] * g[1] + u[2] * g[2]) / (slip * friction));
                }
            }
            (errors, least_cosine)
        };
        let worst = |all: (PhysicalErrors, f64), chunk: (PhysicalErrors, f64)| {
            (all.0.worse(&chunk.0), all.1.min(chunk.1))
        };
        let (errors, least_cosine) = fold_chunks(contacts.len(), (errors, 1.0), of_chunk, worst);
        let slip_angle_max = errors.slip_angle_max.max(real::acos(least_cosine.clamp(-1.0, 1.0)));
        Self { slip_angle_max, ..errors }
    }

    /// The larger of each number.
    pub fn worse(&self, other: &Self) -> Self {
        Self {
            approach_max: self.approach_max.max(other.approach_max),
            overlap_per_step_max_over_size: self
                .overlap_per_step_max_over_size
                .max(other.overlap_per_step_max_over_size),
            cone_excess_max: self.cone_excess_max.max(other.cone_excess_max),
            slip_angle_max: self.slip_angle_max.max(other.slip_angle_max),
            joint_opening_max: self.joint_opening_max.max(other.joint_opening_max),
            momentum_lost_max: self.momentum_lost_max.max(other.momentum_lost_max),
        }
    }
}

/// Impulses on every body that is not free, divided by the step; torques about the body's centre at the
/// step's start, where the cell was `cell`.
pub(crate) fn wrenches(
    position: &[Vec3],
    cell: Option<&Cell>,
    world: &World,
    set: &ContactSet,
    step: f64,
) -> Vec<Wrench> {
    let bodies = world.bodies.len();
    let mut slot = vec![usize::MAX; bodies];
    let mut wrenches: Vec<Wrench> = Vec::new();
    for body in (0..bodies).filter(|&body| !world.is_free(body)) {
        slot[body] = wrenches.len();
        wrenches.push(Wrench { body: BodyId::from_index(body), ..Wrench::default() });
    }
    for (contact, &moment) in set.contacts.iter().zip(&set.moment) {
        for (body, sign) in [(contact.body_a as usize, 1.0), (contact.body_b as usize, -1.0)] {
            if let Some(wrench) = wrenches.get_mut(slot[body]) {
                wrench.torque += sign / step * moment;
            }
        }
    }
    let presses =
        |contact: &Contact| [contact.body_a, contact.body_b].iter().any(|&b| slot[b as usize] != usize::MAX);
    for (contact, &impulse) in set.contacts.iter().zip(&set.impulse).filter(|(contact, _)| presses(contact)) {
        let [(body_a, on_a), (body_b, on_b)] = ends(cell, contact);
        for (body, sign, point) in [(body_a, 1.0, on_a), (body_b, -1.0, on_b)] {
            if let Some(wrench) = wrenches.get_mut(slot[body]) {
                let force = sign / step * impulse;
                wrench.force += force;
                wrench.torque += (point - position[body]).cross(force);
            }
        }
    }
    wrenches
}
