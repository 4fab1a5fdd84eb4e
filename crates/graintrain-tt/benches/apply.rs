//! TT-matrix times full vector against this machine's two limits, measured in the same process and
//! interleaved: the dense product rate of the same library and the bandwidth of a STREAM triad. Wall time,
//! and the processor time of all threads over their number, which other processes disturb less (but which
//! does not see a thread that waits).
//!
//! `cargo bench -p graintrain-tt --bench apply`

use graintrain_linalg::dense::{Matrix, multiply};
use graintrain_tt::TtMatrix;
use graintrain_tt::apply::{ApplyWork, FullOperator};
use rayon::prelude::*;
use std::hint::black_box;
use std::time::Instant;

/// Processor time of this process, seconds.
fn processor_time() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Wall time, and processor time per thread.
fn seconds(mut run: impl FnMut()) -> [f64; 2] {
    let (start, before) = (Instant::now(), processor_time());
    run();
    [start.elapsed().as_secs_f64(), (processor_time() - before) / rayon::current_num_threads() as f64]
}

/// Flops per second of 512^3 products, one per thread.
fn product_seconds(matrices: &mut [(Matrix, Matrix, Matrix)]) -> [f64; 2] {
    seconds(|| {
        matrices.par_iter_mut().for_each(|(a, b, c)| {
            for _ in 0..2 {
                multiply(1.0, a.view(), b.view(), c.view_mut());
            }
        });
    })
}

/// a <- b + s c over three arrays of 128 MB.
fn triad_seconds(a: &mut [f64], b: &[f64], c: &[f64]) -> [f64; 2] {
    let chunk = a.len().div_ceil(rayon::current_num_threads());
    seconds(|| {
        a.par_chunks_mut(chunk).zip(b.par_chunks(chunk)).zip(c.par_chunks(chunk)).for_each(|((a, b), c)| {
            for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
                *a = b + 3.0 * c;
            }
        });
    })
}

fn main() {
    let levels = 15;
    let modes: Vec<usize> = std::iter::once(24).chain(std::iter::repeat_n(2, levels)).collect();
    println!("N = 24 * 2^{levels} = {}", 24usize << levels);
    println!(
        "threads  rank  clock      time/ms  flops/Gflop  traffic/MB  rate/GF/s  dense/GF/s  triad/GB/s  limit/ms  time/limit"
    );
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            for rank in [10, 32] {
                let a = TtMatrix::random(&modes, &modes, rank, 1).expect("train");
                let operator = FullOperator::new(&a).expect("operator");
                let x: Vec<f64> = (0..operator.num_columns()).map(|i| (i as f64).sin()).collect();
                let mut y = vec![0.0; operator.num_rows()];
                let mut work = ApplyWork::default();
                let square = |s| Matrix::from_fn(512, 512, |i, j| ((i * 7 + j * s) % 13) as f64 - 6.0);
                let mut matrices: Vec<_> = (0..threads).map(|_| (square(1), square(3), Matrix::zeros(512, 512))).collect();
                let (mut u, v, w) = (vec![0.0; 1 << 24], vec![1.0; 1 << 24], vec![2.0; 1 << 24]);
                let mut best = [[f64::INFINITY; 2]; 3];
                for _ in 0..12 {
                    let measured = [
                        seconds(|| operator.apply(black_box(&x), &mut y, &mut work).expect("sizes")),
                        product_seconds(&mut matrices),
                        triad_seconds(&mut u, &v, &w),
                    ];
                    for (best, measured) in best.iter_mut().flatten().zip(measured.into_iter().flatten()) {
                        *best = best.min(measured);
                    }
                }
                for (clock, name) in ["wall", "processor"].into_iter().enumerate() {
                    let [time, dense, triad] = best.map(|times| times[clock]);
                    let dense = threads as f64 * 2.0 * 2.0 * 512f64.powi(3) / dense;
                    let triad = 3.0 * 8.0 * f64::from(1 << 24) / triad;
                    let limit = (operator.flops() / dense).max(operator.traffic() / triad);
                    println!(
                        "{threads:7}  {rank:4}  {name:9}  {:7.2}  {:11.2}  {:10.1}  {:9.1}  {:10.1}  {:10.1}  {:8.2}  {:10.2}",
                        1e3 * time,
                        1e-9 * operator.flops(),
                        1e-6 * operator.traffic(),
                        1e-9 * operator.flops() / time,
                        1e-9 * dense,
                        1e-9 * triad,
                        1e3 * limit,
                        time / limit
                    );
                }
            }
        });
    }
}
