//! Sliding and rolling: A2 to A6.

use super::bench::{Accuracy, Bench, G, add_ground, add_sphere, world};
use super::source::{RELAXED, Source};
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::handle::MaterialId;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::world::{Body, World};
use graintrain_ccp::FrictionModel::{Coulomb, Relaxed};

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "A2",
        title: "Block at rest on an incline",
        setup: "A block 0.6 m long lies on a plane tilted by 20 degrees with mu = 0.5 for 10 000 steps of 1 ms.",
        sources: &[Source::Algebra("it stays, since tan 20 degrees = 0.364 < mu")],
        measure: Measure::Small(resting),
    },
    Definition {
        id: "A3",
        title: "Block sliding down an incline",
        setup: "A block starts from rest on a plane tilted by 30 degrees with mu = 0.3.",
        sources: &[
            Source::Algebra(
                "acceleration g (sin - mu cos); the relaxed model opens a gap dt mu v under a sliding body",
            ),
            RELAXED,
        ],
        measure: Measure::Small(sliding),
    },
    Definition {
        id: "A4",
        title: "Thrown block that stops",
        setup: "A block that cannot turn is thrown along a level plane at 5 m/s with mu = 0.5.",
        sources: &[
            Source::Algebra(
                "distance v^2 / (2 mu g); the relaxed model takes mu v / (1 + mu^2) upwards in the first step, which makes \
                 it hop 0.2045 m at dt = 1 ms (the one-contact problem solved step by step)",
            ),
            RELAXED,
        ],
        measure: Measure::Small(thrown),
    },
    Definition {
        id: "A5",
        title: "Thrown sphere that begins to roll",
        setup: "A sphere that does not turn is thrown along a level plane at 1 m/s with mu = 0.25.",
        sources: &[Source::Algebra(
            "momentum about the point of contact is kept: it rolls at 5/7 v after 2 v / (7 mu g) and 12 v^2 / (49 mu g)",
        )],
        measure: Measure::Small(slip_to_roll),
    },
    Definition {
        id: "A6",
        title: "Sphere on an incline",
        setup: "A sphere starts from rest on a plane tilted by 30 degrees.",
        sources: &[Source::Algebra(
            "it rolls with 5/7 g sin exactly if mu >= 2/7 tan, else slides with g (sin - mu cos) and turns with 5 mu g cos / (2 R)",
        )],
        measure: Measure::Small(rolling_down),
    },
];

/// A block of half height 0.1 on a plane tilted about y; it does not turn unless `turns`.
fn block(friction: f64, tilt: f64, turns: bool) -> Result<(World, usize), VerifyError> {
    let mut world = world(friction, 0.0)?;
    add_ground(&mut world, tilt)?;
    let shape = world.add_geometry(Geometry::cuboid(Vec3::new(0.3, 0.3, 0.1))?);
    let motion = world.add_motion(Motion::fixed().with_free([true, true, true, turns, turns, turns]))?;
    let orientation = Quat::from_rotation_y(tilt);
    let position = orientation * Vec3::new(0.0, 0.0, 0.1);
    let body =
        world.add_body(Body { motion, orientation, ..Body::new(shape, MaterialId::default(), position) })?;
    Ok((world, body.index()))
}

fn resting() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-7) {
            let step = 1e-3;
            let (mut world, block) = block(0.5, 20.0_f64.to_radians(), true)?;
            let start = world.bodies.position[block];
            let mut bench = Bench::new(step, 0.01, accuracy, model)?;
            bench.steps(&mut world, 10_000)?;
            let way = (world.bodies.position[block] - start).length();
            let speed = world.bodies.velocity[block].length();
            rows.push(bench.row("way in 10 s (m)", way, 0.0, 6e-7));
            rows.push(bench.row("speed at the end (m/s)", speed, 0.0, accuracy.allowed(1e-7, G * step)));
        }
    }
    Ok(rows)
}

fn sliding() -> Result<Vec<Row>, VerifyError> {
    let (tilt, friction, step) = (30.0_f64.to_radians(), 0.3, 0.01);
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-9) {
            let (mut world, block) = block(friction, tilt, false)?;
            let start = world.bodies.position[block];
            let mut bench = Bench::new(step, 0.05, accuracy, model)?;
            bench.steps(&mut world, 100)?;
            let turn = Quat::from_rotation_y(tilt);
            let speed = world.bodies.velocity[block].dot(turn * Vec3::X);
            let slid = (world.bodies.position[block] - start).dot(turn * Vec3::X);
            let gap = (turn * Vec3::Z).dot(world.bodies.position[block]) - 0.1;
            let expected = G * (tilt.sin() - friction * tilt.cos());
            let (open, distance) =
                if model == Relaxed { (step * friction * speed, 1.1878) } else { (0.0, 1.1899) };
            rows.push(bench.row("speed after 1 s (m/s)", speed, expected, 0.003 * expected));
            rows.push(bench.row(
                "way in 1 s, dt = 10 ms (m)",
                slid,
                distance,
                accuracy.allowed(5e-5, 0.5 * G),
            ));
            // A gap is off by what a velocity is, for one step.
            let digits = accuracy.allowed(1e-8, G * step * step);
            rows.push(bench.row("gap below (m)", gap, open, 0.01 * open + digits));
        }
    }
    Ok(rows)
}

fn thrown() -> Result<Vec<Row>, VerifyError> {
    let step = 1e-3;
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-9) {
            let (mut world, block) = block(0.5, 0.0, false)?;
            world.bodies.velocity[block] = 5.0 * Vec3::X;
            let mut bench = Bench::new(step, 0.3, accuracy, model)?;
            let mut highest = 0.0_f64;
            while world.bodies.velocity[block].length() > 1e-6 && world.time < 2.0 {
                bench.step(&mut world)?;
                highest = highest.max(world.bodies.position[block].z - 0.1);
            }
            let distance = 25.0 / G;
            let hop = if model == Coulomb { 0.0 } else { 0.2045 };
            rows.push(bench.row("distance (m)", world.bodies.position[block].x, distance, 0.005 * distance));
            rows.push(bench.row("hop (m)", highest, hop, 1e-4));
        }
    }
    Ok(rows)
}

fn slip_to_roll() -> Result<Vec<Row>, VerifyError> {
    let (radius, friction) = (0.1, 0.25);
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-10) {
            let mut world = world(friction, 0.0)?;
            add_ground(&mut world, 0.0)?;
            let ball = add_sphere(&mut world, radius, Vec3::new(0.0, 0.0, radius))?;
            world.bodies.velocity[ball] = Vec3::X;
            let mut bench = Bench::new(2.5e-4, 0.02, accuracy, model)?;
            let (mut rolls, mut travelled, mut hop) = (f64::NAN, f64::NAN, 0.0_f64);
            for _ in 0..1600 {
                bench.step(&mut world)?;
                hop = hop.max(world.bodies.position[ball].z - radius);
                let slip = world.bodies.velocity[ball].x - radius * world.bodies.angular_velocity[ball].y;
                if slip < 1e-5 && rolls.is_nan() {
                    (rolls, travelled) = (world.time, world.bodies.position[ball].x);
                }
            }
            let time = 2.0 / (7.0 * friction * G);
            let way = 12.0 / (49.0 * friction * G);
            let speed = world.bodies.velocity[ball].x;
            rows.push(bench.row("speed once rolling (m/s)", speed, 5.0 / 7.0, 1e-4));
            rows.push(bench.row("time until it rolls (s)", rolls, time, 0.01 * time));
            rows.push(bench.row("way until it rolls (m)", travelled, way, 0.01 * way));
            let expected = if model == Relaxed { 2.1e-3 } else { 0.0 };
            rows.push(bench.row("hop (m)", hop, expected, 1e-4));
        }
    }
    Ok(rows)
}

fn rolling_down() -> Result<Vec<Row>, VerifyError> {
    let (tilt, radius, step, steps) = (30.0_f64.to_radians(), 0.1, 1e-3, 500);
    let threshold = 2.0 / 7.0 * tilt.tan();
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-10) {
            let down = |friction: f64| -> Result<_, VerifyError> {
                let mut world = world(friction, 0.0)?;
                add_ground(&mut world, tilt)?;
                let turn = Quat::from_rotation_y(tilt);
                let ball = add_sphere(&mut world, radius, turn * Vec3::new(0.0, 0.0, radius))?;
                let mut bench = Bench::new(step, 0.02, accuracy, model)?;
                bench.steps(&mut world, steps)?;
                let speed = world.bodies.velocity[ball].dot(turn * Vec3::X) / world.time;
                Ok((bench, speed, world.bodies.angular_velocity[ball].y / world.time))
            };
            let (bench, a, _) = down(0.3)?;
            let rolling = 5.0 / 7.0 * G * tilt.sin();
            rows.push(bench.row("acceleration, mu = 0.3 (m/s^2)", a, rolling, 0.005 * rolling));
            let (bench, a, alpha) = down(0.1)?;
            let sliding = G * (tilt.sin() - 0.1 * tilt.cos());
            let turning = 2.5 * 0.1 * G * tilt.cos() / radius;
            rows.push(bench.row("acceleration, mu = 0.1 (m/s^2)", a, sliding, 0.005 * sliding));
            rows.push(bench.row("angular acceleration, mu = 0.1 (rad/s^2)", alpha, turning, 0.005 * turning));
            let (bench, a, alpha) = down(threshold + 1e-3)?;
            let digits = accuracy.allowed(2e-7, G);
            rows.push(bench.row(
                "slip, mu 0.001 above the threshold (m/s^2)",
                a - radius * alpha,
                0.0,
                digits,
            ));
            let (bench, a, alpha) = down(threshold - 1e-3)?;
            // Accelerations differ by g (sin - 7/2 mu cos).
            let expected = 3.5e-3 * G * tilt.cos();
            let what = "slip, mu 0.001 below the threshold (m/s^2)";
            rows.push(bench.row(what, a - radius * alpha, expected, accuracy.allowed(0.02 * expected, G)));
        }
    }
    Ok(rows)
}
