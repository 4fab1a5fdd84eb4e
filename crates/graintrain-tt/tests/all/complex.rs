//! Complex trains against complex numbers.

use graintrain_tt::complex::{ComplexMatrix, ComplexVector};
use graintrain_tt::fourier::Direction;
use graintrain_tt::solve::{SolveSettings, SolveStatus};
use graintrain_tt::{Truncation, TtMatrix, TtVector};
use num_complex::Complex64;
use std::f64::consts::TAU;

fn random(modes: &[usize], rank: usize, seed: u64) -> ComplexVector {
    let part = |seed| TtVector::random(modes, rank, seed).unwrap();
    ComplexVector::new(&part(seed), &part(seed + 100)).unwrap()
}

fn distance(x: &[Complex64], y: &[Complex64]) -> f64 {
    let size: f64 = y.iter().map(|z| z.norm_sqr()).sum();
    (x.iter().zip(y).map(|(a, b)| (a - b).norm_sqr()).sum::<f64>() / size).sqrt()
}

#[test]
fn arithmetic_is_that_of_complex_numbers() {
    let modes = [3, 2, 4];
    let (x, y) = (random(&modes, 2, 1), random(&modes, 3, 2));
    let (fx, fy) = (x.to_full().unwrap(), y.to_full().unwrap());
    let a = Complex64::new(0.3, -1.7);
    let by_entry = |f: &dyn Fn(Complex64, Complex64) -> Complex64| -> Vec<Complex64> {
        fx.iter().zip(&fy).map(|(x, y)| f(*x, *y)).collect()
    };
    let full = |z: ComplexVector| z.to_full().unwrap();
    assert!(distance(&full(x.add(&y.scale(a)).unwrap()), &by_entry(&|x, y| x + a * y)) < 1e-14);
    assert!(distance(&full(x.subtract(&y.conjugate()).unwrap()), &by_entry(&|x, y| x - y.conj())) < 1e-14);
    assert!(distance(&full(x.hadamard(&y).unwrap()), &by_entry(&|x, y| x * y)) < 1e-14);
    let dot: Complex64 = fx.iter().zip(&fy).map(|(x, y)| x.conj() * y).sum();
    assert!((x.dot(&y).unwrap() - dot).norm() < 1e-13 * dot.norm());
    let norm = fx.iter().map(|z| z.norm_sqr()).sum::<f64>().sqrt();
    assert!((x.norm() / norm - 1.0).abs() < 1e-14 && (x.dot(&x).unwrap().im).abs() < 1e-12 * norm * norm);
    assert!((x.entry(&[2, 1, 3]).unwrap() - fx[2 + 3 * (1 + 2 * 3)]).norm() < 1e-14);
    assert_eq!((x.modes(), x.real().modes()), (modes.to_vec(), modes.to_vec()));
    let parts = ComplexVector::new(&x.real(), &x.imaginary()).unwrap();
    assert!(distance(&full(parts), &fx) < 1e-15);
    // There and back; rounding keeps its promise.
    let (again, report) = ComplexVector::from_full(&fx, &modes, &Truncation::to(1e-12)).unwrap();
    assert!(distance(&full(again), &fx) < 1e-12 && report.error < 1e-12);
    let (rounded, report) = x.add(&x).unwrap().round(&Truncation::to(0.3)).unwrap();
    let truth = distance(&full(rounded), &fx.iter().map(|z| 2.0 * z).collect::<Vec<_>>());
    assert!(truth <= 0.3 && (truth - report.error).abs() < 1e-12, "{truth} {report:?}");
    // What does not fit is an error.
    assert!(x.add(&random(&[2, 2], 1, 1)).is_err() && ComplexVector::from_parts(x.real()).is_err());
    assert!(x.entry(&[0, 0]).is_err() && ComplexVector::rank_one(&[]).is_err());
    assert!(
        ComplexVector::rank_one(&[vec![]]).is_err()
            && ComplexVector::from_full(&[], &[], &Truncation::default()).is_err()
    );
}

#[test]
fn waves_have_rank_two_and_transforms_are_sums() {
    let d = 8;
    let factor =
        |k: usize| vec![Complex64::new(0.7, 0.1), Complex64::from_polar(1.1, 0.013 * (1 << k) as f64)];
    let factors: Vec<Vec<Complex64>> = (0..d).map(factor).collect();
    let wave = ComplexVector::rank_one(&factors).unwrap();
    assert!(wave.ranks().iter().all(|&r| r <= 2));
    let full = wave.to_full().unwrap();
    for (j, z) in full.iter().enumerate() {
        let exact: Complex64 = (0..d).map(|k| factors[k][j >> k & 1]).product();
        assert!((z - exact).norm() < 1e-14, "{j}");
    }
    let x = wave.add(&random(&[2; 8], 2, 5)).unwrap();
    let full = x.to_full().unwrap();
    for (direction, sign) in [(Direction::Forward, -1.0), (Direction::Backward, 1.0)] {
        let (y, report) = x.fourier(direction, &Truncation::to(1e-11)).unwrap();
        let n = full.len();
        let term =
            |j: usize, m: usize| full[j] * Complex64::cis(sign * TAU * ((j * m) % n) as f64 / n as f64);
        let exact: Vec<Complex64> =
            (0..n).map(|m| (0..n).map(|j| term(j, m)).sum::<Complex64>() / 16.0).collect();
        let error = distance(&y.to_full().unwrap(), &exact);
        assert!(error <= report.error + 1e-13 && report.error <= 1e-11, "{error} {report:?}");
        let back = if sign < 0.0 { Direction::Backward } else { Direction::Forward };
        let (again, _) = y.fourier(back, &Truncation::to(1e-11)).unwrap();
        assert!(distance(&again.to_full().unwrap(), &full) < 3e-11);
    }
}

#[test]
fn systems_against_their_definition() {
    let modes = [2, 3, 2];
    let ones = TtMatrix::identity(&modes).unwrap();
    let part = |seed| TtMatrix::random(&modes, &modes, 2, seed).unwrap();
    let (re, im) = (part(1), part(2));
    let (re, im) = (ones.add(&re.scale(0.3 / re.norm())).unwrap(), im.scale(0.8 / im.norm()));
    let a = ComplexMatrix::new(&re, &im).unwrap();
    let y = random(&modes, 2, 3);
    let product = |x: &[Complex64]| -> Vec<Complex64> {
        let (re, im) = (re.to_full().unwrap(), im.to_full().unwrap());
        (0..12).map(|i| (0..12).map(|j| Complex64::new(re[(i, j)], im[(i, j)]) * x[j]).sum()).collect()
    };
    let settings = SolveSettings { tolerance: 1e-10, ..Default::default() };
    let (x, report) = a.solve(&y, &settings).unwrap();
    assert_eq!(report.status, SolveStatus::Converged, "{report:?}");
    let (fx, fy) = (x.to_full().unwrap(), y.to_full().unwrap());
    assert!(distance(&product(&fx), &fy) < 1e-10);
    assert!(distance(&a.times_vector(&y).unwrap().to_full().unwrap(), &product(&fy)) < 1e-13);
    // <A x, y> = <x, A* y>, and (A A*) x = A (A* x).
    let left = a.times_vector(&x).unwrap().dot(&y).unwrap();
    assert!((left - x.dot(&a.adjoint().times_vector(&y).unwrap()).unwrap()).norm() < 1e-12 * left.norm());
    let square = a.times_matrix(&a.adjoint()).unwrap().times_vector(&y).unwrap();
    let twice = a.times_vector(&a.adjoint().times_vector(&y).unwrap()).unwrap();
    assert!(square.subtract(&twice).unwrap().norm() < 1e-13 * twice.norm());
    assert!(ComplexMatrix::new(&re, &TtMatrix::identity(&[2, 3]).unwrap()).is_err());
}
