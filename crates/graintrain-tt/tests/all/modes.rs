//! Merging, sums over modes, mode products, concatenation, powers, and the matrices of a vector of
//! differences, entry by entry.

use graintrain_tt::inverse::{InverseForm, inverse};
use graintrain_tt::solve::{SolveSettings, SolveStatus};
use graintrain_tt::{Truncation, TtError, TtMatrix, TtVector, qtt};
use proptest::prelude::*;

fn close(a: &[f64], b: &[f64]) -> bool {
    let size = b.iter().fold(1e-300_f64, |size, x| size.max(x.abs()));
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-12 * size)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn modes_change_as_in_the_full_tensor(modes in prop::collection::vec(1usize..4, 1..6), rank in 1usize..4, k in 0usize..6, rows in 1usize..4, seed in any::<u64>()) {
        let x = TtVector::random(&modes, rank, seed).unwrap();
        let full = x.to_full().unwrap();
        let (d, k) = (modes.len(), k % modes.len());
        // Merged modes are the same numbers.
        let merged = x.merge_modes(&[vec![1; k], vec![d - k]].concat()).unwrap();
        prop_assert!(close(&merged.to_full().unwrap(), &full));
        // A mode product, by its definition.
        let inner: usize = modes[..k].iter().product();
        let matrix: Vec<f64> = (0..rows * modes[k]).map(|e| (e as f64 + 1.0).sin()).collect();
        let changed = x.mode_product(k, &matrix, rows).unwrap();
        let mut expected = vec![0.0; full.len() / modes[k] * rows];
        for (place, value) in full.iter().enumerate() {
            let (low, j, high) = (place % inner, place / inner % modes[k], place / inner / modes[k]);
            (0..rows).for_each(|i| expected[low + inner * (i + rows * high)] += matrix[i + rows * j] * value);
        }
        prop_assert!(close(&changed.to_full().unwrap(), &expected));
        // Sums over modes.
        let over: Vec<bool> = (0..d).map(|m| (seed >> m) & 1 == 1).collect();
        let mut sums = vec![0.0; modes.iter().zip(&over).filter(|(_, over)| !**over).map(|(n, _)| n).product()];
        for (place, value) in full.iter().enumerate() {
            let (mut rest, mut step, mut to) = (place, 1, 0);
            for (n, over) in modes.iter().zip(&over) {
                if !over {
                    to += step * (rest % n);
                    step *= n;
                }
                rest /= n;
            }
            sums[to] += value;
        }
        prop_assert!(close(&x.sum_over(&over).unwrap().to_full().unwrap(), &sums));
        // One after the other along mode k.
        let y = changed;
        let joined = x.concatenate(&y, k).unwrap();
        let fibre = |full: &[f64], n: usize, place: usize, i: usize| full[place % inner + inner * (i + n * (place / inner))];
        let mut expected = Vec::new();
        for place in 0..full.len() / modes[k] {
            for i in 0..modes[k] + rows {
                expected.push(if i < modes[k] { fibre(&full, modes[k], place, i) } else { fibre(&y.to_full().unwrap(), rows, place, i - modes[k]) });
            }
        }
        let all = joined.to_full().unwrap();
        let found: Vec<f64> = (0..expected.len()).map(|e| fibre(&all, modes[k] + rows, e / (modes[k] + rows), e % (modes[k] + rows))).collect();
        prop_assert!(close(&found, &expected));
        // Powers.
        for p in [1, 2, 3, 6] {
            let (power, _) = x.entrywise_power(p, &Truncation::to(1e-14)).unwrap();
            prop_assert!(close(&power.to_full().unwrap(), &full.iter().map(|x| x.powi(p as i32)).collect::<Vec<_>>()));
        }
    }

    #[test]
    fn matrices_of_differences_and_their_products(d in 1usize..6, rank in 1usize..4, seed in any::<u64>()) {
        let n = 1usize << d;
        let x = TtVector::random(&vec![2; d], rank, seed).unwrap();
        let wide = TtVector::random(&vec![2; d + 1], rank, seed ^ 5).unwrap();
        let (cyclic, signed) = (x.to_full().unwrap(), wide.to_full().unwrap());
        let (circulant, toeplitz) = (qtt::circulant(&x).unwrap(), qtt::toeplitz(&wide).unwrap());
        prop_assert!(circulant.max_rank() <= 2 * x.max_rank() && toeplitz.max_rank() <= 2 * wide.max_rank());
        let (c, t) = (circulant.to_full().unwrap(), toeplitz.to_full().unwrap());
        for i in 0..n {
            for j in 0..n {
                prop_assert!((c[(i, j)] - cyclic[(n + i - j) % n]).abs() < 1e-12);
                prop_assert!((t[(i, j)] - signed[(2 * n + i - j) % (2 * n)]).abs() < 1e-12);
            }
        }
        for first in 0..=n {
            let step = qtt::step(d, first).unwrap().to_full().unwrap();
            prop_assert!(step.iter().enumerate().all(|(j, &x)| x == f64::from(j >= first)));
        }
    }
}

#[test]
fn what_does_not_fit_is_an_error() {
    let x = TtVector::random(&[2, 3], 2, 1).unwrap();
    for sizes in [&[][..], &[1], &[2, 1], &[2, 0], &[usize::MAX, 3]] {
        assert!(x.merge_modes(sizes).is_err());
    }
    assert!(
        x.sum_over(&[true]).is_err()
            && x.mode_product(2, &[1.0], 1).is_err()
            && x.mode_product(0, &[1.0; 3], 2).is_err()
    );
    assert!(x.mode_product(0, &[], 0).is_err() && x.concatenate(&x, 2).is_err());
    assert!(x.concatenate(&TtVector::random(&[2, 4], 1, 1).unwrap(), 0).is_err());
    assert!(x.entrywise_power(0, &Truncation::default()).is_err());
    assert!(qtt::circulant(&x).is_err() && qtt::toeplitz(&TtVector::constant(&[2], 1.0).unwrap()).is_err());
    assert!(qtt::step(0, 0).is_err() && qtt::step(64, 0).is_err() && qtt::step(3, 9).is_err());
    let long = TtVector::constant(&[2; 40], 1.0).unwrap();
    assert!(matches!(long.merge_modes(&[40]), Err(TtError::TooLarge { .. })));
    assert_eq!(qtt::ramp(3, 1.0, 0.5).unwrap().to_full().unwrap()[7], 4.5);
}

#[test]
fn inverses_of_matrices_that_are_not_symmetric_have_the_ranks_they_should() {
    // Lines with wind, skew and indefinite ones: rank 5, triangular ones rank 2, up to 2^14 points, where
    // normal equations fail.
    let settings = SolveSettings { tolerance: 1e-5, ..Default::default() };
    for d in [8, 10, 12, 14] {
        for (sub, diagonal, superdiagonal, rank) in [
            (-1.0, 2.0, -1.0, 5),
            (-1.3, 2.0, -0.7, 5),
            (-1.001, 2.0, -0.999, 5),
            (-2.0, 2.0, 0.0, 2),
            (-1.0, 0.1, 1.0, 5),
            (-1.0, 1.0, -1.0, 5),
        ] {
            let a = qtt::tridiagonal(d, sub, diagonal, superdiagonal).unwrap();
            let (x, report) = inverse(&a, InverseForm::Galerkin, None, &settings).unwrap();
            assert_eq!(
                report.status,
                SolveStatus::Converged,
                "{d} {sub} {diagonal} {superdiagonal}: {report:?}"
            );
            assert!(x.max_rank() <= rank, "{d} {sub} {diagonal} {superdiagonal}: {:?}", x.ranks());
            if d == 8 {
                let product = a.times_matrix(&x).unwrap().to_full().unwrap();
                let off: f64 =
                    (0..256 * 256).map(|e| (product.data()[e] - f64::from(e % 257 == 0)).powi(2)).sum();
                assert!((off / 256.0).sqrt() <= 1e-5, "{}", (off / 256.0).sqrt());
            }
        }
    }
    // A random matrix beside the identity, and one whose projections are singular.
    let random = TtMatrix::random(&[3, 2, 4], &[3, 2, 4], 3, 5).unwrap();
    let a = TtMatrix::identity(&[3, 2, 4]).unwrap().add(&random.scale(0.5 / random.norm())).unwrap();
    let swap = qtt::periodic_shift(5).unwrap();
    for a in [&a, &swap] {
        let (_, report) = inverse(a, InverseForm::Galerkin, None, &settings).unwrap();
        assert_eq!(report.status, SolveStatus::Converged, "{report:?}");
    }
}
