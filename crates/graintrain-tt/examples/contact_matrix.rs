//! A sparse matrix three ways: exact pass, sketch and cross, with the error of each over ALL entries.
//!
//! The matrix is that of a chain of cells whose couplings are perturbed by `disorder`: 0 repeats under
//! translation (low rank), 1 does not (no low rank exists, and only methods that see every entry know it).
//!
//! `cargo run --release -p graintrain-tt --example contact_matrix -- [disorder]`

use graintrain_tt::cross::{CrossSettings, cross_sparse};
use graintrain_tt::sketch::Sketch;
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Truncation, TtError, TtMatrix};

fn main() -> Result<(), TtError> {
    let disorder: f64 = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(0.5);
    let levels = 10;
    let n = 3usize << levels;
    let coupling = |i: usize, k: usize| -1.0 + disorder * ((i * i + 17 * k) as f64).sin();
    let entries = (0..n).flat_map(|i| {
        let near = [1, 3, 96].map(move |step| (i, (i + step) % n, coupling(i, step)));
        near.into_iter().flat_map(|(i, j, x)| [(i, j, x), (j, i, x)]).chain([(i, i, 7.0)])
    });
    let matrix = QuadtreeMatrix::from_entries(3, levels, entries)?;
    println!("{n} unknowns, {} nonzeros, disorder {disorder}", matrix.num_entries());
    for rank in [10, 30] {
        let (train, report) = matrix.to_train(&Truncation::capped(1e-8, rank))?;
        println!("exact pass, rank {:3}: error {:.3e}", train.max_rank(), report.error);
        let paired: Vec<usize> = matrix.modes().iter().map(|n| n * n).collect();
        let mut sketch = Sketch::new(&paired, rank, 1)?;
        sketch.add_sparse(&matrix)?;
        let train = sketch.to_train(&Truncation::to(1e-10))?.0;
        let train = TtMatrix::from_vector(train, &matrix.modes(), &matrix.modes())?;
        println!("sketch,     rank {:3}: error {:.3e}", train.max_rank(), matrix.relative_error(&train)?);
        let settings = CrossSettings { tolerance: 1e-2, max_rank: rank, ..Default::default() };
        let (train, report) = cross_sparse(&matrix, None, 1, &settings)?;
        println!(
            "cross,      rank {:3}: error {:.3e}, its own estimate {:.3e}, {:?}",
            train.max_rank(),
            matrix.relative_error(&train)?,
            report.error().unwrap_or(f64::NAN),
            report.status
        );
    }
    Ok(())
}
