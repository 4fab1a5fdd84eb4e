//! The largest and the smallest entry, with bounds that hold for all entries; samples from a train as a
//! density.
//!
//! If the cores after the k-th are right-orthogonal, the entries with first digits i_1 ... i_k have the
//! Frobenius norm |G_1(i_1) ... G_k(i_k)|: none of them exceeds it. So the tree of first digits can be
//! searched best first (branch and bound): the largest bound still open bounds every entry that was not
//! looked at, and where the search ends by itself the largest entry is proven. The same norms, squared, are
//! the marginals of the density x^2, from which digits are drawn one after the other without error ("perfect
//! sampling": A. Ferris, G. Vidal, Phys. Rev. B 85, 2012).

use crate::random::Random;
use crate::vector::Core;
use crate::{TtError, TtVector};
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// What is kept open of the tree is cut to its best half beyond this many nodes, and what is cut off is
/// remembered in the bound.
const MOST_OPEN: usize = 1 << 18;
/// Sums of entries that are taken for nonnegative may be negative by this part of the largest of their kind.
const NEGATIVE: f64 = 1e-10;

/// An entry that was found, and what all others are known to be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Extreme {
    /// Where it is.
    pub index: Vec<usize>,
    /// The entry.
    pub value: f64,
    /// No entry lies beyond this, up to rounding (see [`TtVector::rounding_floor`]): equal to `value` (to
    /// 1e-12 of the largest entry) where it is proven.
    pub bound: f64,
    /// Whether `value` is proven to be the extreme one.
    pub proven: bool,
}

/// The largest and the smallest entry.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Extremes {
    /// The largest entry; `bound` is an upper one.
    pub largest: Extreme,
    /// The smallest entry; `bound` is a lower one.
    pub smallest: Extreme,
}

/// What a train as a density is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Density {
    /// The squares of the entries, over their sum.
    Squares,
    /// The entries, which must not be negative, over their sum.
    Entries,
}

/// First digits of entries: their row G_1(i_1) ... G_k(i_k), whose length bounds them.
struct Node {
    bound: f64,
    digits: Vec<usize>,
    row: Vec<f64>,
}

impl PartialEq for Node {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Node {}

impl PartialOrd for Node {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Node {
    /// The larger bound first, of equal ones the one with more digits, then the smaller digits: the same
    /// search every time.
    fn cmp(&self, other: &Self) -> Ordering {
        let digits = || other.digits.cmp(&self.digits);
        self.bound.total_cmp(&other.bound).then(self.digits.len().cmp(&other.digits.len())).then_with(digits)
    }
}

/// row G(i).
fn times_slice(row: &[f64], core: &Core, i: usize) -> Vec<f64> {
    let column = |beta: usize| &core.data[core.left * (i + core.mode * beta)..][..core.left];
    (0..core.right).map(|beta| column(beta).iter().zip(row).map(|(g, x)| g * x).sum()).collect()
}

fn length(row: &[f64]) -> f64 {
    row.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The entry of largest size of a train that is right-orthogonal after its first core, and a bound of all
/// sizes.
fn largest_size(train: &TtVector, nodes: usize) -> (Vec<usize>, f64) {
    let d = train.num_cores();
    // A greedy descent first: with a good entry in hand most of the tree is never opened.
    let (mut row, mut digits) = (vec![1.0], Vec::with_capacity(d));
    for core in &train.cores {
        let rows: Vec<Vec<f64>> = (0..core.mode).map(|i| times_slice(&row, core, i)).collect();
        let i = (0..core.mode).fold(0, |i, j| if length(&rows[j]) > length(&rows[i]) { j } else { i });
        digits.push(i);
        row.clone_from(&rows[i]);
    }
    let mut best = (row[0].abs(), digits);
    let all = length(&train.cores[0].data);
    let mut open = BinaryHeap::from([Node { bound: all, digits: Vec::new(), row: vec![1.0] }]);
    let (mut opened, mut cut_off) = (0, 0.0_f64);
    while let Some(node) = open.pop() {
        if node.bound <= best.0 {
            // All that is open is no larger.
            return (best.1, best.0.max(cut_off));
        }
        if opened == nodes {
            return (best.1, node.bound.max(cut_off).max(best.0));
        }
        opened += 1;
        let core = &train.cores[node.digits.len()];
        for i in 0..core.mode {
            let row = times_slice(&node.row, core, i);
            let bound = length(&row);
            let digits = [&node.digits[..], &[i]].concat();
            if digits.len() == d {
                if bound > best.0 {
                    best = (bound, digits);
                }
            } else if bound > best.0 {
                open.push(Node { bound, digits, row });
            }
        }
        if open.len() > MOST_OPEN {
            let mut all = open.into_sorted_vec();
            let kept = all.split_off(all.len() - MOST_OPEN / 2);
            cut_off = all.last().map_or(cut_off, |node| cut_off.max(node.bound));
            open = BinaryHeap::from(kept);
        }
    }
    (best.1, best.0.max(cut_off))
}

impl TtVector {
    /// The largest and the smallest entry by branch and bound over the tree of digits, fine to coarse,
    /// opening at most `nodes` nodes for each of the two. With m the entry of largest size, |x - m| is
    /// largest at the other end, so bounds of sizes bound both ends.
    ///
    /// Where the search does not end by itself, `bound` says what is left: for a flat tensor of many entries
    /// that is much, since the Frobenius norm of a part is all that is known about it. O(nodes n r^2 + d n
    /// r^3).
    ///
    /// # Errors
    /// [`TtError::Dense`] for entries that are not finite.
    ///
    /// ```
    /// use graintrain_tt::qtt;
    /// // sin(0.01 j) on 2^12 points: its largest entry is at 0.01 j = 25 pi / 2 to within a step.
    /// let extremes = qtt::sine(12, 0.01, 0.0)?.extremes(100_000)?;
    /// assert!(extremes.largest.proven && (extremes.largest.value - 1.0).abs() < 1e-5);
    /// assert!(extremes.smallest.proven && (extremes.smallest.value + 1.0).abs() < 1e-5);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn extremes(&self, nodes: usize) -> Result<Extremes, TtError> {
        let modes = self.modes();
        let search = |train: &Self| -> Result<(Vec<usize>, f64), TtError> {
            // (An exact rounding refuses what is not finite and takes dependent rows out; powers of two are
            // taken out so that no square overflows.)
            let exact = train.round(&crate::Truncation::to(0.0))?.0;
            let Some((mut balanced, exponent)) = exact.balanced()? else {
                return Ok((vec![0; modes.len()], 0.0));
            };
            balanced.orthogonalise_right();
            let (index, bound) = largest_size(&balanced, nodes);
            Ok((index, bound * (exponent as f64).exp2()))
        };
        let (first, size) = search(self)?;
        let (first, m) = self.climb(first, f64::abs)?;
        let shifted = self.subtract(&Self::constant(&modes, m)?)?;
        let (second, distance) = search(&shifted)?;
        let (second, other) = self.climb(second, |x| (x - m).abs())?;
        let near = |bound: f64, value: f64| (bound - value).abs() <= 1e-12 * m.abs().max(other.abs());
        let extreme = |index: Vec<usize>, value: f64, bound: f64| {
            let proven = near(bound, value);
            Extreme { index, value, bound: if proven { value } else { bound }, proven }
        };
        let (upper, lower) = (size.min(m + distance), (-size).max(m - distance));
        let (mut low, mut high) =
            if other <= m { ((second, other), (first, m)) } else { ((first, m), (second, other)) };
        high = self.climb(high.0, |x| x)?;
        low = self.climb(low.0, |x| -x)?;
        // If m is of the largest size, all entries lie on one side of it.
        let certain = near(size, m.abs());
        let (upper, lower) = if certain && m >= 0.0 { (m, lower) } else { (upper, lower) };
        let (upper, lower) = if certain && m < 0.0 { (upper, m) } else { (upper, lower) };
        Ok(Extremes {
            largest: extreme(high.0, high.1, upper.max(high.1)),
            smallest: extreme(low.0, low.1, lower.min(low.1)),
        })
    }

    /// From an entry to larger ones (as `height` has it) along one mode at a time until none is; the entry.
    /// What a search left off is improved by it, proofs are not its business.
    fn climb(
        &self,
        mut index: Vec<usize>,
        height: impl Fn(f64) -> f64,
    ) -> Result<(Vec<usize>, f64), TtError> {
        let mut value = self.entry(&index)?;
        loop {
            let points: Vec<Vec<usize>> = (0..index.len())
                .flat_map(|k| (0..self.cores[k].mode).map(move |i| (k, i)))
                .map(|(k, i)| [&index[..k], &[i], &index[k + 1..]].concat())
                .collect();
            let values = self.entries(&points.concat())?;
            let best = (0..values.len())
                .fold(0, |best, p| if height(values[p]) > height(values[best]) { p } else { best });
            let found = self.entry(&points[best])?;
            // (`entries` and `entry` may round differently: only what is larger by the same sums counts.)
            if height(found) > height(value) {
                (index, value) = (points[best].clone(), found);
            } else {
                return Ok((index, value));
            }
        }
    }

    /// Independent samples from the train as a density: `count` multi-indices, d digits each, one after the
    /// other. Drawn digit by digit from exact marginals, so there is no burn-in and no rejection. O(d n r^3 +
    /// count d n r^2).
    ///
    /// # Errors
    /// [`TtError::Setting`] for a zero tensor, or for [`Density::Entries`] where sums of entries prove to be
    /// negative (single negative entries may remain unseen); [`TtError::TooLarge`] for more than 2^31 digits.
    ///
    /// ```
    /// use graintrain_tt::{TtVector, extremes::Density};
    /// let x = TtVector::rank_one(&[vec![1.0, 3.0], vec![0.0, 1.0, 1.0]])?;
    /// let samples = x.sample(Density::Entries, 8000, 1)?;
    /// let ones = samples.chunks_exact(2).filter(|index| index[0] == 1).count();
    /// assert!((ones as f64 / 8000.0 - 0.75).abs() < 0.02 && samples.chunks_exact(2).all(|index| index[1] > 0));
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn sample(&self, density: Density, count: usize, seed: u64) -> Result<Vec<usize>, TtError> {
        let d = self.num_cores();
        let digits = count as f64 * d as f64;
        if digits > (1u64 << 31) as f64 {
            return Err(TtError::TooLarge { entries: digits });
        }
        let nothing = TtError::Setting { what: "norm of a density", need: "positive", got: 0.0 };
        let Some((mut train, _)) = self.balanced()? else { return Err(nothing) };
        // Sums over all digits after each core, for entries; for squares the cores after it are orthogonal
        // instead.
        let mut sums = vec![vec![1.0]; d];
        match density {
            Density::Squares => train.orthogonalise_right(),
            Density::Entries => {
                for k in (1..d).rev() {
                    let core = &train.cores[k];
                    let mut sum = vec![0.0; core.left];
                    for (fibre, column) in core.data.chunks_exact(core.left).enumerate() {
                        let weight = sums[k][fibre / core.mode];
                        sum.iter_mut().zip(column).for_each(|(s, x)| *s += weight * x);
                    }
                    sums[k - 1] = sum;
                }
            }
        }
        let mut random = Random::new(seed);
        let mut samples = Vec::with_capacity(count * d);
        for _ in 0..count {
            let mut row = vec![1.0];
            for (core, sum) in train.cores.iter().zip(&sums) {
                let rows: Vec<Vec<f64>> = (0..core.mode).map(|i| times_slice(&row, core, i)).collect();
                let weight = |row: &Vec<f64>| match density {
                    Density::Squares => row.iter().map(|x| x * x).sum(),
                    Density::Entries => row.iter().zip(sum).map(|(x, s)| x * s).sum::<f64>(),
                };
                let weights: Vec<f64> = rows.iter().map(weight).collect();
                let largest = weights.iter().fold(0.0_f64, |largest, w| largest.max(w.abs()));
                if let Some(&negative) = weights.iter().find(|&&w| w < -NEGATIVE * largest) {
                    let (what, need) = ("sum of entries of a density", "at least 0");
                    return Err(TtError::Setting { what, need, got: negative });
                }
                let total: f64 = weights.iter().map(|w| w.max(0.0)).sum();
                if total <= 0.0 || !total.is_finite() {
                    return Err(TtError::Setting { what: "sum of a density", need: "positive", got: total });
                }
                let mut left = 0.5 * (random.symmetric() + 1.0) * total;
                let mut digit = weights.iter().rposition(|&w| w > 0.0).unwrap_or(0);
                for (i, w) in weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
                    left -= w;
                    if left < 0.0 {
                        digit = i;
                        break;
                    }
                }
                samples.push(digit);
                // Kept of length one: a long row of small factors would vanish.
                let size = length(&rows[digit]);
                row = rows[digit].iter().map(|x| x / size).collect();
            }
        }
        Ok(samples)
    }
}
