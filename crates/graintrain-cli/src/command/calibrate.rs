//! `graintrain calibrate`: parameters of a scene from what was measured.

use crate::closing::counted;
use crate::error::Failure;
use crate::signal::Stop;
use crate::sweeping::{RunsOptions, ended, sweep_failure, unreadable_input};
use crate::terminal::{say, tell};
use graintrain_lab::calibrate::question::{Parameter, Question, Target};
use graintrain_lab::calibrate::{Answer, Stage, calibrate};
use graintrain_lab::sweep::collect::Estimate;
use graintrain_lab::sweep::report::with_error;
use std::num::NonZeroUsize;
use std::process::ExitCode;

/// Find the parameters with which a scene reaches what was measured
///
/// Runs the scene at points of the given ranges, draws a smooth surrogate (a Gaussian process) through what
/// the runs say, and goes on where that tells most about the answer, until what is not known of the runs no
/// longer matters or --points are made. The answer has an error and a 95 % interval, in which the errors of
/// the measured numbers, the scatter of the runs and the surrogate's own ignorance are counted. Writes
/// calibration.json, calibration.html, observed.csv and the ledger of points. A calibration that was stopped
/// or killed goes on with the same command to the same answer; a larger --points adds to it.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  graintrain calibrate heap.toml --fit mu=0.1..0.8 --to 'heap.repose_angle:last=20.3 deg+-0.5 deg'\n  \
    graintrain calibrate shear.toml --fit mu=0.1..0.8 --fit rolling=0..0.2 --to box.tau_over_sigma=measured.csv --points 40\n  \
    graintrain calibrate press.toml --fit stiffness=log:1e4..1e7 --to cell.porosity=0.39+-1%\n\n\
    measured.csv has a header of two or three names: a column of the same measurement (as displacement) or a key of the scene, the ordinate, its\n\
    standard error; names may have units in brackets. --to box.tau=measured.csv+-5% gives all points an error.\n\n\
    Exit codes: 0 done; 1 no values in the ranges reach what was measured, no run has a number near the answer, or a run failed (the others are made); 2 bad input; 130 and 143 stopped by Ctrl-C and SIGTERM."
)]
pub struct Arguments {
    #[command(flatten)]
    runs: RunsOptions,
    /// A parameter or key of the scene and the range in which it is looked for; log: where magnitudes are;
    /// may be repeated
    #[arg(long = "fit", value_name = "KEY=LOW..HIGH", required = true)]
    fit: Vec<String>,
    /// What is to be reached, with its standard error: an observable as in sweep and a number or the file of
    /// a curve; may be repeated
    #[arg(long = "to", value_name = "OBSERVABLE=VALUE+-ERROR|FILE.csv", required = true)]
    to: Vec<String>,
    /// Most points; by default 22 for one parameter and 12 more for each other
    #[arg(long, value_name = "N")]
    points: Option<NonZeroUsize>,
    /// Points per round after the first: as many runs as are made at a time, or a multiple
    #[arg(long, value_name = "N", default_value_t = NonZeroUsize::MIN.saturating_add(3))]
    batch: NonZeroUsize,
}

pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let all =
        |texts: &[String]| texts.iter().map(|text| Parameter::parse(text)).collect::<Result<Vec<_>, _>>();
    let parameters = all(&arguments.fit).map_err(sweep_failure)?;
    let targets = arguments.to.iter().map(|text| Target::parse(text)).collect::<Result<Vec<_>, _>>();
    let targets = targets.map_err(unreadable_input)?;
    let most_points = arguments.points.map_or(10 + 12 * parameters.len(), NonZeroUsize::get);
    let question = Question {
        plan: arguments.runs.plan()?,
        parameters,
        targets,
        from: arguments.runs.from,
        batch: arguments.batch.get(),
        most_points,
    };
    question.validate().map_err(sweep_failure)?;
    let stop = Stop::listen()?;
    let how = arguments.runs.execution("calibrate");
    if !arguments.runs.quiet {
        let seeds = question.plan.seeds;
        say!(
            "up to {most_points} points, {} each, {} at a time -> {}\n",
            counted(seeds, "seed", "seeds"),
            how.jobs,
            how.folder.display()
        );
    }
    let bar = arguments.runs.bar(0);
    let progress = |stage: Stage<'_>| {
        bar.set_length(stage.total);
        bar.show(stage.done, stage.last, stage.losses);
    };
    let answer = calibrate(&question, &how, &stop.requested, &progress);
    bar.clear();
    let answer = match answer {
        Ok(answer) => answer,
        Err(error) => return ended(error, &stop),
    };
    answer.write(&how.folder).map_err(sweep_failure)?;
    for (run, why) in &answer.failed {
        tell!("warning: {run} failed: {why}");
    }
    let doubts = answer.doubts();
    doubts.iter().for_each(|doubt| tell!("warning: {doubt}"));
    if !arguments.runs.quiet {
        print(&answer);
        say!(
            "\n  {}: calibration.html, calibration.json, observed.csv, ledger.csv, runs/\n",
            how.folder.display()
        );
    }
    let is_answered = answer.failed.is_empty() && !answer.is_missed() && answer.silent_aim().is_none();
    Ok(if is_answered { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn print(answer: &Answer) {
    let text = |value: f64, error: f64| with_error(&Estimate { value, error, count: 1 });
    let runs = answer.observations.len() * answer.aims.conditions.len();
    say!("\n{} points, {runs} runs\n\n", answer.points.len());
    let fitted = answer.fitted();
    for parameter in &fitted {
        let interval = format!("95 %: {:.4} to {:.4}", Short(parameter.low), Short(parameter.high));
        say!("  {:<24} {}    {interval}\n", parameter.key, text(parameter.value, parameter.error));
    }
    say!("\n");
    for reached in answer.reached().iter().take(12) {
        say!(
            "  {:<40} {} (measured {})\n",
            reached.aim,
            text(reached.predicted, reached.predicted_error),
            text(reached.value, reached.error)
        );
    }
    let plan = &answer.question.plan;
    let fitted = answer.question.settings(&answer.distribution.likeliest);
    let settings: Vec<String> = plan
        .settings
        .iter()
        .chain(&fitted)
        .map(|(key, value)| format!("--set {}", quoted(&format!("{key}={value}"))))
        .collect();
    say!("\n  likeliest: graintrain run {} {}\n", quoted(&plan.scene), settings.join(" "));
}

/// A word as a shell takes it: in quotes where it would split or change it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "=.,-+_/:@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_string()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

/// A number to so many digits, with an exponent where it is large or small.
struct Short(f64);

impl std::fmt::Display for Short {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let digits = f.precision().unwrap_or(4);
        let size = self.0.abs();
        if size == 0.0 || (1e-3..1e5).contains(&size) {
            write!(f, "{:.digits$}", self.0)
        } else {
            write!(f, "{:.digits$e}", self.0)
        }
    }
}
