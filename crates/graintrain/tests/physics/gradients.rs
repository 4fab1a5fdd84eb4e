//! Derivatives of a step against central differences of steps, on eleven scenes; what happens at kinks.

use graintrain::ccp::FrictionModel;
use graintrain::ccp::sensitivity::ContactState::{self, Apart, Sliding, Sticking};
use graintrain::gradient::{GradientError, StepGradient};
use graintrain::handle::{BodyId, GeometryId, MaterialId};
use graintrain::load::{Action, Load};
use graintrain::material::Materials;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::{Motion, Profile};
use graintrain::shape::{Geometry, Part, Shape, Sphere};
use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
use graintrain::world::{Body, World};

const DT: f64 = 1e-2;

/// A world with the ground at z = 0 and two materials.
fn ground(friction: f64, gravity: Vec3) -> World {
    let mut materials = Materials::default();
    let (earth, stone) = (materials.add("earth", 1000.0).unwrap(), materials.add("stone", 1000.0).unwrap());
    for (a, b) in [(earth, earth), (earth, stone), (stone, stone)] {
        materials.set_pair(a, b, friction, 0.0).unwrap();
    }
    let mut world = World::new(gravity, materials).unwrap();
    let plane = world.add_geometry(Geometry::plane());
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    world.add_body(Body { motion: fixed, ..Body::new(plane, earth, Vec3::ZERO) }).unwrap();
    world
}

const DOWN: Vec3 = Vec3::new(0.0, 0.0, -9.81);
const STONE: MaterialId = MaterialId::from_index(1);

fn add(world: &mut World, geometry: Geometry, position: Vec3, velocity: Vec3) -> BodyId {
    let geometry: GeometryId = world.add_geometry(geometry);
    world.add_body(Body { velocity, ..Body::new(geometry, STONE, position) }).unwrap()
}

fn ball(world: &mut World, x: f64, z: f64, velocity: Vec3) -> BodyId {
    add(world, Geometry::sphere(0.1).unwrap(), Vec3::new(x, 0.0, z), velocity)
}

fn cuboid(world: &mut World, position: Vec3, velocity: Vec3) -> BodyId {
    add(world, Geometry::cuboid(Vec3::new(0.1, 0.08, 0.05)).unwrap(), position, velocity)
}

/// Eleven states with the states of contacts that they are there for.
fn scenes() -> Vec<(&'static str, World, Vec<ContactState>)> {
    let mut all = Vec::new();
    let mut world = ground(0.5, DOWN);
    ball(&mut world, 0.0, 0.1, Vec3::new(0.05, 0.02, 0.0));
    all.push(("a ball that rolls", world, vec![Sticking]));

    let mut world = ground(0.2, DOWN);
    ball(&mut world, 0.0, 0.1, Vec3::new(1.5, -0.4, 0.0));
    all.push(("a ball that slides", world, vec![Sliding]));

    let mut world = ground(0.3, DOWN);
    ball(&mut world, 0.0, 0.1, Vec3::new(0.1, 0.0, 0.8));
    ball(&mut world, 0.5, 0.1, Vec3::new(0.0, 1.0, 0.0));
    all.push(("one parts, one slides", world, vec![Apart, Sliding]));

    let mut world = ground(0.4, Vec3::new(2.0, 1.0, -9.0));
    cuboid(&mut world, Vec3::new(0.0, 0.0, 0.05), Vec3::ZERO);
    all.push(("a box at rest on four corners, impulses not unique", world, vec![Sticking]));

    let mut world = ground(0.3, DOWN);
    let body = cuboid(&mut world, Vec3::new(0.0, 0.0, 0.05), Vec3::new(1.0, 0.3, 0.0));
    world.bodies.angular_velocity[body.index()] = Vec3::new(0.0, 0.0, 0.7);
    all.push(("a box that slides and turns", world, vec![Sliding]));

    let mut world = ground(0.5, DOWN);
    for (x, z) in [(-0.1, 0.1), (0.1, 0.1), (0.0, 0.1 + 0.03_f64.sqrt())] {
        ball(&mut world, x, z, Vec3::new(0.02 * z, 0.01, 0.0));
    }
    all.push(("three balls in a pile", world, vec![Sticking]));

    // Spinning bodies whose inertia is not that of a ball.
    let mut world = ground(0.3, DOWN);
    let capsule = Geometry::capsule(0.1, 0.05).unwrap();
    let body = add(&mut world, capsule, Vec3::new(0.0, 0.0, 0.05), Vec3::new(0.4, 0.3, 0.0));
    world.bodies.orientation[body.index()] = Quat::from_rotation_y(std::f64::consts::FRAC_PI_2);
    world.bodies.angular_velocity[body.index()] = Vec3::new(2.0, 0.1, 3.0);
    all.push(("a capsule that spins", world, vec![Sliding]));

    // A blade pushes a ball that lies in front of it; another one hangs on a rail and may turn about two
    // axes.
    let mut world = ground(0.35, DOWN);
    let blade = world.add_geometry(Geometry::cuboid(Vec3::new(0.02, 0.3, 0.3)).unwrap());
    let drive = world.add_motion(Motion::translating(Vec3::X, Profile::Constant(0.5))).unwrap();
    world.add_body(Body { motion: drive, ..Body::new(blade, STONE, Vec3::new(0.0, 0.0, 0.31)) }).unwrap();
    ball(&mut world, 0.12, 0.1, Vec3::new(0.2, 0.05, 0.0));
    let rail = Motion::fixed().with_free([true, false, true, false, true, true]);
    let rail = world.add_motion(rail).unwrap();
    let brick = world.add_geometry(Geometry::cuboid(Vec3::new(0.1, 0.08, 0.05)).unwrap());
    let body = Body {
        motion: rail,
        velocity: Vec3::new(0.6, 0.0, 0.0),
        angular_velocity: Vec3::new(0.0, 0.0, 1.0),
        ..Body::new(brick, STONE, Vec3::new(2.0, 0.0, 0.05))
    };
    world.add_body(body).unwrap();
    all.push(("a blade, a ball, a box on a rail", world, vec![Sliding]));

    // Dumbbells of unequal balls, with forces from outside.
    let mut world = ground(0.6, DOWN);
    let part = |x: f64, radius: f64| Part {
        shape: Shape::Sphere(Sphere { radius }),
        position: Vec3::new(x, 0.0, 0.0),
        orientation: Quat::IDENTITY,
    };
    let (dumbbell, center) = Geometry::compound(vec![part(0.0, 0.1), part(0.3, 0.1)]).unwrap();
    let place = Vec3::new(0.0, 0.0, 0.1) + center;
    let body = add(&mut world, dumbbell, place, Vec3::new(0.0, 0.5, 0.0)).index();
    world.bodies.force[body] = Vec3::new(3.0, -20.0, 1.0);
    world.bodies.torque[body] = Vec3::new(0.1, 0.2, 0.3);
    all.push(("a dumbbell that is pushed", world, vec![Sliding]));

    // On a turntable: a ball that slides, a box that sticks.
    let mut world = ground(0.5, DOWN);
    let turning = Motion::rotating(Vec3::ZERO, Vec3::Z, Profile::Constant(4.0));
    world.bodies.motion[0] = world.add_motion(turning).unwrap();
    ball(&mut world, 0.5, 0.1, Vec3::new(0.7, -0.2, 0.0));
    let body = cuboid(&mut world, Vec3::new(0.0, 0.2, 0.05), Vec3::new(-0.8, 0.0, 0.0));
    world.bodies.angular_velocity[body.index()] = Vec3::new(0.0, 0.0, 4.0);
    all.push(("on a turntable", world, vec![Sliding, Sticking]));

    // Mass ratio 1e6, and a frictionless pair.
    let mut world = ground(0.3, DOWN);
    world.materials.set_pair(MaterialId::from_index(0), STONE, 0.0, 0.0).unwrap();
    ball(&mut world, 0.0, 0.1, Vec3::new(0.3, 0.0, 0.0));
    let small = Geometry::sphere(0.001).unwrap();
    add(&mut world, small, Vec3::new(0.0, 0.0, 0.201), Vec3::new(0.9, 0.2, 0.0));
    all.push(("a grain on a large ball on ice", world, vec![Sliding]));
    all
}

fn step_settings() -> StepSettings {
    let solver = SolverChoice { friction: FrictionModel::Relaxed, ..SolverChoice::default() };
    StepSettings { step: DT, envelope: 1e-3, solver, ..StepSettings::default() }
}

/// The velocities after a step, from a tight solve.
fn after(world: &World) -> Vec<f64> {
    let mut world = world.clone();
    let solver = SolverChoice {
        friction: FrictionModel::Relaxed,
        name: "ipm".parse().unwrap(),
        tolerance: 1e-11,
        criterion: graintrain::ccp::Criterion::Maximum,
        ..SolverChoice::default()
    };
    let settings = StepSettings { solver, ..step_settings() };
    Stepper::new(settings).unwrap().step(&mut world).unwrap();
    graintrain::integrate::velocities(&world)
}

/// Numbers in [-1, 1] that are the same in every run.
fn weights(count: usize) -> Vec<f64> {
    (0..count).map(|k| ((k as f64 + 1.0) * 0.754_877_666).fract() * 2.0 - 1.0).collect()
}

fn differences(world: &World, weight: &[f64], h: f64, change: impl Fn(&mut World, f64)) -> f64 {
    let at = |x: f64| {
        let mut world = world.clone();
        change(&mut world, x);
        after(&world)
    };
    let (up, down) = (at(h), at(-h));
    up.iter().zip(&down).zip(weight).map(|((a, b), w)| w * (a - b)).sum::<f64>() / (2.0 * h)
}

#[test]
fn derivatives_of_eleven_scenes_are_those_of_central_differences() {
    for (name, world, wanted) in scenes() {
        let mut gradient =
            StepGradient::new(&world, &step_settings()).unwrap_or_else(|error| panic!("{name}: {error}"));
        let states: Vec<ContactState> = gradient.states().collect();
        for state in wanted {
            assert!(states.contains(&state), "{name}: {states:?}");
        }
        let weight = weights(6 * world.bodies.len());
        let pulled = gradient.pull_back(&weight).unwrap();
        let mut worst = 0.0_f64;
        let mut compare = |what: &str, got: f64, expected: f64, size: f64| {
            let error = (got - expected).abs() / size.max(expected.abs());
            assert!(error < 1e-5, "{name}: by {what}: {got} against {expected}");
            worst = worst.max(error);
        };
        for body in 0..world.bodies.len() {
            for axis in 0..3 {
                let label = |what: &str| format!("{what} {axis} of body {body}");
                let by = |h: f64, list: fn(&mut World) -> &mut Vec<Vec3>| {
                    differences(&world, &weight, h, |world, x| list(world)[body][axis] += x)
                };
                let k = 6 * body + axis;
                compare(&label("velocity"), pulled.velocity[k], by(1e-5, |w| &mut w.bodies.velocity), 1.0);
                let spin = by(1e-5, |w| &mut w.bodies.angular_velocity);
                compare(&label("angular velocity"), pulled.velocity[k + 3], spin, 0.1);
                // Forces in units of the weight.
                let weight = 10.0 * world.bodies.mass[body].max(1e-9);
                let force = by(1e-4 * weight, |w| &mut w.bodies.force);
                compare(&label("force"), pulled.force[k] * weight, force * weight, 0.1);
                let moment = 0.1 * weight * if world.bodies.mass[body] < 0.01 { 0.01 } else { 1.0 };
                let torque = by(1e-4 * moment, |w| &mut w.bodies.torque);
                compare(&label("torque"), pulled.force[k + 3] * moment, torque * moment, 0.1);
            }
        }
        let pairs = gradient.by_materials(&pulled.friction);
        let handles: Vec<MaterialId> = world.materials.handles().collect();
        for (i, &a) in handles.iter().enumerate() {
            for (j, &b) in handles.iter().enumerate().skip(i) {
                let mu = world.materials.pair_friction(i, j);
                if mu == 0.0 {
                    continue;
                }
                let expected = differences(&world, &weight, 1e-6, |world, x| {
                    world.materials.set_pair(a, b, mu + x, 0.0).unwrap();
                });
                compare(&format!("friction of pair {i}, {j}"), pairs[i * handles.len() + j], expected, 0.1);
            }
        }
        println!("{name}: {states:?}, largest difference {worst:.1e}");
    }
}

#[test]
fn kinks_and_what_has_no_derivative_are_reported() {
    let refused = |world: &World, settings: &StepSettings, words: &str| {
        let error = StepGradient::new(world, settings).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    // Pushed along exactly as hard as friction holds.
    let mut world = ground(0.5, DOWN);
    let motion =
        world.add_motion(Motion::fixed().with_free([true, false, true, false, false, false])).unwrap();
    let block = world.add_geometry(Geometry::sphere(0.1).unwrap());
    let at = Vec3::new(0.0, 0.0, 0.1);
    world.add_body(Body { motion, ..Body::new(block, STONE, at) }).unwrap();
    let weight = 9.81 * world.bodies.mass[1];
    world.bodies.force[1].x = 0.5 * weight;
    refused(&world, &step_settings(), "kink");
    world.bodies.force[1].x = 0.49 * weight;
    let sticking = StepGradient::new(&world, &step_settings()).unwrap();
    assert_eq!(sticking.states().collect::<Vec<_>>(), [Sticking]);
    world.bodies.force[1].x = 0.51 * weight;
    let sliding = StepGradient::new(&world, &step_settings()).unwrap();
    assert_eq!(sliding.states().collect::<Vec<_>>(), [Sliding]);
    // Carried exactly: it touches and does not press.
    world.bodies.force[1] = Vec3::new(0.0, 0.0, weight);
    refused(&world, &step_settings(), "touches without pressing");

    let solver = SolverChoice { friction: FrictionModel::Coulomb, ..SolverChoice::default() };
    let coulomb = StepSettings { solver, ..step_settings() };
    refused(&world, &coulomb, "exact");
    let drag = Action::Drag { linear: 1.0, quadratic: 0.0, angular: 0.0, medium: Vec3::ZERO };
    world.add_load(Load::on_all(drag)).unwrap();
    refused(&world, &step_settings(), "drag");

    let mut bouncing = ground(0.5, DOWN);
    bouncing.materials.set_pair(MaterialId::from_index(0), STONE, 0.5, 0.8).unwrap();
    ball(&mut bouncing, 0.0, 0.101, Vec3::new(0.0, 0.0, -2.0));
    refused(&bouncing, &step_settings(), "restitution");

    let mut gradient = StepGradient::new(&scenes()[0].1, &step_settings()).unwrap();
    assert!(matches!(gradient.pull_back(&[0.0; 5]), Err(GradientError::Size { got: 5, expected: 12 })));
    // Nothing in contact, and nothing at all.
    let mut world = ground(0.5, DOWN);
    let mut empty = StepGradient::new(&world, &step_settings()).unwrap();
    assert_eq!(empty.pull_back(&[1.0; 6]).unwrap().velocity, [0.0; 6]);
    ball(&mut world, 0.0, 5.0, Vec3::ZERO);
    let pulled = StepGradient::new(&world, &step_settings()).unwrap().pull_back(&[1.0; 12]).unwrap();
    assert_eq!(pulled.velocity[6..], [1.0; 6]);
}

/// Boxes that spin on one corner without friction: where a contact would have given a spin energy there is no
/// derivative, and it is refused; elsewhere derivatives by velocities are those of central differences.
#[test]
fn what_a_spin_gives_back_has_no_derivative() {
    let mut state = 1_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    let half = Vec3::new(0.1, 0.06, 0.04);
    let (mut refused, mut compared) = (0, 0);
    for _ in 0..300 {
        let mut vector = |size: f64| size * Vec3::new(next(), next(), next());
        let (spin, axis, angle, rise) = (vector(0.4 / DT), vector(1.0), vector(2.0).x, vector(0.5).z);
        let turn = Quat::from_axis_angle(axis.normalize(), angle);
        let low = half.dot((turn.conjugate() * Vec3::Z).abs());
        let mut world = ground(0.0, DOWN);
        let form = world.add_geometry(Geometry::cuboid(half).unwrap());
        let body = Body {
            orientation: turn,
            angular_velocity: spin,
            velocity: Vec3::new(0.3, 0.2, rise),
            ..Body::new(form, STONE, Vec3::new(0.0, 0.0, low + 1e-5))
        };
        world.add_body(body).unwrap();
        let mut gradient = match StepGradient::new(&world, &step_settings()) {
            Ok(gradient) => gradient,
            Err(error) => {
                refused += usize::from(error.to_string().contains("given a spin energy"));
                continue;
            }
        };
        let report = Stepper::new(step_settings()).unwrap().step(&mut world.clone()).unwrap();
        if gradient.states().all(|state| state == Apart) || report.overlap_corrected_max > 0.0 {
            continue;
        }
        let weight = weights(12);
        let pulled = gradient.pull_back(&weight).unwrap();
        let expected = differences(&world, &weight, 1e-5, |world, x| world.bodies.angular_velocity[1].x += x);
        assert!(
            (pulled.velocity[9] - expected).abs() < 1e-5 * expected.abs().max(0.1),
            "{} {expected}",
            pulled.velocity[9]
        );
        compared += 1;
    }
    assert!(refused > 0 && compared > 30, "{refused} {compared}");
}
