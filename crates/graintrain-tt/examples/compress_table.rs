//! TT-SVD of a table: a function on 2^20 points, or on a grid of 64^3 points, compressed to several
//! tolerances. The printed error is the error itself: the report's is checked against the full table.
//!
//! `cargo run --release -p graintrain-tt --example compress_table`

use graintrain_tt::{Truncation, TtError, TtVector};

/// Prints ranks and errors of the table with these modes.
fn compress(name: &str, table: &[f64], modes: &[usize]) -> Result<(), TtError> {
    println!("{name}: {} numbers", table.len());
    let size = table.iter().map(|x| x * x).sum::<f64>().sqrt();
    for tolerance in [1e-2, 1e-4, 1e-8] {
        let (train, report) = TtVector::from_full(table, modes, &Truncation::to(tolerance))?;
        let difference: f64 = train.to_full()?.iter().zip(table).map(|(a, b)| (a - b).powi(2)).sum();
        println!(
            "  tolerance {tolerance:.0e}: {:6} numbers, largest rank {:2}, error {:.3e} (reported {:.3e})",
            train.num_parameters(),
            train.max_rank(),
            difference.sqrt() / size,
            report.error
        );
    }
    Ok(())
}

fn main() -> Result<(), TtError> {
    // A line of 2^20 points in quantized form: 20 modes of size 2.
    let line: Vec<f64> = (0..1 << 20)
        .map(|j| {
            let x = f64::from(j) / f64::from(1 << 20);
            (40.0 * x).sin() * (-3.0 * x).exp() + 1.0 / (0.01 + x)
        })
        .collect();
    compress("a wave and a pole on a line", &line, &[2; 20])?;
    // A cube of 64^3 points, one mode per direction: first index fastest.
    let coordinate = |j: usize| (j as f64 + 0.5) / 64.0 - 0.5;
    let cube: Vec<f64> = (0..64usize.pow(3))
        .map(|j| {
            let [x, y, z] = [j % 64, j / 64 % 64, j / 4096].map(coordinate);
            1.0 / (0.01 + x * x + y * y + z * z).sqrt()
        })
        .collect();
    compress("a smoothed point charge in a cube", &cube, &[64; 3])
}
