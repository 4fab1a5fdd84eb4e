//! How bodies go through a step.

use super::attempt::Attempt;
use crate::assemble::relative_velocities;
use crate::contact::Contact;
use crate::impact::{Flight, carried};
use crate::integrate::{Course, with_driven};
use crate::load;
use crate::world::World;
use graintrain_ccp::RigidContact;

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

/// Gaps of contacts whose bodies do not touch in the step though they end it fast enough to have closed:
/// what flies has fallen by half of what its velocity says then. With them Phi + dt u_n is 0 where nothing
/// else acts. None for bodies that meet something in the step, or that a contact carried in the last one.
/// Nor where they end nearer than `near`, m: there they land.
/// `before` and `free` are the velocities after the impacts and after the step if no contact acted, six
/// numbers per body.
pub(super) fn unreached(
    world: &World,
    (contacts, rows): (&[Contact], &[RigidContact]),
    [before, free]: [&[f64]; 2],
    step: f64,
    near: impl Fn(&Contact) -> f64,
) -> Vec<(usize, f64)> {
    let before = with_driven(world, before, step);
    let flight = Flight::of(world, [&before, free], step);
    let carried = carried(world);
    let of = |velocity: &[f64]| relative_velocities(world.cell(), contacts, rows, velocity);
    let (end, mean) = (of(&flight.end), of(&flight.mean));
    let mut meets = vec![false; carried.len()];
    for (contact, mean) in contacts.iter().zip(mean.chunks_exact(3)) {
        if contact.gap + step * mean[0] <= 0.0 {
            contact.unordered().into_iter().for_each(|body| meets[body as usize] = true);
        }
    }
    let is_settled = |body: usize| carried[body] || world.is_prescribed(body);
    let is_unreached = |&(i, gap): &(usize, f64)| {
        let contact = &contacts[i];
        let mut pair = contact.unordered().into_iter().map(|body| body as usize);
        gap > contact.gap
            && contact.gap + step * mean[3 * i] > near(contact)
            && flight.has(contact)
            && pair.all(|body| is_settled(body) || !meets[body])
    };
    (0..contacts.len()).map(|i| (i, -step * end[3 * i])).filter(is_unreached).collect()
}
