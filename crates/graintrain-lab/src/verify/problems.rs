//! Contact problems whose solution is known because it was chosen first: A19.

use super::bench::{Accuracy, random};
use super::source::{RELAXED, Source};
use super::{Definition, Measure, Row, VerifyError};
use graintrain::math::{Vec3, tangents};
use graintrain_ccp::{
    BodyInverseMass, Ccp, Delassus, FIXED, FrictionModel, RigidContact, RigidDelassus, SolveSettings,
    SolverSpec,
};

/// The cases.
pub const CASES: &[Definition] = &[Definition {
    id: "A19",
    title: "Contact problems with a chosen solution",
    setup: "Sixty random problems of 1 to 50 contacts between up to 20 bodies of mass ratios up to a million, mu up to 2: impulses and \
            velocities that stick, slide or part are chosen first, and r = u - N g made to fit.",
    sources: &[
        Source::Algebra(
            "the impulses chosen solve the problem, and a convex problem has one least objective",
        ),
        RELAXED,
    ],
    measure: Measure::Small(chosen),
}];

/// A random problem and the objective of its solution.
fn problem(seed: u64) -> Result<(Ccp, f64), VerifyError> {
    let mut next = random(seed);
    let mut unit = move || 0.5 * (next() + 1.0);
    for _ in 0..20 {
        unit();
    }
    let contacts = 1 + (50.0 * unit()) as usize;
    let bodies = 1 + (20.0 * unit()) as u32;
    let masses = (0..bodies).map(|_| {
        let inverse = 10_f64.powf(6.0 * unit() - 3.0);
        let turn = 250.0 * inverse;
        let angular = [turn, 0.0, 0.0, 0.0, turn, 0.0, 0.0, 0.0, turn];
        BodyInverseMass { linear: [inverse; 3], angular }
    });
    let masses: Vec<_> = masses.collect();
    let (mut rows, mut friction) = (Vec::new(), Vec::new());
    let (mut g, mut u) = (Vec::new(), Vec::new());
    for _ in 0..contacts {
        let body_a = (unit() * f64::from(bodies)) as u32;
        let other = (unit() * f64::from(bodies + 1)) as u32;
        let body_b = if other == bodies || other == body_a { FIXED } else { other };
        let mut direction = || Vec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5);
        let normal = (direction() + Vec3::new(0.0, 0.0, 1e-3)).normalize();
        let (t1, t2) = tangents(normal);
        let frame = [normal.to_array(), t1.to_array(), t2.to_array()];
        let (arm_a, arm_b) = ((0.2 * direction()).to_array(), (0.2 * direction()).to_array());
        rows.push(RigidContact { body_a, body_b, frame, arm_a, arm_b });
        let mu = 2.0 * unit();
        friction.push(mu);
        let (sin, cos) = (6.3 * unit()).sin_cos();
        let (size, speed) = (unit(), unit());
        let kind = unit();
        let (impulse, velocity) = if kind < 0.4 {
            let part = 0.9 * mu * unit();
            ([size, part * size * cos, part * size * sin], [0.0; 3])
        } else if kind < 0.7 {
            ([size, mu * size * cos, mu * size * sin], [mu * speed, -speed * cos, -speed * sin])
        } else {
            ([0.0; 3], [(mu + 0.1) * speed, speed * cos, speed * sin])
        };
        g.extend(impulse);
        u.extend(velocity);
    }
    let delassus = Delassus::Rigid(RigidDelassus::new(rows, masses));
    let mut product = vec![0.0; 3 * contacts];
    delassus.multiply(&g, &mut product, &mut delassus.work());
    let r: Vec<f64> = u.iter().zip(&product).map(|(u, p)| u - p).collect();
    let best = g.iter().zip(&product).zip(&r).map(|((g, p), r)| g * (0.5 * p + r)).sum();
    Ok((Ccp::new(delassus, r, friction)?, best))
}

fn chosen() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for accuracy in Accuracy::both(1e-10) {
        let Accuracy { tolerance, criterion } = accuracy;
        let spec = SolverSpec::default();
        let (mut worst, mut unsolved, count) = (0.0_f64, 0, 60);
        for seed in 0..count {
            let (problem, best) = problem(seed)?;
            let mut impulse = vec![0.0; 3 * problem.num_contacts()];
            let settings = SolveSettings { tolerance, criterion, ..SolveSettings::default() };
            let report = spec.build()?.solve(&problem, &mut impulse, &settings)?;
            let residual = report.residual.measured(criterion);
            unsolved += usize::from(residual.is_nan() || residual > 1.1 * tolerance);
            worst = worst.max((report.objective - best).abs() / best.abs().max(f64::MIN_POSITIVE));
        }
        rows.push(Row {
            what: "largest relative error of an objective (1)".into(),
            friction: Some(FrictionModel::Relaxed),
            solver: spec.to_string(),
            step: 0.0,
            accuracy,
            measured: worst,
            expected: 0.0,
            allowed: accuracy.allowed(1e-8, 1.0),
            error: 0.0,
            steps: count as usize,
            unsolved,
        });
    }
    Ok(rows)
}
