//! No first-order method allocates inside its iterations: twice as many iterations allocate exactly as often.
#![allow(unsafe_code)] // A global allocator cannot be written without; this one only counts.

mod common;

use common::{lattice_packing, sparse_form};
use graintrain_ccp::solver::first_order::FirstOrder;
use graintrain_ccp::solver::{Apgd, CcpSolver, GaussSeidel};
use graintrain_ccp::{Ccp, SolveSettings, SolverSpec};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allocations of a solve of so many iterations, with exact friction where the solver is to treat it itself.
fn allocations(solver: &mut dyn CcpSolver, problem: &Ccp, exact: bool, iterations: usize) -> usize {
    let settings =
        SolveSettings { tolerance: 0.0, max_iterations: Some(iterations), ..SolveSettings::default() };
    let mut g = vec![0.0; 3 * problem.num_contacts()];
    let mut last = g.clone();
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    let report = if exact {
        solver
            .solve_exact(problem, &mut g, &mut last, &settings, false)
            .unwrap()
            .expect("treats exact friction")
    } else {
        solver.solve(problem, &mut g, &settings).unwrap()
    };
    let after = ALLOCATIONS.load(Ordering::Relaxed);
    assert_eq!(report.iterations, iterations, "{}", solver.name());
    after - before
}

/// Checks that twice as many iterations allocate exactly as often.
fn check(solver: &mut dyn CcpSolver, problem: &Ccp, exact: bool) {
    // The second solve finds the queues of the threads at their full size.
    allocations(solver, problem, exact, 110);
    let once = allocations(solver, problem, exact, 110);
    let twice = allocations(solver, problem, exact, 220);
    let threads = rayon::current_num_threads();
    assert_eq!(once, twice, "{} on {threads} threads, exact friction: {exact}", solver.name());
}

// The only test of this binary: another one at the same time would be counted, too.
#[test]
fn iterations_do_not_allocate() {
    // More contacts than one chunk of a pass holds, so that passes are split over the threads.
    let packing = lattice_packing(7, 6, 0.3, 1);
    assert!(packing.num_contacts() > 1024);
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            for problem in [packing.clone(), sparse_form(&packing)] {
                for name in ["pj", "pgs", "pgs@1.3", "apgd", "bb", "kucera", "spg", "gpminres"] {
                    check(&mut *name.parse::<SolverSpec>().unwrap().build().unwrap(), &problem, false);
                }
                check(&mut FirstOrder::new(GaussSeidel::default()), &problem, true);
                check(&mut FirstOrder::new(Apgd::default()), &problem, true);
            }
        });
    }
}
