//! One table: dot, norm, rounding, products of trains and with full vectors, TT-SVD at ranks 5 to 200, each
//! beside what the machine could do at best in the same minute: the flops that the operation cannot do
//! without over the rate of a large dense product, or its traffic over the speed of a copy.
//!
//! `cargo bench -p graintrain-tt --bench table`, with ranks behind `--` for these alone; RAYON_NUM_THREADS
//! chooses the threads (times are processor times on one thread, else wall times).

use graintrain_linalg::dense::{Matrix, multiply};
use graintrain_tt::apply::{ApplyWork, FullOperator};
use graintrain_tt::{Truncation, TtMatrix, TtVector};
use rustix::time::{ClockId, clock_gettime};
use std::hint::black_box;

/// Modes of the trains of dot, norm and rounding: 4^20.
const MODES: [usize; 20] = [4; 20];

fn clock() -> f64 {
    let id = if rayon::current_num_threads() == 1 { ClockId::ProcessCPUTime } else { ClockId::Monotonic };
    let time = clock_gettime(id);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// The fastest of several runs within a second (three at least).
fn seconds<T>(mut run: impl FnMut() -> T) -> f64 {
    let (mut best, mut spent, mut count) = (f64::INFINITY, 0.0, 0);
    while count < 3 || (spent < 1.0 && count < 500) {
        let start = clock();
        black_box(run());
        let took = clock() - start;
        (best, spent, count) = (best.min(took), spent + took, count + 1);
    }
    best
}

/// Flops per second of a dense product of 768 x 768 matrices, on one thread.
fn dense_rate() -> f64 {
    let n = 768;
    let (a, b) =
        (Matrix::from_fn(n, n, |i, j| (i + j) as f64), Matrix::from_fn(n, n, |i, j| (i * j % 7) as f64));
    let mut c = Matrix::zeros(n, n);
    2.0 * (n as f64).powi(3) / seconds(|| multiply(1.0, a.view(), b.view(), c.view_mut()))
}

/// Bytes per second that a copy of 2^24 numbers reads.
fn copy_rate() -> f64 {
    let (from, mut to) = (vec![1.0f64; 1 << 24], vec![0.0f64; 1 << 24]);
    8.0 * from.len() as f64 / seconds(|| black_box(&mut to).copy_from_slice(black_box(&from)))
}

fn line(name: &str, rank: usize, ranks: String, took: f64, least: f64) {
    println!(
        "| {name} | {rank} | {ranks} | {:.3} | {:.3} | {:.0} % |",
        1e3 * took,
        1e3 * least,
        100.0 * least / took
    );
}

/// sum over the cores of f(left, mode, right).
fn flops(train: &TtVector, f: impl Fn(f64, f64, f64) -> f64) -> f64 {
    train.cores().iter().map(|core| f(core.left() as f64, core.mode() as f64, core.right() as f64)).sum()
}

fn main() -> Result<(), graintrain_tt::TtError> {
    let threads = rayon::current_num_threads();
    println!(
        "{threads} threads; dense product {:.1} GF/s on one, copy {:.1} GB/s before.\n",
        1e-9 * dense_rate(),
        1e-9 * copy_rate()
    );
    println!("| operation | rank | ranks of the result | ms | bound, ms | share of the bound |");
    println!("|---|---|---|---|---|---|");
    let asked: Vec<usize> = std::env::args().skip(1).filter_map(|x| x.parse().ok()).collect();
    for rank in [5, 20, 50, 100, 200].into_iter().filter(|rank| asked.is_empty() || asked.contains(rank)) {
        let rate = dense_rate();
        let (x, y) = (TtVector::random(&MODES, rank, 1)?, TtVector::random(&MODES, rank, 2)?);
        // P <- sum_i X(i)^T P Y(i): two products per core.
        let least = flops(&x, |l, n, r| 2.0 * n * (l * l * r + l * r * r)) / rate;
        line("dot 4^20", rank, "1".into(), seconds(|| x.dot(&y)), least);
        // A product with the factor of what lies right and half a Gram matrix per core. (The first at its
        // full price, although the factor is a triangle.)
        let least = flops(&x, |l, n, r| n * (2.0 * l * r * r + l * l * r)) / rate;
        line("norm 4^20", rank, "1".into(), seconds(|| x.norm()), least);
        // x + x, of rank 2 r, back to rank r: the same for the sum, then projections from the left.
        let twice = x.add(&x)?;
        let rounded = twice.round(&Truncation::to(1e-10))?.0;
        let least =
            flops(&twice, |l, n, r| n * (2.0 * l * r * r + l * l * r) + n * l * r * 0.5 * (l + r)) / rate;
        let took = seconds(|| twice.round(&Truncation::to(1e-10)));
        line("round x + x, 4^20", rank, rounded.max_rank().to_string(), took, least);
        let a = TtMatrix::random(&[2; 20], &[2; 20], 4, 3)?;
        let v = TtVector::random(&[2; 20], rank, 4)?;
        let mut image = a.times_vector(&v)?;
        // Every number of the result is written once, a copy reads as many.
        let least = 8.0 * image.num_parameters() as f64 / copy_rate();
        let took = seconds(|| a.times_vector_into(&v, &mut image));
        line("matrix of rank 4 times train, 2^20", rank, image.max_rank().to_string(), took, least);
        if rank <= 100 {
            // 2^16 unknowns; the flops of the merged cores.
            let a = TtMatrix::random(&[2; 16], &[2; 16], rank, 5)?;
            let operator = FullOperator::new(&a)?;
            let full = vec![1.0; 1 << 16];
            let (mut result, mut work) = (vec![0.0; 1 << 16], ApplyWork::default());
            let least = operator.flops() / (rate * threads as f64);
            let took = seconds(|| operator.apply(&full, &mut result, &mut work));
            line("matrix times full vector, 2^16", rank, "-".into(), took, least);
        }
        if rank <= 50 {
            let modes = [2; 22];
            let full = TtVector::random(&modes, rank, 6)?.to_full()?;
            let to = Truncation::to(1e-6);
            let found = TtVector::from_full(&full, &modes, &to)?.0;
            let least = 8.0 * full.len() as f64 / copy_rate();
            let took = seconds(|| TtVector::from_full(&full, &modes, &to));
            line("TT-SVD of 2^22 numbers to 1e-6", rank, found.max_rank().to_string(), took, least);
        }
    }
    Ok(())
}
