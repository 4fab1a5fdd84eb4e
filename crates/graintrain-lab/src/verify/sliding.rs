//! Sliding and rolling: A2 to A6.

use super::bench::{Bench, G, add_ground, add_sphere, world};
use super::{Check, MODELS, VerifyError, named};
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::world::{Body, World};
use graintrain_ccp::FrictionModel::{self, Coulomb, Relaxed};

/// The checks.
///
/// # Errors
/// [`VerifyError`] where one cannot be made.
pub fn checks() -> Result<Vec<Check>, VerifyError> {
    let mut checks = Vec::new();
    for model in MODELS {
        checks.push(resting(model)?);
        checks.extend(sliding(model)?);
        checks.extend(thrown(model)?);
        checks.extend(slip_to_roll(model)?);
    }
    checks.extend(rolling_down()?);
    Ok(checks)
}

/// A block of half height 0.1 on a plane tilted about y; it does not turn unless `turns`.
fn block(friction: f64, tilt: f64, turns: bool) -> Result<(World, usize), VerifyError> {
    let mut world = world(friction, 0.0)?;
    add_ground(&mut world, tilt)?;
    let shape = world.add_geometry(Geometry::cuboid(Vec3::new(0.3, 0.3, 0.1))?);
    let motion = world.add_motion(Motion::fixed().with_free([true, true, true, turns, turns, turns]))?;
    let orientation = Quat::from_rotation_y(tilt);
    let position = orientation * Vec3::new(0.0, 0.0, 0.1);
    let body = world.add_body(Body { motion, orientation, ..Body::new(shape, 0, position) })?;
    Ok((world, body as usize))
}

fn resting(model: FrictionModel) -> Result<Check, VerifyError> {
    let (mut world, block) = block(0.5, 20.0_f64.to_radians(), true)?;
    let start = world.bodies.position[block];
    Bench::new(1e-3, 0.01, 1e-7, model)?.steps(&mut world, 2000)?;
    Ok(Check {
        id: "A2",
        what: format!("block at rest on 20 degrees, mu 0.5, {}: way in 2 s (m)", named(model)),
        measured: (world.bodies.position[block] - start).length(),
        expected: 0.0,
        tolerance: 6e-7,
        source: "tan 20 < mu",
        error: 0.0,
    })
}

fn sliding(model: FrictionModel) -> Result<[Check; 2], VerifyError> {
    let (tilt, friction, step) = (30.0_f64.to_radians(), 0.3, 0.01);
    let (mut world, block) = block(friction, tilt, false)?;
    Bench::new(step, 0.05, 1e-9, model)?.steps(&mut world, 100)?;
    let turn = Quat::from_rotation_y(tilt);
    let speed = world.bodies.velocity[block].dot(turn * Vec3::X);
    let gap = (turn * Vec3::Z).dot(world.bodies.position[block]) - 0.1;
    let expected = G * (tilt.sin() - friction * tilt.cos());
    let check = |what: &str, measured, expected, tolerance, source| Check {
        id: "A3",
        what: format!("block sliding on 30 degrees, mu 0.3, {}: {what}", named(model)),
        measured,
        expected,
        tolerance,
        source,
        error: 0.0,
    };
    // The relaxation opens a gap dt mu v under a sliding body.
    let open = if model == Relaxed { step * friction * speed } else { 0.0 };
    Ok([
        check("speed after 1 s (m/s)", speed, expected, 0.003 * expected, "g (sin - mu cos) t"),
        check("gap below (m)", gap, open, 0.01 * open + 1e-8, "dt mu v relaxed, 0 exact"),
    ])
}

fn thrown(model: FrictionModel) -> Result<[Check; 2], VerifyError> {
    let step = 1e-3;
    let (mut world, block) = block(0.5, 0.0, false)?;
    world.bodies.velocity[block] = 5.0 * Vec3::X;
    let mut bench = Bench::new(step, 0.3, 1e-9, model)?;
    let mut highest = 0.0_f64;
    while world.bodies.velocity[block].length() > 1e-6 && world.time < 2.0 {
        bench.step(&mut world)?;
        highest = highest.max(world.bodies.position[block].z - 0.1);
    }
    let check = |what: &str, measured, expected, tolerance, source| Check {
        id: "A4",
        what: format!("block thrown at 5 m/s, mu 0.5, {}: {what} (m)", named(model)),
        measured,
        expected,
        tolerance,
        source,
        error: 0.0,
    };
    let distance = 25.0 / G;
    let hop = if model == Coulomb { 0.0 } else { 0.2045 };
    Ok([
        check("distance", world.bodies.position[block].x, distance, 0.005 * distance, "v^2 / (2 mu g)"),
        check("hop", highest, hop, 1e-4, "0 exact; reference computation relaxed"),
    ])
}

fn slip_to_roll(model: FrictionModel) -> Result<[Check; 2], VerifyError> {
    let (radius, friction) = (0.1, 0.25);
    let mut world = world(friction, 0.0)?;
    add_ground(&mut world, 0.0)?;
    let ball = add_sphere(&mut world, radius, Vec3::new(0.0, 0.0, radius))?;
    world.bodies.velocity[ball] = Vec3::X;
    let mut bench = Bench::new(2.5e-4, 0.02, 1e-10, model)?;
    let mut rolls = f64::NAN;
    for _ in 0..1600 {
        bench.step(&mut world)?;
        let slip = world.bodies.velocity[ball].x - radius * world.bodies.angular_velocity[ball].y;
        if slip < 1e-6 && rolls.is_nan() {
            rolls = world.time;
        }
    }
    let check = |what: &str, measured, expected, tolerance, source| Check {
        id: "A5",
        what: format!("sphere thrown at 1 m/s, mu 0.25, {}: {what}", named(model)),
        measured,
        expected,
        tolerance,
        source,
        error: 0.0,
    };
    let time = 2.0 / (7.0 * friction * G);
    Ok([
        check("speed once rolling (m/s)", world.bodies.velocity[ball].x, 5.0 / 7.0, 1e-4, "5/7 v"),
        check("time until it rolls (s)", rolls, time, 0.01 * time, "2 v / (7 mu g)"),
    ])
}

/// Rolls with 5/7 g sin where mu >= 2/7 tan, else slides with g (sin - mu cos).
fn rolling_down() -> Result<Vec<Check>, VerifyError> {
    let (tilt, radius, step, steps) = (30.0_f64.to_radians(), 0.1, 1e-3, 200);
    let mut checks = Vec::new();
    for (friction, expected) in
        [(0.3, 5.0 / 7.0 * G * tilt.sin()), (0.1, G * (tilt.sin() - 0.1 * tilt.cos()))]
    {
        let mut world = world(friction, 0.0)?;
        add_ground(&mut world, tilt)?;
        let turn = Quat::from_rotation_y(tilt);
        let ball = add_sphere(&mut world, radius, turn * Vec3::new(0.0, 0.0, radius))?;
        Bench::new(step, 0.02, 1e-10, Coulomb)?.steps(&mut world, steps)?;
        let speed = world.bodies.velocity[ball].dot(turn * Vec3::X);
        checks.push(Check {
            id: "A6",
            what: format!("sphere on 30 degrees, mu {friction}, coulomb: acceleration (m/s^2)"),
            measured: speed / (steps as f64 * step),
            expected,
            tolerance: 0.005 * expected,
            source: "5/7 g sin, or g (sin - mu cos)",
            error: 0.0,
        });
    }
    Ok(checks)
}
