//! -Laplace u = 1 on the unit cube with 2^10 (or as many as asked) interior points per direction: 2^30
//! unknowns, and the same number by a sum of sines.
//!
//! `cargo run --release -p graintrain-tt --example poisson -- [digits per direction]`

use graintrain_tt::qtt::{self, DigitOrder};
use graintrain_tt::solve::{SolveSettings, SolveStatus, solve};
use graintrain_tt::{TtError, TtVector};
use std::f64::consts::PI;

/// <u, f> of the discrete problem: sines diagonalise the Laplacian, and of f = 1 only the odd ones are there.
fn by_sines(points: usize) -> f64 {
    let n = points as f64 + 1.0;
    let odd = || (1..=points).step_by(2).map(|k| 0.5 * PI * k as f64 / n);
    let eigenvalues: Vec<f64> = odd().map(|angle| (2.0 * n * angle.sin()).powi(2)).collect();
    let weights: Vec<f64> = odd().map(|angle| 2.0 / n / angle.tan().powi(2)).collect();
    let mut total = 0.0;
    for (a, v) in eigenvalues.iter().zip(&weights) {
        for (b, w) in eigenvalues.iter().zip(&weights) {
            total += v * w * eigenvalues.iter().zip(&weights).map(|(c, x)| x / (a + b + c)).sum::<f64>();
        }
    }
    total
}

fn main() -> Result<(), TtError> {
    let digits = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(10);
    let points = 1usize << digits;
    let line = qtt::laplacian(digits)?.scale((points as f64 + 1.0).powi(2));
    let a = qtt::kronecker_sum(&[line.clone(), line.clone(), line], DigitOrder::Separated)?;
    let f = TtVector::constant(&vec![2; 3 * digits], 1.0)?;
    let settings = SolveSettings { tolerance: 1e-6, ..Default::default() };
    let (u, report) = solve(&a, &f, None, &settings)?;
    println!("{:e} unknowns, operator ranks {:?}", f.num_entries(), a.ranks());
    println!("{:?}, residual {:.2e}, {} sweeps", report.status, report.residual, report.sweeps);
    println!("solution: {} numbers, ranks {:?}", u.num_parameters(), report.ranks);
    let (found, exact) = (u.dot(&f)?, by_sines(points));
    println!("<u, f> = {found:.10e}, by sines {exact:.10e}");
    assert_eq!(report.status, SolveStatus::Converged);
    assert!((found / exact - 1.0).abs() < 1e-6);
    Ok(())
}
