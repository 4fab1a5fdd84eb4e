//! One line of JSON per operation: the same tensors and accuracies as `benches/peers/tensor_trains.py`, which
//! prints the table beside other libraries.
//!
//! `cargo bench -p graintrain-tt --bench operations`; RAYON_NUM_THREADS chooses the threads. On one thread
//! the times are processor times, which other processes disturb little, on several wall times.

use graintrain_tt::apply::{ApplyWork, FullOperator};
use graintrain_tt::cross::{CrossSettings, Function, cross};
use graintrain_tt::qtt::{self, DigitOrder};
use graintrain_tt::solve::{SolveSettings, solve};
use graintrain_tt::symmetric::SymmetricTrain;
use graintrain_tt::{Core, Truncation, TtMatrix, TtVector};
use rustix::time::{ClockId, clock_gettime};
use std::hint::black_box;

/// Seconds on the clock of this run.
fn clock() -> f64 {
    let id = if rayon::current_num_threads() == 1 { ClockId::ProcessCPUTime } else { ClockId::Monotonic };
    let time = clock_gettime(id);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Runs until a second is spent (at least three times) and prints the fastest.
fn report<T>(name: &str, mut run: impl FnMut() -> T, error: impl Fn(&T) -> f64) {
    let (mut best, mut spent, mut count) = (f64::INFINITY, 0.0, 0);
    let mut last = None;
    while count < 3 || (spent < 1.0 && count < 2000) {
        let start = clock();
        let result = black_box(run());
        let seconds = clock() - start;
        best = best.min(seconds);
        spent += seconds;
        count += 1;
        last = Some(result);
    }
    let error = last.as_ref().map_or(f64::NAN, error);
    println!("{{\"operation\": \"{name}\", \"seconds\": {best:e}, \"error\": {error:e}}}");
}

/// The n-th number in [-1, 1) of a fixed sequence (SplitMix64), the same in the Python script.
fn number(n: u64) -> f64 {
    let z = n.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// A train of numbers of the sequence, core by core, first index fastest, scaled to a norm near 1.
fn train(d: usize, mode: usize, rank: usize, seed: u64) -> TtVector {
    let mut n = seed;
    let scale = (3.0 / (mode * rank) as f64).sqrt();
    let cores = (0..d).map(|k| {
        let (left, right) = (if k == 0 { 1 } else { rank }, if k + 1 == d { 1 } else { rank });
        Core::from_fn(left, mode, right, |_, _, _| {
            n += 1;
            scale * number(n)
        })
    });
    TtVector::from_cores(cores.collect()).expect("shapes fit")
}

fn main() {
    let d = 20;
    let x = train(d, 4, 32, 1_000_000);
    let y = train(d, 4, 32, 2_000_000);
    let sum = x.add(&x).expect("same modes");
    let twice = x.scale(2.0);
    report(
        "round 4^20, rank 64 to 32",
        || sum.round(&Truncation::to(1e-10)).expect("finite").0,
        |r| r.relative_distance(&twice).expect("same modes"),
    );
    report("dot 4^20, rank 32", || x.dot(&y).expect("same modes"), |_| 0.0);
    report("norm 4^20, rank 32", || x.norm(), |_| 0.0);
    report("add 4^20, rank 32", || x.add(&y).expect("same modes"), |_| 0.0);
    let (a8, b8) = (train(d, 4, 8, 3_000_000), train(d, 4, 8, 4_000_000));
    report("hadamard 4^20, rank 8 x 8", || a8.hadamard(&b8).expect("same modes"), |_| 0.0);
    let full: Vec<f64> =
        (0..1 << 20).map(|i| (1e-3 * f64::from(i)).sin() + 1.0 / (1.0 + f64::from(i))).collect();
    let size = full.iter().map(|x| x * x).sum::<f64>().sqrt();
    report(
        "TT-SVD 2^20 to 1e-8",
        || TtVector::from_full(&full, &[2; 20], &Truncation::to(1e-8)).expect("finite").0,
        |t| {
            let difference: f64 =
                t.to_full().expect("small").iter().zip(&full).map(|(a, b)| (a - b).powi(2)).sum();
            difference.sqrt() / size
        },
    );
    let points: Vec<usize> = (0..20 * 100_000u64).map(|n| ((number(n) + 1.0) * 2.0) as usize).collect();
    report("100000 entries of 4^20, rank 32", || x.entries(&points).expect("inside"), |_| 0.0);
    let operator = TtMatrix::from_vector(train(d, 4, 4, 5_000_000), &[2; 20], &[2; 20]).expect("pairs");
    let small = train(d, 2, 16, 6_000_000);
    report(
        "TT-matrix x TT-vector 2^20, rank 4 x 16",
        || operator.times_vector(&small).expect("sizes"),
        |_| 0.0,
    );
    let mut kept = small.clone();
    report(
        "TT-matrix x TT-vector 2^20, rank 4 x 16, memory kept",
        || operator.times_vector_into(&small, &mut kept).expect("sizes"),
        |_| 0.0,
    );
    report(
        "TT-matrix x TT-matrix 2^20, rank 4 x 4",
        || operator.times_matrix(&operator).expect("sizes"),
        |_| 0.0,
    );
    let wide = TtMatrix::from_vector(train(d, 4, 24, 9_000_000), &[2; 20], &[2; 20]).expect("pairs");
    let twice_symmetric = wide.symmetric_part().expect("square").add(&wide.symmetric_part().expect("square"));
    let twice_symmetric = twice_symmetric.expect("sizes");
    report(
        "round symmetric 2^20, rank 96 to 48, ungraded",
        || twice_symmetric.round(&Truncation::to(1e-10)).expect("finite").0,
        |_| 0.0,
    );
    let graded = SymmetricTrain::symmetric_part(&wide.add(&wide).expect("sizes")).expect("square");
    report(
        "round symmetric 2^20, rank 96 to 48, graded",
        || graded.round(&Truncation::to(1e-10)).expect("finite").0,
        |r| r.to_matrix().relative_distance(&twice_symmetric).expect("sizes"),
    );
    let matrix = TtMatrix::from_vector(train(16, 4, 10, 7_000_000), &[2; 16], &[2; 16]).expect("pairs");
    let prepared = FullOperator::new(&matrix).expect("small");
    let vector: Vec<f64> = (0..1 << 16).map(|n| number(n + 8_000_000)).collect();
    let (mut result, mut work) = (vec![0.0; 1 << 16], ApplyWork::default());
    report(
        "TT-matrix x full vector 2^16, rank 10",
        || prepared.apply(&vector, &mut result, &mut work),
        |_| 0.0,
    );
    let line = qtt::laplacian(6).expect("d >= 2").scale(65.0 * 65.0);
    for (dimension, tolerance) in [(2, 1e-6), (3, 1e-6)] {
        let a = qtt::kronecker_sum(&vec![line.clone(); dimension], DigitOrder::Separated).expect("axes");
        let f = TtVector::constant(&vec![2; 6 * dimension], 1.0).expect("modes");
        let settings = SolveSettings { tolerance, ..Default::default() };
        let name = format!("AMEn solve, Poisson 64^{dimension} to {tolerance:e}");
        report(&name, || solve(&a, &f, None, &settings).expect("sizes").1.residual, |residual| *residual);
    }
    let source = Function::new(&[32; 6], |index| 1.0 / (6 + index.iter().sum::<usize>()) as f64);
    let settings = CrossSettings { tolerance: 1e-6, ..Default::default() };
    report(
        "cross, Hilbert tensor 32^6 to 1e-6",
        || cross(&source, None, &[], &settings).expect("valid").1,
        |report| report.error().unwrap_or(f64::NAN),
    );
    // Most other libraries measure no error.
    let settings = CrossSettings { samples: 100, ..settings };
    report(
        "cross, Hilbert tensor 32^6 to 1e-6, error from 100 points",
        || cross(&source, None, &[], &settings).expect("valid").1,
        |report| report.error().unwrap_or(f64::NAN),
    );
}
