//! Contacts that exert force though their bodies may pass each other: tried without.
//!
//! A contact keeps two bodies apart along the plane that their nearest points have at the start of the step.
//! Of bodies that pass close by, round or at an edge or over a seam, that plane bars the way though nothing
//! touches. So a contact that exerts force is let go, once in a step, where its bodies would pass each other;
//! and the step is solved again. Where they then overlap on their way, it is back. How they would move is
//! taken from
//!
//! * the velocities found, without what the contacts of the two did to them: what else carries them, does so
//!   then too, but for what these have taken over from it, up to the weight;
//! * those before the step and those without any contact, where one of both is held by a joint or prescribed:
//!   whether what it falls, is carried or pushed by lets it meet the other one no motion tells that is known
//!   before the solve.
//!
//! What joints turn aside goes on as without contacts instead, along the course that they bend ([`bends`]).
//!
//! Contacts of two free balls are left alone here: they have no seams, and what keeps clear of each other has
//! planes moved (`apart.rs`).

use super::Stepper;
use super::attempt::Attempt;
use super::bend::{bends, jointed};
use super::covered::leave_out;
use super::repetition::{Parameters as Repetition, Rounds};
use crate::assemble::{contact_rows, velocity_of};
use crate::cell;
use crate::collide::{Collider, Course};
use crate::contact::Contact;
use crate::integrate::{velocities, with_driven};
use crate::math::Vec3;
use crate::world::World;
use graintrain_ccp::RigidContact;
use hashbrown::HashSet;
use rayon::prelude::*;
use std::slice::from_ref;

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

/// Velocities (u, w) of the two bodies of a contact.
type Motion = [[Vec3; 2]; 2];

impl Stepper {
    /// Lets contacts go, or where there are no more to let go takes those back without which bodies overlap;
    /// whether any of both was done. `world` is at the start of the step. Cost: a pass over the contacts; a
    /// walk along up to three motions for each contact of a pair with force, and along one for each that was
    /// let go.
    pub(super) fn try_without(&self, world: &World, rounds: &mut Rounds, attempt: &Attempt) -> bool {
        let ways = self.ways(world, attempt);
        let unmet = self.unmet(world, rounds, &ways);
        if !unmet.is_empty() {
            rounds.tried.extend(unmet.iter().map(|&i| rounds.contacts[i].identity));
            rounds.let_go.extend(unmet.iter().map(|&i| rounds.contacts[i]));
            leave_out(&mut rounds.contacts, &unmet);
            return true;
        }
        let back = self.returning(rounds, &ways);
        let are_any = !back.is_empty();
        rounds.take(back);
        are_any
    }

    /// Contacts that were let go without which bodies overlap, with the velocities found: they come back, or
    /// in the last round were not detected.
    pub(super) fn not_returned(&self, world: &World, rounds: &mut Rounds, attempt: &Attempt) -> usize {
        self.returning(rounds, &self.ways(world, attempt)).len()
    }

    /// Takes those contacts out of those that were let go without which bodies overlap.
    fn returning(&self, rounds: &mut Rounds, ways: &Ways<'_>) -> Vec<Contact> {
        let let_go = rounds.take_let_go();
        let rows = contact_rows(ways.world, &let_go);
        let is_back = |(contact, row): (&Contact, &RigidContact)| {
            let found = contact.unordered().map(|body| velocity_of(&ways.attempt.velocity, body as usize));
            let (contact, row) = (from_ref(contact), from_ref(row));
            ways.falling(contact, row, found, [0.0, ways.unseen(contact)]) == [Way::Meets]
        };
        let is_back: Vec<bool> = let_go.par_iter().zip(&rows).map(is_back).collect();
        let (back, gone): (Vec<_>, Vec<_>) =
            let_go.into_iter().zip(is_back).partition(|(_, is_back)| *is_back);
        rounds.let_go.extend(gone.into_iter().map(|(contact, _)| contact));
        back.into_iter().map(|(contact, _)| contact).collect()
    }

    /// Contacts (places, ascending) that are to be let go: those not seen to meet whose bodies pass each
    /// other.
    fn unmet(&self, world: &World, rounds: &Rounds, ways: &Ways<'_>) -> Vec<usize> {
        // Planes that gather need no trials.
        if 2 * rounds.round >= self.parameters.repetition.rounds {
            return Vec::new();
        }
        let attempt = ways.attempt;
        let (collider, contacts) = (&self.collider, attempt.posed_with(&rounds.contacts));
        let is_held = |body: u32| ways.is_jointed[body as usize] || world.is_prescribed(body as usize);
        let may_be = |i: &usize| {
            let (contact, bodies) = (&contacts[*i], contacts[*i].unordered());
            // Nothing passes a half-space.
            bodies.iter().any(|&body| is_held(body) || !collider.is_ball(world, body as usize))
                && !bodies.iter().any(|&body| world.is_unbounded(body as usize))
                && attempt.pulls.get(*i).is_none_or(|&pull| pull == 0.0)
                && rounds.times_met(contact) == 0
                && !rounds.tried.contains(&contact.identity)
        };
        // Of contacts side by side any may carry the force.
        let with_force = (0..contacts.len()).filter(may_be).filter(|&i| attempt.push(i) != Vec3::ZERO);
        let pairs: HashSet<[u32; 2]> = with_force.map(|i| contacts[i].unordered()).collect();
        if pairs.is_empty() {
            return Vec::new();
        }
        let pair = |i: usize| contacts[i].unordered();
        let mut places: Vec<usize> = (0..contacts.len()).filter(|&i| pairs.contains(&pair(i))).collect();
        places.sort_by_key(|&i| (pair(i), i));
        // Joints turn aside what they hold: it does not go on as before.
        let mut before = with_driven(world, &velocities(world), self.settings.step);
        for (body, _) in ways.is_jointed.iter().enumerate().filter(|(_, is_jointed)| **is_jointed) {
            before[6 * body..6 * body + 6].copy_from_slice(&attempt.free[6 * body..6 * body + 6]);
        }
        let passing = |group: &[usize]| {
            let own: Vec<Contact> = group.iter().map(|&i| contacts[i]).collect();
            let rows = contact_rows(world, &own);
            let of = |velocity: &[f64]| pair(group[0]).map(|body| velocity_of(velocity, body as usize));
            let found = of(&attempt.velocity);
            let change = attempt.response(group, &own, &rows);
            let without = [0, 1].map(|side| [0, 1].map(|k| found[side][k] - change[side][k]));
            let is_held = pair(group[0]).into_iter().any(is_held);
            let mut passes: Vec<bool> = ways
                .without(&own, &rows, [without, of(&before)])
                .iter()
                .map(|&way| way == Way::Passes)
                .collect();
            if is_held {
                // Those of bodies in joints are the same.
                let mut motions = vec![of(&before), of(&attempt.free)];
                motions.dedup();
                for motion in motions {
                    let found = ways.falling(&own, &rows, motion, [0.0; 2]);
                    for ((passes, way), contact) in passes.iter_mut().zip(found).zip(&own) {
                        let touches = contact.gap <= TOUCHING * collider.contact_size(world, contact);
                        *passes |= !touches && way == Way::Passes;
                    }
                }
            }
            let places = group.iter().copied().zip(passes).filter(|(i, passes)| *passes && may_be(i));
            places.map(|(i, _)| i).collect::<Vec<usize>>()
        };
        let groups: Vec<&[usize]> = places.chunk_by(|&i, &j| pair(i) == pair(j)).collect();
        let mut found: Vec<usize> = groups.into_par_iter().flat_map_iter(passing).collect();
        found.sort_unstable();
        found
    }

    fn ways<'a>(&'a self, world: &'a World, attempt: &'a Attempt) -> Ways<'a> {
        let (collider, repetition) = (&self.collider, &self.parameters.repetition);
        let bends = bends(world, &attempt.free);
        Ways {
            collider,
            repetition,
            unseen: self.unseen(),
            step: self.settings.step,
            world,
            attempt,
            is_jointed: jointed(world),
            bends,
        }
    }
}

/// How bodies go through a step.
struct Ways<'a> {
    collider: &'a Collider,
    repetition: &'a Repetition,
    /// See [`Stepper::unseen`].
    unseen: f64,
    step: f64,
    world: &'a World,
    attempt: &'a Attempt,
    is_jointed: Vec<bool>,
    /// [`bends`].
    bends: Vec<Vec3>,
}

impl Ways<'_> {
    /// What two bodies with these contacts may overlap by unseen, m.
    fn unseen(&self, contacts: &[Contact]) -> f64 {
        self.unseen * self.collider.contact_size(self.world, &contacts[0])
    }

    /// The course of a body that ends the step with these velocities: joints turn it aside on the way as they
    /// do without contacts.
    fn course(&self, body: usize, [velocity, spin]: [Vec3; 2]) -> Course {
        Course { velocity, spin, bend: self.bends.get(body).copied().unwrap_or(Vec3::ZERO) }
    }

    /// How two bodies go, by each of their contacts, without what these do. What a body falls in the step is
    /// allowed for: they may have carried its weight in the place of others. Where it falls too far for that,
    /// `before` tells instead.
    fn without(
        &self,
        contacts: &[Contact],
        rows: &[RigidContact],
        [without, before]: [Motion; 2],
    ) -> Vec<Way> {
        let Self { collider, repetition, step, world, .. } = self;
        let fall = contacts[0].unordered().map(|body| world.acceleration(body as usize));
        let fall = fall.into_iter().fold(0.0, f64::max) * step * step;
        if fall <= repetition.fallen * collider.contact_size(world, &contacts[0]) {
            self.falling(contacts, rows, without, [fall, self.unseen(contacts)])
        } else {
            self.falling(contacts, rows, before, [0.0, self.unseen(contacts)])
        }
    }

    /// How two bodies that move like this and fall so far, m, go by each of their contacts; where Phi + dt
    /// u_n comes to less than `least`, m, it tells nothing.
    fn falling(
        &self,
        contacts: &[Contact],
        rows: &[RigidContact],
        motion: Motion,
        [fall, least]: [f64; 2],
    ) -> Vec<Way> {
        let &Self { collider, repetition, step, world, attempt, .. } = self;
        let bodies = contacts[0].unordered();
        let speed = |body: u32, arm: [f64; 3]| {
            let [u, w] = motion[usize::from(body != bodies[0])];
            u + w.cross(Vec3::from_array(arm))
        };
        let foreseen = |contact: &Contact, row: &RigidContact| {
            let mut closing = speed(contact.body_a, row.arm_a) - speed(contact.body_b, row.arm_b);
            if contact.image != [0; 3] {
                closing -= cell::image_velocity(attempt.cell.as_ref(), contact);
            }
            -(contact.gap.max(0.0) + step * contact.normal.dot(closing)) - fall
        };
        let unseen = self.unseen(contacts);
        let mut ways = vec![Way::Apart; contacts.len()];
        let mut barred: Vec<(usize, f64)> = Vec::new();
        for (k, (contact, row)) in contacts.iter().zip(rows).enumerate() {
            let foreseen = foreseen(contact, row);
            if foreseen > least {
                barred.push((k, unseen.min(repetition.spurious * foreseen)));
            }
        }
        barred.sort_by(|(_, a), (_, b)| a.total_cmp(b));
        let allowed: Vec<f64> = barred.iter().map(|&(_, allowed)| allowed).collect();
        let passes = match allowed.is_empty() {
            true => Vec::new(),
            false => {
                let courses = [0, 1].map(|k| self.course(bodies[k] as usize, motion[k]));
                collider.pass_freely(world, bodies, courses, step, &allowed, fall)
            }
        };
        for ((k, _), passes) in barred.into_iter().zip(passes) {
            ways[k] = if passes { Way::Passes } else { Way::Meets };
        }
        ways
    }
}
