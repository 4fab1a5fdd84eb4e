//! Measures the linear solvers of the interior points on contact problems: outer and inner iterations,
//! seconds of precomputation and of solving, peak memory, residual; how they grow with the number of
//! contacts; what re-use between time steps saves; and where tensor trains pay. Every solve is a process of
//! its own on one thread, killed after a time.
//!
//! ```text
//! cargo run --release -p graintrain-lab --example newton_solvers -- table SECONDS SOLVERS PROBLEM...
//! cargo run --release -p graintrain-lab --example newton_solvers -- table 600 pdip+ilu,pdip+tt,ipm step.hdf5 cubic:8000
//! cargo run --release -p graintrain-lab --example newton_solvers -- reuse SECONDS ITERATIONS SOLVE LINEAR STEPS RUN
//! cargo run --release -p graintrain-lab --example newton_solvers -- systems SECONDS EVERY ITERATIONS GUIDE LINEAR PROBLEM...
//! cargo run --release -p graintrain-lab --example newton_solvers -- growth SECONDS ITERATIONS GUIDE LINEAR PROBLEM...
//! cargo run --release -p graintrain-lab --example newton_solvers -- map SECONDS TABLE.md FILE.svg
//! cargo run --release -p graintrain-lab --example newton_solvers -- orders ITERATION,... PROBLEM
//! cargo run --release -p graintrain-lab --example newton_solvers -- factors ITERATION,... PROBLEM...
//! ```
//!
//! PROBLEM is a file (`graintrain run --dump-problem`) or ASSEMBLY:BODIES[:DISORDER[:SEED]], ASSEMBLY one of
//! `cubic`, `close-packed`, `brick-wall`, `blocks` (see `assemblies.rs`). RUN is the folder of a run with a
//! checkpoint: `reuse` takes the first ITERATIONS Newton systems of each of the STEPS steps after it and
//! prepares LINEAR for them keeping what it learned always, within a step, and never; every SOLVE-th of them
//! is solved as well (0: none).
//!
//! `systems` runs `pdip+GUIDE` and hands every EVERY-th of its Newton systems to the other linear solvers too
//! (`ilu,ic`, without `pdip+`): the same matrices and right-hand sides for all; `tt-any-size` is `tt` that
//! tries a train on small problems too. `growth` does so with every system, and they only prepare themselves.
//!
//! Seconds are processor time. Those of precomputation and linear solves are wall-clock times multiplied by
//! the whole solve's ratio of the two, so that other programs on the machine do not matter.

mod assemblies;
mod factors;
mod follow;
mod map;
mod orders;
mod reuse;
mod solve;
mod systems;
mod table;

use follow::Sampling;

/// Processor seconds of one preparation or solve after which `systems` gives a linear solver no further ones.
const PATIENCE: f64 = 120.0;

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
        ["systems", seconds, every, iterations, guide, linear, problems @ ..] if !problems.is_empty() => {
            let every = every.parse::<usize>()?.max(1);
            let sampling =
                Sampling { every, solve_every: 1, iterations: iterations.parse()?, patience: PATIENCE };
            let others: Vec<&str> = linear.split(',').collect();
            systems::systems(guide, &others, problems, sampling, seconds.parse()?)
        }
        ["growth", seconds, iterations, guide, linear, problems @ ..] if !problems.is_empty() => {
            let iterations = iterations.parse()?;
            let sampling = Sampling { every: 1, solve_every: 0, iterations, patience: f64::INFINITY };
            let others: Vec<&str> = linear.split(',').collect();
            systems::systems(guide, &others, problems, sampling, seconds.parse()?)
        }
        ["reuse", seconds, iterations, solve_every, linear, steps, run] => {
            let (iterations, solve_every) = (iterations.parse()?, solve_every.parse()?);
            let sampling = Sampling { every: 1, solve_every, iterations, patience: f64::INFINITY };
            reuse::reuse(linear, sampling, steps.parse()?, run.as_ref(), seconds.parse()?)
        }
        ["factors", iterations, problems @ ..] if !problems.is_empty() => {
            let iterations = iterations.split(',').map(str::parse).collect::<Result<Vec<usize>, _>>()?;
            factors::factors(&iterations, problems)
        }
        ["orders", iterations, problem] => {
            let iterations = iterations.split(',').map(str::parse).collect::<Result<Vec<usize>, _>>()?;
            orders::orders_of(problem, &iterations)
        }
        ["map", seconds, table, file] => map::map(table.as_ref(), file.as_ref(), seconds.parse()?),
        _ => Err("see the head of examples/newton_solvers/main.rs for how to call it".into()),
    }
}
