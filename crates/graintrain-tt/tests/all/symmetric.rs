//! Parity-graded trains against ungraded ones.

use crate::dense::{dense, full};
use graintrain_linalg::dense::Matrix;
use graintrain_tt::qtt::{self, Boundary, DigitOrder};
use graintrain_tt::symmetric::SymmetricTrain;
use graintrain_tt::{Truncation, TtMatrix, TtVector};
use proptest::prelude::*;

/// Both roundings of a symmetric matrix keep the same total ranks; returns the graded one.
fn same_ranks(a: &TtMatrix, truncation: &Truncation) -> SymmetricTrain {
    let (graded, _) = SymmetricTrain::symmetric_part(a).unwrap().round(truncation).unwrap();
    let totals: Vec<usize> = graded.ranks().iter().map(|(even, odd)| even + odd).collect();
    assert_eq!(totals, a.round(truncation).unwrap().0.ranks());
    graded
}

/// The inverse of the tridiagonal matrix (-1, 2, -1) with this first and last diagonal entry.
fn inverse_of_line(digits: usize, first: f64, last: f64) -> TtMatrix {
    let n = 1 << digits;
    let mut a = Matrix::from_fn(n, n, |i, j| match i.abs_diff(j) {
        0 => 2.0,
        1 => -1.0,
        _ => 0.0,
    });
    a[(0, 0)] = first;
    a[(n - 1, n - 1)] = last;
    let mut inverse = Matrix::identity(n);
    graintrain_linalg::dense::Lu::new(a).unwrap().solve_in_place(inverse.view_mut());
    TtMatrix::from_full(&full(&inverse), &vec![2; digits], &vec![2; digits], &Truncation::to(1e-10))
        .unwrap()
        .0
}

#[test]
fn parities_of_the_line_and_its_inverse() {
    let truncation = Truncation::to(1e-10);
    let line = same_ranks(&qtt::laplacian(8).unwrap(), &truncation);
    assert_eq!(line.ranks()[1..8], [(2, 1); 7]);
    let inverse = same_ranks(&inverse_of_line(8, 2.0, 2.0), &truncation);
    let expected = [(3, 1), (4, 1), (4, 1), (4, 1), (4, 1), (4, 1), (3, 1)];
    assert_eq!(inverse.ranks()[1..8], expected);
    let free = qtt::laplacian_with(8, Boundary::Neumann, Boundary::Neumann).unwrap();
    assert_eq!(same_ranks(&free, &truncation).ranks()[1..8], expected);
    // Free ends, shifted to be regular, and its inverse.
    assert_eq!(same_ranks(&inverse_of_line(8, 1.5, 1.5), &truncation).ranks()[1..8], expected);
}

#[test]
fn unfoldings_of_symmetric_matrices_split_exactly() {
    // Digit pairs on either side of the middle bond, transformed by (1 +- exchange of all i and j) / 2: what
    // leads from one parity to the other is not small, it is 0.
    let n = 16;
    let line = dense(&qtt::laplacian(4).unwrap());
    let free = dense(&qtt::laplacian_with(4, Boundary::Neumann, Boundary::Neumann).unwrap());
    let inverse = inverse_of_line(4, 2.0, 2.0).to_full().unwrap();
    let closed = Matrix::from_fn(n, n, |i, j| ((i.min(j) + 1) * (n - i.max(j))) as f64 / (n + 1) as f64);
    assert!(closed.data().iter().zip(inverse.data()).all(|(a, b)| (a - b).abs() < 1e-12));
    for (name, a) in [("DD", line), ("NN", free), ("inverse of DD", closed)] {
        // Rows: fine pairs (i, j), columns: coarse pairs (k, l) of the entry (i + 4 k, j + 4 l).
        let entry = |(i, j): (usize, usize), (k, l): (usize, usize)| a[(i + 4 * k, j + 4 * l)];
        let pairs = || (0..4).flat_map(|j| (0..4).map(move |i| (i, j)));
        for fine in pairs() {
            for coarse in pairs() {
                let swap = |(i, j)| (j, i);
                for sign in [1.0, -1.0] {
                    let crossed = (entry(fine, coarse) + sign * entry(swap(fine), coarse))
                        - sign * (entry(fine, swap(coarse)) + sign * entry(swap(fine), swap(coarse)));
                    assert_eq!(crossed, 0.0, "{name} {fine:?} {coarse:?}");
                }
            }
        }
    }
}

#[test]
fn the_plane_needs_half_the_numbers() {
    let line = qtt::laplacian(5).unwrap();
    let plane = qtt::kronecker_sum(&[line.clone(), line], DigitOrder::Morton).unwrap();
    let truncation = Truncation::to(1e-12);
    let graded = same_ranks(&plane, &truncation);
    let ungraded = plane.round(&truncation).unwrap().0.as_vector().num_parameters();
    assert!(
        2 * graded.num_parameters() <= ungraded + ungraded / 10,
        "{} of {ungraded}",
        graded.num_parameters()
    );
    assert!(graded.to_matrix().relative_distance(&plane).unwrap() < 1e-12);
}

proptest! {
    #[test]
    fn graded_rounding_is_the_symmetric_part_within_the_tolerance(
        modes in prop::collection::vec(1usize..4, 1..6), rank in 1usize..5, seed in any::<u64>(), digits in 1i32..12,
        scale in prop::sample::select(vec![1e-200, 1.0, 1e200]),
    ) {
        let tolerance = 10f64.powi(-digits);
        let a = TtMatrix::random(&modes, &modes, rank, seed).unwrap();
        let part = a.symmetric_part().unwrap();
        let graded = SymmetricTrain::symmetric_part(&a.scale(scale)).unwrap();
        let norm = part.norm();
        let close = |x: &TtMatrix, error: f64| x.scale(1.0 / scale).subtract(&part).unwrap().norm() <= error * norm;
        // The part may be small beside A (it is zero for some 1 x 1 digits), rounding is relative to A.
        let rounding = 1e-13 * a.norm() / norm.max(f64::MIN_POSITIVE);
        prop_assert!(close(&graded.to_matrix(), rounding));
        let (rounded, report) = graded.round(&Truncation::to(tolerance)).unwrap();
        let train = rounded.to_matrix();
        prop_assert!(close(&train, tolerance + rounding));
        prop_assert!(report.error <= tolerance);
        let error = train.scale(1.0 / scale).subtract(&part).unwrap().norm() / norm;
        prop_assert!((error - report.error).abs() <= 1e-6 * tolerance + rounding, "{error} reported as {}", report.error);
        let full = train.to_full().unwrap();
        for j in 0..full.columns() {
            for i in 0..j {
                prop_assert_eq!(full[(i, j)].to_bits(), full[(j, i)].to_bits());
            }
        }
    }
}

proptest! {
    #[test]
    fn sums_multiples_and_products_equal_those_of_the_matrices(
        modes in prop::collection::vec(1usize..4, 1..6), rank in 1usize..4, factor in -3.0..3.0f64, seed in any::<u64>(),
    ) {
        let random = |seed| TtMatrix::random(&modes, &modes, rank, seed).unwrap();
        let graded = [seed, seed ^ 5].map(|seed| SymmetricTrain::symmetric_part(&random(seed)).unwrap());
        let [a, b] = graded.each_ref().map(SymmetricTrain::to_matrix);
        let sum = graded[0].add(&graded[1].scale(factor)).unwrap();
        let expected = a.add(&b.scale(factor)).unwrap();
        let size = 1e-13 * (a.norm() + factor.abs() * b.norm());
        prop_assert!(sum.to_matrix().subtract(&expected).unwrap().norm() <= size);
        let x = TtVector::random(&modes, 2, seed).unwrap();
        let product = sum.times_vector(&x).unwrap();
        prop_assert!(product.subtract(&expected.times_vector(&x).unwrap()).unwrap().norm() <= size * x.norm());
        let text = serde_json::to_string(&sum).unwrap();
        prop_assert_eq!(serde_json::from_str::<SymmetricTrain>(&text).unwrap(), sum);
    }
}

#[test]
fn damaged_symmetric_trains_are_refused() {
    let line = SymmetricTrain::symmetric_part(&qtt::laplacian(3).unwrap()).unwrap();
    let text = serde_json::to_string(&line).unwrap();
    let refused = |text: &str| serde_json::from_str::<SymmetricTrain>(text).is_err();
    assert!(!refused(&text));
    for (from, to) in [
        ("\"modes\":[2,2,2]", "\"modes\":[2,2]"),
        ("\"modes\":[2,2,2]", "\"modes\":[2,2,3]"),
        ("\"modes\":[2,2,2]", "\"modes\":[2,2,18446744073709551615]"),
        ("\"modes\":[2,2,2]", "\"modes\":[0,2,2]"),
        ("\"right\":3", "\"right\":2"),
    ] {
        assert!(text.contains(from) && refused(&text.replacen(from, to, 1)), "{from} {to}");
    }
    assert!(refused(r#"{"modes":[],"cores":[]}"#));
    let other = SymmetricTrain::symmetric_part(&qtt::laplacian(4).unwrap()).unwrap();
    assert!(line.add(&other).is_err());
}

#[test]
fn a_cap_is_obeyed_and_zero_stays_zero() {
    let a = TtMatrix::random(&[2; 6], &[2; 6], 8, 3).unwrap();
    let (graded, report) =
        SymmetricTrain::symmetric_part(&a).unwrap().round(&Truncation::capped(1e-8, 5)).unwrap();
    assert!(report.capped && graded.ranks().iter().all(|(even, odd)| even + odd <= 5));
    let error = graded.to_matrix().relative_distance(&a.symmetric_part().unwrap()).unwrap();
    assert!((error / report.error - 1.0).abs() < 1e-8, "{error} {}", report.error);
    // A - A^T has no symmetric part.
    let antisymmetric = a.subtract(&a.transpose()).unwrap();
    let (zero, _) =
        SymmetricTrain::symmetric_part(&antisymmetric).unwrap().round(&Truncation::to(1e-8)).unwrap();
    assert!(zero.to_matrix().norm() <= 1e-13 * a.norm());
    let (zero, report) =
        SymmetricTrain::symmetric_part(&a.scale(0.0)).unwrap().round(&Truncation::default()).unwrap();
    assert_eq!((zero.to_matrix().norm(), report.error), (0.0, 0.0));
    assert!(SymmetricTrain::symmetric_part(&TtMatrix::random(&[2, 3], &[3, 2], 2, 1).unwrap()).is_err());
}
