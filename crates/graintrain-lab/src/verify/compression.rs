//! Tier B: density and contacts per grain of packings.
//!
//! A gas in a periodic cell is compressed at a constant rate of strain. Grains are rigid, so that the pressure p rises from that of a gas without bound
//! where the sample jams; it is taken as jammed where the inertial number I = rate d sqrt(rho / p) falls below 1e-3. There are no walls: density and
//! contacts are those of all grains.

use super::bench::{Accuracy, Bench, add_sphere, random};
use super::source::{AGNOLIN_ROUX, SILBERT, SONG_WANG_MAKSE, Source};
use super::{Definition, Measure, Row, Sampling, VerifyError};
use crate::reproduce::ReproduceError;
use graintrain::cell::{Cell, Drive};
use graintrain::material::Materials;
use graintrain::math::Vec3;
use graintrain::measure::contacts::coordination;
use graintrain::measure::space::{porosity, selected};
use graintrain::measure::stress::{pressure, stress};
use graintrain::motion::Profile;
use graintrain::world::World;
use graintrain_ccp::FrictionModel::{self, Relaxed};
use std::f64::consts::PI;
use std::sync::atomic::Ordering;

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "B1",
        title: "Random close packing without friction",
        setup: "A gas of 2 197 spheres, radii within 10 %, without friction is compressed in a periodic cell to an inertial number of 1e-3.",
        sources: &[AGNOLIN_ROUX, SILBERT],
        measure: Measure::Sample(|sampling| {
            let (bench, jammed) = compress(0.0, 13, sampling, Relaxed)?;
            Ok(vec![
                bench.row("volume fraction (1)", jammed.density, 0.639, 0.005),
                bench.row("contacts per grain of the backbone (1)", jammed.contacts, 6.0, 0.15),
            ])
        }),
    },
    Definition {
        id: "B2",
        title: "Isotropic compression with friction",
        setup: "A gas of 2 197 spheres, radii within 10 %, mu = 0.3 from the gas on, is compressed in a periodic cell to an inertial number of 1e-3.",
        sources: &[AGNOLIN_ROUX],
        measure: Measure::SampleWithFriction(|sampling, model| {
            let (bench, jammed) = compress(0.3, 13, sampling, model)?;
            Ok(vec![
                bench.row("volume fraction (1)", jammed.density, 0.593, 0.01),
                bench.row("contacts per grain of the backbone (1)", jammed.contacts, 4.5, 0.2),
            ])
        }),
    },
    Definition {
        id: "B3",
        title: "Density and contacts over the friction coefficient",
        setup: "As B2 with 1 728 spheres at mu = 0.1, 1 and 10: towards random loose packing (B1 has mu = 0).",
        sources: &[
            SILBERT,
            SONG_WANG_MAKSE,
            Source::Algebra("isostatic packings have 4 contacts per grain with much friction"),
        ],
        measure: Measure::SampleWithFriction(over_friction),
    },
];

const RADIUS: f64 = 0.01;

/// Of compression, along every axis, 1/s.
const RATE: f64 = 0.1;

/// Of compressions, s.
const STEP: f64 = 1e-3;

/// Inertial number at which a sample counts as jammed.
const JAMMED: f64 = 1e-3;

/// Volume fraction of the gas.
const GAS: f64 = 0.5;

/// A jammed sample.
struct Jammed {
    /// Volume fraction.
    density: f64,
    /// Neighbours per grain that is no rattler.
    contacts: f64,
}

fn over_friction(sampling: &mut Sampling<'_>, model: FrictionModel) -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    let mut last: Option<Jammed> = None;
    // Ends by the literature; what lies between only has to fall.
    for (friction, ends) in [(0.1, None), (1.0, None), (10.0, Some((0.55, 4.0)))] {
        let (bench, jammed) = compress(friction, 12, sampling, model)?;
        if let Some((density, contacts)) = ends {
            rows.push(bench.row(
                format!("mu = {friction}: volume fraction (1)"),
                jammed.density,
                density,
                0.01,
            ));
            rows.push(bench.row(
                format!("mu = {friction}: contacts per grain (1)"),
                jammed.contacts,
                contacts,
                0.3,
            ));
        }
        if let Some(last) = last {
            let below = |value: f64| if value < 0.0 { 0.0 } else { value };
            let what = format!("mu = {friction}: density above that of the smaller mu (1)");
            rows.push(bench.row(what, below(jammed.density - last.density), 0.0, 0.002));
        }
        let z = jammed.contacts;
        let what = format!("mu = {friction}: volume fraction by z / (z + 2 sqrt 3), B4 (1)");
        rows.push(bench.row(what, jammed.density, z / (z + 2.0 * 3.0_f64.sqrt()), 0.02));
        last = Some(jammed);
    }
    Ok(rows)
}

/// Compresses `edge`^3 spheres until they jam.
fn compress(
    friction: f64,
    edge: i32,
    sampling: &mut Sampling<'_>,
    model: FrictionModel,
) -> Result<(Bench, Jammed), VerifyError> {
    (sampling.progress)(&format!("compression, friction {friction}"));
    let mut world = World::new(Vec3::ZERO, Materials::single("stuff", 1000.0, friction, 0.0)?)?;
    let pitch = 2.0 * RADIUS * (PI / 6.0 / GAS).cbrt();
    let mut next = random(7);
    for k in 0..edge.pow(3) {
        let place =
            Vec3::from_array([k % edge, k / edge % edge, k / edge.pow(2)].map(|i| f64::from(i) + 0.5));
        let radius = RADIUS * (0.9 + 0.05 * (next() + 1.0));
        let jitter = 0.05 * RADIUS * Vec3::new(next(), next(), next());
        let grain = add_sphere(&mut world, radius, pitch * place + jitter)?;
        world.bodies.velocity[grain] = 0.5 * Vec3::new(next(), next(), next());
    }
    let closing = Drive::Rate(Profile::Constant(-RATE));
    let mut cell = Cell::new(Vec3::ZERO, Vec3::splat(pitch * f64::from(edge)), [true; 3])?;
    cell.drive[..3].fill(closing);
    world.set_cell(Some(cell))?;
    let all = selected(&world, None, None);
    let mut bench = Bench::new(STEP, 0.02 * RADIUS, Accuracy::SCENES, model)?;
    loop {
        if sampling.stop.load(Ordering::Relaxed) {
            return Err(ReproduceError::Stopped.into());
        }
        bench.step(&mut world)?;
        let Some(cell) = world.cell() else { unreachable!("nothing takes the cell away") };
        let pressure = pressure(&stress(&world, STEP, &all, cell.volume()).contact);
        let inertial = RATE * 2.0 * RADIUS * (1000.0 / pressure.max(f64::MIN_POSITIVE)).sqrt();
        // Where nothing jams until the cell is half as wide, the last state is judged.
        if inertial < JAMMED || cell.strain[0] < 0.5_f64.ln() {
            let least = if friction == 0.0 { 4 } else { 2 };
            return Ok((
                bench,
                Jammed {
                    density: 1.0 - porosity(&world, &cell.region()),
                    contacts: coordination(&world, &all, least).mean_without_rattlers,
                },
            ));
        }
    }
}
