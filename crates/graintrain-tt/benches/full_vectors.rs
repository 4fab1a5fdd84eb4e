//! TT-SVD of full vectors beside the copy of the same vector and the dense product: `cargo bench -p graintrain-tt --bench full_vectors`;
//! RAYON_NUM_THREADS chooses the threads, an argument the largest power of two (24 by default; 27 takes 2 GiB).
//!
//! Wall times, best of three. "Share" is the time of a copy over that of the TT-SVD.

use graintrain_linalg::dense::{Matrix, multiply};
use graintrain_tt::{Truncation, TtVector};
use std::hint::black_box;
use std::time::Instant;

/// The fastest of three runs, in seconds.
fn best<T>(mut run: impl FnMut() -> T) -> f64 {
    let once = |_| {
        let start = Instant::now();
        black_box(run());
        start.elapsed().as_secs_f64()
    };
    (0..3).map(once).fold(f64::INFINITY, f64::min)
}

/// 2^d numbers of ranks up to `rank` with a part of size 1e-9 of full rank.
fn numbers(d: usize, rank: usize) -> Vec<f64> {
    let train = TtVector::random(&vec![2; d], rank, 1).expect("sizes fit");
    let scale = (d as f64 / 2.0).exp2() / train.norm();
    let mut full = train.scale(scale).to_full().expect("fits");
    let mut state = 1u64;
    for x in &mut full {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        *x += 1e-9 * ((state >> 11) as f64 / (1u64 << 52) as f64 - 1.0);
    }
    full
}

fn main() {
    let most: usize = std::env::args().skip(1).find_map(|x| x.parse().ok()).unwrap_or(24);
    let x = Matrix::from_fn(1024, 1024, |i, j| (i + 2 * j) as f64 * 1e-3);
    let mut y = Matrix::zeros(1024, 1024);
    let dense = best(|| multiply(1.0, x.view(), x.view(), y.view_mut()));
    println!("threads {}, dgemm {:.1} GF/s on one", rayon::current_num_threads(), 2.0 * 1.073741824 / dense);
    println!(
        "{:>4} {:>5} {:>9} {:>10} {:>10} {:>7} {:>6} {:>9}",
        "2^d", "rank", "tolerance", "copy, ms", "time, ms", "share", "ranks", "error"
    );
    for d in [20, 24, 27].into_iter().filter(|&d| d <= most) {
        for rank in [2, 8, 16, 32, 48] {
            let full = numbers(d, rank);
            let mut copy = vec![0.0; full.len()];
            let copied = best(|| copy.copy_from_slice(&full));
            drop(copy);
            for tolerance in [1e-3, 1e-6, 1e-8] {
                let mut found = None;
                let seconds =
                    best(|| found = TtVector::from_full(&full, &vec![2; d], &Truncation::to(tolerance)).ok());
                let (train, report) = found.expect("finite");
                println!(
                    "{d:>4} {rank:>5} {tolerance:>9.0e} {:>10.2} {:>10.2} {:>6.0}% {:>6} {:>9.1e}",
                    copied * 1e3,
                    seconds * 1e3,
                    100.0 * copied / seconds,
                    train.max_rank(),
                    report.error
                );
            }
        }
    }
}
