//! Elastic and cohesive contacts: A43 and A44.

use super::bench::{Accuracy, Bench, G, add_ground, add_sphere, world};
use super::source::Source;
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::handle::MaterialId;
use graintrain::material::Elasticity;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::world::{Body, World};
use std::f64::consts::PI;

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "A43",
        title: "Elastic contacts",
        setup: "A ball of 0.1 m on a plane, k = 10 kN/m per contact: at rest with d = 200 N s/m; thrown at the plane at 0.5 m/s without gravity \
                and damping; pressed below its rest and let go with d = 30 N s/m.",
        sources: &[Source::Algebra(
            "k x = m g; m x'' = -k x: contact for pi sqrt(m/k), the same speed back (implicit Euler takes 1/2 omega^2 dt of it per second); \
             m x'' = -k x - d x' about the rest",
        )],
        measure: Measure::Small(elastic),
    },
    Definition {
        id: "A44",
        title: "Cohesive sphere",
        setup: "A ball hangs from a plate that pulls it with 1.02 and 0.98 of its weight.",
        sources: &[Source::Algebra(
            "it hangs where the pull is more than the weight, and falls where it is less",
        )],
        measure: Measure::Small(cohesive),
    },
];

const RADIUS: f64 = 0.1;
const STIFFNESS: f64 = 1e4;

fn ball_on_plane(damping: f64, height: f64) -> Result<(World, usize), VerifyError> {
    let mut world = world(0.3, 0.0)?;
    let stuff = MaterialId::default();
    world.materials.set_pair_elasticity(stuff, stuff, Elasticity { stiffness: STIFFNESS, damping })?;
    add_ground(&mut world, 0.0)?;
    let ball = add_sphere(&mut world, RADIUS, Vec3::new(0.0, 0.0, height))?;
    Ok((world, ball))
}

fn elastic() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-9) {
            let (mut world, ball) = ball_on_plane(200.0, RADIUS)?;
            let mass = world.bodies.mass[ball];
            let rest = mass * G / STIFFNESS;
            let mut resting = Bench::new(1e-3, 0.02, accuracy, model)?;
            resting.steps(&mut world, 1000)?;
            let sunk = RADIUS - world.bodies.position[ball].z;
            rows.push(resting.row("compression at rest (m)", sunk, rest, accuracy.allowed(1e-9, 1e-4)));

            let (mut world, ball) = ball_on_plane(0.0, RADIUS)?;
            world.gravity = Vec3::ZERO;
            world.bodies.velocity[ball].z = -0.5;
            let half = PI * (mass / STIFFNESS).sqrt();
            let mut bouncing = Bench::new(half / 1000.0, 0.02, accuracy, model)?;
            while world.time == 0.0 || world.bodies.position[ball].z < RADIUS && world.time < 2.0 * half {
                bouncing.steps(&mut world, 1)?;
            }
            rows.push(bouncing.row("bounce: time of contact (s)", world.time, half, 0.003 * half));
            // The amplitude decays with 1/2 omega^2 dt.
            let back = 0.5 * (-0.5 * PI * PI / 1000.0_f64).exp();
            let speed = world.bodies.velocity[ball].z;
            rows.push(bouncing.row("bounce: speed back (m/s)", speed, back, 0.001));

            let damping = 30.0;
            let pressed = 0.8 * rest;
            let (mut world, ball) = ball_on_plane(damping, RADIUS - rest - pressed)?;
            let decay = 0.5 * damping / mass;
            let damped = (STIFFNESS / mass - decay * decay).sqrt();
            let mut swinging = Bench::new(1e-4, 0.02, accuracy, model)?;
            let mut worst: f64 = 0.0;
            for _ in 0..400 {
                swinging.steps(&mut world, 5)?;
                let t = world.time;
                let phase = (damped * t).cos() + decay / damped * (damped * t).sin();
                let expected = -pressed * (-decay * t).exp() * phase;
                let found = world.bodies.position[ball].z - RADIUS + rest;
                worst = worst.max((found - expected).abs() / pressed);
            }
            rows.push(swinging.row("oscillation: largest error over the amplitude (1)", worst, 0.0, 0.1));
        }
    }
    Ok(rows)
}

fn cohesive() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-9) {
            for (share, expected) in [(1.02, 0.0), (0.98, 0.5 * G * 0.2 * 0.2)] {
                let mut world = world(0.3, 0.0)?;
                let plane = world.add_geometry(Geometry::plane());
                let motion = world.add_motion(Motion::fixed())?;
                let orientation = Quat::from_rotation_x(PI);
                let plate =
                    Body { motion, orientation, ..Body::new(plane, MaterialId::default(), Vec3::ZERO) };
                world.add_body(plate)?;
                let ball = add_sphere(&mut world, RADIUS, Vec3::new(0.0, 0.0, -RADIUS))?;
                let stuff = MaterialId::default();
                world.materials.set_pair_cohesion(stuff, stuff, share * G * world.bodies.mass[ball])?;
                let mut bench = Bench::new(1e-3, 0.02, accuracy, model)?;
                let mut released: Option<f64> = None;
                let mut way = 0.0;
                for _ in 0..1000 {
                    bench.steps(&mut world, 1)?;
                    way = -RADIUS - world.bodies.position[ball].z;
                    // Within a thousandth of the radius it counts as touching.
                    if released.is_none() && way > 1e-3 * RADIUS {
                        released = Some(world.time);
                    }
                    if released.is_some_and(|at| world.time - at > 0.2 - 0.5e-3) {
                        break;
                    }
                }
                let what = format!("pull of {share} weights: way (m)");
                let allowed = if share > 1.0 { accuracy.allowed(1e-9, 0.05) } else { 0.02 * expected + 1e-3 };
                rows.push(bench.row(what, way, expected, allowed));
            }
        }
    }
    Ok(rows)
}
