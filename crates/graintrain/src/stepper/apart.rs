//! Contacts that exert force though their bodies were never together.
//!
//! A step asks for `g_n >= 0`, `Phi + dt u_n >= 0` and that one of both vanishes, with the gap linearised
//! where the bodies were. What is meant is the motion: `g_n > 0` only where the bodies touch at some time of
//! the step. Whether they did is looked at afterwards, along the motions that the step is made of: with the
//! velocities before it, those after the impacts, and those of its end.

use super::Stepper;
use super::attempt::Attempt;
use super::placement::Placement;
use crate::cell::Cell;
use crate::contact::Contact;
use crate::math::Vec3;
use crate::world::World;
use graintrain_ccp::Delassus;
use graintrain_ccp::residual::{MIXED_MAXIMUM, velocity_scale};
use std::collections::HashSet;

/// Bodies nearer than this fraction of the smaller one's size count as together.
const TOGETHER: f64 = 0.05;

/// What [`Stepper::apart`] finds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Apart {
    /// Contacts with force whose bodies were never together in the step.
    pub count: usize,
    /// The largest of their impulses, N s.
    pub impulse_max: f64,
}

impl Stepper {
    /// Contacts whose impulse in the contact problem changes velocities by more than the solve resolves and
    /// whose bodies were nowhere on their way nearer to each other than [`TOGETHER`]. Impacts are not looked
    /// at. `world` is at the end of the step, `ahead` are its contacts there. Cost: a pass over the contacts;
    /// a pass over `ahead` if any of them had a gap and force; a sweep along three motions for each that has
    /// a gap at the end, too.
    pub(super) fn apart(
        &self,
        world: &World,
        start: &Placement,
        contacts: &[Contact],
        attempt: &Attempt,
        ahead: &[Contact],
    ) -> Apart {
        let Delassus::Rigid(rigid) = &*attempt.problem.delassus else { return Apart::default() };
        let resolved = MIXED_MAXIMUM * self.settings.solver.tolerance * velocity_scale(&attempt.problem);
        let reach = |contact: &Contact| TOGETHER * self.collider.contact_size(world, contact);
        let mut pressing: Vec<(&Contact, f64)> = Vec::new();
        for (k, (&i, g)) in attempt.active.iter().zip(attempt.impulse.chunks_exact(3)).enumerate() {
            let contact = &contacts[i as usize];
            let has_gap = contact.gap > 0.0 && contact.gap > reach(contact);
            if has_gap && g[0] * rigid.diagonal()[k][0] > resolved {
                pressing.push((contact, g[0]));
            }
        }
        if pressing.is_empty() {
            return Apart::default();
        }
        let wanted: HashSet<u64> = pressing.iter().map(|(contact, _)| contact.identity).collect();
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
        let mut found = Apart::default();
        for (contact, impulse) in pressing.into_iter().filter(|(c, _)| !together.contains(&c.identity)) {
            let near = |motion| self.come_near(world, start, contact, motion, reach(contact));
            if !motions.into_iter().any(near) {
                found.count += 1;
                found.impulse_max = found.impulse_max.max(impulse);
            }
        }
        found
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
