//! The ground state of the Heisenberg chain of 20 spins (a vector of 2^20 numbers), and what it says about
//! neighbours.
//!
//! `cargo run --release -p graintrain-tt --example spin_chain -- [spins]`

use graintrain_tt::extremes::Density;
use graintrain_tt::solve::{EigenSettings, lowest_eigenpairs};
use graintrain_tt::{TtError, TtMatrix};

/// sum_k S_k S_{k+1} over neighbours, from the products of spin matrices (2 S+ S- / 2 is real).
fn heisenberg(spins: usize) -> Result<TtMatrix, TtError> {
    let eye = vec![1.0, 0.0, 0.0, 1.0];
    let (up, down, z) = (vec![0.0, 0.0, 1.0, 0.0], vec![0.0, 1.0, 0.0, 0.0], vec![0.5, 0.0, 0.0, -0.5]);
    let mut total: Option<TtMatrix> = None;
    for k in 0..spins - 1 {
        for (weight, first, second) in [(0.5, &up, &down), (0.5, &down, &up), (1.0, &z, &z)] {
            let mut factors = vec![eye.clone(); spins];
            factors[k] = first.iter().map(|x| weight * x).collect();
            factors[k + 1].clone_from(second);
            let term = TtMatrix::rank_one(&factors, &vec![2; spins], &vec![2; spins])?;
            total = Some(match total {
                None => term,
                Some(sum) => (&sum + &term).without_dependent_ranks(),
            });
        }
    }
    total.ok_or(TtError::Setting { what: "spins", need: "at least 2", got: spins as f64 })
}

fn main() -> Result<(), TtError> {
    let spins = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(20);
    let h = heisenberg(spins)?;
    println!("operator: {h}");
    let settings = EigenSettings { tolerance: 1e-6, max_rank: 100, ..Default::default() };
    let pairs = lowest_eigenpairs(&h, 1, &settings)?;
    for pair in &pairs {
        println!(
            "energy {:.9}, an eigenvalue lies within {:.1e}; rank {}",
            pair.value,
            pair.residual,
            pair.vector.max_rank()
        );
    }
    assert!(pairs.iter().all(|pair| pair.converged));
    if spins == 20 {
        // Exact diagonalisation.
        assert!((pairs[0].value + 8.682_473_334).abs() < 1e-6, "{}", pairs[0].value);
    }
    // Measured configurations: neighbours point in opposite directions more often than not, and no spin has a
    // direction of its own.
    let samples = pairs[0].vector.sample(Density::Squares, 4000, 1)?;
    let opposite =
        samples.chunks_exact(spins).flat_map(|s| s.windows(2)).filter(|pair| pair[0] != pair[1]).count();
    let share = opposite as f64 / (4000 * (spins - 1)) as f64;
    println!("neighbours are opposite in {:.1} % of the samples", 100.0 * share);
    // The energy of a bond is 3 <S_z S_z> = 3 (1/4 - share / 2).
    let expected = 0.5 - 2.0 / 3.0 * pairs[0].value / (spins - 1) as f64;
    assert!((share - expected).abs() < 0.01, "{share} {expected}");
    Ok(())
}
