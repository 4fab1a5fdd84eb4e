//! How joints turn bodies aside within a step: where they are on its way, not only at its end.
//!
//! A step moves a body in joints by dt u+ to where they hold it, so that its velocities are those of the
//! chords of its path, and from one step to the next they change by c = dt a. On the way of a step it is at
//!
//! ```text
//! x(t) = x + t (u+ - (1 - t / dt) c / 2),      0 <= t <= dt
//! ```
//!
//! to third order in dt: the parabola through both ends with the acceleration a.

use crate::assemble::velocity_of;
use crate::math::Vec3;
use crate::world::World;

/// c of every body, m/s: `free`, the velocities of the step without contacts (six numbers per body), less
/// those before it; zero for bodies in no joint, and empty where there are no joints.
pub(super) fn bends(world: &World, free: &[f64]) -> Vec<Vec3> {
    if world.joints().is_empty() {
        return Vec::new();
    }
    let change = |body: usize| velocity_of(free, body)[0] - world.bodies.velocity[body];
    let is_jointed = jointed(world).into_iter().enumerate();
    is_jointed.map(|(body, is_jointed)| if is_jointed { change(body) } else { Vec3::ZERO }).collect()
}

/// Which bodies are in joints.
pub(super) fn jointed(world: &World) -> Vec<bool> {
    let mut is_jointed = vec![false; world.bodies.len()];
    for body in world.joints().iter().flat_map(|placed| placed.joint.bodies.iter().flatten()) {
        is_jointed[body.index()] = true;
    }
    is_jointed
}
