//! The program against exact answers and published figures, on the user's machine: what `graintrain verify`
//! runs.
//!
//! Tier A holds single bodies, impacts and small assemblies against closed forms (a minute). Tier B holds
//! granular samples against published figures and against what must not depend on step and tolerance (minutes
//! to an hour). Every row has a measured and an expected number and what their difference may be; nothing is
//! asserted that is not in the report.
//!
//! Rows are made with the solver, tolerance and criterion of a scene that asks for nothing. Where a closed
//! form is compared to many digits a second row beside it says the tolerance that this takes; the first is
//! held to what its own tolerance promises ([`bench::Accuracy::promise`]).
//!
//! | module | holds |
//! |---|---|
//! | [`source`] | where expected values come from |
//! | [`mod@bench`] | small worlds, and stepping them |
//! | [`flight`], [`impact`], [`arrival`], [`sliding`], [`rest`], [`painleve`], [`shapes`], [`heaps`], [`gas`], [`problems`], [`turning`], [`joints`], [`collisions`] | tier A |
//! | [`mod@periodic_sample`], [`compression`], [`mod@shear`], [`granular`], [`earth_pressure`], [`samples`] | tier B |
//! | [`report`] | table, Markdown, HTML |

pub mod arrival;
pub mod bench;
pub mod collisions;
pub mod compression;
pub mod earth_pressure;
pub mod flight;
pub mod gas;
pub mod granular;
pub mod heaps;
pub mod hulls;
pub mod impact;
pub mod joints;
pub mod laws;
pub mod painleve;
pub mod periodic_sample;
pub mod problems;
pub mod report;
pub mod rest;
pub mod samples;
pub mod shapes;
pub mod shear;
pub mod sliding;
pub mod source;
pub mod turning;

use crate::reproduce::ReproduceError;
use bench::Accuracy;
use graintrain::error::ModelError;
use graintrain::stepper::StepError;
use graintrain_ccp::{CcpError, FrictionModel};
use source::Source;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Something with a known answer.
pub struct Definition {
    /// Number in the list of validations, e.g. `A3`.
    pub id: &'static str,
    /// A few words.
    pub title: &'static str,
    /// What is set up, in one sentence.
    pub setup: &'static str,
    /// Where the expected values come from.
    pub sources: &'static [Source],
    /// How it is measured.
    pub measure: Measure,
}

/// How a case is measured.
#[derive(Clone, Copy)]
pub enum Measure {
    /// By single bodies and small assemblies.
    Small(fn() -> Result<Vec<Row>, VerifyError>),
    /// By a granular sample whose friction model makes no difference, or is its scene's.
    Sample(fn(&mut Sampling) -> Result<Vec<Row>, VerifyError>),
    /// By a granular sample, once in each friction model of [`Sampling::models`].
    SampleWithFriction(fn(&mut Sampling, FrictionModel) -> Result<Vec<Row>, VerifyError>),
    /// Not at all, and why.
    LeftOut(&'static str),
}

/// What measuring a granular sample needs.
pub struct Sampling<'a> {
    /// Size parameter of the sheared and drafted samples.
    pub n: usize,
    /// Friction models of samples with friction.
    pub models: Vec<FrictionModel>,
    /// Folder for their states.
    pub scratch: PathBuf,
    /// Set to stop.
    pub stop: Arc<AtomicBool>,
    /// Is given what begins.
    pub progress: &'a mut dyn FnMut(&str),
}

/// A measured number and what it should be.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// What is measured, with its unit.
    pub what: String,
    /// Friction model; `None` where there is no contact.
    pub friction: Option<FrictionModel>,
    /// Contact solver.
    pub solver: String,
    /// Time step, s; zero where a single problem is solved.
    pub step: f64,
    /// To what contact problems were solved.
    pub accuracy: Accuracy,
    /// What came out.
    pub measured: f64,
    /// What should.
    pub expected: f64,
    /// Largest difference allowed.
    pub allowed: f64,
    /// Standard error of the measured value; zero where nothing is left to chance.
    pub error: f64,
    /// Steps made for it; zero if not counted.
    pub steps: usize,
    /// How many of them did not reach their tolerance: a row with such steps fails.
    pub unsolved: usize,
}

/// How a row or case ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The difference is allowed, and known as well as that.
    Passed,
    /// It was not measured.
    LeftOut,
    /// The standard error is too large to tell.
    Undecided,
    /// The difference is too large by more than two standard errors; or something is not a number; or a solve
    /// did not reach its tolerance.
    Failed,
}

impl Row {
    /// Without friction model where nothing touches.
    pub fn without_contact(self) -> Self {
        Self { friction: None, ..self }
    }

    /// How it ended.
    pub fn outcome(&self) -> Outcome {
        let difference = (self.measured - self.expected).abs();
        if self.unsolved > 0 {
            Outcome::Failed
        } else if difference <= self.allowed && self.error <= self.allowed {
            Outcome::Passed
        } else if self.error > 0.0 && difference - 2.0 * self.error <= self.allowed {
            Outcome::Undecided
        } else {
            Outcome::Failed
        }
    }
}

/// A case as it was measured.
pub struct Case {
    /// What it is.
    pub definition: &'static Definition,
    /// What came out.
    pub rows: Vec<Row>,
    /// Why it could not be measured to its end.
    pub trouble: Option<String>,
    /// How long it took, wall clock.
    pub seconds: f64,
}

impl Case {
    /// How it ended: as its worst row.
    pub fn outcome(&self) -> Outcome {
        if self.trouble.is_some() {
            return Outcome::Failed;
        }
        if matches!(self.definition.measure, Measure::LeftOut(_)) {
            return Outcome::LeftOut;
        }
        let rank = |outcome: &Outcome| *outcome as usize;
        self.rows.iter().map(Row::outcome).max_by_key(rank).unwrap_or(Outcome::Failed)
    }
}

/// Why a case could not be measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VerifyError {
    /// A world could not be built.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A step failed.
    #[error(transparent)]
    Step(#[from] StepError),
    /// A contact problem could not be solved.
    #[error(transparent)]
    Problem(#[from] CcpError),
    /// A granular simulation failed.
    #[error(transparent)]
    Reproduce(#[from] ReproduceError),
}

/// Name of a friction model in tables.
pub fn named(model: FrictionModel) -> &'static str {
    match model {
        FrictionModel::Relaxed => "relaxed",
        FrictionModel::Coulomb => "coulomb",
    }
}

/// Both friction models.
const MODELS: [FrictionModel; 2] = [FrictionModel::Relaxed, FrictionModel::Coulomb];

/// The cases of tier A.
pub fn tier_a() -> impl Iterator<Item = &'static Definition> {
    let mut all: Vec<&Definition> = [
        flight::CASES,
        sliding::CASES,
        impact::CASES,
        rest::CASES,
        painleve::CASES,
        gas::CASES,
        problems::CASES,
        shapes::CASES,
        arrival::CASES,
        heaps::CASES,
        turning::CASES,
        joints::CASES,
        collisions::CASES,
        hulls::CASES,
        laws::CASES,
    ]
    .into_iter()
    .flatten()
    .collect();
    all.sort_by_key(|definition| definition.id[1..].parse::<u32>().unwrap_or(u32::MAX));
    all.into_iter()
}

/// The cases of tier B, the short ones first.
pub fn tier_b() -> impl Iterator<Item = &'static Definition> {
    [compression::CASES, shear::CASES, samples::CASES, earth_pressure::CASES, granular::CASES]
        .into_iter()
        .flatten()
}

/// Measures cases one after another, tells each before it begins, and hands over all so far after each. Ends
/// early once the stop is set; the case under way is then left out.
pub fn measure(
    definitions: impl Iterator<Item = &'static Definition>,
    sampling: &mut Sampling<'_>,
    mut done: impl FnMut(&[Case]),
) -> Vec<Case> {
    let mut cases = Vec::new();
    for definition in definitions {
        (sampling.progress)(&format!("{} {}", definition.id, definition.title));
        let begin = Instant::now();
        let measured = match definition.measure {
            Measure::Small(measure) => measure(),
            Measure::Sample(measure) => measure(sampling),
            Measure::SampleWithFriction(measure) => in_each_model(measure, sampling),
            Measure::LeftOut(_) => Ok(Vec::new()),
        };
        if sampling.stop.load(Ordering::Relaxed) {
            break;
        }
        let seconds = begin.elapsed().as_secs_f64();
        let (rows, trouble) = match measured {
            Ok(rows) => (rows, None),
            Err(error) => (Vec::new(), Some(error.to_string())),
        };
        cases.push(Case { definition, rows, trouble, seconds });
        done(&cases);
    }
    cases
}

/// The rows of a sample in each of the friction models.
fn in_each_model(
    measure: fn(&mut Sampling, FrictionModel) -> Result<Vec<Row>, VerifyError>,
    sampling: &mut Sampling<'_>,
) -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for model in sampling.models.clone() {
        rows.extend(measure(sampling, model)?);
    }
    Ok(rows)
}

/// Whether all that was planned was measured and nothing failed: the program's exit code.
pub fn held(cases: &[Case], planned: usize) -> bool {
    cases.len() == planned && cases.iter().all(|case| case.outcome() != Outcome::Failed)
}

#[cfg(test)]
mod tests;
