//! Calibration: parameters of a scene from what was measured.
//!
//! | module | holds |
//! |---|---|
//! | [`question`] | parameters with their ranges, aims: what is asked |
//! | [`observe`] | what the runs say of the aims |
//! | [`gaussian_process`] | the surrogate: a smooth function through noisy values |
//! | [`inference`] | what the runs say about the parameters, and where to run next |
//! | [`quasi_random`], [`minimize`] | even points, small minimizations |
//! | [`ledger`] | the points, on disk before their runs begin, so that a calibration that was killed goes on as if it had not been |
//! | [`report`] | the page with its plots |
//!
//! Runs are those of a [sweep](crate::sweep) over points that are chosen round by round: even ones first,
//! then where what the surrogates do not know, times the likelihood of the point, is largest. Every run has a
//! seed of its own, so that the surrogates see how much runs scatter. The answer is the distribution of the
//! parameters given the aims: its mean, standard deviation and 95 % interval; errors of the aims, scatter of
//! the runs, and what the surrogates do not know are all in it.

pub mod gaussian_process;
pub mod inference;
pub mod ledger;
pub mod minimize;
pub mod observe;
pub mod quasi_random;
pub mod question;
pub mod report;

use crate::sweep::SweepError;
use crate::sweep::execute::{Execution, Outcome, Progress, execute};
use crate::sweep::plan::{Cell, Plan};
use graintrain_io::mark::Loss;
use inference::{Distribution, Observation, Surrogates};
use ledger::Ledger;
use observe::Aims;
use quasi_random::halton;
use question::Question;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Share of the surrogates in the variance of every aim below which more runs would change nothing that
/// matters.
const KNOWN: f64 = 0.05;

/// How far a calibration is.
#[derive(Clone, Copy, Debug)]
pub struct Stage<'a> {
    /// Runs that ended.
    pub done: usize,
    /// All runs, if it goes on to the end.
    pub total: usize,
    /// The one that ended last.
    pub last: &'a str,
    /// What of its tables was missing or damaged.
    pub losses: &'a [Loss],
}

/// What a calibration came to.
#[derive(Clone, Debug)]
pub struct Answer {
    /// What was asked.
    pub question: Question,
    /// The aims, number by number.
    pub aims: Aims,
    /// Points in the order in which they were chosen, in the unit cube.
    pub points: Vec<Vec<f64>>,
    /// What their runs said.
    pub observations: Vec<Observation>,
    /// Surrogates of the aims.
    pub surrogates: Surrogates,
    /// The parameters.
    pub distribution: Distribution,
    /// Largest share of the surrogates in the variance of an aim.
    pub unknown_share: f64,
    /// Runs that failed, with the reason.
    pub failed: Vec<(String, String)>,
}

/// The plan of the points so far: all conditions of a point one after the other.
fn plan(question: &Question, aims: &Aims, points: &[Vec<f64>]) -> Plan {
    let settings = |point: &Vec<f64>| {
        let own = question.settings(point);
        aims.conditions.iter().map(move |condition| [own.clone(), condition.clone()].concat())
    };
    Plan { points: points.iter().flat_map(settings).collect(), ..question.plan.clone() }
}

/// The runs of points `from` on. Every point has seeds of its own.
fn cells(plan: &Plan, aims: &Aims, from: usize) -> Result<Vec<Cell>, SweepError> {
    let conditions = aims.conditions.len();
    let mut cells = Vec::new();
    for index in from * conditions..plan.points.len() {
        for seed in 0..plan.seeds {
            cells.push(plan.cell(index, (index / conditions) as u64 * plan.seeds + seed)?);
        }
    }
    Ok(cells)
}

/// The error for an aim for which too few runs have a number; its abscissa is `covered` by the runs from here
/// to there.
fn too_few(aims: &Aims, aim: usize, covered: Option<[f64; 2]>, failed: &[(String, String)]) -> SweepError {
    let mut problem =
        format!("fewer than four runs have a number for `{}` (see observed.csv): ", aims.elements[aim].label);
    let beyond = |[low, high]: [f64; 2]| !aims.elements[aim].x.is_some_and(|x| (low..=high).contains(&x));
    problem += &match covered {
        Some(ends) if beyond(ends) => {
            let [low, high] = ends;
            format!(
                "the records of the runs go from {low} to {high}, so leave out the points of the curve beyond"
            )
        }
        _ => "look at the range of the parameters, at the failed runs, or at --from".into(),
    };
    if let Some((run, why)) = failed.first() {
        problem += &format!(
            "; {} runs failed, the first was {run}: {why} (calibrate varies keys continuously; `sweep` takes lists of whole numbers)",
            failed.len()
        );
    }
    SweepError::Plan(problem)
}

/// Calibrates: makes runs round by round, writes the ledger before each. What is in the folder of the same
/// question is kept.
///
/// # Errors
/// [`SweepError`], as of sweeps; [`SweepError::Plan`] where the folder holds another question, or an aim has
/// too few numbers.
pub fn calibrate(
    question: &Question,
    how: &Execution,
    stop: &Arc<AtomicBool>,
    progress: &(dyn Fn(Stage<'_>) + Sync),
) -> Result<Answer, SweepError> {
    let aims = Aims::new(question)?;
    let mut ledger = Ledger::open(&how.folder, question)?;
    let first = question.first_points();
    let dimension = question.parameters.len();
    let runs_per_point = aims.conditions.len() * question.plan.seeds as usize;
    let total = question.most_points.max(first) * runs_per_point;
    let mut failed = Vec::new();
    let mut made = 0;
    loop {
        if ledger.points.is_empty() {
            let points = (0..first as u64).map(|k| question.rounded(&halton(k, dimension)));
            ledger.add(points.collect())?;
        }
        let plan = plan(question, &aims, &ledger.points);
        let new = cells(&plan, &aims, made)?;
        let before = made * runs_per_point;
        let report = |progress_of_round: Progress<'_>| {
            let Progress { done, last, losses, .. } = progress_of_round;
            progress(Stage { done: before + done, total, last, losses });
        };
        let how = Execution { jobs: how.jobs.min(new.len()), ..how.clone() };
        for (cell, outcome) in new.iter().zip(execute(&plan, &new, &how, stop, &report)?) {
            if let Outcome::Failed(why) = outcome {
                failed.push((cell.name.clone(), why));
            }
        }
        made = ledger.points.len();
        let all = cells(&plan, &aims, 0)?;
        let observations = aims.observe(&how.folder, &all, &ledger.points, question)?;
        let surrogates = match Surrogates::new(&aims.values(), &observations, dimension) {
            Ok(surrogates) => surrogates,
            Err(aim) => {
                ledger.conclude(question, &aims, &observations)?;
                return Err(too_few(&aims, aim, aims.covered(&how.folder, &all, question, aim)?, &failed));
            }
        };
        let distribution = surrogates.distribution();
        let unknown_share = surrogates.unknown_share(&distribution);
        // Even points alone may have missed where the aims are reached.
        let is_known = unknown_share < KNOWN && (!distribution.is_missed || made > first);
        if made >= question.most_points || is_known {
            ledger.conclude(question, &aims, &observations)?;
            return Ok(Answer {
                question: question.clone(),
                aims,
                points: ledger.points,
                observations,
                surrogates,
                distribution,
                unknown_share,
                failed,
            });
        }
        let count = question.batch.min(question.most_points - made);
        let next = surrogates.next(&distribution, &observations, count);
        ledger.add(next.iter().map(|point| question.rounded(point)).collect())?;
    }
}
