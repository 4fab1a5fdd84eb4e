//! Impacts: A7, A8, A9, A20.

use super::bench::{Accuracy, Bench, add_ground, add_sphere, world};
use super::source::{CHUNG_OOI, MOREAU, RELAXED, Source};
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::math::Vec3;
use graintrain_ccp::FrictionModel::{self, Coulomb, Relaxed};

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "A7",
        title: "Oblique impact on a plane",
        setup: "A sphere hits a plane at unit speed without gravity, at angles between 10 and 85 degrees from the normal, mu between 0 and 1, \
                e of 0, 0.3 and 0.9.",
        sources: &[
            Source::Algebra(
                "sticking ends the slip s; sliding leaves s' = s - 7/2 mu (1 + e) v_n, in the relaxed model s' / (1 + 7/2 mu^2) \
                 with rebound e v_n + mu s'",
            ),
            RELAXED,
        ],
        measure: Measure::Small(oblique_impacts),
    },
    Definition {
        id: "A8",
        title: "Head-on impact of two spheres",
        setup: "Spheres of masses 1 : 8 meet head-on at 3 m/s without gravity.",
        sources: &[Source::Algebra(
            "Newton's law of impact: separation e v, momentum kept, energy lost 1/2 m_red v^2 (1 - e^2)",
        )],
        measure: Measure::Small(head_on),
    },
    Definition {
        id: "A9",
        title: "Row of spheres, plastic",
        setup: "The first of eight touching spheres in a row moves at 1 m/s towards the others, e = 0, without friction and gravity.",
        sources: &[Source::Algebra("a plastic simultaneous impact: all move at an eighth"), MOREAU],
        measure: Measure::Small(row),
    },
    Definition {
        id: "A20",
        title: "Alumina sphere on glass",
        setup: "A sphere with mu = 0.092 and e = 0.98 hits a plane at 35 to 85 degrees from the normal, where it slides throughout \
                (below 32.5 degrees a rigid body cannot follow the elastic one).",
        sources: &[
            CHUNG_OOI,
            Source::Algebra("tangential restitution 1 - mu (1 + e) / tan of the angle; relaxed as in A7"),
        ],
        measure: Measure::Small(alumina),
    },
];

/// A sphere that hits a plane at unit speed, `angle` from the normal, in one step without gravity: tangential
/// velocity, R omega, rebound velocity.
fn oblique(
    angle: f64,
    friction: f64,
    restitution: f64,
    accuracy: Accuracy,
    model: FrictionModel,
) -> Result<(Bench, [f64; 3]), VerifyError> {
    let radius = 0.1;
    let mut world = world(friction, restitution)?;
    world.gravity = Vec3::ZERO;
    add_ground(&mut world, 0.0)?;
    let ball = add_sphere(&mut world, radius, Vec3::new(0.0, 0.0, radius))?;
    world.bodies.velocity[ball] = Vec3::new(angle.sin(), 0.0, -angle.cos());
    let mut bench = Bench::new(1e-3, 1e-3, accuracy, model)?;
    bench.step(&mut world)?;
    let u = world.bodies.velocity[ball];
    Ok((bench, [u.x, radius * world.bodies.angular_velocity[ball].y, u.z]))
}

/// Slip left and rebound after an oblique impact at unit speed.
pub(super) fn closed_form(angle: f64, friction: f64, restitution: f64, model: FrictionModel) -> [f64; 2] {
    let (tangential, normal) = (angle.sin(), angle.cos());
    let slip = (tangential - 3.5 * friction * (1.0 + restitution) * normal).max(0.0);
    match model {
        Coulomb => [slip, restitution * normal],
        Relaxed => {
            let left = slip / (1.0 + 3.5 * friction * friction);
            [left, restitution * normal + friction * left]
        }
    }
}

fn oblique_impacts() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for model in MODELS {
        for (degrees, friction, restitution) in
            [(45.0, 0.1, 0.0), (60.0, 0.25, 0.0), (75.0, 0.25, 0.0), (75.0, 0.5, 0.0), (75.0, 0.25, 0.9)]
        {
            let angle = f64::to_radians(degrees);
            let accuracy = Accuracy::SCENES;
            let (bench, [u, spin, rebound]) = oblique(angle, friction, restitution, accuracy, model)?;
            let [left, up] = closed_form(angle, friction, restitution, model);
            let name = format!("{degrees} degrees, mu {friction}, e {restitution}");
            let allowed = accuracy.allowed(1e-6, 1.0);
            rows.push(bench.row(format!("{name}: slip left (m/s)"), u - spin, left, allowed));
            rows.push(bench.row(format!("{name}: rebound (m/s)"), rebound, up, allowed));
        }
        for accuracy in Accuracy::both(1e-11) {
            let mut all: Option<Bench> = None;
            let mut worst: f64 = 0.0;
            for degrees in [10.0_f64, 30.0, 45.0, 60.0, 75.0, 85.0] {
                for friction in [0.0, 0.05, 0.25, 0.5, 1.0] {
                    for restitution in [0.0, 0.3, 0.9] {
                        let angle = degrees.to_radians();
                        let (bench, [u, spin, rebound]) =
                            oblique(angle, friction, restitution, accuracy, model)?;
                        let [left, up] = closed_form(angle, friction, restitution, model);
                        // Angular momentum about the contact point is kept, too.
                        let kept = (u + 0.4 * spin - angle.sin()).abs();
                        worst = worst.max((u - spin - left).abs()).max((rebound - up).abs()).max(kept);
                        all = Some(match all {
                            Some(sum) => bench.and(&sum),
                            None => bench,
                        });
                    }
                }
            }
            let row = |bench: Bench| {
                bench.row("largest error of 90 impacts (m/s)", worst, 0.0, accuracy.allowed(1e-6, 1.0))
            };
            rows.extend(all.map(row));
        }
    }
    Ok(rows)
}

fn head_on() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for model in MODELS {
        for restitution in [0.0, 0.5, 1.0] {
            for accuracy in Accuracy::both(1e-13) {
                let mut world = world(0.3, restitution)?;
                world.gravity = Vec3::ZERO;
                let a = add_sphere(&mut world, 0.1, Vec3::new(-0.1, 0.0, 0.0))?;
                let b = add_sphere(&mut world, 0.2, Vec3::new(0.2, 0.0, 0.0))?;
                let (m_a, m_b) = (world.bodies.mass[a], world.bodies.mass[b]);
                world.bodies.velocity[a] = 2.0 * Vec3::X;
                world.bodies.velocity[b] = -Vec3::X;
                let before = world.kinetic_energy();
                let mut bench = Bench::new(1e-3, 1e-3, accuracy, model)?;
                bench.step(&mut world)?;
                let (u_a, u_b) = (world.bodies.velocity[a].x, world.bodies.velocity[b].x);
                let lost = 4.5 * m_a * m_b / (m_a + m_b) * (1.0 - restitution * restitution);
                let digits = |scale: f64| accuracy.allowed(1e-10, scale);
                let row = |what: &str, measured, expected, allowed| {
                    bench.row(format!("e {restitution}: {what}"), measured, expected, allowed)
                };
                let kept = (m_a * u_a + m_b * u_b) / (2.0 * m_a - m_b);
                let loss = 1.0 - world.kinetic_energy() / before;
                rows.push(row("velocity of separation (m/s)", u_b - u_a, 3.0 * restitution, digits(3.0)));
                rows.push(row("momentum over that before (1)", kept, 1.0, 1e-12));
                rows.push(row("part of the energy lost (1)", loss, lost / before, digits(1.0)));
            }
        }
    }
    Ok(rows)
}

fn row() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-12) {
            let mut world = world(0.0, 0.0)?;
            world.gravity = Vec3::ZERO;
            for i in 0..8 {
                add_sphere(&mut world, 0.1, Vec3::new(0.2 * f64::from(i), 0.0, 0.0))?;
            }
            world.bodies.velocity[0] = Vec3::X;
            let mut bench = Bench::new(1e-3, 1e-3, accuracy, model)?;
            bench.step(&mut world)?;
            let speeds = world.bodies.velocity.iter().map(|u| (u.x - 0.125).abs());
            let worst = speeds.fold(0.0, f64::max);
            rows.push(bench.row(
                "largest difference of a sphere's speed from 0.125 m/s (m/s)",
                worst,
                0.0,
                accuracy.allowed(1e-8, 1.0),
            ));
        }
    }
    Ok(rows)
}

fn alumina() -> Result<Vec<Row>, VerifyError> {
    let (friction, restitution) = (0.092, 0.98);
    let mut rows = Vec::new();
    let measured = [(40.0, 0.781), (50.0, 0.845), (60.0, 0.893), (70.0, 0.932), (80.0, 0.966), (85.0, 0.983)];
    for (degrees, digitised) in measured {
        let angle = f64::to_radians(degrees);
        let (bench, [u, ..]) = oblique(angle, friction, restitution, Accuracy::SCENES, Coulomb)?;
        let what = format!("tangential restitution at {degrees} degrees, against the digitised curve (1)");
        rows.push(bench.row(what, u / angle.sin(), digitised, 0.005));
    }
    for model in MODELS {
        let accuracy = Accuracy::SCENES;
        for degrees in [35.0, 60.0, 85.0] {
            let angle = f64::to_radians(degrees);
            let (bench, [u, ..]) = oblique(angle, friction, restitution, accuracy, model)?;
            // u + 2/5 R omega is kept, u - R omega is the slip left.
            let [left, _] = closed_form(angle, friction, restitution, model);
            let expected = (5.0 + 2.0 * left / angle.sin()) / 7.0;
            let what = format!("tangential restitution at {degrees} degrees, closed form (1)");
            rows.push(bench.row(what, u / angle.sin(), expected, accuracy.allowed(1e-6, 1.0)));
        }
    }
    Ok(rows)
}
