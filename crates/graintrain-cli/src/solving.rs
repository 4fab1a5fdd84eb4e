//! What `solve` and `compare` share: options, reading a problem, running a solver, the record of a run.

use crate::error::Failure;
use crate::evaluation::{Evaluation, Yardstick};
use crate::signal::Stop;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use graintrain_ccp::{CcpError, FrictionModel, SolveSettings, SolverSpec, Status};
use graintrain_io::problem_file::{self, Form, ProblemFile};
use graintrain_io::process::cpu_seconds;
use serde::Serialize;
use std::path::Path;
use std::time::{Duration, Instant};

/// Options of a solve.
#[derive(clap::Args)]
pub struct Options {
    /// Stop when the residual of the worst contact is at most this
    #[arg(long, value_name = "X", default_value_t = 1e-4, value_parser = positive, allow_negative_numbers = true)]
    pub tolerance: f64,
    /// Stop each solve after this time, by the wall clock
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    pub max_seconds: Option<f64>,
    /// The convex relaxation, or exact Coulomb friction
    #[arg(long, value_parser = friction_model(), default_value_t = FrictionModel::Relaxed)]
    pub friction: FrictionModel,
    /// Number of threads [default: all processors]
    #[arg(long, value_name = "N")]
    pub threads: Option<std::num::NonZeroUsize>,
    /// Print JSON instead of a table
    #[arg(long)]
    pub json: bool,
    /// Exit with code 1 where a tolerance is not reached
    #[arg(long)]
    pub strict: bool,
}

/// `--friction`: the friction models by name.
pub fn friction_model() -> impl TypedValueParser<Value = FrictionModel> {
    let about = |model| match model {
        FrictionModel::Relaxed => "The convex relaxation (CCP)",
        FrictionModel::Coulomb => "Exact Coulomb friction",
    };
    let names =
        FrictionModel::NAMES.iter().map(move |&(name, model)| PossibleValue::new(name).help(about(model)));
    PossibleValuesParser::new(names).map(|name| {
        let found = FrictionModel::NAMES.iter().find(|(known, _)| *known == name);
        found.map_or(FrictionModel::default(), |&(_, model)| model)
    })
}

/// A number that is finite and positive.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("expected a positive number".to_string()),
    }
}

impl Options {
    /// The settings these options ask for.
    pub fn settings(&self, stop: &Stop) -> SolveSettings {
        SolveSettings {
            tolerance: self.tolerance,
            max_time: self
                .max_seconds
                .map(|limit| Duration::try_from_secs_f64(limit).unwrap_or(Duration::MAX)),
            friction: self.friction,
            stop: Some(std::sync::Arc::clone(&stop.requested)),
            ..SolveSettings::default()
        }
    }
}

/// Reads a problem file.
pub fn read_problem(path: &Path) -> Result<ProblemFile, Failure> {
    problem_file::read(path).map_err(|error| {
        let remedy = error.remedy().to_string();
        Failure::input_error(error, remedy)
    })
}

/// A solver by name.
pub fn solver_spec(name: &str) -> Result<SolverSpec, Failure> {
    name.parse().map_err(|error: CcpError| {
        Failure::input_error(error, "`graintrain solvers` lists the solvers by name")
    })
}

/// The name of a problem in tables: its file name.
pub fn problem_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// One line about a problem.
pub fn describe(file: &ProblemFile) -> String {
    let friction = &file.problem.friction;
    let low = friction.iter().copied().fold(f64::INFINITY, f64::min);
    let high = friction.iter().copied().fold(0.0, f64::max);
    let friction = if friction.is_empty() {
        String::new()
    } else if low == high {
        format!(", friction {}", short(low))
    } else {
        format!(", friction {} to {}", short(low), short(high))
    };
    let form = match file.form {
        Form::Local => "explicit matrix".to_string(),
        Form::RigidBodies => format!("{} rigid bodies", file.bodies),
        Form::Condensed => format!("{} bodies, condensed", file.bodies),
    };
    format!("{} contacts, {form}{friction}", file.problem.num_contacts())
}

/// A number rounded to four digits.
fn short(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// What a solver did to a problem, as it is printed. Residuals and objective come from the independent
/// evaluation.
#[derive(Clone, Debug, Serialize)]
pub struct Record {
    /// File of the problem.
    pub problem: String,
    /// Number of contacts.
    pub contacts: usize,
    /// Number of bodies, 0 where the file does not know them.
    pub bodies: usize,
    /// Solver, with its linear solver where it has one.
    pub solver: String,
    /// `relaxed` or `coulomb`.
    pub friction: FrictionModel,
    /// Tolerance asked for.
    pub tolerance: f64,
    /// Why the solver stopped; `None` where it could not treat the problem.
    pub status: Option<Status>,
    /// Whether the user stopped it.
    #[serde(skip)]
    pub interrupted: bool,
    /// Iterations of the outer method.
    pub iterations: usize,
    /// Iterations of linear solvers, summed.
    pub linear_iterations: usize,
    /// Wall-clock seconds, from the bare problem to the answer.
    pub seconds: f64,
    /// Processor seconds of all threads in that time; `None` where the system does not tell.
    pub cpu_seconds: Option<f64>,
    /// Number of threads, where it was asked for.
    pub threads: Option<usize>,
    /// Whether the solve had a limit of wall-clock time.
    #[serde(skip)]
    pub limited: bool,
    /// Residual in the friction model asked for.
    pub residual: f64,
    /// Its root mean square over the contacts.
    pub residual_rms: f64,
    /// Residual as a relaxed CCP.
    pub residual_relaxed: f64,
    /// Residual as exact Coulomb friction.
    pub residual_coulomb: f64,
    /// 1/2 g^T N g + r^T g, J.
    pub objective: f64,
    /// How far the objective may lie above the optimum, relative to itself; `None` with exact friction, which
    /// minimises nothing.
    pub gap: Option<f64>,
    /// Whether the residual is at most the tolerance: claimed by the solver and confirmed by the evaluation.
    pub converged: bool,
    /// What went wrong, in a sentence.
    pub remark: Option<String>,
    /// What the user should know about the file, one sentence each.
    pub notes: Vec<String>,
}

impl Record {
    /// The status in words; a claim that the evaluation does not confirm is none.
    pub fn verdict(&self) -> &'static str {
        match self.status {
            Some(Status::Converged) if !self.converged => "NOT converged",
            Some(Status::Stopped) if self.interrupted => "interrupted",
            status => status_word(status),
        }
    }

    /// Whether comparisons go by processor time, which other work on the machine does not lengthen: on one
    /// thread, unless there is a limit, which is of wall-clock time.
    pub fn by_processor(&self) -> bool {
        self.threads == Some(1) && !self.limited && self.cpu_seconds.is_some()
    }

    /// The time that comparisons go by ([`Self::by_processor`]), else wall-clock time, s.
    pub fn cost(&self) -> f64 {
        self.cpu_seconds.filter(|_| self.by_processor()).unwrap_or(self.seconds)
    }
}

/// An answer, its evaluation and the record of the run.
pub struct Outcome {
    /// Impulses, N s.
    pub impulse: Vec<f64>,
    /// What they are worth.
    pub evaluation: Evaluation,
    /// The record.
    pub record: Record,
}

/// Round-off may separate a solver's residual from the independent one by this factor at most.
const CONFIRMED: f64 = 1.0 + 1e-3;

/// Solves a problem from zero impulses.
///
/// # Errors
/// Where the solver cannot treat the problem.
pub fn run(
    name: &str,
    file: &ProblemFile,
    yardstick: &Yardstick<'_>,
    spec: &SolverSpec,
    options: &Options,
    stop: &Stop,
) -> Result<Outcome, CcpError> {
    let settings = &options.settings(stop);
    let problem = file.posed(settings.friction);
    let mut impulse = vec![0.0; problem.r.len()];
    let (start, cpu_start) = (Instant::now(), cpu_seconds());
    let report = spec.build()?.solve(problem, &mut impulse, settings)?;
    let seconds = start.elapsed().as_secs_f64();
    let cpu_seconds = cpu_seconds().zip(cpu_start).map(|(end, start)| end - start);
    let evaluation = yardstick.evaluate(&impulse);
    let residual = evaluation.residual(settings.friction);
    // Below 1e-12 round-off decides, and the two evaluations may differ by all of it.
    let confirmed = residual.measured(settings.criterion) <= settings.tolerance * CONFIRMED + 1e-12;
    let remark = (report.converged() && !confirmed).then(|| {
        format!(
            "the solver reports a residual of {:.2e}, the independent evaluation {:.2e}",
            report.residual.max, residual.max
        )
    });
    let record = Record {
        problem: name.to_string(),
        contacts: file.problem.num_contacts(),
        bodies: file.bodies,
        solver: report.solver.clone(),
        friction: settings.friction,
        tolerance: settings.tolerance,
        status: Some(report.status),
        interrupted: report.status == Status::Stopped && stop.exit_code().is_some(),
        iterations: report.iterations,
        linear_iterations: report.linear_iterations,
        seconds,
        cpu_seconds,
        threads: options.threads.map(std::num::NonZeroUsize::get),
        limited: options.max_seconds.is_some(),
        residual: residual.max,
        residual_rms: residual.rms,
        residual_relaxed: evaluation.relaxed.max,
        residual_coulomb: evaluation.coulomb.max,
        objective: evaluation.objective,
        gap: (settings.friction == FrictionModel::Relaxed).then_some(evaluation.gap),
        converged: report.converged() && confirmed,
        remark: remark.or(report.remark),
        notes: notes(file, settings.friction, &impulse),
    };
    Ok(Outcome { impulse, evaluation, record })
}

/// What the user should know about the file, and, where the relaxation took the symmetric part of its matrix,
/// what the answer is worth for the matrix itself.
fn notes(file: &ProblemFile, model: FrictionModel, impulse: &[f64]) -> Vec<String> {
    let mut notes = file.notes();
    if let (Some(as_filed), FrictionModel::Relaxed) = (&file.as_filed, model) {
        let evaluation = Yardstick::new(as_filed).evaluate(impulse);
        notes.push(format!(
            "with the matrix as it is in the file the residual, relaxed, is {:.2e}",
            evaluation.relaxed.max
        ));
    }
    notes
}

/// The record of a solver that cannot treat the problem.
pub fn refused(
    name: &str,
    file: &ProblemFile,
    spec: &SolverSpec,
    options: &Options,
    error: &CcpError,
) -> Record {
    Record {
        problem: name.to_string(),
        contacts: file.problem.num_contacts(),
        bodies: file.bodies,
        solver: spec.to_string(),
        friction: options.friction,
        tolerance: options.tolerance,
        status: None,
        interrupted: false,
        iterations: 0,
        linear_iterations: 0,
        seconds: 0.0,
        cpu_seconds: None,
        threads: None,
        limited: options.max_seconds.is_some(),
        residual: f64::NAN,
        residual_rms: f64::NAN,
        residual_relaxed: f64::NAN,
        residual_coulomb: f64::NAN,
        objective: f64::NAN,
        gap: None,
        converged: false,
        remark: Some(error.to_string()),
        notes: file.notes(),
    }
}

/// A status in words.
pub fn status_word(status: Option<Status>) -> &'static str {
    match status {
        Some(Status::Converged) => "converged",
        Some(Status::Stalled) => "stalled",
        Some(Status::IterationLimit) => "iteration limit",
        Some(Status::Stopped) => "out of time",
        Some(Status::Infeasible) => "infeasible",
        None => "not applicable",
    }
}

/// Seconds with three significant digits.
pub fn seconds_text(seconds: f64) -> String {
    if seconds < 0.0995 {
        format!("{:.3} ms", 1e3 * seconds)
    } else if seconds < 99.5 {
        format!("{seconds:.2} s")
    } else {
        format!("{seconds:.0} s")
    }
}

/// Finds out before the work whether its result can be written: opens the file, which leaves what is in it.
pub fn check_writable(path: &Path, remedy: &str) -> Result<(), Failure> {
    let is_new = !path.exists();
    let opened = std::fs::OpenOptions::new().append(true).create(true).open(path);
    opened.map_err(|error| unwritable(path, &error, remedy))?;
    if is_new {
        // Nothing is left behind where the work fails.
        let _ = std::fs::remove_file(path);
    }
    Ok(())
}

/// A file that cannot be written.
pub fn unwritable(path: &Path, error: &std::io::Error, remedy: &str) -> Failure {
    let what = std::io::Error::new(error.kind(), format!("{}: {error}", path.display()));
    Failure::input_error(what, remedy)
}

/// A spinner on stderr, drawn only where that is a terminal.
pub fn spinner() -> indicatif::ProgressBar {
    let spinner = indicatif::ProgressBar::new_spinner();
    spinner.enable_steady_tick(Duration::from_millis(120));
    spinner
}
