//! `graintrain compare`: many problems, many solvers, one yardstick.

use crate::error::Failure;
use crate::evaluation::Yardstick;
use crate::profile;
use crate::signal::Stop;
use crate::solving::{self, Options, Record};
use crate::threads::with_threads;
use graintrain::problem_file::ProblemFile;
use graintrain_ccp::SolverSpec;
use graintrain_ccp::solver::METHODS;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Short solves are repeated this often, the fastest counts ...
const REPEAT: usize = 20;
/// ... within this time.
const SHORT: Duration = Duration::from_millis(200);

/// Compare solvers on contact problems
///
/// Every solver starts from zero impulses on every problem. Its answer is evaluated by code that no solver shares; a
/// solver counts as converged only where that evaluation agrees. With `--threads 1` times are processor times. Solves
/// of milliseconds are repeated and the fastest counts.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
    graintrain compare sed729.dat KaplasTower.dat --solvers apgd,pgs,ipm --tolerance 1e-6\n  \
    graintrain compare fclib/*.hdf5 --solvers all --max-seconds 10 --profile profile.svg\n  \
    graintrain compare Capsules.hdf5 --solvers ipm --friction coulomb --json")]
pub struct Arguments {
    /// Files of contact problems
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
    // All input is checked before the first solve.
    let files = arguments
        .problem
        .iter()
        .map(|path| Ok((distinct_name(path, &arguments.problem), solving::read_problem(path)?)))
        .collect::<Result<Vec<_>, Failure>>()?;
    let stop = Stop::listen()?;
    let mut records: Vec<Record> = Vec::new();
    for (name, file) in &files {
        if stop.exit_code().is_some() {
            break;
        }
        let of_problem =
            with_threads(arguments.options.threads, || solve_all(arguments, &specs, name, file, &stop))?;
        if !arguments.options.json {
            print_problem(name, file, &of_problem);
        }
        records.extend(of_problem);
    }
    if arguments.options.json {
        println!("{}", serde_json::to_string_pretty(&records).unwrap_or_default());
    } else if files.len() > 1 {
        print_summary(&records);
    }
    if let Some(path) = &arguments.profile {
        std::fs::write(path, profile::svg(&records)).map_err(|error| {
            let what = std::io::Error::new(error.kind(), format!("{}: {error}", path.display()));
            Failure::input_error(what, "--profile needs a file that can be written")
        })?;
    }
    if let Some(code) = stop.exit_code() {
        return Ok(code);
    }
    let missed = arguments.options.strict && records.iter().any(|record| !record.converged);
    Ok(if missed { ExitCode::from(1) } else { ExitCode::SUCCESS })
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
            if name == "all" { METHODS.iter().map(|method| method.name).collect() } else { vec![name] };
        for name in expanded {
            let spec = solving::solver_spec(name)?;
            if !specs.contains(&spec) {
                specs.push(spec);
            }
        }
    }
    Ok(specs)
}

/// Every solver on one problem.
fn solve_all(
    arguments: &Arguments,
    specs: &[SolverSpec],
    name: &str,
    file: &ProblemFile,
    stop: &Stop,
) -> Vec<Record> {
    let options = &arguments.options;
    let yardstick = Yardstick::new(&file.problem);
    let spinner = solving::spinner();
    let mut records = Vec::new();
    for spec in specs {
        spinner.set_message(format!("{name}: {spec}"));
        let mut best: Option<Record> = None;
        let start = Instant::now();
        for _ in 0..REPEAT {
            let record = match solving::run(name, file, &yardstick, spec, options, stop) {
                Ok(outcome) => outcome.record,
                Err(error) => solving::refused(name, file, spec, options, &error),
            };
            if best.as_ref().is_none_or(|best| record.cost() < best.cost()) {
                best = Some(record);
            }
            if start.elapsed() > SHORT || stop.exit_code().is_some() {
                break;
            }
        }
        records.extend(best.map(|record| Record { solver: spec.to_string(), ..record }));
    }
    spinner.finish_and_clear();
    records
}

/// The table of one problem; the fastest solver that converged is starred.
fn print_problem(name: &str, file: &ProblemFile, records: &[Record]) {
    println!("{name}\n  {}", solving::describe(file));
    for note in file.notes() {
        println!("  note: {note}");
    }
    let fastest = records.iter().filter(|record| record.converged).map(Record::cost).reduce(f64::min);
    let width = records.iter().map(|record| record.solver.len()).max().unwrap_or(0).max(6);
    println!(
        "  {:<width$}  {:<15} {:>10} {:>8} {:>11}  {:>8}  {:>8}  {:>19}",
        "solver", "status", "iterations", "linear", "time", "relaxed", "Coulomb", "objective, J"
    );
    for record in records {
        let star = if record.converged && Some(record.cost()) == fastest { "*" } else { " " };
        if record.status.is_none() {
            println!(
                "  {:<width$}  {}",
                record.solver,
                record.remark.as_deref().unwrap_or("cannot treat this problem")
            );
            continue;
        }
        let verdict = record.verdict();
        println!(
            "  {:<width$}  {verdict:<15} {:>10} {:>8} {:>11}{star} {:>8.1e}  {:>8.1e}  {:>19.12e}",
            record.solver,
            record.iterations,
            record.linear_iterations,
            solving::seconds_text(record.cost()),
            record.residual_relaxed,
            record.residual_coulomb,
            record.objective,
        );
    }
    println!();
}

/// How often each solver converged, and how its time compares with the fastest.
fn print_summary(records: &[Record]) {
    let summary = profile::summary(records);
    let width = summary.iter().map(|line| line.solver.len()).max().unwrap_or(0).max(6);
    println!("{:<width$}  {:>9}  {:>7}  time over the fastest", "solver", "converged", "fastest");
    println!("{:<width$}  {:>9}  {:>7}  (geometric mean where converged)", "", "", "");
    for line in summary {
        let ratio = line.mean_ratio.map_or("-".to_string(), |ratio| format!("{ratio:.2}"));
        println!(
            "{:<width$}  {:>9}  {:>7}  {ratio}",
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
