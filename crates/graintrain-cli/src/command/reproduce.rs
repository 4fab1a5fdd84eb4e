//! `graintrain reproduce`: the paper's experiments.

use crate::error::Failure;
use crate::signal::Stop;
use crate::solving::positive;
use crate::terminal::{say, tell};
use crate::threads::with_threads;
use graintrain_lab::reproduce::claims::Verdict;
use graintrain_lab::reproduce::compressibility::drop::Phase;
use graintrain_lab::reproduce::compressibility::{self, Measured};
use graintrain_lab::reproduce::report::{Report, reproduce};
use graintrain_lab::reproduce::{Progress, ReproduceError, Settings, Target};
use indicatif::{ProgressBar, ProgressStyle};
use std::io;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

/// Run the paper's experiments again and report which claims hold
///
/// Writes CSV, SVG plots, pictures and one HTML report. A reproduction that was stopped or killed goes on
/// with the same command.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  graintrain reproduce all --n 4\n  graintrain reproduce fig10 --n 8 --out fig10\n  \
    graintrain reproduce compressibility --n 4 --every 10\n  \
    graintrain reproduce compressibility --n 2 --every 1 --caps 10,100,1000 --densities 1,1000,7800 --envelopes 0.3,1 --readings\n\n\
    Sizes: n = 4 takes minutes, n = 8 an hour, n = 16 a night; for n = 32 use `run sedimentation --set n=32`.\n\
    Exit codes: 0 done, whatever the verdicts; 1 failed; 2 bad arguments; 130 and 143 stopped by Ctrl-C and SIGTERM."
)]
pub struct Arguments {
    /// What: all, table3, table4, fig8, fig10, fig11, fig12, fig15, physics; or compressibility, the settling
    /// experiment: ranks, errors and use of tensor trains of the Newton matrices of one drop
    #[arg(value_parser = subject)]
    target: Subject,
    /// The paper's size parameter: (2n+1)^3 spheres
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=64))]
    n: u32,
    /// Steps of each simulation; by default as long as each experiment takes
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u64).range(1..))]
    steps: Option<u64>,
    /// Folder of the results; by default out/reproduce-TARGET-nN
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Time limit of one solve, s; by default 4 (n/4)^3. Of compressibility: of one compression, inversion or
    /// linear solve, by default 10
    #[arg(long, value_name = "SECONDS", value_parser = positive, allow_negative_numbers = true)]
    max_seconds: Option<f64>,
    /// Number of threads of the simulations; solves are always measured on one
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Print nothing but the verdicts
    #[arg(long)]
    quiet: bool,
    #[command(flatten)]
    compressibility: Compressibility,
}

/// What only the settling experiment takes.
#[derive(clap::Args)]
#[command(next_help_heading = "Options of compressibility")]
struct Compressibility {
    /// Measure every K-th Newton system of a solve at accuracy 1e-2 and rank 10; the first, the 10th and the
    /// last are always measured, at every accuracy and cap
    #[arg(long, value_name = "K", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Follow a solve for at most K Newton iterations
    #[arg(long, value_name = "K", default_value_t = compressibility::LONGEST as u32, value_parser = clap::value_parser!(u32).range(1..))]
    newton: u32,
    /// Densities of the grains, kg/m^3
    #[arg(long, value_name = "RHO,...", value_delimiter = ',', default_value = "1000", value_parser = positive)]
    densities: Vec<f64>,
    /// Contact envelopes, radii
    #[arg(long, value_name = "DELTA,...", value_delimiter = ',', default_value = "0.3", value_parser = positive)]
    envelopes: Vec<f64>,
    /// Caps on the ranks; the paper has 10, 100 and 1000
    #[arg(long, value_name = "R,...", value_delimiter = ',', default_value = "10", value_parser = clap::value_parser!(u32).range(1..))]
    caps: Vec<u32>,
    /// Stages of the drop
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', default_value = "free-fall,falling,settled", value_parser = phase)]
    phases: Vec<Phase>,
    /// Measure the readings of the recipe too, and two trains that are definite by construction
    #[arg(long)]
    readings: bool,
}

/// What is reproduced.
#[derive(Clone, Copy)]
enum Subject {
    /// Tables and figures of the paper.
    Paper(Target),
    /// The settling experiment.
    Compressibility,
}

/// Name of [`Subject::Compressibility`] on the command line.
const COMPRESSIBILITY: &str = "compressibility";

fn subject(name: &str) -> Result<Subject, String> {
    if name == COMPRESSIBILITY {
        return Ok(Subject::Compressibility);
    }
    let known = Target::NAMES.iter().find(|(known, _)| *known == name);
    known.map(|(_, target)| Subject::Paper(*target)).ok_or_else(|| {
        let names: Vec<&str> = Target::NAMES.iter().map(|(name, _)| *name).collect();
        format!("choose one of {}, {COMPRESSIBILITY}", names.join(", "))
    })
}

fn phase(name: &str) -> Result<Phase, String> {
    Phase::ALL.into_iter().find(|phase| phase.name() == name).ok_or_else(|| {
        let names: Vec<&str> = Phase::ALL.iter().map(|phase| phase.name()).collect();
        format!("choose some of {}", names.join(", "))
    })
}

/// Measures, writes the results and prints what they say.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    if matches!(arguments.target, Subject::Compressibility) && arguments.steps.is_some() {
        let what = io::Error::new(io::ErrorKind::InvalidInput, "--steps does not belong to compressibility");
        return Err(Failure::input_error(what, "choose stages of the drop with --phases"));
    }
    let stop = Stop::listen()?;
    let name = match arguments.target {
        Subject::Compressibility => COMPRESSIBILITY,
        Subject::Paper(target) => {
            Target::NAMES.iter().find(|(_, known)| *known == target).map_or("", |(name, _)| name)
        }
    };
    let standard = || PathBuf::from(format!("out/reproduce-{name}-n{}", arguments.n));
    let out = arguments.out.clone().unwrap_or_else(standard);
    let bar = if arguments.quiet { ProgressBar::hidden() } else { ProgressBar::new(0) };
    let style =
        ProgressStyle::with_template("[{bar:30}] {pos}/{len} | {elapsed} so far, {eta} to go | {wide_msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.enable_steady_tick(Duration::from_millis(500));
    let mut progress = |progress: &Progress| {
        bar.set_length(progress.total as u64);
        bar.set_position(progress.done as u64);
        bar.set_message(progress.label.clone());
    };
    let requested = Arc::clone(&stop.requested);
    let result = with_threads(arguments.threads, || match arguments.target {
        Subject::Paper(target) => {
            let settings = Settings {
                target,
                n: arguments.n as usize,
                steps: arguments.steps,
                out,
                max_seconds: arguments.max_seconds,
            };
            reproduce(&settings, &requested, &mut progress).map(Outcome::Paper)
        }
        Subject::Compressibility => {
            let settings = settling(arguments, out);
            compressibility::reproduce(&settings, &requested, &mut progress).map(Outcome::Compressibility)
        }
    })?;
    bar.finish_and_clear();
    match result {
        Ok(Outcome::Paper(report)) => say_verdicts(&report)?,
        Ok(Outcome::Compressibility(measured)) => say_means(&measured)?,
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
    }
    Ok(ExitCode::SUCCESS)
}

/// What a reproduction gave.
enum Outcome {
    Paper(Report),
    Compressibility(Measured),
}

/// Time limit of the settling experiment's single pieces of work, s.
const PIECE: f64 = 10.0;

fn settling(arguments: &Arguments, out: PathBuf) -> compressibility::Settings {
    let own = &arguments.compressibility;
    let limit = Duration::try_from_secs_f64(arguments.max_seconds.unwrap_or(PIECE));
    compressibility::Settings {
        n: arguments.n as usize,
        envelopes: own.envelopes.clone(),
        densities: own.densities.clone(),
        phases: own.phases.clone(),
        every: own.every as usize,
        newton: own.newton as usize,
        caps: own.caps.iter().map(|&cap| cap as usize).collect(),
        readings: own.readings,
        limit: limit.unwrap_or(Duration::MAX),
        out,
    }
}

fn warn_of_damage(damaged: usize) {
    if damaged > 0 {
        tell!(
            "warning: {damaged} lines of cells.jsonl could not be read; their cells were measured again, and the file as it was is \
             kept as cells.jsonl.damaged"
        );
    }
}

fn say_means(measured: &Measured) -> Result<(), Failure> {
    warn_of_damage(measured.damaged);
    say!("{}\n{} rows, {} of them new\n", measured.summary, measured.rows.len(), measured.new);
    say!("{}\n", measured.table.display());
    Ok(())
}

fn say_verdicts(report: &Report) -> Result<(), Failure> {
    for claim in &report.claims {
        let mark = match claim.verdict {
            Verdict::Holds => "holds        ",
            Verdict::Fails => "does not hold",
            Verdict::Open => "not decided  ",
        };
        say!("{mark}  {}: {}\n               {}\n", claim.place, claim.statement, claim.evidence);
    }
    warn_of_damage(report.damaged);
    if !report.missing.is_empty() {
        say!("missing in this build: {}\n", report.missing.join(", "));
    }
    say!("{}\n", report.page.display());
    Ok(())
}
