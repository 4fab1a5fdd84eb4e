//! IC(0) by blocks: A ~ C C^T, C of the pattern of the lower triangle, kept in single precision.

use super::{Preconditioner, PreconditionerError};
use crate::block_ops::{factor_in_place, invert_lower};
use crate::block3::{Block, BlockMatrix3};
use crate::vectorised::{Work, run_wide};

/// Incomplete block Cholesky factor with no fill (Meijerink and van der Vorst 1977) of a symmetric positive
/// definite matrix of B x B blocks with SQUARE = B^2 entries; B is 3 (contacts) or 6 (bodies).
///
/// With the Cholesky factors D_i of its pivot blocks C = D (I + L), and
///
/// ```text
/// y_i = D_i^-1 r_i - sum_(j < i) L_ij y_j,    w_i = y_i - sum_(j > i) L_ji^T w_j,    z_i = D_i^-T w_i.
/// ```
///
/// Both sweeps read blocks in the order in which they lie in memory and add up what a row receives, so L is
/// kept by rows and by columns. It is kept in single precision: any finite L makes a symmetric positive
/// definite preconditioner, and an application is bound by the memory that it reads. Factorisation and sweeps
/// compute in double precision.
///
/// Where a pivot block is not positive definite, or L too large for single precision, the factorisation
/// starts again with the diagonal blocks enlarged by a growing fraction of themselves (Manteuffel 1980).
#[derive(Clone, Debug, Default)]
pub struct IncompleteCholesky<const B: usize, const SQUARE: usize> {
    pattern: LowerPattern,
    /// C, strictly lower, by rows: work memory of the factorisation.
    lower: Vec<[f64; SQUARE]>,
    /// D_i^-1, lower triangular.
    inverse_pivots: Vec<[f64; SQUARE]>,
    /// Position of column k in the row at hand, counted from 1; 0 where it is not stored. Work memory as
    /// well.
    position: Vec<usize>,
    /// L by rows: blocks column-major, and [`PADDING`].
    by_rows: Vec<f32>,
    /// L^T by rows: blocks (j, i) column-major.
    by_columns: Vec<f32>,
    /// Fraction by which the diagonal blocks were enlarged.
    shift: f64,
}

/// First enlargement of the diagonal blocks tried after a breakdown.
pub(super) const FIRST_SHIFT: f64 = 1e-3;
/// How often it is doubled at most.
pub(super) const SHIFT_DOUBLINGS: u32 = 10;

/// Pattern of a strictly lower block triangle, by rows and by columns.
#[derive(Clone, Debug, Default)]
struct LowerPattern {
    row_start: Vec<usize>,
    column: Vec<u32>,
    column_start: Vec<usize>,
    /// Rows of the blocks of each column, ascending.
    row: Vec<u32>,
    /// Where the blocks of each row lie in the list by columns.
    place: Vec<u32>,
}

impl LowerPattern {
    fn new(row_start: Vec<usize>, column: Vec<u32>) -> Self {
        let rows = row_start.len() - 1;
        let mut column_start = vec![0; rows + 1];
        for &j in &column {
            column_start[j as usize + 1] += 1;
        }
        for j in 0..rows {
            column_start[j + 1] += column_start[j];
        }
        let mut next = column_start.clone();
        let (mut row, mut place) = (vec![0; column.len()], vec![0; column.len()]);
        for i in 0..rows {
            for k in row_start[i]..row_start[i + 1] {
                let at = &mut next[column[k] as usize];
                (row[*at], place[k]) = (i as u32, *at as u32);
                *at += 1;
            }
        }
        Self { row_start, column, column_start, row, place }
    }

    fn num_rows(&self) -> usize {
        self.row_start.len().saturating_sub(1)
    }
}

impl<const B: usize, const SQUARE: usize> IncompleteCholesky<B, SQUARE> {
    /// Fraction by which the diagonal blocks had to be enlarged in the last refresh.
    pub fn shift(&self) -> f64 {
        self.shift
    }

    /// Blocks below the diagonal.
    pub fn num_lower_blocks(&self) -> usize {
        self.pattern.column.len()
    }

    /// Adapts to new values of a matrix of which `lower(i)` gives the columns and blocks of row i up to the
    /// diagonal one, columns ascending, the diagonal block last. Blocks are row-major.
    ///
    /// # Errors
    /// [`PreconditionerError`]; the preconditioner is then unusable until the next success.
    ///
    /// # Panics
    /// If the columns of a row do not ascend.
    pub fn refresh_lower<'a>(
        &mut self,
        rows: usize,
        lower: impl Fn(usize) -> (&'a [u32], &'a [[f64; SQUARE]]),
    ) -> Result<(), PreconditionerError> {
        const { assert!((B == 3 || B == 6) && SQUARE == B * B, "blocks of contacts or of bodies") }
        for row in 0..rows {
            let columns = lower(row).0;
            if columns.last() != Some(&(row as u32)) {
                return Err(PreconditionerError::MissingDiagonal { row });
            }
            assert!(columns.is_sorted_by(|a, b| a < b), "the columns of row {row} ascend");
        }
        let fits = self.pattern.num_rows() == rows
            && (0..rows).all(|i| {
                let (start, end) = (self.pattern.row_start[i], self.pattern.row_start[i + 1]);
                let columns = lower(i).0;
                self.pattern.column[start..end] == columns[..columns.len() - 1]
            });
        if !fits {
            let (mut row_start, mut column) = (vec![0], Vec::new());
            for i in 0..rows {
                let columns = lower(i).0;
                column.extend_from_slice(&columns[..columns.len() - 1]);
                row_start.push(column.len());
            }
            self.pattern = LowerPattern::new(row_start, column);
        }
        self.shift = 0.0;
        let mut broken = self.factorize(rows, &lower).and_then(|()| self.store());
        for doubling in 0..=SHIFT_DOUBLINGS {
            if broken.is_ok() {
                break;
            }
            self.shift = FIRST_SHIFT * f64::from(1 << doubling);
            broken = self.factorize(rows, &lower).and_then(|()| self.store());
        }
        broken.map_err(|row| PreconditionerError::Pivot { row })
    }

    /// C and D^-1. The row of the first pivot block that is not positive definite, if there is one.
    fn factorize<'a>(
        &mut self,
        rows: usize,
        matrix: &impl Fn(usize) -> (&'a [u32], &'a [[f64; SQUARE]]),
    ) -> Result<(), usize> {
        let Self { pattern, lower, inverse_pivots, position, shift, .. } = self;
        lower.clear();
        inverse_pivots.clear();
        position.clear();
        position.resize(rows, 0);
        for i in 0..rows {
            let range = pattern.row_start[i]..pattern.row_start[i + 1];
            let (columns, blocks) = matrix(i);
            for (k, &column) in range.clone().zip(columns) {
                position[column as usize] = k + 1;
            }
            let mut pivot = blocks[blocks.len() - 1].map(|x| x * (1.0 + *shift));
            for (&j, &block) in columns.iter().zip(&blocks[..blocks.len() - 1]) {
                let j = j as usize;
                let mut block = block;
                for other in pattern.row_start[j]..pattern.row_start[j + 1] {
                    let at = position[pattern.column[other] as usize];
                    // Entries of row i beyond column j are not there yet, and row j has none.
                    if at > 0 {
                        subtract_product::<B, SQUARE>(&mut block, &lower[at - 1], &lower[other]);
                    }
                }
                // C_ij D_j^T = block.
                let block = times_transposed::<B, SQUARE>(&block, &inverse_pivots[j]);
                subtract_product::<B, SQUARE>(&mut pivot, &block, &block);
                lower.push(block);
            }
            if !factor_in_place(&mut pivot, B) {
                return Err(i);
            }
            inverse_pivots.push(invert_lower::<B, SQUARE>(&pivot));
            for k in range {
                position[pattern.column[k] as usize] = 0;
            }
        }
        Ok(())
    }

    /// L = D^-1 C in single precision, by rows and by columns. The first row with an entry that is too large,
    /// if there is one.
    fn store(&mut self) -> Result<(), usize> {
        let Self { pattern, lower, inverse_pivots, by_rows, by_columns, .. } = self;
        for list in [&mut *by_rows, &mut *by_columns] {
            list.resize(SQUARE * lower.len() + PADDING, 0.0);
        }
        for i in 0..pattern.num_rows() {
            for k in pattern.row_start[i]..pattern.row_start[i + 1] {
                let block = triangular_times::<B, SQUARE>(&inverse_pivots[i], &lower[k]);
                let place = pattern.place[k] as usize;
                let mut finite = true;
                for row in 0..B {
                    for column in 0..B {
                        let x = block[B * row + column] as f32;
                        finite &= x.is_finite();
                        by_rows[SQUARE * k + B * column + row] = x;
                        by_columns[SQUARE * place + B * row + column] = x;
                    }
                }
                if !finite {
                    return Err(i);
                }
            }
        }
        Ok(())
    }

    /// z <- C^-T C^-1 r.
    pub fn apply(&self, r: &[f64], z: &mut [f64]) {
        run_wide(Application { factor: self, r, z });
    }
}

/// One application, compiled for the widest vectors there are.
struct Application<'a, const B: usize, const SQUARE: usize> {
    factor: &'a IncompleteCholesky<B, SQUARE>,
    r: &'a [f64],
    z: &'a mut [f64],
}

impl<const B: usize, const SQUARE: usize> Work for Application<'_, B, SQUARE> {
    #[inline(always)]
    fn run(self) {
        if B <= 4 {
            self.sweeps::<4>();
        } else {
            self.sweeps::<8>();
        }
    }
}

impl<const B: usize, const SQUARE: usize> Application<'_, B, SQUARE> {
    #[inline(always)]
    fn sweeps<const LANES: usize>(self) {
        let Self { factor, r, z } = self;
        let pattern = &factor.pattern;
        for (i, inverse) in factor.inverse_pivots.iter().enumerate() {
            let range = pattern.row_start[i]..pattern.row_start[i + 1];
            let columns = &pattern.column[range.clone()];
            let received = received::<B, SQUARE, LANES>(columns, &factor.by_rows, range.start, z);
            let own = &r[B * i..B * i + B];
            for row in 0..B {
                let mut sum = 0.0;
                for column in 0..=row {
                    sum += inverse[B * row + column] * own[column];
                }
                z[B * i + row] = sum - received[row];
            }
        }
        for i in (0..factor.inverse_pivots.len()).rev() {
            let range = pattern.column_start[i]..pattern.column_start[i + 1];
            let rows = &pattern.row[range.clone()];
            let received = received::<B, SQUARE, LANES>(rows, &factor.by_columns, range.start, z);
            for row in 0..B {
                z[B * i + row] -= received[row];
            }
        }
        for (z, inverse) in z.chunks_exact_mut(B).zip(&factor.inverse_pivots) {
            for row in 0..B {
                let mut sum = 0.0;
                for column in row..B {
                    sum += inverse[B * column + row] * z[column];
                }
                z[row] = sum;
            }
        }
    }
}

/// Entries after the last block, which [`received`] reads and does not use.
const PADDING: usize = 2;

/// sum_k L_k x_(j_k) for the blocks from `first` on, column-major.
///
/// Columns are read with the entries that follow, so that they fill LANES; nobody looks at the sums of those.
/// Consecutive columns add to different sums, so that they do not wait for each other.
#[inline(always)]
fn received<const B: usize, const SQUARE: usize, const LANES: usize>(
    indices: &[u32],
    blocks: &[f32],
    first: usize,
    x: &[f64],
) -> [f64; LANES] {
    let mut sums = [[0.0_f64; LANES]; 3];
    let blocks = &blocks[SQUARE * first..];
    for (k, &j) in indices.iter().enumerate() {
        let x = &x[B * j as usize..B * j as usize + B];
        let block = &blocks[SQUARE * k..SQUARE * (k + 1) + LANES - B];
        let [a, b, c] = &mut sums;
        for (columns, x) in (0..B).step_by(3).zip(x.chunks_exact(3)) {
            for (offset, sum) in [&mut *a, &mut *b, &mut *c].into_iter().enumerate() {
                let start = B * (columns + offset);
                let entries: &[f32; LANES] = block[start..start + LANES].try_into().unwrap_or(&[0.0; LANES]);
                *sum = std::array::from_fn(|l| sum[l] + f64::from(entries[l]) * x[offset]);
            }
        }
    }
    std::array::from_fn(|row| sums[0][row] + sums[1][row] + sums[2][row])
}

/// a <- a - b c^T.
#[inline]
fn subtract_product<const B: usize, const SQUARE: usize>(
    a: &mut [f64; SQUARE],
    b: &[f64; SQUARE],
    c: &[f64; SQUARE],
) {
    for i in 0..B {
        for j in 0..B {
            let mut sum = 0.0;
            for k in 0..B {
                sum += b[B * i + k] * c[B * j + k];
            }
            a[B * i + j] -= sum;
        }
    }
}

/// a t^T with t lower triangular.
#[inline]
fn times_transposed<const B: usize, const SQUARE: usize>(
    a: &[f64; SQUARE],
    t: &[f64; SQUARE],
) -> [f64; SQUARE] {
    let mut product = [0.0; SQUARE];
    for i in 0..B {
        for j in 0..B {
            for k in 0..=j {
                product[B * i + j] += a[B * i + k] * t[B * j + k];
            }
        }
    }
    product
}

/// t a with t lower triangular.
#[inline]
fn triangular_times<const B: usize, const SQUARE: usize>(
    t: &[f64; SQUARE],
    a: &[f64; SQUARE],
) -> [f64; SQUARE] {
    let mut product = [0.0; SQUARE];
    for i in 0..B {
        for k in 0..=i {
            for j in 0..B {
                product[B * i + j] += t[B * i + k] * a[B * k + j];
            }
        }
    }
    product
}

impl Preconditioner for IncompleteCholesky<3, 9> {
    fn refresh(&mut self, matrix: &BlockMatrix3) -> Result<(), PreconditionerError> {
        let lower = |i: usize| -> (&[u32], &[Block]) {
            let (columns, blocks) = matrix.row(i);
            let end = columns.partition_point(|&j| j as usize <= i);
            (&columns[..end], &blocks[..end])
        };
        self.refresh_lower(matrix.num_rows(), lower)
    }

    fn apply(&self, r: &[f64], z: &mut [f64]) {
        Self::apply(self, r, z);
    }
}
