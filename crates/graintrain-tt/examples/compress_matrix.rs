//! A compressed matrix: a sparse matrix of 3072 unknowns as a tensor train, with the error over all of its
//! entries.
//!
//! `cargo run --release -p graintrain-tt --example compress_matrix`

use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Truncation, TtError};

fn main() -> Result<(), TtError> {
    let (levels, leaf) = (10, 3);
    let n: usize = leaf << levels;
    // A ring of cells, each coupled to its neighbours: the same everywhere, so that the ranks are small.
    let entries = (0..n).flat_map(|i| [(i, i, 2.1), (i, (i + 1) % n, -1.0), ((i + 1) % n, i, -1.0)]);
    let matrix = QuadtreeMatrix::from_entries(leaf, levels, entries)?;
    println!("{n} x {n}, {} nonzeros", matrix.num_entries());
    for truncation in [Truncation::to(1e-10), Truncation::capped(1e-10, 2)] {
        let (train, report) = matrix.to_train(&truncation)?;
        let (numbers, rank) = (train.as_vector().num_parameters(), train.as_vector().max_rank());
        println!("{numbers} numbers, largest rank {rank}, relative error {:.1e}", report.error);
    }
    Ok(())
}
