//! Sparse matrix to tensor train by one exact pass over its nonzero blocks.
//!
//! A matrix of size n_1 2^L is a quadtree: L levels of 2x2 blocks over leaf blocks of size n_1. With the
//! digits ordered from fine to coarse the TT-SVD needs, at level k, only the coefficient vectors c_IJ of the
//! nonzero blocks in the basis found so far (block IJ = sum_rho c_IJ(rho) E_rho, E orthonormal), because zero
//! blocks add nothing to the Gram matrix of the unfolding. So, from the leaves up:
//!
//! 1. G = sum over blocks of c c^T; leading eigenvectors U of G are the core, the rest is discarded;
//! 2. c <- U^T c;
//! 3. four children (I, J) share a parent (I / 2, J / 2): their vectors are stacked in the order of the
//!    paired digit.
//!
//! Every entry is seen, the error is known (sum of the discarded eigenvalues), ranks are those of the TT-SVD,
//! and the cost is O(nonzero blocks r^2) per level. Where the tolerance comes near the rounding of the Gram
//! matrix (about 1e-6, or dummies much larger than the entries), the triangle of a QR of all vectors takes
//! its place.

use crate::error::at_core;
use crate::round::{Budget, ROUNDING};
use crate::scale::{binary_exponent, largest_finite, share_power};
use crate::vector::{Core, LARGEST_CORE};
use crate::{Truncation, TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{
    DenseError, Matrix, View, ViewMut, left_svd, multiply, qr_triangle, symmetric_eigen,
};
use graintrain_linalg::triangles::gram;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Blocks per task: part of the definition of every sum made here, so that threads do not change a bit.
const CHUNK: usize = 1024;
/// The Gram matrix serves while its rounding errors, times this, stay below the squared error that one bond
/// may make.
const GRAM_SAFETY: f64 = 100.0;
/// Largest number of levels: block coordinates have 31 bits.
const MAX_LEVELS: usize = 31;

/// A square sparse matrix of size n_1 2^levels, cut into leaf blocks of size n_1 sorted along the quadtree.
#[derive(Clone, Debug)]
pub struct QuadtreeMatrix {
    leaf_size: usize,
    levels: usize,
    /// Morton key of each nonzero leaf block: digit k of (I, J) is 2 bits, I low, J high.
    key: Vec<u64>,
    /// Entries of leaf block b: `start[b]..start[b + 1]`.
    start: Vec<usize>,
    /// Position i + n_1 j in the leaf block.
    position: Vec<u32>,
    value: Vec<f64>,
    /// Diagonal value of the unknowns that do not exist (0: they are left zero).
    dummy: f64,
    /// Frobenius norm of the given entries.
    norm: f64,
    /// Number of dummy unknowns (a float: it may exceed any integer).
    dummy_count: f64,
}

impl QuadtreeMatrix {
    /// From entries (row, column, value); entries at the same place are added.
    ///
    /// # Errors
    /// [`TtError::Index`] if a row or column is not below n_1 2^levels, [`TtError::Setting`] for more than 31
    /// levels or a leaf of size 0.
    pub fn from_entries(
        leaf_size: usize,
        levels: usize,
        entries: impl IntoIterator<Item = (usize, usize, f64)>,
    ) -> Result<Self, TtError> {
        if levels > MAX_LEVELS {
            return Err(TtError::Setting { what: "levels", need: "at most 31", got: levels as f64 });
        }
        if leaf_size == 0 || leaf_size > 1 << 15 {
            return Err(TtError::Setting { what: "leaf size", need: "in 1..=32768", got: leaf_size as f64 });
        }
        let size = leaf_size << levels;
        let mut list = Vec::new();
        for (row, column, value) in entries {
            if row >= size || column >= size {
                let mode = usize::from(row < size);
                return Err(TtError::Index { mode, index: if row < size { column } else { row }, size });
            }
            let key = morton(row / leaf_size, column / leaf_size);
            let position = (row % leaf_size + leaf_size * (column % leaf_size)) as u32;
            list.push((key, position, value));
        }
        list.par_sort_by_key(|&(key, position, _)| (key, position));
        let (mut keys, mut start, mut position, mut value) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::<f64>::new());
        let mut last = None;
        for (key, place, x) in list {
            if last == Some((key, place)) {
                if let Some(sum) = value.last_mut() {
                    *sum += x;
                }
                continue;
            }
            if keys.last() != Some(&key) {
                keys.push(key);
                start.push(position.len());
            }
            last = Some((key, place));
            position.push(place);
            value.push(x);
        }
        start.push(position.len());
        let norm = scaled_norm(&value);
        Ok(Self { leaf_size, levels, key: keys, start, position, value, dummy: 0.0, norm, dummy_count: 0.0 })
    }

    /// From the 3x3 blocks (block row, block column, numbers row by row) of a matrix and the place of every
    /// block row: block row c sits at rows 3 place\[c\] + 0..3, so with `slots` places per leaf its leaf is
    /// place\[c\] / slots and its slot place\[c\] % slots. The first mode is (3 slots)^2, then 4, ..., 4.
    /// Places that no block row takes are dummies: `dummy` on their diagonal (1 keeps the matrix regular, 0
    /// leaves them zero, which compresses better).
    ///
    /// # Errors
    /// [`TtError::Index`] for a block row or column without a place, a place outside slots 2^levels or one
    /// that is taken twice, [`TtError::Setting`] as for [`QuadtreeMatrix::from_entries`].
    ///
    /// ```
    /// use graintrain_tt::{Truncation, sparse::QuadtreeMatrix};
    /// let block = [2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0];
    /// // Three contacts in leaves of two slots; the tree has one level.
    /// let matrix = QuadtreeMatrix::from_blocks((0..3).map(|c| (c, c, block)), &[0, 1, 3], 2, 1, 2.0)?;
    /// let (train, report) = matrix.to_train(&Truncation::to(1e-12))?;
    /// assert_eq!(train.ranks(), [1, 1, 1]); // twice the identity
    /// assert!(report.error < 1e-12);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn from_blocks(
        blocks: impl IntoIterator<Item = (usize, usize, [f64; 9])>,
        place: &[usize],
        slots: usize,
        levels: usize,
        dummy: f64,
    ) -> Result<Self, TtError> {
        let mut sorted: Vec<usize> = place.to_vec();
        sorted.sort_unstable();
        let places = slots.checked_shl(levels as u32).unwrap_or(0);
        if let Some(&outside) = sorted.last().filter(|&&p| p >= places) {
            return Err(TtError::Index { mode: 0, index: outside, size: places });
        }
        if let Some(twice) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(TtError::Index { mode: 0, index: twice[0], size: places });
        }
        // (A block without a place goes outside, where it is refused.)
        let outside = places.saturating_mul(3);
        let entries = blocks.into_iter().flat_map(|(i, j, block)| {
            let first = |c: usize| place.get(c).map_or(outside, |p| 3 * p);
            let (row, column) = (first(i), first(j));
            (0..9).map(move |e| (row.saturating_add(e / 3), column.saturating_add(e % 3), block[e]))
        });
        let mut quadtree = Self::from_entries(slots.saturating_mul(3), levels, entries)?;
        quadtree.fill_partial_leaves(&sorted, slots, dummy);
        Ok(quadtree)
    }

    /// Puts the dummy value on the free slots of leaves that hold some unknown; empty leaves are handled in
    /// the pass.
    fn fill_partial_leaves(&mut self, sorted_places: &[usize], slots: usize, dummy: f64) {
        self.dummy = dummy;
        if dummy == 0.0 {
            return;
        }
        self.dummy_count = 3.0 * ((slots as f64) * (self.levels as f64).exp2() - sorted_places.len() as f64);
        let mut extra: Vec<(u64, u32, f64)> = Vec::new();
        for places in sorted_places.chunk_by(|a, b| a / slots == b / slots) {
            let leaf = places[0] / slots;
            for slot in (0..slots).filter(|slot| places.binary_search(&(leaf * slots + slot)).is_err()) {
                for c in 0..3 {
                    let i = 3 * slot + c;
                    extra.push((morton(leaf, leaf), (i + self.leaf_size * i) as u32, dummy));
                }
            }
        }
        let mut merged: Vec<(u64, u32, f64)> = extra;
        for (block, &key) in self.key.iter().enumerate() {
            let range = self.start[block]..self.start[block + 1];
            merged.extend(range.map(|e| (key, self.position[e], self.value[e])));
        }
        merged.par_sort_by_key(|&(key, position, _)| (key, position));
        self.key.clear();
        self.start.clear();
        for (e, &(key, ..)) in merged.iter().enumerate() {
            if self.key.last() != Some(&key) {
                self.key.push(key);
                self.start.push(e);
            }
        }
        self.start.push(merged.len());
        self.position = merged.iter().map(|&(_, position, _)| position).collect();
        self.value = merged.iter().map(|&(.., value)| value).collect();
    }

    /// Size of a leaf block n_1.
    pub fn leaf_size(&self) -> usize {
        self.leaf_size
    }

    /// Levels of 2x2 blocks above the leaves.
    pub fn levels(&self) -> usize {
        self.levels
    }

    /// Row sizes n_1, 2, ..., 2 of the train.
    pub fn modes(&self) -> Vec<usize> {
        std::iter::once(self.leaf_size).chain(std::iter::repeat_n(2, self.levels)).collect()
    }

    /// Frobenius norm of the entries given, without dummies.
    pub fn norm(&self) -> f64 {
        self.norm
    }

    /// Frobenius norm with the dummies.
    pub fn augmented_norm(&self) -> f64 {
        self.norm.hypot(self.dummy_count.sqrt() * self.dummy)
    }

    /// Number of stored entries (dummies in partly filled leaves included).
    pub fn num_entries(&self) -> usize {
        self.value.len()
    }

    /// Entry (row, column) of the augmented matrix; zero outside.
    pub fn entry(&self, row: usize, column: usize) -> f64 {
        if row.max(column) >= self.leaf_size << self.levels {
            return 0.0;
        }
        let (i, j) = (row / self.leaf_size, column / self.leaf_size);
        let position = (row % self.leaf_size + self.leaf_size * (column % self.leaf_size)) as u32;
        match self.key.binary_search(&morton(i, j)) {
            Ok(block) => {
                let range = self.start[block]..self.start[block + 1];
                let found = self.position[range.clone()].binary_search(&position);
                found.map_or(0.0, |offset| self.value[range.start + offset])
            }
            // No unknown of an empty leaf exists.
            Err(_) if row == column => self.dummy,
            Err(_) => 0.0,
        }
    }

    /// All stored entries as (row, column, value).
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        self.key.iter().enumerate().flat_map(move |(block, &key)| {
            let (i, j) = (self.leaf_size * odd_bits(key), self.leaf_size * odd_bits(key >> 1));
            (self.start[block]..self.start[block + 1]).map(move |e| {
                let position = self.position[e] as usize;
                (i + position % self.leaf_size, j + position / self.leaf_size, self.value[e])
            })
        })
    }

    /// ||S - train||_F over the norm of the given entries for any train, S with its dummies: with D the dummy value on the
    /// whole diagonal, S - D is sparse and ||S - train||^2 = ||S - D||^2 - 2 <S - D, train - D> + ||train -
    /// D||^2. Every nonzero is compared, and what the train puts on zeros counts. O(nnz d r^2); cannot
    /// resolve less than about 1e-8.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the train does not have these modes.
    pub fn relative_error(&self, train: &TtMatrix) -> Result<f64, TtError> {
        let diagonal = TtMatrix::identity(&self.modes())?;
        diagonal.check_same_sizes(train)?;
        // In units of the norm of the entries, so that squares neither overflow nor vanish.
        let unit = f64::from(-self.exponent()).exp2();
        let dummy = self.dummy * unit;
        let (mut places, mut sparse) = (Vec::new(), Vec::new());
        for (row, column, value) in self.entries().filter(|(row, column, _)| dummy == 0.0 || row != column) {
            places.push((row, column));
            sparse.push(value * unit);
        }
        let mut deviation = train.scale(unit);
        if dummy != 0.0 {
            deviation = deviation.subtract(&diagonal.scale(dummy))?;
            for &key in self.key.iter().filter(|&&key| is_diagonal(key)) {
                let first = self.leaf_size * odd_bits(key);
                for i in first..first + self.leaf_size {
                    places.push((i, i));
                    sparse.push(self.entry(i, i) * unit - dummy);
                }
            }
        }
        let values = deviation.entries(&places)?;
        let inner: f64 = values.iter().zip(&sparse).map(|(a, b)| a * b).sum();
        let squared = sparse.iter().map(|x| x * x).sum::<f64>() - 2.0 * inner + deviation.norm().powi(2);
        Ok(squared.max(0.0).sqrt() / (self.norm * unit))
    }

    /// The train of the augmented matrix; see the module. The tolerance is relative to
    /// [`QuadtreeMatrix::norm`], the norm WITHOUT dummies: an identity on many dummies would otherwise hide
    /// any error.
    ///
    /// # Errors
    /// [`TtError::Setting`] for a bad truncation or a norm that overflows, [`TtError::Dense`] if an entry is
    /// not finite, [`TtError::TooLarge`] for leaves whose Gram matrix (n_1^4 numbers) does not fit.
    pub fn to_train(&self, truncation: &Truncation) -> Result<(TtMatrix, SparseReport), TtError> {
        truncation.check()?;
        largest_finite(&self.value).map_err(at_core(0))?;
        let exponent = self.exponent();
        if !self.norm.is_finite() {
            return Err(TtError::Setting { what: "norm of the entries", need: "finite", got: self.norm });
        }
        // Leaves as vectors, and Gram matrices of them.
        let width = (self.leaf_size as f64).powi(2);
        let numbers = width * (self.key.len() as f64 + if self.levels > 0 { width } else { 0.0 });
        if numbers > LARGEST_CORE as f64 {
            return Err(TtError::TooLarge { entries: numbers });
        }
        let norm_squared = (self.norm * f64::from(-exponent).exp2()).powi(2);
        let mut budget = Budget::new(truncation, norm_squared, self.levels);
        let mut nodes = self.leaves(exponent);
        let mut cores = Vec::with_capacity(self.levels + 1);
        let mut left = 1;
        for level in 0..self.levels {
            let mode = nodes.width / left;
            let basis = nodes.leading_basis(&mut budget).map_err(at_core(level))?;
            let rank = basis.columns();
            nodes = nodes.project(&basis).parents();
            cores.push(Core::from_left_unfolding(left, mode, basis));
            left = rank;
        }
        // One block is left (or none: the zero matrix).
        let root = if nodes.key.is_empty() { nodes.dummy.clone() } else { nodes.coefficients.clone() };
        cores.push(Core { left, mode: nodes.width / left, right: 1, data: root });
        share_power(&mut cores, i64::from(exponent));
        let modes = self.modes();
        let matrix = TtMatrix { rows: modes.clone(), columns: modes, train: TtVector { cores } };
        // Every level rotates numbers of the size of the matrix with its dummies.
        let floor =
            ROUNDING * ((self.levels + 1) as f64).sqrt() * (self.augmented_norm() / self.norm).min(f64::MAX);
        let report = budget.report(norm_squared, if self.norm > 0.0 { floor } else { 0.0 });
        // (The quotient first: the product of the error and the norm may vanish.)
        let augmented_error =
            if report.error > 0.0 { report.error * (self.norm / self.augmented_norm()) } else { 0.0 };
        Ok((
            matrix,
            SparseReport {
                error: report.error,
                floor: report.floor,
                augmented_error,
                norm: self.norm(),
                capped: report.capped,
            },
        ))
    }

    /// Power of two near the norm of the entries (of the dummies where there are none).
    fn exponent(&self) -> i32 {
        binary_exponent(if self.norm > 0.0 { self.norm } else { self.dummy.abs() })
    }

    /// Leaf blocks as vectors of n_1^2 numbers, times 2^-exponent.
    fn leaves(&self, exponent: i32) -> Level {
        let unit = f64::from(-exponent).exp2();
        let width = self.leaf_size * self.leaf_size;
        let mut coefficients = vec![0.0; width * self.key.len()];
        for block in 0..self.key.len() {
            for e in self.start[block]..self.start[block + 1] {
                coefficients[block * width + self.position[e] as usize] = self.value[e] * unit;
            }
        }
        let mut dummy = vec![0.0; width];
        dummy.iter_mut().step_by(self.leaf_size + 1).for_each(|x| *x = self.dummy * unit);
        let stored_diagonal = self.key.iter().filter(|&&key| is_diagonal(key)).count();
        let dummy_blocks =
            if self.dummy == 0.0 { 0.0 } else { (self.levels as f64).exp2() - stored_diagonal as f64 };
        Level { width, key: self.key.clone(), coefficients, dummy, dummy_blocks }
    }
}

/// What [`QuadtreeMatrix::to_train`] did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SparseReport {
    /// Frobenius error relative to the norm of the given entries (without dummies): exact up to the rounding
    /// of a Gram matrix, at most a tenth of the tolerance.
    pub error: f64,
    /// Relative error that rounding may have added: 64 eps sqrt(levels) times the norm with dummies over that
    /// without.
    pub floor: f64,
    /// The same error relative to the norm with dummies: what a method that looks only at the augmented
    /// matrix sees.
    pub augmented_error: f64,
    /// Frobenius norm of the given entries.
    pub norm: f64,
    /// Whether the cap on the ranks made the error exceed the tolerance.
    pub capped: bool,
}

/// The nonzero blocks of one level as coefficient vectors, and the one vector that all empty diagonal blocks
/// share.
struct Level {
    width: usize,
    key: Vec<u64>,
    coefficients: Vec<f64>,
    dummy: Vec<f64>,
    dummy_blocks: f64,
}

impl Level {
    /// The vectors of `chunk` as the columns of a matrix.
    fn chunk(&self, chunk: usize) -> View<'_> {
        let (first, last) = (chunk * CHUNK, ((chunk + 1) * CHUNK).min(self.key.len()));
        View::new(&self.coefficients[first * self.width..last * self.width], self.width, last - first)
    }

    fn num_chunks(&self) -> usize {
        self.key.len().div_ceil(CHUNK)
    }

    /// The orthonormal basis to keep: leading left singular vectors of all vectors side by side.
    fn leading_basis(&self, budget: &mut Budget) -> Result<Matrix, DenseError> {
        // The trace bounds the largest eigenvalue; rounding of the small ones is relative to it.
        let trace = self.coefficients.iter().chain([&0.0]).map(|x| x * x).sum::<f64>()
            + self.dummy_blocks.max(0.0) * self.dummy.iter().map(|x| x * x).sum::<f64>();
        let rounding = f64::EPSILON * self.width as f64 * trace;
        let (mut basis, squares) =
            if GRAM_SAFETY * rounding <= budget.share() { self.by_gram()? } else { self.by_triangle()? };
        let rank = budget.rank(&squares);
        basis.truncate_columns(rank);
        Ok(basis)
    }

    /// Eigenvectors of sum c c^T, chunk sums added in order.
    fn by_gram(&self) -> Result<(Matrix, Vec<f64>), DenseError> {
        let n = self.width;
        let sums: Vec<Matrix> =
            (0..self.num_chunks()).into_par_iter().map(|chunk| gram(self.chunk(chunk).t())).collect();
        let mut total = Matrix::zeros(n, n);
        for sum in &sums {
            total.data_mut().iter_mut().zip(sum.data()).for_each(|(t, x)| *t += x);
        }
        if self.dummy_blocks > 0.0 {
            for j in 0..n {
                for i in 0..n {
                    total[(i, j)] += self.dummy_blocks * self.dummy[i] * self.dummy[j];
                }
            }
        }
        let (values, vectors) = symmetric_eigen(total.view())?;
        let descending = Matrix::from_fn(n, n, |i, j| vectors[(i, n - 1 - j)]);
        // Fewer vectors than numbers in one: the rest is exactly zero.
        let most = n.min(self.key.len() + usize::from(self.dummy_blocks > 0.0)).max(1);
        let squares = values.iter().rev().take(most).map(|x| x.max(0.0)).collect();
        Ok((descending, squares))
    }

    /// The same from the triangle of a QR of all vectors: no squared condition number.
    fn by_triangle(&self) -> Result<(Matrix, Vec<f64>), DenseError> {
        let triangles: Vec<Matrix> = (0..self.num_chunks())
            .into_par_iter()
            .map(|chunk| {
                let vectors = self.chunk(chunk);
                qr_triangle(Matrix::from_fn(vectors.columns(), self.width, |i, j| vectors.get(j, i)))
            })
            .collect();
        let weight = self.dummy_blocks.max(0.0).sqrt();
        let mut triangle =
            Matrix::from_fn(usize::from(weight > 0.0), self.width, |_, j| weight * self.dummy[j]);
        for next in &triangles {
            let kept = triangle.rows();
            triangle = qr_triangle(Matrix::from_fn(kept + next.rows(), self.width, |i, j| {
                if i < kept { triangle[(i, j)] } else { next[(i - kept, j)] }
            }));
        }
        if triangle.rows() == 0 {
            triangle = Matrix::zeros(1, self.width);
        }
        let (u, s) = left_svd(triangle.t())?;
        Ok((u, s.iter().map(|s| s * s).collect()))
    }

    /// Coefficients in the new basis, c <- U^T c.
    fn project(self, basis: &Matrix) -> Self {
        let rank = basis.columns();
        let mut coefficients = vec![0.0; rank * self.key.len()];
        coefficients.par_chunks_mut(rank * CHUNK).enumerate().for_each(|(chunk, out)| {
            let columns = out.len() / rank;
            multiply(1.0, basis.t(), self.chunk(chunk), ViewMut::new(out, rank, columns));
        });
        let mut dummy = vec![0.0; rank];
        multiply(1.0, basis.t(), View::new(&self.dummy, self.width, 1), ViewMut::new(&mut dummy, rank, 1));
        Self { width: rank, coefficients, dummy, ..self }
    }

    /// Stacks the four children of every parent; empty diagonal children are dummies.
    fn parents(self) -> Self {
        let (rank, width) = (self.width, 4 * self.width);
        let (mut key, mut coefficients) =
            (Vec::new(), Vec::with_capacity(width * self.key.len().div_ceil(2)));
        let mut child = 0;
        let mut absorbed = 0.0;
        while child < self.key.len() {
            let parent = self.key[child] >> 2;
            let base = coefficients.len();
            coefficients.resize(base + width, 0.0);
            let mut stored = [false; 4];
            while child < self.key.len() && self.key[child] >> 2 == parent {
                let slot = (self.key[child] & 3) as usize;
                stored[slot] = true;
                let from = &self.coefficients[child * rank..(child + 1) * rank];
                coefficients[base + slot * rank..base + (slot + 1) * rank].copy_from_slice(from);
                child += 1;
            }
            if is_diagonal(parent) && self.dummy_blocks > 0.0 {
                for slot in [0, 3].into_iter().filter(|&slot| !stored[slot]) {
                    coefficients[base + slot * rank..base + (slot + 1) * rank].copy_from_slice(&self.dummy);
                    absorbed += 1.0;
                }
            }
            key.push(parent);
        }
        let mut dummy = vec![0.0; width];
        dummy[..rank].copy_from_slice(&self.dummy);
        dummy[3 * rank..].copy_from_slice(&self.dummy);
        Self { width, key, coefficients, dummy, dummy_blocks: (self.dummy_blocks - absorbed) / 2.0 }
    }
}

/// Frobenius norm by numbers scaled to at most 2 (not a number if one is not finite).
fn scaled_norm(values: &[f64]) -> f64 {
    let Ok(largest) = largest_finite(values) else { return f64::NAN };
    let power = f64::from(binary_exponent(largest));
    values.iter().map(|x| (x * (-power).exp2()).powi(2)).sum::<f64>().sqrt() * power.exp2()
}

/// Bits of i at even places (low), of j at odd places.
fn morton(i: usize, j: usize) -> u64 {
    spread(i as u64) | spread(j as u64) << 1
}

/// One zero bit between neighbouring bits.
fn spread(x: u64) -> u64 {
    let mut x = x & 0xFFFF_FFFF;
    x = (x | x << 16) & 0x0000_FFFF_0000_FFFF;
    x = (x | x << 8) & 0x00FF_00FF_00FF_00FF;
    x = (x | x << 4) & 0x0F0F_0F0F_0F0F_0F0F;
    x = (x | x << 2) & 0x3333_3333_3333_3333;
    (x | x << 1) & 0x5555_5555_5555_5555
}

/// The inverse of [`spread`]: every second bit, from the lowest.
fn odd_bits(x: u64) -> usize {
    let mut x = x & 0x5555_5555_5555_5555;
    x = (x | x >> 1) & 0x3333_3333_3333_3333;
    x = (x | x >> 2) & 0x0F0F_0F0F_0F0F_0F0F;
    x = (x | x >> 4) & 0x00FF_00FF_00FF_00FF;
    x = (x | x >> 8) & 0x0000_FFFF_0000_FFFF;
    ((x | x >> 16) & 0x0000_0000_FFFF_FFFF) as usize
}

/// Whether the block lies on the diagonal: I = J.
fn is_diagonal(key: u64) -> bool {
    (key ^ (key >> 1)) & 0x5555_5555_5555_5555 == 0
}
