//! Measures the linear solvers of the interior points on contact problems: outer and inner iterations, seconds of
//! precomputation and of solving, peak memory, residual; how they grow with the number of contacts; what re-use between
//! time steps saves; and where tensor trains pay. Every solve is a process of its own on one thread, killed after a time.
//!
//! ```text
//! cargo run --release -p graintrain --example newton_solvers -- table SECONDS SOLVERS PROBLEM...
//! cargo run --release -p graintrain --example newton_solvers -- table 600 pdip+ilu,pdip+tt,ipm step.hdf5 cubic:8000
//! cargo run --release -p graintrain --example newton_solvers -- reuse SECONDS SOLVERS STEPS RUN
//! cargo run --release -p graintrain --example newton_solvers -- map SECONDS FILE.svg
//! ```
//!
//! PROBLEM is a file (`graintrain run --dump-problem`) or ASSEMBLY:BODIES[:DISORDER[:SEED]], ASSEMBLY one of `cubic`,
//! `close-packed`, `brick-wall`, `blocks` (see `assemblies.rs`). RUN is the folder of a run with a checkpoint: the STEPS
//! steps after it are solved, with one solver that keeps what it learned and with a new one each time.
//!
//! Seconds are processor time. Those of precomputation and linear solves are wall-clock times multiplied by the whole
//! solve's ratio of the two, so that other programs on the machine do not matter.

mod assemblies;
mod map;
mod reuse;
mod solve;
mod table;

/// Any error, for the terminal.
type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["one", seconds, solver, problem] => solve::child(problem, solver, seconds.parse()?),
        ["table", seconds, solvers, problems @ ..] if !problems.is_empty() => {
            let solvers: Vec<&str> = solvers.split(',').collect();
            table::table(&solvers, problems, seconds.parse()?)
        }
        ["reuse", seconds, solvers, steps, run] => {
            let solvers: Vec<&str> = solvers.split(',').collect();
            reuse::reuse(&solvers, steps.parse()?, run.as_ref(), seconds.parse()?)
        }
        ["map", seconds, file] => map::map(file.as_ref(), seconds.parse()?),
        _ => Err("see the head of examples/newton_solvers/main.rs for how to call it".into()),
    }
}
