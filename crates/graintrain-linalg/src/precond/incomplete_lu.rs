//! ILU(0) by blocks: L and U have the pattern of the matrix, L with unit diagonal blocks.

use super::incomplete_cholesky::{FIRST_SHIFT, SHIFT_DOUBLINGS};
use super::{Preconditioner, PreconditionerError};
use crate::block_ops::{apply3, invert3, invert3_general, multiply3};
use crate::block3::{Block, BlockMatrix3};

/// Incomplete block LU factors with no fill (Meijerink and van der Vorst 1977; Saad 2003, section 10.3).
#[derive(Clone, Debug, Default)]
pub struct IncompleteLu {
    /// L below the diagonal, U above it.
    factors: Option<BlockMatrix3>,
    /// Inverses of the diagonal blocks of U.
    inverse_diagonal: Vec<Block>,
    /// Position of the diagonal in each row, counted from the start of the row.
    diagonal: Vec<usize>,
    /// Whether pivot blocks have to be positive definite.
    definite: bool,
    /// Fraction by which the diagonal blocks were enlarged.
    shift: f64,
}

impl IncompleteLu {
    /// For symmetric positive definite matrices: where a pivot block is not positive definite (the
    /// preconditioner would be indefinite, and Krylov methods stagnate) the diagonal blocks are enlarged as
    /// for [`IncompleteCholesky`](super::IncompleteCholesky).
    pub fn definite() -> Self {
        Self { definite: true, ..Self::default() }
    }

    /// The row of the first pivot block that cannot be used, if there is one.
    fn factorize(&mut self, matrix: &BlockMatrix3) -> Result<(), usize> {
        let Self { factors: Some(factors), inverse_diagonal, diagonal, definite, shift } = self else {
            return Ok(());
        };
        factors.blocks_mut().copy_from_slice(matrix.blocks());
        // Position of column j in the current row, counted from 1; 0 where it is not stored.
        let mut position = vec![0_usize; diagonal.len()];
        for i in 0..diagonal.len() {
            let start = matrix.row_starts()[i];
            let end = matrix.row_starts()[i + 1];
            for k in start..end {
                position[matrix.columns()[k] as usize] = k + 1;
            }
            for x in &mut factors.blocks_mut()[start + diagonal[i]] {
                *x *= 1.0 + *shift;
            }
            for k in start..start + diagonal[i] {
                let j = matrix.columns()[k] as usize;
                let multiplier = multiply3(&factors.blocks()[k], &inverse_diagonal[j]);
                factors.blocks_mut()[k] = multiplier;
                for upper in matrix.row_starts()[j] + diagonal[j] + 1..matrix.row_starts()[j + 1] {
                    let target = position[matrix.columns()[upper] as usize];
                    if target > 0 {
                        let product = multiply3(&multiplier, &factors.blocks()[upper]);
                        let block = &mut factors.blocks_mut()[target - 1];
                        for (x, p) in block.iter_mut().zip(&product) {
                            *x -= p;
                        }
                    }
                }
            }
            let pivot = &factors.blocks()[start + diagonal[i]];
            let inverse = if *definite { invert3(pivot) } else { invert3_general(pivot) };
            inverse_diagonal[i] = inverse.ok_or(i)?;
            for k in start..end {
                position[matrix.columns()[k] as usize] = 0;
            }
        }
        Ok(())
    }
}

impl Preconditioner for IncompleteLu {
    fn refresh(&mut self, matrix: &BlockMatrix3) -> Result<(), PreconditionerError> {
        let rows = matrix.num_rows();
        let same = self.factors.as_ref().is_some_and(|factors| {
            factors.row_starts() == matrix.row_starts() && factors.columns() == matrix.columns()
        });
        if !same {
            self.factors = Some(matrix.clone());
            self.diagonal.clear();
            for row in 0..rows {
                let at = matrix.position(row, row).ok_or(PreconditionerError::MissingDiagonal { row })?;
                self.diagonal.push(at - matrix.row_starts()[row]);
            }
            self.inverse_diagonal = vec![[0.0; 9]; rows];
        }
        self.shift = 0.0;
        let mut broken = self.factorize(matrix);
        for doubling in 0..=SHIFT_DOUBLINGS {
            if broken.is_ok() || !self.definite {
                break;
            }
            self.shift = FIRST_SHIFT * f64::from(1 << doubling);
            broken = self.factorize(matrix);
        }
        broken.map_err(|row| PreconditionerError::Pivot { row })
    }

    fn apply(&self, r: &[f64], z: &mut [f64]) {
        let Some(factors) = &self.factors else {
            z.copy_from_slice(r);
            return;
        };
        let rows = factors.num_rows();
        for i in 0..rows {
            let (columns, blocks) = factors.row(i);
            let mut sum = [r[3 * i], r[3 * i + 1], r[3 * i + 2]];
            subtract(&mut sum, &columns[..self.diagonal[i]], &blocks[..self.diagonal[i]], z);
            z[3 * i..3 * i + 3].copy_from_slice(&sum);
        }
        for i in (0..rows).rev() {
            let (columns, blocks) = factors.row(i);
            let mut sum = [z[3 * i], z[3 * i + 1], z[3 * i + 2]];
            let above = self.diagonal[i] + 1;
            subtract(&mut sum, &columns[above..], &blocks[above..], z);
            z[3 * i..3 * i + 3].copy_from_slice(&apply3(&self.inverse_diagonal[i], sum));
        }
    }
}

/// sum -= sum_k block_k z_(column k).
#[inline]
fn subtract(sum: &mut [f64; 3], columns: &[u32], blocks: &[Block], z: &[f64]) {
    for (&j, block) in columns.iter().zip(blocks) {
        let j = 3 * j as usize;
        let product = apply3(block, [z[j], z[j + 1], z[j + 2]]);
        for k in 0..3 {
            sum[k] -= product[k];
        }
    }
}
