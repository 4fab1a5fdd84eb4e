//! Contacts that exert force though their bodies were never together.
//!
//! A step asks for `g_n >= 0`, `Phi + dt u_n >= 0` and that one of both vanishes, with the gap linearised
//! where the bodies were. What is meant is the motion: `g_n > 0` only where the bodies touch at some time of
//! the step. Whether they did is looked at afterwards, along the motions that the step is made of: with the
//! velocities before it, those after the impacts, and those of its end.
//!
//! Planes of two balls are then moved so far away that they let pass what passed, and the step is solved
//! again:
//!
//! ```text
//! Phi' = nearest - dt u_n,     nearest = min |x + t u| - r_A - r_B  for 0 <= t <= dt     (x, u: of A relative to B)
//! ```
//!
//! where that is more than Phi. What else is solved then may send the balls onto each other after all: a
//! plane is back where it was, for good, once they go through each other on their way.

use super::Stepper;
use super::attempt::Attempt;
use super::placement::Placement;
use super::repetition::Rounds;
use crate::assemble::velocity_of;
use crate::cell::Cell;
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

/// How often the plane of two balls is moved out of their way in a step.
const OFTEN: usize = 2;

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
            let near = |motion| self.come_near(world, start, contact, motion, reach(contact));
            !together.contains(&contact.identity) && !motions.into_iter().any(near)
        });
        pressing
    }

    /// Those of them that are of two balls, with the gaps, m, that have their planes let pass what passes:
    /// what was not seen to meet, each so often at most. Where friction is relaxed, planes that press part
    /// bodies; none is moved nearer.
    pub(super) fn passing_balls(
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
        let is_ball = |body: u32| self.collider.is_ball(world, body as usize);
        let moved = |(i, _): (usize, f64)| {
            let contact = &rounds.contacts[i];
            let times = rounds.passed.get(&contact.identity).map_or(0, |passed| passed.times);
            let may_move = is_ball(contact.body_a) && is_ball(contact.body_b) && times < OFTEN;
            if !may_move || rounds.times_met(contact) > 0 {
                return None;
            }
            let [closed, nearest] = self.pass_of_balls(world, start, attempt, contact);
            (closed + nearest > contact.gap).then_some((i, closed + nearest))
        };
        let unmet = self.never_together(world, start, &rounds.contacts, attempt, ahead);
        unmet.into_iter().filter_map(moved).collect()
    }

    /// Contacts (places) whose planes were moved and whose balls go through each other now: what else is
    /// solved with other planes may send them another way.
    pub(super) fn meeting_balls(
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
                && self.pass_of_balls(world, start, attempt, contact)[1]
                    < -THROUGH * self.collider.contact_size(world, contact)
        };
        (0..rounds.contacts.len()).filter(meets).collect()
    }

    /// How far two balls that move with the velocities found close along the normal of their contact, and how
    /// near they come, m. Of `world` only their radii are asked.
    fn pass_of_balls(
        &self,
        world: &World,
        start: &Placement,
        attempt: &Attempt,
        contact: &Contact,
    ) -> [f64; 2] {
        let step = self.settings.step;
        let [a, b] = [contact.body_a, contact.body_b].map(|body| body as usize);
        let speed = |body: usize| velocity_of(&attempt.velocity, body)[0];
        let mut apart = start.position[a] - start.position[b];
        let mut approach = speed(a) - speed(b);
        if let Some(cell) = attempt.cell.as_ref().filter(|_| contact.image != [0; 3]) {
            apart -= cell.shift(contact.image);
            approach -= cell.image_velocity(contact.image);
        }
        let radii = [a, b].map(|body| self.collider.body_size(world, body));
        let nearest = Collider::nearest_of_balls(apart, approach, radii, step);
        [-step * contact.normal.dot(approach), nearest]
    }

    /// Whether the bodies of a contact come nearer than `reach`, m, from where they were at the start of the
    /// step with these velocities (six numbers per body), and a cell of these rates. Of `world` only the
    /// forms of the bodies are asked.
    fn come_near(
        &self,
        world: &World,
        start: &Placement,
        contact: &Contact,
        (velocity, cell): (&[f64], Option<&Cell>),
        reach: f64,
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
        self.collider.come_within(world, pair, places, velocities, self.settings.step, reach)
    }
}
