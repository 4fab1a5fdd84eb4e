//! Problems without a solution, or of sizes at the end of the floats: nobody may claim to have solved them.

use graintrain_ccp::newton::{LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use graintrain_ccp::solver::METHODS;
use graintrain_ccp::solver::pdip::{Pdip, Rule};
use graintrain_ccp::{Ccp, CcpSolver, Delassus, FrictionModel, SolveSettings, SolverSpec, Status};
use graintrain_linalg::block3::BlockMatrix3;
use std::time::Duration;

/// N block-diagonal with these diagonals.
fn diagonal(blocks: &[[f64; 3]], r: &[f64], friction: &[f64]) -> Ccp {
    let block = |d: &[f64; 3]| [d[0], 0.0, 0.0, 0.0, d[1], 0.0, 0.0, 0.0, d[2]];
    let n = blocks.len();
    let matrix = BlockMatrix3::from_rows(
        (0..=n).collect(),
        (0..n as u32).collect(),
        blocks.iter().map(block).collect(),
    );
    Ccp::new(Delassus::Sparse(matrix), r.to_vec(), friction.to_vec()).unwrap()
}

fn nobody_converges(problem: &Ccp, tolerance: f64) {
    for method in METHODS {
        for friction in [FrictionModel::Relaxed, FrictionModel::Coulomb] {
            let settings = SolveSettings {
                tolerance,
                friction,
                max_iterations: Some(20_000),
                max_time: Some(Duration::from_secs(2)),
                ..Default::default()
            };
            let mut impulse = vec![0.0; problem.r.len()];
            let solver = method.name.parse::<SolverSpec>().unwrap().build();
            let report = solver.unwrap().solve(problem, &mut impulse, &settings);
            if let Ok(report) = report {
                assert!(!report.converged(), "{} {friction:?}: {impulse:?} {report:?}", method.name);
            }
        }
    }
}

#[test]
fn a_contact_that_no_impulse_can_open_is_not_solved() {
    // The first contact closes with 1 m/s, and no impulse changes that.
    let blocks = [[0.0; 3], [2.0, 3.0, 3.0]];
    nobody_converges(&diagonal(&blocks, &[-1.0, 0.3, 0.0, -1.0, 0.0, 0.2], &[0.3, 0.5]), 1e-8);
    nobody_converges(&diagonal(&blocks[..1], &[-1.0, 0.3, 0.0], &[0.3]), 1e-8);
}

#[test]
fn large_numbers_do_not_make_a_problem_vanish() {
    let problem = diagonal(&[[1.0; 3], [1.0; 3]], &[-1e160, 0.0, 0.0, -1.0, 0.0, 0.2], &[0.3, 0.5]);
    let mut impulse = vec![0.0; 6];
    let mut solver = "apgd".parse::<SolverSpec>().unwrap().build().unwrap();
    let report = solver.solve(&problem, &mut impulse, &SolveSettings::default()).unwrap();
    assert!(report.residual.max.is_finite());
    assert!(!report.converged() || impulse[0] > 0.9e160, "{impulse:?} {report:?}");
}

#[test]
fn an_impulse_scale_without_meaning_is_refused() {
    for scale in [f64::NAN, f64::INFINITY, -1.0] {
        let mut problem = diagonal(&[[1.0; 3]], &[-1.0, 0.0, 0.0], &[0.3]);
        problem.impulse_scale = Some(scale);
        assert!(problem.validate().is_err());
    }
}

#[test]
fn a_start_that_solves_the_problem_is_the_answer() {
    // Interior points step back from the boundary of the cones, where this solution lies.
    let problem = diagonal(&[[2.0, 3.0, 3.0], [1.0; 3]], &[-1.0, 0.0, 0.0, 1.0, 0.0, 0.0], &[0.5, 0.3]);
    let start = [0.5, 0.0, 0.0, 0.0, 0.0, 0.0];
    for name in ["scip", "ipm+cholesky", "pdip", "pdip-literal"] {
        let settings = SolveSettings { tolerance: 1e-12, max_iterations: Some(0), ..Default::default() };
        let mut impulse = start;
        let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
        let report = solver.solve(&problem, &mut impulse, &settings).unwrap();
        assert!(report.converged() && impulse == start, "{name}: {impulse:?} {report:?}");
    }
}

/// Prepares itself for any matrix and solves none.
struct NeverSolves;

impl NewtonSolver for NeverSolves {
    fn name(&self) -> &'static str {
        "never"
    }

    fn needs_matrix(&self) -> bool {
        false
    }

    fn refresh(&mut self, _: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        Ok(())
    }

    fn solve(&mut self, _: &NewtonSystem<'_>, _: &[f64], z: &mut [f64], _: f64) -> LinearReport {
        z.fill(0.0);
        LinearReport { residual: 1.0, ..LinearReport::default() }
    }
}

/// The path of `pdip` starts at impulses of 100 J: where it goes nowhere they must not be the answer.
#[test]
fn a_linear_solver_that_fails_leaves_the_better_of_the_given_impulses_and_none() {
    let problem = diagonal(&[[2.0, 3.0, 3.0], [1.0; 3]], &[-1.0, 0.0, 0.0, 1.0, 0.0, 0.0], &[0.5, 0.3]);
    let (good, bad) = ([0.4, 0.0, 0.0, 0.0, 0.0, 0.0], [30.0, 0.0, 0.0, 7.0, 0.0, 0.0]);
    for rule in [Rule::Central, Rule::Paper] {
        for (start, answer) in [(good, good), (bad, [0.0; 6])] {
            let mut impulse = start;
            let mut solver = Pdip::with_solver(rule, Box::new(NeverSolves));
            let report = solver.solve(&problem, &mut impulse, &SolveSettings::default()).unwrap();
            assert_eq!((report.status, impulse), (Status::Stalled, answer), "{rule:?}");
        }
    }
}
