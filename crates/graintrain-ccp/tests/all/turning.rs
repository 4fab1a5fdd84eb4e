//! Contacts that resist turning: rolling and spinning friction, against the laws themselves, against Clarabel
//! and against the problem without them.

use crate::common::{lattice_packing, random_problem, sparse_form, with_turning};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SupportedConeT};
use graintrain_ccp::{Ccp, CcpError, FrictionModel, SolveReport, SolveSettings, SolverSpec};

fn solve(problem: &Ccp, name: &str, friction: FrictionModel, tolerance: f64) -> (Vec<f64>, SolveReport) {
    let mut g = vec![0.0; problem.r.len()];
    let settings = SolveSettings { tolerance, friction, ..SolveSettings::default() };
    let report =
        name.parse::<SolverSpec>().unwrap().build().unwrap().solve(problem, &mut g, &settings).unwrap();
    (g, report)
}

fn velocity(problem: &Ccp, g: &[f64]) -> Vec<f64> {
    let mut u = vec![0.0; g.len()];
    problem.delassus.multiply(g, &mut u, &mut problem.delassus.work());
    u.iter().zip(&problem.r).map(|(u, r)| u + r).collect()
}

/// How far impulses are from the law of each contact, written out part by part without cones or projections,
/// in velocities (m/s): impulses count times eta.
fn violation(problem: &Ccp, g: &[f64], friction: FrictionModel) -> f64 {
    let (u, eta, contacts) = (velocity(problem, g), problem.diagonal_scale(), problem.num_contacts());
    let mut worst = 0.0_f64;
    for i in 0..contacts {
        let mut parts = vec![(problem.friction[i], vec![3 * i + 1, 3 * i + 2])];
        if let Some(k) = problem.turning_of(i) {
            let first = 3 * (contacts + k);
            let own = problem.turning[k];
            parts.extend([(own.rolling, vec![first + 1, first + 2]), (own.spinning, vec![first])]);
        }
        let normal = g[3 * i];
        let mut opening = u[3 * i];
        for (coefficient, places) in parts {
            let (impulse, slip): (Vec<f64>, Vec<f64>) = places.iter().map(|&k| (g[k], u[k])).unzip();
            let length = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
            let (limit, speed) = (coefficient * normal, length(&slip));
            worst = worst.max(eta[i] * (length(&impulse) - limit));
            // Dissipation is as large as it can be: impulse . slip = -limit |slip|.
            let lost: f64 = impulse.iter().zip(&slip).map(|(g, u)| g * u).sum();
            let short = (lost + limit * speed) * eta[i];
            worst = worst.max(short / (speed + eta[i] * limit).max(1e-300));
            if friction == FrictionModel::Relaxed {
                opening -= coefficient * speed;
            }
        }
        worst = worst.max(-opening).max(-eta[i] * normal).max((eta[i] * normal).min(opening));
    }
    worst
}

/// Optimum of the relaxed problem by Clarabel: three second-order cones per contact over one normal impulse.
fn clarabel_objective(problem: &Ccp) -> f64 {
    let size = problem.r.len();
    let matrix = problem.delassus.assemble();
    let (mut start, mut row, mut value) = (vec![0], Vec::new(), Vec::new());
    for column in 0..size {
        let (blocks, entries) = matrix.row(column / 3);
        for (&j, block) in blocks.iter().zip(entries) {
            for k in (0..3).filter(|k| 3 * j as usize + k <= column) {
                row.push(3 * j as usize + k);
                value.push(block[3 * (column % 3) + k]);
            }
        }
        start.push(row.len());
    }
    let p = CscMatrix::new(size, size, start, row, value);
    let (mut cones, mut entries, mut line) = (Vec::new(), Vec::new(), 0);
    for i in 0..problem.num_contacts() {
        let mut cone = |coefficient: f64, places: &[usize]| {
            entries.push((line, 3 * i, -coefficient));
            entries.extend(places.iter().enumerate().map(|(k, &place)| (line + 1 + k, place, -1.0)));
            cones.push(SupportedConeT::SecondOrderConeT(1 + places.len()));
            line += 1 + places.len();
        };
        cone(1.0, &[]);
        cone(problem.friction[i], &[3 * i + 1, 3 * i + 2]);
        if let Some(k) = problem.turning_of(i) {
            let first = 3 * (problem.num_contacts() + k);
            cone(problem.turning[k].rolling, &[first + 1, first + 2]);
            cone(problem.turning[k].spinning, &[first]);
        }
    }
    let (rows, (columns, values)): (Vec<_>, (Vec<_>, Vec<_>)) =
        entries.into_iter().map(|(row, column, value)| (row, (column, value))).unzip();
    let a = CscMatrix::new_from_triplets(line, size, rows, columns, values);
    let settings = DefaultSettingsBuilder::default().verbose(false).max_iter(200).build().unwrap();
    let mut solver = DefaultSolver::new(&p, &problem.r, &a, &vec![0.0; line], &cones, settings).unwrap();
    solver.solve();
    solver.solution.obj_val
}

const BOTH: [FrictionModel; 2] = [FrictionModel::Relaxed, FrictionModel::Coulomb];

/// Random bodies of very different masses, redundant contacts, and a packing of more contacts than a chunk of
/// batches holds.
fn problems() -> Vec<Ccp> {
    let mut problems: Vec<Ccp> = (0..14).map(|seed| with_turning(&random_problem(seed), seed)).collect();
    problems.push(with_turning(&lattice_packing(7, 6, 0.3, 1), 1));
    problems
}

#[test]
fn impulses_obey_the_laws_of_sliding_rolling_and_spinning() {
    let (problems, mut solved) = (problems(), [0; 2]);
    for (number, problem) in problems.iter().enumerate() {
        problem.validate().unwrap();
        for (friction, solved) in BOTH.into_iter().zip(&mut solved) {
            for form in [problem.clone(), sparse_form(problem)] {
                let (g, report) = solve(&form, "auto", friction, 1e-6);
                let v = graintrain_ccp::residual::velocity_scale(problem);
                let found = violation(problem, &g, friction) / v;
                // Problems over masses of 1e6 to 1 need not be solved; they must say so.
                assert!(report.converged() || number + 1 < problems.len(), "{number} {friction}: {report:?}");
                if report.converged() {
                    *solved += 1;
                    assert!(found < 1e-4, "{number} {friction}: {found:e} at residual {:?}", report.residual);
                }
            }
        }
    }
    assert!(solved.iter().all(|&solved| solved * 10 >= 2 * problems.len() * 9), "{solved:?}");
}

#[test]
fn every_method_that_takes_turning_finds_the_same_motion() {
    for problem in problems().into_iter().take(4) {
        for friction in BOTH {
            let (expected, report) = solve(&problem, "auto", friction, 1e-7);
            if !report.converged() {
                continue;
            }
            for name in ["apgd", "apgs", "pgs", "pgs@1.3", "pj"] {
                assert!(name.parse::<SolverSpec>().unwrap().build().unwrap().capabilities().turning);
                let (g, other) = solve(&problem, name, friction, 1e-7);
                if !other.converged() {
                    continue;
                }
                // Exact friction may have several solutions; the relaxed problem has one motion.
                if friction == FrictionModel::Relaxed {
                    let (a, b) = (velocity(&problem, &g), velocity(&problem, &expected));
                    let size = b.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
                    let apart = a.iter().zip(&b).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
                    assert!(apart < 1e-3 * size, "{name}: {apart:e} of {size:e}");
                }
                let v = graintrain_ccp::residual::velocity_scale(&problem);
                assert!(violation(&problem, &g, friction) < 1e-4 * v, "{name} {friction}");
            }
        }
    }
}

#[test]
fn the_objective_is_that_of_clarabel() {
    let mut compared = 0;
    for problem in problems() {
        let (_, report) = solve(&problem, "auto", FrictionModel::Relaxed, 1e-8);
        if !report.converged() {
            continue;
        }
        let expected = clarabel_objective(&problem);
        let apart = (report.objective - expected).abs();
        assert!(apart < 1e-4 * expected.abs().max(1e-6), "{:e} {expected:e}", report.objective);
        compared += 1;
    }
    assert!(compared > 12, "{compared}");
}

/// Coefficients of zero leave the turning rows without impulse, and the rest as it is without them.
#[test]
fn without_coefficients_nothing_resists_turning() {
    let plain = lattice_packing(5, 4, 0.3, 2);
    let mut problem = with_turning(&plain, 3);
    for turning in &mut problem.turning {
        (turning.rolling, turning.spinning) = (0.0, 0.0);
    }
    let plain = Ccp { r: problem.r[..plain.r.len()].to_vec(), ..plain };
    for friction in BOTH {
        let (g, report) = solve(&problem, "apgd", friction, 1e-8);
        let (expected, other) = solve(&plain, "apgd", friction, 1e-8);
        assert!(report.converged() && other.converged());
        assert!(g[plain.r.len()..].iter().all(|&h| h == 0.0));
        let (a, b) = (velocity(&problem, &g), velocity(&plain, &expected));
        for (a, b) in a.iter().zip(&b) {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
    }
}

#[test]
fn two_threads_compute_the_bits_of_one() {
    let problem = with_turning(&lattice_packing(7, 6, 0.3, 1), 1);
    for (name, limit) in [("apgd", 200), ("apgs", 60), ("pgs", 60), ("auto", 300)] {
        for friction in BOTH {
            let settings = SolveSettings {
                tolerance: 1e-9,
                max_iterations: Some(limit),
                friction,
                ..SolveSettings::default()
            };
            let of = |threads| {
                rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
                    let mut g = vec![0.0; problem.r.len()];
                    let mut solver = name.parse::<SolverSpec>().unwrap().build().unwrap();
                    solver.solve(&problem, &mut g, &settings).unwrap();
                    g.iter().map(|g| g.to_bits()).collect::<Vec<_>>()
                })
            };
            assert!(of(1) == of(2), "{name} {friction}");
        }
    }
}

#[test]
fn solvers_without_the_cone_refuse_and_name_those_that_have_it() {
    let problem = with_turning(&lattice_packing(2, 2, 0.3, 2), 3);
    for name in ["ipm", "ipm+ic", "path", "scip", "pdip", "bb", "kucera", "spg", "gpminres"] {
        for friction in BOTH {
            let mut g = vec![0.0; problem.r.len()];
            let spec = name.parse::<SolverSpec>().unwrap();
            assert!(!spec.build().unwrap().capabilities().turning);
            let mut solver = spec.build().unwrap();
            let settings = SolveSettings { friction, ..SolveSettings::default() };
            match solver.solve(&problem, &mut g, &settings) {
                Err(error @ CcpError::Unsupported { .. }) => {
                    assert!(error.to_string().contains("apgd"), "{error}")
                }
                other => panic!("{name}: {other:?}"),
            }
        }
    }
}

#[test]
fn problems_whose_parts_do_not_fit_are_refused() {
    let problem = with_turning(&lattice_packing(2, 2, 0.3, 2), 3);
    let wrong = |change: &dyn Fn(&mut Ccp)| {
        let mut problem = problem.clone();
        change(&mut problem);
        problem.validate().unwrap_err().to_string()
    };
    assert!(wrong(&|p| p.turning[0].rolling = -1.0).contains("rolling friction"));
    assert!(wrong(&|p| p.turning[0].spinning = f64::NAN).contains("spinning friction"));
    assert!(wrong(&|p| p.turning[1].contact = p.turning[0].contact).contains("ascend"));
    assert!(wrong(&|p| p.turning[0].contact = 1000).contains("turning contact"));
    assert!(wrong(&|p| p.turning.clear()).contains("friction"));
    assert!(
        wrong(&|p| {
            p.r.pop();
        })
        .contains("r has")
    );
}
