//! Tier B: density and contacts per grain of isotropic packings, compressed from a gas in a periodic cell
//! ([`PeriodicSample`]).

use super::periodic_sample::PeriodicSample;
use super::source::{AGNOLIN_ROUX, SILBERT, SONG_WANG_MAKSE, Source};
use super::{Definition, Measure, Row, Sampling, VerifyError};
use graintrain_ccp::FrictionModel::{self, Relaxed};

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "B1",
        title: "Random close packing without friction",
        setup: "A gas of 1 000 spheres, radii within 10 %, without friction is compressed at 0.1/s in a periodic cell and held under a pressure.",
        sources: &[AGNOLIN_ROUX, SILBERT],
        measure: Measure::Sample(|sampling| {
            let sample = PeriodicSample::compressed(0.0, 10, sampling, Relaxed)?;
            Ok(vec![
                sample.bench.row("volume fraction (1)", sample.density(), 0.639, 0.005),
                sample.bench.row("contacts per grain of the backbone (1)", sample.contacts(), 6.0, 0.15),
            ])
        }),
    },
    Definition {
        id: "B2",
        title: "Isotropic compression with friction",
        setup: "As B1 with mu = 0.3 from the gas on.",
        sources: &[AGNOLIN_ROUX],
        measure: Measure::SampleWithFriction(|sampling, model| {
            let sample = PeriodicSample::compressed(0.3, 10, sampling, model)?;
            Ok(vec![
                sample.bench.row("volume fraction (1)", sample.density(), 0.593, 0.01),
                sample.bench.row("contacts per grain of the backbone (1)", sample.contacts(), 4.5, 0.2),
            ])
        }),
    },
    Definition {
        id: "B3",
        title: "Density and contacts over the friction coefficient",
        setup: "As B1 with 729 spheres at mu = 0.1, 1 and 10: towards random loose packing (B1 has mu = 0).",
        sources: &[
            SILBERT,
            SONG_WANG_MAKSE,
            Source::Algebra("isostatic packings have 4 contacts per grain with much friction"),
        ],
        measure: Measure::SampleWithFriction(over_friction),
    },
];

fn over_friction(sampling: &mut Sampling<'_>, model: FrictionModel) -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    let mut denser: Option<f64> = None;
    // Ends by the literature; what lies between only has to fall.
    for (friction, ends) in [(0.1, None), (1.0, None), (10.0, Some((0.55, 4.0)))] {
        let sample = PeriodicSample::compressed(friction, 9, sampling, model)?;
        let (density, contacts) = (sample.density(), sample.contacts());
        let mut row = |what: &str, measured, expected, allowed| {
            rows.push(sample.bench.row(format!("mu = {friction}: {what}"), measured, expected, allowed));
        };
        if let Some((expected_density, expected_contacts)) = ends {
            row("volume fraction (1)", density, expected_density, 0.01);
            row("contacts per grain (1)", contacts, expected_contacts, 0.3);
        }
        if let Some(denser) = denser {
            row("density above that of the smaller mu (1)", f64::max(density - denser, 0.0), 0.0, 0.002);
        }
        let by_contacts = contacts / (contacts + 2.0 * 3.0_f64.sqrt());
        row("volume fraction by z / (z + 2 sqrt 3), B4 (1)", density, by_contacts, 0.02);
        denser = Some(density);
    }
    Ok(rows)
}
