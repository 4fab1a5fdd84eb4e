//! Whatever a caller hands over: an answer or a typed error, never a panic and never an endless loop.

use graintrain_tt::apply::{ApplyWork, FullOperator};
use graintrain_tt::cross::{CrossSettings, CrossStatus, Function, cross, cross_sparse};
use graintrain_tt::definite::extreme_eigenvalues;
use graintrain_tt::inverse::{InverseForm, inverse, newton_schulz};
use graintrain_tt::qtt::{self, DigitOrder};
use graintrain_tt::sketch::Sketch;
use graintrain_tt::solve::{Method, SolveSettings, SolveStatus, solve};
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Core, Truncation, TtError, TtMatrix, TtVector};
use proptest::prelude::*;

#[test]
fn shapes_that_do_not_fit_are_errors() {
    assert!(Core::new(2, 3, 1, vec![0.0; 5]).is_err());
    assert!(Core::new(usize::MAX, usize::MAX, 2, vec![0.0; 5]).is_err());
    for modes in [&[][..], &[0], &[2, 0, 2], &[usize::MAX, 2]] {
        assert!(TtVector::from_full(&[1.0], modes, &Truncation::default()).is_err(), "{modes:?}");
        assert!(TtVector::unit(modes, &[]).is_err());
        assert!(TtMatrix::identity(modes).is_err());
        assert!(TtMatrix::random(modes, &[2], 2, 1).is_err());
        let source = Function::new(modes, |_| 1.0);
        assert!(TtVector::random(modes, 2, 1).is_err());
        if modes.iter().all(|&n| n < 100) {
            assert!(TtVector::constant(modes, 1.0).is_err());
            assert!(cross(&source, None, &[], &CrossSettings::default()).is_err());
            assert!(Sketch::new(modes, 3, 1).is_err());
        }
    }
    assert!(TtMatrix::from_vector(TtVector::constant(&[4], 1.0).unwrap(), &[2, 2], &[2]).is_err());
    assert!(
        TtMatrix::from_vector(TtVector::constant(&[4], 1.0).unwrap(), &[usize::MAX], &[usize::MAX]).is_err()
    );
    let tall = TtMatrix::random(&[3, 2], &[2, 2], 2, 1).unwrap();
    let y = TtVector::constant(&[3, 2], 1.0).unwrap();
    assert!(solve(&tall, &y, None, &SolveSettings::default()).is_err());
    assert!(inverse(&tall, InverseForm::Energy, None, &SolveSettings::default()).is_err());
    assert!(newton_schulz(&tall, &tall, &Truncation::default(), 1.0, 3).is_err());
    assert!(tall.trace().is_err() && tall.diagonal().is_err() && tall.symmetric_part().is_err());
    assert!(qtt::kronecker_sum(&[], DigitOrder::Morton).is_err());
    assert!(qtt::interleave(&[tall, qtt::shift(3).unwrap()]).is_err());
    for d in [0, 1] {
        assert!(qtt::shift(d).is_err() && qtt::sine(d, 1.0, 1.0).is_err());
        assert!(qtt::polynomial(d, &[1.0], 0.0, 1.0).is_err());
    }
    assert!(qtt::hilbert(&[], 1.0, 1e-3).is_err() && qtt::hilbert(&[2], 0.0, 1e-3).is_err());
    assert!(qtt::hilbert(&[2], 1.0, f64::NAN).is_err() && qtt::hilbert_matrix(0, 1e-3).is_err());
    assert!(QuadtreeMatrix::from_entries(0, 2, []).is_err());
    assert!(QuadtreeMatrix::from_entries(2, 40, []).is_err());
    assert!(QuadtreeMatrix::from_entries(2, 2, [(8, 0, 1.0)]).is_err());
    let long = TtMatrix::identity(&[2; 80]).unwrap();
    assert!(matches!(FullOperator::new(&long), Err(TtError::TooLarge { .. })));
    assert!(matches!(long.to_full(), Err(TtError::TooLarge { .. })));
    let operator = FullOperator::new(&TtMatrix::identity(&[2; 3]).unwrap()).unwrap();
    assert!(operator.apply(&[0.0; 8], &mut [0.0; 7], &mut ApplyWork::default()).is_err());
}

#[test]
fn numbers_that_are_not_finite_are_errors() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let dense =
            |result: Result<(), TtError>| assert!(matches!(result, Err(TtError::Dense { .. })), "{result:?}");
        for modes in [&[3][..], &[2, 3, 2]] {
            let mut full = vec![1.0; modes.iter().product()];
            full[2] = bad;
            dense(TtVector::from_full(&full, modes, &Truncation::to(0.1)).map(drop));
        }
        let x = TtVector::random(&[2; 6], 2, 1).unwrap();
        let mut cores = x.clone().into_cores();
        cores[3] = Core::from_fn(2, 2, 2, |_, i, _| if i == 0 { bad } else { 1.0 });
        let broken = TtVector::from_cores(cores).unwrap();
        dense(broken.round(&Truncation::to(0.1)).map(drop));
        assert!(broken.norm().is_nan());
        let a = qtt::laplacian(6).unwrap();
        dense(solve(&a, &broken, None, &SolveSettings::default()).map(drop));
        dense(solve(&a, &x, Some(&broken), &SolveSettings::default()).map(drop));
        let broken_matrix = TtMatrix::from_diagonal(&broken);
        for form in [InverseForm::Energy, InverseForm::Residual, InverseForm::Symmetric] {
            dense(inverse(&broken_matrix, form, None, &SolveSettings::default()).map(drop));
        }
        dense(solve(&broken_matrix, &x, None, &SolveSettings::default()).map(drop));
        assert!(newton_schulz(&broken_matrix, &a, &Truncation::default(), 1.0, 3).is_err());
        let source = Function::new(&[2; 6], move |i: &[usize]| if i[2] == 1 { bad } else { 1.0 });
        for samples in [0, 4000] {
            let settings = CrossSettings { samples, ..Default::default() };
            let error = cross(&source, None, &[], &settings).unwrap_err();
            assert!(matches!(&error, TtError::Entry { index, .. } if index[2] == 1), "{error}");
        }
        let sparse = QuadtreeMatrix::from_entries(2, 2, [(0, 0, 1.0), (1, 5, bad)]).unwrap();
        dense(sparse.to_train(&Truncation::to(0.1)).map(drop));
        dense(sparse.to_train(&Truncation::to(1e-9)).map(drop));
        assert!(cross_sparse(&sparse, None, 1, &CrossSettings::default()).is_err());
        let mut sketch = Sketch::new(&[2; 6], 2, 1).unwrap();
        sketch.add_entries(&[0; 6], &[bad]).unwrap();
        assert!(sketch.to_train(&Truncation::default()).is_err());
        let operator = FullOperator::new(&broken_matrix).unwrap();
        assert!(extreme_eigenvalues(&operator, 10, 1).is_err());
    }
}

#[test]
fn the_largest_floats_come_back() {
    for (modes, tolerance) in [(&[2; 3][..], 0.0), (&[2; 12], 1e-12), (&[3, 5, 4, 2], 1e-6), (&[7], 0.0)] {
        let entries: usize = modes.iter().product();
        let patterns: [fn(usize) -> f64; 4] = [
            |_| 1.0,
            |i| if i % 2 == 0 { 1.0 } else { -1.0 },
            |i| f64::from(i % 3 == 1),
            |i| {
                if i == 1 { 1.0 } else { 1e-300 * i as f64 }
            },
        ];
        for pattern in patterns {
            let full: Vec<f64> = (0..entries).map(|i| f64::MAX * pattern(i)).collect();
            let (train, _) = TtVector::from_full(&full, modes, &Truncation::to(tolerance)).unwrap();
            for (x, y) in train.to_full().unwrap().iter().zip(&full) {
                assert!((x - y).abs() <= (1e-11 + 10.0 * tolerance) * f64::MAX, "{modes:?} {x:e} {y:e}");
            }
        }
    }
    // Sums on the way exceed the largest float, the entries do not; and what does exceed it is infinite.
    let ends = |right: f64| {
        let first = Core::new(1, 2, 2, vec![1.5e308, 1.0, -1.5e308, 1.0]).unwrap();
        let last = Core::new(2, 2, 1, vec![right, right - 0.25, 1.0, 1.0]).unwrap();
        TtVector::from_cores(vec![first, last]).unwrap().to_full().unwrap()
    };
    let full = ends(4.0);
    assert!((full[0] / 0.375e308 - 1.0).abs() < 1e-13 && full[2] == 0.0, "{full:?}");
    let beyond = TtVector::rank_one(&[vec![1e308, -1e308, 1.0], vec![1.0, 1e10]]).unwrap().to_full().unwrap();
    assert_eq!(beyond, [1e308, -1e308, 1.0, f64::INFINITY, f64::NEG_INFINITY, 1e10]);
}

#[test]
fn zero_systems_and_singular_operators_are_answered() {
    let a = qtt::laplacian(5).unwrap();
    let zero = TtVector::constant(&[2; 5], 0.0).unwrap();
    let one = TtVector::constant(&[2; 5], 1.0).unwrap();
    let settings = SolveSettings::default();
    let (x, report) = solve(&a, &zero, None, &settings).unwrap();
    assert_eq!((x.norm(), report.status, report.residual), (0.0, SolveStatus::Converged, 0.0));
    // A zero start is no obstacle.
    assert_eq!(solve(&a, &one, Some(&zero), &settings).unwrap().1.status, SolveStatus::Converged);
    assert!(solve(&TtMatrix::from_diagonal(&zero), &one, None, &settings).is_err());
    // Singular: the row sums of the free line vanish, so 1 is not in its range.
    let free = qtt::laplacian_with(5, qtt::Boundary::Neumann, qtt::Boundary::Neumann).unwrap();
    for method in [Method::Amen, Method::Als, Method::Dmrg] {
        for direct_limit in [1, 1000] {
            let settings = SolveSettings { method, direct_limit, ..Default::default() };
            let (_, report) = solve(&free, &one, None, &settings).unwrap();
            assert_ne!(report.status, SolveStatus::Converged, "{method:?} {report:?}");
            assert!(report.residual > 0.5 || report.residual.is_nan());
        }
    }
    for form in [InverseForm::Energy, InverseForm::Residual, InverseForm::Symmetric] {
        let (_, report) = inverse(&free, form, None, &settings).unwrap();
        assert_ne!(report.status, SolveStatus::Converged, "{form:?} {report:?}");
    }
    let source = Function::new(&[2; 6], |_| 0.0);
    assert_eq!(
        cross(&source, None, &[], &CrossSettings::default()).unwrap().1.status,
        CrossStatus::ZeroSampled
    );
    for settings in [
        CrossSettings { kick_rank: 0, ..Default::default() },
        CrossSettings { max_sweeps: 0, samples: 0, ..Default::default() },
        CrossSettings { tolerance: 0.0, max_rank: 1, ..Default::default() },
    ] {
        cross(&Function::new(&[1, 3, 1], |i| i[1] as f64), None, &[], &settings).unwrap();
    }
    for settings in [
        SolveSettings { kick_rank: 0, max_sweeps: 1, ..Default::default() },
        SolveSettings { tolerance: 0.0, local_iterations: 0, direct_limit: 0, ..Default::default() },
        SolveSettings { max_rank: 1, kick_rank: 50, ..Default::default() },
    ] {
        assert!(solve(&a, &one, None, &settings).unwrap().1.residual.is_finite(), "{settings:?}");
    }
    let empty = QuadtreeMatrix::from_entries(3, 4, []).unwrap();
    let (train, report) = empty.to_train(&Truncation::to(1e-3)).unwrap();
    assert_eq!((train.norm(), report.error), (0.0, 0.0));
}

#[test]
fn a_system_does_not_care_for_the_units_of_its_sides() {
    // A x = y with A and y scaled by up to 1e +- 200: the same answer in other units.
    let line = qtt::laplacian(4).unwrap();
    let a = qtt::kronecker_sum(&[line.clone(), line], DigitOrder::Separated).unwrap();
    let y = TtVector::random(&[2; 8], 2, 3).unwrap();
    let settings = SolveSettings { tolerance: 1e-8, ..Default::default() };
    let (x, _) = solve(&a, &y, None, &settings).unwrap();
    let middle = x.entry(&[0; 8]).unwrap();
    for (p, q) in [(1e200, 1.0), (1e-200, 1e-200), (1.0, 1e200), (1e150, 1e-100)] {
        let (z, report) = solve(&a.scale(p), &y.scale(q), None, &settings).unwrap();
        assert_eq!(report.status, SolveStatus::Converged, "{p:e} {q:e} {report:?}");
        assert!((z.entry(&[0; 8]).unwrap() / (middle * (q / p)) - 1.0).abs() < 1e-6);
        let (z, report) = inverse(&a.scale(p), InverseForm::Residual, None, &settings).unwrap();
        assert_eq!(report.status, SolveStatus::Converged, "{p:e} {report:?}");
        assert!(z.norm() > 0.0 && z.norm().is_finite());
    }
    // 3^400 unknowns: the norm of the right-hand side is no float.
    let many = TtMatrix::identity(&[3; 400]).unwrap().scale(2.0);
    let ones = TtVector::constant(&[3; 400], 1.0).unwrap();
    let (x, report) = solve(&many, &ones, None, &settings).unwrap();
    assert_eq!(report.status, SolveStatus::Converged, "{report:?}");
    assert!((x.entry(&[1; 400]).unwrap() - 0.5).abs() < 1e-6);
    for scale in [1e-250, 1e250] {
        let source = Function::new(&[2; 10], move |i: &[usize]| {
            scale / (1.0 + i.iter().enumerate().map(|(k, i)| i << k).sum::<usize>() as f64)
        });
        let (train, report) = cross(&source, None, &[], &CrossSettings::default()).unwrap();
        assert_eq!(report.status, CrossStatus::Converged, "{report:?}");
        assert!((train.entry(&[0; 10]).unwrap() / scale - 1.0).abs() < 1e-5);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Any bytes in place of a saved train: an error or a train, no panic and no giant allocation.
    #[test]
    fn any_damage_to_a_file_is_survived(seed in any::<u64>(), place in 0usize..400, bytes in prop::collection::vec(any::<u8>(), 1..24), cut in 0usize..600) {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("train.tt");
        TtMatrix::random(&[3, 2, 2], &[2, 2, 3], 2, seed).unwrap().save(&file).unwrap();
        let mut content = std::fs::read(&file).unwrap();
        for (k, b) in bytes.iter().enumerate() {
            if let Some(at) = content.get_mut(place + k) {
                *at = *b;
            }
        }
        content.truncate(cut);
        std::fs::write(&file, &content).unwrap();
        let _ = TtMatrix::load(&file);
        let _ = TtVector::load(&file);
    }
}
