//! What `sweep`, the studies and `calibrate` share: options, progress, failures, the end.

use crate::closing::counted;
use crate::error::Failure;
use crate::progress::LINE_EVERY;
use crate::scene_failure::scene_failure;
use crate::signal::Stop;
use crate::terminal::{say, tell};
use graintrain_io::mark::Loss;
use graintrain_io::scene;
use graintrain_lab::sweep::SweepError;
use graintrain_lab::sweep::collect::{Collected, Sample, check_names, collect};
use graintrain_lab::sweep::execute::{Execution, Outcome, Progress, check, execute};
use graintrain_lab::sweep::plan::{Cell, Plan};
use graintrain_lab::sweep::report::{shown, with_error};
use indicatif::{ProgressBar, ProgressStyle};
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// Options of all that make many runs.
#[derive(clap::Args)]
pub struct RunsOptions {
    /// A scene file (TOML) or the name of a built-in scene
    pub scene: String,
    /// Set a parameter of the scene or any of its keys in all runs; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// Runs per point, with different seeds
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    seeds: u64,
    /// Runs at a time; processors by threads where it is not given
    #[arg(long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
    /// Threads of each run
    #[arg(long, value_name = "N", default_value_t = NonZeroUsize::MIN)]
    threads: NonZeroUsize,
    /// Means in time begin here, in seconds or with a unit; by default where a series becomes steady
    #[arg(long, value_name = "SECONDS", value_parser = scene::seconds, allow_hyphen_values = true)]
    pub from: Option<f64>,
    /// Folder of the results; by default out/COMMAND-NAME
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Let the runs write frames, for `view` and `render`
    #[arg(long)]
    frames: bool,
    /// Print nothing but warnings and errors
    #[arg(long)]
    pub quiet: bool,
}

/// Options of all sweeps.
#[derive(clap::Args)]
pub struct SweepOptions {
    #[command(flatten)]
    runs: RunsOptions,
    /// An observable of the page and the printed table: MEASURE.COLUMN (its mean in time), with :max, :min or
    /// :last, or a figure of summary.json; may be repeated. All of them are in sweep.csv
    #[arg(long = "observe", value_name = "NAME")]
    observe: Vec<String>,
}

/// The bar of many runs, with warnings above it; where stderr is no terminal a line a minute.
pub struct RunsBar {
    bar: ProgressBar,
    /// Ends the lines when it is dropped.
    _log: Option<Sender<()>>,
}

/// Writes a line a minute until the sender that it gives is dropped: runs may take longer than the patience
/// of who reads the log.
fn log_lines(bar: ProgressBar) -> Sender<()> {
    let (sender, ended) = channel();
    std::thread::spawn(move || {
        while ended.recv_timeout(LINE_EVERY) == Err(RecvTimeoutError::Timeout) {
            tell!("{}", log_line(bar.position(), bar.length().unwrap_or(0), bar.elapsed()));
        }
    });
    sender
}

fn log_line(done: u64, runs: u64, elapsed: Duration) -> String {
    let seconds = elapsed.as_secs_f64();
    let to_go = match done {
        0 => String::new(),
        done => format!(", about {:.0} s to go", seconds * runs.saturating_sub(done) as f64 / done as f64),
    };
    format!("{done} of {runs} runs done, {seconds:.0} s so far{to_go}")
}

impl RunsBar {
    /// A run ended: so many are done now. `losses` is what an interruption had left damaged of it.
    pub fn show(&self, done: usize, last: &str, losses: &[Loss]) {
        self.bar.set_position(done as u64);
        self.bar.set_message(last.to_string());
        for loss in losses {
            self.bar.suspend(|| tell!("warning: {last}: {loss}"));
        }
    }

    /// How many runs there will be.
    pub fn set_length(&self, runs: usize) {
        self.bar.set_length(runs as u64);
    }

    /// The end of it.
    pub fn clear(&self) {
        self.bar.finish_and_clear();
    }
}

/// A sweep that has been made.
pub struct Made {
    pub folder: PathBuf,
    pub plan: Plan,
    pub cells: Vec<Cell>,
    pub collected: Collected,
    /// Observables to be shown.
    pub names: Vec<String>,
    failed: usize,
    quiet: bool,
}

impl RunsOptions {
    /// The plan without points.
    pub fn plan(&self) -> Result<Plan, Failure> {
        let settings = self.settings.iter().map(|text| scene::setting(text).map_err(scene_failure));
        let settings = settings.collect::<Result<_, _>>()?;
        let (scene, seeds, frames) = (self.scene.clone(), self.seeds, self.frames);
        Ok(Plan { scene, settings, points: vec![Vec::new()], seeds, frames })
    }

    /// Where results go and how many runs are made at a time. `kind` is a word for the folder.
    pub fn execution(&self, kind: &str) -> Execution {
        let name = Path::new(&self.scene).file_stem().map_or("scene".into(), |stem| stem.to_string_lossy());
        let folder = self.out.clone().unwrap_or_else(|| Path::new("out").join(format!("{kind}-{name}")));
        let processors = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
        let jobs = self.jobs.map_or((processors / self.threads.get()).max(1), NonZeroUsize::get);
        Execution { folder, jobs, threads: self.threads.get() }
    }

    /// A bar of so many runs, hidden where nothing is to be printed.
    pub fn bar(&self, runs: usize) -> RunsBar {
        let bar = if self.quiet { ProgressBar::hidden() } else { ProgressBar::new(runs as u64) };
        let style = ProgressStyle::with_template(
            "[{bar:30}] {pos}/{len} | {elapsed} so far, {eta} to go | {wide_msg}",
        );
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.enable_steady_tick(Duration::from_millis(500));
        let is_log = !self.quiet && !std::io::stderr().is_terminal();
        RunsBar { _log: is_log.then(|| log_lines(bar.clone())), bar }
    }
}

/// What ends a command whose runs ended in an error: the exit code of the signal where somebody asked to
/// stop.
pub fn ended(error: SweepError, stop: &Stop) -> Result<ExitCode, Failure> {
    match error {
        SweepError::Stopped => {
            tell!("stopped; the same command goes on from here");
            Ok(stop.exit_code().unwrap_or(ExitCode::FAILURE))
        }
        error => Err(sweep_failure(error)),
    }
}

impl SweepOptions {
    /// The plan without points.
    pub fn plan(&self) -> Result<Plan, Failure> {
        self.runs.plan()
    }

    /// Makes all runs of the plan, with a bar, and collects what they measured. `kind` is a word for the
    /// folder.
    ///
    /// # Errors
    /// `Err(Ok(code))` where it was stopped.
    pub fn make(&self, plan: Plan, kind: &str) -> Result<Made, Result<ExitCode, Failure>> {
        let stop = Stop::listen().map_err(Err)?;
        let cells = plan.cells().map_err(|error| Err(sweep_failure(error)))?;
        let how = self.runs.execution(kind);
        let how = Execution { jobs: how.jobs.min(cells.len()), ..how };
        if !self.runs.quiet {
            say!(
                "{} ({}, {}), {} at a time -> {}\n",
                counted(cells.len() as u64, "run", "runs"),
                counted(plan.points.len() as u64, "point", "points"),
                counted(plan.seeds, "seed", "seeds"),
                how.jobs,
                how.folder.display()
            );
        }
        // Before the first run, not after the last one.
        let known = check(&plan, &cells, self.runs.from).map_err(|error| Err(sweep_failure(error)))?;
        check_names(&self.observe, &known).map_err(|error| Err(sweep_failure(error)))?;
        let bar = self.runs.bar(cells.len());
        let progress = |progress: Progress<'_>| bar.show(progress.done, progress.last, progress.losses);
        let outcomes = execute(&plan, &cells, &how, &stop.requested, &progress);
        bar.clear();
        let outcomes = outcomes.map_err(|error| ended(error, &stop))?;
        let mut failed = 0;
        for (cell, outcome) in cells.iter().zip(&outcomes) {
            if let Outcome::Failed(why) = outcome {
                failed += 1;
                tell!("warning: {} failed: {why}", cell.name);
            }
        }
        let failure = |error| Err(sweep_failure(error));
        let folder = how.folder;
        let collected = collect(&folder, &cells, self.runs.from).map_err(failure)?;
        collected.write(&folder, &plan, &cells).map_err(failure)?;
        let names = shown(&collected, &self.observe).map_err(failure)?;
        Ok(Made { folder, plan, cells, collected, names, failed, quiet: self.runs.quiet })
    }
}

impl Made {
    /// Whether nothing but warnings is to be printed.
    pub fn is_quiet(&self) -> bool {
        self.quiet
    }

    /// Warns of means that are not of the state that they are to be of.
    fn warn_of_other_moments(&self) {
        let runs = self.cells.len();
        let samples = || self.collected.samples.iter().flatten();
        let mut left = BTreeMap::<&str, usize>::new();
        for first in samples().filter_map(|sample| sample.stages_left.first()) {
            *left.entry(first).or_default() += 1;
        }
        for (first, count) in left {
            tell!(
                "warning: in {count} of {runs} runs the stage `{first}` never began: their figures are those of the stages before it. \
                 A longer `time.end`, or a `time` for the stage before"
            );
        }
        let is_unsteady = |sample: &&Sample| self.names.iter().any(|name| sample.unsteady.contains(name));
        let unsteady = samples().filter(is_unsteady).count();
        if unsteady > 0 && !self.quiet {
            tell!(
                "note: in {unsteady} of {runs} runs a mean above is over records that are not known to be steady; its error does not include that"
            );
        }
    }

    /// Prints the table of the points, and where everything is.
    pub fn conclude(&self) -> ExitCode {
        if !self.quiet {
            for (point, settings) in self.plan.points.iter().enumerate() {
                say!("\n{}\n", graintrain_lab::sweep::plan::label(settings));
                for name in &self.names {
                    if let Some(found) = self.collected.estimate(&self.cells, point, name) {
                        let unit =
                            self.collected.observable(name).map_or("", |observable| observable.unit.as_str());
                        let unit = if unit == "1" { "" } else { unit };
                        say!("  {name:<40} {} {unit}\n", with_error(&found));
                    }
                }
            }
            say!("\n  {}: sweep.html, sweep.csv, runs.csv, columns.json, runs/\n", self.folder.display());
        }
        self.warn_of_other_moments();
        if self.failed > 0 {
            tell!(
                "warning: {} of {} runs failed and are left out of all means",
                self.failed,
                self.cells.len()
            );
            return ExitCode::FAILURE;
        }
        ExitCode::SUCCESS
    }
}

/// As [`sweep_failure`] for what is read before any run: a table that cannot be read is bad input.
pub fn unreadable_input(error: SweepError) -> Failure {
    match error {
        error @ SweepError::Read { .. } => {
            Failure::input_error(error, "correct the file, or give another one")
        }
        error => sweep_failure(error),
    }
}

/// A failure of a sweep, as the user sees it.
pub fn sweep_failure(error: SweepError) -> Failure {
    match error {
        SweepError::Scene { point, error } => {
            tell!("at {point}:");
            scene_failure(*error)
        }
        SweepError::Output(error) => {
            let remedy = error.remedy();
            if error.is_misplaced() {
                return Failure::input_error(error, remedy);
            }
            Failure::work_error(error, remedy)
        }
        error @ (SweepError::Plan(_) | SweepError::Differs { .. } | SweepError::Observable { .. }) => {
            Failure::input_error(error, "")
        }
        error @ SweepError::Occupied(_) => Failure::input_error(error, "choose another folder with --out"),
        // The file is in the way of the same command, too; the error says what to do where something can be
        // done.
        error @ (SweepError::Read { .. } | SweepError::Unusable { .. }) => {
            Failure::work_error(error, "finished runs are kept")
        }
        error => Failure::work_error(error, "finished runs are kept: the same command goes on"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_is_reported_how_far_the_runs_are() {
        assert_eq!(log_line(0, 12, Duration::from_secs(60)), "0 of 12 runs done, 60 s so far");
        let reported = log_line(3, 12, Duration::from_secs(60));
        assert_eq!(reported, "3 of 12 runs done, 60 s so far, about 180 s to go");
    }
}
