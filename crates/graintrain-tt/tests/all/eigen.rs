//! Lowest eigenpairs against closed forms and dense eigenvalues.

use crate::dense::dense;
use graintrain_linalg::dense::symmetric_eigen;
use graintrain_tt::solve::{EigenMethod, EigenSettings, lowest_eigenpairs};
use graintrain_tt::{TtError, TtMatrix, TtVector, qtt};
use std::f64::consts::PI;

fn line(k: usize, n: usize) -> f64 {
    4.0 * (PI * k as f64 / (2.0 * (n + 1) as f64)).sin().powi(2)
}

#[test]
fn lines_and_planes_have_the_eigenvalues_of_the_formula() {
    let settings = EigenSettings { tolerance: 1e-9, ..Default::default() };
    let a = qtt::laplacian(10).unwrap();
    for (k, pair) in lowest_eigenpairs(&a, 4, &settings).unwrap().iter().enumerate() {
        assert!(pair.converged && (pair.value - line(k + 1, 1024)).abs() < 1e-11, "{k}: {pair:?}");
        assert!(pair.vector.max_rank() <= 4 && (pair.vector.norm() - 1.0).abs() < 1e-12);
    }
    let line5 = qtt::laplacian(5).unwrap();
    let plane = qtt::kronecker_sum(&[line5.clone(), line5.scale(1.3)], qtt::DigitOrder::Separated).unwrap();
    let mut exact: Vec<f64> = (0..9).map(|k| line(1 + k % 3, 32) + 1.3 * line(1 + k / 3, 32)).collect();
    exact.sort_by(f64::total_cmp);
    let pairs = lowest_eigenpairs(&plane, 4, &settings).unwrap();
    for (pair, exact) in pairs.iter().zip(&exact) {
        assert!(
            pair.converged && (pair.value - exact).abs() < 1e-9,
            "{} {exact} {:e}",
            pair.value,
            pair.residual
        );
    }
    for (i, x) in pairs.iter().enumerate() {
        for y in &pairs[..i] {
            assert!(x.vector.dot(&y.vector).unwrap().abs() < 1e-6);
        }
    }
}

/// sum_k S_k . S_{k+1} of d spins one half.
fn heisenberg(d: usize) -> TtMatrix {
    // S_z, and S_x, S_y as (S_+ S_- + S_- S_+) / 2; column-major.
    let (eye, z) = (vec![1.0, 0.0, 0.0, 1.0], vec![0.5, 0.0, 0.0, -0.5]);
    let (up, down) = (vec![0.0, 0.0, 1.0, 0.0], vec![0.0, 1.0, 0.0, 0.0]);
    let mut total: Option<TtMatrix> = None;
    for k in 0..d - 1 {
        for (first, second, weight) in [(&z, &z, 1.0), (&up, &down, 0.5), (&down, &up, 0.5)] {
            let factors: Vec<Vec<f64>> = (0..d)
                .map(|m| {
                    if m == k {
                        first.clone()
                    } else if m == k + 1 {
                        second.clone()
                    } else {
                        eye.clone()
                    }
                })
                .collect();
            let term = TtMatrix::rank_one(&factors, &vec![2; d], &vec![2; d]).unwrap().scale(weight);
            total = Some(match total {
                None => term,
                Some(sum) => sum.add(&term).unwrap().without_dependent_ranks(),
            });
        }
    }
    total.unwrap()
}

#[test]
fn spin_chains_have_their_known_energies() {
    // Open Heisenberg chains; 10 spins: -4.258035207, 20 spins: -8.682473334 (exact diagonalisation, DMRG
    // literature).
    for (d, energy) in [(2, -0.75), (4, -1.616025403784), (10, -4.258035207), (20, -8.682473334)] {
        let h = heisenberg(d);
        assert!(h.max_rank() <= 5, "{:?}", h.ranks());
        let settings = EigenSettings { tolerance: 1e-6, max_rank: 80, ..Default::default() };
        let pair = &lowest_eigenpairs(&h, 1, &settings).unwrap()[0];
        assert!(
            pair.converged && (pair.value - energy).abs() < 1e-8,
            "{d}: {} {:e} rank {}",
            pair.value,
            pair.residual,
            pair.vector.max_rank()
        );
    }
}

#[test]
fn random_matrices_against_dense_eigenvalues() {
    for seed in 0..6 {
        let a = TtMatrix::random(&[3, 2, 3], &[3, 2, 3], 3, seed).unwrap().symmetric_part().unwrap();
        let (values, _) = symmetric_eigen(dense(&a).view()).unwrap();
        let pairs =
            lowest_eigenpairs(&a, 3, &EigenSettings { max_sweeps: 60, ..Default::default() }).unwrap();
        for (k, pair) in pairs.iter().enumerate() {
            let nearest = values.iter().map(|x| (x - pair.value).abs()).fold(f64::INFINITY, f64::min);
            assert!(
                nearest <= pair.residual + pair.floor + 1e-13,
                "{seed} {k}: {nearest:e} {:e}",
                pair.residual
            );
            assert!(
                !pair.converged || (pair.value - values[k]).abs() < 1e-6 * values[17].abs(),
                "{seed} {k}"
            );
            assert!(pair.converged, "{seed} {k} {:e}", pair.residual);
        }
    }
    // One core, more pairs than there are, and what is refused.
    let small = TtMatrix::from_diagonal(&TtVector::rank_one(&[vec![3.0, -1.0, 2.0]]).unwrap());
    let pairs = lowest_eigenpairs(&small, 9, &EigenSettings::default()).unwrap();
    assert_eq!(pairs.iter().map(|pair| pair.value.round() as i32).collect::<Vec<_>>(), [-1, 2, 3]);
    let skew = qtt::tridiagonal(4, -1.0, 0.0, 1.0).unwrap();
    assert!(matches!(lowest_eigenpairs(&skew, 1, &EigenSettings::default()), Err(TtError::Setting { .. })));
    let bad = qtt::laplacian(4).unwrap().scale(f64::NAN);
    assert!(lowest_eigenpairs(&bad, 1, &EigenSettings::default()).is_err());
}

const METHODS: [EigenMethod; 2] = [EigenMethod::Dmrg, EigenMethod::Amen];

#[test]
fn blocks_hold_clusters_and_degenerate_eigenvalues() {
    // A square: every second eigenvalue is double. The six lowest of 2^12 points.
    let line = qtt::laplacian(6).unwrap();
    let square = qtt::kronecker_sum(&[line.clone(), line], qtt::DigitOrder::Separated).unwrap();
    let exact_line: Vec<f64> = (1..4).map(|k| 4.0 * (PI * f64::from(k) / 130.0).sin().powi(2)).collect();
    let mut exact: Vec<f64> = exact_line.iter().flat_map(|x| exact_line.iter().map(move |y| x + y)).collect();
    exact.sort_by(f64::total_cmp);
    for method in METHODS {
        let settings = EigenSettings { tolerance: 1e-7, method, ..Default::default() };
        let pairs = lowest_eigenpairs(&square, 6, &settings).unwrap();
        assert_eq!(pairs.len(), 6);
        for (i, (pair, exact)) in pairs.iter().zip(&exact).enumerate() {
            assert!(pair.converged, "{method:?} {i}: {:e}", pair.residual);
            assert!((pair.value - exact).abs() < 1e-10, "{method:?} {i}: {} {exact}", pair.value);
            for other in &pairs[..i] {
                assert!(pair.vector.dot(&other.vector).unwrap().abs() < 1e-5);
            }
        }
    }
}

#[test]
fn both_methods_against_dense_eigenvalues() {
    // A chain of 8 spins: a singlet, then triplets.
    let chain = heisenberg(8);
    let (values, _) = symmetric_eigen(dense(&chain).view()).unwrap();
    let random = TtMatrix::random(&[3, 2, 4, 3], &[3, 2, 4, 3], 3, 4).unwrap().symmetric_part().unwrap();
    let (random_values, _) = symmetric_eigen(dense(&random).view()).unwrap();
    for method in METHODS {
        for (a, values, count) in [(&chain, &values, 7), (&random, &random_values, 5)] {
            let settings = EigenSettings { tolerance: 1e-7, method, ..Default::default() };
            let pairs = lowest_eigenpairs(a, count, &settings).unwrap();
            for (k, (pair, exact)) in pairs.iter().zip(values.iter()).enumerate() {
                assert!(pair.converged, "{method:?} {k}: {:e}", pair.residual);
                assert!((pair.value - exact).abs() < 1e-8, "{method:?} {k}: {} {exact}", pair.value);
            }
        }
        // All eigenvalues of a small matrix; a cap that is too small is not called converged.
        let small = qtt::laplacian(4).unwrap();
        let pairs = lowest_eigenpairs(&small, 99, &EigenSettings { method, ..Default::default() }).unwrap();
        assert_eq!(pairs.len(), 16);
        for (k, pair) in pairs.iter().enumerate() {
            assert!(
                (pair.value - line(k + 1, 16)).abs() < 1e-12 && pair.converged,
                "{method:?} {k} {pair:?}"
            );
        }
        let settings = EigenSettings { max_rank: 2, method, ..Default::default() };
        let pairs = lowest_eigenpairs(&heisenberg(10), 1, &settings).unwrap();
        assert!(
            !pairs[0].converged && pairs[0].residual > 1e-3 && pairs[0].vector.max_rank() <= 2,
            "{pairs:?}"
        );
        assert!(pairs[0].value > -4.258035207, "{}", pairs[0].value);
    }
}

#[test]
fn the_long_chain_by_single_sites() {
    let settings =
        EigenSettings { tolerance: 1e-6, max_rank: 80, method: EigenMethod::Amen, ..Default::default() };
    let pair = &lowest_eigenpairs(&heisenberg(20), 1, &settings).unwrap()[0];
    assert!(pair.converged && (pair.value + 8.682473334).abs() < 1e-8, "{} {:e}", pair.value, pair.residual);
}

#[test]
fn zero_and_single_points_have_eigenpairs() {
    for method in METHODS {
        let settings = EigenSettings { method, ..Default::default() };
        let zero = TtMatrix::identity(&[2, 3]).unwrap().scale(0.0);
        let pairs = lowest_eigenpairs(&zero, 9, &settings).unwrap();
        assert!(pairs.len() == 6 && pairs.iter().all(|pair| pair.converged && pair.value == 0.0));
        let pairs = lowest_eigenpairs(&TtMatrix::identity(&[1, 1]).unwrap(), 3, &settings).unwrap();
        assert!(pairs.len() == 1 && (pairs[0].value - 1.0).abs() < 1e-15);
        let pairs = lowest_eigenpairs(&TtMatrix::identity(&[2; 30]).unwrap(), 3, &settings).unwrap();
        assert!(pairs.iter().all(|pair| pair.converged && (pair.value - 1.0).abs() < 1e-13));
        assert!(lowest_eigenpairs(&zero, 0, &settings).unwrap().is_empty());
    }
}
