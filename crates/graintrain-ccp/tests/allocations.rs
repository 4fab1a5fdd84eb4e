//! No first-order method and no interior point allocates inside its iterations: twice as many iterations
//! allocate exactly as often. What the linear solvers of interior points allocate, and the records they
//! leave, are counted by themselves.
#![allow(unsafe_code)] // A global allocator cannot be written without; this one only counts.

#[path = "all/common.rs"]
mod common;

use common::{lattice_packing, sparse_form, with_mechanisms};
use graintrain_ccp::newton::{Form, LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use graintrain_ccp::paper::scip::Scip;
use graintrain_ccp::solver::first_order::FirstOrder;
use graintrain_ccp::solver::ipm::Ipm;
use graintrain_ccp::solver::{AcceleratedSweeps, Apgd, CcpSolver, ExactState, GaussSeidel};
use graintrain_ccp::{Ccp, Criterion, Delassus, SolveSettings, SolverSpec};
use std::alloc::{GlobalAlloc, Layout, System};
use std::collections::BTreeMap;
use std::sync::Arc;
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

/// Allocations of a solve of so many iterations to this tolerance, with exact friction where the solver is to
/// treat it itself.
fn allocations(
    solver: &mut dyn CcpSolver,
    problem: &Ccp,
    exact: bool,
    tolerance: f64,
    iterations: usize,
) -> usize {
    let criterion = Criterion::Mixed;
    let settings =
        SolveSettings { tolerance, criterion, max_iterations: Some(iterations), ..SolveSettings::default() };
    let mut g = vec![0.0; 3 * problem.num_contacts()];
    let mut last = ExactState { last: g.clone(), memory: None };
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    let report = if exact {
        solver.solve_exact(problem, &mut g, &mut last, &settings).unwrap().expect("treats exact friction")
    } else {
        solver.solve(problem, &mut g, &settings).unwrap()
    };
    let after = ALLOCATIONS.load(Ordering::Relaxed);
    assert_eq!(report.iterations, iterations, "{}", solver.name());
    after - before
}

/// Checks that twice as many iterations allocate exactly as often, in double precision.
fn check(solver: &mut dyn CcpSolver, problem: &Ccp, exact: bool) {
    check_at(solver, problem, exact, (0.0, 110));
}

/// The same of so many iterations to a tolerance that they do not reach.
fn check_at(solver: &mut dyn CcpSolver, problem: &Ccp, exact: bool, (tolerance, iterations): (f64, usize)) {
    // The second solve finds the queues of the threads at their full size.
    allocations(solver, problem, exact, tolerance, iterations);
    // The queues of threads that wait for a processor take a block now and then: the least of three counts.
    let mut least = |iterations: usize| {
        (0..3).map(|_| allocations(solver, problem, exact, tolerance, iterations)).min().unwrap()
    };
    let (once, twice) = (least(iterations), least(2 * iterations));
    let threads = rayon::current_num_threads();
    assert_eq!(once, twice, "{} on {threads} threads, exact friction: {exact}", solver.name());
}

/// Allocations of linear solvers: when a matrix is taken, in solves, for the record.
static INSIDE: [AtomicUsize; 3] = [const { AtomicUsize::new(0) }; 3];

/// A linear solver whose allocations are counted.
struct Watched(Box<dyn NewtonSolver>);

/// Runs `work` and adds its allocations to one of [`INSIDE`].
fn watch<T>(place: usize, work: impl FnOnce() -> T) -> T {
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    let result = work();
    INSIDE[place].fetch_add(ALLOCATIONS.load(Ordering::Relaxed) - before, Ordering::Relaxed);
    result
}

impl NewtonSolver for Watched {
    fn name(&self) -> &'static str {
        self.0.name()
    }

    fn form(&self) -> Form {
        self.0.form()
    }

    fn prepare(&mut self, system: &NewtonSystem<'_>) {
        self.0.prepare(system);
    }

    fn needs_matrix(&self) -> bool {
        self.0.needs_matrix()
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        watch(0, || self.0.refresh(system))
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        watch(1, || self.0.solve(system, b, z, relative_tolerance))
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        watch(2, || self.0.figures(figures));
    }
}

/// Allocations of a solve of so many Newton systems: of the method, and of its linear solver in matrices,
/// solves and records.
fn newton_allocations(solver: &mut dyn CcpSolver, problem: &Ccp, iterations: usize) -> [usize; 4] {
    INSIDE.iter().for_each(|count| count.store(0, Ordering::Relaxed));
    let all = allocations(solver, problem, false, 0.0, iterations);
    let [matrix, solves, record] = [0, 1, 2].map(|place| INSIDE[place].load(Ordering::Relaxed));
    [all - matrix - solves - record, matrix, solves, record]
}

/// Checks that neither the method nor its linear solver allocates from one system to the next, but for the
/// record.
fn check_newton(name: &str, linear: &str, problem: &Ccp, systems: usize) {
    let watched = Box::new(Watched(common::linear_solver(linear)));
    let mut solver: Box<dyn CcpSolver> = match name {
        "ipm" => Box::new(Ipm::with_solver(watched)),
        _ => Box::new(Scip::with_solver(watched)),
    };
    // The first solve analyses the pattern.
    newton_allocations(&mut *solver, problem, 2 * systems);
    let once = newton_allocations(&mut *solver, problem, systems);
    let twice = newton_allocations(&mut *solver, problem, 2 * systems);
    let record = (twice[3] - once[3]) as f64 / systems as f64;
    println!("{name}+{linear}: {record} allocations per system for the record, {once:?} in all");
    assert_eq!(once[..3], twice[..3], "{name}+{linear}");
}

// The only test of this binary: another one at the same time would be counted, too.
/// The packing with mechanisms and compliant contacts.
fn coupled(packing: &Ccp) -> Ccp {
    let problem = with_mechanisms(packing);
    let Delassus::Rigid(rigid) = &*problem.delassus else { panic!("a problem over bodies") };
    let rigid = rigid.clone().with_compliance(vec![0.1; problem.num_contacts()]);
    Ccp { delassus: Arc::new(Delassus::Rigid(rigid)), ..problem }
}

#[test]
fn iterations_do_not_allocate() {
    // More contacts than one chunk of a pass holds, so that passes are split over the threads.
    let packing = lattice_packing(7, 6, 0.3, 1);
    assert!(packing.num_contacts() > 1024);
    // Several blocks of sweeps in single precision.
    let large = lattice_packing(16, 14, 0.3, 1);
    assert!(large.num_contacts() > 2 * 4096);
    // Handing work to a pool from outside allocates; the interior points are watched from inside, on one
    // thread.
    rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(|| {
        for name in ["ipm", "scip"] {
            for linear in ["cholesky", "schur-cholesky", "body-cholesky", "ic", "block-jacobi", "body-cg"] {
                if name == "ipm" && linear != "ic" && !linear.ends_with("cholesky") {
                    // The same code as with `scip`, which asks for less accuracy.
                    continue;
                }
                // The first systems are easy for Krylov methods, later ones take thousands of iterations.
                check_newton(name, linear, &packing, if linear.ends_with("cholesky") { 6 } else { 2 });
            }
            check_newton(name, "cholesky", &sparse_form(&packing), 6);
        }
    });
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            for problem in [packing.clone(), sparse_form(&packing), coupled(&packing)] {
                for name in ["pj", "pgs", "pgs@1.3", "apgs", "apgd", "bb", "kucera", "spg", "gpminres"] {
                    check(&mut *name.parse::<SolverSpec>().unwrap().build().unwrap(), &problem, false);
                }
                check(&mut FirstOrder::new(GaussSeidel::default()), &problem, true);
                check(&mut FirstOrder::new(AcceleratedSweeps::default()), &problem, true);
                check(&mut FirstOrder::new(Apgd::default()), &problem, true);
            }
            for exact in [true, false] {
                let single = (2e-5, 20);
                check_at(&mut FirstOrder::new(AcceleratedSweeps::default()), &large, exact, single);
                check_at(&mut FirstOrder::new(Apgd::default()), &large, exact, single);
                check_at(&mut FirstOrder::new(Apgd::default()), &coupled(&large), exact, single);
            }
        });
    }
}
