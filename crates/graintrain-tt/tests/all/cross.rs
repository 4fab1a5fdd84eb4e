//! Cross interpolation: exact where the rank is small, honest where it fails.

use graintrain_tt::cross::{
    CrossReport, CrossSettings, CrossStatus, EntrySource, Function, cross, cross_sparse,
};
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{TtMatrix, TtVector};
use proptest::prelude::*;

/// A train as a source of entries.
struct Train(TtVector);

impl EntrySource for Train {
    fn modes(&self) -> Vec<usize> {
        self.0.modes()
    }

    fn entries(&self, indices: &[usize], values: &mut [f64]) {
        values.copy_from_slice(&self.0.entries(indices).unwrap());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn exact_on_trains_of_known_rank(modes in prop::collection::vec(2usize..5, 2..9), rank in 1usize..6, seed in any::<u64>()) {
        let exact = TtVector::random(&modes, rank, seed).unwrap();
        let settings = CrossSettings { tolerance: 1e-9, samples: 500, ..Default::default() };
        let (train, report) = cross(&Train(exact.clone()), None, &[], &settings).unwrap();
        // (500 points of few large entries prove little.)
        let loose = report.upper_bound.is_none_or(|bound| bound >= 1.0);
        let expected = if loose { CrossStatus::Unverified } else { CrossStatus::Converged };
        prop_assert_eq!(report.status, expected, "{:?}", report);
        prop_assert!(train.relative_distance(&exact).unwrap() < 1e-7);
        prop_assert!(train.max_rank() <= rank);
    }
}

/// Relative l2 error over all entries.
fn truth(source: &dyn EntrySource, train: &TtVector) -> f64 {
    let modes = source.modes();
    let count: usize = modes.iter().product();
    let indices: Vec<usize> = (0..count)
        .flat_map(|mut j| {
            modes
                .iter()
                .map(move |n| {
                    let i = j % n;
                    j /= n;
                    i
                })
                .collect::<Vec<_>>()
        })
        .collect();
    let mut values = vec![0.0; count];
    source.entries(&indices, &mut values);
    let full = train.to_full().unwrap();
    let difference: f64 = values.iter().zip(&full).map(|(a, b)| (a - b).powi(2)).sum();
    (difference / values.iter().map(|x| x * x).sum::<f64>()).sqrt()
}

fn position(index: &[usize]) -> f64 {
    index.iter().enumerate().map(|(k, i)| (i << k) as f64).sum()
}

#[test]
fn measured_errors_are_within_a_factor_three_of_the_truth() {
    // 2^14 points each; functions whose cross errors are spread over the entries.
    type Case = (&'static str, fn(&[usize]) -> f64);
    let cases: [Case; 6] = [
        ("reciprocal", |i| 1.0 / (1.0 + position(i))),
        ("root", |i| (position(i) / 16384.0).sqrt()),
        ("gaussian", |i| (-20.0 * (position(i) / 16384.0 - 0.5).powi(2)).exp()),
        ("waves", |i| (position(i) * 0.01).sin() + (position(i) * position(i) * 1e-6).cos()),
        ("kink", |i| (position(i) - 5000.3).abs()),
        ("logarithm", |i| (2.0 + position(i)).ln()),
    ];
    for (name, function) in cases {
        for tolerance in [1e-3, 1e-6] {
            let source = Function::new(&[2; 14], function);
            let settings = CrossSettings { tolerance, ..Default::default() };
            let (train, report) = cross(&source, None, &[], &settings).unwrap();
            let (truth, measured) = (truth(&source, &train), report.error().unwrap());
            println!(
                "{name} {tolerance:e}: {truth:e} measured {measured:e} {:?} ranks {:?} sweeps {} evaluations {}",
                report.status, report.ranks, report.sweeps, report.evaluations
            );
            assert!(measured < 3.0 * truth + 1e-14 && truth < 3.0 * measured + 1e-14, "{name}");
            assert_eq!(report.status == CrossStatus::Converged, measured <= tolerance, "{name} {report:?}");
        }
    }
}

#[test]
fn hilbert_tensors_of_the_reference() {
    // 1 / (i_1 + ... + i_D), 1-based, n = 32. amen_cross(1e-8) of TT-Toolbox: rank 11 and a sample error of
    // 5.0e-9 for D = 6, 11 and 1.4e-8 for D = 20, sums of all entries good to about 1e-8. (Ours: rank 11,
    // errors 4.6e-9 and 5.1e-9.)
    for (dimension, sum, error) in [(6, 1.152252225344e7, 5.0e-9), (20, 3.904509203406e27, 1.4e-8)] {
        let source = Function::new(&vec![32; dimension], |index| {
            1.0 / (index.len() + index.iter().sum::<usize>()) as f64
        });
        let settings = CrossSettings { tolerance: 1e-8, ..Default::default() };
        let (train, report) = cross(&source, None, &[], &settings).unwrap();
        assert_eq!((report.status, train.max_rank()), (CrossStatus::Converged, 11), "{report:?}");
        assert!(report.error().unwrap() <= error, "{report:?}");
        assert!((train.sum() / sum - 1.0).abs() < 1e-8, "{:e} {report:?}", train.sum());
    }
}

fn random_sparse(levels: usize, per_row: usize) -> QuadtreeMatrix {
    let n = 3usize << levels;
    let mut state = 12345u64;
    let mut entries = Vec::new();
    for i in 0..n {
        entries.push((i, i, 2.0 + (i % 7) as f64));
        for _ in 0..per_row {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let j = (state >> 33) as usize % n;
            let value = ((state >> 20) % 1000) as f64 / 500.0 - 1.0;
            entries.push((i, j, value));
            entries.push((j, i, value));
        }
    }
    QuadtreeMatrix::from_entries(3, levels, entries).unwrap()
}

#[test]
fn on_a_sparse_matrix_it_fails_and_says_so() {
    let matrix = random_sparse(8, 4);
    let settings = CrossSettings { tolerance: 1e-2, max_rank: 20, ..Default::default() };
    let (train, report) = cross_sparse(&matrix, None, 1, &settings).unwrap();
    assert_ne!(report.status, CrossStatus::Converged);
    assert!(train.max_rank() <= 20);
    // All nonzeros are probes, so their error is exact up to what the train puts on zeros.
    let full = train.to_full().unwrap();
    let n = full.rows();
    let mut difference = 0.0;
    for i in 0..n {
        for j in 0..n {
            difference += (full[(i, j)] - matrix.entry(i, j)).powi(2);
        }
    }
    let truth = difference.sqrt() / matrix.norm();
    println!("true error {truth}, {report:?}");
    let probed = report.probe_error.unwrap();
    assert!(probed > 0.1 && probed < 3.0 * truth && truth < 3.0 * probed.max(report.error().unwrap()));
}

#[test]
fn a_delta_is_not_found_and_not_claimed() {
    let at = [1, 0, 1, 1, 0, 1, 0, 0, 1, 1, 1, 0, 1, 0, 1, 1, 0, 1, 1, 0];
    let source = Function::new(&[2; 20], |index| f64::from(index == at));
    let settings = CrossSettings::default();
    let run = |start: Option<&TtVector>, probes: &[usize]| -> (TtVector, CrossReport) {
        cross(&source, start, probes, &settings).unwrap()
    };
    assert_eq!(run(None, &[]).1.status, CrossStatus::ZeroSampled);
    // Given where to look it is exact; that there is nothing else no sample can say.
    let start = TtVector::unit(&[2; 20], &at).unwrap();
    let (train, report) = run(Some(&start), &[]);
    assert_eq!(report.status, CrossStatus::Unverified);
    assert!((train.entry(&at).unwrap() - 1.0).abs() < 1e-12);
    for start in [None, Some(&start)] {
        let (train, report) = run(start, &at);
        assert_eq!((report.status, report.upper_bound), (CrossStatus::Unverified, None), "{report:?}");
        assert!((train.norm() - 1.0).abs() < 1e-9);
    }
}

#[test]
fn the_hot_start_reads_fewer_entries_and_the_cap_holds() {
    let function = |shift: f64| {
        Function::new(&[2; 18], move |index: &[usize]| 1.0 / (1.0 + shift + position(index) / 2000.0))
    };
    let settings = CrossSettings { tolerance: 1e-7, ..Default::default() };
    let (first, cold) = cross(&function(0.0), None, &[], &settings).unwrap();
    assert_eq!(cold.status, CrossStatus::Converged, "{cold:?}");
    let (_, hot) = cross(&function(0.01), Some(&first), &[], &settings).unwrap();
    assert_eq!(hot.status, CrossStatus::Converged, "{hot:?}");
    assert!(hot.evaluations < cold.evaluations && hot.sweeps < cold.sweeps, "{hot:?} {cold:?}");
    let capped = CrossSettings { max_rank: 2, ..settings };
    let (train, report) = cross(&function(0.0), None, &[], &capped).unwrap();
    assert!(train.max_rank() <= 2);
    assert_eq!(report.status, CrossStatus::RankCapped, "{report:?}");
    assert!(cross(&function(0.0), None, &[0; 17], &settings).is_err());
    assert!(cross(&function(0.0), None, &[2; 18], &settings).is_err());
    let bad = TtMatrix::identity(&[2; 18]).unwrap();
    assert!(cross(&function(0.0), Some(bad.as_vector()), &[], &settings).is_err());
}

/// A confirmation by all entries once read those again that the sweeps had read: twice the evaluations.
#[test]
fn no_entry_of_a_small_tensor_is_read_twice() {
    let modes = [20; 4];
    let read = std::sync::Mutex::new(std::collections::HashSet::new());
    let ball = Function::new(&modes, |i: &[usize]| {
        assert!(read.lock().unwrap().insert(i.to_vec()), "{i:?}");
        f64::from(i.iter().map(|&i| (i as f64 - 6.3).powi(2)).sum::<f64>() < 50.0)
    });
    let (_, report) = cross(&ball, None, &[], &CrossSettings::default()).unwrap();
    assert!(report.complete && report.evaluations == 160_000, "{report:?}");
    assert_eq!(read.lock().unwrap().len(), report.evaluations);
}
