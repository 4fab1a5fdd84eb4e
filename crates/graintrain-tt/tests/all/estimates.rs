//! The test set on which the reported errors of solves and inverses are compared with the truth
//! (docs/tensor-trains.md, "What is promised"): the residual from dense matrices must be within a factor 3 of
//! the report's, however the sweeps ended.

use crate::dense::dense;
use crate::support::settled_packing;
use graintrain_linalg::dense::{Matrix, product};
use graintrain_tt::apply::FullOperator;
use graintrain_tt::inverse::{InverseForm, inverse, newton_schulz};
use graintrain_tt::qtt::{self, DigitOrder};
use graintrain_tt::solve::{Method, SolveReport, SolveSettings, SolveStatus, solve};
use graintrain_tt::{Truncation, TtMatrix, TtVector};

/// Residuals below this are rounding of the dense oracle.
const RESOLVED: f64 = 1e-11;

/// Operators of the test set by name; whether they are symmetric and positive definite.
fn operators() -> Vec<(&'static str, bool, TtMatrix)> {
    let identity = |a: &TtMatrix, factor: f64| TtMatrix::identity(a.row_modes()).unwrap().scale(factor);
    let line = qtt::laplacian(4).unwrap();
    let plane = qtt::kronecker_sum(&[line.clone(), line], DigitOrder::Morton).unwrap();
    let indefinite = plane.subtract(&identity(&plane, 0.37)).unwrap();
    let wind = qtt::tridiagonal(4, -1.8, 2.0, -0.2).unwrap();
    let wind = qtt::kronecker_sum(&[wind.clone(), wind], DigitOrder::Separated).unwrap();
    let hilbert = qtt::hilbert_matrix(8, 1e-12).unwrap();
    let hilbert = hilbert.add(&identity(&hilbert, 1e-3)).unwrap();
    let modes = [6, 2, 3, 2, 2];
    let noise = TtMatrix::random(&modes, &modes, 2, 5).unwrap();
    let noise = noise.scale(3.6 / noise.norm());
    let mixed = identity(&noise, 1.0).add(&noise).unwrap();
    vec![
        ("plane, Morton order", true, plane),
        ("plane less 0.37, indefinite", false, indefinite),
        ("diffusion with wind", false, wind),
        ("Hilbert matrix + 0.001", true, hilbert),
        ("identity + random, mixed modes", false, mixed),
    ]
}

/// The contact matrix of a settled packing of 365 contacts, truncated to ranks of 12 and kept positive
/// definite.
fn contacts() -> Option<(&'static str, bool, TtMatrix)> {
    let matrix = settled_packing("sed125.dat")?;
    let (train, _) = matrix.to_definite_train(&Truncation::capped(1e-2, 12), 1e-2, 60).unwrap();
    Some(("contact matrix of 365 contacts, rank 12", true, train))
}

/// ||A x - y|| / ||y|| of the full matrix and vectors.
fn true_residual(a: &Matrix, x: &TtVector, y: &TtVector) -> f64 {
    let (x, y) = (x.to_full().unwrap(), y.to_full().unwrap());
    let image = product(a.view(), Matrix::from_vec(x.len(), 1, x).view());
    let difference: f64 = image.data().iter().zip(&y).map(|(a, b)| (a - b).powi(2)).sum();
    (difference / y.iter().map(|y| y * y).sum::<f64>()).sqrt()
}

/// The report is within a factor 3 of the truth and claims no more than it has measured.
fn honest(what: &str, report: &SolveReport, truth: f64, tolerance: f64) {
    let (residual, status) = (report.residual, report.status);
    println!("{what}: {status:?}, reported {residual:.2e}, true {truth:.2e}");
    assert!(
        residual <= 3.0 * truth + RESOLVED && truth <= 3.0 * residual + RESOLVED,
        "{what}: {truth:e} {report:?}"
    );
    assert_eq!(status == SolveStatus::Converged, residual <= 3.0 * tolerance, "{what}: {report:?}");
}

#[test]
fn residuals_of_solves_are_the_true_ones() {
    for (name, _, a) in operators().into_iter().chain(contacts()) {
        let (full, modes) = (dense(&a), a.row_modes().to_vec());
        let y = TtVector::random(&modes, 2, 11).unwrap();
        for method in [Method::Amen, Method::Als, Method::Dmrg] {
            for (tolerance, max_rank) in [(1e-2, usize::MAX), (1e-6, usize::MAX), (1e-6, 4)] {
                let settings =
                    SolveSettings { tolerance, max_rank, method, max_sweeps: 20, ..Default::default() };
                let start = TtVector::random(&modes, 6, 77).unwrap();
                let (x, report) = solve(&a, &y, Some(&start), &settings).unwrap();
                assert!(x.max_rank() <= max_rank);
                let what = format!("{name}, {method:?} to {tolerance:e}, cap {max_rank}");
                honest(&what, &report, true_residual(&full, &x, &y), tolerance);
            }
        }
    }
}

#[test]
#[ignore = "2 052 and 14 087 contacts: a minute"]
fn residuals_on_larger_contact_matrices_are_the_true_ones() {
    for name in ["sed729.dat", "sed4913.dat"] {
        let Some(matrix) = settled_packing(name) else { return };
        let (a, _) = matrix.to_definite_train(&Truncation::capped(1e-2, 12), 1e-2, 60).unwrap();
        let operator = FullOperator::new(&a).unwrap();
        let y = TtVector::random(a.row_modes(), 2, 11).unwrap();
        for method in [Method::Amen, Method::Als, Method::Dmrg] {
            for max_rank in [10, 40] {
                let settings =
                    SolveSettings { tolerance: 1e-4, max_rank, method, max_sweeps: 12, ..Default::default() };
                let (x, report) = solve(&a, &y, None, &settings).unwrap();
                let (image, y) = (operator.multiply(&x.to_full().unwrap()).unwrap(), y.to_full().unwrap());
                let difference: f64 = image.iter().zip(&y).map(|(a, b)| (a - b).powi(2)).sum();
                let truth = (difference / y.iter().map(|y| y * y).sum::<f64>()).sqrt();
                honest(&format!("{name}, {method:?}, cap {max_rank}"), &report, truth, 1e-4);
            }
        }
    }
}

#[test]
fn residuals_of_inverses_are_the_true_ones() {
    for (name, definite, a) in operators().into_iter().chain(contacts()) {
        let full = dense(&a);
        let n = full.rows();
        let truth = |x: &TtMatrix| {
            let image = product(full.view(), dense(x).view());
            let entries = image.data().iter().enumerate();
            entries.map(|(e, x)| (x - f64::from(e % (n + 1) == 0)).powi(2)).sum::<f64>().sqrt()
                / (n as f64).sqrt()
        };
        let forms: &[InverseForm] = match (definite, n > 1000) {
            (true, false) => &[InverseForm::Energy, InverseForm::Residual, InverseForm::Symmetric],
            (true, true) => &[InverseForm::Energy],
            _ => &[InverseForm::Residual],
        };
        for &form in forms {
            for (tolerance, max_rank) in [(1e-2, 20), (1e-4, 6)] {
                let settings = SolveSettings { tolerance, max_rank, max_sweeps: 10, ..Default::default() };
                let (x, report) = inverse(&a, form, None, &settings).unwrap();
                let what = format!("{name}, inverse {form:?} to {tolerance:e}, cap {max_rank}");
                honest(&what, &report, truth(&x), tolerance);
            }
        }
        // Newton's method reports ||I - A X||_F of what it returns.
        let start = TtMatrix::identity(a.row_modes()).unwrap().scale(a.trace().unwrap() / a.norm().powi(2));
        let (x, report) = newton_schulz(&a, &start, &Truncation::capped(1e-6, 12), 1e-2, 4).unwrap();
        let best = report.history.iter().copied().fold(f64::INFINITY, f64::min);
        let truth = truth(&x) * (n as f64).sqrt();
        assert!(best <= 3.0 * truth + RESOLVED && truth <= 3.0 * best + RESOLVED, "{name}: {best} {truth}");
        assert_eq!(report.converged, best <= 1e-2);
    }
}
