//! Convex hulls: A42.

use super::bench::{Accuracy, Bench, G, world};
use super::source::Source;
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::handle::MaterialId;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::world::{Body, World};
use graintrain_ccp::FrictionModel;
use std::f64::consts::TAU;

/// The case.
pub const CASES: &[Definition] = &[Definition {
    id: "A42",
    title: "Convex hulls on a slope",
    setup: "On a fixed box tilted about y: the hull of a block's corners slides at 20 degrees with mu = 0.25, and a prism on a hexagon, \
            0.1 m across its corners' radius, stands on a face at 29 degrees and tips over its lower edge at 31 degrees, mu = 1.",
    sources: &[Source::Algebra(
        "a = g (sin - mu cos); the prism's centre stands over its lower edge at 30 degrees, and past it falls about the edge with \
         omega^2 (I + m r^2) = 2 m g r (cos phi_0 - cos phi), I = 5/12 m r^2",
    )],
    measure: Measure::Small(hulls),
}];

/// Corners of the prism: axis along y, a face down.
fn prism(radius: f64) -> Vec<Vec3> {
    let corner = |k: u32| {
        let angle = TAU * (f64::from(k / 2) / 6.0 + 1.0 / 6.0);
        Vec3::new(radius * angle.cos(), if k % 2 == 1 { 0.1 } else { -0.1 }, radius * angle.sin())
    };
    (0..12).map(corner).collect()
}

/// A hull that stands with its lowest face, `height` below its centre, on a fixed box whose top is tilted.
fn on_box(points: &[Vec3], height: f64, friction: f64, tilt: f64) -> Result<(World, usize), VerifyError> {
    let mut world = world(friction, 0.0)?;
    let turn = Quat::from_rotation_y(tilt);
    let table = world.add_geometry(Geometry::cuboid(Vec3::new(4.0, 1.0, 0.5))?);
    let motion = world.add_motion(Motion::fixed())?;
    let place = turn * Vec3::new(0.0, 0.0, -0.5);
    let ground = Body { motion, orientation: turn, ..Body::new(table, MaterialId::default(), place) };
    world.add_body(ground)?;
    let hull = world.add_geometry(Geometry::hull(points)?.0);
    let body = Body {
        orientation: turn,
        ..Body::new(hull, MaterialId::default(), turn * Vec3::new(0.0, 0.0, height))
    };
    let body = world.add_body(body)?.index();
    Ok((world, body))
}

fn hulls() -> Result<Vec<Row>, VerifyError> {
    let (step, radius) = (1e-3, 0.1);
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-8) {
            let bench = || Bench::new(step, 0.01, accuracy, model);
            let corner = |k: u32| {
                let side = |bit: u32| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
                Vec3::new(0.1 * side(0), 0.08 * side(1), 0.05 * side(2))
            };
            let block: Vec<Vec3> = (0..8).map(corner).collect();
            let tilt = 20.0_f64.to_radians();
            let (mut world, body) = on_box(&block, 0.05, 0.25, tilt)?;
            let mut sliding = bench()?;
            sliding.steps(&mut world, 500)?;
            let downhill = Quat::from_rotation_y(tilt) * Vec3::X;
            let a = world.bodies.velocity[body].dot(downhill) / world.time;
            let expected = G * (tilt.sin() - 0.25 * tilt.cos());
            // Where friction is relaxed, sliding at v lifts the block with mu v for one step, and the impulse
            // of that brakes it once.
            let lift = if model == FrictionModel::Relaxed {
                0.25 * 0.25 * step * expected / world.time
            } else {
                0.0
            };
            let allowed = accuracy.allowed(1e-6, 0.02) + 1.1 * lift;
            rows.push(sliding.row("block: acceleration (m/s^2)", a, expected, allowed));

            let height = radius * 0.75_f64.sqrt();
            let (mut world, body) = on_box(&prism(radius), height, 1.0, 29.0_f64.to_radians())?;
            let start = world.bodies.position[body];
            let mut standing = bench()?;
            standing.steps(&mut world, 1000)?;
            let way = (world.bodies.position[body] - start).length();
            rows.push(standing.row(
                "prism at 29 degrees: way in 1 s (m)",
                way,
                0.0,
                accuracy.allowed(1e-9, 0.02),
            ));

            let tilt = 31.0_f64.to_radians();
            let (mut world, body) = on_box(&prism(radius), height, 1.0, tilt)?;
            let edge = Quat::from_rotation_y(tilt) * Vec3::new(0.5 * radius, 0.0, 0.0);
            let mut tipping = bench()?;
            tipping.steps(&mut world, 300)?;
            // Angle of the centre from the vertical through the edge, downhill.
            let from_edge = world.bodies.position[body] - edge;
            let angle = from_edge.x.atan2(from_edge.z);
            let square = 2.0 * G / radius * (1.0_f64.to_radians().cos() - angle.cos()) / (1.0 + 5.0 / 12.0);
            let spin = world.bodies.angular_velocity[body].y;
            rows.push(tipping.row(
                "prism at 31 degrees: speed of turning (1/s)",
                spin,
                square.sqrt(),
                0.01 * square.sqrt(),
            ));
            let apart = from_edge.length() / radius - 1.0;
            rows.push(tipping.row("distance from the edge over r, less 1 (1)", apart, 0.0, 0.002));
        }
    }
    Ok(rows)
}
