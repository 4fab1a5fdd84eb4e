//! What is deflected within a step meets what is in its new way, with default settings.

use crate::support::*;
use graintrain::handle::MaterialId;
use graintrain::math::Vec3;
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::stepper::{StepSettings, Stepper};
use graintrain::world::{Body, World};

/// A ball that would fly past another, but is thrown onto it by a third within the step, hits it: it gets a
/// push, nothing overlaps, and momentum stays.
#[test]
fn what_is_deflected_onto_a_body_hits_it() {
    for step in [2e-3, 10e-3] {
        let mut world = world(0.0, 1.0);
        world.gravity = Vec3::ZERO;
        let flying = add_sphere(&mut world, 0.05, Vec3::ZERO);
        add_sphere(&mut world, 0.05, Vec3::new(0.08, -0.07, 0.0));
        let passed = add_sphere(&mut world, 0.05, Vec3::new(0.15, 0.11, 0.0));
        world.bodies.velocity[flying] = 20.0 * Vec3::X;
        let settings = StepSettings { step, envelope: 2e-3, ..StepSettings::default() };
        let mut stepper = Stepper::new(settings).unwrap();
        for _ in 0..20 {
            let report = solved_step(&mut stepper, &mut world);
            assert_eq!(report.contacts_missed, 0, "{step} s");
            assert!(
                report.penetration_max_over_size < 1e-3,
                "{step} s: {}",
                report.penetration_max_over_size
            );
        }
        let momentum: Vec3 = world.bodies.velocity.iter().sum();
        assert!(world.bodies.velocity[passed].length() > 5.0, "{step} s: {}", world.bodies.velocity[passed]);
        assert!((momentum - 20.0 * Vec3::X).length() < 1e-9, "{step} s: {momentum}");
    }
}

/// A ball bounces from the floor into a wall within a step; it would have passed beneath that without the
/// floor. A ball that hits one of three within a step is thrown onto the last of them, of equal mass: what
/// they have after it is known.
#[test]
fn balls_meet_what_they_are_deflected_to_in_the_same_step() {
    let fixed_box = |world: &mut World, size: [f64; 3], place: Vec3| {
        let geometry = world.add_geometry(Geometry::cuboid(0.5 * Vec3::from_array(size)).unwrap());
        let motion = world.add_motion(Motion::fixed()).unwrap();
        world.add_body(Body { motion, ..Body::new(geometry, MaterialId::default(), place) }).unwrap();
    };
    for (restitution, step) in [(1.0, 5e-3), (1.0, 10e-3), (0.0, 10e-3), (0.0, 20e-3)] {
        let mut world = world(0.0, restitution);
        world.gravity = Vec3::ZERO;
        fixed_box(&mut world, [0.12, 0.12, 0.002], Vec3::new(0.0, 0.0, -0.001));
        fixed_box(&mut world, [0.002, 0.12, 0.12], Vec3::new(0.051, 0.0, 0.05));
        let ball = add_sphere(&mut world, 0.005, 0.02 * Vec3::Z);
        world.bodies.velocity[ball] = Vec3::new(10.0, 0.0, -8.0);
        run(&mut Stepper::new(StepSettings { step, ..StepSettings::default() }).unwrap(), &mut world, 2);
        let expected = restitution * Vec3::new(-10.0, 0.0, 8.0);
        let got = world.bodies.velocity[ball];
        assert!((got - expected).length() < 1e-4, "{restitution} {step} s: {got}");
        assert!(world.bodies.position[ball].x < 0.0451, "{}", world.bodies.position[ball]);
    }
    for (speed, step) in [(20.0, 5e-3), (20.0, 1e-3), (100.0, 20e-3)] {
        let mut world = world(0.0, 1.0);
        world.gravity = Vec3::ZERO;
        let reach = 0.01;
        let along = |x: f64, y: f64| reach * Vec3::new(x, y, 0.0);
        // It touches the second at 45 degrees, and the last, in the way of what is deflected, off its centre.
        let half = 0.5_f64.sqrt();
        let hits = add_sphere(&mut world, 0.5 * reach, along(-30.0 - half, -half));
        let first = add_sphere(&mut world, 0.5 * reach, Vec3::ZERO);
        let last = add_sphere(&mut world, 0.5 * reach, along(-half + 5.0 * half, -half - 5.0 * half));
        world.bodies.velocity[hits] = speed * Vec3::X;
        run(&mut Stepper::new(StepSettings { step, ..StepSettings::default() }).unwrap(), &mut world, 60);
        let expected =
            [(hits, Vec3::ZERO), (first, Vec3::new(0.5, 0.5, 0.0)), (last, Vec3::new(0.5, -0.5, 0.0))];
        for (body, share) in expected {
            let got = world.bodies.velocity[body];
            assert!((got - speed * share).length() < 1e-6 * speed, "{speed} m/s, {step} s: {got}");
        }
    }
}

/// A light ball at rest is thrown against a thin ceiling by a heavy one, from where that touches it, not from
/// where it would have come from with that speed.
#[test]
fn what_is_thrown_against_a_ceiling_within_a_step_stays_below_it() {
    for k in 0..40 {
        let restitution = [0.0, 0.3, 0.5, 1.0][k as usize % 4];
        let mut world = world(0.0, restitution);
        world.gravity = Vec3::ZERO;
        let plate = world.add_geometry(Geometry::cuboid(Vec3::new(0.5, 0.5, 0.001)).unwrap());
        let motion = world.add_motion(Motion::fixed()).unwrap();
        let ceiling = Body::new(plate, MaterialId::default(), 1.001 * Vec3::Z);
        world.add_body(Body { motion, ..ceiling }).unwrap();
        let aside = 0.03 * (scattered(k, 0.2) - 0.5) * Vec3::X;
        let heavy = add_sphere(&mut world, 0.045, (0.55 + 0.1 * scattered(k, 0.6)) * Vec3::Z);
        let light = add_sphere(&mut world, 0.02, 0.87 * Vec3::Z + aside);
        world.bodies.velocity[heavy] = 32.0 * Vec3::Z;
        let settings = StepSettings { step: 10e-3, ..StepSettings::default() };
        run(&mut Stepper::new(settings).unwrap(), &mut world, 3);
        let [heavy, light] = [heavy, light].map(|body| world.bodies.position[body].z);
        assert!(heavy < 1.0 && light < 1.0, "{k}: {heavy} {light}");
    }
}

/// Balls that cross a box of six plates many times in a step, plastic or elastic, stay in it.
#[test]
fn balls_that_cross_a_box_of_plates_in_a_step_stay_in_it() {
    for (restitution, friction, speed, step) in
        [(0.0, 0.3, 300.0, 10e-3), (0.0, 0.3, 300.0, 2e-3), (1.0, 0.0, 100.0, 2e-3), (1.0, 0.0, 100.0, 10e-3)]
    {
        let mut world = world(friction, restitution);
        world.gravity = Vec3::ZERO;
        let motion = world.add_motion(Motion::fixed()).unwrap();
        for axis in 0..3 {
            let mut size = [1.2; 3];
            size[axis] = 0.002;
            let geometry = world.add_geometry(Geometry::cuboid(0.5 * Vec3::from_array(size)).unwrap());
            for place in [-0.001, 1.001] {
                let mut centre = [0.5; 3];
                centre[axis] = place;
                let wall = Body::new(geometry, MaterialId::default(), Vec3::from_array(centre));
                world.add_body(Body { motion, ..wall }).unwrap();
            }
        }
        let balls: Vec<usize> = (0..12)
            .map(|k| {
                let number = |salt: f64| scattered(k, salt);
                let place = Vec3::new(number(0.11), number(0.57), number(0.83));
                let ball = add_sphere(&mut world, 0.005, 0.5 + 0.9 * (place - 0.5));
                let way = Vec3::new(number(0.29) - 0.5, number(0.91) - 0.5, number(0.43) - 0.5);
                world.bodies.velocity[ball] = speed * way.normalize();
                ball
            })
            .collect();
        run(&mut Stepper::new(StepSettings { step, ..StepSettings::default() }).unwrap(), &mut world, 30);
        for &ball in &balls {
            let place = world.bodies.position[ball];
            let inside = (place - 0.5).abs().max_element() < 0.5;
            assert!(inside, "{restitution} {speed} m/s, {step} s: ball {ball} at {place}");
        }
    }
}
