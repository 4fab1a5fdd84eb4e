//! `graintrain solve`: one problem, one solver.

use crate::error::Failure;
use crate::evaluation::Yardstick;
use crate::signal::Stop;
use crate::solving::{self, Options, Outcome};
use crate::terminal::{answer, tell};
use crate::threads::with_threads;
use graintrain_ccp::CcpError;
use graintrain_io::problem_file::ProblemFile;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Solve one contact problem from a file
///
/// PROBLEM is an FCLIB file (.hdf5), a Siconos text problem (.dat), or a dump of
/// `graintrain run --dump-problem`. The answer is measured by an independent evaluation of its residual, both
/// as the relaxed problem and with exact Coulomb friction.
#[derive(clap::Args)]
#[command(after_help = "Examples, on the problem of a run:\n  \
    graintrain run stack --steps 30 --dump-problem every=10 --out demo\n  \
    graintrain solve demo/problems/step_00000030.hdf5\n  \
    graintrain solve demo/problems/step_00000030.hdf5 --solver ipm --solution answer.csv\n  \
    graintrain solve demo/problems/step_00000030.hdf5 --friction coulomb --tolerance 1e-6 --json")]
pub struct Arguments {
    /// File of the contact problem
    problem: PathBuf,
    /// Solver by name; see `graintrain solvers`
    #[arg(long, value_name = "NAME", default_value = "auto")]
    solver: String,
    /// Write impulses and velocities per contact, in the order and frame of the file
    #[arg(long, value_name = "FILE.csv")]
    solution: Option<PathBuf>,
    #[command(flatten)]
    options: Options,
}

/// What to do about a solution file that cannot be written.
const WRITABLE: &str = "--solution needs a file that can be written";
/// A converged answer whose objective may be off by more than this is worth a note.
const LOOSE: f64 = 1e-3;

/// Solves and prints.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let spec = solving::solver_spec(&arguments.solver)?;
    let file = solving::read_problem(&arguments.problem)?;
    let name = solving::problem_name(&arguments.problem);
    if let Some(path) = &arguments.solution {
        solving::check_writable(path, WRITABLE)?;
    }
    let stop = Stop::listen()?;
    let spinner = solving::spinner();
    spinner.set_message(format!("{spec} on {name}, {}", solving::describe(&file)));
    let outcome = with_threads(arguments.options.threads, || {
        let yardstick = Yardstick::new(file.posed(arguments.options.friction));
        solving::run(&name, &file, &yardstick, &spec, &arguments.options, &stop)
    })?
    .map_err(|error: CcpError| Failure::input_error(error, "choose another --solver"));
    spinner.finish_and_clear();
    let outcome = outcome?;
    if let Some(path) = &arguments.solution {
        write_solution(path, &file, &outcome).map_err(|error| solving::unwritable(path, &error, WRITABLE))?;
    }
    if arguments.options.json {
        let text = serde_json::to_string_pretty(&outcome.record).unwrap_or_default();
        answer(text + "\n")?;
    } else {
        answer(table(&file, &outcome))?;
    }
    for note in &outcome.record.notes {
        tell!("note: {note}");
    }
    if let Some(code) = stop.exit_code() {
        return Ok(code);
    }
    let unconverged = arguments.options.strict && !outcome.record.converged;
    Ok(if unconverged { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// The answer for people.
fn table(file: &ProblemFile, outcome: &Outcome) -> String {
    let (record, evaluation) = (&outcome.record, &outcome.evaluation);
    let mut text = String::new();
    let mut line = |label: &str, value: String| {
        let _ = writeln!(text, "  {label:<20}{value}");
    };
    line("problem", solving::describe(file));
    if !file.title.is_empty() {
        line("title", file.title.clone());
    }
    let linear = match record.linear_iterations {
        0 => String::new(),
        count => format!(", {count} of the linear solver"),
    };
    line("solver", format!("{}, {} iterations{linear}", record.solver, record.iterations));
    let verdict = record.verdict();
    line("status", format!("{verdict} in {}", solving::seconds_text(record.seconds)));
    let asked = |model| {
        if record.friction == model { format!("   asked {:e}", record.tolerance) } else { String::new() }
    };
    use graintrain_ccp::FrictionModel::{Coulomb, Relaxed};
    line("residual, relaxed", format!("{:.2e}{}", record.residual_relaxed, asked(Relaxed)));
    line("residual, Coulomb", format!("{:.2e}{}", record.residual_coulomb, asked(Coulomb)));
    // Most digits of an objective are of no interest where the impulses are that far from a solution.
    let gap = record.gap.map_or(String::new(), |gap| format!("   gap {gap:.1e} of it"));
    line("objective", format!("{:.12e} J{gap}", record.objective));
    if record.converged && record.gap.is_some_and(|gap| gap > LOOSE) {
        line("note", "the objective is known to few digits: ask for a smaller --tolerance".to_string());
    }
    line(
        "contacts",
        format!(
            "{} sticking, {} sliding, {} apart",
            evaluation.sticking, evaluation.sliding, evaluation.apart
        ),
    );
    if let Some(remark) = &record.remark {
        line("remark", remark.clone());
    }
    format!("{}\n{text}", record.problem)
}

/// Writes impulses and velocities as CSV, and where contacts have rolling friction the moments and turning
/// velocities in the units of the file; numbers round-trip.
fn write_solution(path: &Path, file: &ProblemFile, outcome: &Outcome) -> std::io::Result<()> {
    let mut text = String::from("contact,impulse_n,impulse_t1,impulse_t2,velocity_n,velocity_t1,velocity_t2");
    let contacts = file.problem.num_contacts();
    if !file.turning_length.is_empty() {
        text += ",moment_t1,moment_t2,turning_t1,turning_t2";
    }
    text += "\n";
    let rows = outcome.impulse.chunks_exact(3).zip(outcome.evaluation.velocity.chunks_exact(3));
    for (contact, (g, u)) in rows.enumerate().take(contacts) {
        let _ = write!(text, "{contact},{:e},{:e},{:e},{:e},{:e},{:e}", g[0], g[1], g[2], u[0], u[1], u[2]);
        if let Some(length) = file.turning_length.get(contact) {
            let first = 3 * (contacts + contact);
            let [h, w] =
                [&outcome.impulse, &outcome.evaluation.velocity].map(|all| [all[first + 1], all[first + 2]]);
            let _ = write!(
                text,
                ",{:e},{:e},{:e},{:e}",
                length * h[0],
                length * h[1],
                w[0] / length,
                w[1] / length
            );
        }
        text.push('\n');
    }
    std::fs::write(path, text)
}
