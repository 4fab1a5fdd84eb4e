//! Probability in a potential: p' = div(grad p + p x) in the plane on 2^20 points, by implicit midpoint steps
//! whose systems are solved in the format.
//!
//! A Gaussian stays one: mean m e^-t, variance 1 + (s - 1) e^-2t. The run is held against it; its mass must
//! stay.
//!
//! `cargo run --release -p graintrain-tt --example fokker_planck`

use graintrain_tt::qtt::{self, DigitOrder};
use graintrain_tt::solve::{SolveSettings, SolveStatus, solve};
use graintrain_tt::{Truncation, TtError, TtMatrix, TtVector};

/// Digits per direction and half the length of the box.
const DIGITS: usize = 10;
const HALF: f64 = 8.0;
/// Time steps to time 1.
const STEPS: usize = 40;

fn main() -> Result<(), TtError> {
    let n = f64::from(1u32 << DIGITS);
    let h = 2.0 * HALF / n;
    let place = |j: f64| -HALF + h * (j + 0.5);
    // d/dx (dp/dx + x p) by central differences of the fluxes; beyond the box there is nothing.
    let modes = [2; DIGITS];
    let x = qtt::ramp(DIGITS, place(0.0), h)?;
    let second = qtt::laplacian(DIGITS)?.scale(-1.0 / (h * h));
    let shift = qtt::shift(DIGITS)?;
    let first = (&shift.transpose() - &shift).scale(0.5 / h);
    let line = (&second + &(&first * &TtMatrix::from_diagonal(&x))).round(&Truncation::to(1e-14))?.0;
    let a = qtt::kronecker_sum(&[line.clone(), line], DigitOrder::Separated)?;
    println!("operator: {a}");

    let gauss = |mean: f64, variance: f64| -> Result<TtVector, TtError> {
        let entry = |j: usize| {
            (-(place(j as f64) - mean).powi(2) / (2.0 * variance)).exp()
                / (std::f64::consts::TAU * variance).sqrt()
        };
        let full: Vec<f64> = (0..1 << DIGITS).map(entry).collect();
        Ok(TtVector::from_full(&full, &modes, &Truncation::to(1e-12))?.0)
    };
    let mut p = gauss(2.0, 0.3)?.kronecker(&gauss(-1.0, 2.0)?);
    let mass = p.sum() * h * h;

    let step = 1.0 / STEPS as f64;
    let eye = TtMatrix::identity(&[2; 2 * DIGITS])?;
    let (implicit, explicit) = (&eye - &(0.5 * step * &a), &eye + &(0.5 * step * &a));
    let settings = SolveSettings { tolerance: 1e-7, ..Default::default() };
    for _ in 0..STEPS {
        let right = explicit.times_vector_rounded(&p, &Truncation::to(1e-9))?.0;
        let (next, report) = solve(&implicit, &right, Some(&p), &settings)?;
        assert_eq!(report.status, SolveStatus::Converged, "{report:?}");
        p = next;
    }
    let (decay, square) = ((-1.0f64).exp(), (-2.0f64).exp());
    let exact = gauss(2.0 * decay, 1.0 - 0.7 * square)?.kronecker(&gauss(-decay, 1.0 + square)?);
    let error = p.measured_distance(&exact)?;
    println!("after {STEPS} steps: {p}");
    println!(
        "distance to the exact density {:.1e}, change of mass {:.1e}",
        error.value,
        p.sum() * h * h / mass - 1.0
    );
    assert!(error.value < 1e-3 && (p.sum() * h * h / mass - 1.0).abs() < 1e-5);
    // No entry may be far below zero, and the largest one is where the mean is.
    let extremes = p.extremes(20_000)?;
    println!("entries from {:.1e} to {:.4}", extremes.smallest.value, extremes.largest.value);
    assert!(extremes.smallest.value > -1e-5);
    Ok(())
}
