//! Impacts: A7, A8, A9, A20.

use super::bench::{Bench, add_ground, add_sphere, world};
use super::{Check, MODELS, VerifyError, named};
use graintrain::math::Vec3;
use graintrain_ccp::FrictionModel::{self, Coulomb, Relaxed};

/// The checks.
///
/// # Errors
/// [`VerifyError`] where one cannot be made.
pub fn checks() -> Result<Vec<Check>, VerifyError> {
    let mut checks = Vec::new();
    for (angle, friction, restitution) in
        [(45.0, 0.1, 0.0), (75.0, 0.25, 0.0), (75.0, 0.25, 0.9), (30.0, 0.5, 0.3)]
    {
        for model in MODELS {
            checks.extend(oblique_checks(angle, friction, restitution, model)?);
        }
    }
    for restitution in [0.0, 0.5, 1.0] {
        checks.push(head_on(restitution)?);
    }
    checks.push(row()?);
    for (angle, digitised) in [(40.0, 0.781), (60.0, 0.893), (80.0, 0.966)] {
        let [u, ..] = oblique(f64::to_radians(angle), 0.092, 0.98, Coulomb)?;
        checks.push(Check {
            id: "A20",
            what: format!("alumina at {angle} degrees: tangential restitution (1)"),
            measured: u / f64::to_radians(angle).sin(),
            expected: digitised,
            tolerance: 0.005,
            source: "Chung and Ooi, digitised",
            error: 0.0,
        });
    }
    Ok(checks)
}

/// A sphere that hits a plane at unit speed, `angle` from the normal, in one step without gravity: tangential velocity,
/// R omega, rebound velocity.
fn oblique(
    angle: f64,
    friction: f64,
    restitution: f64,
    model: FrictionModel,
) -> Result<[f64; 3], VerifyError> {
    let radius = 0.1;
    let mut world = world(friction, restitution)?;
    world.gravity = Vec3::ZERO;
    add_ground(&mut world, 0.0)?;
    let ball = add_sphere(&mut world, radius, Vec3::new(0.0, 0.0, radius))?;
    world.bodies.velocity[ball] = Vec3::new(angle.sin(), 0.0, -angle.cos());
    Bench::new(1e-3, 1e-3, 1e-11, model)?.step(&mut world)?;
    let u = world.bodies.velocity[ball];
    Ok([u.x, radius * world.bodies.angular_velocity[ball].y, u.z])
}

/// Sticking ends the slip; sliding leaves s' = s - 7/2 mu (1 + e) v_n, relaxed s' / (1 + 7/2 mu^2) with rebound
/// e v_n + mu s'.
fn oblique_checks(
    degrees: f64,
    friction: f64,
    restitution: f64,
    model: FrictionModel,
) -> Result<[Check; 2], VerifyError> {
    let angle = degrees.to_radians();
    let (tangential, normal) = (angle.sin(), angle.cos());
    let [u, spin, rebound] = oblique(angle, friction, restitution, model)?;
    let slip = (tangential - 3.5 * friction * (1.0 + restitution) * normal).max(0.0);
    let left = if model == Relaxed { slip / (1.0 + 3.5 * friction * friction) } else { slip };
    let lift = if model == Relaxed { friction * left } else { 0.0 };
    let check = |what: &str, measured, expected| Check {
        id: "A7",
        what: format!("{degrees} degrees, mu {friction}, e {restitution}, {}: {what} (m/s)", named(model)),
        measured,
        expected,
        tolerance: 1e-6,
        source: "closed form of one impact",
        error: 0.0,
    };
    Ok([check("slip left", u - spin, left), check("rebound", rebound, restitution * normal + lift)])
}

/// Masses 1 : 8: the velocity of separation is e times that of approach.
fn head_on(restitution: f64) -> Result<Check, VerifyError> {
    let mut world = world(0.3, restitution)?;
    world.gravity = Vec3::ZERO;
    let a = add_sphere(&mut world, 0.1, Vec3::new(-0.1, 0.0, 0.0))?;
    let b = add_sphere(&mut world, 0.2, Vec3::new(0.2, 0.0, 0.0))?;
    world.bodies.velocity[a] = 2.0 * Vec3::X;
    world.bodies.velocity[b] = -Vec3::X;
    Bench::new(1e-3, 1e-3, 1e-13, Relaxed)?.step(&mut world)?;
    Ok(Check {
        id: "A8",
        what: format!("head-on, e {restitution}: velocity of separation (m/s)"),
        measured: world.bodies.velocity[b].x - world.bodies.velocity[a].x,
        expected: 3.0 * restitution,
        tolerance: 1e-10,
        source: "Newton's law of impact",
        error: 0.0,
    })
}

/// Eight touching spheres hit by the first: all move at an eighth of its speed.
fn row() -> Result<Check, VerifyError> {
    let mut world = world(0.0, 0.0)?;
    world.gravity = Vec3::ZERO;
    for i in 0..8 {
        add_sphere(&mut world, 0.1, Vec3::new(0.2 * f64::from(i), 0.0, 0.0))?;
    }
    world.bodies.velocity[0] = Vec3::X;
    Bench::new(1e-3, 1e-3, 1e-12, Relaxed)?.step(&mut world)?;
    Ok(Check {
        id: "A9",
        what: "row of 8 spheres: speed of the last (m/s)".into(),
        measured: world.bodies.velocity[7].x,
        expected: 0.125,
        tolerance: 1e-8,
        source: "plastic simultaneous impact",
        error: 0.0,
    })
}
