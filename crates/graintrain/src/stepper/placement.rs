//! Where bodies are and how they move: what a step changes of them and puts back when it is made again.

use crate::cell::Cell;
use crate::integrate::{driven_velocity, velocities};
use crate::math::{Quat, Vec3};
use crate::world::World;

/// Where bodies are and how they move: what a step changes of them.
pub(super) struct Placement {
    pub(super) position: Vec<Vec3>,
    pub(super) orientation: Vec<Quat>,
    pub(super) velocity: Vec<Vec3>,
    pub(super) angular_velocity: Vec<Vec3>,
    pub(super) cell: Option<Cell>,
    /// In the frame of the world, J.
    pub(super) kinetic_energy: f64,
}

impl Placement {
    pub(super) fn of(world: &World) -> Self {
        let bodies = &world.bodies;
        Self {
            position: bodies.position.clone(),
            orientation: bodies.orientation.clone(),
            velocity: bodies.velocity.clone(),
            angular_velocity: bodies.angular_velocity.clone(),
            cell: world.cell().cloned(),
            kinetic_energy: world.kinetic_energy() + taken_along(world, &velocities(world)),
        }
    }

    /// The velocities, six numbers per body.
    pub(super) fn velocities(&self) -> Vec<f64> {
        let pairs = self.velocity.iter().zip(&self.angular_velocity);
        pairs.flat_map(|(u, w)| [u.x, u.y, u.z, w.x, w.y, w.z]).collect()
    }

    /// Puts the bodies of the world here and returns where they were.
    pub(super) fn exchange(&self, world: &mut World) -> Self {
        let before = Self::of(world);
        let bodies = &mut world.bodies;
        bodies.position.copy_from_slice(&self.position);
        bodies.orientation.copy_from_slice(&self.orientation);
        bodies.velocity.copy_from_slice(&self.velocity);
        bodies.angular_velocity.copy_from_slice(&self.angular_velocity);
        world.cell.clone_from(&self.cell);
        before
    }
}

/// Velocities of the bodies that are driven: what they meet in a step depends on how they move in it, not on
/// how they moved before.
pub(super) struct Driven(Vec<(usize, [Vec3; 2])>);

impl Driven {
    /// In a step from `time` on.
    pub(super) fn of(world: &World, time: f64, step: f64) -> Self {
        let driven = (0..world.bodies.len()).filter(|&body| !world.is_free(body));
        Self(driven.map(|body| (body, driven_velocity(world, body, time, step))).collect())
    }

    /// Puts them in the place of those that the bodies have, which are kept here.
    pub(super) fn exchange(&mut self, world: &mut World) {
        let bodies = &mut world.bodies;
        for (body, [velocity, spin]) in &mut self.0 {
            std::mem::swap(velocity, &mut bodies.velocity[*body]);
            std::mem::swap(spin, &mut bodies.angular_velocity[*body]);
        }
    }
}

/// Where bodies were and how they went when they were last looked at.
#[derive(Default)]
pub(super) struct Seen(Option<Placement>);

impl Seen {
    pub(super) fn of(placement: Placement) -> Self {
        Self(Some(placement))
    }

    pub(super) fn is_some(&self) -> bool {
        self.0.is_some()
    }

    /// Which bodies are, within the step, elsewhere than seen by more than `far`, m: those are seen now. All
    /// where none were seen, or in a periodic cell, whose rates carry all of them along. A turn moves a body
    /// by its `radius`.
    pub(super) fn stirred(
        &mut self,
        world: &World,
        step: f64,
        far: f64,
        radius: impl Fn(usize) -> f64,
    ) -> Vec<bool> {
        let bodies = &world.bodies;
        let Some(seen) = self.0.as_mut().filter(|_| world.cell().is_none()) else {
            *self = Self::of(Placement::of(world));
            return vec![true; bodies.len()];
        };
        let is_stirred = |body: usize| {
            let (place, velocity) = (bodies.position[body], bodies.velocity[body]);
            let (orientation, spin) = (bodies.orientation[body], bodies.angular_velocity[body]);
            let way =
                (place - seen.position[body]).length() + step * (velocity - seen.velocity[body]).length();
            let [same, opposite] = [1.0, -1.0].map(|s| (orientation * s - seen.orientation[body]).length());
            let turn = 2.0 * same.min(opposite) + step * (spin - seen.angular_velocity[body]).length();
            let is_stirred = way > far || (turn > 0.0 && way + turn * radius(body) > far);
            if is_stirred {
                (seen.position[body], seen.velocity[body]) = (place, velocity);
                (seen.orientation[body], seen.angular_velocity[body]) = (orientation, spin);
            }
            is_stirred
        };
        (0..bodies.len()).map(is_stirred).collect()
    }
}

/// Kinetic energy of these velocities (six numbers per body) beyond that of the world, in which a periodic
/// cell takes bodies along, J.
pub(super) fn taken_along(world: &World, velocity: &[f64]) -> f64 {
    if world.cell().is_none() {
        return 0.0;
    }
    let beyond = |(body, v): (usize, &[f64])| {
        let speeds = Vec3::from_slice(&v[..3]).length_squared() - world.fluctuation(body).length_squared();
        0.5 * world.bodies.mass[body] * speeds
    };
    let moving = velocity.chunks_exact(6).enumerate().filter(|(body, _)| !world.is_prescribed(*body));
    moving.map(beyond).sum()
}
