//! IC(0) by blocks: A ~ (L + D) D^-1 (L + D)^T with L of the pattern of the strictly lower triangle.

use super::{Preconditioner, PreconditionerError};
use crate::block_ops::{apply3, invert3, multiply3, multiply3_transposed};
use crate::block3::{Block, BlockMatrix3};

/// Incomplete block Cholesky factor with no fill (Meijerink and van der Vorst 1977).
///
/// Where a pivot block is not positive definite the factorisation starts again with the diagonal blocks enlarged by a
/// growing fraction of themselves (Manteuffel 1980), so that the preconditioner is positive definite always.
#[derive(Clone, Debug, Default)]
pub struct IncompleteCholesky {
    row_start: Vec<usize>,
    column: Vec<u32>,
    /// L, strictly lower, by rows: A_ij - sum_k L_ik D_k^-1 L_jk^T.
    lower: Vec<Block>,
    /// Where each lower block lies in the matrix.
    source: Vec<usize>,
    /// Where each diagonal block lies in the matrix.
    diagonal: Vec<usize>,
    inverse_diagonal: Vec<Block>,
    /// Fraction by which the diagonal blocks were enlarged.
    shift: f64,
}

/// First enlargement of the diagonal blocks tried after a breakdown.
pub(super) const FIRST_SHIFT: f64 = 1e-3;
/// How often it is doubled at most.
pub(super) const SHIFT_DOUBLINGS: u32 = 10;

impl IncompleteCholesky {
    /// Fraction by which the diagonal blocks had to be enlarged in the last refresh.
    pub fn shift(&self) -> f64 {
        self.shift
    }

    fn adopt_pattern(&mut self, matrix: &BlockMatrix3) -> Result<(), PreconditionerError> {
        *self = Self { row_start: vec![0], ..Self::default() };
        for row in 0..matrix.num_rows() {
            let start = matrix.row_starts()[row];
            let at = matrix.position(row, row).ok_or(PreconditionerError::MissingDiagonal { row })?;
            self.diagonal.push(at);
            self.column.extend_from_slice(&matrix.columns()[start..at]);
            self.source.extend(start..at);
            self.row_start.push(self.column.len());
        }
        self.lower = vec![[0.0; 9]; self.column.len()];
        self.inverse_diagonal = vec![[0.0; 9]; matrix.num_rows()];
        Ok(())
    }

    fn fits(&self, matrix: &BlockMatrix3) -> bool {
        self.diagonal.len() == matrix.num_rows()
            && self.source.len() + self.diagonal.len() + self.source.len() == matrix.num_blocks()
            && self.source.iter().zip(&self.column).all(|(&k, &j)| matrix.columns()[k] == j)
            && (0..matrix.num_rows()).all(|i| matrix.position(i, i) == Some(self.diagonal[i]))
    }

    /// The row of the first pivot block that is not positive definite, if there is one.
    fn factorize(&mut self, matrix: &BlockMatrix3) -> Result<(), usize> {
        // Position of column k in the lower part of row i, counted from 1; 0 where it is not stored.
        let mut position = vec![0_usize; self.diagonal.len()];
        for i in 0..self.diagonal.len() {
            let range = self.row_start[i]..self.row_start[i + 1];
            for k in range.clone() {
                position[self.column[k] as usize] = k + 1;
            }
            let mut pivot = matrix.blocks()[self.diagonal[i]].map(|x| x * (1.0 + self.shift));
            for k in range.clone() {
                let j = self.column[k] as usize;
                let mut block = matrix.blocks()[self.source[k]];
                for other in self.row_start[j]..self.row_start[j + 1] {
                    let column = self.column[other] as usize;
                    let at = position[column];
                    if at > 0 {
                        let scaled = multiply3(&self.lower[at - 1], &self.inverse_diagonal[column]);
                        let product = multiply3_transposed(&scaled, &self.lower[other]);
                        for (x, p) in block.iter_mut().zip(&product) {
                            *x -= p;
                        }
                    }
                }
                self.lower[k] = block;
                let product = multiply3_transposed(&multiply3(&block, &self.inverse_diagonal[j]), &block);
                for (x, p) in pivot.iter_mut().zip(&product) {
                    *x -= p;
                }
            }
            self.inverse_diagonal[i] = invert3(&pivot).ok_or(i)?;
            for k in range {
                position[self.column[k] as usize] = 0;
            }
        }
        Ok(())
    }
}

impl Preconditioner for IncompleteCholesky {
    fn refresh(&mut self, matrix: &BlockMatrix3) -> Result<(), PreconditionerError> {
        if !self.fits(matrix) {
            self.adopt_pattern(matrix)?;
        }
        self.shift = 0.0;
        let mut broken = self.factorize(matrix);
        for doubling in 0..=SHIFT_DOUBLINGS {
            if broken.is_ok() {
                break;
            }
            self.shift = FIRST_SHIFT * f64::from(1 << doubling);
            broken = self.factorize(matrix);
        }
        broken.map_err(|row| PreconditionerError::Pivot { row })
    }

    fn apply(&self, r: &[f64], z: &mut [f64]) {
        // z holds D^-1 (L + D)^-1 r of the rows above.
        for i in 0..self.diagonal.len() {
            let mut sum = [r[3 * i], r[3 * i + 1], r[3 * i + 2]];
            for k in self.row_start[i]..self.row_start[i + 1] {
                let j = 3 * self.column[k] as usize;
                let product = apply3(&self.lower[k], [z[j], z[j + 1], z[j + 2]]);
                for a in 0..3 {
                    sum[a] -= product[a];
                }
            }
            z[3 * i..3 * i + 3].copy_from_slice(&apply3(&self.inverse_diagonal[i], sum));
        }
        for i in (0..self.diagonal.len()).rev() {
            let zi = [z[3 * i], z[3 * i + 1], z[3 * i + 2]];
            for k in self.row_start[i]..self.row_start[i + 1] {
                let (j, block) = (self.column[k] as usize, &self.lower[k]);
                let transposed: [f64; 3] =
                    std::array::from_fn(|c| block[c] * zi[0] + block[3 + c] * zi[1] + block[6 + c] * zi[2]);
                let product = apply3(&self.inverse_diagonal[j], transposed);
                for a in 0..3 {
                    z[3 * j + a] -= product[a];
                }
            }
        }
    }
}
