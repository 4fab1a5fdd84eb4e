//! Exact friction on the public problems, measured by an evaluation written out here.

use super::data;
use graintrain_ccp::{Ccp, FrictionModel, SolveReport, SolveSettings, SolverSpec, Status};
use graintrain_io::problem_file;

/// max_i eta_i |g_i - P(g_i - (u_i + mu |u_t| e_n) / eta_i)| / V with V = sqrt(mean |r_i|^2) where the file
/// has none; u by rows of N.
fn exact_residual(problem: &Ccp, g: &[f64]) -> f64 {
    let n = problem.delassus.assemble();
    let contacts = problem.num_contacts();
    let mean = problem.r.iter().map(|r| r * r).sum::<f64>() / contacts as f64;
    let scale = problem.velocity_scale.unwrap_or(mean.sqrt());
    let mut worst = 0.0_f64;
    for i in 0..contacts {
        let (columns, blocks) = n.row(i);
        let mut u = [problem.r[3 * i], problem.r[3 * i + 1], problem.r[3 * i + 2]];
        for (&j, block) in columns.iter().zip(blocks) {
            for row in 0..3 {
                u[row] += (0..3).map(|c| block[3 * row + c] * g[3 * j as usize + c]).sum::<f64>();
            }
        }
        let own = n.get(i, i);
        let (eta, mu) = ((own[0] + own[4] + own[8]) / 3.0, problem.friction[i]);
        let normal = g[3 * i] - (u[0] + mu * u[1].hypot(u[2])) / eta;
        let tangential = [g[3 * i + 1] - u[1] / eta, g[3 * i + 2] - u[2] / eta];
        let length = tangential[0].hypot(tangential[1]);
        let projected = if length <= mu * normal {
            [normal, tangential[0], tangential[1]]
        } else if mu * length <= -normal {
            [0.0; 3]
        } else {
            let n = (normal + mu * length) / (1.0 + mu * mu);
            [n, mu * n * tangential[0] / length, mu * n * tangential[1] / length]
        };
        let square: f64 = (0..3).map(|k| (g[3 * i + k] - projected[k]).powi(2)).sum();
        worst = worst.max(eta * square.sqrt() / scale);
    }
    worst
}

fn solve(problem: &Ccp, solver: &str, tolerance: f64, friction: FrictionModel) -> (SolveReport, Vec<f64>) {
    let settings = SolveSettings { tolerance, friction, ..SolveSettings::default() };
    let mut g = vec![0.0; 3 * problem.num_contacts()];
    let mut solver = solver.parse::<SolverSpec>().unwrap().build().unwrap();
    let report = solver.solve(problem, &mut g, &settings).unwrap();
    (report, g)
}

/// Contact problems of Siconos's tests, two settled steps, and two problems on which gradients and sweeps had
/// stalled at 3e-5 and 3e-6.
#[test]
fn the_path_reaches_1e_9_on_every_public_problem_but_one() {
    let Some(data) = data() else { return };
    let mut files: Vec<_> =
        ["ccp/sed125.dat", "ccp/sed729.dat", "hard/random-1010.hdf5", "hard/random-3255.hdf5"]
            .iter()
            .map(|name| data.join(name))
            .filter(|path| path.is_file())
            .collect();
    files.extend(std::fs::read_dir(data.join("fclib")).unwrap().map(|entry| entry.unwrap().path()));
    let mut solved = 0;
    for path in files {
        // What is two-dimensional is refused, and what rolls is no problem for the path: both have tests of
        // their own.
        let Ok(file) = problem_file::read(&path) else { continue };
        let problem = file.posed(FrictionModel::Coulomb);
        if !problem.turning.is_empty() {
            continue;
        }
        for solver in ["path", "auto"] {
            let (report, g) = solve(problem, solver, 1e-9, FrictionModel::Coulomb);
            let residual = exact_residual(problem, &g);
            assert!(report.converged(), "{solver}, {}: {:?} {residual:e}", path.display(), report.status);
            assert!(residual <= 1.001e-9, "{solver}, {}: {residual:e}", path.display());
        }
        solved += 1;
    }
    println!("{solved} problems");
    assert!(solved >= 15);
}

/// W of the capsules is not symmetric: exact friction answers for W, the relaxation for its symmetric part,
/// and both say so.
#[test]
fn exact_friction_takes_an_asymmetric_matrix_as_it_is() {
    let Some(data) = data() else { return };
    let file = problem_file::read(&data.join("fclib/Capsules-i100-889.dat")).unwrap();
    let as_filed = file.as_filed.as_ref().unwrap();
    assert!(as_filed.delassus.assemble().asymmetry() > 1e-4);
    assert!(file.problem.delassus.assemble().asymmetry() < 1e-15);
    assert!(std::ptr::eq(file.posed(FrictionModel::Relaxed), &file.problem));
    assert!(file.notes().iter().any(|note| note.contains("exact friction takes it as it is")));
    let (_, g) = solve(as_filed, "auto", 1e-9, FrictionModel::Coulomb);
    assert!(exact_residual(as_filed, &g) < 1.001e-9);
    assert!(exact_residual(&file.problem, &g) > 1e-7, "the two matrices have to make a difference");
}

/// `auto` keeps the proof of `ipm` at tight tolerances, and says what it means.
#[test]
fn a_problem_without_a_solution_is_called_infeasible_at_any_tolerance() {
    let Some(data) = data() else { return };
    let path = data.join("hard/random-2005-infeasible.hdf5");
    if !path.is_file() {
        return;
    }
    let file = problem_file::read(&path).unwrap();
    for tolerance in [1e-4, 1e-6, 1e-8] {
        let (report, _) = solve(&file.problem, "auto", tolerance, FrictionModel::Relaxed);
        assert_eq!(report.status, Status::Infeasible, "{tolerance:e}");
        assert!(report.remark.is_some_and(|remark| remark.contains("proved")));
    }
}
