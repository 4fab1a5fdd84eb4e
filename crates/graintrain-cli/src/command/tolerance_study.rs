//! `graintrain tolerance-study`: how results depend on the tolerance of the solver.

use crate::error::Failure;
use crate::studying::{StudyOptions, conclude};
use crate::sweeping::{SweepOptions, sweep_failure};
use graintrain_lab::sweep::study::{Refined, tolerances};
use std::process::ExitCode;

/// Tell which tolerance of a scene is fine enough, and what it costs
///
/// Runs it with several of them. Writes what `sweep` writes, and study.csv: the deviation of every observable
/// from that at the finest tolerance, with its error.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  graintrain tolerance-study shear.toml --tolerances 1e-2,1e-3,1e-4,1e-5 --observe box.tau_over_sigma --seeds 4"
)]
pub struct Arguments {
    #[command(flatten)]
    options: SweepOptions,
    #[command(flatten)]
    study: StudyOptions,
    /// The tolerances
    #[arg(long, value_name = "X1,X2,...", value_delimiter = ',', default_value = "1e-2,1e-3,1e-4,1e-5,1e-6")]
    tolerances: Vec<f64>,
}

pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let plan = tolerances(arguments.options.plan()?, &arguments.tolerances).map_err(sweep_failure)?;
    match arguments.options.make(plan, "tolerance-study") {
        Ok(made) => conclude(&made, &arguments.study, Refined::Tolerance),
        Err(ended) => ended,
    }
}
