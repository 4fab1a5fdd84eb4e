//! Every solver on every problem as a Markdown table, and exponents of growth.

use crate::Failure;
use crate::solve::{Measured, measure};

/// Figures of linear solvers that get a column's worth of words.
const REMARKS: [(&str, &str); 6] = [
    ("train_captured_energy", "captured"),
    ("train_active", "active"),
    ("rank_matrix", "rank"),
    ("rank_inverse", "rank of inverse"),
    ("compression_error", "error"),
    ("condition_preconditioned", "condition"),
];

/// Prints rows as they come, then the exponents.
pub fn table(solvers: &[&str], problems: &[&str], limit: f64) -> Result<(), Failure> {
    println!(
        "| problem | contacts | solver | status | outer | inner | precompute, s | solve, s | total, s | memory, MiB | residual | condition of S~ | remarks |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|"
    );
    let mut all = Vec::new();
    for problem in problems {
        for solver in solvers {
            let measured = measure(problem, solver, limit)?;
            println!("{}", row(&measured));
            all.push(measured);
        }
    }
    println!("\nExponents p of seconds ~ contacts^p, least squares (problems with converged solves only):\n");
    println!(
        "| solver | precompute per outer iteration | solve per outer iteration | total |\n|---|---|---|---|"
    );
    for solver in solvers {
        let of_solver: Vec<&Measured> =
            all.iter().filter(|m| m.solver == *solver && m.converged() && m.iterations > 0).collect();
        let fit = |value: &dyn Fn(&Measured) -> f64| {
            let points: Vec<[f64; 2]> = of_solver.iter().map(|m| [m.contacts as f64, value(m)]).collect();
            exponent(&points).map_or("-".to_string(), |p| format!("{p:.2}"))
        };
        println!(
            "| `{solver}` | {} | {} | {} |",
            fit(&|m| m.precompute / m.iterations as f64),
            fit(&|m| m.apply / m.iterations as f64),
            fit(&|m| m.seconds)
        );
    }
    Ok(())
}

fn row(m: &Measured) -> String {
    let remarks: Vec<String> = REMARKS
        .iter()
        .filter_map(|(key, word)| m.figures.get(*key).map(|value| format!("{word} {}", short(*value))))
        .collect();
    let status = m.status.map_or("killed".to_string(), |status| format!("{status:?}").to_lowercase());
    format!(
        "| {} | {} | `{}` | {status} | {} | {} | {} | {} | {} | {:.0} | {:.1e} | {:.0e} | {} |",
        m.problem.rsplit('/').next().unwrap_or_default(),
        m.contacts,
        m.solver,
        m.iterations,
        m.inner,
        short(m.precompute),
        short(m.apply),
        short(m.seconds),
        m.memory,
        m.residual,
        m.condition,
        remarks.join(", ")
    )
}

/// Three significant digits.
pub fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 8) as usize;
    if value.abs() < 1e-3 { format!("{value:.1e}") } else { format!("{value:.digits$}") }
}

/// Slope of log y over log x; `None` for fewer than three points.
pub fn exponent(points: &[[f64; 2]]) -> Option<f64> {
    let logs: Vec<[f64; 2]> = points.iter().filter(|p| p[1] > 0.0).map(|p| [p[0].ln(), p[1].ln()]).collect();
    if logs.len() < 3 {
        return None;
    }
    let count = logs.len() as f64;
    let mean = [0, 1].map(|k| logs.iter().map(|p| p[k]).sum::<f64>() / count);
    let covariance: f64 = logs.iter().map(|p| (p[0] - mean[0]) * (p[1] - mean[1])).sum();
    let variance: f64 = logs.iter().map(|p| (p[0] - mean[0]).powi(2)).sum();
    (variance > 0.0).then(|| covariance / variance)
}
