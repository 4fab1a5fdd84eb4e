//! Without a drive the energy of a world never rises: random scenes of mixed shapes, masses over four orders
//! of magnitude, all coefficients of restitution and friction, both friction models, default solver and
//! tolerance.

use crate::joints::lump;
use crate::support::*;
use graintrain::ccp::FrictionModel;
use graintrain::handle::{BodyId, MaterialId};
use graintrain::joint::Joint;
use graintrain::load::{Action, Load};
use graintrain::material::{Materials, TurningResistance};
use graintrain::math::{Vec3, rotation_exponential};
use graintrain::measure::energy::Ledger;
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
use graintrain::world::{Body, World};

fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Fourteen bodies that fall, spin and bounce on a plane.
fn scene(seed: u64, restitution: f64, friction: f64) -> World {
    let mut next = random(seed);
    let mut materials = Materials::default();
    for (k, density) in [10.0, 1000.0, 100_000.0].into_iter().enumerate() {
        materials.add(&format!("m{k}"), density).unwrap();
    }
    for i in materials.handles() {
        for j in materials.handles() {
            materials.set_pair(i, j, friction, restitution).unwrap();
        }
    }
    let mut world = World::new(Vec3::new(0.0, 0.0, -G), materials).unwrap();
    add_ground(&mut world, 0.0);
    for k in 0..14 {
        let size = 0.05 + 0.1 * next();
        let geometry = match k % 4 {
            0 => Geometry::sphere(size),
            1 => Geometry::cuboid(Vec3::new(size, 0.7 * size, 0.5 * size)),
            2 => Geometry::capsule(size, 0.5 * size),
            _ => Geometry::cylinder(0.7 * size, 0.6 * size),
        };
        let geometry = world.add_geometry(geometry.unwrap());
        let place =
            Vec3::new(0.35 * f64::from(k % 2), 0.35 * f64::from(k / 2 % 2), 0.3 + 0.35 * f64::from(k / 4));
        let turn = Vec3::new(next(), next(), next()) * 3.0;
        let material = MaterialId::from_index((next() * 3.0) as usize);
        world
            .add_body(Body {
                orientation: rotation_exponential(turn),
                velocity: Vec3::new(next() - 0.5, next() - 0.5, -next()),
                angular_velocity: 4.0 * Vec3::new(next() - 0.5, next() - 0.5, next() - 0.5),
                ..Body::new(geometry, material, place)
            })
            .unwrap();
    }
    world
}

fn energy(world: &World) -> f64 {
    let bodies = &world.bodies;
    let height: f64 = (0..bodies.len()).map(|b| bodies.mass[b] * G * bodies.position[b].z).sum();
    world.kinetic_energy() + height
}

/// Steps of 5 ms with default solver and tolerance.
fn stepper_of(friction: FrictionModel) -> Stepper {
    let solver = SolverChoice { friction, ..SolverChoice::default() };
    Stepper::new(StepSettings { step: 5e-3, envelope: 2e-3, solver, ..StepSettings::default() }).unwrap()
}

fn worst_rise(seed: u64, restitution: f64, friction: f64, model: FrictionModel, steps: usize) -> f64 {
    let mut world = scene(seed, restitution, friction);
    let mut stepper = stepper_of(model);
    let mut worst: f64 = 0.0;
    for step in 0..steps {
        let before = energy(&world);
        let report = stepper.step(&mut world).unwrap();
        let rise = (energy(&world) - before - report.correction_energy) / before.abs();
        if rise > 1e-9 {
            println!(
                "seed {seed} e {restitution} mu {friction} {model:?} step {step}: {rise:.2e} of {before:.3} J, {} impacts, \
                 {:?} residual {:.1e}, added {}",
                report.impacts, report.solve.status, report.solve.residual.max, report.contacts_added
            );
        }
        worst = worst.max(rise);
    }
    worst
}

#[test]
fn energy_never_rises_without_a_drive() {
    let mut worst: f64 = 0.0;
    let mut seed = 0;
    for restitution in [0.0, 0.5, 0.9, 1.0] {
        for friction in [0.0, 0.3, 1.0] {
            for model in BOTH {
                seed += 1;
                worst = worst.max(worst_rise(seed, restitution, friction, model, 400));
            }
        }
    }
    assert!(worst < 1e-9, "largest rise in a step: {worst:.1e} of the energy present");
}

/// The ledger of balls closes to rounding in every step, with a drive, a load, impacts, friction, and
/// resistance to rolling and spinning; its terms have the signs that they must have, and gravity's work is
/// the fall.
#[test]
fn the_ledger_of_balls_closes_in_every_step() {
    for (model, restitution) in [(FrictionModel::Relaxed, 0.0), (FrictionModel::Coulomb, 0.6)] {
        let mut world = world(0.4, restitution);
        let (material, resistance) = (MaterialId::default(), TurningResistance::Ratio(0.1));
        world.materials.set_pair_turning(material, material, resistance, resistance).unwrap();
        let plane = world.add_geometry(Geometry::plane());
        let belt = Motion::translating(Vec3::X, Profile::Constant(0.5));
        let belt = world.add_motion(belt).unwrap();
        world.add_body(Body { motion: belt, ..Body::new(plane, MaterialId::default(), Vec3::ZERO) }).unwrap();
        let mut next = random(7);
        for k in 0..30 {
            let size = if k % 3 == 0 { 0.01 } else { 0.1 };
            let place = Vec3::new(
                0.25 * f64::from(k % 3),
                0.25 * f64::from(k / 3 % 3),
                0.15 + 0.25 * f64::from(k / 9),
            );
            let ball = add_sphere(&mut world, size, place);
            world.bodies.velocity[ball] = 3.0 * Vec3::new(next() - 0.5, next() - 0.5, next() - 0.5);
            world.bodies.angular_velocity[ball] = 9.0 * Vec3::new(next(), next(), next());
        }
        let wind = Action::Uniform {
            acceleration: [Profile::Constant(0.0), Profile::Constant(0.3), Profile::Constant(0.0)],
        };
        world.add_load(Load::on_all(wind)).unwrap();
        let settings = StepSettings {
            step: 2e-3,
            envelope: 2e-3,
            solver: SolverChoice { friction: model, ..SolverChoice::default() },
            ..StepSettings::default()
        };
        let mut stepper = Stepper::new(settings).unwrap();
        let (begin, mut sum) = (world.kinetic_energy(), Ledger::default());
        for _ in 0..400 {
            let ledger = stepper.step(&mut world).unwrap().ledger;
            assert!(ledger.rest.abs() <= 1e-10 * ledger.throughput(), "{ledger:?}");
            sum.add(&ledger);
        }
        let Ledger { gravity, loads, drives, joints: _, friction, normal, rest } = sum;
        let change = world.kinetic_energy() - begin;
        assert!(
            (change - (gravity + loads + drives - friction - normal + rest)).abs() < 1e-10 * sum.throughput()
        );
        assert!(gravity > 0.0 && loads != 0.0 && drives > 0.0 && friction > 0.0 && normal > 0.0, "{sum:?}");
    }
}

/// A ball that is driven along x and about y, and free otherwise, with and without a floor: the work of the
/// drive has what its own inertia takes.
#[test]
fn the_ledger_closes_where_bodies_are_driven_in_some_degrees() {
    for floor in [false, true] {
        let mut world = world(0.3, 0.0);
        if floor {
            add_ground(&mut world, 0.0);
        }
        let ball = add_sphere(&mut world, 0.05, Vec3::new(0.0, 0.0, 0.06));
        let growing = Profile::Table { times: vec![0.0, 1.0], values: vec![0.0, 2.0] };
        let motion = Motion::translating(Vec3::X, growing).with_free([false, true, true, true, true, true]);
        world.bodies.motion[ball] = world.add_motion(motion).unwrap();
        let mut stepper = Stepper::new(StepSettings { step: 1e-3, ..StepSettings::default() }).unwrap();
        let (mut work, mass) = (0.0, world.bodies.mass[ball]);
        for _ in 0..1000 {
            let ledger = solved_step(&mut stepper, &mut world).ledger;
            work += ledger.drives;
            assert!(ledger.rest.abs() < 1e-11 * mass, "{ledger:?}");
        }
        let own = 0.5 * mass * world.bodies.velocity[ball].x.powi(2);
        assert!(if floor { work > own } else { (work - own).abs() < 1e-9 * own }, "{floor} {work} {own}");
    }
}

/// The scene of this seed with joints of every kind between neighbours.
fn jointed(seed: u64, restitution: f64, friction: f64) -> World {
    let mut world = scene(seed, restitution, friction);
    let mut next = random(seed + 1000);
    for k in (1..world.bodies.len() - 1).filter(|k| k % 4 != 0) {
        let [a, b] = [k, k + 1].map(BodyId::from_index);
        let [at, to] = [k, k + 1].map(|body| world.bodies.position[body]);
        let (point, axis) = (0.5 * (at + to), Vec3::new(next() - 0.5, next() - 0.5, next() - 0.5));
        let joint = match (5.0 * next()) as usize {
            0 => Joint::spherical(Some(a), b, point),
            1 => Joint::revolute(Some(a), b, point, axis),
            2 => Joint::prismatic(Some(a), b, point, axis),
            3 => Joint::distance(Some(a), b, [at, to]),
            _ => Joint::fixed(Some(a), b, point),
        };
        world.add_joint(joint).unwrap();
    }
    world
}

/// With joints too, light bodies beside heavy ones that turn by up to a radian in a step: what energy gains
/// over steps that converge (heights between two steps, where velocities belong to) stays below a 200th of
/// what was there, with relaxed friction below a twentieth. (A step in which a body turns by more than that
/// opens its joints and says so, and may gain more.) Velocities that do not lie along the joints, where
/// impacts find them, gave twenty times of it.
#[test]
fn energy_never_rises_with_joints() {
    let mut worst = 0.0_f64;
    for seed in 1..=20 {
        let model = BOTH[seed as usize % 2];
        let restitution = [0.0, 0.5, 0.9][seed as usize % 3];
        let mut world = jointed(seed, restitution, 0.3);
        let mut stepper = stepper_of(model);
        let (mut first, mut least, mut rise, mut open, mut unconverged) =
            (f64::NAN, f64::INFINITY, 0.0_f64, 0.0_f64, 0);
        let mut corrected = 0.0;
        for _ in 0..400 {
            let before = energy(&world) - world.kinetic_energy();
            let report = stepper.step(&mut world).unwrap();
            let after = energy(&world) - world.kinetic_energy();
            corrected += report.correction_energy;
            let now = world.kinetic_energy() + 0.5 * (before + after) - corrected;
            first = if first.is_nan() { now } else { first };
            least = if report.solve.converged() { least.min(now) } else { now };
            rise = rise.max((now - least) / first.abs());
            if report.solve.converged() {
                open = open.max(report.errors.joint_opening_max);
            }
            unconverged += usize::from(!report.solve.converged());
        }
        let bound = if model == FrictionModel::Relaxed { 0.05 } else { 0.005 };
        assert!(rise < bound, "seed {seed}, {model:?}, e = {restitution}: {rise:.1e} of {first:.1e} J");
        assert!(
            open < 1e-3,
            "seed {seed}, {model:?}, e = {restitution}: {open:.1e} m in a step that converged"
        );
        assert!(
            unconverged < 150,
            "seed {seed}, {model:?}, e = {restitution}: {unconverged} steps unconverged"
        );
        worst = worst.max(rise);
    }
    println!("largest rise {worst:.1e}");
}

/// One to five bodies that hang on hinges, balls and rods, some of them spinning.
fn mechanism(seed: u64) -> World {
    let mut next = random(seed);
    let mut world = world(0.0, 0.0);
    let mut vector = move |size: f64| {
        let unit = rotation_exponential(6.0 * Vec3::new(next() - 0.5, next() - 0.5, next() - 0.5)) * Vec3::X;
        (size * unit, next())
    };
    let mut last: Option<BodyId> = None;
    for k in 0..1 + seed as usize % 5 {
        let at = last.map_or(Vec3::ZERO, |body| world.bodies.position[body.index()]);
        let (way, share) = vector(0.25);
        let place = at + (0.6 + 0.8 * share) * way;
        let ((axis, weight), (spin, slimness)) =
            (vector(1.0), vector([0.0, 3.0, 15.0][(seed as usize + k) % 3]));
        let mass = 10_f64.powf(2.0 * weight - 1.0);
        let body = lump(&mut world, place, mass, mass * Vec3::splat(0.002 + 0.018 * slimness));
        world.bodies.angular_velocity[body.index()] = spin;
        let pin = at.lerp(place, 0.3);
        let (aside, which) = vector(0.05);
        let joint = match (3.0 * which) as usize {
            0 => Joint::spherical(last, body, pin),
            1 => Joint::revolute(last, body, pin, axis),
            _ => Joint::distance(last, body, [at + 0.7 * aside, place + aside]),
        };
        world.add_joint(joint).unwrap();
        last = Some(body);
    }
    world
}

/// Mechanisms that swing as fast as they like for 20 s keep or lose energy, whatever the step resolves of
/// their swings: the mean over a second (heights between two steps) never rises by more than 6 % of the most
/// that there is in steps of 1 ms.
#[test]
fn mechanisms_gain_no_energy() {
    let trace = |seed: u64, step: f64| {
        let mut world = mechanism(seed);
        let settings = StepSettings { step, ..StepSettings::default() };
        let mut stepper = Stepper::new(settings).unwrap();
        let (mut kinetic, mut means, per) = (0.0_f64, Vec::new(), (1.0 / step).round() as usize);
        for _ in 0..if step > 2e-3 { 20 } else { 3 } {
            let mut sum = 0.0;
            for _ in 0..per {
                let before = energy(&world) - world.kinetic_energy();
                stepper.step(&mut world).unwrap();
                let after = energy(&world) - world.kinetic_energy();
                kinetic = kinetic.max(world.kinetic_energy());
                sum += world.kinetic_energy() + 0.5 * (before + after);
            }
            means.push(sum / per as f64);
        }
        (means, kinetic)
    };
    for seed in 0..30 {
        let (_, most) = trace(seed, 1e-3);
        for step in [1e-2, 2e-2] {
            let (means, _) = trace(seed, step);
            let rise = means.iter().fold(0.0_f64, |rise, mean| rise.max((mean - means[0]) / most));
            assert!(rise < 0.06, "seed {seed}, {step} s: {rise:.3}");
        }
    }
}
