//! The tensor train of a vector (or of any tensor): the type, its entries and its full form.

use crate::TtError;
use crate::scale::{
    binary_exponent, factor_within_product, largest_finite, scale_by_power, scale_within_floats,
};
use graintrain_linalg::dense::{Matrix, View, ViewMut, multiply, product};
use graintrain_linalg::triangles::{Triangle, multiply_triangle};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Largest full tensor that will be formed: 2^31 entries (16 GiB).
pub(crate) const LARGEST_FULL: f64 = 2147483648.0;
/// Most numbers of one core, or of a matrix on the way to one, that an operation makes unasked: 2^28 (2 GiB).
pub(crate) const LARGEST_CORE: usize = 1 << 28;
/// Right ranks that a block of a block-diagonal core has at least where blocks are multiplied one by one.
const SMALLEST_BLOCK: usize = 8;
/// Points per task of the evaluation of many entries.
const POINTS_PER_TASK: usize = 2048;

/// One core G(alpha, i, beta), of shape left x mode x right, at `alpha + left * (i + mode * beta)`.
///
/// So the same numbers are, without a copy, the left unfolding ((left mode) x right) and the right unfolding
/// (left x (mode right)), both column-major: every contraction is a plain matrix product.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "StoredCore")]
pub struct Core {
    pub(crate) left: usize,
    pub(crate) mode: usize,
    pub(crate) right: usize,
    pub(crate) data: Vec<f64>,
}

/// A block of a core: G(alpha, i, beta) is zero for these right ranks beta and all other left ranks alpha.
struct DiagonalBlock {
    left: Range<usize>,
    right: Range<usize>,
}

/// What serde sees; checked on the way in.
#[derive(Deserialize)]
struct StoredCore {
    left: usize,
    mode: usize,
    right: usize,
    data: Vec<f64>,
}

impl TryFrom<StoredCore> for Core {
    type Error = TtError;

    fn try_from(stored: StoredCore) -> Result<Self, TtError> {
        Self::new(stored.left, stored.mode, stored.right, stored.data)
    }
}

impl Core {
    /// A core from its numbers, first index fastest.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the length is not left * mode * right.
    pub fn new(left: usize, mode: usize, right: usize, data: Vec<f64>) -> Result<Self, TtError> {
        let core = Self { left, mode, right, data };
        core.check_length()?;
        Ok(core)
    }

    /// Fails unless the core holds left * mode * right numbers.
    fn check_length(&self) -> Result<(), TtError> {
        let expected = self.left.checked_mul(self.mode).and_then(|n| n.checked_mul(self.right));
        if expected == Some(self.data.len()) {
            return Ok(());
        }
        Err(TtError::Shape {
            what: "numbers in a core of left x mode x right",
            expected: vec![self.left, self.mode, self.right],
            got: vec![self.data.len()],
        })
    }

    /// A core from a function of (alpha, i, beta).
    pub fn from_fn(
        left: usize,
        mode: usize,
        right: usize,
        mut entry: impl FnMut(usize, usize, usize) -> f64,
    ) -> Self {
        let mut data = Vec::with_capacity(left * mode * right);
        for beta in 0..right {
            for i in 0..mode {
                data.extend((0..left).map(|alpha| entry(alpha, i, beta)));
            }
        }
        Self { left, mode, right, data }
    }

    /// Rank on the left.
    #[inline]
    pub fn left(&self) -> usize {
        self.left
    }

    /// Size of the mode.
    #[inline]
    pub fn mode(&self) -> usize {
        self.mode
    }

    /// Rank on the right.
    #[inline]
    pub fn right(&self) -> usize {
        self.right
    }

    /// The numbers, first index fastest.
    #[inline]
    pub fn data(&self) -> &[f64] {
        &self.data
    }

    /// G(alpha, i, beta).
    #[inline]
    pub fn get(&self, alpha: usize, i: usize, beta: usize) -> f64 {
        self.data[alpha + self.left * (i + self.mode * beta)]
    }

    /// The (left mode) x right unfolding.
    #[inline]
    pub(crate) fn left_unfolding(&self) -> View<'_> {
        View::new(&self.data, self.left * self.mode, self.right)
    }

    /// The left x (mode right) unfolding.
    #[inline]
    pub(crate) fn right_unfolding(&self) -> View<'_> {
        View::new(&self.data, self.left, self.mode * self.right)
    }

    /// The left x right matrix G(i) of one index: a view with stride left * mode between columns.
    #[inline]
    pub(crate) fn slice(&self, i: usize) -> View<'_> {
        View::with_stride(&self.data[i * self.left..], self.left, self.right, self.left * self.mode)
    }

    /// The left unfolding as a matrix, taking the numbers.
    pub(crate) fn into_left_unfolding(self) -> Matrix {
        Matrix::from_vec(self.left * self.mode, self.right, self.data)
    }

    /// A core from its left unfolding.
    pub(crate) fn from_left_unfolding(left: usize, mode: usize, matrix: Matrix) -> Self {
        Self { left, mode, right: matrix.columns(), data: matrix.into_vec() }
    }

    /// A core from its right unfolding.
    pub(crate) fn from_right_unfolding(mode: usize, right: usize, matrix: Matrix) -> Self {
        Self { left: matrix.rows(), mode, right, data: matrix.into_vec() }
    }

    /// M G: the left index contracted with the columns of M.
    pub(crate) fn multiply_left(&self, m: View<'_>) -> Self {
        self.multiply_left_scaled(m, 0)
    }

    /// G M: the right index contracted with the rows of M.
    pub(crate) fn multiply_right(&self, m: View<'_>) -> Self {
        self.multiply_right_scaled(m, 0)
    }

    /// 2^power M G, without overflow on the way where 2^power G has none. Only the blocks of block-diagonal
    /// cores are multiplied.
    pub(crate) fn multiply_left_scaled(&self, m: View<'_>, power: i32) -> Self {
        self.multiply_left_in(m, power, Vec::new())
    }

    /// [`Core::multiply_left_scaled`] in the given memory: new memory costs a page fault per 512 numbers, up
    /// to a tenth of such a product.
    pub(crate) fn multiply_left_in(&self, m: View<'_>, power: i32, memory: Vec<f64>) -> Self {
        let Some(factor) = factor_within_product(power) else {
            return self.scaled(power).multiply_left_in(m, 0, memory);
        };
        let (rows, fibres) = (m.rows(), self.mode * self.right);
        let mut data = with_length(memory, rows * fibres);
        match self.diagonal_blocks() {
            Some(blocks) => {
                for DiagonalBlock { left, right } in blocks {
                    let fibres = self.mode * right.start..self.mode * right.end;
                    let to = &mut data[rows * fibres.start..rows * fibres.end];
                    let to = ViewMut::new(to, rows, fibres.len());
                    let block = self.right_unfolding().block(left.clone(), fibres);
                    multiply(factor, m.block(0..rows, left), block, to);
                }
            }
            None => multiply(factor, m, self.right_unfolding(), ViewMut::new(&mut data, rows, fibres)),
        }
        Self { left: rows, data, ..*self }
    }

    /// 2^power G M, without overflow on the way where 2^power G has none. Blocks of zeros of block-diagonal
    /// cores and above the diagonal of M are not multiplied.
    pub(crate) fn multiply_right_scaled(&self, m: View<'_>, power: i32) -> Self {
        self.multiply_right_in(m, power, Vec::new())
    }

    /// [`Core::multiply_right_scaled`] in the given memory.
    pub(crate) fn multiply_right_in(&self, m: View<'_>, power: i32, memory: Vec<f64>) -> Self {
        let Some(factor) = factor_within_product(power) else {
            return self.scaled(power).multiply_right_in(m, 0, memory);
        };
        let (rows, columns) = (self.left * self.mode, m.columns());
        let mut data = with_length(memory, rows * columns);
        if let Some(blocks) = self.diagonal_blocks() {
            // (Rows below the last block belong to none.)
            data.fill(0.0);
            for DiagonalBlock { left, right } in blocks {
                let m = m.block(right.clone(), 0..columns);
                for i in 0..self.mode {
                    let to = &mut data[self.left * i + left.start..];
                    let to = ViewMut::with_stride(to, left.len(), columns, rows);
                    multiply(factor, self.slice(i).block(left.clone(), right.clone()), m, to);
                }
            }
        } else if m.rows() == columns && m.is_lower_triangular() {
            multiply_triangle(factor, self.left_unfolding(), m, Triangle::Lower, &mut data);
        } else {
            multiply(factor, self.left_unfolding(), m, ViewMut::new(&mut data, rows, columns));
        }
        Self { right: columns, data, ..*self }
    }

    /// The blocks of a core that is zero outside of them, as the cores of a sum are, each of
    /// [`SMALLEST_BLOCK`] right ranks at least; none for other cores. O(1) for a core without zeros in its
    /// corners, else O(left mode right).
    fn diagonal_blocks(&self) -> Option<Vec<DiagonalBlock>> {
        if self.left.min(self.right) < 2 * SMALLEST_BLOCK {
            return None;
        }
        let corners =
            |i: usize| self.get(self.left - 1, i, 0) == 0.0 && self.get(0, i, self.right - 1) == 0.0;
        if !(0..self.mode).all(corners) {
            return None;
        }
        // (All bits but the sign: without a branch, four numbers a cycle.)
        let any = |part: &[f64]| part.iter().fold(0, |bits, x| bits | (x.to_bits() << 1)) != 0;
        // Of every column the rows between its first and its last number that is not zero.
        let support = |column: &[f64]| {
            let (mut first, mut end) = (self.left, 0);
            for fibre in column.chunks_exact(self.left) {
                if any(&fibre[..first]) {
                    first = fibre.iter().position(|x| *x != 0.0).unwrap_or(first);
                }
                if any(&fibre[end..]) {
                    end = fibre.iter().rposition(|x| *x != 0.0).map_or(end, |last| last + 1);
                }
            }
            (first, end)
        };
        let supports: Vec<(usize, usize)> =
            self.data.chunks_exact(self.left * self.mode).map(support).collect();
        // The smallest first row of the columns from here on.
        let mut firsts: Vec<usize> = supports.iter().map(|s| s.0).collect();
        (0..self.right - 1).rev().for_each(|beta| firsts[beta] = firsts[beta].min(firsts[beta + 1]));
        let (mut blocks, mut row, mut column, mut end) = (Vec::new(), 0, 0, 0);
        for beta in 0..self.right {
            end = end.max(supports[beta].1);
            let last = beta + 1 == self.right;
            if last || (beta + 1 - column >= SMALLEST_BLOCK && end <= firsts[beta + 1]) {
                blocks.push(DiagonalBlock { left: row..end.max(row), right: column..beta + 1 });
                (row, column) = (end.max(row), beta + 1);
            }
        }
        (blocks.len() > 1).then_some(blocks)
    }

    /// 2^power G.
    pub(crate) fn scaled(&self, power: i32) -> Self {
        self.clone().into_scaled(power)
    }

    /// 2^power G in the same memory.
    pub(crate) fn into_scaled(mut self, power: i32) -> Self {
        scale_by_power(&mut self.data, power);
        self
    }
}

/// Memory for this many numbers, whatever they are.
pub(crate) fn with_length(mut memory: Vec<f64>, length: usize) -> Vec<f64> {
    if memory.capacity() < length {
        return vec![0.0; length];
    }
    memory.resize(length, 0.0);
    memory
}

/// A tensor train: A(i_1, ..., i_d) = G_1(i_1) G_2(i_2) ... G_d(i_d).
///
/// The first index is the fastest of the full vector: j = i_1 + n_1 i_2 + n_1 n_2 i_3 + ...
///
/// ```
/// use graintrain_tt::TtVector;
/// let x = TtVector::rank_one(&[vec![1.0, 2.0], vec![1.0, 10.0]])?;
/// assert_eq!(x.to_full()?, [1.0, 2.0, 10.0, 20.0]);
/// assert_eq!(x.entry(&[1, 1])?, 20.0);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Core>", into = "Vec<Core>")]
pub struct TtVector {
    pub(crate) cores: Vec<Core>,
}

impl TryFrom<Vec<Core>> for TtVector {
    type Error = TtError;

    fn try_from(cores: Vec<Core>) -> Result<Self, TtError> {
        Self::from_cores(cores)
    }
}

impl From<TtVector> for Vec<Core> {
    fn from(train: TtVector) -> Self {
        train.cores
    }
}

impl TtVector {
    /// A train from its cores.
    ///
    /// # Errors
    /// [`TtError::Shape`] if there is no core, a core does not hold left * mode * right numbers, neighbours
    /// disagree on a rank, a size is zero, or the outer ranks are not 1.
    pub fn from_cores(cores: Vec<Core>) -> Result<Self, TtError> {
        let shape = |what, expected: usize, got: usize| {
            if expected == got {
                Ok(())
            } else {
                Err(TtError::Shape { what, expected: vec![expected], got: vec![got] })
            }
        };
        if cores.is_empty() {
            return Err(TtError::Shape { what: "number of cores", expected: vec![1], got: vec![0] });
        }
        let mut rank = 1;
        for core in &cores {
            shape("left rank of a core", rank, core.left)?;
            core.check_length()?;
            if core.data.is_empty() {
                return Err(TtError::Shape { what: "numbers in a core", expected: vec![1], got: vec![0] });
            }
            rank = core.right;
        }
        shape("right rank of the last core", 1, rank)?;
        Ok(Self { cores })
    }

    /// The Kronecker product x_d (x) ... (x) x_1 of vectors: rank one, entry prod_k x_k(i_k).
    ///
    /// # Errors
    /// [`TtError::Shape`] if there is no factor or a factor is empty.
    pub fn rank_one(factors: &[Vec<f64>]) -> Result<Self, TtError> {
        Self::from_cores(
            factors.iter().map(|x| Core { left: 1, mode: x.len(), right: 1, data: x.clone() }).collect(),
        )
    }

    /// All entries equal to `value`.
    ///
    /// # Errors
    /// [`TtError::Shape`] if there is no mode or a mode is empty, [`TtError::TooLarge`] for a mode above
    /// 2^31.
    pub fn constant(modes: &[usize], value: f64) -> Result<Self, TtError> {
        check_modes(modes)?;
        let mut train = Self::rank_one(&modes.iter().map(|&n| vec![1.0; n]).collect::<Vec<_>>())?;
        train.cores[0].data.fill(value);
        Ok(train)
    }

    /// One entry equal to 1, all others 0.
    ///
    /// # Errors
    /// [`TtError::Index`] if the index lies outside, [`TtError::Shape`] if it has the wrong length,
    /// [`TtError::TooLarge`] for a mode above 2^31.
    pub fn unit(modes: &[usize], index: &[usize]) -> Result<Self, TtError> {
        check_modes(modes)?;
        check_index(modes, index)?;
        let unit = |(&n, &i): (&usize, &usize)| (0..n).map(|k| f64::from(k == i)).collect();
        Self::rank_one(&modes.iter().zip(index).map(unit).collect::<Vec<_>>())
    }

    /// Ranks `rank` (less where the tensor does not allow it) and entries uniform in [-1, 1], from a seed.
    ///
    /// # Errors
    /// [`TtError::Shape`] if there is no mode or a mode is empty, [`TtError::TooLarge`] for a core of more
    /// than 2^31 numbers.
    pub fn random(modes: &[usize], rank: usize, seed: u64) -> Result<Self, TtError> {
        let mut random = crate::random::Random::new(seed);
        let ranks = admissible_ranks(modes, rank);
        check_cores(modes, &ranks)?;
        let core = |k: usize, random: &mut crate::random::Random| {
            Core::from_fn(ranks[k], modes[k], ranks[k + 1], |_, _, _| random.symmetric())
        };
        Self::from_cores((0..modes.len()).map(|k| core(k, &mut random)).collect())
    }

    /// The cores.
    pub fn cores(&self) -> &[Core] {
        &self.cores
    }

    /// The cores, taken.
    pub fn into_cores(self) -> Vec<Core> {
        self.cores
    }

    /// Number of cores d.
    pub fn num_cores(&self) -> usize {
        self.cores.len()
    }

    /// Mode sizes n_1, ..., n_d.
    pub fn modes(&self) -> Vec<usize> {
        self.cores.iter().map(|core| core.mode).collect()
    }

    /// Ranks r_0 = 1, r_1, ..., r_d = 1.
    pub fn ranks(&self) -> Vec<usize> {
        std::iter::once(1).chain(self.cores.iter().map(|core| core.right)).collect()
    }

    /// The largest rank.
    pub fn max_rank(&self) -> usize {
        self.cores.iter().map(|core| core.right).max().unwrap_or(1)
    }

    /// Numbers stored.
    pub fn num_parameters(&self) -> usize {
        self.cores.iter().map(|core| core.data.len()).sum()
    }

    /// Number of entries of the full tensor (a float: it may exceed any integer).
    pub fn num_entries(&self) -> f64 {
        self.cores.iter().map(|core| core.mode as f64).product()
    }

    /// A(i_1, ..., i_d); O(d r^2).
    ///
    /// # Errors
    /// [`TtError::Index`] if an index lies outside its mode, [`TtError::Shape`] if there are not d of them.
    pub fn entry(&self, index: &[usize]) -> Result<f64, TtError> {
        check_index(&self.modes(), index)?;
        let mut row = vec![1.0];
        for (core, &i) in self.cores.iter().zip(index) {
            let slice = core.slice(i);
            let product = |beta| (0..core.left).map(|alpha| row[alpha] * slice.get(alpha, beta)).sum();
            row = (0..core.right).map(product).collect();
        }
        Ok(row[0])
    }

    /// Many entries: `indices` holds d indices per entry, one entry after the other. O(d r^2) each.
    ///
    /// Points are taken in chunks (one task each); in a chunk all points with the same digit go through the
    /// core in one matrix product.
    ///
    /// # Errors
    /// [`TtError::Index`] if an index lies outside its mode, [`TtError::Shape`] if the length is not a
    /// multiple of d.
    pub fn entries(&self, indices: &[usize]) -> Result<Vec<f64>, TtError> {
        let (d, modes) = (self.num_cores(), self.modes());
        if !indices.len().is_multiple_of(d) {
            return Err(TtError::Shape {
                what: "indices per entry",
                expected: vec![d],
                got: vec![indices.len() % d],
            });
        }
        indices.chunks_exact(d).try_for_each(|index| check_index(&modes, index))?;
        let mut values = vec![0.0; indices.len() / d];
        let chunks = indices.par_chunks(d * POINTS_PER_TASK);
        values
            .par_chunks_mut(POINTS_PER_TASK)
            .zip(chunks)
            .for_each(|(values, indices)| self.chunk(indices, values));
        Ok(values)
    }

    /// Entries of one chunk of points.
    fn chunk(&self, indices: &[usize], values: &mut [f64]) {
        let (d, count) = (self.num_cores(), values.len());
        // Column p of the state is (G_1(i_1) ... G_k(i_k))^T for point `order[p]`.
        let mut order: Vec<usize> = (0..count).collect();
        let (mut state, mut sorted, mut next) = (vec![1.0; count], Vec::new(), Vec::new());
        for (k, core) in self.cores.iter().enumerate() {
            let digit = |p: usize| indices[p * d + k];
            // Points sorted by digit, their columns with them.
            let mut start = vec![0; core.mode + 1];
            order.iter().for_each(|&p| start[digit(p) + 1] += 1);
            (0..core.mode).for_each(|i| start[i + 1] += start[i]);
            let groups = start.clone();
            let mut moved = vec![0; count];
            sorted.resize(core.left * count, 0.0);
            for (column, &p) in order.iter().enumerate() {
                let to = start[digit(p)];
                start[digit(p)] += 1;
                moved[to] = p;
                sorted[to * core.left..(to + 1) * core.left]
                    .copy_from_slice(&state[column * core.left..(column + 1) * core.left]);
            }
            order = moved;
            next.resize(core.right * count, 0.0);
            for i in 0..core.mode {
                let (first, last) = (groups[i], groups[i + 1]);
                if first < last {
                    let from = View::new(&sorted[first * core.left..], core.left, last - first);
                    let to = ViewMut::new(&mut next[first * core.right..], core.right, last - first);
                    multiply(1.0, core.slice(i).t(), from, to);
                }
            }
            std::mem::swap(&mut state, &mut next);
        }
        order.iter().zip(&state).for_each(|(&p, &value)| values[p] = value);
    }

    /// The full vector, first index fastest. An entry that exceeds the largest float by rounding only (1e-13
    /// of it) is that float; larger ones are infinite.
    ///
    /// # Errors
    /// [`TtError::TooLarge`] above 2^31 entries.
    pub fn to_full(&self) -> Result<Vec<f64>, TtError> {
        let entries = self.num_entries();
        if entries > LARGEST_FULL {
            return Err(TtError::TooLarge { entries });
        }
        // No entry of a product of cores exceeds the product of their Frobenius norms: nothing overflows on
        // the way.
        let size = |core: &Core| largest_finite(&core.data).unwrap_or(0.0);
        let bits = |core: &Core| (size(core).log2() + 0.5 * (core.data.len() as f64).log2()).max(0.0);
        if self.cores.iter().map(bits).sum::<f64>() < f64::from(f64::MAX_EXP - 1) {
            return Ok(full_vector(&self.cores));
        }
        let powers: Vec<i32> = self.cores.iter().map(|core| binary_exponent(size(core))).collect();
        let scaled: Vec<Core> =
            self.cores.iter().zip(&powers).map(|(core, power)| core.scaled(-power)).collect();
        let mut full = full_vector(&scaled);
        scale_within_floats(&mut full, powers.iter().map(|&power| i64::from(power)).sum());
        Ok(full)
    }

    /// Sum of all entries; O(d n r^2).
    pub fn sum(&self) -> f64 {
        let mut row = vec![1.0];
        for core in &self.cores {
            let column = |beta: usize| {
                let g = &core.data[beta * core.left * core.mode..(beta + 1) * core.left * core.mode];
                g.chunks_exact(core.left).map(|g| g.iter().zip(&row).map(|(g, x)| g * x).sum::<f64>()).sum()
            };
            row = (0..core.right).map(column).collect();
        }
        row[0]
    }

    /// Fails unless the other train has the same modes.
    pub(crate) fn check_same_modes(&self, other: &Self) -> Result<(), TtError> {
        let (expected, got) = (self.modes(), other.modes());
        if expected == got { Ok(()) } else { Err(TtError::Shape { what: "mode sizes", expected, got }) }
    }
}

/// The tensor of cores, first index fastest.
fn full_vector(cores: &[Core]) -> Vec<f64> {
    let mut full = Matrix::from_vec(1, 1, vec![1.0]);
    for core in cores {
        let rows = full.rows();
        let next = product(full.view(), core.right_unfolding()).into_vec();
        full = Matrix::from_vec(rows * core.mode, core.right, next);
    }
    full.into_vec()
}

/// Ranks `rank`, but never above the number of rows or columns of an unfolding.
pub(crate) fn admissible_ranks(modes: &[usize], rank: usize) -> Vec<usize> {
    let d = modes.len();
    let mut ranks = vec![rank.max(1); d + 1];
    ranks[0] = 1;
    ranks[d] = 1;
    for k in 1..d {
        ranks[k] = ranks[k].min(ranks[k - 1].saturating_mul(modes[k - 1]));
    }
    for k in (1..d).rev() {
        ranks[k] = ranks[k].min(ranks[k + 1].saturating_mul(modes[k]));
    }
    ranks
}

/// Fails if a core of these ranks does not fit.
pub(crate) fn check_cores(modes: &[usize], ranks: &[usize]) -> Result<(), TtError> {
    let sizes = modes.iter().zip(ranks.windows(2)).map(|(&n, r)| n as f64 * r[0] as f64 * r[1] as f64);
    let largest = sizes.fold(0.0, f64::max);
    if largest > LARGEST_FULL { Err(TtError::TooLarge { entries: largest }) } else { Ok(()) }
}

/// Fails if a vector of the length of a mode does not fit.
fn check_modes(modes: &[usize]) -> Result<(), TtError> {
    let largest = modes.iter().copied().max().unwrap_or(0) as f64;
    if largest > LARGEST_FULL { Err(TtError::TooLarge { entries: largest }) } else { Ok(()) }
}

/// Fails unless the index lies inside the modes.
pub(crate) fn check_index(modes: &[usize], index: &[usize]) -> Result<(), TtError> {
    if modes.len() != index.len() {
        return Err(TtError::Shape {
            what: "number of indices",
            expected: vec![modes.len()],
            got: vec![index.len()],
        });
    }
    match (0..modes.len()).find(|&k| index[k] >= modes[k]) {
        Some(mode) => Err(TtError::Index { mode, index: index[mode], size: modes[mode] }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use graintrain_linalg::dense::product;

    /// Cores with blocks of zeros, of every shape of blocks, against products that know nothing of blocks.
    #[test]
    fn products_of_block_diagonal_cores_equal_those_of_full_ones() {
        let mut random = Random::new(1);
        for blocks in [
            vec![(20, 20), (20, 20)],
            vec![(9, 30), (30, 9)],
            vec![(16, 3), (4, 17), (2, 2), (9, 9)],
            vec![(1, 12), (40, 8), (0, 5)],
            vec![(33, 40)],
        ] {
            let (left, right): (Vec<usize>, Vec<usize>) = blocks.iter().copied().unzip();
            let block_of = |sizes: &[usize], at: usize| {
                sizes
                    .iter()
                    .scan(0, |sum, n| {
                        *sum += n;
                        Some(*sum)
                    })
                    .position(|end| at < end)
            };
            let (rows, columns): (usize, usize) = (left.iter().sum(), right.iter().sum());
            let core = Core::from_fn(rows, 3, columns, |alpha, _, beta| {
                if block_of(&left, alpha) == block_of(&right, beta) { random.symmetric() } else { 0.0 }
            });
            assert_eq!(core.diagonal_blocks().is_some(), blocks.len() > 1, "{blocks:?}");
            let mut sample = |m, n| Matrix::from_fn(m, n, |_, _| random.symmetric());
            let (before, after) = (sample(7, rows), sample(columns, 5));
            // A factor that is a triangle, too.
            let square = sample(columns, columns);
            let lower = Matrix::from_fn(columns, columns, |i, j| if i >= j { square[(i, j)] } else { 0.0 });
            let close = |x: &[f64], y: &Matrix| {
                x.len() == y.data().len() && x.iter().zip(y.data()).all(|(x, y)| (4.0 * x - y).abs() < 1e-13)
            };
            assert!(close(
                &core.multiply_left_scaled(before.view(), -2).data,
                &product(before.view(), core.right_unfolding())
            ));
            for factor in [after, lower, square] {
                assert!(close(
                    &core.multiply_right_scaled(factor.view(), -2).data,
                    &product(core.left_unfolding(), factor.view())
                ));
            }
        }
    }
}
