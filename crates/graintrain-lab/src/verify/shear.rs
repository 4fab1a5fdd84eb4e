//! Tier B: slow simple shear in a periodic cell ([`PeriodicSample`]): the friction and density of the
//! critical state.

use super::periodic_sample::PeriodicSample;
use super::source::{CHIALVO, PEYNEAU_ROUX, Source};
use super::{Definition, Measure, Row, Sampling, VerifyError};
use graintrain_ccp::FrictionModel::{self, Relaxed};

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "B5",
        title: "Simple shear without friction",
        setup: "The sample of B1, of 512 spheres, is sheared to a strain of 1 under the same normal stresses at an inertial number of 1e-3; the published angle is that of slower and slower shear.",
        sources: &[
            PEYNEAU_ROUX,
            Source::Algebra(
                "the angle is atan of the mean shear stress over the pressure; no dilatancy: the density stays that of B1",
            ),
        ],
        measure: Measure::Sample(|sampling| {
            let mut sample = PeriodicSample::compressed(0.0, 8, sampling, Relaxed)?;
            let sheared = sample.sheared(sampling)?;
            let (ratio, density) = (sheared.stress_ratio, sheared.density);
            let degrees = ratio.value.atan().to_degrees();
            let error = (ratio.error / (1.0 + ratio.value * ratio.value)).to_degrees();
            let bench = &sample.bench;
            Ok(vec![
                Row { error, ..bench.row("friction angle (degrees)", degrees, 5.76, 0.6) },
                Row { error: density.error, ..bench.row("volume fraction (1)", density.value, 0.639, 0.005) },
            ])
        }),
    },
    Definition {
        id: "B6",
        title: "The critical state with friction",
        setup: "As B5 with mu = 0.1, 0.3 and 0.5.",
        sources: &[CHIALVO],
        measure: Measure::SampleWithFriction(critical_states),
    },
];

fn critical_states(sampling: &mut Sampling<'_>, model: FrictionModel) -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for (friction, expected_density, expected_ratio) in
        [(0.1, 0.613, 0.27), (0.3, 0.596, 0.36), (0.5, 0.587, 0.38)]
    {
        let mut sample = PeriodicSample::compressed(friction, 8, sampling, model)?;
        let sheared = sample.sheared(sampling)?;
        let (ratio, density) = (sheared.stress_ratio, sheared.density);
        let row = |what: &str, measured, expected, allowed| {
            sample.bench.row(format!("mu = {friction}: {what}"), measured, expected, allowed)
        };
        rows.push(Row {
            error: ratio.error,
            ..row("shear stress over pressure (1)", ratio.value, expected_ratio, 0.03)
        });
        rows.push(Row {
            error: density.error,
            ..row("volume fraction (1)", density.value, expected_density, 0.01)
        });
    }
    Ok(rows)
}
