//! Contacts that exert force though their bodies were never together.
//!
//! A step asks for `g_n >= 0`, `Phi + dt u_n >= 0` and that one of both vanishes, with the gap linearised
//! where the bodies were. What is meant is the motion: `g_n > 0` only where the bodies touch at some time of
//! the step. Whether they did is looked at afterwards, along the motions that the step is made of: with the
//! velocities before it, those after the impacts, and those of its end.
//!
//! Planes of bodies that keep clear of each other all the same are then moved so far away that they let pass
//! what passed, and the step is solved again:
//!
//! ```text
//! Phi' = nearest - dt u_n,     nearest: the least distance of both on their way
//! ```
//!
//! where that is more than Phi. What else is solved then may send the bodies onto each other after all: a
//! plane is back where it was, for good, once they go through each other on their way.

use super::Stepper;
use super::attempt::Attempt;
use super::placement::Placement;
use super::repetition::Rounds;
use crate::assemble::velocity_of;
use crate::cell::{self, Cell};
use crate::collide::Collider;
use crate::contact::Contact;
use crate::math::Vec3;
use crate::world::World;
use graintrain_ccp::Delassus;
use graintrain_ccp::residual::{MIXED_MAXIMUM, velocity_scale};
use hashbrown::HashSet;

/// Bodies nearer than this fraction of the smaller one's size count as together.
const TOGETHER: f64 = 0.05;

/// Balls whose plane was moved go through each other where they overlap on their way by more than this
/// fraction of the smaller one's size.
const THROUGH: f64 = 0.02;

/// Other bodies do where they touch before this fraction of the step: at its end they may.
const EARLY: f64 = 0.95;

/// How often the plane of a contact is moved out of the way of its bodies in a step.
const OFTEN: usize = 2;

/// How often the distance of bodies that are no balls is doubled to find how near they come.
const DOUBLED: i32 = 5;

/// What [`Stepper::apart`] finds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Apart {
    /// Contacts with force whose bodies were never together in the step.
    pub count: usize,
    /// The largest of their impulses, N s.
    pub impulse_max: f64,
}

impl Stepper {
    /// Contacts with force whose bodies were never together. `world` is at the end of the step, `ahead` are
    /// its contacts there.
    pub(super) fn apart(
        &self,
        world: &World,
        start: &Placement,
        contacts: &[Contact],
        attempt: &Attempt,
        ahead: &[Contact],
    ) -> Apart {
        let unmet = self.never_together(world, start, contacts, attempt, ahead);
        let impulse_max = unmet.iter().map(|(_, impulse)| *impulse).fold(0.0, f64::max);
        Apart { count: unmet.len(), impulse_max }
    }

    /// Contacts (places, ascending, and impulses, N s) whose impulse in the contact problem changes
    /// velocities by more than the solve resolves and whose bodies were nowhere on their way nearer to each
    /// other than [`TOGETHER`]. Impacts are not looked at. Of `world` only the forms of the bodies are asked;
    /// `ahead` are contacts of the end. Cost: a pass over the contacts; a pass over `ahead` if any of them
    /// had a gap and force; a sweep along three motions for each that has a gap at the end, too.
    fn never_together(
        &self,
        world: &World,
        start: &Placement,
        contacts: &[Contact],
        attempt: &Attempt,
        ahead: &[Contact],
    ) -> Vec<(usize, f64)> {
        let Delassus::Rigid(rigid) = &*attempt.problem.delassus else { return Vec::new() };
        let resolved = MIXED_MAXIMUM * self.settings.solver.tolerance * velocity_scale(&attempt.problem);
        let reach = |contact: &Contact| TOGETHER * self.collider.contact_size(world, contact);
        let mut pressing: Vec<(usize, f64)> = Vec::new();
        for (k, (&i, g)) in attempt.active.iter().zip(attempt.impulse.chunks_exact(3)).enumerate() {
            let contact = &contacts[i as usize];
            let has_gap = contact.gap > 0.0 && contact.gap > reach(contact);
            if has_gap && g[0] * rigid.diagonal()[k][0] > resolved {
                pressing.push((i as usize, g[0]));
            }
        }
        if pressing.is_empty() {
            return pressing;
        }
        let wanted: HashSet<u64> = pressing.iter().map(|(i, _)| contacts[*i].identity).collect();
        let together: HashSet<u64> = ahead
            .iter()
            .filter(|c| wanted.contains(&c.identity) && c.gap <= reach(c))
            .map(|c| c.identity)
            .collect();
        let before = start.velocities();
        let motions = [
            (before.as_slice(), start.cell.as_ref()),
            (&attempt.impacts.velocity, start.cell.as_ref()),
            (&attempt.velocity, attempt.cell.as_ref()),
        ];
        pressing.retain(|(i, _)| {
            let contact = &contacts[*i];
            let near =
                |motion| self.come_near(world, start, contact, motion, (self.settings.step, reach(contact)));
            !together.contains(&contact.identity) && !motions.into_iter().any(near)
        });
        pressing
    }

    /// Those of them, with the gaps, m, that have their planes let pass what passes, that were not seen to
    /// meet, each so often at most. Where friction is relaxed, planes that press part bodies; none is moved
    /// nearer.
    pub(super) fn passing(
        &self,
        world: &World,
        start: &Placement,
        rounds: &Rounds,
        attempt: &Attempt,
        ahead: &[Contact],
    ) -> Vec<(usize, f64)> {
        // Planes that gather are left as they are.
        if 2 * rounds.round >= self.parameters.repetition.rounds {
            return Vec::new();
        }
        let moved = |(i, _): (usize, f64)| {
            let contact = &rounds.contacts[i];
            let times = rounds.passed.get(&contact.identity).map_or(0, |passed| passed.times);
            if times >= OFTEN || rounds.times_met(contact) > 0 {
                return None;
            }
            let closed = -self.settings.step * closing(start, attempt, contact);
            let nearest = match self.nearest_of_balls(world, start, attempt, contact) {
                Some(nearest) => nearest,
                None => self.clear_by(world, start, attempt, contact),
            };
            (closed + nearest > contact.gap).then_some((i, closed + nearest))
        };
        let unmet = self.never_together(world, start, &rounds.contacts, attempt, ahead);
        unmet.into_iter().filter_map(moved).collect()
    }

    /// Contacts (places) whose planes were moved and whose bodies go through each other now: what else is
    /// solved with other planes may send them another way.
    pub(super) fn meeting(
        &self,
        world: &World,
        start: &Placement,
        rounds: &Rounds,
        attempt: &Attempt,
    ) -> Vec<usize> {
        if rounds.passed.is_empty() {
            return Vec::new();
        }
        let meets = |i: &usize| {
            let contact = &rounds.contacts[*i];
            let is_moved =
                rounds.passed.get(&contact.identity).is_some_and(|passed| passed.gap < contact.gap)
                    && !rounds.planes.has(contact.identity);
            is_moved
                && match self.nearest_of_balls(world, start, attempt, contact) {
                    Some(nearest) => nearest < -THROUGH * self.collider.contact_size(world, contact),
                    None => {
                        let motion = (&*attempt.velocity, attempt.cell.as_ref());
                        let early = EARLY * self.settings.step;
                        self.come_near(world, start, contact, motion, (early, 0.0))
                    }
                }
        };
        (0..rounds.contacts.len()).filter(meets).collect()
    }

    /// How near two balls come that move with the velocities found, m; `None` for other bodies. Of `world`
    /// only their radii are asked.
    fn nearest_of_balls(
        &self,
        world: &World,
        start: &Placement,
        attempt: &Attempt,
        contact: &Contact,
    ) -> Option<f64> {
        let [a, b] = [contact.body_a, contact.body_b].map(|body| body as usize);
        if ![a, b].into_iter().all(|body| self.collider.is_ball(world, body)) {
            return None;
        }
        let speed = |body: usize| velocity_of(&attempt.velocity, body)[0];
        let mut apart = start.position[a] - start.position[b];
        let mut approach = speed(a) - speed(b);
        if let Some(cell) = attempt.cell.as_ref().filter(|_| contact.image != [0; 3]) {
            apart -= cell.shift(contact.image);
            approach -= cell.image_velocity(contact.image);
        }
        let radii = [a, b].map(|body| self.collider.body_size(world, body));
        Some(Collider::nearest_of_balls(apart, approach, radii, self.settings.step))
    }

    /// What two bodies that were [never together](Self::never_together) keep clear of each other by with the
    /// velocities found, to within a factor of two, m.
    fn clear_by(&self, world: &World, start: &Placement, attempt: &Attempt, contact: &Contact) -> f64 {
        let motion = (&*attempt.velocity, attempt.cell.as_ref());
        let reach = |k: i32| TOGETHER * self.collider.contact_size(world, contact) * f64::from(1 << k);
        let is_clear =
            |k: &i32| !self.come_near(world, start, contact, motion, (self.settings.step, reach(*k)));
        reach((1..DOUBLED).take_while(is_clear).last().unwrap_or(0))
    }

    /// Whether the bodies of a contact come nearer than `reach`, m, within `time`, s, from where they were at
    /// the start of the step with these velocities (six numbers per body), and a cell of these rates. Of
    /// `world` only the forms of the bodies are asked.
    fn come_near(
        &self,
        world: &World,
        start: &Placement,
        contact: &Contact,
        (velocity, cell): (&[f64], Option<&Cell>),
        (time, reach): (f64, f64),
    ) -> bool {
        let pair = [contact.body_a, contact.body_b];
        let mut velocities = pair.map(|body| {
            let v = &velocity[6 * body as usize..6 * body as usize + 6];
            [Vec3::from_slice(&v[..3]), Vec3::from_slice(&v[3..])]
        });
        let mut places = pair.map(|body| (start.position[body as usize], start.orientation[body as usize]));
        if let Some(cell) = cell.filter(|_| contact.image != [0; 3]) {
            places[1].0 += cell.shift(contact.image);
            velocities[1][0] += cell.image_velocity(contact.image);
        }
        self.collider.come_within(world, pair, places, velocities, time, reach)
    }
}

/// u_n of a contact with the velocities found, of its points at the start of the step, m/s.
pub(super) fn closing(start: &Placement, attempt: &Attempt, contact: &Contact) -> f64 {
    let speed = |body: u32, point: Vec3| {
        let [velocity, spin] = velocity_of(&attempt.velocity, body as usize);
        velocity + spin.cross(point - start.position[body as usize])
    };
    let [(_, on_a), (_, on_b)] = cell::ends(start.cell.as_ref(), contact);
    let mut relative = speed(contact.body_a, on_a) - speed(contact.body_b, on_b);
    if contact.image != [0; 3] {
        relative -= cell::image_velocity(attempt.cell.as_ref(), contact);
    }
    contact.normal.dot(relative)
}
