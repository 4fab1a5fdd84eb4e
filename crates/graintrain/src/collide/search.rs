//! Which touches of two bodies count: those within the envelope, and those that may close within the step.

use super::reduce::Touch;
use crate::math::Vec3;
use crate::world::World;

/// How far contacts are looked for.
#[derive(Clone, Copy)]
pub(super) struct Search {
    pub(super) envelope: f64,
    pub(super) step: f64,
    /// The largest acceleration of any body times step^2, m: pairs further apart are not looked at.
    pub(super) fall: f64,
    /// Balls that do not meet within the step are left out.
    pub(super) meeting: bool,
}

impl Search {
    /// For all contacts.
    pub(super) fn all(world: &World, envelope: f64, step: f64) -> Self {
        Self { envelope, step, fall: world.largest_acceleration() * step * step, meeting: false }
    }

    /// How near pairs have to come to be looked at, m.
    pub(super) fn margin(&self) -> f64 {
        self.envelope.max(self.fall)
    }

    /// Whether a touch lies within the envelope or may close within the step.
    pub(super) fn closes(&self, world: &World, pair: [u32; 2], largest: f64, touch: &Touch) -> bool {
        if touch.gap <= self.envelope {
            return true;
        }
        let away = surface_speeds(world, pair, touch);
        let approach = self.step * (away[1] - away[0]);
        let fall = self.fall_of(world, pair);
        self.reaches(touch, fall, approach) || self.closes_at_rest(world, pair, fall, largest, touch, away)
    }

    /// Largest acceleration of either body times step^2, m.
    pub(super) fn fall_of(&self, world: &World, pair: [u32; 2]) -> f64 {
        let [a, b] = pair.map(|body| world.acceleration(body as usize));
        a.max(b) * self.step * self.step
    }

    /// Whether a touch may close within the step if one of both bodies came to rest, unless it is held;
    /// `away` as [`surface_speeds`].
    pub(super) fn closes_at_rest(
        &self,
        world: &World,
        pair: [u32; 2],
        fall: f64,
        largest: f64,
        touch: &Touch,
        [away_a, away_b]: [f64; 2],
    ) -> bool {
        let [held_a, held_b] = pair.map(|body| world.is_prescribed(body as usize));
        let stops = |parting: f64, held: bool| if held { parting } else { 0.0 };
        let rest = (-away_a + stops(away_b, held_b)).max(away_b - stops(away_a, held_a));
        self.reaches(touch, fall, (self.step * rest).min(largest))
    }

    fn reaches(&self, touch: &Touch, fall: f64, approach: f64) -> bool {
        touch.gap <= self.envelope + approach || touch.gap <= fall + approach
    }
}

/// Velocities of the surfaces of A and B at a touch along its normal, m/s. What is round about an axis turns
/// about it in itself: its points move, its surface does not.
pub(super) fn surface_speeds(world: &World, pair: [u32; 2], touch: &Touch) -> [f64; 2] {
    let [a, b] = world.pair_velocities(pair);
    [(pair[0], a), (pair[1], b)].map(|(body, [velocity, spin])| {
        let body = body as usize;
        let axis = world.geometries[world.bodies.geometry[body].index()].axis_of_revolution();
        let own = axis.map_or(Vec3::ZERO, |axis| spin.project_onto(world.bodies.orientation[body] * axis));
        touch.normal.dot(velocity + (spin - own).cross(world.way_to(body, touch.point)))
    })
}
