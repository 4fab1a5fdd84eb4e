//! -Laplace u = 1 on the unit cube with 2^7 (or as many as asked) interior points per direction: 2^21 unknowns.
//!
//! `cargo run --release -p graintrain-tt --example poisson -- [digits per direction]`

use graintrain_tt::qtt::{self, DigitOrder};
use graintrain_tt::solve::{SolveSettings, solve};
use graintrain_tt::{TtError, TtVector};

fn main() -> Result<(), TtError> {
    let digits = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(7);
    let points = f64::from(1u32 << digits);
    let line = qtt::laplacian(digits)?.scale((points + 1.0).powi(2));
    let a = qtt::kronecker_sum(&[line.clone(), line.clone(), line], DigitOrder::Separated)?;
    let f = TtVector::constant(&vec![2; 3 * digits], 1.0)?;
    let settings = SolveSettings { tolerance: 1e-6, ..Default::default() };
    let (u, report) = solve(&a, &f, None, &settings)?;
    println!("{} unknowns, operator ranks {:?}", f.num_entries(), a.ranks());
    println!("{:?}, residual {:.2e}, {} sweeps", report.status, report.residual, report.sweeps);
    println!("solution: {} numbers, ranks {:?}", u.num_parameters(), report.ranks);
    println!("<u, f> h^3 = {:.10}", u.dot(&f)? / points.powi(3));
    Ok(())
}
