//! What every linear solver needs for the same Newton systems, and how that grows with the number of
//! contacts.

use crate::Failure;
use crate::follow::{Life, Run, Sampling, Tally, lock};
use crate::solve::problem;
use crate::table::{exponent, short};
use std::collections::BTreeMap;

/// Follows `pdip+GUIDE` on every problem; prints what each linear solver needed per system, and exponents of
/// growth.
pub fn systems(
    guide: &str,
    others: &[&str],
    problems: &[&str],
    sampling: Sampling,
    limit: f64,
) -> Result<(), Failure> {
    println!(
        "| problem | contacts | solver | systems | first precompute, s | precompute, s per system | solved | unconverged | inner per solve | s per solve | worst residual | rank | rank of inverse | error | captured |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|"
    );
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let solvers: Vec<&str> = std::iter::once(guide).chain(others.iter().copied()).collect();
    // Seconds against contacts: precomputation for the first system, for later ones, solve.
    let mut points: BTreeMap<&str, [Vec<[f64; 2]>; 3]> = BTreeMap::new();
    for name in problems {
        let problem = problem(name)?;
        let contacts = problem.num_contacts();
        let lives: Vec<(&str, Life)> = others.iter().map(|name| (*name, Life::Problem)).collect();
        let mut run = Run::new(guide, &lives, sampling)?;
        let report = pool.install(|| run.solve(&problem, limit))?;
        eprintln!(
            "{name}: pdip+{guide} {:?} after {} iterations, residual {:.1e}",
            report.status, report.iterations, report.residual.max
        );
        for (solver, tally) in solvers.iter().zip(&run.tallies) {
            let tally = lock(tally);
            println!("{}", row(name, contacts, solver, &tally));
            let per_solve = (tally.solved > 0).then(|| tally.apply / tally.solved as f64);
            let first = (tally.systems > 0).then_some(tally.first);
            let values = [first, tally.later(), per_solve];
            for (list, value) in points.entry(*solver).or_default().iter_mut().zip(values) {
                list.extend(value.map(|value| [contacts as f64, value]));
            }
        }
    }
    println!("\nExponents p of seconds ~ contacts^p, least squares (number of sizes):\n");
    println!("| solver | first precompute | precompute | solve |\n|---|---|---|---|");
    for solver in &solvers {
        let fits: Vec<String> = points[solver]
            .iter()
            .map(|list| exponent(list).map_or("-".to_string(), |p| format!("{p:.2} ({})", list.len())))
            .collect();
        println!("| `{solver}` | {} |", fits.join(" | "));
    }
    Ok(())
}

fn row(problem: &str, contacts: usize, solver: &str, tally: &Tally) -> String {
    let problem = problem.rsplit('/').next().unwrap_or_default();
    let start = format!("| {problem} | {contacts} | `{solver}` | {}", tally.systems);
    if let (0, Some(failure)) = (tally.systems, &tally.failure) {
        return format!("{start} | {failure} |");
    }
    let per_solve =
        |sum: f64| if tally.solved > 0 { short(sum / tally.solved as f64) } else { "-".to_string() };
    format!(
        "{start} | {} | {} | {} | {} | {} | {} | {:.1e} | {} | {} | {} | {} |",
        short(tally.first),
        tally.later().map_or("-".to_string(), short),
        tally.solved,
        tally.unconverged,
        per_solve(tally.inner as f64),
        per_solve(tally.apply),
        tally.residual,
        tally.figure("rank_matrix"),
        tally.figure("rank_inverse"),
        tally.figure("compression_error"),
        tally.figure("train_captured_energy"),
    )
}
