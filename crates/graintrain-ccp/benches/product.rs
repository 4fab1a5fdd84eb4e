//! Cost of the product with N and of one iteration of each first-order method, beside a copy of the same
//! size.
//!
//! `cargo bench -p graintrain-ccp --bench product [-- SIDE... METHOD... WORD...]`; SIDE is the edge of the
//! packing in balls, six contacts per ball (default 15, 29, 58: about 2e4, 1.5e5, 1.2e6 contacts), METHOD
//! leaves the others out (`none`: all of them), WORD is `bodies` or `rows` (N over bodies or as a sparse
//! matrix, default both), `one` or `two` (threads, default both). Each figure is the least of several
//! interleaved rounds, because other programs disturb every one of them.

#[path = "../tests/all/common.rs"]
mod common;

use graintrain_ccp::residual::ResidualScale;
use graintrain_ccp::solver::dispatch::vectorised;
use graintrain_ccp::solver::lanes::{LANES, Lanes, TaskWork, Vector};
use graintrain_ccp::solver::scaling::ScaledProblem;
use graintrain_ccp::{Ccp, Delassus};
use graintrain_ccp::{SolveSettings, SolverSpec};
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Instant;

const METHODS: &[&str] = &["pj", "pgs", "apgs", "apgd", "bb", "kucera", "spg", "gpminres"];
const ROUNDS: usize = 5;
/// Floating-point operations of a product per contact: twice 9 + 2 (9 + 3) + 15 in and out, and the bodies'
/// share.
const FLOPS: f64 = 110.0;

/// The time that measurements go by: processor time on one thread, which other programs do not lengthen, else
/// wall-clock time.
struct Clock {
    start: Instant,
    processor: Option<f64>,
}

impl Clock {
    fn start() -> Self {
        let processor = (rayon::current_num_threads() == 1).then(processor_seconds);
        Self { start: Instant::now(), processor }
    }

    fn seconds(&self) -> f64 {
        self.processor.map_or_else(|| self.start.elapsed().as_secs_f64(), |start| processor_seconds() - start)
    }
}

/// Processor time of this process, s.
fn processor_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Seconds of one call, the least of a few.
fn least(repeat: usize, mut call: impl FnMut()) -> f64 {
    (0..repeat).fold(f64::INFINITY, |least, _| {
        let clock = Clock::start();
        call();
        least.min(clock.seconds())
    })
}

/// Sum of numbers, sixteen at a time.
fn sum(numbers: &[f64]) -> f64 {
    numbers
        .par_chunks(1 << 16)
        .map(|part| {
            let mut sums = [0.0; 16];
            for numbers in part.as_chunks::<16>().0 {
                for (sum, x) in sums.iter_mut().zip(numbers) {
                    *sum += x;
                }
            }
            sums.iter().sum::<f64>()
        })
        .sum()
}

/// Multiplications and additions per second that one thread can do, half of each, with nothing to load or to
/// store.
fn peak_flops() -> f64 {
    const STEPS: usize = 1 << 14;
    struct Peak<'a>(&'a mut Lanes);
    impl TaskWork for Peak<'_> {
        #[inline(always)]
        fn run<V: Vector>(self) {
            let factor = V::of(*self.0);
            let (mut products, mut sums) = ([factor; 6], [factor; 6]);
            for _ in 0..STEPS {
                for k in 0..6 {
                    products[k] = products[k] * factor;
                    sums[k] += factor;
                }
            }
            let mut total = V::default();
            for k in 0..6 {
                total += products[k] + sums[k];
            }
            *self.0 = total.lanes();
        }
    }
    let seconds = least(20, || {
        let mut lanes = std::hint::black_box(Lanes([1.0; LANES]));
        vectorised(Peak(&mut lanes));
        std::hint::black_box(lanes);
    });
    (12 * LANES * STEPS) as f64 / seconds
}

/// Seconds and products of a solve of so many iterations.
fn solve(problem: &Ccp, method: &str, iterations: usize) -> (f64, usize) {
    let mut g = vec![0.0; 3 * problem.num_contacts()];
    let settings =
        SolveSettings { tolerance: 0.0, max_iterations: Some(iterations), ..SolveSettings::default() };
    let mut solver = method.parse::<SolverSpec>().expect("a known name").build().expect("a known name");
    let clock = Clock::start();
    let report = solver.solve(problem, &mut g, &settings).expect("a valid problem");
    assert_eq!(report.iterations, iterations);
    (clock.seconds(), report.products)
}

fn measure(problem: &Ccp, methods: &[&str]) {
    let contacts = problem.num_contacts();
    let bodies = problem.delassus.num_bodies();
    let scaled = ScaledProblem::new(problem, &ResidualScale::new(problem));
    let bytes = scaled.product_bytes() as f64;
    let (mut x, mut u) = (scaled.zeros(), scaled.zeros());
    scaled.pack(&vec![1.0; 3 * contacts], &mut x);
    let (mut image, mut work) = (scaled.zero_image(), scaled.work());
    // A copy that moves as many bytes as the product: half read, half written.
    let from = vec![1.0_f64; (bytes / 16.0) as usize];
    let mut to = from.clone();
    let (mut copy, mut read, mut product) = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
    for _ in 0..ROUNDS {
        // And a sum over as many bytes.
        for part in [&from, &to] {
            read = read.min(
                2.0 * least(5, || {
                    std::hint::black_box(sum(part));
                }),
            );
        }
        copy = copy.min(least(5, || {
            to.par_chunks_mut(1 << 16)
                .zip(from.par_chunks(1 << 16))
                .for_each(|(to, from)| to.copy_from_slice(from));
        }));
        product = product.min(least(5, || scaled.multiply(&mut x, &mut u, &mut image, &mut work)));
    }
    let threads = rayon::current_num_threads();
    let (flops, peak) = (FLOPS * contacts as f64, threads as f64 * peak_flops());
    // Four fifths of what the product moves is read: it cannot be faster than reading as many bytes, nor than
    // the arithmetic.
    let bound = read.max(flops / peak);
    println!(
        "{contacts:8} contacts {bodies:7} bodies {threads} threads | copy {:6.1} read {:6.1} GB/s, peak {:5.1} Gflop/s | N g {:8.3} ms {:5.1} ns/contact {:6.1} GB/s {:5.2} Gflop/s, {:4.2} of the copy's speed, {:4.2} of the bound by {}",
        bytes / copy / 1e9,
        bytes / read / 1e9,
        peak / 1e9,
        1e3 * product,
        1e9 * product / contacts as f64,
        bytes / product / 1e9,
        flops / product / 1e9,
        copy / product,
        bound / product,
        if bound > read { "arithmetic" } else { "reading" },
    );
    let iterations = (6_000_000 / contacts.max(1)).clamp(10, 400);
    for method in methods {
        // The difference of a long and a short solve, beside products of the same moment.
        let (mut short, mut long, mut beside) = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
        let mut products = 0;
        for _ in 0..ROUNDS {
            let (seconds, before) = solve(problem, method, 10);
            short = short.min(seconds);
            let (seconds, after) = solve(problem, method, 10 + iterations);
            long = long.min(seconds);
            products = after - before;
            beside = beside.min(least(10, || scaled.multiply(&mut x, &mut u, &mut image, &mut work)));
        }
        let time = (long - short) / iterations as f64;
        let per_iteration = products as f64 / iterations as f64;
        println!(
            "    {method:9} {:8.3} ms per iteration, {per_iteration:4.2} products in it, {:4.2} times their cost",
            1e3 * time,
            time / (per_iteration * beside)
        );
    }
}

fn main() {
    let sides: Vec<usize> = std::env::args().skip(1).filter_map(|side| side.parse().ok()).collect();
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let mut methods = METHODS.to_vec();
    if methods.iter().any(|method| wanted.iter().any(|name| name == method)) {
        methods.retain(|method| wanted.iter().any(|name| name == method));
    }
    let named = |word: &str| wanted.iter().any(|name| name == word);
    if named("none") {
        methods.clear();
    }
    let either = |word: &str, other: &str| named(word) || !named(other);
    let (bodies, rows) = (either("bodies", "rows"), either("rows", "bodies"));
    let sides = if sides.is_empty() { vec![15, 29, 58] } else { sides };
    for side in sides {
        let problem = common::lattice_packing(side, side, 0.3, 1);
        for threads in [1, 2] {
            if !(if threads == 1 { either("one", "two") } else { either("two", "one") }) {
                continue;
            }
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| {
                if bodies {
                    measure(&problem, &methods);
                }
                if rows && problem.num_contacts() < 300_000 {
                    let sparse = Ccp {
                        delassus: Arc::new(Delassus::Sparse(problem.delassus.assemble())),
                        ..problem.clone()
                    };
                    print!("  sparse ");
                    measure(&sparse, &methods);
                }
            });
        }
    }
}
