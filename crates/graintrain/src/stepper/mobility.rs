//! Contacts along whose normal nothing can move.
//!
//! A wheel on a hinge that just touches a wall turns freely: the wall meets it where joints hold it. To
//! rounding, though, the normal n does not go through the axis but passes it at a distance of some 1e-8 of
//! the radius, and an exact solution of the contact stops the wheel with a force that no bearing stands. What
//! has no mobility to rounding neither approaches nor can be pushed away, so that its force is undetermined:
//! it is taken to be zero. What holds the bodies may let go within the step, as stops and motors do that can
//! do no more: contacts at which they then approach return to the problem ([`super::Stepper::closed`]).

use crate::math::Vec3;
use crate::world::World;
use graintrain_ccp::{Ccp, Delassus, RigidContact};
use graintrain_linalg::real;

/// Normals that pass the axis of a lever by less than about this share of its length have no lever: forces at
/// them would be the inverse times those along it.
const LEVER: f64 = 1e-6;

/// Approach along the normal, over the speed along the tangents, that is rounding of the normal.
const ROUNDING: f64 = 1e-5;

/// Approach in a step, over the arm of a contact, that is rounding.
const TOUCH: f64 = 1e-9;

/// Contacts (indices, ascending) whose N_nn is below [`LEVER`]^2 of that of the bodies without joints and
/// constraints, and that do not approach.
pub(super) fn immobile(world: &World, problem: &Ccp, step: f64) -> Vec<usize> {
    let Delassus::Rigid(rigid) = &*problem.delassus else { return Vec::new() };
    let is_bound =
        |body: usize| !world.is_prescribed(body) && world.free_degrees(body).iter().any(|free| !free);
    if rigid.coupled().is_empty() && !(0..world.bodies.len()).any(is_bound) {
        return Vec::new();
    }
    // Prescribed bodies are none to the rows of contacts.
    let alone = |body: u32| world.bodies.mass.get(body as usize).map_or(0.0, |mass| 1.0 / mass);
    let holds = |(k, own): (usize, &RigidContact)| {
        let mobility = rigid.diagonal()[k][0];
        if mobility > LEVER * LEVER * (alone(own.body_a) + alone(own.body_b)) {
            return None;
        }
        (!approaches(own, &problem.r[3 * k..3 * k + 3], step)).then_some(k)
    };
    rigid.contacts().iter().enumerate().filter_map(holds).collect()
}

/// Whether bodies approach at a contact by more than rounding, with Phi / dt + u_n and u_t.
pub(super) fn approaches(row: &RigidContact, r: &[f64], step: f64) -> bool {
    let arm = Vec3::from_array(row.arm_a).length().max(Vec3::from_array(row.arm_b).length());
    r[0] < -(ROUNDING * real::hypot(r[1], r[2]) + TOUCH * arm / step)
}
