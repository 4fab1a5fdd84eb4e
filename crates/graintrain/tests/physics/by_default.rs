//! What a newcomer meets: settings as they are by default, so Coulomb's law.

use crate::support::*;
use graintrain::handle::MaterialId;
use graintrain::joint::{Joint, Motor};
use graintrain::math::{Quat, Vec3};
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::world::Body;
use std::f64::consts::PI;

/// A box at 2 m/s on a plane slides v^2 / (2 mu g) and never leaves it. (Relaxed friction lifts it by 16 mm.)
#[test]
fn a_box_slides_and_does_not_hop() {
    let mut world = world(0.3, 0.0);
    add_ground(&mut world, 0.0);
    let form = world.add_geometry(Geometry::cuboid(Vec3::new(0.1, 0.1, 0.05)).unwrap());
    let block = world.add_body(Body::new(form, MaterialId::default(), 0.05 * Vec3::Z)).unwrap().index();
    world.bodies.velocity[block] = 2.0 * Vec3::X;
    let mut stepper = default_stepper(1e-3);
    for _ in 0..1000 {
        let report = solved_step(&mut stepper, &mut world);
        assert!(report.contacts >= 4);
        assert_close(world.bodies.position[block].z, 0.05, 1e-7, "height");
    }
    // The scheme is of first order: half a step of the speed is missing.
    assert_close(world.bodies.position[block].x, 4.0 / (2.0 * 0.3 * G), 1.1e-3, "way");
    assert!(world.bodies.velocity[block].length() < 1e-6);
}

/// A sphere of 2.7 m/s that arrives 80 degrees off the normal leaves with e times its normal velocity.
#[test]
fn a_sphere_bounces_obliquely_with_its_restitution() {
    let (speed, restitution) = (2.7, 0.9);
    for step in [1e-3, 5e-3] {
        let mut world = world(0.3, restitution);
        world.gravity = Vec3::ZERO;
        add_ground(&mut world, 0.0);
        let angle = 80_f64.to_radians();
        let ball = add_sphere(&mut world, 0.05, Vec3::new(0.0, 0.0, 0.0537));
        world.bodies.velocity[ball] = speed * Vec3::new(angle.sin(), 0.0, -angle.cos());
        let mut stepper = default_stepper(step);
        run(&mut stepper, &mut world, 60);
        let up = world.bodies.velocity[ball].z;
        assert_close(up, restitution * speed * angle.cos(), 1e-9, "velocity after the bounce");
    }
}

/// A bed whose floor starts to move at once at 1 m/s keeps its weight on it. (Relaxed friction throws the bed
/// up: 26 times the weight, then a twentieth.)
#[test]
fn a_bed_on_a_floor_that_starts_keeps_its_weight() {
    let mut world = world(0.5, 0.0);
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    let profile = Profile::Delayed { start: 0.5, profile: Box::new(Profile::Constant(1.0)) };
    let moving = world.add_motion(Motion::translating(Vec3::Y, profile)).unwrap();
    let plane = world.add_geometry(Geometry::plane());
    let stuff = MaterialId::default();
    let floor = world.add_body(Body { motion: moving, ..Body::new(plane, stuff, Vec3::ZERO) }).unwrap();
    for normal in [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y] {
        let orientation = Quat::from_rotation_arc(Vec3::Z, normal);
        let wall = Body::new(plane, stuff, -0.055 * normal);
        world.add_body(Body { motion: fixed, orientation, ..wall }).unwrap();
    }
    for k in 0..250_u32 {
        let place = Vec3::from([k % 5, k / 5 % 5, k / 25].map(f64::from));
        let jitter = 4e-4 * Vec3::new(f64::from(k * 7 % 5), f64::from(k * 3 % 7), 0.0);
        add_sphere(&mut world, 0.009, 0.0205 * (place - Vec3::new(2.0, 2.0, -0.5)) + jitter);
    }
    let weight = G * world.bodies.mass[5..].iter().sum::<f64>();
    let mut stepper = default_stepper(1e-3);
    for step in 0..520 {
        let report = stepper.step(&mut world).unwrap();
        let carried = report.wrenches.iter().find(|wrench| wrench.body == floor).unwrap().force.z;
        if step >= 500 {
            let share = -carried / weight;
            // Walls carry a part, and what is dragged against them presses the more.
            assert!((0.15..8.0).contains(&share), "step {step}: {share} of the weight");
        }
    }
}

/// Two light jaws on slides press a box with 1.3 times the force that holds it up. Coulomb's law also lets it
/// go, by one edge of a face after the other: what can be at rest stays at rest.
#[test]
fn jaws_hold_what_they_can_hold() {
    for (step, cylinder) in [(1e-3, false), (5e-3, false), (1e-2, false), (5e-3, true)] {
        let mut world = world(0.4, 0.0);
        let half = 0.05;
        let load = if cylinder {
            Geometry::cylinder(2.0 * half, half).unwrap()
        } else {
            Geometry::cuboid(Vec3::splat(half)).unwrap()
        };
        let load = world.add_geometry(load);
        let orientation = if cylinder { Quat::from_rotation_y(0.5 * PI) } else { Quat::IDENTITY };
        let load = Body { orientation, ..Body::new(load, MaterialId::default(), Vec3::ZERO) };
        let load = world.add_body(load).unwrap().index();
        let weight = G * world.bodies.mass[load];
        let jaw = world.add_geometry(Geometry::cuboid(Vec3::new(0.01, 0.05, 0.03)).unwrap());
        for side in [-1.0, 1.0] {
            let place = side * (half + 0.01) * Vec3::X;
            let jaw = world.add_body(Body::new(jaw, MaterialId::default(), place)).unwrap();
            let mass = &mut world.bodies.mass[jaw.index()];
            world.bodies.inertia[jaw.index()] *= 0.05 * weight / G / *mass;
            *mass = 0.05 * weight / G;
            let press = Motor::Force(Profile::Constant(1.3 * weight / (2.0 * 0.4)));
            let slide = Joint::prismatic(None, jaw, place, -side * Vec3::X).with_motor(press);
            world.add_joint(slide).unwrap();
        }
        let mut stepper = default_stepper(step);
        for _ in 0..60 {
            solved_step(&mut stepper, &mut world);
        }
        let (at, w) = (world.bodies.position[load], world.bodies.angular_velocity[load]);
        assert!(at.length() < 1e-8 && w.length() < 1e-6, "{step} {cylinder}: {at} {w}");
    }
}
