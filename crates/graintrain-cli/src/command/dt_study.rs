//! `graintrain dt-study`: how results depend on the time step.

use crate::error::Failure;
use crate::studying::{StudyOptions, conclude};
use crate::sweeping::{SweepOptions, sweep_failure};
use graintrain_lab::sweep::study::{Refined, time_steps};
use std::process::ExitCode;

/// Tell which time step of a scene is short enough
///
/// Runs it with its time step, half of it, a quarter and so on. Writes what `sweep` writes, and study.csv:
/// the deviation of every observable from that at the shortest step, with its error.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  graintrain dt-study shear.toml --observe box.tau_over_sigma --seeds 4\n  \
    graintrain dt-study heap.toml --halvings 3 --within 0.02 --observe heap.repose_angle:last"
)]
pub struct Arguments {
    #[command(flatten)]
    options: SweepOptions,
    #[command(flatten)]
    study: StudyOptions,
    /// How often the step is halved
    #[arg(long, default_value_t = 2, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=20))]
    halvings: u32,
}

pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let plan = time_steps(arguments.options.plan()?, arguments.halvings).map_err(sweep_failure)?;
    match arguments.options.make(plan, "dt-study") {
        Ok(made) => conclude(&made, &arguments.study, Refined::TimeStep),
        Err(ended) => ended,
    }
}
