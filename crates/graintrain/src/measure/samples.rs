//! Small worlds of known forces for the tests of measurements.

use crate::contact::Contact;
use crate::handle::MaterialId;
use crate::math::{Quat, Vec3};
use crate::motion::Motion;
use crate::shape::Geometry;
use crate::stepper::{SolverChoice, StepSettings, Stepper};
use crate::world::{Body, World};

/// A chain of balls of radius 0.5 m along x between two plates, with the force (N) along it in every contact,
/// and the step.
pub(crate) fn chain(balls: usize, force: f64) -> (World, f64) {
    let step = 0.01;
    let mut world = World { gravity: Vec3::ZERO, ..World::default() };
    let ball = world.add_geometry(Geometry::sphere(0.5).unwrap());
    let plane = world.add_geometry(Geometry::plane());
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    for k in 0..balls {
        let place = Vec3::new(0.5 + k as f64, 0.0, 0.0);
        world.add_body(Body::new(ball, MaterialId::default(), place)).unwrap();
    }
    for (x, normal) in [(0.0, Vec3::X), (balls as f64, Vec3::NEG_X)] {
        let orientation = Quat::from_rotation_arc(Vec3::Z, normal);
        let body = Body {
            motion: fixed,
            orientation,
            ..Body::new(plane, MaterialId::default(), Vec3::new(x, 0.0, 0.0))
        };
        world.add_body(body).unwrap();
    }
    let last = balls as u32;
    let pairs = (0..=last).map(|k| {
        if k == 0 {
            [0, last]
        } else if k == last {
            [last + 1, last - 1]
        } else {
            [k, k - 1]
        }
    });
    for (k, [a, b]) in pairs.enumerate() {
        let contact = Contact {
            body_a: a,
            body_b: b,
            identity: k as u64,
            point: Vec3::new(k as f64, 0.0, 0.0),
            normal: Vec3::X,
            gap: 0.0,
            lead: Vec3::ZERO,
            image: [0; 3],
        };
        world.contacts.contacts.push(contact);
        world.contacts.impulse.push(force * step * Vec3::X);
        world.contacts.friction.push(0.25);
    }
    (world, step)
}

/// Columns of balls of radius 0.5 m at rest on a floor, one beside the other along x with room between them,
/// after some steps.
pub(crate) fn row_of_columns(columns: usize, high: usize) -> (World, f64) {
    let step = 1e-3;
    let mut world = World::default();
    let ball = world.add_geometry(Geometry::sphere(0.5).unwrap());
    let plane = world.add_geometry(Geometry::plane());
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    for k in 0..columns * high {
        let place = Vec3::new(1.5 * (k % columns) as f64, 0.0, 0.5 + (k / columns) as f64);
        world.add_body(Body::new(ball, MaterialId::default(), place)).unwrap();
    }
    world.add_body(Body { motion: fixed, ..Body::new(plane, MaterialId::default(), Vec3::ZERO) }).unwrap();
    let mut stepper = Stepper::new(StepSettings {
        step,
        envelope: 0.01,
        solver: SolverChoice { tolerance: 1e-8, ..SolverChoice::default() },
        ..StepSettings::default()
    })
    .unwrap();
    for _ in 0..3 {
        stepper.step(&mut world).unwrap();
    }
    (world, step)
}
