//! A wheel on a bed: what terramechanics asks of it.

use super::flow::force_on;
use super::space::bounds;
use crate::handle::BodyId;
use crate::math::Vec3;
use crate::world::World;
use std::collections::BTreeMap;

/// A wheel and the way in which it rolls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rolling {
    /// The wheel; its centre of mass is on its axis.
    pub body: BodyId,
    /// Radius with which slip and sinkage count, m.
    pub radius: f64,
    /// Unit vector along the axis: turning about it is rolling forward, along axis x up.
    pub axis: Vec3,
}

/// What a wheel does in a step. Numbers that mean nothing (the slip of a wheel that does not turn) are NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelState {
    /// 1 - v / (w R): 0 rolls, 1 spins on the spot, negative is towed.
    pub slip: f64,
    /// Depth of the lowest point of the circle of radius R below the bed's surface, m.
    pub sinkage: f64,
    /// Force by contacts forward: what is left to pull with, N.
    pub pull: f64,
    /// Force by contacts upward: what the bed carries, N.
    pub load: f64,
    /// Torque on the axis that turns it against its contacts, N m.
    pub torque: f64,
    /// Pull times speed over torque times rate: what becomes useful of the work put in.
    pub efficiency: f64,
}

/// Height along `up` (unit) of the surface of some bodies, m: the median of the tops of upright columns,
/// which are two mean extents wide, so that a rut or a body on top does not count. NaN without bodies.
pub fn surface_level(world: &World, selected: &[bool], up: Vec3) -> f64 {
    let meant: Vec<usize> = (0..world.bodies.len()).filter(|&body| selected[body]).collect();
    let boxes: Vec<[Vec3; 2]> = meant.iter().map(|&body| bounds(world, body)).collect();
    let extent = boxes.iter().map(|[low, high]| (*high - *low).max_element()).sum::<f64>();
    let width = 2.0 * extent / meant.len() as f64;
    let across = up.any_orthonormal_pair();
    let mut tops: BTreeMap<[i64; 2], f64> = BTreeMap::new();
    for (&body, [low, high]) in meant.iter().zip(&boxes) {
        let place = world.bodies.position[body];
        let column = [across.0, across.1].map(|axis| (place.dot(axis) / width).floor() as i64);
        let reach = 0.5 * (*high - *low).dot(up.abs());
        let top = tops.entry(column).or_insert(f64::NEG_INFINITY);
        *top = top.max((0.5 * (*high + *low)).dot(up) + reach);
    }
    let mut tops: Vec<f64> = tops.into_values().collect();
    tops.sort_unstable_by(f64::total_cmp);
    match tops.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => tops[n / 2],
        n => 0.5 * (tops[n / 2 - 1] + tops[n / 2]),
    }
}

/// What a wheel does on the bed of the bodies that are meant (without itself), in a world whose last step
/// took `step` s. Up is against gravity. Source: J. Y. Wong, Theory of Ground Vehicles, 4th edition (2008),
/// chapters 2 and 4.
pub fn wheel(world: &World, step: f64, rolling: &Rolling, selected: &[bool]) -> WheelState {
    let up = (-world.gravity).normalize_or(Vec3::Z);
    let forward = rolling.axis.cross(up).normalize_or_zero();
    let body = rolling.body.index();
    let place = world.bodies.position[body];
    let mut bed = selected.to_vec();
    bed[body] = false;
    // Contacts are where they were at the start of the step.
    let start = place - step * world.bodies.velocity[body];
    let (force, torque) = force_on(world, step, &[rolling.body], None, start);
    let speed = world.bodies.velocity[body].dot(forward);
    let rate = world.bodies.angular_velocity[body].dot(rolling.axis);
    let (pull, torque) = (force.dot(forward), -torque.dot(rolling.axis));
    let or_nothing = |value: f64, means: bool| if means { value } else { f64::NAN };
    WheelState {
        slip: or_nothing(1.0 - speed / (rate * rolling.radius), rate != 0.0),
        sinkage: surface_level(world, &bed, up) - (place.dot(up) - rolling.radius),
        pull,
        load: force.dot(up),
        torque,
        efficiency: or_nothing(pull * speed / (torque * rate), torque * rate != 0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::Contact;
    use crate::handle::MaterialId;
    use crate::shape::Geometry;
    use crate::world::Body;

    /// A bed of balls 0.2 m wide, its tops at 0.2 m but for a rut and a heap, under a wheel of radius 0.5 m
    /// whose axle is at 0.6 m.
    fn bed() -> (World, Rolling) {
        let mut world = World::default();
        let ball = world.add_geometry(Geometry::sphere(0.1).unwrap());
        for i in 0..400 {
            let (x, y) = (0.2 * f64::from(i % 20) - 1.9, 0.2 * f64::from(i / 20) - 1.9);
            let height = if y.abs() < 0.4 {
                -0.3
            } else if x > 1.6 {
                0.9
            } else {
                0.1
            };
            world.add_body(Body::new(ball, MaterialId::default(), Vec3::new(x, y, height))).unwrap();
        }
        let tyre = world.add_geometry(Geometry::sphere(0.5).unwrap());
        let body = world.add_body(Body::new(tyre, MaterialId::default(), Vec3::new(0.0, 0.0, 0.6))).unwrap();
        (world, Rolling { body, radius: 0.5, axis: Vec3::Y })
    }

    #[test]
    fn the_surface_is_that_beside_the_rut() {
        let (world, rolling) = bed();
        let mut grains = vec![true; world.bodies.len()];
        grains[rolling.body.index()] = false;
        assert!((surface_level(&world, &grains, Vec3::Z) - 0.2).abs() < 1e-12);
        assert!(surface_level(&world, &vec![false; world.bodies.len()], Vec3::Z).is_nan());
    }

    /// One contact under the wheel with 30 N up and 4 N forward: load, pull, and a torque of 4 N times the
    /// arm of 0.5 m.
    #[test]
    fn forces_slip_and_sinkage_of_a_known_wheel() {
        let (mut world, rolling) = bed();
        let (body, step) = (rolling.body.index(), 0.01);
        let velocity = Vec3::new(0.8, 0.3, 0.0);
        world.gravity = Vec3::new(0.0, 0.0, -9.81);
        world.contacts.contacts.push(Contact {
            body_a: body as u32,
            body_b: 0,
            identity: 0,
            // Under where the wheel was at the start of the step.
            point: Vec3::new(0.0, 0.0, 0.1) - step * velocity,
            normal: Vec3::Z,
            gap: 0.0,
            lead: Vec3::ZERO,
            image: [0; 3],
        });
        world.contacts.impulse.push(step * Vec3::new(4.0, 0.0, 30.0));
        world.contacts.friction.push(0.5);
        let all = vec![true; world.bodies.len()];
        assert!(wheel(&world, step, &rolling, &all).slip.is_nan());
        world.bodies.velocity[body] = velocity;
        world.bodies.angular_velocity[body] = 2.0 * Vec3::Y;
        let found = wheel(&world, step, &rolling, &all);
        let expected = [0.2, 0.1, 4.0, 30.0, 2.0, 4.0 * 0.8 / (2.0 * 2.0)];
        let numbers = [found.slip, found.sinkage, found.pull, found.load, found.torque, found.efficiency];
        for (number, expected) in numbers.into_iter().zip(expected) {
            assert!((number - expected).abs() < 1e-12, "{found:?}");
        }
    }
}
