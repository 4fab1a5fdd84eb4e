//! The promise of error control on hard input: the true relative error of TT-SVD, rounding and the sparse
//! pass never exceeds the tolerance, whatever the size of the numbers, the ranks or the modes.

use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Core, Truncation, TtError, TtVector};
use proptest::prelude::*;

/// Rounding level of the algorithms, relative to the norm.
const ROUNDING: f64 = 3e-15;

/// What rounding may add to the relative error of a TT-SVD (and of the sparse pass, which is one) and of the
/// sums that make its full tensor again. At every bond a matrix of r n rows is multiplied by an orthogonal
/// one, which is found, and applied, and undone by sums of r n terms: such sums err by some units of eps
/// sqrt(r n) (N. Higham, T. Mary, SIAM J. Sci. Comput. 41, 2019), and what the bonds add is independent of
/// each other.
fn svd_rounding(modes: &[usize]) -> f64 {
    let total: usize = modes.iter().product();
    let (mut terms, mut left) = (1, 1);
    for n in modes.iter().take(modes.len() - 1) {
        terms += left * n;
        left = (left * n).min(total / (left * n));
    }
    8.0 * f64::EPSILON * (terms as f64).sqrt()
}

/// ||a - b|| / ||b|| by numbers scaled to the largest of b (0 where both vanish).
fn distance(a: &[f64], b: &[f64]) -> f64 {
    let largest = b.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    if largest == 0.0 {
        return a.iter().fold(0.0, |largest, x| x.abs().max(largest));
    }
    let sum = |f: &dyn Fn(usize) -> f64| (0..b.len()).map(|i| (f(i) / largest).powi(2)).sum::<f64>().sqrt();
    sum(&|i| a[i] - b[i]) / sum(&|i| b[i])
}

fn modes() -> impl Strategy<Value = Vec<usize>> {
    prop::collection::vec(1usize..5, 1..6)
}

fn tolerances() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(0.0),
        Just(1e-15),
        Just(0.5),
        Just(0.999),
        (1u32..13).prop_map(|k| 0.1f64.powi(k as i32))
    ]
}

fn scales() -> impl Strategy<Value = f64> {
    prop_oneof![Just(1.0), Just(1e-200), Just(1e200), Just(1e-300), Just(1e300), Just(0.0)]
}

/// Numbers with a few zeros and a decaying profile, from a seed.
fn numbers(count: usize, seed: u64, scale: f64, decay: f64) -> Vec<f64> {
    let mut state = seed | 1;
    (0..count)
        .map(|i| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let x = (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
            if state.is_multiple_of(5) { 0.0 } else { scale * x * (-decay * i as f64).exp() }
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn tt_svd_never_errs_by_more_than_the_tolerance(
        modes in modes(), tolerance in tolerances(), scale in scales(), decay in 0.0..1.0f64, seed in any::<u64>(),
    ) {
        let full = numbers(modes.iter().product(), seed, scale, decay);
        let (train, report) = TtVector::from_full(&full, &modes, &Truncation::to(tolerance)).unwrap();
        let truth = distance(&train.to_full().unwrap(), &full);
        let rounding = svd_rounding(&modes);
        prop_assert!(truth <= tolerance * (1.0 + 1e-9) + rounding, "{} > {}", truth, tolerance);
        prop_assert!((truth - report.error).abs() <= 1e-6 * tolerance + rounding, "{} reported {}", truth, report.error);
        prop_assert!(!report.capped);
    }

    #[test]
    fn rounding_never_errs_by_more_than_the_tolerance(
        modes in modes(), tolerance in tolerances(), scale in scales(), seed in any::<u64>(),
    ) {
        // Ranks far above what the modes allow, an exactly dependent part and parts of falling size.
        let x = TtVector::random(&modes, 4, seed).unwrap();
        let mut sum = x.add(&x.scale(-0.5)).unwrap();
        for k in 1..4 {
            sum = sum.add(&TtVector::random(&modes, 3, seed ^ k).unwrap().scale(0.02f64.powi(k as i32))).unwrap();
        }
        // The size sits in one core, in all cores or in cores that undo each other.
        let d = modes.len();
        let spread = |k: usize| match seed % 3 {
            0 => if k == 0 { scale } else { 1.0 },
            1 => scale.powf(1.0 / d as f64),
            _ => if k == 0 { scale } else if k == 1 && scale != 0.0 { 1.0 / scale } else { 1.0 },
        };
        let cores: Vec<Core> = sum.cores().iter().enumerate().map(|(k, core)| {
            let data = core.data().iter().map(|x| x * spread(k)).collect();
            Core::new(core.left(), core.mode(), core.right(), data).unwrap()
        }).collect();
        let train = TtVector::from_cores(cores).unwrap();
        let total: f64 = (0..d).map(spread).product();
        let exact: Vec<f64> = sum.to_full().unwrap().iter().map(|x| x * total).collect();
        let (rounded, report) = train.round(&Truncation::to(tolerance)).unwrap();
        let truth = distance(&rounded.to_full().unwrap(), &exact);
        // (The oracle's own sums and roots of the scale are off by a few roundings.)
        prop_assert!(truth <= tolerance * (1.0 + 1e-9) + 5.0 * ROUNDING, "{} > {}", truth, tolerance);
        prop_assert!((truth - report.error).abs() <= 1e-6 * tolerance + 5.0 * ROUNDING, "{} {}", truth, report.error);
        prop_assert!(rounded.ranks().iter().zip(train.ranks()).all(|(&a, b)| a <= b));
    }

    #[test]
    fn the_sparse_pass_never_errs_by_more_than_the_tolerance(
        leaf in 1usize..6, levels in 0usize..5, count in 0usize..60, tolerance in tolerances(), scale in scales(),
        decay in 0.0..0.5f64, seed in any::<u64>(),
    ) {
        let n = leaf << levels;
        let values = numbers(count, seed, scale, decay);
        let entries: Vec<(usize, usize, f64)> = values.iter().enumerate()
            .map(|(k, &x)| ((k * 7919 + seed as usize % 97) % n, (k * k * 31 + 5) % n, x)).collect();
        let matrix = QuadtreeMatrix::from_entries(leaf, levels, entries.iter().copied()).unwrap();
        let mut full = vec![0.0; n * n];
        entries.iter().for_each(|&(i, j, x)| full[i + n * j] += x);
        let (train, report) = matrix.to_train(&Truncation::to(tolerance)).unwrap();
        let truth = distance(train.to_full().unwrap().data(), &full);
        let pairs: Vec<usize> = std::iter::once(leaf * leaf).chain(std::iter::repeat_n(4, levels)).collect();
        let rounding = svd_rounding(&pairs);
        prop_assert!(truth <= tolerance * (1.0 + 1e-6) + rounding, "{} > {}", truth, tolerance);
        // A Gram matrix may report its own rounding, far below the tolerance, as error.
        prop_assert!((truth - report.error).abs() <= 0.1 * tolerance + rounding, "{} {}", truth, report.error);
    }
}

#[test]
fn dummies_far_larger_or_smaller_than_the_entries_do_not_hide_the_error() {
    use graintrain_linalg::block3::BlockMatrix3;
    for dummy in [1e-12, 1.0, 1e9] {
        let blocks: Vec<[f64; 9]> = (0..5)
            .map(|k| std::array::from_fn(|e| if e % 4 == 0 { 2.0 } else { 0.1 * (k * 9 + e) as f64 }))
            .collect();
        let s = BlockMatrix3::from_rows((0..=5).collect(), (0..5).collect(), blocks);
        // Five contacts in a tree of 2 * 2^6 places.
        let matrix = QuadtreeMatrix::from_blocks(s.iter(), &[3, 17, 40, 77, 101], 2, 6, dummy).unwrap();
        for tolerance in [0.3, 1e-2, 1e-4] {
            let (train, report) = matrix.to_train(&Truncation::to(tolerance)).unwrap();
            let full = train.to_full().unwrap();
            let (mut difference, mut size) = (0.0, 0.0);
            for i in 0..full.rows() {
                for j in 0..full.rows() {
                    difference += (full[(i, j)] - matrix.entry(i, j)).powi(2);
                }
            }
            matrix.entries().filter(|e| e.2 != dummy).for_each(|e| size += e.2 * e.2);
            let truth = (difference / size).sqrt();
            // With dummies of 1e9 the entries keep 7 digits at most.
            let rounding = 1e-14 * matrix.augmented_norm() / matrix.norm();
            assert!(truth <= tolerance + rounding, "dummy {dummy:e}: {truth} > {tolerance}");
            assert!((truth - report.error).abs() <= 1e-3 * tolerance + rounding, "{truth} {report:?}");
        }
    }
}

#[test]
fn tolerances_without_meaning_are_refused() {
    let x = TtVector::random(&[2; 5], 2, 1).unwrap();
    let matrix = QuadtreeMatrix::from_entries(2, 2, [(0, 0, 1.0)]).unwrap();
    for tolerance in [1.0, 2.0, -1e-3, f64::NAN, f64::INFINITY] {
        let truncation = Truncation::to(tolerance);
        assert!(matches!(x.round(&truncation), Err(TtError::Setting { .. })), "{tolerance}");
        assert!(matches!(TtVector::from_full(&[1.0, 2.0], &[2], &truncation), Err(TtError::Setting { .. })));
        assert!(matches!(matrix.to_train(&truncation), Err(TtError::Setting { .. })));
    }
}

#[test]
fn norms_and_long_trains_at_the_ends_of_the_floats() {
    for scale in [1e-300, 1e300] {
        // 40 cores of that size: the norm itself is no float, its logarithm is.
        let cores = (0..40).map(|_| Core::from_fn(1, 2, 1, |_, _, _| scale)).collect();
        let train = TtVector::from_cores(cores).unwrap();
        let log = 40.0 * (scale.ln() + 0.5 * 2f64.ln());
        assert!((train.log_norm() / log - 1.0).abs() < 1e-13);
        let (rounded, report) = train.add(&train).unwrap().round(&Truncation::to(1e-12)).unwrap();
        assert_eq!(rounded.max_rank(), 1);
        assert!(report.error < 1e-14);
        assert!((rounded.log_norm() - log - 2f64.ln()).abs() < 1e-10 * log.abs());
        assert!(rounded.relative_distance(&train.scale(2.0)).unwrap() < 1e-13);
        // Cores that undo each other: the entries are 1.
        let cores =
            (0..40).map(|k| Core::from_fn(1, 2, 1, |_, _, _| if k % 2 == 0 { scale } else { 1.0 / scale }));
        let train = TtVector::from_cores(cores.collect()).unwrap();
        assert!((train.norm() / 2f64.powi(20) - 1.0).abs() < 1e-12);
        let rounded = train.round(&Truncation::to(1e-12)).unwrap().0;
        assert!((rounded.entry(&[1; 40]).unwrap() - 1.0).abs() < 1e-12);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn cancelling_sums_keep_the_promise(
        modes in modes(), rank in 1usize..6, gap in 0.0..13.0f64, digits in 0.5..12.0f64, part in 0.0..10.0f64, seed in any::<u64>(),
    ) {
        // a - (1 + 10^-gap) a + 10^-part b, whose terms cancel but for the given parts of a and b.
        let (a, b) = (TtVector::random(&modes, rank, seed).unwrap(), TtVector::random(&modes, rank, seed ^ 7).unwrap());
        let (factor, small) = (1.0 + 10f64.powf(-gap), 10f64.powf(-part));
        let sum = a.add(&a.scale(-factor)).unwrap().add(&b.scale(small)).unwrap();
        let (full_a, full_b) = (a.to_full().unwrap(), b.to_full().unwrap());
        let exact: Vec<f64> = full_a.iter().zip(&full_b).map(|(a, b)| (1.0 - factor) * a + small * b).collect();
        let norm = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
        // Rounding of the terms, enlarged by what they lose.
        let lost = (2.0 * norm(&full_a) + small * norm(&full_b)) / norm(&exact);
        let rounding = 5.0 * ROUNDING * lost;
        prop_assume!(rounding < 1e-2);
        prop_assert!((sum.norm() / norm(&exact) - 1.0).abs() <= rounding, "norm off by {}", sum.norm() / norm(&exact) - 1.0);
        let tolerance = 0.1f64.powf(digits);
        let (rounded, report) = sum.round(&Truncation::to(tolerance)).unwrap();
        let truth = distance(&rounded.to_full().unwrap(), &exact);
        prop_assert!(truth <= tolerance * (1.0 + 1e-9) + rounding, "{truth} > {tolerance}");
        prop_assert!((truth - report.error).abs() <= 1e-6 * tolerance + rounding, "{truth} reported as {}", report.error);
    }
}

/// A core with 1e200 beside 1, whose partner has 1e-201 beside 1: no term vanishes on the way.
#[test]
fn units_that_differ_within_a_core_lose_no_term() {
    let core = |left, right, data: &[f64]| Core::new(left, 1, right, data.to_vec()).unwrap();
    for (large, small) in [(1e200, 1e-201), (1e-200, 1e199), (1e80, 1e-81)] {
        let train =
            TtVector::from_cores(vec![core(1, 2, &[large, 1.0]), core(2, 1, &[small, 0.25])]).unwrap();
        assert!((train.norm() / 0.35 - 1.0).abs() < 1e-14, "{large:e}: {}", train.norm());
        let (rounded, report) = train.round(&Truncation::to(1e-12)).unwrap();
        assert!(
            (rounded.entry(&[0, 0]).unwrap() / 0.35 - 1.0).abs() < 1e-13
                && (report.norm / 0.35 - 1.0).abs() < 1e-13
        );
        let other =
            TtVector::from_cores(vec![core(1, 2, &[large, 1.0]), core(2, 1, &[small, -0.1])]).unwrap();
        assert!(other.norm() < 1e-15, "{large:e}: {}", other.norm());
    }
}

/// Tiny and huge trains that keep their size in different cores: side by side in a sum their squares have no
/// common range.
#[test]
fn sums_do_not_care_where_the_terms_keep_their_size() {
    let modes = [2, 3, 2, 4];
    for size in [1e-300, 1e-200, 1e200, 1e300] {
        let (a, b) = (TtVector::random(&modes, 3, 1).unwrap(), TtVector::random(&modes, 2, 2).unwrap());
        let moved = |x: &TtVector, k: usize| {
            let mut cores = x.clone().into_cores();
            let core = &cores[k];
            cores[k] =
                Core::from_fn(core.left(), core.mode(), core.right(), |l, i, r| size * core.get(l, i, r));
            TtVector::from_cores(cores).unwrap()
        };
        let expected = a.add(&b).unwrap().to_full().unwrap();
        for (i, j) in [(0, 3), (3, 0), (1, 2), (2, 2)] {
            let (first, second) = (moved(&a, i), moved(&b, j));
            let rounded = first.add(&second).unwrap().round(&Truncation::to(1e-10)).unwrap().0;
            let at_once =
                TtVector::sum_rounded(&[(1.0, &first), (1.0, &second)], &Truncation::to(1e-10)).unwrap().0;
            for sum in [rounded, at_once] {
                for (x, y) in sum.to_full().unwrap().iter().zip(&expected) {
                    assert!((x / size - y).abs() < 1e-8, "{size:e} {i} {j}: {x:e} {y:e}");
                }
            }
            let distance = first.measured_distance(&moved(&a, j)).unwrap();
            assert!(distance.value <= distance.floor.max(1e-14), "{size:e} {i} {j} {distance:?}");
        }
    }
}
