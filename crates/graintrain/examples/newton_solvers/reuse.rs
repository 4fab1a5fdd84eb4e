//! Precomputation with and without what earlier steps left.

use crate::Failure;
use crate::solve::{Measured, clock, settings};
use graintrain::ccp::SolverSpec;
use graintrain::reproduce::solves::Problems;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Sums over the steps of one way to go.
#[derive(Default)]
struct Sum {
    first: f64,
    precompute: f64,
    apply: f64,
    outer: usize,
    inner: usize,
    error: f64,
    unconverged: usize,
    contacts: usize,
}

/// Solves the steps after a run's last checkpoint and prints sums.
pub fn reuse(solvers: &[&str], steps: usize, run: &Path, limit: f64) -> Result<(), Failure> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    println!(
        "| solver | steps | contacts | re-use | first precompute, s/step | precompute, s/step | solve, s/step | outer/step | inner/outer | compression error | not converged |\n\
         |---|---|---|---|---|---|---|---|---|---|---|"
    );
    pool.install(|| {
        for solver in solvers {
            let spec: SolverSpec = solver.parse()?;
            let mut problems = Problems::open(run, &Arc::new(AtomicBool::new(false)))?;
            let mut keeping = spec.build()?;
            let mut sums = [Sum::default(), Sum::default()];
            let mut done = 0;
            for _ in 0..steps {
                let Some((_, problem)) = problems.advance()? else { continue };
                done += 1;
                let mut fresh = spec.build()?;
                for (sum, method) in sums.iter_mut().zip([&mut keeping, &mut fresh]) {
                    let mut impulse = vec![0.0; 3 * problem.num_contacts()];
                    let start = Instant::now();
                    let begun = clock(start);
                    let report = method.solve(&problem, &mut impulse, &settings(limit))?;
                    let seconds = clock(start) - begun;
                    let m = Measured::new("", problem.num_contacts(), &report, seconds, 0.0);
                    let first = report.newton.first().map_or(0.0, |record| record.precompute_seconds);
                    sum.first += first * seconds / report.seconds.max(1e-9);
                    sum.precompute += m.precompute;
                    sum.apply += m.apply;
                    sum.outer += m.iterations;
                    sum.inner += m.inner;
                    sum.error += m.figures.get("compression_error").copied().unwrap_or(f64::NAN);
                    sum.unconverged += usize::from(!m.converged());
                    sum.contacts += m.contacts;
                }
            }
            let count = f64::from(u32::try_from(done.max(1))?);
            for (name, sum) in ["yes", "no"].iter().zip(&sums) {
                println!(
                    "| `{solver}` | {done} | {:.0} | {name} | {:.3} | {:.3} | {:.3} | {:.1} | {:.1} | {:.3} | {} |",
                    sum.contacts as f64 / count,
                    sum.first / count,
                    sum.precompute / count,
                    sum.apply / count,
                    sum.outer as f64 / count,
                    sum.inner as f64 / (sum.outer as f64).max(1.0),
                    sum.error / count,
                    sum.unconverged
                );
            }
        }
        Ok(())
    })
}
