//! Rolling and spinning friction: A30 to A32.

use super::bench::{Accuracy, Bench, G, add_ground, add_sphere, world};
use super::source::{RELAXED, Source};
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::handle::MaterialId;
use graintrain::material::TurningResistance;
use graintrain::math::{Quat, Vec3};
use graintrain::world::World;
use graintrain_ccp::FrictionModel::Relaxed;

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "A30",
        title: "Ball on an incline, rolling friction",
        setup: "A ball starts from rest on a plane with mu = 0.8 and rolling friction mu_r = 0.2 R, tilted to 0.95 and 1.5 times the \
                threshold.",
        sources: &[
            Source::Algebra(
                "it stays up to tan = mu_r / R and rolls with 5/7 g (sin - mu_r / R cos) beyond it; the relaxed model lifts what rolls \
                 by dt mu_r |w|",
            ),
            RELAXED,
        ],
        measure: Measure::Small(incline),
    },
    Definition {
        id: "A31",
        title: "Rolling ball that stops",
        setup: "A ball rolls on level ground at 1 m/s with rolling friction mu_r = 0.05 R.",
        sources: &[Source::Algebra("it slows by 5/7 g mu_r / R and stops after v^2 / (2 a)")],
        measure: Measure::Small(stopping),
    },
    Definition {
        id: "A32",
        title: "Spinning ball that stops",
        setup: "A ball of radius 0.1 m spins at 10 rad/s about the vertical on level ground with spinning friction mu_s = 2 mm.",
        sources: &[Source::Algebra("it loses mu_s g / (0.4 R^2) a second, and rests after w / that")],
        measure: Measure::Small(spinning),
    },
];

const RADIUS: f64 = 0.1;

fn ball(tilt: f64, rolling: f64, spinning: f64) -> Result<(World, usize), VerifyError> {
    let mut world = world(0.8, 0.0)?;
    let stuff = MaterialId::default();
    let [rolling, spinning] = [rolling, spinning].map(TurningResistance::Length);
    world.materials.set_pair_turning(stuff, stuff, rolling, spinning)?;
    add_ground(&mut world, tilt)?;
    let ball = add_sphere(&mut world, RADIUS, Quat::from_rotation_y(tilt) * Vec3::new(0.0, 0.0, RADIUS))?;
    Ok((world, ball))
}

fn incline() -> Result<Vec<Row>, VerifyError> {
    let (ratio, step) = (0.2_f64, 1e-3);
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-9) {
            let below = (0.95 * ratio).atan();
            let (mut world, body) = ball(below, ratio * RADIUS, 0.0)?;
            let start = world.bodies.position[body];
            let mut bench = Bench::new(step, 0.02, accuracy, model)?;
            bench.steps(&mut world, 2000)?;
            let way = (world.bodies.position[body] - start).length();
            rows.push(bench.row("way in 2 s below the threshold (m)", way, 0.0, 1e-6));

            let above = (1.5 * ratio).atan();
            let (mut world, body) = ball(above, ratio * RADIUS, 0.0)?;
            let mut bench = Bench::new(step, 0.02, accuracy, model)?;
            bench.steps(&mut world, 500)?;
            let turn = Quat::from_rotation_y(above);
            let speed = world.bodies.velocity[body].dot(turn * Vec3::X);
            let expected = 5.0 / 7.0 * G * (above.sin() - ratio * above.cos());
            rows.push(bench.row(
                "acceleration above it (m/s^2)",
                speed / world.time,
                expected,
                0.005 * expected,
            ));
            let spin = world.bodies.angular_velocity[body].y;
            let gap = (turn * Vec3::Z).dot(world.bodies.position[body]) - RADIUS;
            let open = if model == Relaxed { step * ratio * RADIUS * spin } else { 0.0 };
            let digits = accuracy.allowed(1e-8, G * step * step);
            rows.push(bench.row("gap below (m)", gap, open, 0.02 * open + digits));
        }
    }
    Ok(rows)
}

fn stopping() -> Result<Vec<Row>, VerifyError> {
    let ratio = 0.05;
    let deceleration = 5.0 / 7.0 * G * ratio;
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-9) {
            let (mut world, body) = ball(0.0, ratio * RADIUS, 0.0)?;
            world.bodies.velocity[body] = Vec3::X;
            world.bodies.angular_velocity[body] = Vec3::Y / RADIUS;
            let mut bench = Bench::new(1e-3, 0.02, accuracy, model)?;
            bench.steps(&mut world, (1.2e3 / deceleration) as usize)?;
            let way = 0.5 / deceleration;
            rows.push(bench.row("way (m)", world.bodies.position[body].x, way, 0.01 * way));
            let speed = world.bodies.velocity[body].length();
            rows.push(bench.row("speed at the end (m/s)", speed, 0.0, accuracy.allowed(1e-7, G * 1e-3)));
        }
    }
    Ok(rows)
}

fn spinning() -> Result<Vec<Row>, VerifyError> {
    let (coefficient, spin) = (2e-3, 10.0);
    let slowing = coefficient * G / (0.4 * RADIUS * RADIUS);
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-9) {
            let (mut world, body) = ball(0.0, 0.0, coefficient)?;
            world.bodies.angular_velocity[body] = spin * Vec3::Z;
            let mut bench = Bench::new(1e-3, 0.02, accuracy, model)?;
            let half = (0.5e3 * spin / slowing).round();
            bench.steps(&mut world, half as usize)?;
            let expected = spin - slowing * half * 1e-3;
            let found = world.bodies.angular_velocity[body].z;
            rows.push(bench.row("spin after half the time (rad/s)", found, expected, 0.01 * spin));
            bench.steps(&mut world, (0.7e3 * spin / slowing) as usize)?;
            let found = world.bodies.angular_velocity[body].length();
            let digits = accuracy.allowed(1e-7, G * 1e-3 / RADIUS);
            rows.push(bench.row("spin at the end (rad/s)", found, 0.0, digits));
        }
    }
    Ok(rows)
}
