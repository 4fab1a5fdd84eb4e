//! Precomputation with and without what earlier steps and earlier Newton iterations left.

use crate::Failure;
use crate::follow::{Life, Run, Sampling, lock};
use graintrain_lab::reproduce::solves::Problems;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Interior points follow exact solves, so that every way to go meets the same systems.
const GUIDE: &str = "cholesky";

/// How long trains are kept, with a word for the table.
const LIVES: [(Life, &str); 3] =
    [(Life::Always, "steps and iterations"), (Life::Problem, "iterations"), (Life::System, "none")];

/// Follows the first Newton systems of the steps after a run's last checkpoint and prints means.
pub fn reuse(
    linear: &str,
    sampling: Sampling,
    steps: usize,
    run_folder: &Path,
    limit: f64,
) -> Result<(), Failure> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    println!(
        "| solver | re-use over | steps | contacts | systems | precompute of a step's first system, s | precompute, s per system | compression error | residual of the inversion | rank | rank of inverse | solved | unconverged | inner per solve |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|---|"
    );
    pool.install(|| {
        let mut problems = Problems::open(&run_folder.join("checkpoints"), &Arc::new(AtomicBool::new(false)))?;
        let lives = LIVES.map(|(life, _)| (linear, life));
        let mut run = Run::new(GUIDE, &lives, sampling)?;
        let (mut done, mut contacts) = (0, 0);
        for _ in 0..steps {
            let Some((_, problem)) = problems.advance()? else { continue };
            run.solve(&problem, limit)?;
            done += 1;
            contacts += problem.num_contacts();
            eprintln!("step {done}");
        }
        for ((_, word), tally) in LIVES.iter().zip(&run.tallies[1..]) {
            let tally = lock(tally);
            println!(
                "| `{linear}` | {word} | {done} | {} | {} | {:.4} | {:.4} | {} | {} | {} | {} | {} | {} | {:.1} |",
                contacts / done.max(1),
                tally.systems,
                tally.first_of_problems / done.max(1) as f64,
                tally.precompute / tally.systems.max(1) as f64,
                tally.figure("compression_error"),
                tally.figure("inversion_residual"),
                tally.figure("rank_matrix"),
                tally.figure("rank_inverse"),
                tally.solved,
                tally.unconverged,
                tally.inner as f64 / tally.solved.max(1) as f64,
            );
        }
        Ok(())
    })
}
