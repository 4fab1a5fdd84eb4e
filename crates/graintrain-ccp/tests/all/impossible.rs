//! Problems without a solution, or of sizes at the end of the floats: nobody may claim to have solved them.

use graintrain_ccp::newton::{LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use graintrain_ccp::paper::pdip::{Pdip, Rule};
use graintrain_ccp::registry::Method;
use graintrain_ccp::{Ccp, CcpError, CcpSolver, Delassus, FrictionModel, SolveSettings, SolverSpec, Status};
use graintrain_linalg::block3::BlockMatrix3;
use std::sync::{Arc, atomic::AtomicBool};
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
    for method in Method::available() {
        for friction in [FrictionModel::Relaxed, FrictionModel::Coulomb] {
            let settings = SolveSettings {
                tolerance,
                friction,
                max_iterations: Some(20_000),
                max_time: Some(Duration::from_secs(2)),
                ..Default::default()
            };
            let mut impulse = vec![0.0; problem.r.len()];
            let solver = SolverSpec::from(method).build();
            let report = solver.unwrap().solve(problem, &mut impulse, &settings);
            if let Ok(report) = report {
                assert!(!report.converged(), "{} {friction:?}: {impulse:?} {report:?}", method.name());
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

/// The velocities of the first impulses overflow: a residual that is not finite ends the solve, it is not
/// waited for.
#[test]
fn a_residual_that_is_not_finite_ends_the_solve() {
    let problem = diagonal(&[[1e-300; 3]], &[-1e300, 1e300, 0.0], &[0.5]);
    for name in ["apgd", "apgs", "pgs", "bb", "ipm", "auto"] {
        let settings =
            SolveSettings { friction: FrictionModel::Coulomb, tolerance: 1e-8, ..Default::default() };
        let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
        let report = solver.solve(&problem, &mut [0.0; 3], &settings).unwrap();
        assert!(!report.converged(), "{name}: {report:?}");
    }
}

#[test]
fn a_scale_without_meaning_is_refused() {
    for scale in [f64::NAN, f64::INFINITY, -1.0] {
        let problem = diagonal(&[[1.0; 3]], &[-1.0, 0.0, 0.0], &[0.3]);
        assert!(Ccp { velocity_scale: Some(scale), ..problem }.validate().is_err());
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

/// N, and with it the impulses, near the ends of the floats: an answer is a number, whatever else it is.
#[test]
fn no_solver_returns_impulses_that_are_not_numbers() {
    for size in [1e-300, 1e-160, 1e160, 1e300] {
        let problem = diagonal(&[[size; 3]; 2], &[-1.0, 0.3, 0.1, -1.0, 0.3, 0.1], &[0.5; 2]);
        for method in Method::available() {
            for start in [0.0, f64::NAN, 1.0 / size] {
                let settings =
                    SolveSettings { max_time: Some(Duration::from_secs(1)), ..SolveSettings::default() };
                let mut impulse = [start; 6];
                let solver = SolverSpec::from(method).build();
                let _ = solver.unwrap().solve(&problem, &mut impulse, &settings);
                let name = method.name();
                assert!(impulse.iter().all(|g| g.is_finite()), "{name} N {size:e} {start:e}: {impulse:?}");
            }
        }
    }
}

/// Walls that close on a ball, contacts between immovable bodies.
fn without_solution() -> [Ccp; 3] {
    let wedged = {
        // The ball's normal velocities towards two walls are opposite.
        let block = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let across = [-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let matrix =
            BlockMatrix3::from_rows(vec![0, 2, 4], vec![0, 1, 0, 1], vec![block, across, across, block]);
        Ccp::new(Delassus::Sparse(matrix), vec![-1.0, 0.1, 0.0, -1.0, 0.1, 0.0], vec![0.5; 2]).unwrap()
    };
    let nothing_moves = diagonal(&[[0.0; 3]], &[-1.0, 0.3, 0.1], &[0.5]);
    let one_moves = diagonal(&[[0.0; 3], [1.0; 3]], &[-1.0, 0.3, 0.1, -1.0, 0.2, 0.1], &[0.5; 2]);
    [wedged, nothing_moves, one_moves]
}

/// Where the relaxed problem has no solution, or the solve is stopped, a finish changes nothing.
#[test]
fn a_finish_that_leads_nowhere_keeps_the_best_impulses() {
    for (case, problem) in without_solution().iter().enumerate() {
        for stop in [false, true] {
            let solve = |finish| {
                let settings = SolveSettings {
                    friction: FrictionModel::Coulomb,
                    max_iterations: Some(5),
                    finish,
                    stop: stop.then(|| Arc::new(AtomicBool::new(true))),
                    ..Default::default()
                };
                let mut impulse = vec![0.0; problem.r.len()];
                let mut solver = "auto".parse::<SolverSpec>().unwrap().build().unwrap();
                let report = solver.solve(problem, &mut impulse, &settings).unwrap();
                assert!(!report.converged(), "case {case}: {report:?}");
                assert_eq!(stop, report.status == Status::Stopped, "case {case}: {report:?}");
                (impulse, report.residual.max)
            };
            assert_eq!(solve(0), solve(90_000), "case {case}, stop {stop}");
        }
    }
}

/// The objective has no lower bound.
#[test]
fn interior_points_say_that_there_is_no_solution() {
    for (case, problem) in without_solution().iter().enumerate() {
        for name in ["pdip", "ipm+cholesky", "scip"] {
            let mut impulse = vec![0.0; problem.r.len()];
            let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
            let report = solver.solve(problem, &mut impulse, &SolveSettings::default()).unwrap();
            assert_eq!(report.status, Status::Infeasible, "{name}, case {case}: {report:?}");
            assert!(report.objective.abs() < 1e12, "{name}, case {case}: {}", report.objective);
        }
    }
}

#[test]
fn a_solver_ends_where_rounding_keeps_it_from_the_tolerance() {
    let problem = diagonal(&[[2.0, 3.0, 3.0], [1.0; 3]], &[-1.0, 0.3, 0.0, -1.0, 0.0, 0.2], &[0.3, 0.5]);
    let settings = SolveSettings { tolerance: 1e-17, ..SolveSettings::default() };
    let mut impulse = [0.0; 6];
    let mut solver = "pdip".parse::<SolverSpec>().unwrap().build().unwrap();
    let report = solver.solve(&problem, &mut impulse, &settings).unwrap();
    assert!(report.status == Status::Stalled && report.iterations < 200, "{report:?}");
    // One matrix per iteration, however often the linear tolerance is tightened; the last may have led
    // nowhere.
    assert!(report.newton.len() - report.iterations <= 1);
}

/// Refuses every matrix.
struct Refuses(NewtonError);

impl NewtonSolver for Refuses {
    fn name(&self) -> &'static str {
        "refuses"
    }

    fn needs_matrix(&self) -> bool {
        false
    }

    fn refresh(&mut self, _: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        Err(self.0.clone())
    }

    fn solve(&mut self, _: &NewtonSystem<'_>, _: &[f64], _: &mut [f64], _: f64) -> LinearReport {
        unreachable!("it was never ready")
    }
}

#[test]
fn the_reason_why_a_linear_solver_gives_up_is_reported() {
    let problem = diagonal(&[[2.0, 3.0, 3.0]], &[-1.0, 0.3, 0.0], &[0.3]);
    let solve = |error: NewtonError| {
        let mut solver = Pdip::with_solver(Rule::Central, Box::new(Refuses(error)));
        solver.solve(&problem, &mut [0.0; 3], &SolveSettings::default())
    };
    let report = solve(NewtonError::Breakdown { solver: "refuses", reason: "pivot 7".to_string() }).unwrap();
    assert_eq!(report.status, Status::Stalled);
    assert!(report.remark.unwrap().contains("pivot 7"));
    let error = solve(NewtonError::Unsupported { solver: "refuses", reason: "no bodies" }).unwrap_err();
    assert!(matches!(&error, CcpError::Unsupported { reason, .. } if reason == "no bodies"), "{error}");
    for method in ["pdip", "ipm", "scip"] {
        let mut solver = format!("{method}+body-cg").parse::<SolverSpec>().unwrap().build().unwrap();
        let answer = solver.solve(&problem, &mut [0.0; 3], &SolveSettings::default());
        assert!(matches!(answer, Err(CcpError::Unsupported { .. })), "{method}: {answer:?}");
    }
}
