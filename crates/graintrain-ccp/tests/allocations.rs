//! No first-order method allocates inside its iterations: twice as many iterations allocate exactly as often.
#![allow(unsafe_code)] // A global allocator cannot be written without; this one only counts.

mod common;

use common::{lattice_packing, sparse_form};
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

/// Allocations of a solve of so many iterations.
fn allocations(name: &str, problem: &Ccp, iterations: usize) -> usize {
    let settings =
        SolveSettings { tolerance: 0.0, max_iterations: Some(iterations), ..SolveSettings::default() };
    let mut g = vec![0.0; 3 * problem.num_contacts()];
    let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    let report = solver.solve(problem, &mut g, &settings).unwrap();
    let after = ALLOCATIONS.load(Ordering::Relaxed);
    assert_eq!(report.iterations, iterations, "{name}");
    after - before
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
                for name in ["pj", "pgs", "apgd", "bb", "kucera", "spg", "gpminres"] {
                    // The second solve finds the queues of the threads at their full size.
                    allocations(name, &problem, 110);
                    let (once, twice) = (allocations(name, &problem, 110), allocations(name, &problem, 220));
                    assert_eq!(once, twice, "{name} on {threads} threads");
                }
            }
        });
    }
}
