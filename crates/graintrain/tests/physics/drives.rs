//! Bodies of which some degrees of freedom are driven, some loaded and some free.

use crate::support::*;
use graintrain::ccp::FrictionModel;
use graintrain::collide::Collider;
use graintrain::handle::{BodyId, MaterialId};
use graintrain::joint::{Joint, Motor};
use graintrain::load::{Action, Load};
use graintrain::math::{Quat, Vec3};
use graintrain::motion::{Axes, Motion, Profile};
use graintrain::shape::{Geometry, HalfSpace, Part, Shape, Sphere};
use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
use graintrain::world::{Body, World};
use std::collections::BTreeSet;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

const BOTH: [FrictionModel; 2] = [FrictionModel::Relaxed, FrictionModel::Coulomb];

fn stepper(step: f64, friction: FrictionModel) -> Stepper {
    Stepper::new(StepSettings {
        step,
        envelope: 0.01,
        solver: SolverChoice { tolerance: 1e-10, friction, ..SolverChoice::default() },
        ..StepSettings::default()
    })
    .unwrap()
}

fn constant_force(direction: Vec3, size: f64) -> Action {
    Action::Force { terms: vec![(direction, Profile::Constant(size))], axes: Axes::World, point: Vec3::ZERO }
}

/// A wheel of radius 1 m with its axis along y that stands on the ground.
fn add_wheel(world: &mut World, motion: Motion) -> BodyId {
    let geometry = world.add_geometry(Geometry::cylinder(0.1, 1.0).unwrap());
    let motion = world.add_motion(motion).unwrap();
    let orientation = Quat::from_rotation_x(FRAC_PI_2);
    let place = Vec3::new(0.0, 0.0, 1.0);
    world.add_body(Body { motion, orientation, ..Body::new(geometry, MaterialId::default(), place) }).unwrap()
}

/// Driven at 0.1 m/s and 0.1 rad/s a wheel of radius 1 m goes straight on, where an axis fixed in the world
/// takes it in a circle.
#[test]
fn a_wheel_that_translates_and_turns_goes_straight() {
    for model in BOTH {
        let mut world = world(0.5, 0.0);
        add_ground(&mut world, 0.0);
        let rolling = Motion::spinning(Vec3::Y, Profile::Constant(0.1))
            .and_translating(Vec3::X, Profile::Constant(0.1));
        let wheel = add_wheel(&mut world, rolling).index();
        let mut stepper = stepper(0.01, model);
        for _ in 0..500 {
            let report = stepper.step(&mut world).unwrap();
            assert!(report.solve.converged());
            let slip = world.bodies.velocity[wheel].x - world.bodies.angular_velocity[wheel].y;
            assert!(slip.abs() < 1e-15, "{slip}");
        }
        let expected = Vec3::new(0.5, 0.0, 1.0);
        assert!(
            (world.bodies.position[wheel] - expected).length() < 1e-12,
            "{}",
            world.bodies.position[wheel]
        );
    }
}

/// What a driven plate meets in a step depends on how fast it is in that step, not on how fast it was before:
/// it starts, is under way, or stops in front of a ball that comes after it.
#[test]
fn a_driven_plate_meets_what_its_motion_in_the_step_leads_to() {
    for (model, step) in [(BOTH[0], 10e-3), (BOTH[1], 10e-3), (BOTH[1], 2e-3)] {
        let times = vec![0.0, 0.1, 0.1 + 1e-9, 0.3, 0.3 + 1e-9];
        let profile = Profile::Table { times, values: vec![0.0, 0.0, 50.0, 50.0, 0.0] };
        for (place, velocity, is_ahead) in [(0.27, 0.0, true), (5.3, 0.0, true), (-0.27, 50.0, false)] {
            let mut world = world(0.3, 0.0);
            world.gravity = Vec3::ZERO;
            let plate = world.add_geometry(Geometry::cuboid(Vec3::new(2.0, 2.0, 0.0005)).unwrap());
            let motion = world.add_motion(Motion::translating(Vec3::Z, profile.clone())).unwrap();
            let at = Body::new(plate, MaterialId::default(), -0.0005 * Vec3::Z);
            let plate = world.add_body(Body { motion, ..at }).unwrap().index();
            let ball = add_sphere(&mut world, 0.02, Vec3::new(0.3, 0.2, place));
            // What comes after the plate arrives as it has stopped.
            let wait = if is_ahead { 0.0 } else { 0.1 };
            world.bodies.velocity[ball] = velocity * Vec3::Z;
            world.bodies.position[ball].z -= wait * velocity;
            let mut stepper = stepper(step, model);
            for _ in 0..(0.5 / step).round() as usize {
                let report = stepper.step(&mut world).unwrap();
                assert!(report.solve.converged(), "{report:?}");
            }
            let [ball, plate] =
                [ball, plate].map(|body| (world.bodies.position[body].z, world.bodies.velocity[body].z));
            assert_eq!(ball.0 > plate.0, is_ahead, "{model:?} {step} s, from {place}: {ball:?} {plate:?}");
            let expected = if is_ahead { 50.0 } else { 0.0 };
            assert!((ball.1 - expected).abs() < 1e-6, "{model:?} {step} s, from {place}: {ball:?} {plate:?}");
        }
    }
}

/// With its rate prescribed and its path free, friction takes a wheel along until speed = radius x rate, to
/// the accuracy of the solve.
#[test]
fn a_driven_wheel_rolls_with_radius_times_rate() {
    for model in BOTH {
        let mut world = world(0.5, 0.0);
        add_ground(&mut world, 0.0);
        let free = [true, false, true, false, false, false];
        let rolling = Motion::spinning(Vec3::Y, Profile::Constant(0.3)).with_free(free);
        let wheel = add_wheel(&mut world, rolling).index();
        let mut stepper = stepper(0.002, model);
        for _ in 0..300 {
            assert!(stepper.step(&mut world).unwrap().solve.converged());
        }
        let speed = world.bodies.velocity[wheel].x;
        // The contact lies the height of the centre below it: the radius but for the overlap kept.
        let radius = world.bodies.position[wheel].z;
        assert!((radius - 1.0).abs() < 1e-3);
        assert!((speed - 0.3 * radius).abs() < 1e-9, "{model:?}: {speed} with {radius}");
    }
}

/// Torque on the axle, load and weight on it: without slip the wheel accelerates by T R / (m R^2 + I).
#[test]
fn a_wheel_loaded_by_a_torque_accelerates_as_it_should() {
    for model in BOTH {
        let mut world = world(0.8, 0.0);
        let ground = add_ground(&mut world, 0.0);
        let wheel = add_wheel(&mut world, Motion::fixed().with_free([true, false, true, false, true, false]));
        let (mass, torque, load) = (world.bodies.mass[wheel.index()], 300.0, 2000.0);
        // About its own axis.
        let inertia = world.bodies.inertia[wheel.index()].z_axis.z;
        let twist = Action::Torque { terms: vec![(Vec3::Y, Profile::Constant(torque))], axes: Axes::World };
        world.add_load(Load::on(wheel, twist)).unwrap();
        world.add_load(Load::on(wheel, constant_force(-Vec3::Z, load))).unwrap();
        let step = 1e-3;
        let mut stepper = stepper(step, model);
        let mut work = 0.0;
        for n in 1..=500 {
            let report = stepper.step(&mut world).unwrap();
            work += report.ledger.loads;
            let acceleration = torque / (mass + inertia);
            let speed = f64::from(n) * step * acceleration;
            let found = world.bodies.velocity[wheel.index()].x;
            assert!((found / speed - 1.0).abs() < 2e-4, "{model:?} {n}: {found}, not {speed}");
            let carried = report.wrenches.iter().find(|w| w.body == ground).unwrap().force.z;
            assert!((carried / (mass * G + load) + 1.0).abs() < 1e-3, "{model:?} {n}: {carried} N");
        }
        // Rolling loses nothing: what the torque does is there as motion.
        assert!((work / world.kinetic_energy() - 1.0).abs() < 1e-3, "{model:?}: {work}");
    }
}

/// A piston on rails accelerates at F / m; pressed on a block it hands the force through to the floor.
#[test]
fn a_loaded_piston_accelerates_and_presses() {
    for model in BOTH {
        let mut world = world(0.3, 0.0);
        let floor = add_ground(&mut world, 0.0);
        let cube = world.add_geometry(Geometry::cuboid(Vec3::splat(0.1)).unwrap());
        let block = Body::new(cube, MaterialId::default(), Vec3::new(0.0, 0.0, 0.1));
        world.add_body(block).unwrap();
        let rail =
            world.add_motion(Motion::fixed().with_free([false, false, true, false, false, false])).unwrap();
        let piston = Body::new(cube, MaterialId::default(), Vec3::new(0.0, 0.0, 0.35));
        let piston = world.add_body(Body { motion: rail, ..piston }).unwrap();
        let (mass, load) = (world.bodies.mass[piston.index()], 500.0);
        world.add_load(Load::on(piston, constant_force(-Vec3::Z, load))).unwrap();
        let step = 1e-3;
        let mut stepper = stepper(step, model);
        let mut carried = 0.0;
        for n in 1..=400 {
            let report = stepper.step(&mut world).unwrap();
            if n <= 30 {
                // Nothing in its way yet: 1/2 a t^2 < 50 mm.
                let speed = f64::from(n) * step * (G + load / mass);
                let found = -world.bodies.velocity[piston.index()].z;
                assert!((found / speed - 1.0).abs() < 1e-12, "{found}");
            }
            carried = -report.wrenches.iter().find(|w| w.body == floor).unwrap().force.z;
        }
        let expected = 2.0 * mass * G + load;
        assert!((carried / expected - 1.0).abs() < 1e-4, "{model:?}: {carried} N, not {expected} N");
        assert!(world.bodies.velocity[piston.index()].length() < 1e-6);
    }
}

/// A body of planes alone is seen to be far from most others without the exact tests. It meets the balls that
/// it meets with them: here beside two balls far away, which keep the short cut out, at rest and turning
/// fast.
#[test]
fn a_turning_box_of_planes_misses_no_contact() {
    let contacts_of = |rate: f64, behind: bool| {
        let mut world = world(0.3, 0.0);
        let wall = |place: Vec3, normal: Vec3| Part {
            shape: Shape::Plane(HalfSpace),
            position: place,
            orientation: Quat::from_rotation_arc(Vec3::Z, normal),
        };
        let mut parts = vec![
            wall(Vec3::ZERO, Vec3::Z),
            wall(-2.0 * Vec3::X, Vec3::X),
            wall(2.0 * Vec3::X, -Vec3::X),
            wall(-2.0 * Vec3::Y, Vec3::Y),
        ];
        if behind {
            let ball = Shape::Sphere(Sphere { radius: 0.2 });
            // Two of them, so that the centre of mass stays.
            for height in [-50.0, 50.0] {
                parts.push(Part {
                    shape: ball.clone(),
                    position: height * Vec3::Z,
                    orientation: Quat::IDENTITY,
                });
            }
        }
        let walls = world.add_geometry(Geometry::compound(parts).unwrap().0);
        let motion =
            world.add_motion(Motion::spinning(Vec3::new(0.6, 0.8, 0.0), Profile::Constant(rate))).unwrap();
        let place = Vec3::new(0.3, -0.2, 0.1);
        world.add_body(Body { motion, ..Body::new(walls, MaterialId::default(), place) }).unwrap();
        world.bodies.angular_velocity[0] = rate * Vec3::new(0.6, 0.8, 0.0);
        for k in 0..512 {
            let at = [k % 8, k / 8 % 8, k / 64].map(|i| 0.5 * f64::from(i));
            let ball = add_sphere(&mut world, 0.1, Vec3::from(at) + Vec3::new(-1.5, -1.8, 0.25));
            world.bodies.velocity[ball] = Vec3::new(0.0, 1.0, -2.0);
        }
        let found = Collider::default().contacts(&world, 0.01, 0.02);
        let with_walls = found.iter().filter(|c| c.body_a.min(c.body_b) == 0);
        // (Fast pairs of bodies of different size are reported at different times of the step: balls, not
        // gaps.)
        with_walls.map(|c| c.body_a.max(c.body_b)).collect::<BTreeSet<_>>()
    };
    for (rate, least) in [(0.0, 20), (15.0, 30)] {
        let found = contacts_of(rate, false);
        assert!(found.len() >= least, "{} at {rate} rad/s", found.len());
        assert_eq!(found, contacts_of(rate, true), "{rate} rad/s");
    }
}

/// A block on a table that goes round with the world turning under it, about an axis beside the table, stays
/// where it is on the table, also at its middle.
#[test]
fn what_rides_on_an_orbiting_table_stays_there() {
    for place in [0.0, 0.1] {
        let (step, speed) = (0.01, 3.0);
        let mut world = world(10.0, 0.0);
        let material = MaterialId::default();
        let plate = world.add_geometry(Geometry::cylinder(0.05, 0.3).unwrap());
        let turning = Motion::rotating(Vec3::ZERO, Vec3::Z, Profile::Constant(speed));
        let motion = world.add_motion(turning).unwrap();
        let table = Body { motion, ..Body::new(plate, material, Vec3::new(1.0, 0.0, -0.05)) };
        let table = world.add_body(table).unwrap().index();
        let block = world.add_geometry(Geometry::cuboid(Vec3::new(0.02, 0.02, 0.01)).unwrap());
        let block = Body {
            velocity: Vec3::new(0.0, (1.0 + place) * speed, 0.0),
            angular_velocity: speed * Vec3::Z,
            ..Body::new(block, material, Vec3::new(1.0 + place, 0.0, 0.01))
        };
        let block = world.add_body(block).unwrap().index();
        let mut stepper = stepper(step, FrictionModel::Coulomb);
        for _ in 0..(10.0 * TAU / speed / step) as usize {
            assert!(stepper.step(&mut world).unwrap().solve.converged());
        }
        let bodies = &world.bodies;
        let apart = bodies.position[block] - bodies.position[table];
        let now = (bodies.orientation[table].conjugate() * apart).with_z(0.0);
        assert!((now - place * Vec3::X).length() < 4e-3, "{place}: {now}");
    }
}

/// What sticks to a turntable, driven as a motion or by the motor of its joint, stays on its circle, also
/// where it is held by nine tenths of what friction can do; a ball that rolls on it goes round a circle of
/// its own, 2/7 as fast.
#[test]
fn what_rides_on_a_turntable_keeps_to_its_circle() {
    for (step, friction, tolerance, is_jointed) in [
        (0.01, 10.0, 2e-4, false),
        (0.02, 10.0, 2e-3, false),
        (0.01, 0.42, 2e-4, false),
        (0.01, 10.0, 2e-4, true),
    ] {
        let (radius, speed) = (0.5, 2.76);
        let mut world = world(friction, 0.0);
        let material = MaterialId::default();
        if is_jointed {
            let plate = world.add_geometry(Geometry::cylinder(0.05, 0.6).unwrap());
            let angular_velocity = speed * Vec3::Z;
            let plate = Body { angular_velocity, ..Body::new(plate, material, -0.05 * Vec3::Z) };
            let plate = world.add_body(plate).unwrap();
            let motor = Motor::Speed { speed: Profile::Constant(speed), limit: None };
            world.add_joint(Joint::revolute(None, plate, Vec3::ZERO, Vec3::Z).with_motor(motor)).unwrap();
        } else {
            let plane = world.add_geometry(Geometry::plane());
            let turning = Motion::rotating(Vec3::ZERO, Vec3::Z, Profile::Constant(speed));
            let motion = world.add_motion(turning).unwrap();
            world.add_body(Body { motion, ..Body::new(plane, material, Vec3::ZERO) }).unwrap();
        }
        let block = world.add_geometry(Geometry::cuboid(Vec3::new(0.02, 0.02, 0.01)).unwrap());
        let block = Body {
            velocity: Vec3::new(0.0, radius * speed, 0.0),
            angular_velocity: Vec3::new(0.0, 0.0, speed),
            ..Body::new(block, material, Vec3::new(radius, 0.0, 0.01))
        };
        let block = world.add_body(block).unwrap().index();
        let ball = world.add_geometry(Geometry::sphere(0.02).unwrap());
        // Rolling with the table under it; the centre of its circle is at the axis.
        let own = 2.0 / 7.0 * speed;
        let place = Vec3::new(-0.3, 0.0, 0.02);
        let slower = (speed - own) * -0.3 / 0.02;
        let ball = Body {
            velocity: Vec3::new(0.0, -0.3 * own, 0.0),
            angular_velocity: Vec3::new(slower, 0.0, 0.0),
            ..Body::new(ball, material, place)
        };
        let ball = world.add_body(ball).unwrap().index();
        let mut stepper = stepper(step, FrictionModel::Coulomb);
        for _ in 0..(5.0 / step) as usize {
            assert!(stepper.step(&mut world).unwrap().solve.converged());
        }
        let out = |body: usize| world.bodies.position[body].with_z(0.0).length();
        let place = world.bodies.position[block];
        let behind = (place.y.atan2(place.x) - 5.0 * speed).rem_euclid(TAU);
        let behind = if behind > PI { behind - TAU } else { behind };
        assert!(behind.abs() < 10.0 * tolerance, "{step} {friction}: {behind}");
        assert!((out(block) / radius - 1.0).abs() < tolerance, "{step} {friction}: {}", out(block) / radius);
        assert!((out(ball) / 0.3 - 1.0).abs() < 0.02, "{step} {friction}: {}", out(ball) / 0.3);
    }
}
