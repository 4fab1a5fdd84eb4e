//! Block Jacobi: the inverse of every diagonal block.

use super::{Preconditioner, PreconditionerError};
use crate::block_ops::{factor_in_place, solve_in_place};
use crate::block3::BlockMatrix3;

/// Inverse diagonal blocks, kept as Cholesky factors; for any block size.
#[derive(Clone, Debug)]
pub struct BlockJacobi {
    block_size: usize,
    factors: Vec<f64>,
}

impl BlockJacobi {
    /// For matrices of `block_size` x `block_size` blocks.
    pub fn new(block_size: usize) -> Self {
        Self { block_size, factors: Vec::new() }
    }

    /// Factorises the given diagonal blocks, row-major, one after the other.
    ///
    /// # Errors
    /// [`PreconditionerError::Pivot`] for a block that is not positive definite.
    pub fn refresh_blocks<'a>(
        &mut self,
        blocks: impl Iterator<Item = &'a [f64]>,
    ) -> Result<(), PreconditionerError> {
        let entries = self.block_size * self.block_size;
        self.factors.clear();
        for (row, block) in blocks.enumerate() {
            self.factors.extend_from_slice(block);
            let factor = &mut self.factors[row * entries..];
            if !factor_in_place(factor, self.block_size) {
                return Err(PreconditionerError::Pivot { row });
            }
        }
        Ok(())
    }
}

impl Preconditioner for BlockJacobi {
    fn refresh(&mut self, matrix: &BlockMatrix3) -> Result<(), PreconditionerError> {
        for row in 0..matrix.num_rows() {
            if matrix.position(row, row).is_none() {
                return Err(PreconditionerError::MissingDiagonal { row });
            }
        }
        let diagonal = (0..matrix.num_rows()).filter_map(|i| matrix.position(i, i));
        self.refresh_blocks(diagonal.map(|k| matrix.blocks()[k].as_slice()))
    }

    fn apply(&self, r: &[f64], z: &mut [f64]) {
        let b = self.block_size;
        z.copy_from_slice(r);
        for (z, factor) in z.chunks_exact_mut(b).zip(self.factors.chunks_exact(b * b)) {
            solve_in_place(factor, b, z);
        }
    }
}
