//! TT-SVD of full vectors beside the copy of the same vector and the dense product:
//! `cargo bench -p graintrain-tt --bench full_vectors`; an argument is the largest power of two (24 by
//! default; 27 takes 2 GiB), a second one the number of runs of which the best counts (5).
//!
//! Wall times of one thread and of all (RAYON_NUM_THREADS), run in turns. "Share" is the time of a copy on
//! one thread over that of the TT-SVD on one. How much faster all threads copy and read the vector is what
//! they can gain where memory is the limit.

use graintrain_linalg::dense::{Matrix, multiply};
use graintrain_tt::{Truncation, TtVector};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::hint::black_box;
use std::time::Instant;

/// Numbers of a task of the parallel copy and read.
const TASK: usize = 1 << 16;

/// The fastest of several runs in every pool, in seconds, the pools in turns.
fn best<T: Send>(pools: &[ThreadPool], runs: usize, run: impl Fn() -> T + Sync) -> Vec<f64> {
    let mut least = vec![f64::INFINITY; pools.len()];
    for _ in 0..runs {
        for (least, pool) in least.iter_mut().zip(pools) {
            let start = Instant::now();
            black_box(pool.install(&run));
            *least = least.min(start.elapsed().as_secs_f64());
        }
    }
    least
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

/// Times of a copy and of a read (a sum in eight lanes) in every pool.
fn copy_and_read(full: &[f64], pools: &[ThreadPool], runs: usize) -> [Vec<f64>; 2] {
    let copy = std::sync::Mutex::new(vec![0.0; full.len()]);
    let copied = best(pools, runs, || {
        let mut copy = copy.lock().expect("no run panics");
        if rayon::current_num_threads() == 1 {
            copy.copy_from_slice(full);
        } else {
            let parts = full.len().div_ceil(rayon::current_num_threads());
            copy.par_chunks_mut(parts)
                .zip(full.par_chunks(parts))
                .for_each(|(to, from)| to.copy_from_slice(from));
        }
    });
    let sum = |part: &[f64]| {
        let mut lanes = [0.0; 8];
        part.chunks_exact(8).for_each(|x| (0..8).for_each(|k| lanes[k] += x[k]));
        lanes.iter().sum::<f64>()
    };
    [copied, best(pools, runs, || full.par_chunks(TASK).map(sum).sum::<f64>())]
}

fn main() {
    let mut numbers_asked = std::env::args().skip(1).filter_map(|x| x.parse::<usize>().ok());
    let (most, runs) = (numbers_asked.next().unwrap_or(24), numbers_asked.next().unwrap_or(5));
    let x = Matrix::from_fn(1024, 1024, |i, j| (i + 2 * j) as f64 * 1e-3);
    let threads = rayon::current_num_threads();
    let counts = if threads == 1 { vec![1] } else { vec![1, threads] };
    let pool = |&count: &usize| ThreadPoolBuilder::new().num_threads(count).build().expect("threads");
    let pools: Vec<ThreadPool> = counts.iter().map(pool).collect();
    let dense = best(&pools[..1], runs, || {
        let mut y = Matrix::zeros(1024, 1024);
        multiply(1.0, x.view(), x.view(), y.view_mut());
        y
    });
    println!(
        "dgemm {:.1} GF/s on one thread; \"by {threads}\": times as fast on {threads}",
        2.0 * 1.073741824 / dense[0]
    );
    println!(
        "{:>4} {:>5} {:>9} {:>9} {:>9} {:>7} {:>6} {:>5} {:>9} {:>5} {:>5}",
        "2^d", "rank", "tolerance", "copy, ms", "time, ms", "share", "by", "ranks", "error", "copy", "read"
    );
    for d in [20, 24, 27].into_iter().filter(|&d| d <= most) {
        for rank in [2, 8, 16, 32, 48] {
            let full = numbers(d, rank);
            let [copied, read] = copy_and_read(&full, &pools, runs);
            let gain = |times: &[f64]| times[0] / times[times.len() - 1];
            for tolerance in [1e-3, 1e-6, 1e-8] {
                let truncation = Truncation::to(tolerance);
                let took = best(&pools, runs, || TtVector::from_full(&full, &vec![2; d], &truncation));
                let (train, report) = TtVector::from_full(&full, &vec![2; d], &truncation).expect("finite");
                println!(
                    "{d:>4} {rank:>5} {tolerance:>9.0e} {:>9.2} {:>9.2} {:>6.0}% {:>6.2} {:>5} {:>9.1e} {:>5.2} {:>5.2}",
                    copied[0] * 1e3,
                    took[0] * 1e3,
                    100.0 * copied[0] / took[0],
                    gain(&took),
                    train.max_rank(),
                    report.error,
                    gain(&copied),
                    gain(&read),
                );
            }
        }
    }
}
