//! Fits to scattered data against the functions they were drawn from.

use graintrain_tt::TtVector;
use graintrain_tt::fit::{FitSettings, fit};

/// Random multi-indices.
fn scattered(modes: &[usize], count: usize, seed: u64) -> Vec<usize> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize
    };
    (0..count).flat_map(|_| modes.iter().map(|n| next() % n).collect::<Vec<_>>()).collect()
}

#[test]
fn low_rank_tensors_are_recovered_from_some_entries() {
    for (modes, rank, count, seed) in
        [(vec![8; 5], 2, 4000, 1), (vec![6, 3, 9, 4, 2, 7], 3, 6000, 5), (vec![2; 14], 2, 3000, 3)]
    {
        let exact = TtVector::random(&modes, rank, seed).unwrap();
        // Units must not matter.
        for scale in [1.0, 1e-200, 1e150] {
            let exact = exact.scale(scale);
            let indices = scattered(&modes, count, seed + 7);
            let values = exact.entries(&indices).unwrap();
            let settings =
                FitSettings { tolerance: 1e-6, max_rank: 6, max_sweeps: 200, ..Default::default() };
            let (x, report) = fit(&modes, &indices, &values, &settings).unwrap();
            let truth = x.relative_distance(&exact).unwrap();
            println!("{modes:?} {scale:e}: true {truth:e} {report:?}");
            assert!(
                report.test_error < 3.0 * truth + 1e-12 && truth < 3.0 * report.test_error + 1e-12,
                "{truth:e} {report:?}"
            );
            assert_eq!(report.converged, report.error_estimate <= 1e-6);
            assert!(report.error_estimate >= truth, "{truth:e} {report:?}");
            assert!(report.converged, "{report:?}");
        }
    }
}

/// Thirty random trains of rank 2 and 3 in 5 to 14 modes from 3000 to 6000 entries: alternating least squares
/// from one start, its ranks growing by random directions, once found 16 of them.
#[test]
fn most_random_trains_are_recovered() {
    let shapes: [(&[usize], usize, usize); 10] = [
        (&[8; 5], 2, 4000),
        (&[8; 5], 3, 5000),
        (&[6, 3, 9, 4, 2, 7], 3, 6000),
        (&[6, 3, 9, 4, 2, 7], 2, 3000),
        (&[4; 8], 2, 4000),
        (&[4; 8], 3, 6000),
        (&[3; 10], 2, 4000),
        (&[3; 10], 3, 6000),
        (&[2; 14], 2, 3000),
        (&[2; 14], 3, 6000),
    ];
    let mut recovered = 0;
    for (modes, rank, count) in shapes {
        for seed in 0..3 {
            let exact = TtVector::random(modes, rank, 100 * seed + 11).unwrap();
            let indices = scattered(modes, count, seed + 70);
            let values = exact.entries(&indices).unwrap();
            let settings = FitSettings { max_rank: 8, seed: seed + 5, ..Default::default() };
            let (x, report) = fit(modes, &indices, &values, &settings).unwrap();
            let truth = x.relative_distance(&exact).unwrap();
            println!("{modes:?} {rank} {seed}: true {truth:e} {report:?}");
            assert!(!report.converged || truth <= 1e-6, "{truth:e} {report:?}");
            recovered += usize::from(report.converged);
        }
    }
    println!("{recovered} of 30");
    assert_eq!(recovered, 30);
}

/// Five times as many points as the trains have degrees of freedom: ranks that grew by one found 9 of 24.
#[test]
fn few_points_are_enough() {
    let shapes: [(&[usize], usize); 5] =
        [(&[4; 6], 2), (&[4; 6], 4), (&[6; 5], 3), (&[2; 12], 3), (&[5, 3, 7, 4, 6], 2)];
    let mut recovered = 0;
    for (modes, rank) in shapes {
        for seed in 0..3 {
            let exact = TtVector::random(modes, rank, 40 + seed).unwrap();
            let (ranks, d) = (exact.ranks(), modes.len());
            let freedom = exact.num_parameters() - ranks[1..d].iter().map(|r| r * r).sum::<usize>();
            let indices = scattered(modes, 5 * freedom, seed + 90);
            let values = exact.entries(&indices).unwrap();
            let settings = FitSettings { max_rank: 10, seed, ..Default::default() };
            let (x, report) = fit(modes, &indices, &values, &settings).unwrap();
            let truth = x.relative_distance(&exact).unwrap();
            println!("{modes:?} {rank} {seed}: true {truth:e} {report:?}");
            assert!(!report.converged || truth <= 1e-6, "{truth:e} {report:?}");
            assert!(report.upper_bound.is_none_or(|bound| bound >= truth), "{truth:e} {report:?}");
            recovered += usize::from(report.converged);
        }
    }
    println!("{recovered} of 15");
    assert!(recovered >= 13, "{recovered}");
}

/// A peak at one corner, which few points see: the error on the test points alone once was called convergence
/// where the error of all entries was above the tolerance.
#[test]
fn a_peak_that_few_points_see_is_not_called_met() {
    let mut claims = 0;
    // (The last of them has no peak, and is met.)
    for (modes, count, offset) in
        [(vec![10; 4], 3000, 1), (vec![6; 6], 5000, 1), (vec![16; 4], 4000, 1), (vec![8; 4], 2000, 20)]
    {
        let reciprocal = |i: &[usize]| 1.0 / (offset + i.iter().sum::<usize>()) as f64;
        let total: usize = modes.iter().product();
        let all: Vec<usize> = (0..total)
            .flat_map(|p| {
                let mut rest = p;
                modes.iter().map(move |n| (rest % n, rest /= n).0).collect::<Vec<_>>()
            })
            .collect();
        let exact: Vec<f64> = all.chunks_exact(modes.len()).map(reciprocal).collect();
        for (tolerance, seed) in [(3e-2, 1), (1e-2, 2), (3e-3, 3), (1e-3, 4)] {
            let indices = scattered(&modes, count, seed + 40);
            let values: Vec<f64> = indices.chunks_exact(modes.len()).map(reciprocal).collect();
            let settings = FitSettings { tolerance, seed, max_rank: 6, restarts: 1, ..Default::default() };
            let (x, report) = fit(&modes, &indices, &values, &settings).unwrap();
            let difference: f64 =
                x.to_full().unwrap().iter().zip(&exact).map(|(a, b)| (a - b) * (a - b)).sum();
            let truth = (difference / exact.iter().map(|y| y * y).sum::<f64>()).sqrt();
            println!("{modes:?} {tolerance:e}: true {truth:e} {report:?}");
            assert!(!report.converged || truth <= tolerance, "{truth:e} {report:?}");
            claims += usize::from(report.converged);
        }
    }
    println!("{claims} of 16 converged");
    assert!(claims >= 4, "{claims}");
}

#[test]
fn noise_and_too_few_points_show_in_the_test_error() {
    let modes = vec![8; 5];
    let exact = TtVector::random(&modes, 2, 1).unwrap();
    let indices = scattered(&modes, 4000, 9);
    let mut values = exact.entries(&indices).unwrap();
    let size = values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64;
    let mut sign = 1.0;
    values.iter_mut().for_each(|x| {
        sign = -sign;
        *x += sign * 0.05 * size.sqrt();
    });
    let settings = FitSettings { tolerance: 1e-6, max_rank: 8, ..Default::default() };
    let (x, report) = fit(&modes, &indices, &values, &settings).unwrap();
    let truth = x.relative_distance(&exact).unwrap();
    println!("noise: true {truth:e} {report:?}");
    // The noise cannot be predicted (the test says 5 %), but most of it is averaged away.
    assert!(!report.converged && report.test_error > 0.04 && report.test_error < 0.1, "{report:?}");
    assert!(truth < 0.04, "{truth}");
    // Sixty points for a train of 110 numbers: the fit meets its own points and the test says that this is
    // worth nothing.
    let few = &indices[..5 * 60];
    let (x, report) = fit(&modes, few, &exact.entries(few).unwrap(), &settings).unwrap();
    let truth = x.relative_distance(&exact).unwrap();
    assert!(!report.converged && truth > 0.3 && report.test_error > 0.3, "{truth} {report:?}");
    // Random values have no train at all.
    let noise: Vec<f64> = scattered(&[1001], 2000, 3).iter().map(|&i| i as f64 / 500.0 - 1.0).collect();
    let (_, report) = fit(&modes, &indices[..5 * 2000], &noise, &settings).unwrap();
    assert!(!report.converged && report.test_error > 0.8, "{report:?}");
}

#[test]
fn what_does_not_fit_is_an_error() {
    let indices = scattered(&[4, 4], 20, 1);
    let values = vec![1.0; 20];
    let ok = FitSettings::default();
    // A constant, and zero.
    assert!(fit(&[4, 4], &indices, &values, &ok).unwrap().1.converged);
    let (zero, report) = fit(&[4, 4], &indices, &[0.0; 20], &ok).unwrap();
    assert!(zero.norm() < 1e-6, "{report:?}");
    assert!(fit(&[16], &scattered(&[16], 200, 2), &vec![2.5; 200], &ok).unwrap().1.converged);
    assert!(fit(&[4, 3], &indices, &values, &ok).is_err());
    assert!(fit(&[4, 4], &indices[..18], &values[..9], &ok).is_err());
    assert!(fit(&[4, 4], &indices, &values[..19], &ok).is_err());
    assert!(fit(&[], &[], &values, &ok).is_err());
    assert!(fit(&[4, 4], &indices, &[f64::NAN; 20], &ok).is_err());
    for bad in [
        FitSettings { held_out: 0.0, ..ok },
        FitSettings { max_rank: 0, ..ok },
        FitSettings { tolerance: 2.0, ..ok },
    ] {
        assert!(fit(&[4, 4], &indices, &values, &bad).is_err());
    }
}

/// What is known at an index of the fit is no test: fifty values at one index once "converged".
#[test]
fn repeated_points_are_not_their_own_test() {
    let settings = FitSettings::default();
    assert!(fit(&[5; 3], &[1; 150], &[0.5; 50], &settings).is_err());
    // Forty random numbers, each twenty times: a train that knows the fitted ones is worth nothing at the
    // others.
    let points: Vec<usize> = (0..800).map(|p| p % 40).collect();
    let indices: Vec<usize> = points.iter().flat_map(|p| [p * 3 % 8, p / 5, p * 5 % 7]).collect();
    let values: Vec<f64> = points.iter().map(|p| (1000.0 * (*p as f64).sqrt()).sin()).collect();
    let (_, report) = fit(&[8; 3], &indices, &values, &settings).unwrap();
    assert!(!report.converged && report.test_error > 0.1, "{report:?}");
}
