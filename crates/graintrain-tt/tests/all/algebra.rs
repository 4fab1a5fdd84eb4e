//! Every operation against dense brute force, and the promise of error control, on random trains (property
//! tests).

use crate::dense::{dense, full};
use graintrain_linalg::dense::{Matrix, View, product};
use graintrain_tt::apply::{ApplyWork, FullOperator};
use graintrain_tt::{Truncation, TtMatrix, TtVector};
use proptest::prelude::*;

fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let difference: f64 = a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum();
    let size: f64 = b.iter().map(|x| x * x).sum();
    difference.sqrt() / size.sqrt().max(1e-300)
}

fn modes() -> impl Strategy<Value = Vec<usize>> {
    prop::collection::vec(1usize..5, 1..6)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn vector_operations_equal_dense(modes in modes(), r in 1usize..5, s in 1usize..4, seed in any::<u64>()) {
        let x = TtVector::random(&modes, r, seed).unwrap();
        let y = TtVector::random(&modes, s, seed ^ 1).unwrap();
        let (fx, fy) = (x.to_full().unwrap(), y.to_full().unwrap());
        let pairwise = |f: fn(f64, f64) -> f64| fx.iter().zip(&fy).map(|(&a, &b)| f(a, b)).collect::<Vec<_>>();
        prop_assert!(distance(&x.add(&y).unwrap().to_full().unwrap(), &pairwise(|a, b| a + b)) < 1e-12);
        prop_assert!(distance(&x.subtract(&y).unwrap().to_full().unwrap(), &pairwise(|a, b| a - b)) < 1e-12);
        prop_assert!(distance(&x.hadamard(&y).unwrap().to_full().unwrap(), &pairwise(|a, b| a * b)) < 1e-12);
        prop_assert!(distance(&x.scale(-2.5).to_full().unwrap(), &fx.iter().map(|a| -2.5 * a).collect::<Vec<_>>()) < 1e-14);
        let kronecker: Vec<f64> = fy.iter().flat_map(|b| fx.iter().map(move |a| a * b)).collect();
        prop_assert!(distance(&x.kronecker(&y).to_full().unwrap(), &kronecker) < 1e-12);
        let norm = fx.iter().map(|a| a * a).sum::<f64>().sqrt();
        prop_assert!((x.norm() - norm).abs() <= 1e-12 * norm);
        prop_assert!((x.log_norm() - norm.ln()).abs() <= 1e-11);
        let dot: f64 = fx.iter().zip(&fy).map(|(a, b)| a * b).sum();
        prop_assert!((x.dot(&y).unwrap() - dot).abs() <= 1e-12 * norm * y.norm());
        prop_assert!((x.sum() - fx.iter().sum::<f64>()).abs() <= 1e-12 * norm * (fx.len() as f64).sqrt());
        let mut left = x.clone();
        left.orthogonalise_left();
        let mut right = x.clone();
        right.orthogonalise_right();
        for (k, core) in left.cores().iter().enumerate().take(modes.len() - 1) {
            let unfolding = View::new(core.data(), core.left() * core.mode(), core.right());
            let g = product(unfolding.t(), unfolding);
            prop_assert!(distance(g.data(), Matrix::identity(core.right()).data()) < 1e-13, "core {}", k);
        }
        for core in &right.cores()[1..] {
            let unfolding = View::new(core.data(), core.left(), core.mode() * core.right());
            let g = product(unfolding, unfolding.t());
            prop_assert!(distance(g.data(), Matrix::identity(core.left()).data()) < 1e-13);
        }
        prop_assert!(distance(&left.to_full().unwrap(), &fx) < 1e-12);
        prop_assert!(distance(&right.to_full().unwrap(), &fx) < 1e-12);
    }

    #[test]
    fn entries_are_those_of_the_full_tensor(modes in modes(), r in 1usize..5, seed in any::<u64>()) {
        let x = TtVector::random(&modes, r, seed).unwrap();
        let full = x.to_full().unwrap();
        let digits = |mut j: usize| modes.iter().map(|&n| { let i = j % n; j /= n; i }).collect::<Vec<_>>();
        let order: Vec<usize> = (0..2 * full.len()).map(|k| (k * 7919 + 13) % full.len()).collect();
        let indices: Vec<usize> = order.iter().flat_map(|&j| digits(j)).collect();
        let values = x.entries(&indices).unwrap();
        for (value, &j) in values.iter().zip(&order) {
            prop_assert!((value - full[j]).abs() <= 1e-13 * (1.0 + full[j].abs()) * 16.0);
            prop_assert!((x.entry(&digits(j)).unwrap() - full[j]).abs() <= 1e-12);
        }
    }

    #[test]
    fn matrix_operations_equal_dense(
        sizes in prop::collection::vec((1usize..4, 1usize..4, 1usize..3), 1..5),
        r in 1usize..4,
        seed in any::<u64>(),
    ) {
        let rows: Vec<usize> = sizes.iter().map(|s| s.0).collect();
        let inner: Vec<usize> = sizes.iter().map(|s| s.1).collect();
        let columns: Vec<usize> = sizes.iter().map(|s| s.2).collect();
        let a = TtMatrix::random(&rows, &inner, r, seed).unwrap();
        let b = TtMatrix::random(&inner, &columns, 2, seed ^ 7).unwrap();
        let x = TtVector::random(&inner, 2, seed ^ 9).unwrap();
        let (fa, fb) = (dense(&a), dense(&b));
        let fx = Matrix::from_vec(fa.columns(), 1, x.to_full().unwrap());
        prop_assert!(distance(a.times_matrix(&b).unwrap().to_full().unwrap().data(), product(fa.view(), fb.view()).data()) < 1e-12);
        prop_assert!(distance(&a.times_vector(&x).unwrap().to_full().unwrap(), product(fa.view(), fx.view()).data()) < 1e-12);
        // (A + C) x = A x + C x and (A B) z = A (B z), train against train.
        let c = TtMatrix::random(&rows, &inner, 2, seed ^ 11).unwrap();
        let z = TtVector::random(&columns, 2, seed ^ 13).unwrap();
        let both = a.times_vector(&x).unwrap().add(&c.times_vector(&x).unwrap()).unwrap();
        let size = both.norm() + a.norm() * x.norm();
        prop_assert!(a.add(&c).unwrap().times_vector(&x).unwrap().subtract(&both).unwrap().norm() <= 1e-12 * size);
        let nested = a.times_vector(&b.times_vector(&z).unwrap()).unwrap();
        let size = a.norm() * b.norm() * z.norm();
        let joined = a.times_matrix(&b).unwrap().times_vector(&z).unwrap();
        prop_assert!(joined.subtract(&nested).unwrap().norm() <= 1e-12 * size);
        // The memory of the result may hold anything: more cores, fewer, larger or smaller ones.
        for mut y in [TtVector::random(&[3; 7], 5, seed).unwrap(), TtVector::random(&[1], 1, seed).unwrap(), x.clone()] {
            a.times_vector_into(&x, &mut y).unwrap();
            prop_assert_eq!(&y, &a.times_vector(&x).unwrap());
        }
        prop_assert!(distance(a.transpose().to_full().unwrap().data(), fa.transposed().data()) < 1e-15);
        let operator = FullOperator::new(&a).unwrap();
        prop_assert!(distance(&operator.multiply(fx.data()).unwrap(), product(fa.view(), fx.view()).data()) < 1e-12);
        let back = TtMatrix::from_full(&full(&fa), &rows, &inner, &Truncation::to(1e-13)).unwrap().0;
        prop_assert!(distance(back.to_full().unwrap().data(), fa.data()) < 1e-12);
        let square = TtMatrix::random(&rows, &rows, r, seed).unwrap();
        let square_full = square.to_full().unwrap();
        let diagonal: Vec<f64> = (0..square_full.rows()).map(|i| square_full[(i, i)]).collect();
        prop_assert!(distance(&square.diagonal().unwrap().to_full().unwrap(), &diagonal) < 1e-14);
        prop_assert!((square.trace().unwrap() - diagonal.iter().sum::<f64>()).abs() < 1e-11);
        let positions: Vec<(usize, usize)> = (0..fa.rows()).flat_map(|i| (0..fa.columns()).map(move |j| (i, j))).collect();
        for (value, &(i, j)) in a.entries(&positions).unwrap().iter().zip(&positions) {
            prop_assert!((value - fa[(i, j)]).abs() < 1e-12 * (1.0 + fa[(i, j)].abs()));
        }
    }

    #[test]
    fn products_within_a_tolerance_keep_the_promise_of_rounding(
        sizes in prop::collection::vec((1usize..4, 1usize..4, 1usize..3), 1..6),
        r in 1usize..5, tolerance in prop::sample::select(vec![0.0, 1e-9, 1e-4, 0.1]), cap in 1usize..40,
        scale in prop::sample::select(vec![1.0, 1e-200, 1e200]), seed in any::<u64>(),
    ) {
        let rows: Vec<usize> = sizes.iter().map(|s| s.0).collect();
        let inner: Vec<usize> = sizes.iter().map(|s| s.1).collect();
        let columns: Vec<usize> = sizes.iter().map(|s| s.2).collect();
        // A part of small size gives the product a spectrum that decays.
        let a = TtMatrix::random(&rows, &inner, r, seed).unwrap();
        let a = a.add(&TtMatrix::random(&rows, &inner, 2, seed ^ 3).unwrap().scale(1e-3)).unwrap();
        let b = TtMatrix::random(&inner, &columns, 3, seed ^ 7).unwrap();
        let x = TtVector::random(&inner, 3, seed ^ 9).unwrap();
        let truncation = Truncation::capped(tolerance, cap);
        let (product, other) = (a.times_matrix(&b).unwrap(), a.times_vector(&x).unwrap());
        let (ab, report_ab) = a.scale(scale).times_matrix_rounded(&b.scale(1.0 / scale), &truncation).unwrap();
        let (ax, report_ax) = a.scale(scale).times_vector_rounded(&x.scale(1.0 / scale), &truncation).unwrap();
        prop_assert_eq!((ab.row_modes(), ab.column_modes()), (&rows[..], &columns[..]));
        for (found, exact, report) in [(ab.as_vector(), product.as_vector(), report_ab), (&ax, &other, report_ax)] {
            let truth = distance(&found.to_full().unwrap(), &exact.to_full().unwrap());
            prop_assert!(report.capped || truth <= tolerance * (1.0 + 1e-6) + 1e-13, "{} > {}", truth, tolerance);
            prop_assert!((truth - report.error).abs() <= 1e-6 * truth + 1e-13, "{} {:?}", truth, report);
            prop_assert!((report.norm / exact.norm() - 1.0).abs() < 1e-10);
            let explicit = exact.round(&truncation).unwrap().0;
            // (Which of two nearly equal singular values is left out may differ, and so the next bond's
            // budget.)
            prop_assert!(found.ranks().iter().zip(explicit.ranks()).all(|(a, b)| a.abs_diff(b) <= 1));
        }
    }

    #[test]
    fn parts_of_trains_are_parts_of_tensors(
        cuts in prop::collection::vec((1usize..4, 0usize..3, 1usize..4, 1usize..4, 0usize..3, 1usize..4), 1..6),
        r in 1usize..4, seed in any::<u64>(),
    ) {
        let rows: Vec<usize> = cuts.iter().map(|c| c.0).collect();
        let columns: Vec<usize> = cuts.iter().map(|c| c.3).collect();
        let range = |n: usize, start: usize, length: usize| { let start = start.min(n - 1); start..(start + length).min(n) };
        let row_ranges: Vec<_> = cuts.iter().map(|c| range(c.0, c.1, c.2)).collect();
        let column_ranges: Vec<_> = cuts.iter().map(|c| range(c.3, c.4, c.5)).collect();
        // The numbers of the full tensor that a part holds, in its order.
        let places = |modes: &[usize], ranges: &[std::ops::Range<usize>]| -> Vec<usize> {
            let (mut places, mut step) = (vec![0], 1);
            for (n, range) in modes.iter().zip(ranges) {
                places = range.clone().flat_map(|i| places.iter().map(move |p| p + step * i)).collect();
                step *= n;
            }
            places
        };
        let x = TtVector::random(&rows, r, seed).unwrap();
        let full = x.to_full().unwrap();
        let part = x.sub_tensor(&row_ranges).unwrap();
        let expected: Vec<f64> = places(&rows, &row_ranges).iter().map(|&p| full[p]).collect();
        prop_assert!(distance(&part.to_full().unwrap(), &expected) < 1e-12);
        let squeezed = part.squeeze();
        let large: Vec<usize> = part.modes().into_iter().filter(|&n| n > 1).collect();
        prop_assert_eq!(squeezed.modes(), if large.is_empty() { vec![1] } else { large });
        prop_assert!(distance(&squeezed.to_full().unwrap(), &expected) < 1e-12);
        let a = TtMatrix::random(&rows, &columns, r, seed).unwrap();
        let dense = a.to_full().unwrap();
        let block = a.sub_matrix(&row_ranges, &column_ranges).unwrap().to_full().unwrap();
        let (i, j) = (places(&rows, &row_ranges), places(&columns, &column_ranges));
        let expected = Matrix::from_fn(i.len(), j.len(), |row, column| dense[(i[row], j[column])]);
        prop_assert!(distance(block.data(), expected.data()) < 1e-12);
    }

    /// TT-SVD and rounding keep their promise, report the true error, and rounding twice changes nothing.
    #[test]
    fn truncation_keeps_its_promise(modes in modes(), seed in any::<u64>(), digits in 1i32..9, cap in 1usize..6) {
        let tolerance = 10f64.powi(-digits);
        let x = TtVector::random(&modes, 6, seed).unwrap();
        // A spectrum that decays: sum of trains of falling size.
        let mut sum = x.clone();
        for k in 1..4 {
            sum = sum.add(&TtVector::random(&modes, 3, seed ^ k).unwrap().scale(0.03f64.powi(k as i32))).unwrap();
        }
        let full = sum.to_full().unwrap();
        let by_svd = TtVector::from_full(&full, &modes, &Truncation::to(tolerance)).unwrap();
        let by_round = sum.round(&Truncation::to(tolerance)).unwrap();
        for (train, report) in [&by_svd, &by_round] {
            let truth = distance(&train.to_full().unwrap(), &full);
            prop_assert!(truth <= tolerance * (1.0 + 1e-6) + 1e-13, "{} > {}", truth, tolerance);
            prop_assert!((truth - report.error).abs() <= 1e-6 * tolerance + 1e-12, "{} reported as {}", truth, report.error);
            prop_assert!(!report.capped);
            let (again, second) = train.round(&Truncation::to(1e-12)).unwrap();
            // (A later bond may have made an earlier rank superfluous: never more, sometimes fewer.)
            prop_assert!(again.ranks().iter().zip(train.ranks()).all(|(&a, b)| a <= b));
            prop_assert!(second.error < 1e-12);
        }
        let (capped, report) = sum.round(&Truncation::capped(tolerance, cap)).unwrap();
        prop_assert!(capped.max_rank() <= cap);
        let truth = distance(&capped.to_full().unwrap(), &full);
        prop_assert!((truth - report.error).abs() <= 1e-6 * truth + 1e-12);
        prop_assert!(report.capped || truth <= tolerance * (1.0 + 1e-6) + 1e-13);
        prop_assert!((report.norm - sum.norm()).abs() <= 1e-10 * report.norm);
    }
}

#[test]
fn products_with_full_vectors_equal_dense_over_both_stages_and_any_number_of_threads() {
    // Wide enough that both stages, merged cores and ragged row blocks occur; the oracle multiplies core by
    // core naively.
    for (rows, columns, r) in [
        (vec![6, 2, 2, 2, 2, 2, 2, 2, 2, 2], vec![6, 2, 2, 2, 2, 2, 2, 2, 2, 2], 9),
        (vec![24, 2, 2, 2, 2, 2, 2, 2], vec![24, 2, 2, 2, 2, 2, 2, 2], 20),
        (vec![5, 3, 4, 7, 3, 5], vec![4, 5, 3, 2, 7, 5], 30),
        (vec![2; 14], vec![2; 14], 12),
    ] {
        let a = TtMatrix::random(&rows, &columns, r, 3).unwrap();
        let operator = FullOperator::new(&a).unwrap();
        let x: Vec<f64> = (0..operator.num_columns()).map(|i| ((i * i) as f64 * 0.37).sin()).collect();
        let expected = naive_apply(&a, &x);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| operator.multiply(&x).unwrap())
        };
        let one = run(1);
        assert!(distance(&one, &expected) < 1e-12, "{rows:?}");
        assert_eq!(one, run(2));
        assert_eq!(one, run(3));
        // Several vectors at once: the same bits, one after the other.
        let many: Vec<f64> = [&x[..], &x, &x].concat();
        let mut results = vec![0.0; 3 * one.len()];
        operator.apply_many(&many, &mut results, &mut ApplyWork::default()).unwrap();
        assert_eq!(results, [&one[..], &one, &one].concat());
        assert!(operator.apply_many(&many[1..], &mut results, &mut ApplyWork::default()).is_err());
        assert!(operator.apply_many(&x, &mut results, &mut ApplyWork::default()).is_err());
    }
}

/// One digit at a time with an explicit sum: state[i.., alpha, j..] in plain index arithmetic.
fn naive_apply(a: &TtMatrix, x: &[f64]) -> Vec<f64> {
    let (mut state, mut produced) = (x.to_vec(), 1);
    for (k, core) in a.cores().iter().enumerate() {
        let (m, n) = (a.row_modes()[k], a.column_modes()[k]);
        let rest = state.len() / (produced * core.left() * n);
        let mut next = vec![0.0; produced * m * core.right() * rest];
        for q in 0..rest {
            for beta in 0..core.right() {
                for i in 0..m {
                    for j in 0..n {
                        for alpha in 0..core.left() {
                            let g = core.get(alpha, i + m * j, beta);
                            let from = produced * (alpha + core.left() * (j + n * q));
                            let to = produced * (i + m * (beta + core.right() * q));
                            for p in 0..produced {
                                next[to + p] += g * state[from + p];
                            }
                        }
                    }
                }
            }
        }
        state = next;
        produced *= m;
    }
    state
}

#[test]
fn long_trains_stay_small() {
    // 2^40 and 3^200 entries: any dense path would die, and the norm of the second overflows a float.
    let x = TtVector::random(&[2; 40], 5, 1).unwrap();
    let (sum, report) = x.add(&x).unwrap().round(&Truncation::to(1e-12)).unwrap();
    assert_eq!(sum.ranks(), x.ranks());
    assert!(report.error < 1e-12);
    assert!(sum.relative_distance(&x.scale(2.0)).unwrap() < 1e-12);
    assert!((x.dot(&x).unwrap().sqrt() / x.norm() - 1.0).abs() < 1e-12);
    let long = TtVector::constant(&[3; 700], 1.0).unwrap();
    assert!((long.log_norm() - 350.0 * 3f64.ln()).abs() < 1e-9);
    assert!(long.to_full().is_err());
    let (rounded, _) = long.add(&long).unwrap().round(&Truncation::to(1e-10)).unwrap();
    assert_eq!(rounded.max_rank(), 1);
    assert!((rounded.entry(&[1; 700]).unwrap() - 2.0).abs() < 1e-9);
    let a = TtMatrix::identity(&[2; 40]).unwrap();
    assert_eq!(a.trace().unwrap(), 2f64.powi(40));
    assert!(a.times_vector(&x).unwrap().relative_distance(&x).unwrap() < 1e-14);
}

#[test]
fn wrong_input_is_an_error_not_a_panic() {
    let x = TtVector::random(&[2, 3], 2, 1).unwrap();
    assert!(x.add(&TtVector::random(&[3, 2], 2, 1).unwrap()).is_err());
    assert!(x.entry(&[0, 3]).is_err());
    assert!(x.entry(&[0]).is_err());
    assert!(x.entries(&[0, 0, 1]).is_err());
    assert!(TtVector::from_cores(Vec::new()).is_err());
    assert!(TtVector::from_full(&[1.0; 5], &[2, 3], &Truncation::default()).is_err());
    assert!(x.round(&Truncation::to(-1.0)).is_err());
    assert!(x.round(&Truncation::capped(0.1, 0)).is_err());
    assert!(x.scale(f64::NAN).round(&Truncation::to(0.1)).is_err());
    let a = TtMatrix::identity(&[2, 3]).unwrap();
    assert!(a.times_vector(&TtVector::random(&[3, 2], 2, 1).unwrap()).is_err());
    assert!(FullOperator::new(&a).unwrap().multiply(&[0.0; 5]).is_err());
    assert!(a.entries(&[(6, 0)]).is_err());
    assert!(
        a.times_vector_rounded(&TtVector::random(&[3, 2], 2, 1).unwrap(), &Truncation::default()).is_err()
    );
    assert!(a.times_matrix_rounded(&TtMatrix::identity(&[3, 2]).unwrap(), &Truncation::default()).is_err());
    assert!(a.times_matrix_rounded(&a, &Truncation::to(2.0)).is_err());
    let nan = x.scale(f64::NAN);
    assert!(a.times_vector_rounded(&nan, &Truncation::default()).is_err());
    let zero = a.times_vector_rounded(&x.scale(0.0), &Truncation::default()).unwrap().0;
    assert_eq!((zero.modes(), zero.norm()), (vec![2, 3], 0.0));
    for ranges in [vec![0..2; 1], vec![0..2, 0..4], vec![0..2, 1..1], vec![0..2, 0..usize::MAX]] {
        assert!(x.sub_tensor(&ranges).is_err() && a.sub_matrix(&ranges, &ranges).is_err(), "{ranges:?}");
    }
}

#[test]
fn zero_stays_zero() {
    let x = TtVector::constant(&[2; 8], 0.0).unwrap();
    let (y, report) = x.add(&x).unwrap().round(&Truncation::to(1e-3)).unwrap();
    assert_eq!((y.norm(), report.error, y.max_rank()), (0.0, 0.0, 1));
    assert_eq!(TtVector::from_full(&[0.0; 16], &[2; 4], &Truncation::to(0.1)).unwrap().0.max_rank(), 1);
}
