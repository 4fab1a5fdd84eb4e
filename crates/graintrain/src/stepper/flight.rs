//! How bodies go through a step.

use super::attempt::Attempt;
use crate::assemble::{of_each, relative_velocities};
use crate::collide::Collider;
use crate::contact::Contact;
use crate::impact::{Flight, LAST, carried};
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

/// Gaps of contacts whose bodies do not touch in the step though they end it fast enough to have closed: what
/// flies has fallen by half of what its velocity says then. With them Phi + dt u_n is the gap at the end
/// where nothing else acts. None for bodies that meet something in the step, or that a contact carried in the
/// last one. Nor of what does not spring back (`springs`): it lands. `before` and `free` are the velocities
/// after the impacts and after the step if no contact acted, six numbers per body.
pub(super) fn unreached(
    world: &World,
    (contacts, rows): (&[Contact], &[RigidContact]),
    seen: (&Collider, f64),
    [before, free]: [&[f64]; 2],
    step: f64,
    springs: impl Fn(&Contact) -> bool,
) -> Vec<(usize, f64)> {
    let (carried, flies) = (carried(world), load::flies(world, step));
    let is_settled = |body: usize| carried[body] || world.is_prescribed(body);
    let both = |contact: &Contact| contact.unordered().map(|body| body as usize);
    // In a pile that rests all are settled.
    let of: Vec<u32> = (0..contacts.len() as u32)
        .filter(|&i| !both(&contacts[i as usize]).into_iter().all(is_settled))
        .collect();
    if !of.iter().any(|&i| springs(&contacts[i as usize])) || !flies.contains(&true) {
        return Vec::new();
    }
    let before = with_driven(world, before, step);
    let flight = Flight::of(world, &carried, seen, [&before, free], step);
    let own = of_each(&of, |&i| contacts[i as usize]);
    let own_rows = of_each(&of, |&i| rows[i as usize]);
    let normal = |velocity: &[f64]| {
        let u = relative_velocities(world.cell(), &own, &own_rows, velocity);
        u.into_iter().step_by(3).collect::<Vec<f64>>()
    };
    let (end, mean) = (normal(&flight.end), normal(&flight.mean));
    let mut meets = vec![false; carried.len()];
    for (contact, mean) in own.iter().zip(&mean) {
        if contact.gap + (1.0 - LAST) * step * mean <= 0.0 {
            both(contact).into_iter().for_each(|body| meets[body] = true);
        }
    }
    let is_unreached = |&k: &usize| {
        let contact = &own[k];
        -step * end[k] > contact.gap
            && contact.gap + (1.0 - LAST) * step * mean[k] > 0.0
            && flight.has(contact)
            && springs(contact)
            && both(contact).into_iter().all(|body| is_settled(body) || !meets[body])
    };
    let gap = |k: usize| own[k].gap + step * (mean[k] - end[k]);
    (0..of.len()).filter(is_unreached).map(|k| (of[k] as usize, gap(k))).collect()
}
