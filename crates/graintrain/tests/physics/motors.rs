//! Motors and stops of joints.

use super::joints::{BOTH, GRAVITY, earth, lump, rod, run, stepper, weightless};
use graintrain::ccp::{FrictionModel, Status};
use graintrain::formula::{Formula, Function, Operation, Operator};
use graintrain::handle::{BodyId, MaterialId};
use graintrain::joint::{Joint, Motor};
use graintrain::load::{Action, Load};
use graintrain::material::Materials;
use graintrain::math::{Mat3, Vec3};
use graintrain::motion::Axes;
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::world::{Body, MassProperties, World};

/// A motor on a pinion lifts a weight on a rack at its speed; one that is too weak lets it down with what is
/// left of gravity.
#[test]
fn a_motor_lifts_what_its_torque_can() {
    for (limit, lifts) in [(3.0, true), (1.5, false)] {
        let mut world = earth();
        let (mass, radius, inertia, step): (f64, f64, f64, f64) = (2.0, 0.1, 1e-3, 1e-3);
        let weight = lump(&mut world, Vec3::ZERO, mass, Vec3::splat(1e-3));
        let pinion = lump(&mut world, Vec3::X, 1.0, Vec3::splat(inertia));
        let motor = Motor::Speed { speed: Profile::Constant(2.0), limit: Some(Profile::Constant(limit)) };
        let turn = Joint::revolute(None, pinion, Vec3::X, Vec3::Y).with_motor(motor);
        let turn = world.add_joint(turn).unwrap();
        let slide = world.add_joint(Joint::prismatic(None, weight, Vec3::ZERO, Vec3::Z)).unwrap();
        world.add_joint(Joint::gear([turn, slide], radius)).unwrap();
        let mut stepper = stepper(step, FrictionModel::Relaxed);
        run(&mut world, &mut stepper, 1000);
        let (speed, drive) =
            (world.bodies.velocity[weight.index()].z, world.joints()[turn.index()].state.drive);
        if lifts {
            assert!((speed - 2.0 * radius).abs() < 1e-13, "{speed}");
            assert!((drive - mass * GRAVITY * radius).abs() < 1e-10, "{drive}");
        } else {
            let acceleration = (limit / radius - mass * GRAVITY) / (mass + inertia / (radius * radius));
            assert!((speed - acceleration).abs() < 1e-10 * acceleration.abs(), "{speed} {acceleration}");
            assert!((drive - limit).abs() < 1e-12);
        }
    }
}

/// A wheel on a hinge of a carriage that slides, driven, on a plane: it rolls.
#[test]
fn a_driven_wheel_rolls_without_slip() {
    for friction in BOTH {
        let mut world = earth();
        let radius = 0.3;
        let plane = world.add_geometry(Geometry::plane());
        let fixed = world.add_motion(Motion::fixed()).unwrap();
        world
            .add_body(Body { motion: fixed, ..Body::new(plane, MaterialId::default(), Vec3::ZERO) })
            .unwrap();
        let wheel = world.add_geometry(Geometry::sphere(radius).unwrap());
        let hub = Vec3::new(0.0, 0.0, radius);
        let wheel = world.add_body(Body::new(wheel, MaterialId::default(), hub)).unwrap();
        let carriage = lump(&mut world, hub, 50.0, Vec3::splat(1.0));
        let motor = Motor::Speed { speed: Profile::Constant(1.5), limit: Some(Profile::Constant(60.0)) };
        let axle = Joint::revolute(Some(carriage), wheel, hub, Vec3::Y).with_motor(motor);
        world.add_joint(axle).unwrap();
        // The carriage may rise and go ahead, but not turn: two slides would need a third body, a fixed
        // rotation is enough.
        let guide = lump(&mut world, hub + Vec3::Y, 1.0, Vec3::splat(1.0));
        world.add_joint(Joint::prismatic(None, guide, hub, Vec3::Z)).unwrap();
        world.add_joint(Joint::prismatic(Some(guide), carriage, hub, Vec3::X)).unwrap();
        let mut stepper = stepper(1e-3, friction);
        run(&mut world, &mut stepper, 1500);
        let speed = world.bodies.velocity[carriage.index()].x;
        let rate = world.bodies.angular_velocity[wheel.index()].y;
        assert!((rate - 1.5).abs() < 1e-9, "{rate}");
        assert!((speed - radius * rate).abs() < 1e-9, "{speed}");
    }
}

#[test]
fn stops_hold_and_let_go() {
    for friction in BOTH {
        // A weight on a slide falls on its lower stop, is lifted off it, and meets the upper one.
        let mut world = earth();
        let weight = lump(&mut world, Vec3::ZERO, 2.0, Vec3::splat(1e-3));
        let slide = Joint::prismatic(None, weight, Vec3::ZERO, Vec3::Z).with_limits(Some(-0.2), Some(0.3));
        let slide = world.add_joint(slide).unwrap();
        let mut stepper = stepper(1e-3, friction);
        run(&mut world, &mut stepper, 500);
        let state = world.joints()[slide.index()].state;
        assert!((state.coordinate + 0.2).abs() < 1e-12 && state.rate.abs() < 1e-12, "{state:?}");
        assert!((state.drive - 2.0 * GRAVITY).abs() < 1e-9);
        world.bodies.force[weight.index()] = Vec3::new(0.0, 0.0, 2.0 * (GRAVITY + 4.0));
        run(&mut world, &mut stepper, 200);
        let risen = world.joints()[slide.index()].state.coordinate + 0.2;
        assert!((risen - 4.0 * 0.5 * 0.2 * 0.201).abs() < 1e-9, "{risen}");
        run(&mut world, &mut stepper, 600);
        let state = world.joints()[slide.index()].state;
        assert!((state.coordinate - 0.3).abs() < 1e-12, "{state:?}");
        assert!((state.drive + 8.0).abs() < 1e-9, "{state:?}");
        // A ball on a rope, which is slack at first and then taut.
        let mut world = earth();
        let ball = lump(&mut world, Vec3::new(0.4, 0.0, 0.0), 1.0, Vec3::splat(1e-3));
        let rope =
            Joint::distance(None, ball, [Vec3::ZERO, Vec3::new(0.4, 0.0, 0.0)]).with_limits(None, Some(0.5));
        let rope = world.add_joint(rope).unwrap();
        run(&mut world, &mut stepper, 300);
        let fallen = GRAVITY * 0.5 * 0.3 * 0.301;
        assert!((world.bodies.position[ball.index()].z.abs() - fallen).abs() < 0.15);
        let longest = (0..2000).map(|_| {
            run(&mut world, &mut stepper, 1);
            world.joints()[rope.index()].state.coordinate
        });
        let longest = longest.fold(0.0, f64::max);
        assert!((longest - 0.5).abs() < 1e-9, "{longest}");
    }
}

/// A motor without a limit turns a crank whose linkage does not let it go round: at the dead point joints can
/// only be closed against it. The step says so, and the next ones go on: roundings decide for how long, so
/// steps and speeds vary.
#[test]
fn a_motor_at_a_dead_point_is_reported() {
    let cases = [(5e-3, 2.0), (4.9e-3, 2.0), (5.1e-3, 2.0), (5e-3, 2.01), (5e-3, 1.95)];
    let told: usize = cases.iter().map(|&(step, speed)| told_at_a_dead_point(step, speed)).sum();
    assert!(told < 80 * cases.len(), "{told}");
}

/// Steps in which the motor is reported, of 400.
fn told_at_a_dead_point(step: f64, speed: f64) -> usize {
    let mut world = earth();
    let pins =
        [Vec3::ZERO, Vec3::new(0.287, 0.0, 0.089), Vec3::new(0.631, 0.0, 0.292), Vec3::new(0.7, 0.0, 0.0)];
    let links: Vec<BodyId> = (0..3).map(|k| rod(&mut world, [pins[k], pins[k + 1]], 1.0)).collect();
    let motor = Motor::Speed { speed: Profile::Constant(speed), limit: None };
    let crank = Joint::revolute(None, links[0], pins[0], -Vec3::Y).with_motor(motor).named("crank");
    world.add_joint(crank).unwrap();
    world.add_joint(Joint::revolute(Some(links[0]), links[1], pins[1], Vec3::Y)).unwrap();
    world.add_joint(Joint::revolute(Some(links[1]), links[2], pins[2], Vec3::Y)).unwrap();
    world.add_joint(Joint::revolute(None, links[2], pins[3], Vec3::Y)).unwrap();
    let mut stepper = stepper(step, FrictionModel::Coulomb);
    let mut remarks = Vec::new();
    for _ in 0..400 {
        let before = world.joints()[0].state.coordinate;
        let report = stepper.step(&mut world).unwrap();
        let turned = world.joints()[0].state.coordinate - before;
        if report.solve.status == Status::Converged {
            assert!((turned - step * speed).abs() < 1.1e-3, "{turned}");
        } else {
            remarks.push(report.solve.remark.unwrap());
        }
        let fastest = world.bodies.velocity.iter().map(|v| v.length()).fold(0.0, f64::max);
        assert!(fastest < 1e3, "{fastest}");
    }
    assert!(!remarks.is_empty());
    assert!(
        remarks.iter().all(|remark| remark.contains("crank") || remark.contains("beyond all bounds")),
        "{remarks:?}"
    );
    remarks.len()
}

#[test]
fn drives_that_are_no_numbers_are_named() {
    let mut world = earth();
    let ball = lump(&mut world, Vec3::ZERO, 1.0, Vec3::ONE);
    // sqrt(0.01 - t)
    let root = [Operation::Number(0.01), Operation::Time, Operation::Operator(Operator::Subtract)];
    let root = Formula::new([&root[..], &[Operation::Function(Function::Sqrt)]].concat()).unwrap();
    let speed = Motor::Speed { speed: Profile::Formula(root), limit: None };
    world.add_joint(Joint::revolute(None, ball, Vec3::ZERO, Vec3::Y).with_motor(speed).named("hub")).unwrap();
    let mut stepper = stepper(5e-3, FrictionModel::Coulomb);
    let error = (0..4).find_map(|_| stepper.step(&mut world).err()).unwrap().to_string();
    assert!(error.contains("the speed or force of the motor of joint 'hub'"), "{error}");
    assert!(error.contains("from 0.01 s on"), "{error}");
}

/// An arm that rests on the stop of its hinge, with a block just above it, is pushed up by a piston from
/// below: the block holds it. (While the arm was on its stop nothing could move at the block, whose contact
/// was left out for the step.)
#[test]
fn what_a_stop_lets_go_meets_what_is_there() {
    for model in BOTH {
        let mut world = earth();
        let fixed = world.add_motion(Motion::fixed()).unwrap();
        let mut solid = |half: [f64; 3], position: [f64; 3]| {
            let form = world.add_geometry(Geometry::cuboid(half.into()).unwrap());
            world.add_body(Body::new(form, MaterialId::default(), position.into())).unwrap()
        };
        let arm = solid([0.5, 0.1, 0.05], [0.5, 0.0, 0.0]);
        let block = solid([0.1, 0.2, 0.1], [0.9, 0.0, 0.15]);
        let piston = solid([0.05, 0.05, 0.05], [0.5, 0.0, -0.1]);
        world.bodies.motion[block.index()] = fixed;
        let upward = Motion::fixed().with_free([false, false, true, false, false, false]);
        world.bodies.motion[piston.index()] = world.add_motion(upward).unwrap();
        let hinge = Joint::revolute(None, arm, Vec3::ZERO, -Vec3::Y);
        world.add_joint(hinge.with_limits(Some(0.0), None)).unwrap();
        let terms = vec![(Vec3::Z, Profile::Constant(2000.0))];
        let push = Action::Force { terms, axes: Axes::World, point: Vec3::ZERO };
        world.add_load(Load::on(piston, push)).unwrap();
        let mut stepper = stepper(2e-3, model);
        for _ in 0..200 {
            stepper.step(&mut world).unwrap();
        }
        let height = world.bodies.position[piston.index()].z;
        assert!((height + 0.1).abs() < 1e-4, "{model}: {height}");
    }
}

/// A body that came to rest at a stop, where nothing pulls it, has velocities of rounding alone: that is a
/// step that converged.
#[test]
fn what_rests_at_a_stop_has_converged() {
    let mut world = World::new(Vec3::ZERO, Materials::single("stuff", 1000.0, 0.3, 0.0).unwrap()).unwrap();
    let form = world.add_geometry(Geometry::cuboid(Vec3::new(0.2, 0.03, 0.05)).unwrap());
    let bar = Body {
        velocity: -6.0 * Vec3::Z,
        angular_velocity: 30.0 * Vec3::Y,
        ..Body::new(form, MaterialId::default(), 0.2 * Vec3::X)
    };
    let bar = world.add_body(bar).unwrap();
    world
        .add_joint(Joint::revolute(None, bar, Vec3::ZERO, Vec3::Y).with_limits(Some(-0.5), Some(1.7)))
        .unwrap();
    let mut stepper = stepper(1e-2, FrictionModel::Coulomb);
    for _ in 0..300 {
        let report = stepper.step(&mut world).unwrap();
        assert!(report.solve.converged(), "{:?}", report.solve.remark);
    }
}

/// A motor with a limit that lifts a weight, or turns a wheel, at its speed until it meets its stop: from
/// there on it pushes against the stop with all its force, and what holds the weight is both together.
#[test]
fn a_motor_with_a_limit_that_meets_its_stop_has_converged() {
    for (step, friction) in [(1e-3, FrictionModel::Relaxed), (5e-3, FrictionModel::Coulomb)] {
        for turns in [false, true] {
            let mut world = earth();
            let weight = lump(&mut world, Vec3::ZERO, 2.0, Vec3::splat(0.1));
            let joint = if turns {
                Joint::revolute(None, weight, Vec3::ZERO, Vec3::Z)
            } else {
                Joint::prismatic(None, weight, Vec3::ZERO, Vec3::Z)
            };
            let limit = Some(Profile::Constant(30.0));
            let motor = Motor::Speed { speed: Profile::Constant(1.0), limit };
            let joint = world.add_joint(joint.with_motor(motor).with_limits(None, Some(0.7))).unwrap();
            let mut stepper = stepper(step, friction);
            while world.time < 1.0 {
                let report = stepper.step(&mut world).unwrap();
                assert!(report.solve.converged(), "{} {:?}", world.time, report.solve.remark);
            }
            let state = world.joints()[joint.index()].state;
            assert!((state.coordinate - 0.7).abs() < 1e-9 && state.rate.abs() < 1e-9, "{state:?}");
            let held = if turns { 0.0 } else { 2.0 * GRAVITY };
            assert!((state.drive - held).abs() < 1e-6, "{state:?}");
        }
    }
}

/// Two wheels in gear, the one with a motor of any strength, the other with a stop or a motor of its own: at
/// the stop the motor pushes with all its force and the stop bears it; of two motors the one that the other
/// cannot hold has its speed.
#[test]
fn motors_push_against_stops_and_each_other_through_gears() {
    let speed = |speed: f64, limit: f64| Motor::Speed {
        speed: Profile::Constant(speed),
        limit: Some(Profile::Constant(limit)),
    };
    for (limit, other, step) in [
        (1e2, None, 1e-3),
        (1e6, None, 5e-3),
        (1e9, None, 1e-3),
        (1e2, Some(2.0), 1e-3),
        (1e6, Some(2.0), 5e-3),
        (1e9, Some(2.0), 1e-3),
    ] {
        let mut world = weightless();
        let [first, second] = [Vec3::ZERO, Vec3::X].map(|x| lump(&mut world, x, 1.0, Vec3::splat(0.05)));
        let a = Joint::revolute(None, first, Vec3::ZERO, Vec3::Y);
        let a = match other {
            None => a.with_limits(Some(-0.3), Some(0.3)),
            Some(own) => a.with_motor(speed(own, limit)),
        };
        let a = world.add_joint(a).unwrap();
        let b = Joint::revolute(None, second, Vec3::X, Vec3::Y).with_motor(speed(-3.0, limit));
        let b = world.add_joint(b).unwrap();
        let ratio = if other.is_none() { 1.0 } else { -0.5 };
        world.add_joint(Joint::gear([a, b], ratio)).unwrap();
        let mut stepper = stepper(step, FrictionModel::Coulomb);
        while world.time < 0.3 {
            let report = stepper.step(&mut world).unwrap();
            assert!(report.solve.converged(), "{limit} {}: {:?}", world.time, report.solve.remark);
        }
        let [a, b] = [a, b].map(|joint| world.joints()[joint.index()].state);
        assert!((b.drive + limit).abs() < 1e-9 * limit, "{b:?}");
        match other {
            None => {
                assert!((a.coordinate + 0.3).abs() < 1e-12 && a.rate.abs() < 1e-9, "{a:?}");
                assert!((a.drive - limit).abs() < 1e-9 * limit, "{a:?}");
            }
            Some(own) => {
                assert!((a.rate - own).abs() < 1e-9 && (b.rate + 0.5 * own).abs() < 1e-9, "{a:?} {b:?}");
                assert!((a.drive + 0.5 * limit).abs() < 1e-9 * limit, "{a:?}");
            }
        }
    }
}

/// Four links whose motors drive them into stops and are too weak to hold them: motors, stops and paths agree
/// in every step.
#[test]
fn motors_and_stops_of_a_chain_agree() {
    let mut world = earth();
    let mut last = None;
    for k in 0..4 {
        let ends = [0, 1].map(|end| Vec3::new(0.3 * f64::from(k + end), 0.0, 0.0));
        let link = rod(&mut world, ends, 1.0);
        let motor = Motor::Speed { speed: Profile::Constant(1.0), limit: Some(Profile::Constant(15.0)) };
        let hinge = Joint::revolute(last, link, ends[0], Vec3::Y);
        world.add_joint(hinge.with_motor(motor).with_limits(Some(-0.3), Some(0.3))).unwrap();
        last = Some(link);
    }
    let mut stepper = stepper(1e-2, FrictionModel::Coulomb);
    for step in 0..300 {
        let report = stepper.step(&mut world).unwrap();
        assert_eq!(report.solve.status, Status::Converged, "step {step}: {:?}", report.solve.remark);
    }
}

/// An arm of two links whose motors press it on a fixed block: motors do what they can, in a problem that has
/// a solution. (As rows they pressed without limit: impulses of 1e8 N s, millions of iterations, and the arm
/// was thrown.)
#[test]
fn motors_with_a_limit_press_an_arm_on_a_block() {
    let mut world = earth();
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    let block = world.add_geometry(Geometry::cuboid(Vec3::new(0.15, 0.15, 0.1)).unwrap());
    let body = Body::new(block, MaterialId::default(), Vec3::new(0.45, 0.0, 0.1));
    world.add_body(Body { motion: fixed, ..body }).unwrap();
    let link = world.add_geometry(Geometry::cuboid(Vec3::new(0.1425, 0.04, 0.02)).unwrap());
    let mut last = None;
    for (x, speed, limit) in [(0.0, 1.0, 100.0), (0.3, -0.5, 75.0)] {
        let at = Vec3::new(x + 0.15, 0.0, 0.35);
        let inertia =
            Mat3::from_diagonal(Vec3::new(0.08_f64.powi(2), 0.285_f64.powi(2), 0.285_f64.powi(2)) / 12.0);
        let mass = Some(MassProperties { mass: 1.0, inertia });
        let body = world.add_body(Body { mass, ..Body::new(link, MaterialId::default(), at) }).unwrap();
        let motor = Motor::Speed { speed: Profile::Constant(speed), limit: Some(Profile::Constant(limit)) };
        let hinge = Joint::revolute(last, body, Vec3::new(x, 0.0, 0.35), Vec3::Y);
        world.add_joint(hinge.with_motor(motor)).unwrap();
        last = Some(body);
    }
    let mut stepper = stepper(5e-3, FrictionModel::Coulomb);
    let mut iterations = 0;
    for step in 0..240 {
        let report = stepper.step(&mut world).unwrap();
        assert_eq!(report.solve.status, Status::Converged, "step {step}: {:?}", report.solve.remark);
        assert!(report.kinetic_energy < 10.0, "step {step}: {} J", report.kinetic_energy);
        iterations += report.solve.iterations;
    }
    assert!(iterations < 100_000, "{iterations}");
}
