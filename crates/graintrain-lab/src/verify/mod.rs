//! The program against exact answers, on the user's machine: what `graintrain verify` runs.
//!
//! Tier A holds single bodies and impacts against closed forms (seconds). Tier B shears and drafts a granular sample and
//! holds it against what must not depend on step and tolerance (minutes). Every check has a measured and an expected
//! number and a tolerance; nothing is asserted that is not in the table.
//!
//! | module | holds |
//! |---|---|
//! | [`mod@bench`] | small worlds, and stepping them to convergence |
//! | [`sliding`], [`impact`], [`rest`], [`flight`] | tier A |
//! | [`granular`], [`earth_pressure`] | tier B |

pub mod bench;
pub mod earth_pressure;
pub mod flight;
pub mod granular;
pub mod impact;
pub mod rest;
pub mod sliding;

use crate::reproduce::ReproduceError;
use graintrain::error::ModelError;
use graintrain::stepper::StepError;
use graintrain_ccp::FrictionModel;
use graintrain_view::plot::axis::number;
use std::fmt::Write as _;

/// A measured number and what it should be.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// Number in the list of validations, e.g. `A3`.
    pub id: &'static str,
    /// What is measured, with its unit.
    pub what: String,
    /// What came out.
    pub measured: f64,
    /// What should.
    pub expected: f64,
    /// Largest difference allowed.
    pub tolerance: f64,
    /// Where the expected value comes from.
    pub source: &'static str,
    /// Standard error of the measured value; zero where nothing is left to chance.
    pub error: f64,
}

/// How a check ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The difference is allowed, and known as well as that.
    Passed,
    /// It is not, by more than two standard errors; or something is not a number.
    Failed,
    /// The standard error is too large to tell.
    Undecided,
}

impl Check {
    /// How it ended.
    pub fn outcome(&self) -> Outcome {
        let difference = (self.measured - self.expected).abs();
        if difference <= self.tolerance && self.error <= self.tolerance {
            Outcome::Passed
        } else if difference - 2.0 * self.error <= self.tolerance {
            Outcome::Undecided
        } else {
            Outcome::Failed
        }
    }
}

/// Why a check could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VerifyError {
    /// A world could not be built.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A step failed.
    #[error(transparent)]
    Step(#[from] StepError),
    /// A solve missed its tolerance.
    #[error(
        "a contact problem of the checks was solved to {residual:.1e} only, asked for was {tolerance:.1e}"
    )]
    Unsolved {
        /// Residual reached.
        residual: f64,
        /// Residual asked for.
        tolerance: f64,
    },
    /// A granular simulation failed.
    #[error(transparent)]
    Reproduce(#[from] ReproduceError),
}

/// Name of a friction model in tables.
fn named(model: FrictionModel) -> &'static str {
    match model {
        FrictionModel::Relaxed => "relaxed",
        FrictionModel::Coulomb => "coulomb",
    }
}

/// Both friction models.
const MODELS: [FrictionModel; 2] = [FrictionModel::Relaxed, FrictionModel::Coulomb];

/// All checks of tier A, telling each group before it begins.
///
/// # Errors
/// [`VerifyError`] where a check cannot be made; a check that is made and fails is in the list.
pub fn tier_a(mut progress: impl FnMut(&str)) -> Result<Vec<Check>, VerifyError> {
    type Group = fn() -> Result<Vec<Check>, VerifyError>;
    let groups: [(&str, Group); 4] = [
        ("free flight and rotation", flight::checks),
        ("impacts", impact::checks),
        ("sliding and rolling", sliding::checks),
        ("rest", rest::checks),
    ];
    let mut checks = Vec::new();
    for (name, group) in groups {
        progress(name);
        checks.extend(group()?);
    }
    Ok(checks)
}

/// The checks as a Markdown table whose columns also line up as plain text.
pub fn table(checks: &[Check]) -> String {
    let header = ["", "check", "measured", "expected", "allowed", "source", "verdict"].map(String::from);
    let rows = checks.iter().map(|check| {
        [
            check.id.to_string(),
            check.what.clone(),
            precise(check.measured),
            precise(check.expected),
            number(check.tolerance),
            check.source.to_string(),
            match check.outcome() {
                Outcome::Passed => "passed".to_string(),
                Outcome::Failed => "FAILED".to_string(),
                Outcome::Undecided => format!("undecided (+- {})", number(check.error)),
            },
        ]
    });
    let rows: Vec<[String; 7]> = std::iter::once(header).chain(rows).collect();
    let widths: [usize; 7] =
        std::array::from_fn(|k| rows.iter().map(|row| row[k].chars().count()).max().unwrap_or(0));
    let mut text = String::new();
    for (k, row) in rows.iter().enumerate() {
        for (cell, width) in row.iter().zip(widths) {
            let _ = write!(text, "| {cell:width$} ");
        }
        text.push_str("|\n");
        if k == 0 {
            text.extend(widths.map(|width| format!("|{}", "-".repeat(width + 2))));
            text.push_str("|\n");
        }
    }
    let count = |outcome| checks.iter().filter(|check| check.outcome() == outcome).count();
    let _ = write!(text, "\n{} checks, {} failed", checks.len(), count(Outcome::Failed));
    if count(Outcome::Undecided) > 0 {
        let _ = write!(text, ", {} undecided", count(Outcome::Undecided));
    }
    text.push('\n');
    text
}

/// Six digits: differences from the expected value have to show.
fn precise(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) {
        format!("{value:.6}")
    } else {
        format!("{value:.3e}")
    }
}

#[cfg(test)]
mod tests;
