//! A TT-matrix times full vectors: a convolution with 1 / (1 + |i - j|) on 2^18 points, as a train of small
//! rank, against sums over all points.
//!
//! `cargo run --release -p graintrain-tt --example full_vector`

use graintrain_tt::apply::{ApplyWork, FullOperator};
use graintrain_tt::cross::{CrossSettings, Function, cross};
use graintrain_tt::{TtError, TtMatrix};
use std::time::Instant;

fn main() -> Result<(), TtError> {
    let digits = 18;
    let n = 1usize << digits;
    let kernel = |i: usize, j: usize| 1.0 / (1.0 + i.abs_diff(j) as f64);
    // Mode k of the matrix is the pair i_k + 2 j_k of binary digits.
    let source = Function::new(&vec![4; digits], move |pairs| {
        let bits = |bit: &dyn Fn(usize) -> usize| pairs.iter().enumerate().map(|(k, &b)| bit(b) << k).sum();
        kernel(bits(&|b| b % 2), bits(&|b| b / 2))
    });
    let settings = CrossSettings { tolerance: 1e-7, ..Default::default() };
    // Most of the norm sits on the diagonals, where random points hardly fall: look there.
    let probes: Vec<usize> = (0..4000)
        .flat_map(|p| {
            let (i, offset) = (p * 7919 % n, p % 40);
            (0..digits).map(move |k| (i >> k & 1) + 2 * ((i + offset).min(n - 1) >> k & 1))
        })
        .collect();
    let (train, report) = cross(&source, None, &probes, &settings)?;
    println!(
        "{:?}: ranks {:?}, error {:.1e}",
        report.status,
        report.ranks,
        report.error().unwrap_or(f64::NAN)
    );
    let matrix = TtMatrix::from_vector(train, &vec![2; digits], &vec![2; digits])?;
    let operator = FullOperator::new(&matrix)?;
    let x: Vec<f64> = (0..n).map(|j| (1e-4 * j as f64).sin() + f64::from(j % 97 == 0)).collect();
    let (mut y, mut work) = (vec![0.0; n], ApplyWork::default());
    let start = Instant::now();
    operator.apply(&x, &mut y, &mut work)?;
    println!(
        "{n} unknowns: {:.1} ms, {:.2} Gflop",
        1e3 * start.elapsed().as_secs_f64(),
        1e-9 * operator.flops()
    );
    let (mut worst, mut size) = (0.0_f64, 0.0_f64);
    for i in (0..n).step_by(n / 50) {
        let exact: f64 = (0..n).map(|j| kernel(i, j) * x[j]).sum();
        worst = worst.max((exact - y[i]).abs());
        size = size.max(exact.abs());
    }
    println!("50 rows against plain sums: largest difference {:.1e} of {size:.2}", worst);
    // Four vectors at once.
    let several: Vec<f64> = (0..4).flat_map(|c| x.iter().map(move |x| f64::from(c) * x)).collect();
    let mut images = vec![0.0; 4 * n];
    operator.apply_many(&several, &mut images, &mut work)?;
    let twice = images[2 * n..3 * n].iter().zip(&y).map(|(a, b)| (a - 2.0 * b).abs()).fold(0.0, f64::max);
    println!("the third of four vectors, 2 x: differs by {twice:.1e}");
    Ok(())
}
