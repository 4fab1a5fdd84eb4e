//! Tier B: a sheared and a drafted sample, and what must not depend on time step and tolerance.

use super::{Check, VerifyError};
use crate::reproduce::SEEDS;
use crate::reproduce::physics::{Steady, friction_ratio, steady};
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
        let mut paper = None;
        for variant in [Variant::Paper, Variant::HalfStep, Variant::TenthTolerance] {
            let (mut forces, mut ratios, mut momentum) = (Vec::new(), Vec::new(), 0.0_f64);
            for seed in 1..=SEEDS {
                progress(&format!("{}, {}, seed {seed}", experiment.scene(), variant.name()));
                let simulate = Simulate { experiment, n, steps: None, variant, seed };
                let trajectory = simulate.run(0, scratch, stop, |_, _| {})?;
                forces.extend(steady(experiment, &trajectory));
                ratios.extend(friction_ratio(&trajectory));
                momentum = trajectory.rows.iter().map(|row| row.momentum_error).fold(momentum, f64::max);
            }
            let force = Steady::over(forces.into_iter()).unwrap_or(nowhere);
            let name = format!("{} n = {n}, {}", experiment.scene(), variant.name());
            checks.push(Check {
                id: "B0",
                what: format!("{name}: largest defect of momentum over a grain's weight impulse (1)"),
                measured: momentum,
                expected: 0.0,
                tolerance: 1e-6,
                source: "Newton's second law",
            });
            let reference = *paper.get_or_insert(force);
            if variant != Variant::Paper {
                let error = force.error.hypot(reference.error) / reference.mean.abs();
                checks.push(Check {
                    id: "B0",
                    what: format!("{name}: steady force over that of the paper's step and tolerance (1)"),
                    measured: force.mean / reference.mean,
                    expected: 1.0,
                    tolerance: 0.05_f64.max(2.0 * error),
                    source: "convergence: 5 %, or two standard errors",
                });
            }
            if experiment == Experiment::DirectShear {
                let ratio = Steady::over(ratios.into_iter()).unwrap_or(nowhere);
                checks.push(Check {
                    id: "B6",
                    what: format!("{name}: friction angle (degrees)"),
                    measured: ratio.mean.atan().to_degrees(),
                    expected: 22.5,
                    tolerance: 12.5,
                    source: "sheared spheres, mu 0.25: 10 to 35 degrees",
                });
            }
        }
    }
    Ok(checks)
}
