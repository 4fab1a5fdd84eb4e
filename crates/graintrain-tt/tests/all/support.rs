//! The matrices of settled packings, for several test files.

use graintrain_tt::sparse::QuadtreeMatrix;
use std::collections::BTreeMap;

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
pub fn settled_packing(name: &str) -> Option<QuadtreeMatrix> {
    let file = graintrain_testdata::public_data(&format!("ccp/{name}"))?;
    let text = std::fs::read_to_string(file).unwrap();
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
