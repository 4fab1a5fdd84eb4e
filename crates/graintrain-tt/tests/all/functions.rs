//! Functions of entries, extremes, samples, orders of modes, Fourier transforms and convolutions against full
//! vectors.

use graintrain_tt::cross::{CrossSettings, CrossStatus};
use graintrain_tt::extremes::Density;
use graintrain_tt::fourier::{Direction, convolution, fourier};
use graintrain_tt::solve::{SolveSettings, SolveStatus};
use graintrain_tt::{Truncation, TtError, TtVector, qtt};
use proptest::prelude::*;

fn distance(x: &[f64], y: &[f64]) -> f64 {
    assert_eq!(x.len(), y.len());
    let norm = |list: &mut dyn Iterator<Item = f64>| list.map(|x| x * x).sum::<f64>().sqrt();
    norm(&mut x.iter().zip(y).map(|(x, y)| x - y)) / norm(&mut y.iter().copied()).max(f64::MIN_POSITIVE)
}

/// The unitary transform by its definition.
fn slow_fourier(real: &[f64], imaginary: &[f64], sign: f64) -> (Vec<f64>, Vec<f64>) {
    let n = real.len();
    let entry = |m: usize| {
        let (mut a, mut b) = (0.0, 0.0);
        for j in 0..n {
            let (sin, cos) = (sign * std::f64::consts::TAU * ((j * m) % n) as f64 / n as f64).sin_cos();
            a += real[j] * cos - imaginary[j] * sin;
            b += real[j] * sin + imaginary[j] * cos;
        }
        (a / (n as f64).sqrt(), b / (n as f64).sqrt())
    };
    (0..n).map(entry).unzip()
}

proptest! {
    #[test]
    fn fourier_is_the_sum_of_its_definition(d in 1usize..8, rank in 1usize..4, digits in 2..13i32, seed in any::<u64>()) {
        let modes = vec![2; d];
        let (x, y) = (TtVector::random(&modes, rank, seed).unwrap(), TtVector::random(&modes, rank, seed ^ 1).unwrap());
        let (fx, fy) = (x.to_full().unwrap(), y.to_full().unwrap());
        let truncation = Truncation::to(10f64.powi(-digits));
        for (direction, sign) in [(Direction::Forward, -1.0), (Direction::Backward, 1.0)] {
            let (a, b, report) = fourier(&x, Some(&y), direction, &truncation).unwrap();
            let (real, imaginary) = slow_fourier(&fx, &fy, sign);
            let found = [a.to_full().unwrap(), b.to_full().unwrap()].concat();
            let truth = distance(&found, &[real, imaginary].concat());
            prop_assert!(truth <= report.error + 1e-13 && report.error <= truncation.tolerance, "{truth} {report:?}");
        }
        // Back again.
        let (a, b, _) = fourier(&x, None, Direction::Forward, &Truncation::to(1e-13)).unwrap();
        let (c, e, _) = fourier(&a, Some(&b), Direction::Backward, &Truncation::to(1e-13)).unwrap();
        prop_assert!(distance(&c.to_full().unwrap(), &fx) < 1e-11 && e.norm() < 1e-11 * x.norm());
    }

    #[test]
    fn convolutions_are_sums_of_products(d in 1usize..7, rank in 1usize..4, seed in any::<u64>()) {
        let modes = vec![2; d];
        let (x, y) = (TtVector::random(&modes, rank, seed).unwrap(), TtVector::random(&modes, rank, seed ^ 1).unwrap());
        let (fx, fy) = (x.to_full().unwrap(), y.to_full().unwrap());
        let mut expected = vec![0.0; 2 << d];
        for (i, a) in fx.iter().enumerate() {
            fy.iter().enumerate().for_each(|(j, b)| expected[i + j] += a * b);
        }
        let (z, report) = convolution(&x, &y, &Truncation::to(1e-12)).unwrap();
        let size = expected.iter().map(|x| x * x).sum::<f64>().sqrt();
        // (Sums may cancel: rounding is relative to the terms.)
        let terms = x.norm() * y.norm() * (expected.len() as f64).sqrt() / size;
        prop_assert!(distance(&z.to_full().unwrap(), &expected) <= report.error + 1e-14 * terms + 1e-14);
    }

    #[test]
    fn permuted_modes_are_the_same_entries(
        modes in prop::collection::vec(1usize..5, 1..6), rank in 1usize..4, digits in 1..14i32, seed in any::<u64>(),
    ) {
        let d = modes.len();
        let x = TtVector::random(&modes, rank, seed).unwrap();
        let mut order: Vec<usize> = (0..d).collect();
        (1..d).for_each(|i| order.swap(i, (seed as usize >> (3 * i)) % (i + 1)));
        let truncation = Truncation::to(10f64.powi(-digits));
        let (y, report) = x.permute(&order, &truncation).unwrap();
        prop_assert_eq!(y.modes(), order.iter().map(|&k| modes[k]).collect::<Vec<_>>());
        let (full, size) = (y.to_full().unwrap(), x.norm());
        let mut squares = 0.0;
        for (place, value) in full.iter().enumerate() {
            let digits = qtt::digits(place, &y.modes()).unwrap();
            let mut index = vec![0; d];
            order.iter().zip(&digits).for_each(|(&k, &i)| index[k] = i);
            squares += (value - x.entry(&index).unwrap()).powi(2);
        }
        let truth = squares.sqrt() / size;
        prop_assert!(truth <= report.error + report.floor + 1e-14 && report.error <= truncation.tolerance, "{truth} {report:?}");
    }

    #[test]
    fn extremes_bound_every_entry_and_are_proven_where_all_is_searched(
        modes in prop::collection::vec(1usize..5, 1..7), rank in 1usize..5, nodes in 0usize..40, shift in -2.0..2.0f64, seed in any::<u64>(),
    ) {
        let x = TtVector::random(&modes, rank, seed).unwrap();
        let x = x.scale(1.0 / x.norm()).add(&TtVector::constant(&modes, shift * x.num_entries().powf(-0.5)).unwrap()).unwrap();
        let full = x.to_full().unwrap();
        let high = full.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let low = full.iter().copied().fold(f64::INFINITY, f64::min);
        for nodes in [nodes, 1_000_000] {
            let found = x.extremes(nodes).unwrap();
            for extreme in [&found.largest, &found.smallest] {
                prop_assert_eq!(x.entry(&extreme.index).unwrap(), extreme.value);
            }
            prop_assert!(found.largest.bound >= high - 1e-12 && found.smallest.bound <= low + 1e-12, "{found:?} {low} {high}");
            prop_assert!(!found.largest.proven || (found.largest.value - high).abs() < 1e-11);
            prop_assert!(!found.smallest.proven || (found.smallest.value - low).abs() < 1e-11);
            if nodes > 40 {
                prop_assert!(found.largest.proven && found.smallest.proven, "{found:?}");
            }
        }
    }
}

#[test]
fn a_needle_in_two_to_the_fifty_is_proven_to_be_the_largest() {
    // The tree is opened only where the needle may be. That nothing lies above 0 it does not show.
    let digits: Vec<usize> = (0..50).map(|k| k * 7 % 3 % 2).collect();
    let needle = TtVector::unit(&[2; 50], &digits).unwrap();
    let found = needle.scale(-3.0).extremes(1000).unwrap();
    assert_eq!((found.smallest.index, found.smallest.value, found.smallest.proven), (digits, -3.0, true));
    assert!(
        found.largest.value == 0.0 && !found.largest.proven && found.largest.bound <= 3.0,
        "{:?}",
        found.largest
    );
    // A flat tensor cannot be searched: it says so, and its bounds hold.
    let flat = qtt::sine(50, 0.1, 0.0).unwrap().extremes(1000).unwrap();
    assert!(!flat.largest.proven && flat.largest.bound >= 1.0 && flat.smallest.bound <= -1.0, "{flat:?}");
    let zero = TtVector::constant(&[2; 5], 0.0).unwrap().extremes(10).unwrap();
    assert!(zero.largest.proven && zero.largest.value == 0.0 && zero.smallest.value == 0.0);
}

#[test]
fn samples_have_the_frequencies_of_the_density() {
    let modes = [3, 2, 4, 2];
    let x = TtVector::random(&modes, 3, 5).unwrap();
    let squares: Vec<f64> = x.to_full().unwrap().iter().map(|x| x * x).collect();
    let density = x.hadamard(&x).unwrap();
    let count = 200_000;
    for (train, kind) in [(&x, Density::Squares), (&density, Density::Entries)] {
        let samples = train.sample(kind, count, 7).unwrap();
        assert_eq!(samples, train.sample(kind, count, 7).unwrap());
        let mut seen = vec![0.0; squares.len()];
        samples.chunks_exact(4).for_each(|index| seen[qtt::index(index, &modes).unwrap()] += 1.0);
        // Pearson's chi squared of 47 degrees of freedom: 100 has a probability of 1e-5.
        let total: f64 = squares.iter().sum();
        let term =
            |(seen, x): (&f64, &f64)| (seen - count as f64 * x / total).powi(2) / (count as f64 * x / total);
        let chi: f64 = seen.iter().zip(&squares).map(term).sum();
        assert!(chi < 100.0, "{kind:?} {chi}");
    }
    // A density of 2^200 entries, and what is none.
    let long = TtVector::rank_one(&vec![vec![0.25, 0.75]; 200]).unwrap();
    let ones = long.sample(Density::Entries, 500, 1).unwrap().iter().sum::<usize>() as f64 / 1e5;
    assert!((ones - 0.75).abs() < 0.01, "{ones}");
    assert!(matches!(
        qtt::sine(8, 0.1, 0.0).unwrap().scale(-1.0).sample(Density::Entries, 10, 1),
        Err(TtError::Setting { .. })
    ));
    assert!(TtVector::constant(&[2; 3], 0.0).unwrap().sample(Density::Squares, 1, 1).is_err());
}

#[test]
fn functions_of_entries_with_residuals_over_all_of_them() {
    // x in [0.2, 2.2]: a wave.
    let x = qtt::sine(14, 0.013, 0.4).unwrap().add(&TtVector::constant(&[2; 14], 1.2).unwrap()).unwrap();
    let full = x.to_full().unwrap();
    for tolerance in [1e-4, 1e-9] {
        let settings = SolveSettings { tolerance, ..Default::default() };
        let (y, report) = x.reciprocal(&settings).unwrap();
        assert_eq!(report.status, SolveStatus::Converged);
        let truth: f64 = y.to_full().unwrap().iter().zip(&full).map(|(y, x)| (x * y - 1.0).powi(2)).sum();
        assert!(((truth / 16384.0).sqrt() / report.residual - 1.0).abs() < 1e-3, "{truth} {report:?}");
        let settings = CrossSettings { tolerance, ..Default::default() };
        let (root, report) = x.square_root(&settings).unwrap();
        assert!(report.converged, "{report:?}");
        let exact: Vec<f64> = full.iter().map(|x| x.sqrt()).collect();
        assert!(distance(&root.to_full().unwrap(), &exact) < 10.0 * tolerance);
        let squares: Vec<f64> = root.to_full().unwrap().iter().map(|y| y * y).collect();
        let truth = distance(&squares, &full);
        assert!((truth / report.residual - 1.0).abs() < 1e-3, "{truth} {report:?}");
    }
    // Two arguments: the larger of two waves has an edge, and the report says how well it is met.
    let (y, tolerance) = (qtt::sine(14, 0.017, 0.1).unwrap(), 1e-4);
    let settings = CrossSettings { tolerance, max_rank: 30, ..Default::default() };
    let (larger, report) = TtVector::map(&[&x, &y], |v| v[0].max(v[1]), &settings).unwrap();
    let exact: Vec<f64> = full.iter().zip(y.to_full().unwrap()).map(|(x, y)| x.max(y)).collect();
    let truth = distance(&larger.to_full().unwrap(), &exact);
    assert!(report.status != CrossStatus::Converged || truth <= 3.0 * tolerance, "{truth} {report:?}");
    // A poor cross (rank 2) is repaired by Newton's steps as far as the cap allows, and what is missed is
    // said.
    let settings = CrossSettings { tolerance: 1e-8, max_rank: 2, ..Default::default() };
    let (root, report) = x.square_root(&settings).unwrap();
    let squares: Vec<f64> = root.to_full().unwrap().iter().map(|y| y * y).collect();
    assert!(
        !report.converged && (distance(&squares, &full) / report.residual - 1.0).abs() < 1e-6,
        "{report:?}"
    );
    // Negative entries have no root, zeros no reciprocal.
    let wave = qtt::sine(10, 0.1, 0.0).unwrap();
    assert!(matches!(wave.square_root(&CrossSettings::default()), Err(TtError::Entry { .. })));
    let (_, report) = wave.reciprocal(&SolveSettings::default()).unwrap();
    assert_ne!(report.status, SolveStatus::Converged);
    assert!(TtVector::map(&[], |_| 0.0, &CrossSettings::default()).is_err());
    assert!(TtVector::map(&[&x, &wave], |v| v[0], &CrossSettings::default()).is_err());
}

#[test]
fn what_does_not_fit_is_an_error() {
    let x = TtVector::random(&[2, 3, 2], 2, 1).unwrap();
    for order in [&[][..], &[0, 1], &[0, 1, 1], &[0, 1, 3], &[0, 1, 2, 3]] {
        assert!(x.permute(order, &Truncation::default()).is_err(), "{order:?}");
    }
    assert!(fourier(&x, None, Direction::Forward, &Truncation::default()).is_err());
    assert!(convolution(&x, &x, &Truncation::default()).is_err());
    let infinite = TtVector::rank_one(&[vec![1.0, f64::INFINITY], vec![1.0, 2.0]]).unwrap();
    assert!(infinite.extremes(10).is_err());
    assert!(fourier(&infinite, None, Direction::Forward, &Truncation::default()).is_err());
    assert!(infinite.permute(&[1, 0], &Truncation::default()).is_err());
    let _ = infinite.sample(Density::Squares, 2, 1);
}

/// Numbers of any size: what is found and drawn does not change.
#[test]
fn units_do_not_matter() {
    let x = TtVector::random(&[2, 3, 2, 4], 3, 11).unwrap();
    let (plain, samples) = (x.extremes(1000).unwrap(), x.sample(Density::Squares, 50, 3).unwrap());
    for scale in [1e-250, 1e-160, 1e160, 1e250] {
        let scaled = x.scale(scale);
        let found = scaled.extremes(1000).unwrap();
        assert_eq!(
            (&found.largest.index, &found.smallest.index),
            (&plain.largest.index, &plain.smallest.index),
            "{scale:e}"
        );
        assert!((found.largest.bound / scale / plain.largest.bound - 1.0).abs() < 1e-10, "{found:?}");
        assert!(found.largest.proven && found.smallest.proven, "{scale:e} {found:?}");
        assert_eq!(scaled.sample(Density::Squares, 50, 3).unwrap(), samples);
        let turned = scaled.permute(&[3, 1, 0, 2], &Truncation::to(1e-10)).unwrap().0;
        assert!(
            (turned.entry(&[3, 2, 1, 0]).unwrap() / scale - x.entry(&[1, 2, 0, 3]).unwrap()).abs() < 1e-10
        );
    }
    let wave = qtt::sine(6, 0.3, 0.1).unwrap();
    let (real, ..) = fourier(&wave, None, Direction::Forward, &Truncation::to(1e-10)).unwrap();
    let (large, ..) = fourier(&wave.scale(1e200), None, Direction::Forward, &Truncation::to(1e-10)).unwrap();
    assert!(large.scale(1e-200).relative_distance(&real).unwrap() < 1e-9);
}

/// 64 numbers of 1e-300: the smallest was "proven" to be another one, since the shifted tensor lost it in its
/// rounding.
#[test]
fn extremes_of_tiny_tensors_are_the_extremes() {
    for seed in 1..20 {
        let x = TtVector::random(&[2; 6], 8, seed).unwrap();
        let full = x.to_full().unwrap();
        let (low, high) = full.iter().fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
        for size in [1e-300, 1e-160, 1e290] {
            let found = x.scale(size).extremes(100_000).unwrap();
            assert!(found.largest.proven && found.smallest.proven);
            assert!((found.largest.value / size - high).abs() < 1e-10 * high, "{seed} {size:e} {found:?}");
            assert!((found.smallest.value / size - low).abs() < -1e-10 * low, "{seed} {size:e} {found:?}");
        }
    }
}
