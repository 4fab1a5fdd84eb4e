//! External forces and torques that a program sets between steps, and removal of bodies.

use crate::support::*;
use graintrain::handle::{BodyId, MaterialId};
use graintrain::math::{Quat, Vec3};
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
use graintrain::world::{Body, World};
use graintrain_ccp::FrictionModel;

fn stepper(step: f64, friction: FrictionModel) -> Stepper {
    Stepper::new(StepSettings {
        step,
        envelope: 1e-4,
        solver: SolverChoice { tolerance: 1e-8, friction, ..SolverChoice::default() },
        ..StepSettings::default()
    })
    .unwrap()
}

fn block(world: &mut World, half: f64, position: Vec3) -> BodyId {
    let geometry = world.add_geometry(Geometry::cuboid(Vec3::splat(half)).unwrap());
    world.add_body(Body::new(geometry, MaterialId::default(), position)).unwrap()
}

#[test]
fn a_constant_force_and_torque_accelerate() {
    let mut world = world(0.0, 0.0);
    let geometry = world.add_geometry(Geometry::cuboid(Vec3::new(0.1, 0.2, 0.3)).unwrap());
    let orientation = Quat::from_rotation_y(0.7);
    let body = world
        .add_body(Body { orientation, ..Body::new(geometry, MaterialId::default(), Vec3::ZERO) })
        .unwrap()
        .index();
    let (mass, inertia) = (world.bodies.mass[body], world.bodies.inertia[body]);
    let force = Vec3::new(3.0, -2.0, 50.0);
    // About the middle axis of the box, which stays where it is.
    let axis = orientation * Vec3::Y;
    world.bodies.force[body] = force;
    world.bodies.torque[body] = 0.3 * axis;
    let (step, steps) = (1e-3, 500);
    let mut stepper = stepper(step, FrictionModel::Relaxed);
    for _ in 0..steps {
        stepper.step(&mut world).unwrap();
    }
    let time = step * f64::from(steps);
    let velocity = time * (force / mass - G * Vec3::Z);
    assert!((world.bodies.velocity[body] - velocity).length() < 1e-12 * velocity.length());
    let spin = time * 0.3 / inertia.y_axis.y * axis;
    assert!((world.bodies.angular_velocity[body] - spin).length() < 1e-9 * spin.length());
}

/// A block pressed down and pulled: the floor carries weight and press; it slides where the pull exceeds
/// friction.
#[test]
fn a_pulled_block_slides_beyond_friction() {
    for model in BOTH {
        for (share, slides) in [(0.9, false), (1.5, true)] {
            // A relaxed contact that slides faster and faster lifts the block off.
            if slides && model == FrictionModel::Relaxed {
                continue;
            }
            let mut world = world(0.4, 0.0);
            let floor = add_ground(&mut world, 0.0);
            let body = block(&mut world, 0.1, Vec3::new(0.0, 0.0, 0.1));
            let mass = world.bodies.mass[body.index()];
            let press = 20.0 * mass;
            let pull = share * 0.4 * (mass * G + press);
            // At the height of the floor, so that nothing tips.
            world.add_force_at(body, Vec3::new(pull, 0.0, 0.0), Vec3::ZERO).unwrap();
            world.add_force_at(body, -press * Vec3::Z, Vec3::new(0.0, 0.0, 0.5)).unwrap();
            let mut stepper = stepper(1e-3, model);
            let mut carried = 0.0;
            for _ in 0..200 {
                let report = stepper.step(&mut world).unwrap();
                carried = report.wrenches.iter().find(|w| w.body == floor).unwrap().force.z;
            }
            let expected = mass * G + press;
            assert!((-carried / expected - 1.0).abs() < 1e-6, "{model:?}: {carried} of {expected} N");
            let speed = world.bodies.velocity[body.index()].x;
            let exact = if slides { 0.2 * (pull - 0.4 * expected) / mass } else { 0.0 };
            assert!(
                (speed - exact).abs() < 1e-6 * expected / mass,
                "{model:?} {share}: {speed} for {exact} m/s"
            );
        }
    }
}

/// A force that carries a grain through a plate within one step: the plate is found, and holds.
#[test]
fn a_strong_force_does_not_pass_a_plate() {
    let mut world = world(0.3, 0.0);
    let plate = world.add_geometry(Geometry::cuboid(Vec3::new(0.5, 0.5, 1e-3)).unwrap());
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    world.add_body(Body { motion: fixed, ..Body::new(plate, MaterialId::default(), Vec3::ZERO) }).unwrap();
    let ball = world.add_geometry(Geometry::sphere(0.005).unwrap());
    let grain =
        world.add_body(Body::new(ball, MaterialId::default(), Vec3::new(0.0, 0.0, 0.02))).unwrap().index();
    world.bodies.force[grain] = -1e5 * world.bodies.mass[grain] * Vec3::Z;
    let mut stepper = stepper(1e-3, FrictionModel::Relaxed);
    for _ in 0..20 {
        stepper.step(&mut world).unwrap();
    }
    assert!((world.bodies.position[grain].z - 0.006).abs() < 1e-5, "at {}", world.bodies.position[grain].z);
}

#[test]
fn driven_bodies_do_not_feel_forces_and_bad_forces_are_refused() {
    let mut world = world(0.3, 0.0);
    let ball = world.add_geometry(Geometry::sphere(0.1).unwrap());
    let driven = world.add_motion(Motion::translating(Vec3::X, Profile::Constant(1.0))).unwrap();
    let body = world
        .add_body(Body { motion: driven, ..Body::new(ball, MaterialId::default(), Vec3::ZERO) })
        .unwrap();
    world.add_force_at(body, Vec3::new(1e3, 1e3, 1e3), Vec3::ONE).unwrap();
    assert!(world.add_force_at(BodyId::from_index(7), Vec3::ONE, Vec3::ZERO).is_err());
    assert!(world.add_force_at(body, Vec3::splat(f64::NAN), Vec3::ZERO).is_err());
    let mut stepper = stepper(0.1, FrictionModel::Relaxed);
    stepper.step(&mut world).unwrap();
    assert!((world.bodies.position[0] - Vec3::new(0.1, 0.0, 0.0)).length() < 1e-15);
    world.clear_forces();
    assert_eq!((world.bodies.force[0], world.bodies.torque[0]), (Vec3::ZERO, Vec3::ZERO));
    world.bodies.torque[0].y = f64::INFINITY;
    let error = stepper.step(&mut world).unwrap_err().to_string();
    assert!(error.contains("external torque"), "{error}");
}

/// The lower box of a stack is taken away while a stepper goes on: the upper one falls by its height and
/// rests.
#[test]
fn bodies_can_be_removed_between_steps() {
    for model in BOTH {
        let mut world = world(0.5, 0.0);
        let lower = block(&mut world, 0.1, Vec3::new(0.0, 0.0, 0.1));
        let upper = block(&mut world, 0.1, Vec3::new(0.0, 0.0, 0.3));
        add_ground(&mut world, 0.0);
        let mut stepper = stepper(1e-3, model);
        for _ in 0..20 {
            stepper.step(&mut world).unwrap();
        }
        let before = world.contacts.contacts.len();
        let index = world.remove_bodies(|body| body == lower.index());
        assert_eq!(index, [None, Some(BodyId::from_index(0)), Some(BodyId::from_index(1))]);
        assert!(before >= 8 && world.contacts.contacts.is_empty(), "the two kept bodies do not touch");
        assert_eq!((world.bodies.len(), index[upper.index()]), (2, Some(BodyId::from_index(0))));
        for _ in 0..400 {
            assert!(stepper.step(&mut world).unwrap().solve.converged());
        }
        assert!(
            (world.bodies.position[0].z - 0.1).abs() < 1e-4,
            "{model:?}: at {}",
            world.bodies.position[0]
        );
        assert!(world.bodies.velocity[0].length() < 1e-6);
        // Nothing left is a world too.
        world.remove_bodies(|_| true);
        stepper.step(&mut world).unwrap();
    }
}

/// Without gravity, a ball with e = 0.5 that a force presses on a wall rests there: what a solve leaves over
/// is no impact.
#[test]
fn what_a_force_presses_rests() {
    for model in BOTH {
        let mut world = world(0.3, 0.5);
        world.gravity = Vec3::ZERO;
        add_ground(&mut world, 0.0);
        let ball = add_sphere(&mut world, 0.1, Vec3::new(0.0, 0.0, 0.15));
        world.bodies.force[ball] = -10.0 * world.bodies.mass[ball] * Vec3::Z;
        let mut stepper = stepper(1e-3, model);
        let mut late = 0;
        for step in 0..1500 {
            let report = stepper.step(&mut world).unwrap();
            assert!(report.solve.converged());
            late += if step >= 1000 { report.impacts } else { 0 };
        }
        assert_eq!(late, 0, "{model:?}");
        assert!(
            world.bodies.velocity[ball].length() < 1e-6 && (world.bodies.position[ball].z - 0.1).abs() < 1e-4
        );
    }
}

/// A force of 1e5 m/s^2 on one ball makes no contacts of others with each other.
#[test]
fn a_strong_force_widens_no_other_pair() {
    let contacts = |pull: f64| {
        let mut world = world(0.3, 0.0);
        let ball = world.add_geometry(Geometry::sphere(0.005).unwrap());
        for k in 0..100 {
            let place = Vec3::new(f64::from(k % 10), f64::from(k / 10), 0.0) * 0.012;
            world.add_body(Body::new(ball, MaterialId::default(), place)).unwrap();
        }
        let far =
            world.add_body(Body::new(ball, MaterialId::default(), Vec3::new(0.0, 0.0, 5.0))).unwrap().index();
        world.bodies.force[far] = pull * world.bodies.mass[far] * Vec3::Z;
        stepper(1e-3, FrictionModel::Relaxed).step(&mut world).unwrap().contacts
    };
    assert_eq!(contacts(1e5), contacts(0.0));
}

/// Impacts are solved to 1e-9, which is no reason to call a step missed whose contact problem is asked for
/// more.
#[test]
fn impacts_do_not_miss_a_tolerance_below_their_own() {
    let mut world = world(0.3, 0.5);
    add_ground(&mut world, 0.0);
    for k in 0..4 {
        let ball =
            add_sphere(&mut world, 0.1, Vec3::new(0.19 * f64::from(k % 2), 0.19 * f64::from(k / 2), 0.12));
        world.bodies.velocity[ball] = Vec3::new(1.0 - f64::from(k), 0.3, -2.0);
    }
    let settings = StepSettings {
        step: 1e-2,
        solver: SolverChoice { tolerance: 1e-11, ..SolverChoice::default() },
        ..StepSettings::default()
    };
    let mut stepper = Stepper::new(settings).unwrap();
    let report = stepper.step(&mut world).unwrap();
    assert!(report.impacts > 0 && report.impact_residual.max <= 1e-9, "{:?}", report.impact_residual);
    assert!(report.solve.remark.is_none(), "{:?}", report.solve.remark);
}
