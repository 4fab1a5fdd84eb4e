//! TT-matrix times full vector, O(r^2 N log N), without transposing the state.
//!
//! Between two cores the state is Z[P | alpha | j | Q], first index fastest: P the digits i already produced,
//! alpha the rank index, j the next digit, Q the digits not yet touched. For each q in Q one product
//!
//! (P x (alpha, j)) * C_k((alpha, j), (i, alpha'))
//!
//! writes [P | i | alpha' | q]: already the layout of the next core. Neighbouring cores are merged first
//! where that costs no time (digits of size 4 cost the flops of two of size 2 and half the traffic; the first
//! core grows until P is wide enough for the vector units).
//!
//! Cores are run depth first in two stages so that only ONE state of r N numbers passes through memory: stage
//! one runs the fine cores on one chunk of x at a time (the state of a chunk stays in cache), stage two the
//! coarse cores on one block of rows P at a time. Chunks and blocks are the tasks of the threads; each writes
//! its own part, so the bits do not depend on the number of threads.
//!
//! Flops: 2 N sum_k n_k r_{k-1} r_k. Traffic: about 8 N (2 r + 4) bytes, r the rank at the seam of the two
//! stages.

use crate::{TtError, TtMatrix};
use graintrain_linalg::dense::{Matrix, View, ViewMut, multiply};
use rayon::prelude::*;
use std::cell::RefCell;

/// Rows of P per task of stage two.
const BLOCK_ROWS: usize = 32;
/// Numbers of state per task that fit in a core's cache with room to spare (half a MiB).
const CACHE_NUMBERS: usize = 1 << 16;
/// A merged core of more numbers than this (8 MiB) stays in no cache: it is read again for every task.
const LARGEST_CACHED_CORE: f64 = 1048576.0;
/// Rough rates for choosing which cores to merge: flops and bytes (between core and cache) per second.
const FLOP_RATE: f64 = 4e10;
const BYTE_RATE: f64 = 2e10;

/// One merged core C((alpha, j), (i, alpha')).
#[derive(Clone, Debug)]
struct Step {
    left: usize,
    rows: usize,
    columns: usize,
    right: usize,
    /// (left columns) x (rows right); for the first step transposed: (rows right) x columns.
    matrix: Matrix,
}

/// A TT-matrix prepared for products with full vectors.
///
/// ```
/// use graintrain_tt::{apply::FullOperator, qtt};
/// let operator = FullOperator::new(&qtt::laplacian(10)?)?;
/// let y = operator.multiply(&vec![1.0; 1024])?;
/// assert!((y[0] - 1.0).abs() < 1e-12 && y[512].abs() < 1e-12);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
#[derive(Clone, Debug)]
pub struct FullOperator {
    steps: Vec<Step>,
    /// Steps of stage one.
    seam: usize,
    num_rows: usize,
    num_columns: usize,
    flops: f64,
}

/// Memory of [`FullOperator::apply`], kept between calls.
#[derive(Clone, Debug, Default)]
pub struct ApplyWork {
    seam: Vec<f64>,
    blocks: Vec<f64>,
}

thread_local! {
    /// Two states of one task.
    static STATES: RefCell<(Vec<f64>, Vec<f64>)> = const { RefCell::new((Vec::new(), Vec::new())) };
}

/// Full vectors longer than this (8 TiB, or the whole memory of a 32-bit system) are refused before memory is
/// asked for.
const LARGEST_VECTOR: u64 = if usize::BITS < 64 { isize::MAX as u64 / 8 } else { 1 << 40 };

impl FullOperator {
    /// Merges and reshapes the cores: O(numbers in the cores).
    ///
    /// # Errors
    /// [`TtError::TooLarge`] if the full vectors would not fit in an index.
    pub fn new(matrix: &TtMatrix) -> Result<Self, TtError> {
        let (num_rows, num_columns) = (matrix.num_rows()?, matrix.num_columns()?);
        if num_rows.max(num_columns) as u64 > LARGEST_VECTOR {
            return Err(TtError::TooLarge { entries: num_rows.max(num_columns) as f64 });
        }
        let groups = choose_groups(matrix);
        let steps: Vec<Step> =
            groups.iter().enumerate().map(|(k, &(first, last))| merge(matrix, first, last, k == 0)).collect();
        let (mut flops, mut produced, mut left_over) = (0.0, 1.0, num_columns as f64);
        for step in &steps {
            left_over /= step.columns as f64;
            flops += 2.0 * produced * left_over * (step.left * step.columns * step.rows * step.right) as f64;
            produced *= step.rows as f64;
        }
        let mut operator = Self { seam: steps.len(), steps, num_rows, num_columns, flops };
        operator.seam = operator.choose_seam();
        Ok(operator)
    }

    /// Number of rows.
    pub fn num_rows(&self) -> usize {
        self.num_rows
    }

    /// Number of columns.
    pub fn num_columns(&self) -> usize {
        self.num_columns
    }

    /// Floating point operations of one product.
    pub fn flops(&self) -> f64 {
        self.flops
    }

    /// Bytes that one product must move through memory: x, y, the state at the seam written and read, and the
    /// blocks.
    pub fn traffic(&self) -> f64 {
        let mut numbers = self.num_rows + self.num_columns;
        if self.seam < self.steps.len() {
            numbers += 2 * self.seam_numbers() + 2 * self.num_rows;
        }
        8.0 * numbers as f64
    }

    /// A x as a new vector.
    ///
    /// # Errors
    /// [`TtError::Shape`] if x does not have the number of columns.
    pub fn multiply(&self, x: &[f64]) -> Result<Vec<f64>, TtError> {
        let mut y = vec![0.0; self.num_rows];
        self.apply(x, &mut y, &mut ApplyWork::default())?;
        Ok(y)
    }

    /// y <- A x.
    ///
    /// # Errors
    /// [`TtError::Shape`] if x or y has the wrong length.
    pub fn apply(&self, x: &[f64], y: &mut [f64], work: &mut ApplyWork) -> Result<(), TtError> {
        if x.len() != self.num_columns || y.len() != self.num_rows {
            return Err(TtError::Shape {
                what: "lengths of x and y in y = A x",
                expected: vec![self.num_columns, self.num_rows],
                got: vec![x.len(), y.len()],
            });
        }
        if self.seam == self.steps.len() {
            self.run_chunk(x, y);
            return Ok(());
        }
        let (fine, coarse) = self.steps.split_at(self.seam);
        let produced: usize = fine.iter().map(|step| step.rows).product();
        let consumed: usize = fine.iter().map(|step| step.columns).product();
        let rank = coarse[0].left;
        work.seam.resize(self.seam_numbers(), 0.0);
        work.seam
            .par_chunks_mut(produced * rank)
            .zip(x.par_chunks(consumed))
            .for_each(|(out, x)| self.run_chunk(x, out));
        let coarse_rows: usize = coarse.iter().map(|step| step.rows).product();
        work.blocks.resize(self.num_rows, 0.0);
        let seam = &work.seam;
        work.blocks
            .par_chunks_mut(BLOCK_ROWS * coarse_rows)
            .enumerate()
            .for_each(|(block, out)| self.run_block(seam, produced, block * BLOCK_ROWS, out));
        let blocks = &work.blocks;
        y.par_chunks_mut(produced).enumerate().for_each(|(coarse_row, y)| {
            for (block, y) in y.chunks_mut(BLOCK_ROWS).enumerate() {
                let from = block * BLOCK_ROWS * coarse_rows + coarse_row * y.len();
                y.copy_from_slice(&blocks[from..from + y.len()]);
            }
        });
        Ok(())
    }

    /// Y <- A X for several vectors, the columns of X one after the other. Matrices so small that one product
    /// is one task run the columns side by side; larger ones run every product on all threads.
    ///
    /// # Errors
    /// [`TtError::Shape`] unless X and Y hold the same number of columns.
    ///
    /// ```
    /// use graintrain_tt::{apply::{ApplyWork, FullOperator}, qtt};
    /// let operator = FullOperator::new(&qtt::shift(4)?)?;
    /// let x: Vec<f64> = (0..3 * 16).map(f64::from).collect();
    /// let mut y = vec![0.0; 3 * 16];
    /// operator.apply_many(&x, &mut y, &mut ApplyWork::default())?;
    /// assert_eq!((y[16], y[17]), (0.0, 16.0)); // the second vector, moved by one
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn apply_many(&self, x: &[f64], y: &mut [f64], work: &mut ApplyWork) -> Result<(), TtError> {
        let count = x.len() / self.num_columns;
        if x.len() != count * self.num_columns || y.len() != count * self.num_rows {
            return Err(TtError::Shape {
                what: "lengths of X and Y, whole numbers of columns, in Y = A X",
                expected: vec![count * self.num_columns, count * self.num_rows],
                got: vec![x.len(), y.len()],
            });
        }
        if self.seam == self.steps.len() {
            let columns = x.par_chunks(self.num_columns);
            y.par_chunks_mut(self.num_rows).zip(columns).for_each(|(y, x)| self.run_chunk(x, y));
            return Ok(());
        }
        let columns = x.chunks_exact(self.num_columns);
        y.chunks_exact_mut(self.num_rows).zip(columns).try_for_each(|(y, x)| self.apply(x, y, work))
    }

    /// Numbers of the state at the seam.
    fn seam_numbers(&self) -> usize {
        let (fine, coarse) = self.steps.split_at(self.seam);
        let produced: usize = fine.iter().map(|step| step.rows).product();
        produced
            * coarse.iter().map(|step| step.columns).product::<usize>()
            * coarse.first().map_or(1, |c| c.left)
    }

    /// The seam that makes the larger of the two states per task smallest; none if one task fits in cache.
    fn choose_seam(&self) -> usize {
        let count = self.steps.len();
        let widest = |steps: &[Step]| steps.iter().map(|step| step.left.max(step.right)).max().unwrap_or(1);
        let size = |steps: &[Step]| steps.iter().map(|step| step.rows.max(step.columns)).product::<usize>();
        if widest(&self.steps) * size(&self.steps) <= CACHE_NUMBERS {
            return count;
        }
        let state = |seam: usize| {
            let (fine, coarse) = self.steps.split_at(seam);
            (widest(fine) * size(fine)).max(BLOCK_ROWS.min(size(fine)) * widest(coarse) * size(coarse))
        };
        (1..count).min_by_key(|&seam| state(seam)).unwrap_or(count)
    }

    /// Stage one on one chunk of x: [j_1, ..., j_s] to [i_1, ..., i_s | alpha].
    fn run_chunk(&self, x: &[f64], out: &mut [f64]) {
        let steps = &self.steps[..self.seam];
        let first = &steps[0];
        let rest = x.len() / first.columns;
        let wide = first.rows * first.right;
        let whole = View::new(x, first.columns, rest);
        if steps.len() == 1 {
            multiply(1.0, first.matrix.view(), whole, ViewMut::new(out, wide, rest));
            return;
        }
        STATES.with_borrow_mut(|(state, next)| {
            state.resize(wide * rest, 0.0);
            multiply(1.0, first.matrix.view(), whole, ViewMut::new(state, wide, rest));
            run_steps(&steps[1..], first.rows, state, next, out);
        });
    }

    /// Stage two on the rows from `first_row` of the seam: [rows | alpha | j] to [rows | i].
    fn run_block(&self, seam: &[f64], produced: usize, first_row: usize, out: &mut [f64]) {
        let steps = &self.steps[self.seam..];
        let rows = BLOCK_ROWS.min(produced - first_row);
        let first = &steps[0];
        let (inner, wide) = (first.left * first.columns, first.rows * first.right);
        let rest = seam.len() / (produced * inner);
        let step_in = |state: &mut [f64]| {
            for q in 0..rest {
                let from =
                    View::with_stride(&seam[q * produced * inner + first_row..], rows, inner, produced);
                let to = &mut state[q * rows * wide..(q + 1) * rows * wide];
                multiply(1.0, from, first.matrix.view(), ViewMut::new(to, rows, wide));
            }
        };
        if steps.len() == 1 {
            step_in(out);
            return;
        }
        STATES.with_borrow_mut(|(state, next)| {
            state.resize(rows * wide * rest, 0.0);
            step_in(state);
            run_steps(&steps[1..], rows * first.rows, state, next, out);
        });
    }
}

/// Runs steps on a state with `produced` rows; the last one writes to `out`.
fn run_steps(
    steps: &[Step],
    mut produced: usize,
    state: &mut Vec<f64>,
    next: &mut Vec<f64>,
    out: &mut [f64],
) {
    let (last, before) = match steps.split_last() {
        Some(split) => split,
        None => return,
    };
    for step in before {
        let numbers = state.len() / (step.left * step.columns) * step.rows * step.right;
        next.resize(numbers, 0.0);
        run_step(step, produced, state, next);
        std::mem::swap(state, next);
        produced *= step.rows;
    }
    run_step(last, produced, state, out);
}

/// One step for every q.
fn run_step(step: &Step, produced: usize, state: &[f64], out: &mut [f64]) {
    let (inner, wide) = (step.left * step.columns, step.rows * step.right);
    for (from, to) in state.chunks_exact(produced * inner).zip(out.chunks_exact_mut(produced * wide)) {
        let from = View::new(from, produced, inner);
        multiply(1.0, from, step.matrix.view(), ViewMut::new(to, produced, wide));
    }
}

/// The cheapest way to merge neighbouring cores, by dynamic programming over the estimated time per unknown.
fn choose_groups(matrix: &TtMatrix) -> Vec<(usize, usize)> {
    let (d, ranks) = (matrix.num_cores(), matrix.ranks());
    let mut best = vec![f64::INFINITY; d + 1];
    let mut from = vec![0; d + 1];
    best[0] = 0.0;
    for last in 0..d {
        let (mut rows, mut columns) = (1.0, 1.0);
        for first in (0..=last).rev() {
            rows *= matrix.rows[first] as f64;
            columns *= matrix.columns[first] as f64;
            if first < last && rows.max(columns) > 256.0 {
                break;
            }
            let (left, right) = (ranks[first] as f64, ranks[last + 1] as f64);
            // Per unknown of the vector: `rows` outputs of `right` numbers, each a sum of left * columns
            // products.
            let flops = 2.0 * left * right * rows.max(columns);
            let mut bytes = 8.0 * (left + right);
            let numbers = left * rows * columns * right;
            if numbers > LARGEST_CACHED_CORE {
                bytes += 8.0 * numbers * left.max(right) / CACHE_NUMBERS as f64;
            }
            // Narrow P starves the vector units; the first step has Q in its place.
            let produced: f64 = matrix.rows[..first].iter().map(|&n| n as f64).product();
            let narrow = if first == 0 { 1.0 } else { 1.0 + 24.0 / produced };
            let time = best[first] + narrow * flops / FLOP_RATE + bytes / BYTE_RATE;
            if time < best[last + 1] {
                best[last + 1] = time;
                from[last + 1] = first;
            }
        }
    }
    let mut groups = Vec::new();
    let mut end = d;
    while end > 0 {
        groups.push((from[end], end - 1));
        end = from[end];
    }
    groups.reverse();
    groups
}

/// Cores first..=last as one step.
fn merge(matrix: &TtMatrix, first: usize, last: usize, transposed: bool) -> Step {
    let cores = &matrix.cores()[first..=last];
    let (mut rows, mut columns) = (matrix.rows[first], matrix.columns[first]);
    let left = cores[0].left();
    // merged(alpha, i, j, beta) with i, j the merged digits.
    let mut merged = cores[0].data().to_vec();
    let mut rank = cores[0].right();
    for (core, k) in cores.iter().zip(first..).skip(1) {
        let (m, n) = (matrix.rows[k], matrix.columns[k]);
        let height = left * rows * columns;
        let width = m * n * core.right();
        let mut full = vec![0.0; height * width];
        multiply(
            1.0,
            View::new(&merged, height, rank),
            core.right_unfolding(),
            ViewMut::new(&mut full, height, width),
        );
        // full(alpha, i, j, i_k, j_k, beta) to (alpha, (i, i_k), (j, j_k), beta).
        let mut sorted = Vec::with_capacity(full.len());
        for beta in 0..core.right() {
            for jk in 0..n {
                for j in 0..columns {
                    for ik in 0..m {
                        let at = left * rows * (j + columns * (ik + m * (jk + n * beta)));
                        sorted.extend_from_slice(&full[at..at + left * rows]);
                    }
                }
            }
        }
        merged = sorted;
        rows *= m;
        columns *= n;
        rank = core.right();
    }
    let entry = |alpha: usize, i: usize, j: usize, beta: usize| {
        merged[alpha + left * (i + rows * (j + columns * beta))]
    };
    let matrix = if transposed {
        Matrix::from_fn(rows * rank, columns, |c, j| entry(0, c % rows, j, c / rows))
    } else {
        Matrix::from_fn(left * columns, rows * rank, |r, c| entry(r % left, c % rows, r / left, c / rows))
    };
    Step { left, rows, columns, right: rank, matrix }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Merged cores of 52 MB, read again for every chunk, made products at rank 100 three times and at rank
    /// 50 four times as slow.
    #[test]
    fn merged_cores_stay_in_cache() {
        for rank in [2, 10, 50, 100] {
            let a = TtMatrix::random(&[2; 16], &[2; 16], rank, 1).unwrap();
            let operator = FullOperator::new(&a).unwrap();
            for step in &operator.steps {
                let merged = step.rows > 2;
                assert!(
                    !merged || (step.matrix.data().len() as f64) < 2.0 * LARGEST_CACHED_CORE,
                    "{rank}: {}",
                    step.matrix.data().len()
                );
            }
        }
    }
}
