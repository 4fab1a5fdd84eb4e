//! Systems, functions and trains that no development was done on: an answer, or an honest "no", in a short
//! time.

use graintrain_tt::cross::{CrossSettings, CrossStatus, Function, cross};
use graintrain_tt::solve::{Method, SolveSettings, SolveStatus, solve};
use graintrain_tt::{Core, Truncation, TtError, TtMatrix, TtVector, qtt};
use std::time::{Duration, Instant};

type Entry = fn(&[usize]) -> f64;

/// -u'' + wind u' on 2^d points, central differences.
fn windy(d: usize, wind: f64) -> TtMatrix {
    let h = 1.0 / (1u64 << d) as f64;
    qtt::tridiagonal(d, -1.0 - 0.5 * h * wind, 2.0, -1.0 + 0.5 * h * wind).unwrap()
}

#[test]
fn projections_that_break_down_are_mended() {
    // P e_0 for the cyclic shift P: y^T P y = 0, so the Galerkin projection onto y is zero.
    let first = TtVector::unit(&[2; 10], &[0; 10]).unwrap();
    let shift = qtt::circulant(&TtVector::unit(&[2; 10], &[1, 0, 0, 0, 0, 0, 0, 0, 0, 0]).unwrap()).unwrap();
    for method in [Method::Amen, Method::Dmrg] {
        let settings = SolveSettings { method, ..Default::default() };
        let (x, report) = solve(&shift, &first, None, &settings).unwrap();
        assert_eq!(report.status, SolveStatus::Converged, "{method:?} {report:?}");
        assert!((x.entry(&[1; 10]).unwrap() - 1.0).abs() < 1e-6);
    }
    // Skew: x^T A x = 0 for every x. (2^9 is even, so A is regular.)
    let skew = qtt::tridiagonal(9, -1.0, 0.0, 1.0).unwrap();
    let y = TtVector::random(&[2; 9], 2, 5).unwrap();
    let (_, report) = solve(&skew, &y, None, &SolveSettings::default()).unwrap();
    assert_eq!(report.status, SolveStatus::Converged, "{report:?}");
    // ALS keeps the ranks of its start, whatever happens.
    let settings = SolveSettings { method: Method::Als, ..Default::default() };
    assert_eq!(solve(&shift, &first, None, &settings).unwrap().0.max_rank(), 1);
}

#[test]
fn wind_and_waves() {
    let settings = SolveSettings::default();
    for (d, wind) in [(10, 1e4), (10, 1e6), (16, 1e6)] {
        let y = TtVector::constant(&vec![2; d], 1.0).unwrap();
        let (_, report) = solve(&windy(d, wind), &y, None, &settings).unwrap();
        assert_eq!(report.status, SolveStatus::Converged, "{d} {wind}: {report:?}");
    }
    // Helmholtz below the grid's resolution: indefinite.
    for (d, k) in [(5, 10.5), (6, 20.3)] {
        let line = qtt::laplacian(d).unwrap().scale(((1u64 << d) as f64 + 1.0).powi(2));
        let plane = qtt::kronecker_sum(&[line.clone(), line], qtt::DigitOrder::Separated).unwrap();
        let a = plane.subtract(&TtMatrix::identity(&vec![2; 2 * d]).unwrap().scale(k * k)).unwrap();
        let y = TtVector::constant(&vec![2; 2 * d], 1.0).unwrap();
        for method in [Method::Amen, Method::Dmrg] {
            let settings = SolveSettings { method, ..settings };
            let (_, report) = solve(&a, &y, None, &settings).unwrap();
            assert_eq!(report.status, SolveStatus::Converged, "{d} {method:?}: {report:?}");
        }
    }
}

#[test]
fn conditions_beyond_the_numbers_end_soon() {
    // 4^d: from d = 24 on no solver can reach 1e-6. Until this was tried the ranks grew for minutes.
    for d in [24, 40, 200] {
        let start = Instant::now();
        let y = TtVector::constant(&vec![2; d], 1.0).unwrap();
        let (_, report) = solve(&qtt::laplacian(d).unwrap(), &y, None, &SolveSettings::default()).unwrap();
        assert_ne!(report.status, SolveStatus::Converged, "{d}: {report:?}");
        assert!(
            report.residual <= 1.0 + 1e-12 && start.elapsed() < Duration::from_secs(30),
            "{d}: {report:?}"
        );
    }
}

#[test]
fn units_of_cores_do_not_matter() {
    let line = qtt::laplacian(10).unwrap();
    let mut cores = line.as_vector().clone().into_cores();
    for (k, core) in cores.iter_mut().enumerate() {
        let unit = if k % 2 == 0 { 1e90 } else { 1e-90 };
        let data = core.data().iter().map(|x| x * unit).collect();
        *core = Core::new(core.left(), core.mode(), core.right(), data).unwrap();
    }
    let a = TtMatrix::from_cores(cores, &[2; 10], &[2; 10]).unwrap();
    let y = TtVector::constant(&[2; 10], 1.0).unwrap();
    let (_, report) = solve(&a, &y, None, &SolveSettings::default()).unwrap();
    assert_eq!(report.status, SolveStatus::Converged, "{report:?}");
    // A train of zero made of parts that cancel: no error is known, and the report says so.
    let x = TtVector::random(&[3; 8], 4, 1).unwrap();
    let zero = x.add(&x).unwrap().subtract(&x.scale(2.0)).unwrap();
    let (_, report) = zero.round(&Truncation::to(1e-6)).unwrap();
    assert!(report.floor > 1.0, "{report:?}");
}

#[test]
fn entries_that_are_no_numbers_are_named() {
    let pole = Function::new(&[16; 4], |i: &[usize]| 1.0 / (i.iter().sum::<usize>() as f64 - 20.0));
    let error = cross(&pole, None, &[], &CrossSettings::default()).unwrap_err();
    let TtError::Entry { index, value } = &error else { panic!("{error}") };
    assert!(index.iter().sum::<usize>() == 20 && value.is_infinite(), "{error}");
    assert!(error.to_string().contains(&format!("{index:?}")), "{error}");
    // Seen by the sweeps alone, the samples being off.
    let root = Function::new(&[9; 5], |i: &[usize]| (i.iter().sum::<usize>() as f64 - 17.0).sqrt());
    for samples in [0, 10, 4000] {
        let settings = CrossSettings { samples, ..Default::default() };
        let error = cross(&root, None, &[], &settings).unwrap_err();
        let TtError::Entry { index, value } = &error else { panic!("{error}") };
        assert!(index.iter().sum::<usize>() < 17 && value.is_nan(), "{error}");
    }
}

#[test]
fn tensors_that_are_read_whole_are_known_whole() {
    // Full rank, and no fibre tells of another: the sweeps stagnate, all entries do not.
    let hash: Entry = |i| {
        let n =
            i.iter().fold(7u64, |n, &i| (n ^ i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(31));
        (n >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let diagonal: Entry = |i| f64::from(i[0] == i[1]);
    let cases: [(&[usize], Entry); 2] = [(&[4; 7], hash), (&[40, 40], diagonal)];
    for (modes, function) in cases {
        let (train, report) =
            cross(&Function::new(modes, function), None, &[], &CrossSettings::default()).unwrap();
        assert!(report.status == CrossStatus::Converged && report.complete, "{report:?}");
        let mut index = vec![0; modes.len()];
        for value in train.to_full().unwrap() {
            assert!((value - function(&index)).abs() < 1e-5, "{index:?}");
            for (digit, &n) in index.iter_mut().zip(modes) {
                *digit += 1;
                if *digit < n {
                    break;
                }
                *digit = 0;
            }
        }
        let settings = CrossSettings { max_rank: 5, ..Default::default() };
        let report = cross(&Function::new(modes, function), None, &[], &settings).unwrap().1;
        assert!(
            report.status != CrossStatus::Converged && report.ranks.iter().all(|&r| r <= 5),
            "{report:?}"
        );
    }
    // Nothing but one entry of 3^5, which no random start has to see.
    let needle = Function::new(&[3; 5], |i: &[usize]| f64::from(i == [2, 0, 1, 2, 0]));
    let (train, report) = cross(&needle, None, &[], &CrossSettings::default()).unwrap();
    assert!(report.status == CrossStatus::Converged && (train.norm() - 1.0).abs() < 1e-12, "{report:?}");
}

#[test]
fn many_modes_and_poles_between_points() {
    let settings = CrossSettings { tolerance: 1e-8, ..Default::default() };
    let total = |i: &[usize]| i.iter().sum::<usize>() as f64;
    let (train, report) = cross(&Function::new(&[2; 200], total), None, &[], &settings).unwrap();
    assert!(report.status == CrossStatus::Converged && train.max_rank() == 2, "{report:?}");
    assert!((train.entry(&[1; 200]).unwrap() - 200.0).abs() < 1e-9);
    for gap in [0.5, 1e-8] {
        let pole = Function::new(&[16; 4], move |i: &[usize]| 1.0 / (total(i) - 20.0 - gap));
        let (train, report) = cross(&pole, None, &[], &settings).unwrap();
        assert_eq!(report.status, CrossStatus::Converged, "{gap}: {report:?}");
        assert!((train.entry(&[5; 4]).unwrap() * gap + 1.0).abs() < 1e-6, "{gap}");
    }
    for modes in [&[50][..], &[1, 5, 1, 7, 1], &[1; 5]] {
        let report = cross(&Function::new(modes, |i: &[usize]| 1.0 / (1.0 + total(i))), None, &[], &settings);
        assert_eq!(report.unwrap().1.status, CrossStatus::Converged, "{modes:?}");
    }
}
