//! GMRES and the sweeps on systems that are not symmetric, against full matrices.

use crate::dense::dense;
use graintrain_linalg::dense::{Lu, Matrix};
use graintrain_tt::solve::{GmresSettings, Method, SolveSettings, SolveStatus, gmres, solve};
use graintrain_tt::{TtMatrix, TtVector, qtt};
use proptest::prelude::*;

/// ||A x - y|| / ||y|| and ||x - A^-1 y|| / ||A^-1 y|| from full matrices.
fn truth(a: &TtMatrix, x: &TtVector, y: &TtVector) -> (f64, f64) {
    let (full, x, y) = (dense(a), x.to_full().unwrap(), y.to_full().unwrap());
    let n = x.len();
    let norm = |list: &[f64]| list.iter().map(|x| x * x).sum::<f64>().sqrt();
    let rest: Vec<f64> = (0..n).map(|i| (0..n).map(|j| full[(i, j)] * x[j]).sum::<f64>() - y[i]).collect();
    let mut exact = Matrix::from_vec(n, 1, y.clone());
    Lu::new(full).unwrap().solve_in_place(exact.view_mut());
    let error: Vec<f64> = x.iter().zip(exact.data()).map(|(x, e)| x - e).collect();
    (norm(&rest) / norm(&y), norm(&error) / norm(exact.data()))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn the_reported_residual_is_the_true_one(
        modes in prop::collection::vec(1usize..4, 2..6), size in 0.1..0.9f64, digits in 1..11i32, cap in 1usize..9, restart in 1usize..20, seed in any::<u64>(),
    ) {
        let random = TtMatrix::random(&modes, &modes, 2, seed).unwrap();
        let a = TtMatrix::identity(&modes).unwrap().add(&random.scale(size / random.norm())).unwrap();
        let y = TtVector::random(&modes, 2, seed ^ 3).unwrap();
        let tolerance = 10f64.powi(-digits);
        for max_rank in [usize::MAX, cap] {
            let settings = GmresSettings { tolerance, max_rank, restart, max_iterations: 200 };
            let (x, report) = gmres(&a, &y, None, None, &settings).unwrap();
            let (residual, _) = truth(&a, &x, &y);
            prop_assert!((residual - report.residual).abs() <= 1e-6 * residual + 1e-13, "{residual:e} {report:?}");
            prop_assert_eq!(report.status == SolveStatus::Converged, report.residual <= tolerance);
            prop_assert!(x.max_rank() <= max_rank.max(y.max_rank()) && residual <= 1.0 + 1e-12);
            prop_assert!(max_rank < usize::MAX || report.status == SolveStatus::Converged, "{report:?}");
            // The starting point is the solution: nothing is left to do.
            let (_, again) = gmres(&a, &y, Some(&x), None, &settings).unwrap();
            prop_assert!(again.residual <= report.residual * (1.0 + 1e-9) + 1e-15);
        }
    }
}

/// -u'' + wind u' on 2^d points.
fn windy(d: usize, wind: f64) -> TtMatrix {
    let h = 1.0 / (1u64 << d) as f64;
    qtt::tridiagonal(d, -1.0 - 0.5 * h * wind, 2.0, -1.0 + 0.5 * h * wind).unwrap()
}

#[test]
fn lines_and_planes_with_wind_are_solved_without_squaring_the_condition() {
    for (d, wind) in [(8, 10.0), (8, 300.0), (12, 1000.0), (20, 100.0)] {
        let a = windy(d, wind);
        let y = TtVector::constant(&vec![2; d], 1.0).unwrap();
        // (With the wind the condition is about the number of points: 1e-5 is far above its rounding, its
        // square below.)
        let tolerance = if d == 20 { 1e-4 } else { 1e-8 };
        let settings = SolveSettings { tolerance, ..Default::default() };
        let (x, report) = solve(&a, &y, None, &settings).unwrap();
        assert_eq!(report.status, SolveStatus::Converged, "{d} {wind}: {report:?}");
        if d == 8 {
            let (residual, error) = truth(&a, &x, &y);
            assert!((residual - report.residual).abs() < 1e-10 && error < 1e-4, "{residual} {error}");
        }
    }
    let line = windy(6, 40.0);
    let plane = qtt::kronecker_sum(&[line.clone(), line], qtt::DigitOrder::Separated).unwrap();
    let y = TtVector::constant(&[2; 12], 1.0).unwrap();
    for method in [Method::Amen, Method::Dmrg] {
        let settings = SolveSettings { tolerance: 1e-7, method, ..Default::default() };
        let (_, report) = solve(&plane, &y, None, &settings).unwrap();
        assert_eq!(report.status, SolveStatus::Converged, "{method:?}: {report:?}");
    }
}

#[test]
fn a_preconditioner_makes_few_steps_of_many() {
    // The plane with wind, preconditioned by the inverse of the plane without.
    let (d, wind) = (5, 8.0);
    let (line, still) = (windy(d, wind), windy(d, 0.0));
    let a = qtt::kronecker_sum(&[line.clone(), line], qtt::DigitOrder::Separated).unwrap();
    let plain = qtt::kronecker_sum(&[still.clone(), still], qtt::DigitOrder::Separated).unwrap();
    let y = TtVector::constant(&[2; 10], 1.0).unwrap();
    let inner = SolveSettings { tolerance: 1e-3, ..Default::default() };
    let (p, _) =
        graintrain_tt::inverse::inverse(&plain, graintrain_tt::inverse::InverseForm::Energy, None, &inner)
            .unwrap();
    let settings = GmresSettings { tolerance: 1e-7, ..Default::default() };
    let (x, report) = gmres(&a, &y, None, Some(&p), &settings).unwrap();
    assert_eq!(report.status, SolveStatus::Converged, "{report:?}");
    let (residual, error) = truth(&a, &x, &y);
    assert!(residual <= 1e-7 && error < 1e-5, "{residual} {error}");
    let (_, without) = gmres(&a, &y, None, None, &settings).unwrap();
    println!("{} with, {} without: {:?}", report.iterations, without.iterations, without.status);
    assert!(report.iterations < 40 && report.iterations * 3 < without.iterations, "{report:?} {without:?}");
}

#[test]
fn what_gmres_cannot_solve_it_says() {
    // A cyclic shift: every vector but the last of the space is useless. Singular: half of y is out of reach.
    let (shift, y) = (qtt::periodic_shift(5).unwrap(), TtVector::unit(&[2; 5], &[1, 0, 0, 0, 0]).unwrap());
    let short = GmresSettings { restart: 10, max_iterations: 40, ..Default::default() };
    let (x, report) = gmres(&shift, &y, None, None, &short).unwrap();
    assert_ne!(report.status, SolveStatus::Converged);
    assert!(report.residual <= 1.0 && x.norm() == 0.0, "{report:?}");
    let long = GmresSettings { restart: 40, max_iterations: 40, ..Default::default() };
    assert_eq!(gmres(&shift, &y, None, None, &long).unwrap().1.status, SolveStatus::Converged);
    let half = qtt::step(5, 16).unwrap();
    let singular = TtMatrix::from_diagonal(&half);
    let one = TtVector::constant(&[2; 5], 1.0).unwrap();
    let (x, report) = gmres(&singular, &one, None, None, &GmresSettings::default()).unwrap();
    assert_eq!(report.status, SolveStatus::Stagnated);
    assert!(
        (report.residual - 0.5f64.sqrt()).abs() < 1e-6
            && singular.times_vector(&x).unwrap().relative_distance(&half).unwrap() < 1e-5,
        "{report:?}"
    );
    // A x = 0, and what has no meaning.
    let zero = one.scale(0.0);
    let (x, report) = gmres(&shift, &zero, None, None, &GmresSettings::default()).unwrap();
    assert_eq!((x.norm(), report.status), (0.0, SolveStatus::Converged));
    assert!(gmres(&shift, &qtt::sine(4, 0.1, 0.0).unwrap(), None, None, &short).is_err());
    assert!(gmres(&shift, &y, None, Some(&qtt::shift(4).unwrap()), &short).is_err());
    for bad in [
        GmresSettings { restart: 0, ..Default::default() },
        GmresSettings { max_iterations: 0, ..Default::default() },
        GmresSettings { tolerance: -1.0, ..Default::default() },
    ] {
        assert!(gmres(&shift, &y, None, None, &bad).is_err());
    }
    let infinite = TtVector::unit(&[2; 5], &[0; 5]).unwrap().scale(f64::INFINITY);
    assert!(gmres(&shift, &infinite, None, None, &short).is_err());
}

#[test]
fn units_do_not_matter() {
    let random = TtMatrix::random(&[2, 3, 4], &[2, 3, 4], 2, 9).unwrap();
    let a = TtMatrix::identity(&[2, 3, 4]).unwrap().add(&random.scale(0.5 / random.norm())).unwrap();
    let y = TtVector::random(&[2, 3, 4], 2, 4).unwrap();
    let (plain, _) = gmres(&a, &y, None, None, &GmresSettings::default()).unwrap();
    for (p, q) in [(1e200, 1e-50), (1e-200, 1e50), (1e150, 1e150), (1e-120, 1e-180)] {
        let (x, report) = gmres(&a.scale(p), &y.scale(q), None, None, &GmresSettings::default()).unwrap();
        assert_eq!(report.status, SolveStatus::Converged, "{p:e} {q:e}: {report:?}");
        assert!(x.scale(p).scale(1.0 / q).relative_distance(&plain).unwrap() < 1e-5, "{p:e} {q:e}");
    }
}
