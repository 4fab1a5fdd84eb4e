//! ILU(0) by blocks: L and U have the pattern of the matrix, L with unit diagonal blocks.

use super::{Preconditioner, PreconditionerError};
use crate::block_ops::{apply3, invert3_general, multiply3};
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
}

impl Preconditioner for IncompleteLu {
    fn refresh(&mut self, matrix: &BlockMatrix3) -> Result<(), PreconditionerError> {
        let rows = matrix.num_rows();
        let same = self.factors.as_ref().is_some_and(|factors| {
            factors.row_starts() == matrix.row_starts() && factors.columns() == matrix.columns()
        });
        if same {
            if let Some(factors) = &mut self.factors {
                factors.blocks_mut().copy_from_slice(matrix.blocks());
            }
        } else {
            self.factors = Some(matrix.clone());
            self.diagonal.clear();
            for row in 0..rows {
                let at = matrix.position(row, row).ok_or(PreconditionerError::MissingDiagonal { row })?;
                self.diagonal.push(at - matrix.row_starts()[row]);
            }
            self.inverse_diagonal = vec![[0.0; 9]; rows];
        }
        let Some(factors) = &mut self.factors else { return Ok(()) };
        // Position of column j in the current row, counted from 1; 0 where it is not stored.
        let mut position = vec![0_usize; rows];
        for i in 0..rows {
            let start = matrix.row_starts()[i];
            let end = matrix.row_starts()[i + 1];
            for k in start..end {
                position[matrix.columns()[k] as usize] = k + 1;
            }
            for k in start..start + self.diagonal[i] {
                let j = matrix.columns()[k] as usize;
                let multiplier = multiply3(&factors.blocks()[k], &self.inverse_diagonal[j]);
                factors.blocks_mut()[k] = multiplier;
                for upper in matrix.row_starts()[j] + self.diagonal[j] + 1..matrix.row_starts()[j + 1] {
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
            self.inverse_diagonal[i] = invert3_general(&factors.blocks()[start + self.diagonal[i]])
                .ok_or(PreconditionerError::Pivot { row: i })?;
            for k in start..end {
                position[matrix.columns()[k] as usize] = 0;
            }
        }
        Ok(())
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
