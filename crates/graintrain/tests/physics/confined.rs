//! Bodies between surfaces that slide past each other and cannot move apart. Default solver and tolerance.

use crate::support::*;
use graintrain::ccp::{FrictionModel, Status};
use graintrain::handle::{BodyId, MaterialId};
use graintrain::joint::Joint;
use graintrain::math::Vec3;
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
use graintrain::world::{Body, World};

/// A block of 0.2 m without play between a floor, which is driven at 0.1 m/s, and a fixed lid; 300 balls in
/// contact lie on the floor beside it.
fn press(balls: usize) -> (World, BodyId) {
    let mut world = world(0.5, 0.0);
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    let driven = world.add_motion(Motion::translating(Vec3::X, Profile::Constant(0.1))).unwrap();
    let plate = world.add_geometry(Geometry::cuboid(Vec3::new(2.0, 2.0, 0.05)).unwrap());
    for (motion, z) in [(driven, -0.05), (fixed, 0.25)] {
        let place = Vec3::new(0.0, 0.0, z);
        world.add_body(Body { motion, ..Body::new(plate, MaterialId::default(), place) }).unwrap();
    }
    let block = world.add_geometry(Geometry::cuboid(Vec3::splat(0.1)).unwrap());
    let block = world.add_body(Body::new(block, MaterialId::default(), Vec3::new(0.0, 0.0, 0.1))).unwrap();
    let ball = world.add_geometry(Geometry::sphere(0.05).unwrap());
    let side = (balls as f64).sqrt().ceil() as usize;
    for k in 0..balls {
        let place = Vec3::new(0.15 + 0.1 * (k % side) as f64, 0.1 * (k / side) as f64 - 0.5, 0.05);
        world.add_body(Body::new(ball, MaterialId::default(), place)).unwrap();
    }
    (world, block)
}

/// The block rides on the floor and slides under the lid; its neighbours do not feel it. Relaxed friction
/// would have to lift it off one of the plates by mu times its slip, for which there is no room: that problem
/// has no solution, and the step says so.
#[test]
fn a_block_that_slides_between_two_plates_is_not_locked() {
    for balls in [0, 100] {
        let (mut world, block) = press(balls);
        let mut stepper = Stepper::new(StepSettings { step: 5e-3, ..StepSettings::default() }).unwrap();
        for n in 0..40 {
            let report = stepper.step(&mut world).unwrap();
            assert!(report.solve.converged(), "step {n}: {:?}", report.solve);
            let z = world.bodies.position[block.index()].z;
            assert!((z - 0.1).abs() < 1e-4, "step {n}: {z}");
        }
        assert_close(world.bodies.velocity[block.index()].x, 0.1, 1e-3, "speed of the block");
    }
    let (mut world, _) = press(0);
    let solver = SolverChoice { friction: FrictionModel::Relaxed, ..SolverChoice::default() };
    let mut stepper = Stepper::new(StepSettings { step: 5e-3, solver, ..StepSettings::default() }).unwrap();
    let report = stepper.step(&mut world).unwrap();
    assert!(!report.solve.converged(), "{:?}", report.solve);
}

/// The block of the press drags a ball on a joint behind it.
#[test]
fn a_jointed_block_between_two_plates_is_not_locked() {
    let (mut world, block) = press(0);
    let ball = world.add_geometry(Geometry::sphere(0.02).unwrap());
    let ball = Body::new(ball, MaterialId::default(), Vec3::new(0.2, 0.0, 0.1));
    let ball = world.add_body(ball).unwrap();
    world.add_joint(Joint::spherical(Some(block), ball, Vec3::new(0.1, 0.0, 0.1))).unwrap();
    let mut stepper = Stepper::new(StepSettings { step: 5e-3, ..StepSettings::default() }).unwrap();
    for n in 0..20 {
        let report = stepper.step(&mut world).unwrap();
        assert!(report.solve.converged(), "step {n}: {:?}", report.solve);
        let z = world.bodies.position[block.index()].z;
        assert!((z - 0.1).abs() < 1e-4, "step {n}: {z}");
    }
    assert!(world.bodies.velocity[block.index()].x > 0.05, "{}", world.bodies.velocity[block.index()]);
}

/// A layer of balls between a fixed lid and a floor that is driven: it rolls.
#[test]
fn a_layer_of_balls_between_two_plates_rolls() {
    let mut world = world(0.9, 0.0);
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    let driven = world.add_motion(Motion::translating(Vec3::X, Profile::Constant(0.05))).unwrap();
    let plate = world.add_geometry(Geometry::cuboid(Vec3::new(15.0, 15.0, 0.5)).unwrap());
    for (motion, z) in [(driven, -0.5), (fixed, 0.6)] {
        let place = Vec3::new(0.0, 0.0, z);
        world.add_body(Body { motion, ..Body::new(plate, MaterialId::default(), place) }).unwrap();
    }
    let ball = world.add_geometry(Geometry::sphere(0.05).unwrap());
    for k in 0..144 {
        let place = Vec3::new(0.1 * f64::from(k % 12) - 0.55, 0.1 * f64::from(k / 12) - 0.55, 0.05);
        world.add_body(Body::new(ball, MaterialId::default(), place)).unwrap();
    }
    let mut stepper = Stepper::new(StepSettings { step: 5e-3, ..StepSettings::default() }).unwrap();
    for n in 0..5 {
        let report = stepper.step(&mut world).unwrap();
        assert!(report.solve.converged(), "step {n}: {:?}", report.solve);
        assert!(report.penetration_max_over_size < 0.01, "step {n}: {}", report.penetration_max_over_size);
    }
}

/// A ball between a floor and a press that comes down on it: no impulses keep them apart, and by both models
/// the step says so, within the budget of a step.
#[test]
fn a_ball_under_a_press_has_no_solution() {
    for friction in [FrictionModel::Coulomb, FrictionModel::Relaxed] {
        let mut world = world(0.5, 0.0);
        let fixed = world.add_motion(Motion::fixed()).unwrap();
        let down = world.add_motion(Motion::translating(-Vec3::Z, Profile::Constant(0.1))).unwrap();
        let plate = world.add_geometry(Geometry::cuboid(Vec3::new(1.0, 1.0, 0.05)).unwrap());
        for (motion, z) in [(fixed, -0.05), (down, 0.15)] {
            let place = Vec3::new(0.0, 0.0, z);
            world.add_body(Body { motion, ..Body::new(plate, MaterialId::default(), place) }).unwrap();
        }
        let ball = world.add_geometry(Geometry::sphere(0.05).unwrap());
        world.add_body(Body::new(ball, MaterialId::default(), Vec3::new(0.0, 0.0, 0.05))).unwrap();
        let solver = SolverChoice { friction, ..SolverChoice::default() };
        let mut stepper = Stepper::new(StepSettings { solver, ..StepSettings::default() }).unwrap();
        for n in 0..5 {
            let report = stepper.step(&mut world).unwrap();
            assert_eq!(report.solve.status, Status::Infeasible, "{friction:?}, step {n}: {:?}", report.solve);
        }
    }
}
