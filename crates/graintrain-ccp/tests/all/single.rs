//! Large problems are begun in single precision: what comes out must be what double precision finds.

use crate::common::{Random, lattice_packing};
use graintrain_ccp::residual::{Criterion, FrictionModel, ResidualScale};
use graintrain_ccp::{Ccp, Delassus, RigidDelassus, SolveReport, SolveSettings, SolverSpec};
use std::sync::Arc;

/// Below this a maximum is beyond single precision, and at it not.
const LEAST: f64 = 1e-3;

fn solve(problem: &Ccp, start: &[f64], settings: &SolveSettings) -> (Vec<f64>, SolveReport) {
    solve_by("apgd", problem, start, settings)
}

fn solve_by(solver: &str, problem: &Ccp, start: &[f64], settings: &SolveSettings) -> (Vec<f64>, SolveReport) {
    let mut solver = solver.parse::<SolverSpec>().unwrap().build().unwrap();
    let mut g = start.to_vec();
    let report = solver.solve(problem, &mut g, settings).unwrap();
    (g, report)
}

/// The packing with other masses, and with arms that leave the normals by this fraction of their length.
fn changed(problem: &Ccp, mass: impl Fn(usize) -> f64, off: f64) -> Ccp {
    let Delassus::Rigid(rigid) = &*problem.delassus else { unreachable!("the packing has bodies") };
    let mut random = Random::new(11);
    let mut contacts = rigid.contacts().to_vec();
    for contact in &mut contacts {
        for arm in [&mut contact.arm_a, &mut contact.arm_b] {
            let length = arm.iter().map(|x| x * x).sum::<f64>().sqrt();
            for x in arm {
                *x += off * length * random.signed();
            }
        }
    }
    let mut masses = rigid.inverse_mass().to_vec();
    for (body, own) in masses.iter_mut().enumerate() {
        own.linear = own.linear.map(|m| m / mass(body));
        own.angular = own.angular.map(|m| m / mass(body));
        if off > 0.0 {
            // A slender body, turned: 1 + a a^T.
            let a: [f64; 3] = std::array::from_fn(|_| random.signed());
            let size = own.angular[0];
            for (k, entry) in own.angular.iter_mut().enumerate() {
                *entry += size * a[k / 3] * a[k % 3];
            }
        }
    }
    let delassus = Arc::new(Delassus::Rigid(RigidDelassus::new(contacts, masses)));
    Ccp { delassus, ..problem.clone() }
}

/// The residual at this tolerance is reached in about as many iterations as double precision takes, and it is
/// the truth.
fn check(name: &str, problem: &Ccp) {
    for (friction, criterion, tolerance) in [
        (FrictionModel::Relaxed, Criterion::Maximum, LEAST),
        (FrictionModel::Relaxed, Criterion::Mixed, LEAST),
        (FrictionModel::Relaxed, Criterion::Mixed, 3e-5),
        (FrictionModel::Coulomb, Criterion::Mixed, LEAST),
    ] {
        let settings = SolveSettings { tolerance, criterion, friction, ..SolveSettings::default() };
        for solver in ["apgd", "apgs"] {
            let (g, report) = solve_by(solver, problem, &vec![0.0; problem.r.len()], &settings);
            assert!(
                report.converged(),
                "{name}, {solver}, {friction:?}, {criterion:?}, {tolerance:e}: {report:?}"
            );
            let mut u = vec![0.0; g.len()];
            problem.delassus.multiply(&g, &mut u, &mut problem.delassus.work());
            for (u, r) in u.iter_mut().zip(&problem.r) {
                *u += r;
            }
            let truth = ResidualScale::new(problem).residual(problem, &g, &u, friction);
            assert!(truth.measured(criterion) <= tolerance, "{name}: {truth:?}");
        }
    }
    // A hair's breadth below, all of it is done in double precision.
    let iterations = [LEAST, 0.999 * LEAST].map(|tolerance| {
        let settings = SolveSettings { tolerance, ..SolveSettings::default() };
        solve(problem, &vec![0.0; problem.r.len()], &settings).1.iterations
    });
    assert!(iterations[0] <= iterations[1] + iterations[1] / 4 + 30, "{name}: {iterations:?}");
}

#[test]
fn packings_of_balls_are_solved() {
    let problem = lattice_packing(7, 5, 0.3, 1);
    assert!(problem.num_contacts() > 256);
    check("balls", &problem);
}

#[test]
fn contacts_off_the_normal_and_turned_inertias_are_solved() {
    check("others", &changed(&lattice_packing(7, 5, 0.3, 2), |_| 1.0, 0.3));
}

/// Sweeps in blocks, which threads share, find what gradients find, with the bits of one thread.
#[test]
fn threads_share_sweeps() {
    for problem in [lattice_packing(16, 14, 0.3, 5), changed(&lattice_packing(16, 14, 0.3, 6), |_| 1.0, 0.3)]
    {
        assert!(problem.num_contacts() > 2 * 4096, "several blocks");
        let settings = SolveSettings {
            tolerance: LEAST,
            criterion: Criterion::Mixed,
            friction: FrictionModel::Coulomb,
            ..SolveSettings::default()
        };
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| solve_by("apgs", &problem, &vec![0.0; problem.r.len()], &settings))
        };
        let (one, report) = on(1);
        assert!(report.converged(), "{report:?}");
        let bits = |g: &[f64]| g.iter().map(|g| g.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&one), bits(&on(3).0));
        let by_gradients = solve(&problem, &vec![0.0; problem.r.len()], &settings).1;
        assert!(
            report.iterations < by_gradients.iterations,
            "{} {}",
            report.iterations,
            by_gradients.iterations
        );
    }
}

/// Where single precision cannot tell any more, double precision ends the solve.
#[test]
fn mixed_masses_are_solved() {
    let problem = lattice_packing(6, 4, 0.3, 3);
    for ratio in [1e3, 1e6] {
        let mixed = changed(&problem, |body| if body % 3 == 0 { ratio } else { 1.0 }, 0.0);
        let settings =
            SolveSettings { tolerance: LEAST, criterion: Criterion::Mixed, ..SolveSettings::default() };
        let (_, report) = solve(&mixed, &vec![0.0; mixed.r.len()], &settings);
        assert!(report.converged(), "{ratio:e}: {report:?}");
    }
}

/// Masses and lengths of dust and of planets.
#[test]
fn units_do_not_matter() {
    let problem = lattice_packing(6, 4, 0.3, 4);
    let settings =
        SolveSettings { tolerance: LEAST, criterion: Criterion::Mixed, ..SolveSettings::default() };
    let own = solve(&problem, &vec![0.0; problem.r.len()], &settings).1;
    for mass in [1e-30, 1e30] {
        let scaled = changed(&problem, |_| mass, 0.0);
        let report = solve(&scaled, &vec![0.0; problem.r.len()], &settings).1;
        assert!(report.converged(), "{mass:e}: {report:?}");
        assert!(report.iterations.abs_diff(own.iterations) <= 3, "{} {}", report.iterations, own.iterations);
    }
}

/// Where nothing has moved nothing is packed and no product is made: the impulses stay as they were, bit by
/// bit.
#[test]
fn a_start_that_solves_the_problem_is_handed_back() {
    let problem = lattice_packing(8, 6, 0.3, 6);
    for criterion in [Criterion::Mixed, Criterion::Maximum] {
        let tolerance = if criterion == Criterion::Maximum { LEAST.max(1e-3) } else { LEAST };
        let settings = SolveSettings { tolerance, criterion, ..SolveSettings::default() };
        let (g, cold) = solve(&problem, &vec![0.0; problem.r.len()], &settings);
        assert!(cold.converged() && cold.iterations > 20, "{criterion:?}: {cold:?}");
        let settings = SolveSettings { curvature: cold.curvature, ..settings };
        let (again, report) = solve(&problem, &g, &settings);
        assert!(report.converged(), "{report:?}");
        assert_eq!((report.iterations, report.products, report.history.len()), (0, 0, 1));
        assert_eq!(report.curvature, cold.curvature);
        assert!(g.iter().zip(&again).all(|(g, again)| g.to_bits() == again.to_bits()));
        // A start that is a little off is none.
        let off: Vec<f64> = g.iter().map(|g| 0.9 * g).collect();
        assert!(solve(&problem, &off, &settings).1.iterations > 0);
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let problem = lattice_packing(12, 8, 0.3, 5);
    let settings =
        SolveSettings { tolerance: LEAST, criterion: Criterion::Mixed, ..SolveSettings::default() };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (g, report) = pool.install(|| solve(&problem, &vec![0.0; problem.r.len()], &settings));
        (g.iter().map(|g| g.to_bits()).collect::<Vec<_>>(), report.iterations, report.curvature)
    };
    let one = on(1);
    assert!(one.2.is_some());
    for threads in [2, 3, 4] {
        assert_eq!(on(threads), one, "{threads} threads");
    }
}

/// A start that is good enough costs no iteration, and a solve that knows the curvature of the last one none
/// for the power iterations.
#[test]
fn what_is_known_is_not_found_again() {
    let problem = lattice_packing(7, 5, 0.3, 6);
    let settings =
        SolveSettings { tolerance: LEAST, criterion: Criterion::Mixed, ..SolveSettings::default() };
    let (g, cold) = solve(&problem, &vec![0.0; problem.r.len()], &settings);
    let again = SolveSettings { curvature: cold.curvature, ..settings.clone() };
    let (_, warm) = solve(&problem, &g, &again);
    assert!(warm.converged() && warm.iterations == 0 && warm.products == 0, "{warm:?}");
    let (_, known) = solve(&problem, &vec![0.0; problem.r.len()], &again);
    assert!(known.converged() && known.products == known.iterations, "{known:?}");
    assert!(cold.products > cold.iterations);
    for nonsense in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let settings = SolveSettings { curvature: Some(nonsense), ..settings.clone() };
        let (_, report) = solve(&problem, &vec![0.0; problem.r.len()], &settings);
        assert!(report.converged(), "{nonsense}: {report:?}");
    }
    for strange in [1e-6, 1e6] {
        let settings = SolveSettings { curvature: Some(strange), ..settings.clone() };
        let (_, report) = solve(&problem, &vec![0.0; problem.r.len()], &settings);
        assert!(report.converged(), "{strange}: {report:?}");
    }
}
