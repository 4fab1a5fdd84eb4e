//! The accuracy measure: every contact by its own effective mass, the same inside a solver as in its report.

use crate::common::{Random, lattice_packing, random_problem, sparse_form};
use graintrain_ccp::registry::Method;
use graintrain_ccp::residual::{MIXED_MAXIMUM, ResidualScale};
use graintrain_ccp::solver::scaling::ScaledProblem;
use graintrain_ccp::{BodyInverseMass, Ccp, Delassus, FIXED, RigidContact, RigidDelassus};
use graintrain_ccp::{Criterion, FrictionModel, Residual, SolveReport, SolveSettings, SolverSpec, Status};
use std::sync::Arc;

const MODELS: [FrictionModel; 2] = [FrictionModel::Relaxed, FrictionModel::Coulomb];

fn bodies(problem: &Ccp) -> &RigidDelassus {
    match &*problem.delassus {
        Delassus::Rigid(rigid) => rigid,
        Delassus::Sparse(_) => unreachable!("the generators make bodies"),
    }
}

/// The problem with every mass times a factor of its own; r stays.
fn with_masses(problem: &Ccp, factor: impl Fn(usize) -> f64) -> Ccp {
    let masses = bodies(problem).inverse_mass().iter().enumerate();
    let masses = masses.map(|(b, m)| BodyInverseMass {
        linear: m.linear.map(|x| x / factor(b)),
        angular: m.angular.map(|x| x / factor(b)),
    });
    let rigid = RigidDelassus::new(bodies(problem).contacts().to_vec(), masses.collect());
    Ccp { delassus: Arc::new(Delassus::Rigid(rigid)), ..problem.clone() }
}

/// Both problems in one, without a body in common.
fn beside(first: &Ccp, second: &Ccp) -> Ccp {
    let shift = bodies(first).num_bodies() as u32;
    let moved = |body: u32| if body == FIXED { FIXED } else { body + shift };
    let others = bodies(second).contacts().iter().map(|c| RigidContact {
        body_a: moved(c.body_a),
        body_b: moved(c.body_b),
        ..*c
    });
    let contacts = bodies(first).contacts().iter().copied().chain(others).collect();
    let masses = [bodies(first).inverse_mass(), bodies(second).inverse_mass()].concat();
    Ccp {
        delassus: Arc::new(Delassus::Rigid(RigidDelassus::new(contacts, masses))),
        r: [&first.r[..], &second.r[..]].concat(),
        friction: [&first.friction[..], &second.friction[..]].concat(),
        points: vec![],
        identity: vec![],
        ..first.clone()
    }
}

fn residual(problem: &Ccp, g: &[f64], model: FrictionModel) -> Residual {
    let mut u = vec![0.0; g.len()];
    problem.delassus.multiply(g, &mut u, &mut problem.delassus.work());
    u.iter_mut().zip(&problem.r).for_each(|(u, r)| *u += r);
    ResidualScale::new(problem).residual(problem, g, &u, model)
}

fn solve(name: &str, problem: &Ccp, g: &mut [f64], settings: &SolveSettings) -> SolveReport {
    name.parse::<SolverSpec>().unwrap().build().unwrap().solve(problem, g, settings).unwrap()
}

fn assert_close(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!(
        (found - expected).abs() <= tolerance * expected.abs(),
        "{what}: {found:e}, expected {expected:e}"
    );
}

/// Impulses on their way to a solution.
fn unfinished(problem: &Ccp) -> Vec<f64> {
    let mut g = vec![0.0; problem.r.len()];
    solve("apgd", problem, &mut g, &SolveSettings { max_iterations: Some(20), ..SolveSettings::default() });
    g
}

/// Grains beside blocks a million times heavier that they never touch. Before, the blocks' mass was in the
/// unit of every contact: the light part passed for solved with errors 5e5 times the tolerance.
#[test]
fn heavy_bodies_elsewhere_do_not_change_the_verdict_on_light_ones() {
    let light = lattice_packing(4, 3, 0.3, 1);
    let heavy = with_masses(&lattice_packing(3, 3, 0.3, 2), |_| 1e6);
    let both = beside(&light, &heavy);
    let contacts = light.num_contacts();

    // The heavy part left alone: its r of zero is solved by no impulses.
    let mut at_rest = both.clone();
    at_rest.r[3 * contacts..].fill(0.0);
    let g = unfinished(&light);
    let mut all = vec![0.0; both.r.len()];
    all[..g.len()].copy_from_slice(&g);
    for model in MODELS {
        let (alone, beside) = (residual(&light, &g, model), residual(&at_rest, &all, model));
        assert!(alone.max > 1e-3);
        assert_eq!(beside.max, alone.max);
        let share = (contacts as f64 / both.num_contacts() as f64).sqrt();
        assert_close(beside.rms, share * alone.rms, 1e-12, "rms");
    }

    // Whoever claims a tolerance of both has reached it in the light part alone.
    for name in ["apgd", "apgs", "bb", "pgs", "ipm", "scip", "auto"] {
        for form in [both.clone(), sparse_form(&both)] {
            let settings = SolveSettings { tolerance: 1e-5, ..SolveSettings::default() };
            let mut g = vec![0.0; form.r.len()];
            let report = solve(name, &form, &mut g, &settings);
            assert!(report.converged(), "{name}: {report:?}");
            let alone = residual(&light, &g[..3 * contacts], FrictionModel::Relaxed).max;
            assert!(alone <= 1.001e-5, "{name}: {alone:e}");
        }
    }
}

#[test]
fn the_unit_of_mass_leaves_the_residual_as_it_is() {
    for seed in 0..4 {
        for problem in [random_problem(seed), lattice_packing(3, 3, 0.3, seed)] {
            let g = unfinished(&problem);
            for factor in [1e-6, 1e9] {
                let other = with_masses(&problem, |_| factor);
                let scaled: Vec<f64> = g.iter().map(|g| factor * g).collect();
                for model in MODELS {
                    let (found, expected) = (residual(&other, &scaled, model), residual(&problem, &g, model));
                    assert_close(found.max, expected.max, 1e-9, &format!("{seed}, {factor:e}"));
                    assert_close(found.rms, expected.rms, 1e-9, &format!("{seed}, {factor:e}"));
                }
            }
        }
    }
}

/// One contact of effective mass 1/2 that approaches with 3 m/s and is stopped half way, with V given, from
/// r, and none.
#[test]
fn the_residual_is_the_error_as_a_velocity_over_v() {
    let identity = [2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0];
    let matrix = graintrain_linalg::block3::BlockMatrix3::from_rows(vec![0, 1], vec![0], vec![identity]);
    let bare = Ccp::new(Delassus::Sparse(matrix), vec![-3.0, 0.0, 0.0], vec![0.5]).unwrap();
    let half = [0.75, 0.0, 0.0];
    let given = Ccp { velocity_scale: Some(0.25), ..bare.clone() };
    let without = Ccp { velocity_scale: Some(0.0), ..bare.clone() };
    for (problem, expected) in [(&bare, 0.5), (&given, 6.0), (&without, 1.5)] {
        let found = residual(problem, &half, FrictionModel::Relaxed);
        assert_close(found.max, expected, 1e-14, "max");
        assert_close(found.rms, expected, 1e-14, "rms");
    }
    let nothing = Ccp { r: vec![0.0; 3], ..bare };
    assert_eq!(residual(&nothing, &[0.0; 3], FrictionModel::Relaxed).max, 0.0);
}

#[test]
fn the_number_that_is_compared() {
    let of = |max: f64, rms: f64, criterion| Residual { max, rms }.measured(criterion);
    assert_eq!(of(3.0, 1.0, Criterion::Maximum), 3.0);
    assert_eq!(of(3.0, 1.0, Criterion::Mixed), 1.0);
    assert_eq!(of(60.0, 1.0, Criterion::Mixed), 60.0 / MIXED_MAXIMUM);
    for criterion in [Criterion::Maximum, Criterion::Mixed] {
        assert!(of(f64::NAN, f64::NAN, criterion).is_nan() && of(f64::NAN, 1.0, criterion).is_nan());
        assert_eq!(of(f64::INFINITY, f64::INFINITY, criterion), f64::INFINITY);
    }
    assert!(of(1.0, f64::NAN, Criterion::Mixed).is_nan());
}

/// Problems with masses from a gram to a ton, with a V of their own and bare, over bodies and over rows.
fn uneven_problems() -> Vec<Ccp> {
    let mut all = Vec::new();
    for seed in 0..3 {
        let mut random = Random::new(seed);
        let factors: Vec<f64> = (0..200).map(|_| 10.0_f64.powf(3.0 * random.signed())).collect();
        let packing = with_masses(&lattice_packing(4, 3, 0.3, seed), |b| factors[b % 200]);
        let bare = Ccp { velocity_scale: None, ..packing.clone() };
        all.extend([sparse_form(&packing), bare, packing]);
    }
    all
}

/// The residual of the scaled problem, in its own units and order, is that of the impulses themselves.
#[test]
fn first_order_methods_measure_as_the_report_does() {
    for problem in uneven_problems() {
        let g = unfinished(&problem);
        let mut scaled = ScaledProblem::new(&problem, &ResidualScale::new(&problem));
        let (mut x, mut image, mut work) = (scaled.zeros(), scaled.zero_image(), scaled.work());
        let mut gradient = scaled.zeros();
        scaled.pack(&g, &mut x);
        scaled.image_of(&mut x, &mut image, &mut work);
        for model in MODELS {
            scaled.set_friction_model(model);
            let expected = residual(&problem, &g, model);
            let found = scaled.residual(&mut x, &image, &mut work);
            scaled.gradient(&image, &mut gradient, &mut work);
            let given = scaled.residual_given(&mut x, &mut gradient, &mut work);
            for found in [found, given] {
                assert_close(found.max, expected.max, 1e-9, "max");
                assert_close(found.rms, expected.rms, 1e-9, "rms");
            }
        }
    }
}

/// A solver that is asked for a hair more than the best residual of its first iterations stops among them,
/// and one that is asked for a hair less goes on to its limit: what it measures inside is what its report
/// says.
#[test]
fn every_solver_measures_inside_as_its_report_does() {
    const HAIR: f64 = 1e-6;
    let linear = ["ipm+cholesky", "scip+block-jacobi", "pdip+ilu"];
    for (k, problem) in uneven_problems().iter().enumerate() {
        // `auto` begins with another member where it is asked for less.
        let alone = Method::available().map(Method::name).filter(|name| *name != "auto");
        for name in alone.chain(linear) {
            for criterion in [Criterion::Maximum, Criterion::Mixed] {
                let is_newton = ["ipm", "scip", "pdip"].iter().any(|newton| name.starts_with(newton));
                let iterations = if is_newton { 4 } else { 40 };
                let run = |tolerance, limit| {
                    let settings = SolveSettings {
                        tolerance,
                        criterion,
                        max_iterations: Some(limit),
                        ..SolveSettings::default()
                    };
                    let report = solve(name, problem, &mut vec![0.0; problem.r.len()], &settings);
                    let measured = report.residual.measured(criterion);
                    (report, measured)
                };
                // The start of `ipm` is of another kind: it ends at 1e-6 whatever is asked for below that.
                let (_, reached) = run(1e-9, iterations);
                if reached < 1e-6 {
                    continue;
                }
                let what = format!("{name} on problem {k}, {criterion:?}");
                let (more, measured) = run(reached * (1.0 + HAIR), 100 * iterations);
                assert_eq!(more.status, Status::Converged, "{what}");
                // `gpminres` looks at its residual at the ends of its phases, and at the limit, where its
                // best iterate may have been.
                let is_early = more.iterations <= iterations || name == "gpminres";
                assert!(is_early, "{what}: {} iterations", more.iterations);
                assert!(measured <= reached * (1.0 + HAIR), "{what}");
                let (less, measured) = run(reached * (1.0 - HAIR), iterations);
                assert_eq!(less.status, Status::IterationLimit, "{what}: {measured:e} after {reached:e}");
            }
        }
    }
}

/// Runs are asked for the root mean square: that costs fewer iterations than the worst contact, and is kept.
#[test]
fn the_mixed_rule_asks_for_the_mean_and_bounds_the_worst() {
    let problem = lattice_packing(8, 6, 0.3, 1);
    for name in ["apgd", "apgs", "pgs", "ipm", "auto", "scip", "pdip"] {
        for friction in MODELS {
            let settings = |criterion| SolveSettings {
                tolerance: 1e-4,
                criterion,
                friction,
                ..SolveSettings::default()
            };
            let run =
                |criterion| solve(name, &problem, &mut vec![0.0; problem.r.len()], &settings(criterion));
            let (mixed, strict) = (run(Criterion::Mixed), run(Criterion::Maximum));
            println!("{name}, {friction:?}: {} iterations, strictly {}", mixed.iterations, strict.iterations);
            if mixed.converged() {
                assert!(
                    mixed.residual.rms <= 1e-4 && mixed.residual.max <= MIXED_MAXIMUM * 1e-4,
                    "{mixed:?}"
                );
            }
            if friction == FrictionModel::Relaxed {
                assert!(mixed.converged() && strict.converged(), "{name}: {mixed:?} {strict:?}");
                assert!(mixed.iterations <= strict.iterations, "{name}");
            }
        }
    }
}
