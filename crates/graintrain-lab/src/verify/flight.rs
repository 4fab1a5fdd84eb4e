//! Bodies without contact: A1, A15.

use super::bench::{Bench, G, add_sphere, world};
use super::{Check, VerifyError};
use graintrain::math::{Mat3, Vec3};
use graintrain_ccp::FrictionModel::Relaxed;

/// The checks.
///
/// # Errors
/// [`VerifyError`] where one cannot be made.
pub fn checks() -> Result<Vec<Check>, VerifyError> {
    let mut checks = free_flight()?;
    checks.extend(turning_over()?);
    Ok(checks)
}

/// Semi-implicit Euler: x_n = x_0 + n h v_0 + h^2 g n (n + 1) / 2; the exact path is off by g h t / 2.
fn free_flight() -> Result<Vec<Check>, VerifyError> {
    let (step, steps) = (1e-3, 1000);
    let mut world = world(0.0, 0.0)?;
    let ball = add_sphere(&mut world, 0.1, Vec3::new(1.0, 2.0, 3.0))?;
    world.bodies.velocity[ball] = Vec3::new(0.5, -0.3, 4.0);
    Bench::new(step, 0.01, 1e-6, Relaxed)?.steps(&mut world, steps)?;
    let n = steps as f64;
    let exact = 3.0 + n * step * 4.0 - G * step * step * 0.5 * n * (n + 1.0);
    let continuous = 3.0 + 4.0 - 0.5 * G;
    let height = world.bodies.position[ball].z;
    let check = |what: &str, measured, expected, tolerance| Check {
        id: "A1",
        what: what.into(),
        measured,
        expected,
        tolerance,
        source: "recurrence of the scheme",
        error: 0.0,
    };
    Ok(vec![
        check("height after 1 s (m)", height, exact, 1e-12),
        check("lag behind the parabola (m)", continuous - height, 0.5 * G * step, 1e-11),
    ])
}

/// A body with inertia 1 : 2 : 3 spun about its middle axis turns over when elliptic integrals say.
fn turning_over() -> Result<Vec<Check>, VerifyError> {
    let mut world = world(0.0, 0.0)?;
    world.gravity = Vec3::ZERO;
    let body = add_sphere(&mut world, 0.1, Vec3::ZERO)?;
    world.bodies.inertia[body] = Mat3::from_diagonal(Vec3::new(1.0, 2.0, 3.0));
    world.bodies.angular_velocity[body] = Vec3::new(0.01, 1.0, 0.01);
    let energy = world.kinetic_energy();
    let (step, mut turns) = (1e-3, Vec::new());
    let mut bench = Bench::new(step, 0.0, 1e-6, Relaxed)?;
    let mut last = 1.0;
    for _ in 0..31_000 {
        bench.step(&mut world)?;
        let now = (world.bodies.orientation[body].conjugate() * world.bodies.angular_velocity[body]).y;
        if now * last < 0.0 {
            turns.push(world.time - step * now / (now - last));
        }
        last = now;
    }
    let turn = |k: usize| turns.get(k).copied().unwrap_or(f64::NAN);
    let check = |what: &str, measured, expected: f64, tolerance| Check {
        id: "A15",
        what: what.into(),
        measured,
        expected,
        tolerance,
        source: "Euler's equations, elliptic integral",
        error: 0.0,
    };
    Ok(vec![
        check("first turn-over (s)", turn(0), 10.9169, 0.109),
        check("second turn-over (s)", turn(1), 30.4698, 0.305),
        check("relative drift of the energy (1)", world.kinetic_energy() / energy - 1.0, 0.0, 1e-4),
    ])
}
