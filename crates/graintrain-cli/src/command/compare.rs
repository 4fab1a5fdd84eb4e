//! `graintrain compare`: many problems, many solvers, one yardstick.

use crate::error::Failure;
use crate::evaluation::Yardstick;
use crate::profile;
use crate::signal::Stop;
use crate::solving::{self, Options, Record};
use crate::terminal::{answer, say, tell};
use crate::threads::with_threads;
use graintrain_ccp::SolverSpec;
use graintrain_ccp::registry::Method;
use graintrain_io::problem_file::ProblemFile;
use indicatif::{ProgressBar, ProgressStyle};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Short solves are repeated this often, the fastest counts ...
const REPEAT: usize = 20;
/// ... within this time.
const SHORT: Duration = Duration::from_millis(200);

/// Compare solvers on contact problems
///
/// Every solver starts from zero impulses on every problem. Its answer is evaluated by code that no solver
/// shares; a solver counts as converged only where that evaluation agrees. With `--threads 1` times are
/// processor times, unless `--max-seconds` limits them: then they are of the wall clock, as the limit is.
/// Solves of milliseconds are repeated and the fastest counts. Files that hold no problem which is solved
/// here are reported and left out (exit code 2 after the others). Ctrl-C ends the comparison with what is
/// done.
#[derive(clap::Args)]
#[command(after_help = "Examples, on problems of a run:\n  \
    graintrain run stack --steps 30 --dump-problem every=10 --out demo\n  \
    graintrain compare demo/problems --solvers apgd,pgs,ipm --tolerance 1e-6\n  \
    graintrain compare demo/problems --max-seconds 10 --profile profile.svg\n  \
    graintrain compare demo/problems/step_00000030.hdf5 --solvers ipm --friction coulomb --json")]
pub struct Arguments {
    /// Files of contact problems; a folder stands for the .hdf5, .h5 and .dat files in it
    #[arg(required = true)]
    problem: Vec<PathBuf>,
    /// Solvers by name, separated by commas; `all` for every one
    #[arg(long, value_name = "A,B,C", value_delimiter = ',', default_value = "all")]
    solvers: Vec<String>,
    /// Draw the performance profile (Dolan and More 2002)
    #[arg(long, value_name = "FILE.svg")]
    profile: Option<PathBuf>,
    #[command(flatten)]
    options: Options,
}

/// Solves everything and prints.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let specs = specs(&arguments.solvers)?;
    let (files, left_out) = read_all(&arguments.problem)?;
    if let Some(path) = &arguments.profile {
        solving::check_writable(path, "--profile needs a file that can be written")?;
    }
    let stop = Stop::listen()?;
    let mut progress = Progress::new(&files, &specs);
    let mut records: Vec<Record> = Vec::new();
    for (name, file) in &files {
        let of_problem = with_threads(arguments.options.threads, || {
            solve_all(arguments, &specs, name, file, &stop, &mut progress)
        })?;
        if !arguments.options.json && !of_problem.is_empty() {
            progress.bar.suspend(|| print_problem(name, file, &of_problem));
        }
        records.extend(of_problem);
        if stop.exit_code().is_some() {
            break;
        }
    }
    progress.bar.finish_and_clear();
    let interrupted = stop.exit_code();
    if arguments.options.json {
        let text = serde_json::to_string_pretty(&records).unwrap_or_default();
        answer(text + "\n")?;
    } else if files.len() > 1 {
        print_summary(&records);
    }
    if let Some(path) = &arguments.profile {
        std::fs::write(path, profile::svg(&records)).map_err(|error| {
            solving::unwritable(path, &error, "--profile needs a file that can be written")
        })?;
    }
    if let Some(code) = interrupted {
        tell!("stopped after {} of {} solves", records.len(), files.len() * specs.len());
        return Ok(code);
    }
    if left_out > 0 {
        tell!("{left_out} of {} files left out, see above", files.len() + left_out);
        return Ok(ExitCode::from(2));
    }
    let unconverged = arguments.options.strict && records.iter().any(|record| !record.converged);
    Ok(if unconverged { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// Reads all problems before the first solve, each with its name in tables. What cannot be read is reported
/// on stderr at once; also gives the number of those files.
fn read_all(paths: &[PathBuf]) -> Result<(Vec<(String, ProblemFile)>, usize), Failure> {
    let paths = expanded(paths)?;
    let mut files = Vec::new();
    let mut failures = Vec::new();
    for path in &paths {
        match solving::read_problem(path) {
            Ok(file) => files.push((distinct_name(path, &paths), file)),
            // A name that is mistyped is better reported before hours of work than after.
            Err(failure) if !path.exists() => return Err(failure),
            Err(failure) => failures.push(failure),
        }
    }
    let last = if files.is_empty() { failures.pop() } else { None };
    for failure in &failures {
        failure.report();
    }
    if let Some(last) = last {
        return Err(last);
    }
    Ok((files, failures.len()))
}

/// The files asked for; a folder stands for the problem files in it, in the order of their names.
fn expanded(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    const EXTENSIONS: [&str; 3] = ["hdf5", "h5", "dat"];
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let unreadable = |error: std::io::Error| {
            let what = std::io::Error::new(error.kind(), format!("{}: {error}", path.display()));
            Failure::input_error(what, "check the name and the permissions of the folder")
        };
        let mut inside = Vec::new();
        for entry in std::fs::read_dir(path).map_err(unreadable)? {
            let file = entry.map_err(unreadable)?.path();
            let extension = file.extension().unwrap_or_default();
            if EXTENSIONS.iter().any(|known| extension.eq_ignore_ascii_case(known)) && file.is_file() {
                inside.push(file);
            }
        }
        if inside.is_empty() {
            let what = format!("{}: a folder without .hdf5, .h5 or .dat files", path.display());
            let what = std::io::Error::new(std::io::ErrorKind::NotFound, what);
            return Err(Failure::input_error(what, "name the files of contact problems"));
        }
        inside.sort();
        files.extend(inside);
    }
    Ok(files)
}

/// How far a comparison is: a bar on stderr, where that is a terminal and it takes longer than a moment.
struct Progress {
    bar: ProgressBar,
    solves: usize,
    done: usize,
}

impl Progress {
    /// The bar goes by contacts, so that the time to go is a guess that large problems do not upset.
    fn new(files: &[(String, ProblemFile)], specs: &[SolverSpec]) -> Self {
        let contacts: usize = files.iter().map(|(_, file)| weight(file)).sum();
        let bar = solving::spinner();
        bar.set_length((contacts * specs.len()) as u64);
        // The template is a constant; were it faulty, the plain spinner would do.
        if let Ok(style) = ProgressStyle::with_template(
            "{spinner} {bar:24.cyan/blue} {msg} | {elapsed} so far, about {eta} to go",
        ) {
            bar.set_style(style.progress_chars("=> "));
        }
        Self { bar, solves: files.len() * specs.len(), done: 0 }
    }

    fn begin(&mut self, name: &str, spec: &SolverSpec) {
        self.done += 1;
        self.bar.set_message(format!("{} of {}: {name}, {spec}", self.done, self.solves));
    }
}

fn weight(file: &ProblemFile) -> usize {
    file.problem.num_contacts().max(1)
}

/// Names with the commas of their own settings (`tt-cross@1e-3,100`) put back: no solver's name is a number.
fn rejoined(names: &[String]) -> Vec<String> {
    let mut whole: Vec<String> = Vec::new();
    for name in names {
        match whole.last_mut() {
            Some(last) if last.contains('@') && name.parse::<usize>().is_ok() => {
                last.push(',');
                last.push_str(name);
            }
            _ => whole.push(name.clone()),
        }
    }
    whole
}

/// The solvers asked for, each once.
fn specs(names: &[String]) -> Result<Vec<SolverSpec>, Failure> {
    let mut specs: Vec<SolverSpec> = Vec::new();
    for name in &rejoined(names) {
        let expanded: Vec<&str> =
            if name == "all" { Method::available().map(Method::name).collect() } else { vec![name] };
        for name in expanded {
            let spec = solving::solver_spec(name)?;
            if !specs.contains(&spec) {
                specs.push(spec);
            }
        }
    }
    Ok(specs)
}

/// Every solver on one problem, or those that were done when the user stopped it.
fn solve_all(
    arguments: &Arguments,
    specs: &[SolverSpec],
    name: &str,
    file: &ProblemFile,
    stop: &Stop,
    progress: &mut Progress,
) -> Vec<Record> {
    let options = &arguments.options;
    let yardstick = Yardstick::new(file.posed(options.friction));
    let mut records = Vec::new();
    for spec in specs {
        progress.begin(name, spec);
        let mut best: Option<Record> = None;
        let start = Instant::now();
        for _ in 0..REPEAT {
            let record = match solving::run(name, file, &yardstick, spec, options, stop) {
                Ok(outcome) => outcome.record,
                Err(error) => solving::refused(name, file, spec, options, &error),
            };
            // A solve that was cut short says nothing about its solver.
            if stop.exit_code().is_some() {
                break;
            }
            // Where the machine was busy a repetition may have run out of its time.
            let is_better = |best: &Record| {
                record.converged && !best.converged
                    || record.converged == best.converged && record.cost() < best.cost()
            };
            if best.as_ref().is_none_or(is_better) {
                best = Some(record);
            }
            if start.elapsed() > SHORT {
                break;
            }
        }
        records.extend(best.map(|record| Record { solver: spec.to_string(), ..record }));
        if stop.exit_code().is_some() {
            break;
        }
        progress.bar.inc(weight(file) as u64);
    }
    records
}

/// The table of one problem; the fastest solver that converged is starred.
fn print_problem(name: &str, file: &ProblemFile, records: &[Record]) {
    say!("{name}\n  {}\n", solving::describe(file));
    for note in file.notes() {
        say!("  note: {note}\n");
    }
    let fastest = records.iter().filter(|record| record.converged).map(Record::cost).reduce(f64::min);
    let width = records.iter().map(|record| record.solver.len()).max().unwrap_or(0).max(6);
    say!(
        "  {:<width$}  {:<15} {:>10} {:>8} {:>11}  {:>8}  {:>8}  {:>19}\n",
        "solver",
        "status",
        "iterations",
        "linear",
        if records.iter().any(Record::by_processor) { "cpu time" } else { "wall time" },
        "relaxed",
        "Coulomb",
        "objective, J"
    );
    for record in records {
        let star = if record.converged && Some(record.cost()) == fastest { "*" } else { " " };
        if record.status.is_none() {
            say!(
                "  {:<width$}  {}\n",
                record.solver,
                record.remark.as_deref().unwrap_or("cannot treat this problem")
            );
            continue;
        }
        let verdict = record.verdict();
        say!(
            "  {:<width$}  {verdict:<15} {:>10} {:>8} {:>11}{star} {:>8.1e}  {:>8.1e}  {:>19.12e}\n",
            record.solver,
            record.iterations,
            record.linear_iterations,
            solving::seconds_text(record.cost()),
            record.residual_relaxed,
            record.residual_coulomb,
            record.objective,
        );
    }
    if records.iter().any(|record| record.converged && record.iterations == 0) {
        say!(
            "  0 iterations: the solver's start (`ipm`: projected gradients) met the tolerance before its first iteration\n"
        );
    }
    say!("\n");
}

/// How often each solver converged, and how its time compares with the fastest.
fn print_summary(records: &[Record]) {
    let summary = profile::summary(records);
    let width = summary.iter().map(|line| line.solver.len()).max().unwrap_or(0).max(6);
    say!("{:<width$}  {:>9}  {:>7}  time over the fastest\n", "solver", "converged", "fastest");
    say!("{:<width$}  {:>9}  {:>7}  (geometric mean where converged)\n", "", "", "");
    for line in summary {
        let ratio = line.mean_ratio.map_or("-".to_string(), |ratio| format!("{ratio:.2}"));
        let refused = match line.refused {
            0 => String::new(),
            problems => format!("  (cannot treat {problems} more)"),
        };
        say!(
            "{:<width$}  {:>9}  {:>7}  {ratio}{refused}\n",
            line.solver,
            format!("{}/{}", line.converged, line.problems),
            line.fastest
        );
    }
}

/// The file name of a problem, or its path where another problem has the same file name.
fn distinct_name(path: &Path, all: &[PathBuf]) -> String {
    let name = solving::problem_name(path);
    let shared = all.iter().filter(|other| solving::problem_name(other) == name).count() > 1;
    if shared { path.display().to_string() } else { name }
}
