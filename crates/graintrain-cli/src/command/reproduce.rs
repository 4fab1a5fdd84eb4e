//! `graintrain reproduce`: the paper's experiments.

use crate::error::Failure;
use crate::signal::Stop;
use crate::solving::positive;
use crate::terminal::{say, tell};
use crate::threads::with_threads;
use graintrain_lab::reproduce::claims::Verdict;
use graintrain_lab::reproduce::report::reproduce;
use graintrain_lab::reproduce::{Progress, ReproduceError, Settings, Target};
use indicatif::{ProgressBar, ProgressStyle};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

/// Run the paper's experiments again and report which claims hold
///
/// Writes CSV, SVG plots, pictures and one HTML report. A reproduction that was stopped or killed goes on with the same
/// command.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  graintrain reproduce all --n 4\n  graintrain reproduce fig10 --n 8 --out fig10\n\n\
    Sizes: n = 4 takes minutes, n = 8 an hour, n = 16 a night; for n = 32 use `run sedimentation --set n=32`.\n\
    Exit codes: 0 done, whatever the verdicts; 1 failed; 2 bad arguments; 130 and 143 stopped by Ctrl-C and SIGTERM."
)]
pub struct Arguments {
    /// What: all, table3, table4, fig8, fig10, fig11, fig12, fig15, physics
    #[arg(value_parser = target)]
    target: Target,
    /// The paper's size parameter: (2n+1)^3 spheres
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=64))]
    n: u32,
    /// Steps of each simulation; by default as long as each experiment takes
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u64).range(1..))]
    steps: Option<u64>,
    /// Folder of the results; by default out/reproduce-TARGET-nN
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Time limit of one solve, s; by default 4 (n/4)^3
    #[arg(long, value_name = "SECONDS", value_parser = positive, allow_negative_numbers = true)]
    max_seconds: Option<f64>,
    /// Number of threads of the simulations; solves are always measured on one
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Print nothing but the verdicts
    #[arg(long)]
    quiet: bool,
}

fn target(name: &str) -> Result<Target, String> {
    let known = Target::NAMES.iter().find(|(known, _)| *known == name);
    known.map(|(_, target)| *target).ok_or_else(|| {
        let names: Vec<&str> = Target::NAMES.iter().map(|(name, _)| *name).collect();
        format!("choose one of {}", names.join(", "))
    })
}

/// Measures, writes the report and prints the verdicts.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let stop = Stop::listen()?;
    let n = arguments.n as usize;
    let name =
        Target::NAMES.iter().find(|(_, target)| *target == arguments.target).map_or("", |(name, _)| name);
    let standard = || PathBuf::from(format!("out/reproduce-{name}-n{n}"));
    let out = arguments.out.clone().unwrap_or_else(standard);
    let settings = Settings {
        target: arguments.target,
        n,
        steps: arguments.steps,
        out,
        max_seconds: arguments.max_seconds,
    };
    let bar = if arguments.quiet { ProgressBar::hidden() } else { ProgressBar::new(0) };
    let style =
        ProgressStyle::with_template("[{bar:30}] {pos}/{len} | {elapsed} so far, {eta} to go | {wide_msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.enable_steady_tick(Duration::from_millis(500));
    let result = with_threads(arguments.threads, || {
        reproduce(&settings, &Arc::clone(&stop.requested), &mut |progress: &Progress| {
            bar.set_length(progress.total as u64);
            bar.set_position(progress.done as u64);
            bar.set_message(progress.label.clone());
        })
    })?;
    bar.finish_and_clear();
    let report = match result {
        Ok(report) => report,
        Err(ReproduceError::Stopped) => {
            tell!("stopped; the same command goes on from here");
            return Ok(stop.exit_code().unwrap_or(ExitCode::FAILURE));
        }
        Err(error) => {
            let remedy = match error {
                ReproduceError::Busy { .. } | ReproduceError::File { .. } | ReproduceError::Output(_) => "",
                _ => "finished cells are kept: the same command goes on",
            };
            return Err(Failure::work_error(error, remedy));
        }
    };
    for claim in &report.claims {
        let mark = match claim.verdict {
            Verdict::Holds => "holds        ",
            Verdict::Fails => "does not hold",
            Verdict::Open => "not decided  ",
        };
        say!("{mark}  {}: {}\n               {}\n", claim.place, claim.statement, claim.evidence);
    }
    if report.damaged > 0 {
        tell!(
            "warning: {} lines of cells.jsonl could not be read; their cells were measured again, and the file as it was is \
             kept as cells.jsonl.damaged",
            report.damaged
        );
    }
    if !report.missing.is_empty() {
        say!("missing in this build: {}\n", report.missing.join(", "));
    }
    say!("{}\n", report.page.display());
    Ok(ExitCode::SUCCESS)
}
