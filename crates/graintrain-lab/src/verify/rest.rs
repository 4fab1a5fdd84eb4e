//! Rest: A10, A12, A13.

use super::bench::{Bench, G, add_ground, add_sphere, world};
use super::{Check, VerifyError};
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::{Geometry, Part, Shape};
use graintrain::world::{Body, World};
use graintrain_ccp::FrictionModel::Relaxed;
use std::f64::consts::FRAC_PI_2;

/// The checks.
///
/// # Errors
/// [`VerifyError`] where one cannot be made.
pub fn checks() -> Result<Vec<Check>, VerifyError> {
    let mut checks = vec![stack()?];
    for degrees in [30.0, 60.0] {
        checks.push(groove(degrees)?);
    }
    checks.push(table()?);
    Ok(checks)
}

/// Contact forces of the last step, N.
fn forces(world: &World, step: f64) -> Vec<f64> {
    let set = &world.contacts;
    set.contacts
        .iter()
        .zip(&set.impulse)
        .map(|(contact, impulse)| impulse.dot(contact.normal) / step)
        .collect()
}

/// Ten boxes: the force between two of them is the weight above.
fn stack() -> Result<Check, VerifyError> {
    let mut world = world(0.5, 0.0)?;
    add_ground(&mut world, 0.0)?;
    let block = world.add_geometry(Geometry::cuboid(Vec3::splat(0.1))?);
    for k in 0..10 {
        world.add_body(Body::new(block, 0, Vec3::new(0.0, 0.0, 0.1 + 0.2 * f64::from(k))))?;
    }
    let step = 0.005;
    Bench::new(step, 0.01, 1e-10, Relaxed)?.steps(&mut world, 100)?;
    let all = forces(&world, step);
    let worst = (0..10_u32)
        .map(|level| {
            let set = &world.contacts.contacts;
            let here = (0..set.len()).filter(|&i| {
                let (a, b) = (set[i].body_a, set[i].body_b);
                (a.min(b), a.max(b)) == (level, level + 1)
            });
            let force: f64 = here.map(|i| all[i]).sum();
            (force / (world.bodies.mass[1] * G * f64::from(10 - level)) - 1.0).abs()
        })
        .fold(0.0, f64::max);
    Ok(Check {
        id: "A10",
        what: "stack of 10 boxes: largest relative error of a force (1)".into(),
        measured: worst,
        expected: 0.0,
        tolerance: 1e-6,
        source: "weights above",
        error: 0.0,
    })
}

/// A sphere in a frictionless V of half angle a: forces m g / (2 sin a).
fn groove(degrees: f64) -> Result<Check, VerifyError> {
    let (radius, half, step) = (0.1, degrees.to_radians(), 1e-3);
    let mut world = world(0.0, 0.0)?;
    let plane = world.add_geometry(Geometry::plane());
    let fixed = world.add_motion(Motion::fixed())?;
    for sign in [-1.0, 1.0] {
        let orientation = Quat::from_rotation_y(sign * (FRAC_PI_2 - half));
        world.add_body(Body { motion: fixed, orientation, ..Body::new(plane, 0, Vec3::ZERO) })?;
    }
    let ball = add_sphere(&mut world, radius, Vec3::new(0.0, 0.0, radius / half.sin()))?;
    Bench::new(step, 1e-3, 1e-11, Relaxed)?.steps(&mut world, 20)?;
    Ok(Check {
        id: "A12",
        what: format!("sphere in a V of half angle {degrees} degrees: force over weight (1)"),
        measured: forces(&world, step).first().copied().unwrap_or(f64::NAN) / (world.bodies.mass[ball] * G),
        expected: 0.5 / half.sin(),
        tolerance: 1e-8,
        source: "statics",
        error: 0.0,
    })
}

/// A table on four legs: the forces add up to the weight.
fn table() -> Result<Check, VerifyError> {
    let mut world = world(0.4, 0.0)?;
    add_ground(&mut world, 0.0)?;
    let part = |x: f64, y: f64, z: f64, shape: Shape| Part {
        shape,
        position: Vec3::new(x, y, z),
        orientation: Quat::IDENTITY,
    };
    let mut parts = vec![part(0.0, 0.0, 0.75, Shape::Box { half: Vec3::new(0.6, 0.4, 0.05) })];
    for (x, y) in [(0.5, 0.3), (0.5, -0.3), (-0.5, -0.3), (-0.5, 0.3)] {
        parts.push(part(x, y, 0.35, Shape::Capsule { half_length: 0.3, radius: 0.05 }));
    }
    let (geometry, centre) = Geometry::compound(parts)?;
    let geometry = world.add_geometry(geometry);
    let body = world.add_body(Body::new(geometry, 0, centre))? as usize;
    let step = 1e-3;
    Bench::new(step, 1e-3, 1e-11, Relaxed)?.steps(&mut world, 20)?;
    Ok(Check {
        id: "A13",
        what: "table on four legs: sum of the forces over the weight (1)".into(),
        measured: forces(&world, step).iter().sum::<f64>() / (world.bodies.mass[body] * G),
        expected: 1.0,
        tolerance: 1e-8,
        source: "statics",
        error: 0.0,
    })
}
