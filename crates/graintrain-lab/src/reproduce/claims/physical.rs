//! This project's goals for forces, friction angles and momentum, with verdicts from the simulations.

use super::super::physics::{Sensitivity, friction_ratio_over_seeds, sensitivities, trend_over_seeds};
use super::super::trajectory::Variant;
use super::{Claim, Results, Verdict, number};

/// Steady forces under half the step and a tenth of the tolerance, the angle of friction, momentum.
pub(super) fn verdicts(results: &Results) -> Vec<Claim> {
    let mut claims = Vec::new();
    for sensitivity in sensitivities(results).iter().filter(|s| s.variant != Variant::Coulomb) {
        let change = match sensitivity.variant {
            Variant::HalfStep => "half the time step",
            _ => "a tenth of the tolerance",
        };
        let Sensitivity { experiment, paper, changed, change: relative, pairs, .. } = sensitivity;
        let trend = trend_over_seeds(results, *experiment, Variant::Paper).map_or(String::new(), |trend| {
            format!(
                " From the first to the second half of the steady part the force changes by {} %.",
                number(100.0 * trend)
            )
        });
        claims.push(Claim {
            place: "this project",
            statement: format!(
                "Steady force in {} changes by less than 5 % with {change}.",
                experiment.scene()
            ),
            verdict: Verdict::within(0.05, relative.mean, relative.error),
            evidence: format!(
                "{} N to {} N: {} +- {} % ({pairs} {}).{trend}",
                number(paper.mean),
                number(changed.mean),
                number(100.0 * relative.mean),
                number(100.0 * relative.error),
                if *pairs == 1 { "lattice" } else { "lattices" }
            ),
        });
    }
    for variant in [Variant::Paper, Variant::Coulomb] {
        let Some(ratio) = friction_ratio_over_seeds(results, variant) else {
            continue;
        };
        let degrees = |tangent: f64| tangent.atan().to_degrees();
        claims.push(Claim {
            place: "this project",
            statement: format!(
                "The friction angle of the sheared sample ({} friction) is physical: 15 to 25 degrees (critical state of spheres with \
                 this friction, Chialvo, Sun, Sundaresan 2012: 18.6).",
                variant.name()
            ),
            verdict: Verdict::within(5.0, degrees(ratio.mean) - 20.0, degrees(ratio.mean + ratio.error) - degrees(ratio.mean)),
            evidence: format!(
                "Shear force over normal force on the plane between the halves {} +- {}: {} degrees.",
                number(ratio.mean),
                number(ratio.error),
                number(degrees(ratio.mean))
            ),
        });
    }
    let worst = results
        .trajectories
        .iter()
        .flat_map(|(_, t)| &t.rows)
        .map(|row| row.momentum_error)
        .fold(0.0, f64::max);
    if !results.trajectories.is_empty() {
        claims.push(Claim {
            place: "this project",
            statement: "The momentum of every body is balanced exactly in every step.".into(),
            verdict: Verdict::of(worst < 1e-9),
            evidence: format!(
                "Largest defect of Newton's second law for a free body: {} of the impulses on it.",
                number(worst)
            ),
        });
    }
    claims
}
