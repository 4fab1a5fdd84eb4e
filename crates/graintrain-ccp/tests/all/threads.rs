//! Same input, any number of threads: the same bits, also of the second-order methods and with exact
//! friction. (First-order methods: `tests/all/first_order.rs`.)

use crate::common::lattice_packing;
use graintrain_ccp::{Ccp, FrictionModel, SolveSettings, SolverSpec};

/// Impulses and iterations of a solve on so many threads.
fn solve(problem: &Ccp, name: &str, settings: &SolveSettings, threads: usize) -> (Vec<u64>, usize) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let mut g = vec![0.0; 3 * problem.num_contacts()];
        let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
        let report = solver.solve(problem, &mut g, settings).unwrap();
        assert!(g.iter().any(|&g| g != 0.0), "{name} did something");
        (g.iter().map(|g| g.to_bits()).collect(), report.iterations)
    })
}

#[test]
fn two_threads_compute_the_bits_of_one() {
    // More contacts than one chunk of a sum or of a pass holds.
    let problem = lattice_packing(7, 6, 0.3, 1);
    assert!(3 * problem.num_contacts() > 4096);
    let relaxed = [
        ("ipm", 4),
        ("ipm+body-cg", 8),
        ("ipm+ic", 15),
        ("ipm+cholesky", 15),
        ("scip", 25),
        ("pdip", 25),
        ("pdip+ic", 25),
    ];
    let exact =
        [("apgd", 200), ("apgs", 100), ("pgs", 100), ("ipm", 200), ("bb", 200), ("scip", 60), ("auto", 200)];
    let runs = relaxed.map(|(name, limit)| (name, limit, FrictionModel::Relaxed));
    let runs = runs.into_iter().chain(exact.map(|(name, limit)| (name, limit, FrictionModel::Coulomb)));
    for (name, limit, friction) in runs {
        let settings = SolveSettings {
            tolerance: 1e-9,
            max_iterations: Some(limit),
            friction,
            ..SolveSettings::default()
        };
        let one = solve(&problem, name, &settings, 1);
        assert!(one == solve(&problem, name, &settings, 2), "{name} {friction:?}");
    }
}
