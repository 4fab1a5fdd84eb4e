//! The bottom-up pass over nonzero blocks against the TT-SVD of the full matrix.

use crate::dense::dense;
use graintrain_linalg::block3::BlockMatrix3;
use graintrain_linalg::dense::Matrix;
use graintrain_tt::apply::FullOperator;
use graintrain_tt::definite::extreme_eigenvalues;
use graintrain_tt::sketch::Sketch;
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Truncation, TtMatrix};
use proptest::prelude::*;

/// A random symmetric positive definite block matrix: a ring with extra links, one contact per place.
fn contact_like(rows: usize, links: usize, seed: u64) -> BlockMatrix3 {
    let mut state = seed | 1;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let mut dense = std::collections::BTreeMap::<(usize, usize), [f64; 9]>::new();
    for link in 0..rows + links {
        let i = if link < rows { link } else { (random() % rows as u64) as usize };
        let j = if link < rows { (link + 1) % rows } else { (random() % rows as u64) as usize };
        if i == j {
            continue;
        }
        let v: Vec<f64> = (0..6).map(|_| (random() % 2001) as f64 / 1000.0 - 1.0).collect();
        for (p, q, x, y) in [
            (i, i, &v[..3], &v[..3]),
            (j, j, &v[3..], &v[3..]),
            (i, j, &v[..3], &v[3..]),
            (j, i, &v[3..], &v[..3]),
        ] {
            let block = dense.entry((p, q)).or_insert([0.0; 9]);
            for e in 0..9 {
                block[e] += x[e / 3] * y[e % 3] + if p == q && e % 4 == 0 { 0.1 } else { 0.0 };
            }
        }
    }
    let mut row_start = vec![0];
    let (mut column, mut block) = (Vec::new(), Vec::new());
    for i in 0..rows {
        for (&(_, j), b) in dense.range((i, 0)..(i + 1, 0)) {
            column.push(j as u32);
            block.push(*b);
        }
        row_start.push(column.len());
    }
    BlockMatrix3::from_rows(row_start, column, block)
}

fn dense_of(s: &BlockMatrix3, place: &[usize], size: usize, dummy: f64) -> Matrix {
    let mut full = Matrix::zeros(size, size);
    full.data_mut().iter_mut().step_by(size + 1).for_each(|x| *x = dummy);
    for i in 0..s.num_rows() {
        (0..3).for_each(|a| full[(3 * place[i] + a, 3 * place[i] + a)] = 0.0);
    }
    for i in 0..s.num_rows() {
        let (columns, blocks) = s.row(i);
        for (&j, b) in columns.iter().zip(blocks) {
            for e in 0..9 {
                full[(3 * place[i] + e / 3, 3 * place[j as usize] + e % 3)] = b[e];
            }
        }
    }
    full
}

fn frobenius(a: &Matrix) -> f64 {
    a.data().iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn difference(a: &Matrix, b: &Matrix) -> f64 {
    a.data().iter().zip(b.data()).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt()
}

/// Distinct places in an order that is not sorted.
fn scattered(rows: usize, places: usize, seed: usize) -> Vec<usize> {
    let mut all: Vec<usize> = (0..places).collect();
    for i in (1..places).rev() {
        all.swap(i, (i * 7919 + seed * 104_729) % (i + 1));
    }
    all.truncate(rows);
    all
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_pass_is_the_tt_svd(
        rows in 3usize..40, links in 0usize..30, slots in 1usize..4, spare in 0usize..2, seed in 0u64..1000, digits in 1i32..11,
    ) {
        let tolerance = 10f64.powi(-digits);
        let levels = (rows.div_ceil(slots)).next_power_of_two().trailing_zeros() as usize + spare;
        let s = contact_like(rows, links, seed * 2 + 1);
        let place = scattered(rows, slots << levels, seed as usize);
        for dummy in [0.0, 1.0] {
            let quadtree = QuadtreeMatrix::from_blocks(s.iter(), &place, slots, levels, dummy).unwrap();
            let full = dense_of(&s, &place, 3 * (slots << levels), dummy);
            prop_assert!((quadtree.augmented_norm() - frobenius(&full)).abs() < 1e-10 * frobenius(&full));
            let (train, report) = quadtree.to_train(&Truncation::to(tolerance)).unwrap();
            let truth = difference(&dense(&train), &full);
            prop_assert!(truth <= (tolerance + 1e-12) * quadtree.norm(), "{} {}", truth / quadtree.norm(), tolerance);
            prop_assert!((truth / quadtree.norm() - report.error).abs() <= 1e-2 * tolerance + 1e-12);
            prop_assert!((truth / frobenius(&full) - report.augmented_error).abs() <= 1e-2 * tolerance + 1e-12);
            // The same absolute budget for the dense algorithm gives the same ranks.
            let share = tolerance * quadtree.norm() / quadtree.augmented_norm();
            let modes = quadtree.modes();
            let (by_svd, _) = TtMatrix::from_full(&crate::dense::full(&full), &modes, &modes, &Truncation::to(share)).unwrap();
            let (a, b) = (train.as_vector().num_parameters() as f64, by_svd.as_vector().num_parameters() as f64);
            prop_assert!((a / b - 1.0).abs() < 0.05, "{:?} and {:?}", train.ranks(), by_svd.ranks());
        }
    }

    #[test]
    fn entries_can_be_looked_up(rows in 3usize..20, slots in 1usize..4, seed in 0u64..1000) {
        let levels = (rows.div_ceil(slots)).next_power_of_two().trailing_zeros() as usize + 1;
        let s = contact_like(rows, 10, seed * 2 + 1);
        let place = scattered(rows, slots << levels, seed as usize);
        let quadtree = QuadtreeMatrix::from_blocks(s.iter(), &place, slots, levels, 1.0).unwrap();
        let size = 3 * (slots << levels);
        let full = dense_of(&s, &place, size, 1.0);
        for i in 0..size {
            for j in 0..size {
                prop_assert_eq!(quadtree.entry(i, j), full[(i, j)]);
            }
        }
        for (i, j, value) in quadtree.entries() {
            prop_assert_eq!(value, full[(i, j)]);
        }
    }
}

#[test]
fn a_lattice_has_the_ranks_of_its_stencil_at_two_to_the_forty_entries() {
    // tridiag(-1, 2, -1) of size 2^20, that is 2^40 entries: rank 3 at every bond, from 3 * 2^20 numbers.
    let n = 1usize << 20;
    let entries = (0..n).flat_map(|i| {
        [(i, i, 2.0)]
            .into_iter()
            .chain((i + 1 < n).then_some((i, i + 1, -1.0)))
            .chain((i > 0).then(|| (i, i - 1, -1.0)))
    });
    let quadtree = QuadtreeMatrix::from_entries(2, 19, entries).unwrap();
    for tolerance in [1e-5, 1e-12] {
        let (train, report) = quadtree.to_train(&Truncation::to(tolerance)).unwrap();
        assert_eq!(train.ranks()[1..20], [3; 19]);
        assert!(report.error <= tolerance && !report.capped);
        let truth = train.relative_distance(&graintrain_tt::qtt::laplacian(20).unwrap()).unwrap();
        assert!(truth < tolerance.max(1e-10), "{truth}");
    }
}

#[test]
fn dummies_cost_no_memory_and_hide_no_error() {
    // Four contacts in a tree of 2^30 leaves; the identity on all the others must not buy any error.
    let s = contact_like(4, 3, 5);
    let place = [5, 1 << 20, (1 << 29) + 3, (1 << 30) - 1];
    let quadtree = QuadtreeMatrix::from_blocks(s.iter(), &place, 1, 30, 1.0).unwrap();
    let (train, report) = quadtree.to_train(&Truncation::to(1e-3)).unwrap();
    assert!(report.error <= 1e-3 && report.augmented_error < 1e-3 * report.error.max(1e-12));
    let at: Vec<(usize, usize)> =
        (0..12).map(|i| 3 * place[i / 3] + i % 3).flat_map(|i| [(i, i), (i, 15), (7, 7)]).collect();
    let values = train.entries(&at).unwrap();
    let norm = s.blocks().iter().flatten().map(|x| x * x).sum::<f64>().sqrt();
    for (value, &(i, j)) in values.iter().zip(&at) {
        assert!((value - quadtree.entry(i, j)).abs() < 2e-3 * norm, "({i}, {j})");
    }
    assert!(QuadtreeMatrix::from_blocks(s.iter(), &[0, 1, 2, 2], 1, 30, 1.0).is_err());
    assert!(QuadtreeMatrix::from_blocks(s.iter(), &[0, 1, 2], 1, 30, 1.0).is_err());
    assert!(QuadtreeMatrix::from_blocks(s.iter(), &[0, 1, 2, 1 << 30], 1, 30, 1.0).is_err());
}

#[test]
fn a_cap_on_the_ranks_is_reported() {
    let s = contact_like(64, 200, 11);
    let place: Vec<usize> = (0..64).collect();
    let quadtree = QuadtreeMatrix::from_blocks(s.iter(), &place, 2, 5, 1.0).unwrap();
    let (train, report) = quadtree.to_train(&Truncation::capped(1e-3, 5)).unwrap();
    assert!(train.max_rank() <= 5 && report.capped && report.error > 0.1);
    let truth = difference(&dense(&train), &dense_of(&s, &place, 192, 1.0)) / quadtree.norm();
    assert!((truth - report.error).abs() < 1e-9);
}

#[test]
fn the_error_of_any_train_is_measured_over_all_entries() {
    let s = contact_like(40, 60, 21);
    let place = scattered(40, 64, 3);
    for dummy in [0.0, 1.0] {
        let quadtree = QuadtreeMatrix::from_blocks(s.iter(), &place, 4, 4, dummy).unwrap();
        let full = dense_of(&s, &place, 192, dummy);
        for rank in [1, 4, 12] {
            let train = quadtree.to_train(&Truncation::capped(1e-3, rank)).unwrap().0.scale(1.1);
            let truth = difference(&dense(&train), &full) / quadtree.norm();
            assert!((quadtree.relative_error(&train).unwrap() / truth - 1.0).abs() < 1e-6);
        }
    }
}

#[test]
fn sketches_are_linear_and_nearly_as_good_as_the_exact_pass() {
    // A lattice with a perturbation: rank 3 plus a small full-rank part.
    let n = 1 << 10;
    let entries = |size: f64| {
        (0..n).flat_map(move |i: usize| {
            let noise = size * ((i * i) as f64).sin();
            [(i, i, 2.0 + noise), (i, (i + 1) % n, -1.0), ((i + 1) % n, i, -1.0)]
        })
    };
    let quadtree = QuadtreeMatrix::from_entries(2, 9, entries(1e-4)).unwrap();
    let modes: Vec<usize> = quadtree.modes().iter().map(|n| n * n).collect();
    let mut sketch = Sketch::new(&modes, 6, 5).unwrap();
    sketch.add_sparse(&quadtree).unwrap();
    let (train, _) = sketch.to_train(&Truncation::to(1e-12)).unwrap();
    let train = TtMatrix::from_vector(train, &quadtree.modes(), &quadtree.modes()).unwrap();
    let exact = quadtree.to_train(&Truncation::capped(1e-12, 6)).unwrap().1.error;
    let sketched = quadtree.relative_error(&train).unwrap();
    assert!(sketched < 30.0 * exact && exact < 1e-4 && sketched > 0.5 * exact, "{sketched} {exact}");
    // In two parts, and the rest as a train.
    let (mut first, mut second) = (Sketch::new(&modes, 6, 5).unwrap(), Sketch::new(&modes, 6, 5).unwrap());
    let all: Vec<(usize, usize, f64)> = quadtree.entries().collect();
    for (part, half) in [(&mut first, &all[..1000]), (&mut second, &all[1000..])] {
        part.add_sparse(&QuadtreeMatrix::from_entries(2, 9, half.iter().copied()).unwrap()).unwrap();
    }
    first.add(&second).unwrap();
    let (parts, _) = first.to_train(&Truncation::to(1e-12)).unwrap();
    assert!(parts.relative_distance(train.as_vector()).unwrap() < 1e-6);
    let mut by_train = Sketch::new(&modes, 6, 5).unwrap();
    by_train.add_train(quadtree.to_train(&Truncation::to(1e-13)).unwrap().0.as_vector()).unwrap();
    assert!(
        by_train.to_train(&Truncation::to(1e-12)).unwrap().0.relative_distance(train.as_vector()).unwrap()
            < 1e-6
    );
    assert!(first.add(&Sketch::new(&modes, 6, 6).unwrap()).is_err());
}

#[test]
fn a_truncated_definite_matrix_can_be_kept_definite() {
    let s = contact_like(60, 100, 31);
    let place: Vec<usize> = (0..60).collect();
    let quadtree = QuadtreeMatrix::from_blocks(s.iter(), &place, 2, 5, 1.0).unwrap();
    let truncation = Truncation::capped(1e-2, 8);
    let plain = quadtree.to_train(&truncation).unwrap().0;
    let smallest = |train: &TtMatrix| {
        let full = dense(train);
        graintrain_linalg::dense::symmetric_eigen(full.view()).unwrap().0[0]
    };
    assert!(smallest(&plain) < 0.0, "truncation alone makes it indefinite: that is the point");
    let (train, report) = quadtree.to_definite_train(&truncation, 1e-3, 60).unwrap();
    assert!(smallest(&train) >= 1e-3 * 0.99 && report.shift > 0.0, "{report:?}");
    assert!((report.smallest.value / smallest(&train) - 1.0).abs() < 0.1);
    assert!(train.max_rank() <= 9);
    assert!(quadtree.relative_error(&train).unwrap() <= report.error * 1.0001);
    // Nothing is shifted where nothing is needed.
    let (_, report) = quadtree.to_definite_train(&Truncation::to(1e-9), 1e-3, 100).unwrap();
    assert_eq!(report.shift, 0.0, "{report:?}");
}

#[test]
fn lanczos_finds_the_known_ends_of_a_spectrum() {
    let operator = FullOperator::new(&graintrain_tt::qtt::laplacian(7).unwrap()).unwrap();
    let (low, high) = extreme_eigenvalues(&operator, 128, 3).unwrap();
    let angle = std::f64::consts::PI / 258.0;
    assert!((low.value - 4.0 * angle.sin().powi(2)).abs() < 1e-10 && low.residual < 1e-8);
    assert!((high.value - 4.0 * angle.cos().powi(2)).abs() < 1e-10);
}
