//! Errors that a report must not hide: regressions of a review.

use crate::dense::full;
use graintrain_linalg::block3::BlockMatrix3;
use graintrain_linalg::dense::Matrix;
use graintrain_tt::cross::{CrossSettings, CrossStatus, Function, cross, cross_sparse};
use graintrain_tt::inverse::newton_schulz;
use graintrain_tt::qtt::{self, Boundary};
use graintrain_tt::solve::{SolveSettings, SolveStatus, relative_residual, solve};
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Truncation, TtMatrix, TtVector, maxvol};

#[test]
fn points_that_became_pivots_do_not_measure_the_error() {
    // One point in 200 is a spike: a pivot sees its own spike only.
    let spikes = |index: &[usize]| {
        let n = index.iter().enumerate().fold(0u64, |n, (k, i)| n | (*i as u64) << k);
        let hash = (n ^ 77).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        if (hash ^ (hash >> 29)) % 200 == 0 { 1000.0 } else { 1.0 }
    };
    let source = Function::new(&[2; 18], spikes);
    for seed in 1..8 {
        let settings = CrossSettings { tolerance: 1e-3, max_sweeps: 12, seed, ..Default::default() };
        let (_, report) = cross(&source, None, &[], &settings).unwrap();
        assert_ne!(report.status, CrossStatus::Converged, "{report:?}");
        assert!(report.error().unwrap() > 0.3, "{report:?}");
    }
}

/// Three contacts far apart in a tree of 2^levels places, dummies 1.
fn three_contacts(levels: usize) -> QuadtreeMatrix {
    let block = [2.0, 0.1, 0.0, 0.1, 3.0, 0.0, 0.0, 0.0, 2.5];
    let s = BlockMatrix3::from_rows(vec![0, 1, 2, 3], vec![0, 1, 2], vec![block; 3]);
    QuadtreeMatrix::from_blocks(s.iter(), &[1, 5, 9], 1, levels, 1.0).unwrap()
}

#[test]
fn dummies_do_not_hide_the_error_of_a_train() {
    for levels in [4, 16, 30] {
        let matrix = three_contacts(levels);
        let (train, _) = matrix.to_train(&Truncation::to(1e-14)).unwrap();
        assert!(matrix.relative_error(&train).unwrap() < 1e-7, "{levels}");
        // One entry of block (1, 1) of contact 5, wrong by a known part of the norm.
        let modes = matrix.modes();
        let digits = qtt::digits(15, &modes).unwrap();
        let entry = TtMatrix::from_diagonal(&TtVector::unit(&modes, &digits).unwrap());
        let wrong = train.add(&entry.scale(1e-4 * matrix.norm())).unwrap();
        let error = matrix.relative_error(&wrong).unwrap();
        assert!((error / 1e-4 - 1.0).abs() < 1e-3, "{levels}: {error}");
    }
    let settings = CrossSettings { tolerance: 1e-8, ..Default::default() };
    let (_, report) = cross_sparse(&three_contacts(30), None, 1, &settings).unwrap();
    assert!(
        report.status != CrossStatus::Stagnated && report.exact_error.is_none_or(|e| e < 1e-6),
        "{report:?}"
    );
}

#[test]
fn newton_schulz_measures_the_residual_of_what_it_returns() {
    let shift = qtt::periodic_shift(8).unwrap().scale(0.3);
    let a = TtMatrix::identity(&[2; 8]).unwrap().add(&shift).unwrap();
    let start = TtMatrix::identity(&[2; 8]).unwrap();
    let (x, report) = newton_schulz(&a, &start, &Truncation::capped(1e-10, 1), 0.96, 5).unwrap();
    let truth = TtMatrix::identity(&[2; 8]).unwrap().subtract(&a.times_matrix(&x).unwrap()).unwrap().norm();
    let best = report.history.iter().copied().fold(f64::INFINITY, f64::min);
    assert!((best / truth - 1.0).abs() < 1e-10, "{best} {truth}");
    assert_eq!(report.converged, truth <= 0.96);
}

#[test]
fn small_residuals_of_large_ranks_are_resolved() {
    let line = qtt::laplacian(3).unwrap();
    let a = qtt::kronecker_sum(&[line.clone(), line.clone(), line], qtt::DigitOrder::Morton).unwrap();
    let x = TtVector::random(&[2; 9], 100, 7).unwrap();
    let y = a.times_vector(&x).unwrap();
    assert!(y.max_rank() + y.max_rank() > 400 || y.max_rank() > 100);
    let residual = relative_residual(&a, &x, &y, &[1; 9]).unwrap();
    assert!(residual < 1e-13, "{residual}");
    let (z, report) = solve(&a, &y, None, &SolveSettings { tolerance: 1e-10, ..Default::default() }).unwrap();
    assert_eq!(report.status, SolveStatus::Converged, "{report:?}");
    assert!(z.relative_distance(&x).unwrap() < 1e-8);
}

#[test]
fn the_part_of_a_matrix_that_is_not_symmetric_counts_as_error() {
    let entries = [(0, 0, 1.0), (0, 1, 1.0), (1, 0, -1.0), (1, 1, 1.0)];
    let matrix = QuadtreeMatrix::from_entries(1, 1, entries).unwrap();
    let (train, report) = matrix.to_definite_train(&Truncation::to(1e-10), 0.1, 10).unwrap();
    let truth = matrix.relative_error(&train).unwrap();
    assert!((truth - 0.5_f64.sqrt()).abs() < 1e-7 && report.error >= truth - 1e-7, "{truth} {report:?}");
}

#[test]
fn ends_of_long_lines_are_kept() {
    let d = 100;
    let line = qtt::laplacian_with(d, Boundary::Neumann, Boundary::Dirichlet).unwrap();
    assert_eq!(line.entry(&vec![0; d], &vec![0; d]).unwrap(), 1.0);
    assert_eq!(line.entry(&vec![1; d], &vec![1; d]).unwrap(), 2.0);
}

#[test]
fn a_norm_beyond_the_floats_is_an_error() {
    let entries = (0..5).map(|k| (k, k, 1e308));
    let matrix = QuadtreeMatrix::from_entries(2, 2, entries).unwrap();
    assert!(matrix.to_train(&Truncation::to(1e-3)).is_err());
}

#[test]
fn unreasonable_sizes_are_errors() {
    assert!(TtVector::constant(&[usize::MAX, 2], 1.0).is_err());
    assert!(TtVector::unit(&[usize::MAX], &[0]).is_err());
    assert!(maxvol::maxvol(&full(&Matrix::from_fn(2, 3, |i, j| (i + 2 * j) as f64))).is_err());
    let source = Function::new(&[2; 4], |_| 1.0);
    let settings = CrossSettings { samples: usize::MAX, ..Default::default() };
    assert!(cross(&source, None, &[], &settings).is_err());
    let eye = TtMatrix::identity(&[2; 62]).unwrap();
    assert!(graintrain_tt::apply::FullOperator::new(&eye).is_err());
    let core = r#"{"left":2,"mode":2,"right":2,"data":[]}"#;
    assert!(serde_json::from_str::<graintrain_tt::Core>(core).is_err());
    let matrix = QuadtreeMatrix::from_entries(2, 1, [(0, 0, 1.0)]).unwrap();
    assert_eq!(matrix.entry(1 << 32, 0), 0.0);
}
