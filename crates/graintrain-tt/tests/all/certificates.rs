//! Reports that have to be true where it is hardest: cancelling sums, residuals of large ranks in bad gauges,
//! singular systems, terms far smaller than others, sketches of too small a rank, sizes that do not fit.

use graintrain_tt::inverse::{InverseForm, inverse};
use graintrain_tt::qtt::{self, Boundary, DigitOrder};
use graintrain_tt::sketch::Sketch;
use graintrain_tt::solve::{Method, SolveSettings, SolveStatus, measured_residual, solve};
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Core, Truncation, TtError, TtMatrix, TtVector};

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn distance(x: &[f64], y: &[f64]) -> f64 {
    norm(&x.iter().zip(y).map(|(a, b)| a - b).collect::<Vec<_>>()) / norm(y)
}

#[test]
fn the_floor_covers_what_cancellation_costs() {
    // a - a + s b is s b exactly: entries of b times s are the oracle.
    let (mut worst, mut beyond_tolerance): (f64, usize) = (0.0, 0);
    for seed in 0..1500u64 {
        let modes = vec![2 + seed as usize % 3; 3 + seed as usize % 5];
        let rank = 1 + seed as usize % 6;
        let a = TtVector::random(&modes, rank, 2 * seed).unwrap();
        let b = TtVector::random(&modes, rank, 2 * seed + 1).unwrap();
        let small = 10f64.powi(-(seed as i32 % 14));
        let sum = a.subtract(&a).unwrap().add(&b.scale(small)).unwrap();
        let exact: Vec<f64> = b.to_full().unwrap().iter().map(|x| small * x).collect();
        let tolerance = 10f64.powi(-(1 + seed as i32 % 12));
        let (rounded, report) = sum.round(&Truncation::to(tolerance)).unwrap();
        let truth = distance(&rounded.to_full().unwrap(), &exact);
        assert!(truth <= tolerance + report.floor, "{seed}: {truth:e} {tolerance:e} {report:?}");
        assert!(
            (truth - report.error).abs() <= report.floor + 1e-6 * tolerance,
            "{seed}: {truth:e} {report:?}"
        );
        beyond_tolerance += usize::from(truth > tolerance);
        worst = worst.max(truth / (tolerance + report.floor));
        let measured = sum.measured_distance(&b.scale(small)).unwrap();
        assert!(measured.value <= measured.floor, "{seed}: {measured:?}");
        // No more than it has to be: the product of core norms over the norm bounds it.
        let sizes: f64 = sum.cores().iter().map(|core| norm(core.data())).product();
        let cores = (modes.len() as f64).sqrt();
        assert!(report.floor <= 64.1 * f64::EPSILON * cores * sizes / norm(&exact), "{seed} {report:?}");
        assert!(a.round(&Truncation::to(tolerance)).unwrap().1.floor < 1e-12);
    }
    println!("{beyond_tolerance} of 1500 beyond the tolerance, at most {worst:.2} of tolerance + floor");
    assert!(beyond_tolerance > 20);
}

/// The same tensor with a random regular matrix and its inverse between neighbouring cores, ill-conditioned
/// by 10^digits.
fn other_gauge(train: &TtVector, digits: f64) -> TtVector {
    let mut cores: Vec<Core> = train.cores().to_vec();
    for k in 0..cores.len() - 1 {
        let size = |alpha: usize| {
            10f64.powf(digits * (alpha as f64 / cores[k].right() as f64 - 0.5)).log2().round().exp2()
        };
        let (left, right) = (&cores[k], &cores[k + 1]);
        let first =
            Core::from_fn(left.left(), left.mode(), left.right(), |a, i, b| left.get(a, i, b) * size(b));
        let second =
            Core::from_fn(right.left(), right.mode(), right.right(), |a, i, b| right.get(a, i, b) / size(a));
        (cores[k], cores[k + 1]) = (first, second);
    }
    TtVector::from_cores(cores).unwrap()
}

#[test]
fn residuals_of_large_ranks_are_those_of_the_full_vectors() {
    let line = qtt::laplacian(4).unwrap();
    let a = qtt::kronecker_sum(&[line.clone(), line.clone(), line], DigitOrder::Morton).unwrap();
    let x = TtVector::random(&[2; 12], 64, 7).unwrap();
    let (product, noise) = (a.times_vector(&x).unwrap(), TtVector::random(&[2; 12], 8, 8).unwrap());
    for part in [1e-3, 1e-5, 1e-8] {
        let y = product.add(&noise.scale(part * product.norm() / noise.norm())).unwrap();
        let full = |train: &TtVector| train.to_full().unwrap();
        let truth = distance(&full(&product), &full(&y));
        for digits in [0.0, 6.0] {
            let (x, y) = (other_gauge(&x, digits), other_gauge(&y, digits));
            assert!(a.max_rank() * x.max_rank() > 400);
            let measured = measured_residual(&a, &x, &y, &[1; 12]).unwrap();
            assert!((measured.value / truth - 1.0).abs() < 1e-4, "{part:e}: {measured:?} {truth:e}");
            assert!(measured.floor < 1e-10, "{measured:?}");
        }
    }
}

/// ||A x - y|| / ||y|| from full matrices.
fn dense_residual(a: &TtMatrix, x: &TtVector, y: &TtVector) -> f64 {
    let (a, x, y) = (a.to_full().unwrap(), x.to_full().unwrap(), y.to_full().unwrap());
    let row = |i: usize| (0..x.len()).map(|j| a[(i, j)] * x[j]).sum::<f64>();
    distance(&(0..y.len()).map(row).collect::<Vec<_>>(), &y)
}

#[test]
fn singular_systems_give_their_best_iterate_and_its_residual() {
    let free = qtt::laplacian_with(6, Boundary::Neumann, Boundary::Neumann).unwrap();
    let one = TtVector::constant(&[2; 6], 1.0).unwrap();
    let wave = qtt::sine(6, 0.3, 0.1).unwrap();
    // Half of one and half of what is in the range.
    let solvable = free.times_vector(&wave).unwrap();
    let half = solvable.scale(8.0 / solvable.norm()).add(&one).unwrap();
    let shift = qtt::shift(6).unwrap();
    for method in [Method::Amen, Method::Als, Method::Dmrg] {
        for direct_limit in [8, 1000] {
            let settings = SolveSettings { method, direct_limit, ..Default::default() };
            for (a, y, reachable) in [
                (&free, &one, 1.0),
                (&free, &solvable, 0.0),
                (&free, &half, 0.5f64.sqrt()),
                (&shift, &one, 0.0),
            ] {
                let (x, report) = solve(a, y, None, &settings).unwrap();
                let truth = dense_residual(a, &x, y);
                assert!(
                    (truth - report.residual).abs() <= 1e-9 * truth + report.floor + 1e-14,
                    "{truth} {report:?}"
                );
                assert!(report.residual <= 1.0 + 1e-12, "{method:?} {direct_limit} {report:?}");
                assert!(x.norm() < 1e8 * y.norm(), "{method:?} {direct_limit}: {}", x.norm());
                assert_eq!(
                    report.status == SolveStatus::Converged,
                    truth <= settings.tolerance,
                    "{report:?}"
                );
                assert!(report.residual >= reachable - 1e-9);
            }
            if direct_limit == 1000 && method != Method::Als {
                let report = solve(&free, &solvable, None, &settings).unwrap().1;
                assert_eq!(report.status, SolveStatus::Converged, "{method:?} {report:?}");
                // (A Galerkin projection does not minimise the residual: 0.707 would be the smallest.)
                let report = solve(&free, &half, None, &settings).unwrap().1;
                assert!(report.residual < 0.97, "{method:?} {report:?}");
            }
        }
    }
    for form in [InverseForm::Energy, InverseForm::Residual, InverseForm::Symmetric] {
        let (_, report) = inverse(&free, form, None, &SolveSettings::default()).unwrap();
        assert!(
            report.residual <= 1.0 + 1e-12 && report.status != SolveStatus::Converged,
            "{form:?} {report:?}"
        );
    }
}

#[test]
fn an_axis_far_weaker_than_another_is_kept() {
    let line = qtt::laplacian(4).unwrap();
    for order in [DigitOrder::Morton, DigitOrder::Separated] {
        for weak in [1e-3, 1e-15, 1e-30] {
            let sum = qtt::kronecker_sum(&[line.clone(), line.scale(weak)], order).unwrap();
            let both = qtt::kronecker_sum(&[line.clone(), line.clone()], order).unwrap();
            assert_eq!(sum.ranks(), both.ranks(), "{order:?} {weak:e}");
            // Coordinates (x, y): a step in y alone is the weak axis alone.
            let place = |x: usize, y: usize| match order {
                DigitOrder::Morton => qtt::morton(&[x, y], 4).unwrap(),
                DigitOrder::Separated => x + 16 * y,
            };
            for (x, y) in [(0, 0), (3, 7), (15, 14)] {
                let entry = sum.entries(&[(place(x, y), place(x, y + 1))]).unwrap()[0];
                assert!((entry / -weak - 1.0).abs() < 1e-12, "{order:?} {weak:e}: {entry:e}");
                let entry = sum.entries(&[(place(x, y), place(x, y))]).unwrap()[0];
                assert!((entry - 2.0 - 2.0 * weak).abs() < 1e-14, "{entry}");
            }
        }
    }
}

#[test]
fn a_sketch_of_too_small_a_rank_says_so() {
    let mut factors = Vec::new();
    for seed in 0..40u64 {
        let (d, rank) = (6 + seed as usize % 8, 1 + seed as usize % 5);
        // A train of rank 12 whose terms fall off.
        let mut tensor = TtVector::random(&vec![2; d], 1, seed).unwrap();
        for k in 1..12u64 {
            let term = TtVector::random(&vec![2; d], 1, 100 + 20 * seed + k).unwrap();
            let fall = 0.5f64.powi(k as i32);
            tensor = tensor.add(&term.scale(fall * tensor.norm() / term.norm())).unwrap();
        }
        let mut sketch = Sketch::new(&vec![2; d], rank, seed).unwrap();
        sketch.add_train(&tensor).unwrap();
        let (train, report) = sketch.to_train(&Truncation::to(1e-12)).unwrap();
        assert!(train.max_rank() <= rank);
        let truth = train.relative_distance(&tensor).unwrap();
        factors.push(report.error / truth);
    }
    factors.sort_by(f64::total_cmp);
    println!("estimate over truth from {:.2} to {:.2}", factors[0], factors[39]);
    assert!(factors[0] > 0.4 && factors[39] < 3.0, "{factors:?}");
    // Rank 4 in a sketch of rank 2, and of rank 4.
    let tensor = TtVector::random(&[3; 7], 4, 5).unwrap();
    for (rank, exact) in [(2, false), (4, true)] {
        let mut sketch = Sketch::new(&[3; 7], rank, 9).unwrap();
        sketch.add_train(&tensor).unwrap();
        let (train, report) = sketch.to_train(&Truncation::to(1e-12)).unwrap();
        let truth = train.relative_distance(&tensor).unwrap();
        assert_eq!(truth < 1e-10, exact, "{truth:e}");
        assert_eq!(report.error < 1e-10, exact, "{report:?}");
        assert_eq!(report.capped, !exact, "{report:?}");
    }
}

#[test]
fn what_does_not_fit_is_refused_before_it_is_asked_for() {
    for levels in [0, 3, 16] {
        let matrix = QuadtreeMatrix::from_entries(1 << 15, levels, [(0, 0, 1.0), (7, 32767, 2.0)]).unwrap();
        assert!(matches!(matrix.to_train(&Truncation::to(1e-3)), Err(TtError::TooLarge { .. })));
        assert!(matches!(
            matrix.to_definite_train(&Truncation::to(1e-3), 0.1, 5),
            Err(TtError::TooLarge { .. })
        ));
        assert!(matches!(TtMatrix::identity(&matrix.modes()), Err(TtError::TooLarge { .. })));
    }
}

#[test]
fn sums_without_their_zero_blocks_are_sums() {
    for seed in 0..30u64 {
        let modes: Vec<usize> = (0..1 + seed as usize % 6).map(|k| 1 + (k + seed as usize) % 4).collect();
        let terms: Vec<TtVector> = (0..1 + seed % 5)
            .map(|k| TtVector::random(&modes, 1 + k as usize, 10 * seed + k).unwrap())
            .collect();
        let weights: Vec<f64> = (0..terms.len()).map(|k| if k == 2 { 0.0 } else { 1.5 - k as f64 }).collect();
        let mut exact = vec![0.0; modes.iter().product()];
        for (term, weight) in terms.iter().zip(&weights) {
            exact.iter_mut().zip(term.to_full().unwrap()).for_each(|(sum, x)| *sum += weight * x);
        }
        let pairs: Vec<(f64, &TtVector)> = weights.iter().copied().zip(&terms).collect();
        for tolerance in [0.0, 1e-8, 0.3] {
            let (sum, report) = TtVector::sum_rounded(&pairs, &Truncation::to(tolerance)).unwrap();
            let truth = distance(&sum.to_full().unwrap(), &exact);
            assert!(
                truth <= tolerance + report.floor && (truth - report.error).abs() < 1e-13 + report.floor,
                "{truth} {report:?}"
            );
        }
    }
    assert!(TtVector::sum_rounded(&[], &Truncation::default()).is_err());
    let (x, y) = (TtVector::random(&[2, 3], 2, 1).unwrap(), TtVector::random(&[3, 2], 2, 1).unwrap());
    assert!(TtVector::sum_rounded(&[(1.0, &x), (1.0, &y)], &Truncation::default()).is_err());
    assert!(TtVector::sum_rounded(&[(f64::NAN, &x)], &Truncation::default()).is_err());
}
