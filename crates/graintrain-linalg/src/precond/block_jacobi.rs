//! Block Jacobi: the inverse of every diagonal block.

use super::{Preconditioner, PreconditionerError};
use crate::block_ops::{factor_in_place, solve_in_place, solve_lower_in_place, solve_upper_in_place};
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

    /// r <- L^-1 r with the Cholesky factors L of the diagonal blocks.
    pub fn solve_lower(&self, r: &mut [f64]) {
        let b = self.block_size;
        for (r, factor) in r.chunks_exact_mut(b).zip(self.factors.chunks_exact(b * b)) {
            solve_lower_in_place(factor, b, r);
        }
    }

    /// r <- L^-T r.
    pub fn solve_upper(&self, r: &mut [f64]) {
        let b = self.block_size;
        for (r, factor) in r.chunks_exact_mut(b).zip(self.factors.chunks_exact(b * b)) {
            solve_upper_in_place(factor, b, r);
        }
    }

    /// A_ij <- L_i^-1 A_ij L_j^-T: block (i, j), row-major, of the symmetrically scaled matrix, whose
    /// diagonal blocks are identities.
    pub fn scale(&self, i: usize, j: usize, block: &mut [f64]) {
        let b = self.block_size;
        let factor = |row: usize| &self.factors[row * b * b..(row + 1) * b * b];
        for row in block.chunks_exact_mut(b) {
            // A row of A L^-T is L^-1 applied to the row of A.
            solve_lower_in_place(factor(j), b, row);
        }
        let left = factor(i);
        for column in 0..b {
            for row in 0..b {
                let sum: f64 = (0..row).map(|k| left[row * b + k] * block[k * b + column]).sum();
                block[row * b + column] = (block[row * b + column] - sum) / left[row * b + row];
            }
        }
    }

    /// L^-1 A L^-T by blocks of 3 into a matrix of the same pattern, for the diagonal blocks of the last
    /// refresh. O(blocks).
    ///
    /// # Panics
    /// If the patterns differ.
    pub fn scale_matrix(&self, matrix: &BlockMatrix3, scaled: &mut BlockMatrix3) {
        assert!(
            matrix.row_starts() == scaled.row_starts() && matrix.columns() == scaled.columns(),
            "the scaled matrix has the pattern of the matrix"
        );
        scaled.blocks_mut().copy_from_slice(matrix.blocks());
        for i in 0..matrix.num_rows() {
            for k in matrix.row_starts()[i]..matrix.row_starts()[i + 1] {
                self.scale(i, matrix.columns()[k] as usize, &mut scaled.blocks_mut()[k]);
            }
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A = [[P, C], [C^T, Q]] with 2x2 blocks: the scaled diagonal blocks are identities, and scaling then
    /// solving with both halves is the same as solving with the block.
    #[test]
    fn scaling_makes_identities_and_halves_make_the_whole() {
        let p = [4.0, 1.0, 1.0, 3.0];
        let q = [2.0, -0.5, -0.5, 1.0];
        let c = [0.3, -0.2, 0.7, 0.1];
        let mut jacobi = BlockJacobi::new(2);
        jacobi.refresh_blocks([p.as_slice(), q.as_slice()].into_iter()).unwrap();
        for (row, block) in [p, q].into_iter().enumerate() {
            let mut scaled = block;
            jacobi.scale(row, row, &mut scaled);
            for (value, expected) in scaled.iter().zip([1.0, 0.0, 0.0, 1.0]) {
                assert!((value - expected).abs() < 1e-14);
            }
        }
        // L_1 (scaled C) L_2^T = C, read column by column through the solves.
        let mut scaled = c;
        jacobi.scale(0, 1, &mut scaled);
        let r = [1.0, 2.0, 3.0, 4.0];
        let mut whole = [0.0; 4];
        jacobi.apply(&r, &mut whole);
        let mut halves = r;
        jacobi.solve_lower(&mut halves);
        jacobi.solve_upper(&mut halves);
        for (a, b) in whole.iter().zip(halves) {
            assert!((a - b).abs() < 1e-14);
        }
        // x^T L_1^-1 C L_2^-T y both ways.
        let (x, y) = ([0.4, -1.1], [2.0, 0.3]);
        let direct: f64 = (0..2).map(|i| x[i] * (scaled[2 * i] * y[0] + scaled[2 * i + 1] * y[1])).sum();
        let mut sides = [x[0], x[1], y[0], y[1]];
        jacobi.solve_upper(&mut sides);
        let by_sides: f64 = (0..2).map(|i| sides[i] * (c[2 * i] * sides[2] + c[2 * i + 1] * sides[3])).sum();
        assert!((direct - by_sides).abs() < 1e-14);
    }
}
