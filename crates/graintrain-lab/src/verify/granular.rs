//! Tier B: a sheared and a drafted sample, and what must not depend on time step and tolerance.

use super::{Check, VerifyError};
use crate::reproduce::SEEDS;
use crate::reproduce::physics::{Sensitivity, Steady, friction_ratio, steady};
use crate::reproduce::trajectory::{Experiment, Simulate, Variant};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// The checks at size n, averaged over perturbed lattices, from simulations whose states go to a scratch folder.
///
/// # Errors
/// [`VerifyError::Reproduce`] where a simulation fails or is stopped.
pub fn checks(
    n: usize,
    scratch: &Path,
    stop: &Arc<AtomicBool>,
    mut progress: impl FnMut(&str),
) -> Result<Vec<Check>, VerifyError> {
    let nowhere = Steady { mean: f64::NAN, error: f64::NAN };
    let mut checks = Vec::new();
    for experiment in [Experiment::Drafting, Experiment::DirectShear] {
        let mut paper: Vec<(u64, Steady)> = Vec::new();
        for variant in [Variant::Paper, Variant::HalfStep, Variant::TenthTolerance] {
            let (mut forces, mut ratios, mut momentum) = (Vec::new(), Vec::new(), 0.0_f64);
            for seed in 1..=SEEDS {
                progress(&format!("{}, {}, seed {seed}", experiment.scene(), variant.name()));
                let simulate = Simulate { experiment, n, steps: None, variant, seed };
                let trajectory = simulate.run(0, scratch, stop, |_, _| {})?;
                forces.extend(steady(experiment, &trajectory).map(|force| (seed, force)));
                ratios.extend(friction_ratio(&trajectory));
                momentum = trajectory.rows.iter().map(|row| row.momentum_error).fold(momentum, f64::max);
            }
            let name = format!("{} n = {n}, {}", experiment.scene(), variant.name());
            checks.push(Check {
                id: "B0",
                what: format!("{name}: largest defect of a body's momentum over the impulses on it (1)"),
                measured: momentum,
                expected: 0.0,
                tolerance: 1e-9,
                source: "Newton's second law",
                error: 0.0,
            });
            if variant == Variant::Paper {
                paper = forces;
            } else {
                let found = Sensitivity::of(experiment, variant, &paper, &forces);
                let change = found.map_or(nowhere, |found| found.change);
                checks.push(Check {
                    id: "B0",
                    what: format!("{name}: relative change of the steady force (1)"),
                    measured: change.mean,
                    expected: 0.0,
                    tolerance: 0.05,
                    source: "convergence: 5 %",
                    error: change.error,
                });
            }
            if experiment == Experiment::DirectShear {
                let ratio = Steady::over(ratios.into_iter()).unwrap_or(nowhere);
                checks.push(Check {
                    id: "B6",
                    what: format!("{name}: friction angle (degrees)"),
                    measured: ratio.mean.atan().to_degrees(),
                    expected: 18.6,
                    tolerance: 5.0,
                    source: "critical state, mu 0.25: Chialvo, Sun, Sundaresan 2012",
                    error: (ratio.error / (1.0 + ratio.mean * ratio.mean)).to_degrees(),
                });
            }
        }
    }
    Ok(checks)
}
