//! The stored systems of Dolgov and Oseledets (MPI-MIS preprint 19/2011) from TT-Toolbox: operator,
//! right-hand side and solution, with the residuals that the toolbox computes for them.

use graintrain_tt::apply::FullOperator;
use graintrain_tt::inverse::{InverseForm, inverse};
use graintrain_tt::solve::{SolveSettings, SolveStatus, relative_residual, solve};
use graintrain_tt::toolbox::{Stored, read_mat};
use graintrain_tt::{TtMatrix, TtVector};

fn read(name: &str) -> Option<Vec<(String, Stored)>> {
    let file = graintrain_testdata::public_data(&format!("tt/{name}"))?;
    Some(read_mat(&file).unwrap())
}

/// Operator, right-hand side and stored solution.
fn system(file: &str) -> Option<(TtMatrix, TtVector, TtVector)> {
    let (mut a, mut rhs, mut x) = (None, None, None);
    for (name, stored) in read(file)? {
        match (name.to_lowercase().as_str(), stored) {
            ("a", Stored::Matrix(matrix)) => a = Some(matrix),
            ("rhs", Stored::Vector(train)) => rhs = Some(train),
            ("x", Stored::Vector(train)) => x = Some(train),
            other => panic!("{file}: {other:?}"),
        }
    }
    Some((a.unwrap(), rhs.unwrap(), x.unwrap()))
}

#[test]
fn stored_solutions_have_their_residuals() {
    // file, number of cores, rank of A, rank of x, residual of the stored x
    let cases = [
        ("tt-solve_ex2.1_6-8.mat", 24, 4, 46, 2.81e-6),
        ("tt-solve_ex2_6-10.mat", 20, 4, 34, 2.10e-6),
        ("tt-solve_ex3.mat", 64, 6, 64, 8.49e-6),
        ("tt-solve_ex6.mat", 20, 6, 48, 3.12e-4),
    ];
    for (file, d, operator_rank, solution_rank, stored) in cases {
        let Some((a, rhs, x)) = system(file) else { return };
        assert_eq!((a.num_cores(), a.max_rank(), x.max_rank()), (d, operator_rank, solution_rank), "{file}");
        let residual = relative_residual(&a, &x, &rhs, &vec![1; d]).unwrap();
        assert!((residual / stored - 1.0).abs() < 5e-3, "{file}: {residual:e}");
    }
}

/// Solves a system again with default settings and compares with the stored solution, which is itself off by
/// about its residual times the condition number.
fn solve_again(file: &str, stored_error: f64) {
    let Some((a, rhs, x)) = system(file) else { return };
    let settings = SolveSettings { tolerance: 1e-5, ..Default::default() };
    let (found, report) = solve(&a, &rhs, None, &settings).unwrap();
    let distance = found.relative_distance(&x).unwrap();
    println!("{file}: {:?} residual {:e} distance {distance:e}", report.status, report.residual);
    assert_eq!(report.status, SolveStatus::Converged, "{file}: {report:?}");
    let residual = relative_residual(&a, &found, &rhs, &vec![1; a.num_cores()]).unwrap();
    assert!(
        (report.residual / residual - 1.0).abs() < 1e-3 && residual <= 3e-5,
        "{file}: {residual:e} {report:?}"
    );
    assert!(distance < stored_error, "{file}: {distance:e}");
}

#[test]
fn a_stored_system_is_solved_again() {
    solve_again("tt-solve_ex2.1_6-8.mat", 1e-6);
}

/// Symmetric and indefinite with a condition number near 1e6: Krylov methods fail on its local systems, LU
/// does not, and the solver changes over by itself.
#[test]
fn an_indefinite_stored_system_is_solved_again() {
    solve_again("tt-solve_ex2_6-10.mat", 1e-6);
}

#[test]
#[ignore = "ranks to 64 in 64 dimensions: 15 s each without optimisation"]
fn the_other_stored_systems_are_solved_again() {
    solve_again("tt-solve_ex3.mat", 1e-5);
    solve_again("tt-solve_ex6.mat", 1e-2);
}

/// Inverts the stored operators to a tolerance with a cap, and holds the residuals against random full
/// vectors.
fn invert(tolerance: f64, max_rank: usize) {
    for (file, forms) in [
        ("tt-solve_ex2.1_6-8.mat", &[InverseForm::Energy, InverseForm::Residual][..]),
        // Indefinite: the energy has no minimum.
        ("tt-solve_ex2_6-10.mat", &[InverseForm::Residual]),
        ("tt-solve_ex3.mat", &[InverseForm::Energy, InverseForm::Residual]),
        ("tt-solve_ex6.mat", &[InverseForm::Energy]),
    ] {
        let Some((a, ..)) = system(file) else { return };
        for &form in forms {
            let settings = SolveSettings { tolerance, max_rank, ..Default::default() };
            let (x, report) = inverse(&a, form, None, &settings).unwrap();
            println!("{file} {form:?}: {:?} {:e} rank {}", report.status, report.residual, x.max_rank());
            assert_eq!(report.status, SolveStatus::Converged, "{file} {form:?} {report:?}");
            if a.num_cores() > 20 || a.row_modes()[0] > 2 {
                continue;
            }
            // 2^20 unknowns: ||(A X - I) v|| / ||v|| of a random full vector is about ||A X - I||_F /
            // sqrt(N).
            let mut state = 1u64;
            let v: Vec<f64> = (0..1 << 20)
                .map(|_| {
                    state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                    (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
                })
                .collect();
            let apply = |m: &TtMatrix, v: &[f64]| FullOperator::new(m).unwrap().multiply(v).unwrap();
            let w = apply(&a, &apply(&x, &v));
            let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
            let truth = norm(&mut w.iter().zip(&v).map(|(w, v)| w - v)) / norm(&mut v.iter().copied());
            assert!(truth < 2.0 * report.residual && report.residual < 2.0 * truth, "{truth} {report:?}");
        }
    }
}

#[test]
fn stored_operators_are_inverted_at_low_rank_with_an_honest_residual() {
    invert(5e-2, 30);
}

#[test]
#[ignore = "a minute: normal equations at rank 40"]
fn stored_operators_are_inverted_to_a_hundredth() {
    invert(1e-2, 40);
}
