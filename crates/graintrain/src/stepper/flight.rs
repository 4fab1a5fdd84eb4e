//! How bodies go through a step.

use super::attempt::Attempt;
use crate::contact::Contact;
use crate::integrate::Course;
use crate::load;
use crate::world::World;

/// The course of every body. One flies ([`load::flies`]) where contacts exert no impulse in the contact
/// problem either (impacts come before it). What another force pushes goes `x + dt u+`, which is symplectic
/// where the force depends on the place.
pub(super) fn courses(world: &World, contacts: &[Contact], attempt: &Attempt, step: f64) -> Vec<Course> {
    let flies = load::flies(world, step);
    let course = |body: usize| match (flies[body], world.is_free(body)) {
        (true, _) => Course::Flies,
        (false, true) => Course::Pushed,
        (false, false) => Course::Held,
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
