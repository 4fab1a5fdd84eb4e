//! `graintrain sweep`: a scene at many values of its parameters.

use crate::error::Failure;
use crate::sweeping::{SweepOptions, sweep_failure};
use graintrain_lab::sweep::plan::{Setting, grid, over, table};
use graintrain_lab::sweep::report::page;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Run a scene at many values of its parameters, with several seeds
///
/// Writes sweep.csv (a record per point: means and standard errors over the seeds), runs.csv and one HTML
/// page with plots. A sweep that was stopped or killed goes on with the same command; more values or seeds
/// add to it.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  graintrain sweep heap.toml --over mu=0.1,0.3,0.5 --over n=4,8 --seeds 4\n  \
    graintrain sweep shear.toml --over load='1 kPa','2 kPa' --observe box.tau_over_sigma:max --from '0.5 s'\n  \
    graintrain sweep heap.toml --table points.csv      keys in the header, a point per line\n\n\
    Exit codes: 0 done; 1 a run failed (the others are made); 2 bad input; 130 and 143 stopped by Ctrl-C and SIGTERM."
)]
pub struct Arguments {
    #[command(flatten)]
    options: SweepOptions,
    /// A parameter or key of the scene and its values; may be repeated: all combinations
    #[arg(long, value_name = "KEY=V1,V2,...")]
    over: Vec<String>,
    /// A CSV file of points instead: keys in the header, values in the lines
    #[arg(long, value_name = "FILE", conflicts_with = "over")]
    table: Option<PathBuf>,
}

pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut plan = arguments.options.plan()?;
    plan.points = match &arguments.table {
        Some(path) => points(path)?,
        None => {
            let keys = arguments.over.iter().map(|text| over(text)).collect::<Result<Vec<_>, _>>();
            keys.and_then(|keys| grid(&keys)).map_err(sweep_failure)?
        }
    };
    let made = match arguments.options.make(plan, "sweep") {
        Ok(made) => made,
        Err(ended) => return ended,
    };
    page(&made.folder, &made.plan, &made.cells, &made.collected, &made.names, false, "")
        .map_err(sweep_failure)?;
    Ok(made.conclude())
}

/// The points of a table.
fn points(path: &Path) -> Result<Vec<Vec<Setting>>, Failure> {
    let refuse = |problem: String| {
        let remedy =
            "give a CSV file with keys of the scene in its header, and a line of their values for each point";
        Failure::input_error(std::io::Error::other(problem), remedy)
    };
    let text = std::fs::read_to_string(path)
        .map_err(|error| refuse(format!("cannot read {}: {error}", path.display())))?;
    table(&text).map_err(|error| refuse(format!("{}: {error}", path.display())))
}
