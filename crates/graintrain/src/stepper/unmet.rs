//! Contacts that exert force though their bodies may pass each other: tried without.
//!
//! A contact keeps two bodies apart along the plane that their nearest points have at the start of the step.
//! Of bodies that pass close by, round or at an edge, that plane bars the way though nothing touches. Whether
//! one that is held by others (a floor, a joint) meets it no motion tells that is known before the solve: it
//! falls, is carried or pushed. So a contact that exerts force is let go, once in a step, where its bodies
//! pass each other as they moved before the step, or as they would move without contacts; and the step is
//! solved again. Where they then overlap on their way, it is back.

use super::Stepper;
use super::attempt::Attempt;
use super::covered::leave_out;
use super::repetition::Rounds;
use crate::assemble::{contact_rows, relative_velocities};
use crate::contact::Contact;
use crate::integrate::velocities;
use crate::math::Vec3;
use crate::world::World;
use rayon::prelude::*;
use std::collections::HashSet;

/// Bodies whose gap is below this fraction of the smaller one's size touch: without what carries it a body
/// meets everything below it.
const TOUCHING: f64 = 5e-5;

/// How two bodies go through the step.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    /// As Phi + dt u_n says, they do not come together.
    Apart,
    /// It says that they overlap, and they do by no more than goes unseen, and than a fraction of that.
    Passes,
    Meets,
}

impl Stepper {
    /// Lets contacts go, and takes those back without which bodies overlap; whether any of both was done.
    /// `world` is at the start of the step. Cost: a pass over the contacts; a walk along two motions for each
    /// pair with a gap and force, and along one for each that was let go.
    pub(super) fn try_without(&self, world: &World, rounds: &mut Rounds, attempt: &Attempt) -> bool {
        let let_go = rounds.take_let_go();
        let ways = self.ways(world, &let_go, attempt, &attempt.velocity);
        let (back, gone): (Vec<_>, Vec<_>) =
            let_go.into_iter().zip(ways).partition(|(_, way)| *way == Way::Meets);
        rounds.let_go.extend(gone.into_iter().map(|(contact, _)| contact));
        let unmet = self.unmet(world, rounds, attempt);
        rounds.tried.extend(unmet.iter().map(|&i| rounds.contacts[i].identity));
        rounds.let_go.extend(unmet.iter().map(|&i| rounds.contacts[i]));
        leave_out(&mut rounds.contacts, &unmet);
        let any = !(back.is_empty() && unmet.is_empty());
        rounds.take(back.into_iter().map(|(contact, _)| contact).collect());
        any
    }

    /// Contacts (places, ascending) that are to be let go: those of bodies of which one is held, that were
    /// not seen to meet, and pass each other.
    fn unmet(&self, world: &World, rounds: &Rounds, attempt: &Attempt) -> Vec<usize> {
        // Planes that gather need no trials.
        if 2 * rounds.round >= self.parameters.repetition.rounds {
            return Vec::new();
        }
        // What moves freely was looked at as it flies.
        let is_jointed = jointed(world);
        let is_held = |body: usize| is_jointed[body] || world.is_prescribed(body);
        let may_be = |i: &usize| {
            let contact = &rounds.contacts[*i];
            let pair = [contact.body_a, contact.body_b].map(|body| body as usize);
            // Nothing passes a half-space.
            pair.iter().any(|&body| is_held(body))
                && !pair.iter().any(|&body| world.is_unbounded(body))
                && contact.gap > TOUCHING * self.collider.contact_size(world, contact)
                && attempt.pulls.get(*i).is_none_or(|&pull| pull == 0.0)
                && rounds.times_met(contact) == 0
                && !rounds.tried.contains(&contact.identity)
        };
        // Of contacts side by side any may carry the force.
        let with_force =
            attempt.active.iter().zip(attempt.impulse.chunks_exact(3)).filter(|(_, g)| g[0] > 0.0);
        let with_force = with_force.map(|(&i, _)| i as usize).filter(may_be);
        let pairs: HashSet<[u32; 2]> = with_force.map(|i| rounds.contacts[i].unordered()).collect();
        if pairs.is_empty() {
            return Vec::new();
        }
        let is_beside = |i: &usize| pairs.contains(&rounds.contacts[*i].unordered());
        let places: Vec<usize> = (0..rounds.contacts.len()).filter(is_beside).filter(may_be).collect();
        let contacts: Vec<Contact> = places.iter().map(|&i| rounds.contacts[i]).collect();
        let before = self.ways(world, &contacts, attempt, &velocities(world));
        let free = self.ways(world, &contacts, attempt, &attempt.free);
        let passes = before.into_iter().zip(free).map(|(before, free)| [before, free].contains(&Way::Passes));
        places.into_iter().zip(passes).filter(|(_, passes)| *passes).map(|(i, _)| i).collect()
    }

    /// How the bodies of each of these contacts go that move with these velocities, six numbers each. The way
    /// of what joints turn aside bends by dt^2 a / 2, a its acceleration without contacts, which is no
    /// overlap.
    fn ways(&self, world: &World, contacts: &[Contact], attempt: &Attempt, velocity: &[f64]) -> Vec<Way> {
        if contacts.is_empty() {
            return Vec::new();
        }
        let (step, repetition, collider) = (self.settings.step, &self.parameters.repetition, &self.collider);
        let is_jointed = jointed(world);
        let u =
            relative_velocities(attempt.cell.as_ref(), contacts, &contact_rows(world, contacts), velocity);
        let way = |(contact, u): (&Contact, &[f64])| {
            let foreseen = -(contact.gap + step * u[0]);
            if foreseen <= 0.0 {
                return Way::Apart;
            }
            let pair = [contact.body_a, contact.body_b];
            let of_body =
                |body: u32| [0, 3].map(|k| Vec3::from_slice(&velocity[6 * body as usize + k..][..3]));
            let bends = |body: u32| {
                let body = body as usize;
                let change = Vec3::from_slice(&attempt.free[6 * body..][..3]) - world.bodies.velocity[body];
                if is_jointed[body] { 0.5 * step * change.length() } else { 0.0 }
            };
            let aside: f64 = pair.into_iter().map(bends).sum();
            let unseen = repetition.undetected * collider.contact_size(world, contact);
            let allowed = unseen.min(repetition.spurious * foreseen);
            let allowed = allowed.max(aside.min(0.5 * foreseen));
            let passes = collider.pass_freely(world, pair, pair.map(of_body), step, &[allowed], 0.0)[0];
            if passes { Way::Passes } else { Way::Meets }
        };
        contacts.par_iter().zip(u.par_chunks_exact(3)).map(way).collect()
    }
}

/// Which bodies are in joints.
fn jointed(world: &World) -> Vec<bool> {
    let mut is_jointed = vec![false; world.bodies.len()];
    for body in world.joints().iter().flat_map(|placed| placed.joint.bodies.iter().flatten()) {
        is_jointed[body.index()] = true;
    }
    is_jointed
}
