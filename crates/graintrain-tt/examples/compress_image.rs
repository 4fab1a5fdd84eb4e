//! An image of 512 x 512 points as a quantized train, digits of both directions side by side: how much of it
//! which rank keeps, beside an SVD of the image as a matrix with as many numbers.
//!
//! `cargo run --release -p graintrain-tt --example compress_image`

use graintrain_tt::qtt;
use graintrain_tt::{Truncation, TtError, TtVector};

const LEVELS: usize = 9;

/// Rings, an edge, a disc and a texture of stripes.
fn brightness(i: usize, j: usize) -> f64 {
    let (x, y) = (i as f64 / 512.0 - 0.5, j as f64 / 512.0 - 0.5);
    let rings = 0.3 * (60.0 * (x * x + y * y)).cos();
    let disc = f64::from(((x + 0.2).powi(2) + (y - 0.1).powi(2)).sqrt() < 0.15);
    let stripes = if x > 0.2 { 0.2 * (200.0 * y + 40.0 * x).sin() } else { 0.0 };
    0.5 + rings + 0.4 * disc + stripes
}

fn main() -> Result<(), TtError> {
    // Place in Morton order: bit k of i, bit k of j, from the finest on.
    let mut morton = vec![0.0; 1 << (2 * LEVELS)];
    for j in 0..512 {
        for i in 0..512 {
            let place = qtt::morton(&[i, j], LEVELS).unwrap_or(0);
            morton[place] = brightness(i, j);
        }
    }
    // The two digits of a level as one mode of four.
    let modes = vec![4; LEVELS];
    let plain: Vec<f64> = (0..1 << (2 * LEVELS)).map(|e| brightness(e % 512, e / 512)).collect();
    println!("rank    numbers   of all   error, train   error, SVD of the same size");
    let mut before = f64::INFINITY;
    for rank in [8, 16, 32, 64, 128] {
        let (train, report) = TtVector::from_full(&morton, &modes, &Truncation::capped(0.0, rank))?;
        let numbers = train.num_parameters();
        // A matrix of rank r has r (512 + 512) numbers: a train of two modes.
        let (_, svd) =
            TtVector::from_full(&plain, &[512, 512], &Truncation::capped(0.0, (numbers / 1024).max(1)))?;
        println!(
            "{rank:4} {numbers:10} {:7.1} % {:14.4} {:14.4}",
            100.0 * numbers as f64 / plain.len() as f64,
            report.error,
            svd.error
        );
        // What is reported is what is lost.
        let truth: f64 = train.to_full()?.iter().zip(&morton).map(|(a, b)| (a - b).powi(2)).sum();
        let size: f64 = morton.iter().map(|x| x * x).sum();
        assert!(((truth / size).sqrt() - report.error).abs() < 1e-10 && report.error < before);
        before = report.error;
    }
    assert!(before < 0.02, "{before}");
    Ok(())
}
