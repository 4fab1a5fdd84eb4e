//! Streaming approximation of a tensor from two-sided random sketches.
//!
//! One pass over the entries (or over other trains), in any order and in parts: the sketch is linear, so the
//! sketch of a sum is the sum of the sketches, and a small change of a matrix is added to an old sketch. With
//! random trains Y (left) and X (right) and the unfolding A_k at every bond,
//!
//! Omega_k = Y_k^T A_k X_k (small), Psi_k = (Y_{k-1}^T (x) I) A_k X_k, core k = Psi_k Omega_k^+,
//!
//! a generalised Nystrom approximation (Kressner, Vandereycken, Voorhaar, arXiv 2208.02600). O(nnz d r^2) for
//! entries. The error is near the best one of the rank in expectation. The sketch estimates it from itself: a
//! few columns more than the rank are kept, and how far a column of Omega_k is from the span of the others is
//! what a new column would find at this bond (leaving one out). That is an estimate, not a bound; for a
//! sparse matrix [`QuadtreeMatrix::relative_error`] measures. Where all entries are at hand, the exact pass
//! of [`crate::sparse`] is simpler and better.

use crate::arithmetic::push_dot;
use crate::error::at_core;
use crate::random::Random;
use crate::sparse::QuadtreeMatrix;
use crate::vector::{Core, admissible_ranks, check_cores, check_index};
use crate::{Truncation, TruncationReport, TtError, TtVector};
use graintrain_linalg::dense::{Matrix, Svd, View, ViewMut, multiply_add, product, thin_svd};

/// Singular values of Omega below this part of the largest are noise and are not inverted.
const CUT: f64 = 1e-13;
/// Columns beyond the rank on the right; the left side has twice all of them and as many again.
const OVERSAMPLING: usize = 5;

/// The sketch of a tensor.
///
/// ```
/// use graintrain_tt::{Truncation, TtVector, sketch::Sketch};
/// let a = TtVector::random(&[2; 20], 3, 1)?;
/// let b = TtVector::random(&[2; 20], 2, 2)?;
/// let mut sketch = Sketch::new(&[2; 20], 5, 7)?;
/// sketch.add_train(&a)?;
/// sketch.add_train(&b)?;
/// let (sum, _) = sketch.to_train(&Truncation::to(1e-10))?;
/// assert!(sum.relative_distance(&a.add(&b)?)? < 1e-8);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Sketch {
    /// Random trains; their cores have Gaussian entries of variance 1 / rank.
    left: TtVector,
    right: TtVector,
    /// Omega of bond k = 1..d-1.
    omega: Vec<Matrix>,
    /// Psi of mode k = 1..d as a core.
    psi: Vec<Core>,
    /// No rank of a result above this.
    rank: usize,
}

impl Sketch {
    /// The sketch of zero for results of rank up to `rank`: rank + 5 columns on the right, 2 rank + 15 on the
    /// left.
    ///
    /// Sketches can be added if they have the same modes, rank and seed.
    ///
    /// # Errors
    /// [`TtError::Shape`] if there is no mode or a mode is empty, [`TtError::TooLarge`] for a core of more
    /// than 2^31 numbers.
    pub fn new(modes: &[usize], rank: usize, seed: u64) -> Result<Self, TtError> {
        let mut random = Random::new(seed);
        let mut gaussian = |ranks: &[usize]| {
            let core = |k: usize, random: &mut Random| {
                // Scaled so that the length of a random row stays about one along the train.
                let scale = (1.0 / ranks[k + 1].max(ranks[k]) as f64).sqrt();
                Core::from_fn(ranks[k], modes[k], ranks[k + 1], |_, _, _| scale * random.normal())
            };
            TtVector::from_cores((0..modes.len()).map(|k| core(k, &mut random)).collect())
        };
        let columns = rank.saturating_add(OVERSAMPLING);
        let right_ranks = admissible_ranks(modes, columns);
        let left_ranks = admissible_ranks(modes, columns.saturating_mul(2).saturating_add(OVERSAMPLING));
        check_cores(modes, &left_ranks)?;
        let (left, right) = (gaussian(&left_ranks)?, gaussian(&right_ranks)?);
        let d = modes.len();
        let omega = (1..d).map(|k| Matrix::zeros(left_ranks[k], right_ranks[k])).collect();
        let psi = (0..d)
            .map(|k| Core::from_fn(left_ranks[k], modes[k], right_ranks[k + 1], |_, _, _| 0.0))
            .collect();
        Ok(Self { left, right, omega, psi, rank })
    }

    /// Adds `values` at `indices` (d indices per entry).
    ///
    /// # Errors
    /// [`TtError::Index`] or [`TtError::Shape`] if an index does not fit.
    pub fn add_entries(&mut self, indices: &[usize], values: &[f64]) -> Result<(), TtError> {
        let (d, modes) = (self.psi.len(), self.left.modes());
        if indices.len() != d * values.len() {
            let (expected, got) = (vec![d * values.len()], vec![indices.len()]);
            return Err(TtError::Shape { what: "indices of entries", expected, got });
        }
        for (index, &value) in indices.chunks_exact(d).zip(values) {
            check_index(&modes, index)?;
            let (left, right) = (self.left_rows(index), self.right_columns(index));
            for k in 0..d {
                // Psi(., i_k, .) += value L_{k-1}^T R_k; Omega_k += value L_k^T R_k.
                let core = &mut self.psi[k];
                for (beta, r) in right[k].iter().enumerate() {
                    let at = core.left * (index[k] + core.mode * beta);
                    let to = &mut core.data[at..at + core.left];
                    to.iter_mut().zip(&left[k]).for_each(|(to, l)| *to += value * r * l);
                }
                if k + 1 < d {
                    let (height, width) = (left[k + 1].len(), right[k].len());
                    let (l, r) = (View::new(&left[k + 1], height, 1), View::new(&right[k], 1, width));
                    multiply_add(value, l, r, self.omega[k].view_mut());
                }
            }
        }
        Ok(())
    }

    /// Adds all entries of a sparse matrix over paired modes (its dummies in partly filled leaves included).
    ///
    /// # Errors
    /// [`TtError::Shape`] if the modes differ.
    pub fn add_sparse(&mut self, matrix: &QuadtreeMatrix) -> Result<(), TtError> {
        let sizes = matrix.modes();
        let mut index = Vec::with_capacity(sizes.len());
        for (row, column, value) in matrix.entries() {
            index.clear();
            let (mut i, mut j) = (row, column);
            for n in &sizes {
                index.push(i % n + n * (j % n));
                (i, j) = (i / n, j / n);
            }
            self.add_entries(&index, &[value])?;
        }
        Ok(())
    }

    /// Adds a train; O(d n r^3).
    ///
    /// # Errors
    /// [`TtError::Shape`] if the modes differ.
    pub fn add_train(&mut self, train: &TtVector) -> Result<(), TtError> {
        self.left.check_same_modes(train)?;
        let d = self.psi.len();
        // right[k]: train rank x sketch rank of everything right of core k.
        let (turned, turned_sketch) = (train.reverse(), self.right.reverse());
        let mut right = vec![Matrix::identity(1)];
        for k in 0..d - 1 {
            let next = push_dot(&right[k], &turned.cores[k], &turned_sketch.cores[k]);
            right.push(next);
        }
        right.reverse();
        let mut left = Matrix::identity(1);
        for k in 0..d {
            let core = train.cores[k].multiply_left(left.view());
            let contribution = core.multiply_right(right[k].view());
            self.psi[k].data.iter_mut().zip(&contribution.data).for_each(|(to, x)| *to += x);
            left = push_dot(&left, &self.left.cores[k], &train.cores[k]);
            if k + 1 < d {
                let omega = product(left.view(), right[k].view());
                self.omega[k].data_mut().iter_mut().zip(omega.data()).for_each(|(to, x)| *to += x);
            }
        }
        Ok(())
    }

    /// Adds another sketch with the same modes, rank and seed.
    ///
    /// # Errors
    /// [`TtError::Shape`] if they were not made alike.
    pub fn add(&mut self, other: &Self) -> Result<(), TtError> {
        if self.left != other.left || self.right != other.right {
            let (expected, got) = (self.right.ranks(), other.right.ranks());
            return Err(TtError::Shape { what: "modes, rank and seed of two sketches", expected, got });
        }
        for (to, from) in self.omega.iter_mut().zip(&other.omega) {
            to.data_mut().iter_mut().zip(from.data()).for_each(|(to, x)| *to += x);
        }
        for (to, from) in self.psi.iter_mut().zip(&other.psi) {
            to.data.iter_mut().zip(&from.data).for_each(|(to, x)| *to += x);
        }
        Ok(())
    }

    /// The train, rounded, of ranks up to that of the sketch. The report's error is that of the rounding and
    /// the estimate of what the sketch missed (see the module), sqrt(rounding^2 + sum over bonds of
    /// missed^2).
    ///
    /// # Errors
    /// [`TtError::Setting`] for a bad truncation, [`TtError::Dense`] if an entry is not finite.
    pub fn to_train(&self, truncation: &Truncation) -> Result<(TtVector, TruncationReport), TtError> {
        let d = self.psi.len();
        let mut cores = Vec::with_capacity(d);
        // Core k is Psi_k Omega_k^+ = (Psi_k V) (diag(1/s) U^T): the second part goes to the right.
        let (mut carry, mut missed) = (Matrix::identity(1), 0.0);
        let modes = self.left.modes();
        for k in 0..d {
            let core = self.psi[k].multiply_left(carry.view());
            if k + 1 == d {
                cores.push(core);
                break;
            }
            let Svd { u, s, mut v } = thin_svd(self.omega[k].view()).map_err(at_core(k))?;
            let useful = s.iter().take_while(|&&x| x > CUT * s[0]).count().max(1);
            let size = |modes: &[usize]| modes.iter().fold(1usize, |size, &n| size.saturating_mul(n));
            // (Where the columns of the sketch span all of one side nothing is missed.)
            if useful == v.rows() && v.rows() < size(&modes[..=k]).min(size(&modes[k + 1..])) {
                missed += left_out_share(&s, &v);
            }
            v.truncate_columns(useful);
            cores.push(core.multiply_right(v.view()));
            let inverse = |x: f64| if x > 0.0 { 1.0 / x } else { 0.0 };
            carry = Matrix::from_fn(useful, u.rows(), |i, j| inverse(s[i]) * u[(j, i)]);
        }
        let capped = Truncation { max_rank: truncation.max_rank.min(self.rank.max(1)), ..*truncation };
        let (train, report) = TtVector { cores }.round(&capped)?;
        let error = report.error.hypot(missed.sqrt());
        // Exact ranks leave rounding errors of a pseudo-inverse.
        let floor = report.floor.max(CUT);
        Ok((
            train,
            TruncationReport {
                error,
                floor,
                capped: report.capped || error > truncation.tolerance.max(floor),
                ..report
            },
        ))
    }

    /// L_0 = 1, L_k = L_{k-1} Y_k(i_k).
    fn left_rows(&self, index: &[usize]) -> Vec<Vec<f64>> {
        let mut rows = vec![vec![1.0]];
        for (k, core) in self.left.cores.iter().enumerate().take(index.len() - 1) {
            let mut next = vec![0.0; core.right];
            multiply_add(
                1.0,
                View::new(&rows[k], 1, core.left),
                core.slice(index[k]),
                ViewMut::new(&mut next, 1, core.right),
            );
            rows.push(next);
        }
        rows
    }

    /// R_d = 1, R_{k-1} = X_k(i_k) R_k; the k-th of the result belongs to the bond right of mode k.
    fn right_columns(&self, index: &[usize]) -> Vec<Vec<f64>> {
        let mut columns = vec![vec![1.0]];
        for (k, core) in self.right.cores.iter().enumerate().skip(1).rev() {
            let last = &columns[columns.len() - 1];
            let mut next = vec![0.0; core.left];
            multiply_add(
                1.0,
                core.slice(index[k]),
                View::new(last, core.right, 1),
                ViewMut::new(&mut next, core.left, 1),
            );
            columns.push(next);
        }
        columns.reverse();
        columns
    }
}

impl TtVector {
    /// sum_i w_i x_i of many terms at once: every term is sketched, O(d n r_i R (r_i + R)) for a sketch of
    /// rank R, and no core of the sum of all ranks is ever made. R doubles from 8 until the sketch's own
    /// estimate of its error meets the tolerance; the report holds this ESTIMATE (see the module), not the
    /// error itself, which [`TtVector::sum_rounded`] knows.
    ///
    /// # Errors
    /// [`TtError::Shape`] if there is no term or the modes differ, else as for [`Sketch::to_train`].
    ///
    /// ```
    /// use graintrain_tt::{Truncation, TtVector, qtt};
    /// // A thousand waves that are combinations of ten.
    /// let waves: Vec<TtVector> = (0..1000).map(|k| qtt::sine(16, 1e-3 * (k % 5) as f64, k as f64)).collect::<Result<_, _>>()?;
    /// let terms: Vec<(f64, &TtVector)> = waves.iter().map(|wave| (0.001, wave)).collect();
    /// let (sum, report) = TtVector::sum_sketched(&terms, &Truncation::to(1e-8), 1)?;
    /// assert!(sum.max_rank() <= 10 && report.error <= 1e-8);
    /// let entry: f64 = waves.iter().map(|wave| 0.001 * wave.entry(&[1; 16]).unwrap()).sum();
    /// assert!((sum.entry(&[1; 16])? - entry).abs() < 1e-8);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn sum_sketched(
        terms: &[(f64, &Self)],
        truncation: &Truncation,
        seed: u64,
    ) -> Result<(Self, TruncationReport), TtError> {
        let Some((_, first)) = terms.first() else {
            return Err(TtError::Shape { what: "terms of a sum", expected: vec![1], got: vec![0] });
        };
        let most = terms.iter().map(|(_, term)| term.max_rank()).fold(0usize, usize::saturating_add);
        let mut rank = 8;
        loop {
            let mut sketch = Sketch::new(&first.modes(), rank, seed)?;
            for (weight, term) in terms {
                sketch.add_train(&term.scale(*weight))?;
            }
            let (sum, report) = sketch.to_train(truncation)?;
            if report.error <= truncation.tolerance.max(report.floor) || rank >= most.min(truncation.max_rank)
            {
                return Ok((sum, report));
            }
            rank *= 2;
        }
    }
}

/// Mean squared distance of the columns of U diag(s) V^T from the span of the others, over their mean square:
/// column j is 1 / |row j of the pseudo-inverse| away. All singular values are positive.
fn left_out_share(s: &[f64], v: &Matrix) -> f64 {
    let distance = |j: usize| 1.0 / (0..s.len()).map(|i| (v[(j, i)] / s[i]).powi(2)).sum::<f64>();
    (0..v.rows()).map(distance).sum::<f64>() / s.iter().map(|s| s * s).sum::<f64>()
}
