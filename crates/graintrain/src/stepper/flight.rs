//! How bodies go through a step.

use super::attempt::Attempt;
use crate::cell::Cell;
use crate::contact::Contact;
use crate::integrate::Course;
use crate::load;
use crate::world::World;

/// The course of every body. One flies where nothing acts on it in the step but gravity and forces that
/// depend on time alone: contacts exert no impulse in the contact problem (impacts come before it), no joint
/// holds it, nothing is prescribed, no other force ([`load::pushed`]; one that depends on the place needs
/// `x + dt u+`, which is symplectic), and no periodic cell that deforms takes it along. With these it is
/// pushed.
pub(super) fn courses(world: &World, contacts: &[Contact], attempt: &Attempt, step: f64) -> Vec<Course> {
    let pushed = load::pushed(world, step);
    let deforms = world.cell().is_some_and(Cell::deforms);
    let course =
        |body: usize| match (world.is_free(body), deforms || pushed.get(body).copied().unwrap_or(false)) {
            (false, _) => Course::Held,
            (true, false) => Course::Flies,
            (true, true) => Course::Pushed,
        };
    let mut courses: Vec<Course> = (0..world.bodies.len()).map(course).collect();
    let mut touch = |contact: &Contact| {
        for body in [contact.body_a, contact.body_b] {
            courses[body as usize] = Course::Touched;
        }
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
    for body in world.joints().iter().flat_map(|placed| placed.joint.bodies.iter().flatten()) {
        courses[body.index()] = Course::Held;
    }
    courses
}
