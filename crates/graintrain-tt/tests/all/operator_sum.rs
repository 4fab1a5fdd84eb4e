//! Sums of products of local operators against Kronecker products of full matrices, and their ranks against
//! those of unfoldings.

use graintrain_linalg::dense::Matrix;
use graintrain_linalg::dense::symmetric_eigen;
use graintrain_tt::operator_sum::{LocalOperator, OperatorSum};
use graintrain_tt::solve::{EigenSettings, lowest_eigenpairs};
use graintrain_tt::{FullMatrix, Truncation, TtError, TtMatrix};

fn named(operator: LocalOperator, n: usize) -> FullMatrix {
    operator.matrix(n).unwrap()
}

/// S_k . S_{k+1} summed over a chain of spins.
fn heisenberg(sites: usize, n: usize) -> OperatorSum {
    let [plus, minus, z] =
        [LocalOperator::SPlus, LocalOperator::SMinus, LocalOperator::Sz].map(|o| named(o, n));
    let mut sum = OperatorSum::new(&vec![n; sites]).unwrap();
    sum.add_translates(0.5, &[&plus, &minus]).unwrap();
    sum.add_translates(0.5, &[&minus, &plus]).unwrap();
    sum.add_translates(1.0, &[&z, &z]).unwrap();
    sum
}

/// The same by brute force: a product of full matrices, site 1 the finest digit.
fn kronecker(modes: &[usize], factors: &[(usize, &FullMatrix)]) -> Matrix {
    let size = modes.iter().product();
    Matrix::from_fn(size, size, |i, j| {
        let (mut i, mut j, mut value) = (i, j, 1.0);
        for (site, &n) in modes.iter().enumerate() {
            let here = factors.iter().find(|(at, _)| *at == site);
            value *= here.map_or(f64::from(i % n == j % n), |(_, operator)| operator[(i % n, j % n)]);
            (i, j) = (i / n, j / n);
        }
        value
    })
}

fn largest_difference(a: &TtMatrix, b: &Matrix) -> f64 {
    let full = a.to_full().unwrap();
    let mut largest = 0.0_f64;
    for i in 0..b.rows() {
        (0..b.columns()).for_each(|j| largest = largest.max((full[(i, j)] - b[(i, j)]).abs()));
    }
    largest
}

/// Ranks of the unfoldings, from singular values above 1e-10 of the largest.
fn unfolding_ranks(a: &TtMatrix) -> Vec<usize> {
    let values = a.as_vector().singular_values().unwrap();
    values.iter().map(|s| s.iter().filter(|&&x| x > 1e-10 * s[0]).count()).collect()
}

#[test]
fn the_heisenberg_chain_has_ranks_5_and_the_energies_of_the_full_matrix() {
    let h = heisenberg(9, 2).to_matrix().unwrap();
    assert_eq!(h.ranks()[1..9], [4, 5, 5, 5, 5, 5, 5, 4]);
    let size = 1 << 9;
    let mut full = Matrix::zeros(size, size);
    let operators = [LocalOperator::Sx, LocalOperator::ISy, LocalOperator::Sz].map(|o| named(o, 2));
    for k in 0..8 {
        for (operator, sign) in operators.iter().zip([1.0, -1.0, 1.0]) {
            let term = kronecker(&[2; 9], &[(k, operator), (k + 1, operator)]);
            (0..size * size).for_each(|e| full[(e % size, e / size)] += sign * term[(e % size, e / size)]);
        }
    }
    assert_eq!(largest_difference(&h, &full), 0.0);
    let (energies, _) = symmetric_eigen(full.view()).unwrap();
    // The ground state of an odd chain is a doublet, then a quartet: the third level is the sixth.
    let pairs = lowest_eigenpairs(&h, 3, &EigenSettings::default()).unwrap();
    for (pair, energy) in pairs.iter().zip(&energies) {
        assert!(pair.converged && (pair.value - energy).abs() < 1e-9, "{} {energy}", pair.value);
    }
}

#[test]
fn chains_of_known_energy() {
    // Ten spins one half: -4.258035207 (Bethe ansatz and every table of exact diagonalisation).
    let ten =
        lowest_eigenpairs(&heisenberg(10, 2).to_matrix().unwrap(), 1, &EigenSettings::default()).unwrap();
    assert!((ten[0].value + 4.258035207282882).abs() < 1e-9, "{}", ten[0].value);
    // Two spins one: total spin 0, (0 - 2 - 2) / 2.
    let two =
        lowest_eigenpairs(&heisenberg(2, 3).to_matrix().unwrap(), 1, &EigenSettings::default()).unwrap();
    assert!((two[0].value + 2.0).abs() < 1e-12);
}

#[test]
fn sums_over_all_pairs_have_the_smallest_ranks() {
    let (z, number) = (named(LocalOperator::Sz, 2), named(LocalOperator::Number, 2));
    let sites = 8;
    let pairs = || (0..sites).flat_map(|i| (0..i).map(move |j| (j, i)));
    // Exponential couplings need one state more than a field, any couplings as many as the shorter side has
    // sites.
    let exponential = |i: usize, j: usize| 0.7f64.powi((j - i) as i32);
    let any = |i: usize, j: usize| ((17 * i * i * j + 31 * j * j) as f64).sin();
    for (coupling, expected) in
        [(&exponential as &dyn Fn(usize, usize) -> f64, [2, 3, 3, 3, 3, 3, 2]), (&any, [2, 4, 5, 6, 5, 4, 2])]
    {
        let mut sum = OperatorSum::new(&vec![2; sites]).unwrap();
        let mut full = Matrix::zeros(1 << sites, 1 << sites);
        for (i, j) in pairs() {
            sum.add(coupling(i, j), &[(j, &z), (i, &z)]).unwrap();
            let term = kronecker(&vec![2; sites], &[(i, &z), (j, &z)]);
            (0..1 << sites).for_each(|e| full[(e, e)] += coupling(i, j) * term[(e, e)]);
        }
        let matrix = sum.to_matrix().unwrap();
        assert!(largest_difference(&matrix, &full) < 1e-14);
        assert_eq!(matrix.ranks()[1..sites], expected);
        assert_eq!(unfolding_ranks(&matrix), expected);
    }
    // Operators that depend on each other and the identity: n = 1/2 - Sz.
    let mut sum = OperatorSum::new(&[2; 6]).unwrap();
    sum.add_translates(1.0, &[&z]).unwrap().add_translates(1.0, &[&number]).unwrap();
    let constant = sum.to_matrix().unwrap();
    assert_eq!((constant.max_rank(), constant.entry(&[0; 6], &[0; 6]).unwrap()), (1, 3.0));
}

#[test]
fn small_weights_stay_and_terms_cancel() {
    let (a, create) = (named(LocalOperator::Annihilate, 3), named(LocalOperator::Create, 3));
    let mut sum = OperatorSum::new(&[3, 2, 3]).unwrap();
    sum.add(1.0, &[(2, &a)]).unwrap().add(1e-18, &[(0, &a), (2, &create)]).unwrap();
    // Written out of order and twice at a site: a a^T at site 0.
    sum.add(2.0, &[(2, &a), (0, &a), (0, &create)])
        .unwrap()
        .add(0.0, &[(1, &named(LocalOperator::Sx, 2))])
        .unwrap();
    assert_eq!((sum.num_terms(), sum.modes()), (4, &[3, 2, 3][..]));
    let h = sum.to_matrix().unwrap();
    assert_eq!(h.entry(&[0, 1, 2], &[1, 1, 1]).unwrap(), 1e-18 * 2f64.sqrt());
    assert_eq!(h.entry(&[1, 0, 0], &[1, 0, 1]).unwrap(), 1.0 + 2.0 * (2f64.sqrt() * 2f64.sqrt()));
    sum.add(-1.0, &[(2, &a)]).unwrap().add(-1e-18, &[(2, &create), (0, &a)]).unwrap();
    let product = kronecker(
        &[3, 2, 3],
        &[(0, &FullMatrix::new(3, 3, vec![1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0]).unwrap()), (2, &a)],
    );
    let rest = sum.to_matrix().unwrap();
    assert_eq!(rest.max_rank(), 1);
    assert!(largest_difference(&rest.scale(0.5), &product) < 1e-15);
    let nothing = OperatorSum::new(&[2, 2]).unwrap().to_matrix().unwrap();
    assert_eq!((nothing.ranks(), nothing.norm()), (vec![1, 1, 1], 0.0));
    let mut identity = OperatorSum::new(&[2, 2]).unwrap();
    identity.add(3.0, &[]).unwrap();
    let distance =
        identity.to_matrix().unwrap().relative_distance(&TtMatrix::identity(&[2, 2]).unwrap().scale(3.0));
    assert!(distance.unwrap() < 1e-15);
}

#[test]
fn long_sums_are_quick_and_power_laws_round() {
    let h = heisenberg(1000, 2).to_matrix().unwrap();
    assert_eq!(h.max_rank(), 5);
    // 1 / r^2 between all pairs of 60 spins: full ranks as they stand, few to 1e-8.
    let z = named(LocalOperator::Sz, 2);
    let mut sum = OperatorSum::new(&[2; 60]).unwrap();
    for i in 0..60 {
        for j in 0..i {
            sum.add(((i - j) as f64).powi(-2), &[(j, &z), (i, &z)]).unwrap();
        }
    }
    let h = sum.to_matrix().unwrap();
    assert!(
        h.max_rank() <= 32 && h.round(&Truncation::to(1e-8)).unwrap().0.max_rank() <= 12,
        "{:?}",
        h.ranks()
    );
    let energy: f64 = (0..60).flat_map(|i| (0..i).map(move |j| 0.25 / ((i - j) as f64).powi(2))).sum();
    assert!((h.entry(&[0; 60], &[0; 60]).unwrap() / energy - 1.0).abs() < 1e-12);
}

#[test]
fn what_is_wrong_is_refused_and_changes_nothing() {
    assert!(matches!(OperatorSum::new(&[]), Err(TtError::Shape { .. })));
    assert!(matches!(OperatorSum::new(&[2, 0]), Err(TtError::Shape { .. })));
    assert!(matches!(OperatorSum::new(&[1 << 20]), Err(TtError::TooLarge { .. })));
    assert!(LocalOperator::Sz.matrix(0).is_err() && LocalOperator::Sz.matrix(usize::MAX).is_err());
    let mut sum = OperatorSum::new(&[2, 2, 3]).unwrap();
    let (z, wide) = (named(LocalOperator::Sz, 2), FullMatrix::new(2, 3, vec![0.0; 6]).unwrap());
    let infinite = FullMatrix::new(2, 2, vec![f64::INFINITY; 4]).unwrap();
    assert!(matches!(sum.add(f64::NAN, &[]), Err(TtError::Setting { .. })));
    assert!(matches!(sum.add(1.0, &[(3, &z)]), Err(TtError::Index { .. })));
    assert!(matches!(sum.add(1.0, &[(0, &wide)]), Err(TtError::Shape { .. })));
    assert!(matches!(sum.add(1.0, &[(0, &infinite)]), Err(TtError::Dense { .. })));
    assert!(sum.add_translates(1.0, &[]).is_err() && sum.add_translates(1.0, &[&z, &z]).is_err());
    assert_eq!(sum.num_terms(), 0);
}
