//! The matrix of a settled packing: no low rank exists, the exact pass knows the error, cross must admit failure.

use graintrain_tt::Truncation;
use graintrain_tt::cross::{CrossSettings, CrossStatus, cross_sparse};
use graintrain_tt::sparse::QuadtreeMatrix;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Entries "i j : x" of the two sparse matrices M and H of a problem in Siconos's global text form.
fn matrices(text: &str) -> Vec<Vec<(usize, usize, f64)>> {
    let mut found: Vec<Vec<(usize, usize, f64)>> = Vec::new();
    for line in text.lines() {
        if line.starts_with("triplet:") {
            found.push(Vec::new());
        }
        let mut words = line.split_whitespace();
        if let (Some(i), Some(j), Some(":"), Some(x), Some(list)) =
            (words.next(), words.next(), words.next(), words.next(), found.last_mut())
        {
            list.push((i.parse().unwrap(), j.parse().unwrap(), x.parse().unwrap()));
        }
    }
    found
}

/// S = H^T M^-1 H + 0.01 mean(diagonal) I, contacts in the order of the file, 4 slots per leaf, zero dummies.
fn settled_packing(name: &str) -> Option<QuadtreeMatrix> {
    let folder = std::env::var_os("GRAINTRAIN_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    let file = folder.join("ccp").join(name);
    let Ok(text) = std::fs::read_to_string(&file) else {
        println!("skipped: {} is not there (set GRAINTRAIN_DATA)", file.display());
        return None;
    };
    let lists = matrices(&text);
    let mass: BTreeMap<usize, f64> = lists[0].iter().map(|&(i, _, x)| (i, x)).collect();
    let mut rows: BTreeMap<usize, Vec<(usize, f64)>> = BTreeMap::new();
    lists[1].iter().for_each(|&(i, j, x)| rows.entry(i).or_default().push((j, x)));
    let mut sum: BTreeMap<(usize, usize), f64> = BTreeMap::new();
    for (i, row) in &rows {
        for (j, x) in row {
            for (k, y) in row {
                *sum.entry((*j, *k)).or_default() += x * y / mass[i];
            }
        }
    }
    let unknowns = 1 + sum.keys().map(|&(i, _)| i).max().unwrap();
    let mean = sum.iter().filter(|((i, j), _)| i == j).map(|(_, x)| x).sum::<f64>() / unknowns as f64;
    (0..unknowns).for_each(|i| *sum.entry((i, i)).or_default() += 0.01 * mean);
    let levels = unknowns.div_ceil(12).next_power_of_two().trailing_zeros() as usize;
    Some(QuadtreeMatrix::from_entries(12, levels, sum.into_iter().map(|((i, j), x)| (i, j, x))).unwrap())
}

/// Cross of the matrix under a cap on the ranks, and under stride-th nonzeros as probes, must not claim to have converged,
/// and the error in the report must be the true one. Returns the error of the exact pass with cap 10.
fn cross_admits_failure(matrix: &QuadtreeMatrix, runs: &[(usize, usize)]) -> f64 {
    for &(max_rank, stride) in runs {
        let settings = CrossSettings { tolerance: 1e-2, max_rank, ..Default::default() };
        let (train, report) = cross_sparse(matrix, None, stride, &settings).unwrap();
        let truth = matrix.relative_error(&train).unwrap();
        let measured = report.error().unwrap();
        let best = matrix.to_train(&Truncation::capped(1e-2, max_rank)).unwrap().1.error;
        println!(
            "cap {max_rank}: {truth:.3} measured {measured:.3} {:?}; exact pass {best:.3}",
            report.status
        );
        assert_ne!(report.status, CrossStatus::Converged);
        assert!((measured - truth).abs() <= 1e-12, "{truth} {report:?}");
        // The independent measure behind the sweeps sees the failure too, if less sharply.
        assert!(report.sampled_error.into_iter().chain(report.probe_error).fold(0.0, f64::max) > 0.1);
        assert!(truth >= 0.99 * best / 3.0, "the TT-SVD is optimal up to sqrt(d - 1)");
    }
    let exact = matrix.to_train(&Truncation::capped(1e-2, 10)).unwrap().1;
    assert!(exact.capped, "{exact:?}");
    exact.error
}

#[test]
fn the_reported_error_is_that_of_all_entries_one_by_one() {
    let Some(matrix) = settled_packing("sed125.dat") else { return };
    let settings = CrossSettings { tolerance: 1e-2, max_rank: 10, ..Default::default() };
    let (train, report) = cross_sparse(&matrix, None, 1, &settings).unwrap();
    let full = train.to_full().unwrap();
    let (mut difference, mut size) = (0.0, 0.0);
    for j in 0..full.columns() {
        for i in 0..full.rows() {
            let entry = matrix.entry(i, j);
            difference += (full[(i, j)] - entry).powi(2);
            size += entry * entry;
        }
    }
    let truth = (difference / size).sqrt();
    assert!((report.error().unwrap() / truth - 1.0).abs() < 1e-8, "{truth} {report:?}");
}

#[test]
fn a_settled_packing_has_no_low_rank_and_cross_says_that_it_failed() {
    let Some(matrix) = settled_packing("sed125.dat") else { return };
    assert!(cross_admits_failure(&matrix, &[(10, 1), (40, 1), (10, 7)]) > 0.3);
    let full = matrix.to_train(&Truncation::to(1e-2)).unwrap();
    println!("ranks at 1e-2: {:?}", full.0.ranks());
    assert!(full.0.max_rank() > 100 && full.1.error <= 1e-2);
    assert!((matrix.relative_error(&full.0).unwrap() - full.1.error).abs() < 1e-6);
}

#[test]
#[ignore = "2 052 and 14 087 contacts: a minute"]
fn larger_packings_have_no_low_rank_either() {
    for name in ["sed729.dat", "sed4913.dat"] {
        let Some(matrix) = settled_packing(name) else { return };
        println!("{name}");
        assert!(cross_admits_failure(&matrix, &[(10, 1), (30, 1), (10, 7)]) > 0.3);
    }
}
