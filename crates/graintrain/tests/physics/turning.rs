//! Rolling and spinning friction: A30 to A32 of `verify`, and rollers under a heavy slab.

use crate::support::*;
use graintrain::ccp::FrictionModel::{self, Relaxed};
use graintrain::handle::MaterialId;
use graintrain::material::TurningResistance::{self, Length, Ratio};
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
use graintrain::world::{Body, World};

const RADIUS: f64 = 0.1;

/// Ground tilted about y and a ball on it, of materials that resist turning.
fn ball_on_ground(tilt: f64, rolling: TurningResistance, spinning: TurningResistance) -> (World, usize) {
    let mut world = world(0.8, 0.0);
    let stuff = MaterialId::default();
    world.materials.set_pair_turning(stuff, stuff, rolling, spinning).unwrap();
    add_ground(&mut world, tilt);
    let ball = add_sphere(&mut world, RADIUS, Quat::from_rotation_y(tilt) * Vec3::new(0.0, 0.0, RADIUS));
    (world, ball)
}

fn speed_down(world: &World, ball: usize, tilt: f64) -> f64 {
    world.bodies.velocity[ball].dot(Quat::from_rotation_y(tilt) * Vec3::X)
}

/// A ball stays on an incline up to tan = mu_r / R, for 2 s, and rolls with 5/7 g (sin - mu_r / R cos) beyond
/// it; the coefficient as a number of effective radii and as a length is the same thing.
#[test]
fn a_ball_stays_up_to_the_threshold_and_rolls_beyond_it() {
    let ratio: f64 = 0.2;
    for model in BOTH {
        for rolling in [Ratio(ratio), Length(ratio * RADIUS)] {
            let below = (0.95 * ratio).atan();
            let (mut world, ball) = ball_on_ground(below, rolling, TurningResistance::NONE);
            let start = world.bodies.position[ball];
            run(&mut stepper(1e-3, 0.02, 1e-9, model), &mut world, 2000);
            let way = (world.bodies.position[ball] - start).length();
            assert!(way < 1e-6, "{model}: {way:e}");

            let above = (1.5 * ratio).atan();
            let (mut world, ball) = ball_on_ground(above, rolling, TurningResistance::NONE);
            run(&mut stepper(1e-3, 0.02, 1e-9, model), &mut world, 500);
            let expected = 5.0 / 7.0 * G * (above.sin() - ratio * above.cos());
            let found = speed_down(&world, ball, above) / world.time;
            assert_close(found, expected, 0.005 * expected, "acceleration");
            let slip = speed_down(&world, ball, above) - RADIUS * world.bodies.angular_velocity[ball].y;
            // The relaxation lifts what rolls by dt mu_r |w|, as it lifts what slides by dt mu v.
            let height = (Quat::from_rotation_y(above) * Vec3::Z).dot(world.bodies.position[ball]) - RADIUS;
            let spin = world.bodies.angular_velocity[ball].y;
            let lift = if model == Relaxed { 1e-3 * ratio * RADIUS * spin } else { 0.0 };
            assert_close(height, lift, 0.02 * lift + 1e-8, "gap");
            // The contact point lies in the middle of the gap.
            assert_close(slip, 0.0, spin * lift + 1e-7, "slip");
        }
    }
}

/// A ball that rolls on level ground is slowed by 5/7 g mu_r / R and stops for good after v^2 / (2 a).
#[test]
fn a_rolling_ball_comes_to_rest() {
    let ratio = 0.05;
    for model in BOTH {
        let (mut world, ball) = ball_on_ground(0.0, Ratio(ratio), TurningResistance::NONE);
        world.bodies.velocity[ball] = Vec3::X;
        world.bodies.angular_velocity[ball] = Vec3::Y / RADIUS;
        let mut stepper = stepper(1e-3, 0.02, 1e-9, model);
        let deceleration = 5.0 / 7.0 * G * ratio;
        run(&mut stepper, &mut world, (1.2 / deceleration * 1e3) as usize);
        let way = 0.5 / deceleration;
        assert_close(world.bodies.position[ball].x, way, 0.01 * way, "way");
        assert!(world.bodies.velocity[ball].length() < 1e-9, "{model}");
        assert!(world.bodies.angular_velocity[ball].length() < 1e-8, "{model}");
    }
}

/// A ball that spins on the spot loses mu_s m g of angular momentum a second, and rolling friction does not
/// touch it.
#[test]
fn spinning_friction_stops_a_top() {
    let (coefficient, spin) = (2e-3, 10.0);
    for model in BOTH {
        let (mut world, ball) = ball_on_ground(0.0, Ratio(0.3), Length(coefficient));
        world.bodies.angular_velocity[ball] = spin * Vec3::Z;
        let mut stepper = stepper(1e-3, 0.02, 1e-9, model);
        let slowing = coefficient * G / (0.4 * RADIUS * RADIUS);
        let half = (0.5 * spin / slowing * 1e3).round();
        run(&mut stepper, &mut world, half as usize);
        let expected = spin - slowing * half * 1e-3;
        assert_close(
            world.bodies.angular_velocity[ball].z,
            expected,
            0.01 * spin,
            "spin after half the time",
        );
        run(&mut stepper, &mut world, (0.7 * spin / slowing * 1e3) as usize);
        assert!(world.bodies.angular_velocity[ball].length() < 1e-8, "{model}");
        // The ground feels the moment while it lasts, and none after.
        let report = solved_step(&mut stepper, &mut world);
        assert!(report.wrenches[0].torque.length() < 1e-9);
    }
}

/// The ground's torque about the contact is that of rolling friction.
#[test]
fn the_moment_of_rolling_friction_is_felt_by_what_is_rolled_on() {
    for model in BOTH {
        let (mut world, ball) = ball_on_ground(0.0, Ratio(0.05), TurningResistance::NONE);
        world.bodies.velocity[ball] = Vec3::X;
        world.bodies.angular_velocity[ball] = Vec3::Y / RADIUS;
        let mut stepper = stepper(1e-3, 0.02, 1e-10, model);
        run(&mut stepper, &mut world, 300);
        let report = solved_step(&mut stepper, &mut world);
        let weight = world.bodies.mass[ball] * G;
        let [wrench] = &report.wrenches[..] else { panic!("only the ground is not free") };
        // About the ground's own position: the normal force at x, and the moment, which turns the ground with
        // the ball.
        let x = world.contacts.contacts[0].point.x;
        let expected = x * weight + 0.05 * RADIUS * weight;
        assert_close(wrench.torque.y, expected, 1e-3 * expected, "torque");
        assert!(
            report.errors.cone_excess_max < 1e-9 && report.errors.slip_angle_max < 1e-4,
            "{:?}",
            report.errors
        );
    }
}

/// A slab a million times as heavy as each of the four balls that carry it is slowed by g (b_1 + b_2) / (2
/// R), with the coefficients b_1 against the slab and b_2 against the ground.
#[test]
fn rollers_under_a_heavy_slab() {
    let (above, below) = (2e-3, 4e-3);
    for model in BOTH {
        let mut world = world(0.5, 0.0);
        let stuff = MaterialId::default();
        let slab_material = world.materials.add("slab", 1e6).unwrap();
        world.materials.set_pair(stuff, slab_material, 0.5, 0.0).unwrap();
        world.materials.set_pair_turning(stuff, stuff, Length(below), TurningResistance::NONE).unwrap();
        world
            .materials
            .set_pair_turning(stuff, slab_material, Length(above), TurningResistance::NONE)
            .unwrap();
        add_ground(&mut world, 0.0);
        for (x, y) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let ball = add_sphere(&mut world, RADIUS, Vec3::new(x, y, RADIUS));
            world.bodies.velocity[ball] = 0.25 * Vec3::X;
            world.bodies.angular_velocity[ball] = 0.25 / RADIUS * Vec3::Y;
        }
        let shape = world.add_geometry(Geometry::cuboid(Vec3::new(2.0, 2.0, 0.25)).unwrap());
        let upright =
            world.add_motion(Motion::fixed().with_free([true, true, true, false, false, false])).unwrap();
        let position = Vec3::new(0.0, 0.0, 2.0 * RADIUS + 0.25);
        let slab = world
            .add_body(Body {
                motion: upright,
                velocity: 0.5 * Vec3::X,
                ..Body::new(shape, slab_material, position)
            })
            .unwrap()
            .index();
        assert!(world.bodies.mass[slab] > 9e5 * world.bodies.mass[1]);
        let step = 1e-3;
        let mut stepper = Stepper::new(StepSettings {
            step,
            envelope: 0.01,
            solver: SolverChoice { friction: model, ..SolverChoice::default() },
            ..StepSettings::default()
        })
        .unwrap();
        for _ in 0..400 {
            solved_step(&mut stepper, &mut world);
        }
        let slowed = (0.5 - world.bodies.velocity[slab].x) / world.time;
        let expected = G * (above + below) / (2.0 * RADIUS);
        assert_close(slowed, expected, 0.02 * expected, "deceleration");
    }
}

/// Energy is lost and never made, by a pile of balls of radii 1 to 30 that roll and spin over one another.
#[test]
fn turning_resistance_makes_no_energy() {
    for model in BOTH {
        let mut world = world(0.5, 0.0);
        let stuff = MaterialId::default();
        world.materials.set_pair_turning(stuff, stuff, Ratio(0.1), Ratio(0.05)).unwrap();
        add_ground(&mut world, 0.0);
        add_sphere(&mut world, 0.3, Vec3::new(0.0, 0.0, 0.3));
        for k in 0..12 {
            let angle = 2.4 * f64::from(k);
            let radius = [0.01, 0.02, 0.05][k as usize % 3];
            let place = Vec3::new(0.2 * angle.cos(), 0.2 * angle.sin(), 0.65 + 0.12 * f64::from(k));
            let ball = add_sphere(&mut world, radius, place);
            world.bodies.angular_velocity[ball] = Vec3::new(5.0, -3.0, 8.0);
        }
        let settings = StepSettings {
            step: 2e-3,
            solver: SolverChoice { friction: model, ..SolverChoice::default() },
            ..StepSettings::default()
        };
        let mut stepper = Stepper::new(settings).unwrap();
        let energy = |world: &World| {
            let height = |b: usize| G * world.bodies.mass[b] * world.bodies.position[b].z;
            world.kinetic_energy() + (1..world.bodies.len()).map(height).sum::<f64>()
        };
        let mut last = energy(&world);
        for _ in 0..600 {
            let report = solved_step(&mut stepper, &mut world);
            let now = energy(&world);
            assert!(now <= last + report.correction_energy + 1e-9 * last, "{model}: {last} {now}");
            last = now;
        }
    }
}

/// Warm starts carry moments from step to step, and bodies may be taken away between steps.
#[test]
fn moments_stay_with_their_contacts() {
    let tilt = 0.1_f64.atan();
    let (mut world, ball) = ball_on_ground(tilt, Ratio(0.2), TurningResistance::NONE);
    let other = add_sphere(&mut world, RADIUS, Vec3::new(5.0, 5.0, 5.0));
    let mut stepper = stepper(1e-3, 0.02, 1e-9, FrictionModel::Relaxed);
    run(&mut stepper, &mut world, 20);
    let weight = world.bodies.mass[ball] * G;
    let expected = 1e-3 * weight * tilt.sin() * RADIUS;
    assert_close(world.contacts.moment[0].length(), expected, 1e-6 * expected, "moment");
    // From the impulses of the last step a resting contact is solved at once.
    let report = solved_step(&mut stepper, &mut world);
    assert!(report.solve.iterations <= 20, "{}", report.solve.iterations);
    world.remove_bodies(|body| body == other);
    assert_eq!(world.contacts.moment.len(), world.contacts.contacts.len());
    solved_step(&mut stepper, &mut world);
}

/// Angle of repose, degrees, of a column of `side` x `side` x `layers` balls that collapses on a flat floor
/// of the same material, after so many seconds: of the cone whose mass lies as high and as far out as that of
/// the heap, tan = 2 <z> / <r>.
fn angle_of_repose(rolling: f64, side: usize, layers: usize, seconds: f64, model: FrictionModel) -> f64 {
    let (radius, step) = (0.01, 2e-3);
    let mut world = world(0.5, 0.0);
    let stuff = MaterialId::default();
    world.materials.set_pair_turning(stuff, stuff, Ratio(rolling), TurningResistance::NONE).unwrap();
    add_ground(&mut world, 0.0);
    let ball = world.add_geometry(Geometry::sphere(radius).unwrap());
    let mut seed = 1_u64;
    let mut jitter = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        0.05 * radius * ((seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
    };
    let middle = 0.5 * (side as f64 - 1.0);
    for k in 0..side * side * layers {
        let [x, y, z] = [k % side, k / side % side, k / (side * side)].map(|n| 2.1 * radius * n as f64);
        let shift = 2.1 * radius * middle;
        let position = Vec3::new(x - shift + jitter(), y - shift + jitter(), z + 1.1 * radius + jitter());
        world.add_body(Body::new(ball, stuff, position)).unwrap();
    }
    let settings = StepSettings {
        step,
        solver: SolverChoice { friction: model, ..SolverChoice::default() },
        ..StepSettings::default()
    };
    let mut stepper = Stepper::new(settings).unwrap();
    for _ in 0..(seconds / step) as usize {
        solved_step(&mut stepper, &mut world);
    }
    let count = world.bodies.len() as f64 - 1.0;
    let places = &world.bodies.position[1..];
    let centre = places.iter().sum::<Vec3>() / count;
    let out = places.iter().map(|p| (p.x - centre.x).hypot(p.y - centre.y)).sum::<f64>() / count;
    (2.0 * (centre.z - radius) / out).atan().to_degrees()
}

#[test]
fn a_small_heap_is_steeper_with_rolling_friction() {
    let angles = [0.0, 0.3].map(|rolling| angle_of_repose(rolling, 5, 8, 1.0, FrictionModel::Relaxed));
    println!("{angles:?}");
    assert!(angles[1] > angles[0] + 8.0, "{angles:?}");
}

/// 2 000 balls: the angle of repose grows with rolling friction (Y. C. Zhou, B. H. Xu, A. B. Yu, P. Zulli,
/// "Numerical investigation of the angle of repose of monosized spheres", Physical Review E 64:021301, 2001).
/// The measure counts balls that have rolled away, so that it is flatter than the slope of the heap itself:
/// 0.1, 4.6 and 14.1 degrees.
#[test]
#[ignore = "three heaps of 2 000 balls, minutes"]
fn the_angle_of_repose_grows_with_rolling_friction() {
    let angles = [0.0, 0.1, 0.3].map(|rolling| angle_of_repose(rolling, 10, 20, 2.0, FrictionModel::Relaxed));
    println!("angles of repose with rolling friction 0, 0.1, 0.3: {angles:.1?} degrees");
    assert!(angles[0] < 2.0 && angles[1] > angles[0] + 2.0 && angles[2] > angles[1] + 5.0, "{angles:?}");
}
