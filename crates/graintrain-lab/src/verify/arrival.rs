//! Arrival within a step: A25.

use super::bench::{Accuracy, Bench, add_ground, add_sphere, world};
use super::impact::closed_form;
use super::source::{RELAXED, Source};
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::math::Vec3;
use graintrain_ccp::FrictionModel::Relaxed;

/// The cases.
pub const CASES: &[Definition] = &[Definition {
    id: "A25",
    title: "Impact at eight phases of the step",
    setup: "A sphere with e = 0.5 hits a plane without gravity, head-on and at 45 degrees with mu = 0.1, from such distances that it arrives \
            at 1/16, 3/16 to 15/16 of a step; obliquely with exact friction alone.",
    sources: &[
        Source::Algebra("as A7: the rebound does not depend on when within a step the sphere arrives"),
        RELAXED,
    ],
    measure: Measure::Small(phases),
}];

fn phases() -> Result<Vec<Row>, VerifyError> {
    let (radius, step, restitution) = (0.1, 1e-3, 0.5);
    let mut rows = Vec::new();
    for model in MODELS {
        // Relaxed friction lifts what slides: at which phase is part of its answer.
        let all = [("head-on", 0.0_f64, 0.1), ("45 degrees", 45.0, 0.1)];
        let cases = if model == Relaxed { &all[..1] } else { &all[..] };
        for &(name, degrees, friction) in cases {
            let angle = degrees.to_radians();
            let [left, up] = closed_form(angle, friction, restitution, model);
            for (envelope, accuracy) in
                [0.0, 0.01 * radius].into_iter().flat_map(|e| Accuracy::both(1e-11).map(|a| (e, a)))
            {
                let (mut slip_error, mut rebound_error) = (0.0_f64, 0.0_f64);
                let mut all: Option<Bench> = None;
                for phase in 0..8 {
                    let phase = (2.0 * f64::from(phase) + 1.0) / 16.0;
                    let mut world = world(friction, restitution)?;
                    world.gravity = Vec3::ZERO;
                    add_ground(&mut world, 0.0)?;
                    let gap = (1.0 + phase) * step * angle.cos();
                    let ball = add_sphere(&mut world, radius, Vec3::new(0.0, 0.0, radius + gap))?;
                    world.bodies.velocity[ball] = Vec3::new(angle.sin(), 0.0, -angle.cos());
                    let mut bench = Bench::new(step, envelope, accuracy, model)?;
                    bench.steps(&mut world, 6)?;
                    let u = world.bodies.velocity[ball];
                    let slip = u.x - radius * world.bodies.angular_velocity[ball].y;
                    slip_error = slip_error.max((slip - left).abs());
                    rebound_error = rebound_error.max((u.z - up).abs());
                    all = Some(match all {
                        Some(sum) => bench.and(&sum),
                        None => bench,
                    });
                }
                let Some(bench) = all else { continue };
                let row = |what: &str, error| {
                    let what = format!("{name}, envelope {envelope} m: largest error of the {what} (m/s)");
                    bench.row(what, error, 0.0, accuracy.allowed(1e-6, 1.0))
                };
                rows.push(row("rebound", rebound_error));
                rows.push(row("slip left", slip_error));
            }
        }
    }
    Ok(rows)
}
