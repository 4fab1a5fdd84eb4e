//! Sweeps over the time step or the tolerance, and what follows from them: which is fine enough, and what it
//! costs.

use super::SweepError;
use super::collect::{Collected, Estimate};
use super::plan::{Cell, Plan, Setting};

/// Which number is refined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refined {
    /// `time.step`, s.
    TimeStep,
    /// `solver.tolerance`.
    Tolerance,
}

impl Refined {
    /// The key of the scene.
    pub fn key(self) -> &'static str {
        match self {
            Self::TimeStep => "time.step",
            Self::Tolerance => "solver.tolerance",
        }
    }
}

/// How an observable depends on what is refined. Values are in the order of the plan: from coarse to fine,
/// the last one being the reference.
#[derive(Clone, Debug, PartialEq)]
pub struct Convergence {
    /// Deviation from the finest, and its standard error, by value.
    pub deviation: Vec<Estimate>,
    /// Index of the coarsest value from which on every deviation, with twice its error, stays within what was
    /// allowed.
    pub admissible: Option<usize>,
    /// Exponent of the error in the step, from the last three values where their differences exceed twice
    /// their errors.
    pub order: Option<f64>,
}

/// The plan of a study of the time step: the scene's own, its half, its quarter and so on, to the same
/// simulated time.
///
/// # Errors
/// [`SweepError::Scene`] where the scene cannot be read.
pub fn time_steps(mut plan: Plan, halvings: u32) -> Result<Plan, SweepError> {
    let time = plan.load(&[], &[])?.time;
    let end = time.step * time.steps as f64;
    plan.settings.push(("time.end".into(), format!("{end:?}")));
    let point = |k: u32| -> Vec<Setting> {
        vec![(Refined::TimeStep.key().into(), format!("{:?}", time.step / f64::from(1_u32 << k)))]
    };
    plan.points = (0..=halvings.min(20)).map(point).collect();
    Ok(plan)
}

/// The plan of a study of the tolerance, from coarse to fine.
///
/// # Errors
/// [`SweepError::Plan`] for fewer than two tolerances, or one that is not positive.
pub fn tolerances(mut plan: Plan, tolerances: &[f64]) -> Result<Plan, SweepError> {
    let mut sorted = tolerances.to_vec();
    sorted.sort_by(|a, b| b.total_cmp(a));
    sorted.dedup();
    if sorted.len() < 2 || sorted.iter().any(|tolerance| !(tolerance.is_finite() && *tolerance > 0.0)) {
        return Err(SweepError::Plan("a study needs at least two different positive tolerances".into()));
    }
    plan.points = sorted
        .iter()
        .map(|tolerance| vec![(Refined::Tolerance.key().to_string(), format!("{tolerance:?}"))])
        .collect();
    Ok(plan)
}

/// How the estimates (coarse to fine) converge, where deviations up to `within` of the finest one's magnitude
/// are allowed. Errors of different values are taken for independent. `ratio` is what one value is to the
/// next.
pub fn convergence(estimates: &[Estimate], within: f64, ratio: f64) -> Option<Convergence> {
    let reference = *estimates.last()?;
    let known = |error: f64| if error.is_finite() { error } else { 0.0 };
    let between = |a: &Estimate, b: &Estimate| Estimate {
        value: a.value - b.value,
        error: known(a.error).hypot(known(b.error)),
        count: a.count.min(b.count),
    };
    let deviation: Vec<Estimate> = estimates.iter().map(|estimate| between(estimate, &reference)).collect();
    let allowed = within * reference.value.abs();
    let fits = |deviation: &Estimate| deviation.value.abs() + 2.0 * deviation.error <= allowed;
    let coarser = &deviation[..deviation.len() - 1];
    // The reference is not compared with itself.
    let bad = coarser.iter().rposition(|deviation| !fits(deviation)).map_or(0, |last| last + 1);
    let admissible = (bad < coarser.len()).then_some(bad);
    let order = match estimates {
        [.., a, b, c] => {
            let (first, second) = (between(a, b), between(b, c));
            let clear = |d: &Estimate| d.value.abs() > 2.0 * d.error && d.value != 0.0;
            (clear(&first) && clear(&second) && ratio > 1.0)
                .then(|| (first.value / second.value).abs().ln() / ratio.ln())
        }
        _ => None,
    };
    Some(Convergence { deviation, admissible, order })
}

/// The estimates of an observable at all points of a plan; `None` where one is missing.
pub fn estimates(collected: &Collected, plan: &Plan, cells: &[Cell], name: &str) -> Option<Vec<Estimate>> {
    (0..plan.points.len()).map(|point| collected.estimate(cells, point, name)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(value: f64, error: f64) -> Estimate {
        Estimate { value, error, count: 3 }
    }

    /// x(dt) = 2 + dt + noise: order 1, and the step that errs by 5 % of 2 at most.
    #[test]
    fn a_scheme_of_first_order() {
        let exact: Vec<Estimate> = [0.8, 0.4, 0.2, 0.1, 0.05].map(|dt| estimate(2.0 + dt, 1e-6)).to_vec();
        let found = convergence(&exact, 0.05, 2.0).unwrap();
        assert!((found.order.unwrap() - 1.0).abs() < 1e-3);
        // 0.1 errs by 0.05 against the finest: within 0.1025; 0.2 by 0.15.
        assert_eq!(found.admissible, Some(3));
        assert!((found.deviation[2].value - 0.15).abs() < 1e-12);
        let noisy: Vec<Estimate> = exact.iter().map(|e| estimate(e.value, 0.2)).collect();
        let found = convergence(&noisy, 0.05, 2.0).unwrap();
        assert_eq!((found.admissible, found.order), (None, None));
        assert_eq!(convergence(&[estimate(1.0, 0.0)], 0.1, 2.0).unwrap().admissible, None);
        assert!(convergence(&[], 0.1, 2.0).is_none());
    }

    #[test]
    fn plans_of_studies() {
        let plan =
            Plan { scene: "stack".into(), settings: Vec::new(), points: Vec::new(), seeds: 1, frames: false };
        let steps = time_steps(plan.clone(), 2).unwrap();
        let step: Vec<f64> = steps.points.iter().map(|point| point[0].1.parse().unwrap()).collect();
        assert_eq!((step[1], step[2]), (0.5 * step[0], 0.25 * step[0]));
        let scenes: Vec<_> = steps.points.iter().map(|point| steps.load(point, &[]).unwrap().time).collect();
        assert_eq!(scenes[2].steps, 4 * scenes[0].steps);
        let finer = tolerances(plan.clone(), &[1e-4, 1e-2]).unwrap();
        assert_eq!(finer.points[0][0].1.parse::<f64>(), Ok(1e-2));
        assert!(tolerances(plan, &[1e-4]).is_err());
    }
}
