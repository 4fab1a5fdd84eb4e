//! Which bodies fly: nothing touches them in the step.

use super::attempt::Attempt;
use crate::contact::Contact;
use crate::math::Vec3;
use crate::world::World;

/// Whether nothing acts on a body in the step but gravity: contacts exert no impulse in the contact problem
/// (impacts come before it), no joint holds it, nothing is prescribed, there is no force (one that depends on
/// the place needs x + dt u+, which is symplectic) and no drag, and no periodic cell takes it along.
pub(super) fn flying(world: &World, contacts: &[Contact], attempt: &Attempt) -> Vec<bool> {
    if world.cell().is_some() {
        return vec![false; world.bodies.len()];
    }
    let bodies = &world.bodies;
    let is_loaded = |body: usize| {
        let is_dragged = world.drag.get(body).is_some_and(|drag| drag.linear > 0.0 || drag.angular > 0.0);
        is_dragged || bodies.force[body] != Vec3::ZERO || bodies.torque[body] != Vec3::ZERO
    };
    let mut flies: Vec<bool> =
        (0..bodies.len()).map(|body| world.is_free(body) && !is_loaded(body)).collect();
    for placed in world.joints() {
        for body in placed.joint.bodies.iter().flatten() {
            flies[body.index()] = false;
        }
    }
    let mut touch = |contact: &Contact| {
        (flies[contact.body_a as usize], flies[contact.body_b as usize]) = (false, false);
    };
    for (&i, g) in attempt.active.iter().zip(attempt.impulse.chunks_exact(3)) {
        if g[0] != 0.0 {
            touch(&contacts[i as usize]);
        }
    }
    for (contact, &pull) in contacts.iter().zip(&attempt.pulls) {
        if pull != 0.0 {
            touch(contact);
        }
    }
    flies
}
