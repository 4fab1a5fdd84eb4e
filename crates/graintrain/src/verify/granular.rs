//! Tier B: a sheared and a drafted sample, and what must not depend on time step and tolerance.

use super::{Check, VerifyError};
use crate::reproduce::physics::{friction_ratio, steady};
use crate::reproduce::trajectory::{Experiment, Simulate, Variant};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// The checks at size n, from simulations whose states go to a scratch folder.
///
/// # Errors
/// [`VerifyError::Reproduce`] where a simulation fails or is stopped.
pub fn checks(
    n: usize,
    scratch: &Path,
    stop: &Arc<AtomicBool>,
    mut progress: impl FnMut(&str),
) -> Result<Vec<Check>, VerifyError> {
    let mut checks = Vec::new();
    for experiment in [Experiment::Drafting, Experiment::DirectShear] {
        let mut paper = None;
        for variant in [Variant::Paper, Variant::HalfStep, Variant::TenthTolerance] {
            progress(&format!("{}, {}", experiment.scene(), variant.name()));
            let simulate = Simulate { experiment, n, steps: None, variant };
            let trajectory = simulate.run(1, scratch, stop, |_, _| {})?;
            let force = steady(experiment, &trajectory).map_or(f64::NAN, |steady| steady.mean);
            let name = format!("{} n = {n}, {}", experiment.scene(), variant.name());
            let momentum = trajectory.rows.iter().map(|row| row.momentum_error).fold(0.0, f64::max);
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
                checks.push(Check {
                    id: "B0",
                    what: format!("{name}: steady force over that of the paper's step and tolerance (1)"),
                    measured: force / reference,
                    expected: 1.0,
                    tolerance: 0.05,
                    source: "convergence",
                });
            }
            if experiment == Experiment::DirectShear {
                let angle =
                    friction_ratio(&trajectory).map_or(f64::NAN, |ratio| ratio.mean.atan().to_degrees());
                checks.push(Check {
                    id: "B6",
                    what: format!("{name}: friction angle (degrees)"),
                    measured: angle,
                    expected: 22.5,
                    tolerance: 12.5,
                    source: "sheared spheres, mu 0.25: 10 to 35 degrees",
                });
            }
        }
    }
    Ok(checks)
}
