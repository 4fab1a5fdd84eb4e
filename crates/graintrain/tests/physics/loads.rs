//! Loads against closed forms of the integrator, and their work against the kinetic energy.

use crate::support::*;
use graintrain::ccp::FrictionModel;
use graintrain::ccp::FrictionModel::{Coulomb, Relaxed};
use graintrain::formula::{Formula, Function, Operation, Operator};
use graintrain::handle::{BodyId, MaterialId};
use graintrain::load::{Action, Load, Region};
use graintrain::material::Materials;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::{Axes, Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
use graintrain::world::{Body, World};
use std::f64::consts::TAU;

fn stepper(step: f64, friction: FrictionModel) -> Stepper {
    Stepper::new(StepSettings {
        step,
        envelope: 1e-4,
        solver: SolverChoice { tolerance: 1e-9, friction, ..SolverChoice::default() },
        ..StepSettings::default()
    })
    .unwrap()
}

fn weightless() -> World {
    World::new(Vec3::ZERO, Materials::single("stuff", 1000.0, 0.5, 0.0).unwrap()).unwrap()
}

fn add_brick(world: &mut World, half: Vec3, position: Vec3) -> BodyId {
    let geometry = world.add_geometry(Geometry::cuboid(half).unwrap());
    world.add_body(Body::new(geometry, MaterialId::default(), position)).unwrap()
}

fn force(terms: Vec<(Vec3, Profile)>) -> Action {
    Action::Force { terms, axes: Axes::World, point: Vec3::ZERO }
}

/// amplitude sin(rate t)
fn sine(amplitude: f64, rate: f64) -> Profile {
    use Operation::{Function as F, Number, Operator as O, Time};
    let multiply = O(Operator::Multiply);
    let operations = vec![Number(amplitude), Number(rate), Time, multiply, F(Function::Sin), multiply];
    Profile::Formula(Formula::new(operations).unwrap())
}

/// A force F sin(w t) on a free body: the impulse of every step is exact, u_n = F / (m w) (1 - cos n w dt),
/// and x_n = sum_k dt (u_k-1 + u_k) / 2 = dt F / (m w) (n - sum_k cos k w dt - (1 - cos n w dt) / 2), a
/// geometric sum.
#[test]
fn a_sinusoidal_force_moves_as_the_closed_form_of_the_integrator() {
    let (step, period, amplitude) = (2e-3, 0.7, 30.0);
    let rate = TAU / period;
    for profile in [Profile::Sinusoidal { amplitude, period, phase: 0.0 }, sine(amplitude, rate)] {
        let mut world = weightless();
        let body = add_sphere(&mut world, 0.1, Vec3::ZERO);
        world.add_load(Load::on(BodyId::from_index(body), force(vec![(Vec3::Y, profile)]))).unwrap();
        let mass = world.bodies.mass[body];
        let mut stepper = stepper(step, Relaxed);
        let mut work = 0.0;
        for n in 1..=1000 {
            work += stepper.step(&mut world).unwrap().ledger.loads;
            let (n, angle) = (f64::from(n), rate * step);
            let scale = amplitude / (mass * rate);
            let cosines = (0.5 * n * angle).sin() * (0.5 * (n + 1.0) * angle).cos() / (0.5 * angle).sin();
            let velocity = scale * (1.0 - (n * angle).cos());
            assert!((world.bodies.velocity[body].y - velocity).abs() < 1e-12 * scale, "{n}");
            let way = step * (scale * (n - cosines) - 0.5 * velocity);
            assert!((world.bodies.position[body].y - way).abs() < 1e-11 * scale);
            assert!((work - world.kinetic_energy()).abs() < 1e-12 * mass * scale * scale);
        }
    }
}

/// In body axes, at a point: a thruster that turns with a disc on an axle gives the constant torque r F.
#[test]
fn a_force_in_body_axes_at_a_point_turns_a_body_on_an_axle() {
    let mut world = weightless();
    let geometry = world.add_geometry(Geometry::cylinder(0.05, 0.3).unwrap());
    let axle =
        world.add_motion(Motion::fixed().with_free([false, false, false, false, false, true])).unwrap();
    let orientation = Quat::from_rotation_z(0.4);
    let disc = world
        .add_body(Body { motion: axle, orientation, ..Body::new(geometry, MaterialId::default(), Vec3::ONE) })
        .unwrap();
    let action = Action::Force {
        terms: vec![(Vec3::Y, Profile::Constant(2.0))],
        axes: Axes::Body,
        point: Vec3::new(0.3, 0.0, 0.02),
    };
    world.add_load(Load::on(disc, action)).unwrap();
    let torque = Action::Torque { terms: vec![(Vec3::Z, Profile::Constant(0.1))], axes: Axes::Body };
    world.add_load(Load::on(disc, torque)).unwrap();
    let mut stepper = stepper(1e-3, Relaxed);
    let mut work = 0.0;
    for _ in 0..2000 {
        work += stepper.step(&mut world).unwrap().ledger.loads;
    }
    let spin = 2.0 * (0.3 * 2.0 + 0.1) / world.bodies.inertia[0].z_axis.z;
    assert!((world.bodies.angular_velocity[0] - spin * Vec3::Z).length() < 1e-11 * spin);
    assert!((work / world.kinetic_energy() - 1.0).abs() < 1e-11, "{work}");
    assert_eq!(world.bodies.position[0], Vec3::ONE);
}

/// A floor carries the weight under a gravity that changes, and a load on top of it, at every step.
#[test]
fn a_floor_carries_changing_gravity_and_load() {
    for model in [FrictionModel::Relaxed, FrictionModel::Coulomb] {
        let mut world = world(0.5, 0.0);
        let floor = add_ground(&mut world, 0.0);
        let half = Vec3::splat(0.1);
        let body = add_brick(&mut world, half, Vec3::new(0.0, 0.0, 0.1));
        let table = Profile::Table { times: vec![0.0, 0.1], values: vec![-9.0, -3.0] };
        let zero = || Profile::Constant(0.0);
        world.set_gravity_of_time([zero(), zero(), table.clone()]).unwrap();
        let press = Profile::Table { times: vec![0.05, 0.1], values: vec![0.0, 400.0] };
        world.add_load(Load::on(body, force(vec![(-Vec3::Z, press.clone())]))).unwrap();
        let (mass, step) = (world.bodies.mass[body.index()], 1e-3);
        let mut stepper = stepper(step, model);
        for _ in 0..150 {
            let time = world.time;
            let report = stepper.step(&mut world).unwrap();
            assert!(report.solve.converged());
            let expected = mass * table.mean(time, step) - press.mean(time, step);
            let found = report.wrenches.iter().find(|w| w.body == floor).unwrap().force.z;
            assert!(
                (found / expected - 1.0).abs() < 1e-6,
                "{model:?} at {time}: {found} N, not {expected} N"
            );
        }
        assert_eq!(world.bodies.force[body.index()], Vec3::ZERO, "loads are gone after the step");
    }
}

/// Linear drag alone is backward Euler, u_n = u_0 (1 + dt c / m)^-n, quadratic drag alone the exact u_0 /
/// (1 + q u_0 t / m); no drag turns a body back, however strong; and its work is what the body loses.
#[test]
fn drag_is_an_implicit_step() {
    let step = 1e-2;
    for (linear, quadratic) in [(3.0, 0.0), (0.0, 20.0), (1.0, 5.0), (1e9, 0.0), (0.0, 1e12)] {
        let mut world = weightless();
        let medium = Vec3::new(1.0, 0.0, 0.0);
        let body = add_sphere(&mut world, 0.05, Vec3::ZERO);
        world.bodies.velocity[body] = Vec3::new(4.0, 4.0, 0.0);
        world.bodies.angular_velocity[body] = Vec3::new(0.0, 0.0, 7.0);
        let action = Action::Drag { linear, quadratic, angular: 1e-3, medium };
        world.add_load(Load::on_all(action)).unwrap();
        let (mass, inertia) = (world.bodies.mass[body], world.bodies.inertia[body].x_axis.x);
        let mut stepper = stepper(step, Relaxed);
        let (mut energy, mut speed, mut spin) = (world.kinetic_energy(), 5.0, 7.0);
        for _ in 0..50 {
            let report = stepper.step(&mut world).unwrap();
            let relative = world.bodies.velocity[body] - medium;
            let s = relative.length();
            let coefficient = linear + quadratic * speed;
            let expected = speed / (1.0 + step * coefficient / mass);
            assert!((s - expected).abs() <= 1e-14, "{linear} {quadratic}: {s} for {expected}");
            assert!(relative.dot(Vec3::new(3.0, 4.0, 0.0)) >= -1e-12, "turned back: {relative}");
            spin /= 1.0 + step * 1e-3 / inertia;
            assert!((world.bodies.angular_velocity[body].z - spin).abs() < 1e-12 * 7.0);
            let now = world.kinetic_energy();
            let rounding = 1e-12 * energy.max(now) + step * coefficient * 1e-15;
            assert!((report.ledger.loads - (now - energy)).abs() < rounding, "{linear} {quadratic}");
            (energy, speed) = (now, s);
        }
    }
    // What falls reaches c u = m g.
    let mut world = world(0.3, 0.0);
    let body = add_sphere(&mut world, 0.05, Vec3::new(0.0, 0.0, 1e3));
    let mass = world.bodies.mass[body];
    let action = Action::Drag { linear: 2.0, quadratic: 0.0, angular: 0.0, medium: Vec3::ZERO };
    world.add_load(Load::on_all(action)).unwrap();
    let mut stepper = stepper(1e-3, Relaxed);
    for _ in 0..5000 {
        stepper.step(&mut world).unwrap();
    }
    let terminal = mass * G / 2.0;
    let found = -world.bodies.velocity[body].z;
    assert!((found / terminal - 1.0).abs() < 1e-6, "{found} of {terminal}");
}

/// Drag that would stop a body within a hundredth of a step: what falls reaches the speed at which it is
/// carried, at once where drag is linear, and a wind presses a block against a wall with its whole force.
/// Both friction modes, step by step.
#[test]
fn strong_drag_carries_and_presses() {
    for friction in [Relaxed, Coulomb] {
        for (linear, quadratic) in [(300.0, 0.0), (0.0, 100.0)] {
            let step = 2e-2;
            let mut world = world(0.3, 0.0);
            add_ground(&mut world, 0.0);
            let ball = add_sphere(&mut world, 0.05, Vec3::new(0.0, 0.0, 1e3));
            let held = add_sphere(&mut world, 0.05, Vec3::new(1.0, 0.0, 0.05));
            let fall = Action::Drag { linear, quadratic, angular: 0.0, medium: Vec3::ZERO };
            let wind = Vec3::new(0.0, 0.0, -8.0);
            let press = Action::Drag { linear, quadratic, angular: 0.1, medium: wind };
            world.add_load(Load::on(BodyId::from_index(ball), fall)).unwrap();
            world.add_load(Load::on(BodyId::from_index(held), press)).unwrap();
            let weight = G * world.bodies.mass[ball];
            let terminal = if linear > 0.0 { weight / linear } else { (weight / quadratic).sqrt() };
            let pressed = (linear + quadratic * 8.0) * 8.0 + G * world.bodies.mass[held];
            let mut stepper = stepper(step, friction);
            for k in 0..60 {
                let report = stepper.step(&mut world).unwrap();
                let speed = -world.bodies.velocity[ball].z;
                // The quadratic one comes there in an oscillation that halves.
                if k > 40 || linear > 0.0 && k > 3 {
                    assert!((speed / terminal - 1.0).abs() < 1e-3, "step {k}: {speed} of {terminal}");
                }
                let floor = report.wrenches.iter().map(|w| w.force.length()).fold(0.0, f64::max);
                assert!((floor / pressed - 1.0).abs() < 1e-4, "step {k}: {floor} of {pressed}");
            }
        }
    }
}

/// Drags on one body add: three that would each stop it do not throw it back.
#[test]
fn several_drags_do_not_turn_a_body_back() {
    for linear in [10.0, 1e9] {
        let mut world = weightless();
        let body = add_sphere(&mut world, 0.05, Vec3::ZERO);
        world.bodies.velocity[body] = Vec3::new(4.0, 0.0, 0.0);
        world.bodies.angular_velocity[body] = Vec3::new(0.0, 0.0, 7.0);
        for _ in 0..3 {
            let medium = Vec3::ZERO;
            world
                .add_load(Load::on_all(Action::Drag { linear, quadratic: 0.0, angular: linear, medium }))
                .unwrap();
        }
        let (mass, inertia) = (world.bodies.mass[body], world.bodies.inertia[body].x_axis.x);
        stepper(0.01, Relaxed).step(&mut world).unwrap();
        let expected = [4.0 / (1.0 + 0.03 * linear / mass), 7.0 / (1.0 + 0.03 * linear / inertia)];
        let found = [world.bodies.velocity[body].x, world.bodies.angular_velocity[body].z];
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{linear}: {found} for {expected}");
        }
    }
}

/// A central field with power 1 is a spring; semi-implicit Euler turns by the angle a with 2 - 2 cos a = w^2
/// dt^2 per step.
#[test]
fn a_central_field_of_power_one_is_an_oscillator() {
    let mut world = weightless();
    let centre = Vec3::new(0.5, 0.0, 0.0);
    let body = add_sphere(&mut world, 0.1, centre + Vec3::Z);
    let action = Action::Central { centre, strength: 25.0, distance: 1.0, power: 1.0 };
    world.add_load(Load::on_all(action)).unwrap();
    let step = 0.01;
    let mut stepper = stepper(step, Relaxed);
    let cosine = 1.0 - 0.5 * 25.0 * step * step;
    let (angle, b) = (cosine.acos(), (cosine - 1.0) / (1.0 - cosine * cosine).sqrt());
    for n in 1..=500 {
        stepper.step(&mut world).unwrap();
        let phase = f64::from(n) * angle;
        let z = phase.cos() + b * phase.sin();
        assert!((world.bodies.position[body] - centre - z * Vec3::Z).length() < 1e-11, "{n}");
    }
    // At the centre itself nothing acts.
    world.bodies.position[body] = centre;
    world.bodies.velocity[body] = Vec3::ZERO;
    stepper.step(&mut world).unwrap();
    assert_eq!(world.bodies.position[body], centre);
}

/// Uniform fields act on masses alike; a region only inside; removed bodies take their loads along.
#[test]
fn fields_regions_and_removal() {
    let mut world = weightless();
    let light = add_sphere(&mut world, 0.01, Vec3::ZERO);
    let heavy = add_sphere(&mut world, 1.0, Vec3::new(5.0, 0.0, 0.0));
    let acceleration = [0.0, 0.0, 2.0].map(Profile::Constant);
    world.add_load(Load::on_all(Action::Uniform { acceleration })).unwrap();
    let lift = force(vec![(Vec3::Y, Profile::Constant(1.0))]);
    let near = Region::Cylinder { base: Vec3::new(0.0, 0.0, -1.0), radius: 1.0, height: 2.0 };
    world.add_load(Load { bodies: None, region: Some(near), action: lift.clone() }).unwrap();
    world.add_load(Load::on(BodyId::from_index(heavy), lift.clone())).unwrap();
    assert!(world.add_load(Load::on(BodyId::from_index(9), lift)).is_err());
    let mut stepper = stepper(0.01, Relaxed);
    stepper.step(&mut world).unwrap();
    let (m, v) = (world.bodies.mass.clone(), world.bodies.velocity.clone());
    for body in [light, heavy] {
        let expected = 0.01 * Vec3::new(0.0, 1.0 / m[body], 2.0);
        assert!((v[body] - expected).length() < 1e-15 * expected.length().max(1.0), "{body}");
    }
    world.remove_bodies(|body| body == light);
    stepper.step(&mut world).unwrap();
    assert!((world.bodies.velocity[0].y - 0.02 / m[heavy]).abs() < 1e-15);
    world.remove_bodies(|_| true);
    stepper.step(&mut world).unwrap();
}

/// Loads come on top of what a program has set, which is there again after the step, made or not.
#[test]
fn loads_add_to_the_forces_of_a_program() {
    let mut world = weightless();
    let body = add_sphere(&mut world, 0.1, Vec3::ZERO);
    let own = Vec3::new(0.1, 0.2, 0.3);
    world.bodies.force[body] = own;
    world.add_load(Load::on_all(force(vec![(Vec3::X, Profile::Constant(7.0))]))).unwrap();
    let mut stepper = stepper(0.1, Relaxed);
    stepper.step(&mut world).unwrap();
    let expected = 0.1 / world.bodies.mass[body] * (own + 7.0 * Vec3::X);
    assert!((world.bodies.velocity[body] - expected).length() < 1e-15);
    assert_eq!(world.bodies.force[body], own);
    // The root of a negative number is none: the step says so and changes nothing.
    let root = vec![Operation::Number(-1.0), Operation::Function(Function::Sqrt)];
    let root = Profile::Formula(Formula::new(root).unwrap());
    world.add_load(Load::on_all(force(vec![(Vec3::X, root)]))).unwrap();
    let before = world.clone();
    let error = stepper.step(&mut world).unwrap_err().to_string();
    assert!(error.contains("external force of body 0"), "{error}");
    assert_eq!(world, before);
}

/// Constant loads are no reason to look for contacts twice, and bits do not depend on how a force is given to
/// what lies on something. (In flight a program's force may be one of the place.)
#[test]
fn a_constant_load_has_the_bits_of_a_force_of_a_program() {
    let mut worlds = [world(0.4, 0.0), world(0.4, 0.0)];
    for (k, world) in worlds.iter_mut().enumerate() {
        add_ground(world, 0.1);
        let brick = add_brick(world, Vec3::new(0.1, 0.07, 0.05), Vec3::new(0.0, 0.0, 0.08));
        let mut stepper = stepper(2e-3, FrictionModel::Coulomb);
        for _ in 0..100 {
            stepper.step(world).unwrap();
        }
        let push = Vec3::new(3.0, -2.0, 1.0);
        if k == 0 {
            world.bodies.force[brick.index()] = push;
        } else {
            let terms = vec![(push, Profile::Constant(1.0))];
            world.add_load(Load::on(brick, force(terms))).unwrap();
        }
        for _ in 0..200 {
            stepper.step(world).unwrap();
        }
    }
    let [own, loaded] = worlds;
    assert_eq!(own.bodies.position, loaded.bodies.position);
    assert_eq!(own.bodies.velocity, loaded.bodies.velocity);
}
