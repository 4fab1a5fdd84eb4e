//! Contacts that exert force though their bodies were never together.
//!
//! A step asks for `g_n >= 0`, `Phi + dt u_n >= 0` and that one of both vanishes, with the gap linearised where the bodies were. What is meant is the motion: `g_n > 0` only
//! where the bodies touch at some time of the step. Whether they did is looked at afterwards, along the motions that the step is made of: with the velocities before it, those after
//! the impacts, and those of its end.

use super::Stepper;
use super::attempt::Attempt;
use super::placement::Placement;
use crate::collide::sweep::comes_within;
use crate::contact::Contact;
use crate::math::Vec3;
use crate::world::World;
use graintrain_ccp::Delassus;
use graintrain_ccp::residual::{MIXED_MAXIMUM, velocity_scale};
use std::collections::HashMap;

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
    /// Contacts whose impulse changes velocities by more than the solve resolves and whose bodies were nowhere on their way nearer to each other than [`TOGETHER`].
    /// `world` is at the end of the step, `ahead` are its contacts there. Cost: nothing but a pass over the contacts where all that press touch at the start or at the end.
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
        let mut impulse: Vec<(u32, f64)> = Vec::new();
        for (k, (&i, g)) in attempt.active.iter().zip(attempt.impulse.chunks_exact(3)).enumerate() {
            if contacts[i as usize].gap > 0.0 && g[0] * rigid.diagonal()[k][0] > resolved {
                impulse.push((i, g[0]));
            }
        }
        let reach = |contact: &Contact| TOGETHER * self.collider.contact_size(world, contact);
        impulse.retain(|&(i, _)| contacts[i as usize].gap > reach(&contacts[i as usize]));
        if impulse.is_empty() {
            return Apart::default();
        }
        let at_end: HashMap<u64, f64> = ahead.iter().map(|c| (c.identity, c.gap)).collect();
        let before = start.velocities();
        let mut found = Apart::default();
        for (i, impulse) in impulse {
            let contact = &contacts[i as usize];
            let reach = reach(contact);
            let touches_at_end = at_end.get(&contact.identity).is_some_and(|&gap| gap <= reach);
            let mut motions = [&before, &attempt.impacts.velocity, &attempt.velocity].into_iter();
            if touches_at_end
                || motions.any(|velocity| self.come_near(world, start, contact, velocity, reach))
            {
                continue;
            }
            found.count += 1;
            found.impulse_max = found.impulse_max.max(impulse);
        }
        found
    }

    /// Whether the bodies of a contact come nearer than `reach`, m, from where they were at the start of the step with these velocities (six numbers per body).
    fn come_near(
        &self,
        world: &World,
        start: &Placement,
        contact: &Contact,
        velocity: &[f64],
        reach: f64,
    ) -> bool {
        let own = |body: u32| {
            let v = &velocity[6 * body as usize..6 * body as usize + 6];
            [Vec3::from_slice(&v[..3]), Vec3::from_slice(&v[3..])]
        };
        let [a, mut b] = [contact.body_a, contact.body_b].map(|body| {
            let mut placed = self.collider.placed(world, body as usize);
            placed.position = start.position[body as usize];
            placed.orientation = start.orientation[body as usize];
            (placed, own(body))
        });
        if let Some(cell) = start.cell.as_ref().filter(|_| contact.image != [0; 3]) {
            b.0.position += cell.shift(contact.image);
            b.1[0] += cell.image_velocity(contact.image);
        }
        comes_within([a.0, b.0], [a.1, b.1], self.settings.step, reach)
    }
}
