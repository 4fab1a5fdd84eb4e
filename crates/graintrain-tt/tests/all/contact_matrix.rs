//! The matrix of a settled packing: no low rank exists, the exact pass knows the error, cross must admit
//! failure.

use crate::support::settled_packing;
use graintrain_tt::Truncation;
use graintrain_tt::cross::{CrossSettings, CrossStatus, cross_sparse};
use graintrain_tt::sparse::QuadtreeMatrix;

/// Cross of the matrix under a cap on the ranks, and under stride-th nonzeros as probes, must not claim to
/// have converged, and the error in the report must be the true one. Returns the error of the exact pass with
/// cap 10.
fn cross_admits_failure(matrix: &QuadtreeMatrix, runs: &[(usize, usize)]) -> f64 {
    for &(max_rank, stride) in runs {
        let settings = CrossSettings { tolerance: 1e-2, max_rank, ..Default::default() };
        let (train, report) = cross_sparse(matrix, None, stride, &settings).unwrap();
        let truth = matrix.relative_error(&train).unwrap();
        let measured = report.error().unwrap();
        let best = matrix.to_train(&Truncation::capped(1e-2, max_rank)).unwrap().1.error;
        println!(
            "cap {max_rank}: {truth:.3} measured {measured:.3} {:?}; exact pass {best:.3}",
            report.status
        );
        assert_ne!(report.status, CrossStatus::Converged);
        assert!((measured - truth).abs() <= 1e-12, "{truth} {report:?}");
        // The independent measure behind the sweeps sees the failure too, if less sharply.
        assert!(report.sampled_error.into_iter().chain(report.probe_error).fold(0.0, f64::max) > 0.1);
        assert!(truth >= 0.99 * best / 3.0, "the TT-SVD is optimal up to sqrt(d - 1)");
    }
    let exact = matrix.to_train(&Truncation::capped(1e-2, 10)).unwrap().1;
    assert!(exact.capped, "{exact:?}");
    exact.error
}

#[test]
fn the_reported_error_is_that_of_all_entries_one_by_one() {
    let Some(matrix) = settled_packing("sed125.dat") else { return };
    let settings = CrossSettings { tolerance: 1e-2, max_rank: 10, ..Default::default() };
    let (train, report) = cross_sparse(&matrix, None, 1, &settings).unwrap();
    let full = train.to_full().unwrap();
    let (mut difference, mut size) = (0.0, 0.0);
    for j in 0..full.columns() {
        for i in 0..full.rows() {
            let entry = matrix.entry(i, j);
            difference += (full[(i, j)] - entry).powi(2);
            size += entry * entry;
        }
    }
    let truth = (difference / size).sqrt();
    assert!((report.error().unwrap() / truth - 1.0).abs() < 1e-8, "{truth} {report:?}");
}

#[test]
fn a_settled_packing_has_no_low_rank_and_cross_says_that_it_failed() {
    let Some(matrix) = settled_packing("sed125.dat") else { return };
    assert!(cross_admits_failure(&matrix, &[(10, 1), (20, 7)]) > 0.3);
    let full = matrix.to_train(&Truncation::to(1e-2)).unwrap();
    println!("ranks at 1e-2: {:?}", full.0.ranks());
    assert!(full.0.max_rank() > 100 && full.1.error <= 1e-2);
    assert!((matrix.relative_error(&full.0).unwrap() - full.1.error).abs() < 1e-6);
}

#[test]
#[ignore = "2 052 and 14 087 contacts: a minute"]
fn larger_packings_have_no_low_rank_either() {
    for name in ["sed729.dat", "sed4913.dat"] {
        let Some(matrix) = settled_packing(name) else { return };
        println!("{name}");
        assert!(cross_admits_failure(&matrix, &[(10, 1), (30, 1), (10, 7)]) > 0.3);
    }
}
