//! Tier B: a sheared and a drafted sample, and what must not depend on time step and tolerance.

use super::bench::Accuracy;
use super::source::{CHIALVO, Source};
use super::{Definition, Measure, Row, Sampling, VerifyError};
use crate::reproduce::SEEDS;
use crate::reproduce::physics::{Sensitivity, Steady, friction_ratio, steady};
use crate::reproduce::trajectory::{Experiment, Simulate, Variant};
use graintrain_ccp::{Criterion, FrictionModel, SolverSpec};

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "P2",
        title: "Drafting",
        setup: "A blade drafts through a settled bed: the scene as it is, with half the time step, and with a tenth of the tolerance, \
                four perturbed lattices each.",
        sources: &[Source::Algebra(
            "Newton's second law; converged forces change by less than 5 % (a goal, not a law)",
        )],
        measure: Measure::Sample(|sampling| checks(Experiment::Drafting, sampling)),
    },
    Definition {
        id: "P3",
        title: "Direct shear",
        setup: "A sample is sheared under a press: the scene as it is, with half the time step, and with a tenth of the tolerance, \
                four perturbed lattices each.",
        sources: &[
            CHIALVO,
            Source::Algebra(
                "Newton's second law; converged forces change by less than 5 % (a goal, not a law)",
            ),
        ],
        measure: Measure::Sample(|sampling| checks(Experiment::DirectShear, sampling)),
    },
];

fn checks(experiment: Experiment, sampling: &mut Sampling<'_>) -> Result<Vec<Row>, VerifyError> {
    let nowhere = Steady { mean: f64::NAN, error: f64::NAN };
    let n = sampling.n;
    let mut rows = Vec::new();
    let mut paper: Vec<(u64, Steady)> = Vec::new();
    for variant in [Variant::Paper, Variant::HalfStep, Variant::TenthTolerance] {
        let (mut forces, mut ratios, mut momentum) = (Vec::new(), Vec::new(), 0.0_f64);
        for seed in 1..=SEEDS {
            (sampling.progress)(&format!("{}, {}, seed {seed}", experiment.scene(), variant.name()));
            let simulate = Simulate { experiment, n, steps: None, variant, seed };
            let trajectory = simulate.run(0, &sampling.scratch, &sampling.stop, |_, _| {})?;
            forces.extend(steady(experiment, &trajectory).map(|force| (seed, force)));
            ratios.extend(friction_ratio(&trajectory));
            momentum = trajectory.rows.iter().map(|row| row.momentum_error).fold(momentum, f64::max);
        }
        let row = |what: &str, measured, expected, allowed, error| Row {
            what: format!("n = {n}, {}: {what}", variant.name()),
            friction: Some(FrictionModel::Relaxed),
            solver: SolverSpec::default().to_string(),
            step: 0.0,
            accuracy: Accuracy {
                tolerance: if variant == Variant::TenthTolerance { 1e-4 } else { 1e-3 },
                criterion: Criterion::Mixed,
            },
            measured,
            expected,
            allowed,
            error,
            steps: 0,
            unsolved: 0,
        };
        let what = "largest defect of a body's momentum over the impulses on it (1)";
        rows.push(row(what, momentum, 0.0, 1e-9, 0.0));
        if variant == Variant::Paper {
            paper = forces;
        } else {
            let found = Sensitivity::of(experiment, variant, &paper, &forces);
            let change = found.map_or(nowhere, |found| found.change);
            rows.push(row("relative change of the steady force (1)", change.mean, 0.0, 0.05, change.error));
        }
        if experiment == Experiment::DirectShear {
            let ratio = Steady::over(ratios.into_iter()).unwrap_or(nowhere);
            let error = (ratio.error / (1.0 + ratio.mean * ratio.mean)).to_degrees();
            rows.push(row("friction angle (degrees)", ratio.mean.atan().to_degrees(), 18.6, 5.0, error));
        }
    }
    Ok(rows)
}
