//! Cost of the product with N and of one iteration of each first-order method, beside a copy of the same size.
//!
//! `cargo bench -p graintrain-ccp --bench product [-- SIDE...]`; SIDE is the edge of the packing in balls, six contacts per ball
//! (default 15, 29, 58: about 2e4, 1.5e5, 1.2e6 contacts). Each figure is the least of several interleaved
//! rounds, because other programs disturb every one of them.

#[path = "../tests/common/mod.rs"]
mod common;

use graintrain_ccp::residual::ResidualScale;
use graintrain_ccp::solver::scaling::ScaledProblem;
use graintrain_ccp::solver::{SolveSettings, SolverSpec};
use graintrain_ccp::{Ccp, Delassus};
use rayon::prelude::*;
use std::time::Instant;

const METHODS: &[&str] = &["pj", "pgs", "apgd", "bb", "kucera", "spg", "gpminres"];
const ROUNDS: usize = 5;
/// Floating-point operations of a product per contact: twice 9 + 2 (9 + 3) + 15 in and out, and the bodies' share.
const FLOPS: f64 = 110.0;

/// Seconds of one call, the least of a few.
fn least(repeat: usize, mut call: impl FnMut()) -> f64 {
    (0..repeat).fold(f64::INFINITY, |least, _| {
        let start = Instant::now();
        call();
        least.min(start.elapsed().as_secs_f64())
    })
}

/// Seconds of one iteration of a method: the difference between a long and a short solve.
fn iteration(problem: &Ccp, method: &str, iterations: usize) -> f64 {
    let run = |iterations| {
        let mut g = vec![0.0; 3 * problem.num_contacts()];
        let settings =
            SolveSettings { tolerance: 0.0, max_iterations: Some(iterations), ..SolveSettings::default() };
        let mut solver = method.parse::<SolverSpec>().expect("a known name").build().expect("a known name");
        let start = Instant::now();
        let report = solver.solve(problem, &mut g, &settings).expect("a valid problem");
        assert_eq!(report.iterations, iterations);
        start.elapsed().as_secs_f64()
    };
    let (short, long) = (
        least(3, || {
            run(10);
        }),
        least(3, || {
            run(10 + iterations);
        }),
    );
    (long - short) / iterations as f64
}

fn measure(problem: &Ccp) {
    let contacts = problem.num_contacts();
    let bodies = problem.delassus.num_bodies();
    let scaled = ScaledProblem::new(problem, &ResidualScale::new(problem));
    let bytes = scaled.product_bytes() as f64;
    let (mut x, mut u) = (scaled.zeros(), scaled.zeros());
    scaled.pack(&vec![1.0; 3 * contacts], &mut x);
    let (mut image, zero, mut work) = (scaled.zero_image(), scaled.zero_image(), scaled.work());
    // A copy that moves as many bytes as the product: half read, half written.
    let from = vec![1.0_f64; (bytes / 16.0) as usize];
    let mut to = from.clone();
    let (mut copy, mut product) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..ROUNDS {
        copy = copy.min(least(5, || {
            to.par_chunks_mut(1 << 16)
                .zip(from.par_chunks(1 << 16))
                .for_each(|(to, from)| to.copy_from_slice(from));
        }));
        product = product.min(least(5, || scaled.multiply(&mut x, &mut u, &mut image, &zero, &mut work)));
    }
    println!(
        "{contacts:8} contacts {bodies:7} bodies {} threads | copy {:6.1} GB/s | N g {:8.3} ms {:5.1} ns/contact {:6.1} GB/s {:5.2} Gflop/s, {:4.2} of the copy's speed",
        rayon::current_num_threads(),
        bytes / copy / 1e9,
        1e3 * product,
        1e9 * product / contacts as f64,
        bytes / product / 1e9,
        FLOPS * contacts as f64 / product / 1e9,
        copy / product,
    );
    let iterations = (2_000_000 / contacts.max(1)).clamp(10, 100);
    for method in METHODS {
        let time = iteration(problem, method, iterations);
        println!("    {method:9} {:8.3} ms per iteration, {:4.2} products", 1e3 * time, time / product);
    }
}

fn main() {
    let sides: Vec<usize> = std::env::args().skip(1).filter_map(|side| side.parse().ok()).collect();
    let sides = if sides.is_empty() { vec![15, 29, 58] } else { sides };
    for side in sides {
        let problem = common::lattice_packing(side, side, 0.3, 1);
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| {
                measure(&problem);
                if problem.num_contacts() < 300_000 {
                    let sparse =
                        Ccp { delassus: Delassus::Sparse(problem.delassus.assemble()), ..problem.clone() };
                    print!("  sparse ");
                    measure(&sparse);
                }
            });
        }
    }
}
