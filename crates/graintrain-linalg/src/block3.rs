//! Sparse matrices of dense 3x3 blocks in compressed row form: one block row per contact.

use crate::parallel::CHUNK;
use rayon::prelude::*;

/// A 3x3 block, row-major: entry (a, b) at `3 * a + b`.
pub type Block = [f64; 9];

/// Square sparse matrix of 3x3 blocks, all blocks stored (both triangles), columns ascending in each row.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockMatrix3 {
    row_start: Vec<usize>,
    column: Vec<u32>,
    block: Vec<Block>,
}

impl BlockMatrix3 {
    /// From compressed block rows: `column[row_start[i]..row_start[i + 1]]` are the block columns of row i.
    ///
    /// # Panics
    /// If the row starts do not ascend from 0 to the number of blocks, or the columns of a row do not strictly ascend.
    pub fn from_rows(row_start: Vec<usize>, column: Vec<u32>, block: Vec<Block>) -> Self {
        assert_eq!(row_start.first(), Some(&0), "row starts begin at 0");
        assert_eq!(row_start.last(), Some(&column.len()), "row starts end at the number of blocks");
        assert_eq!(column.len(), block.len(), "one column index per block");
        let rows = row_start.len() - 1;
        for row in row_start.windows(2) {
            let columns = &column[row[0]..row[1]];
            assert!(columns.windows(2).all(|pair| pair[0] < pair[1]), "columns of a row ascend");
            assert!(columns.iter().all(|&c| (c as usize) < rows), "columns are below the number of rows");
        }
        Self { row_start, column, block }
    }

    /// Number of block rows.
    pub fn num_rows(&self) -> usize {
        self.row_start.len() - 1
    }

    /// Number of stored blocks.
    pub fn num_blocks(&self) -> usize {
        self.block.len()
    }

    /// Block columns and blocks of block row i.
    pub fn row(&self, i: usize) -> (&[u32], &[Block]) {
        let range = self.row_start[i]..self.row_start[i + 1];
        (&self.column[range.clone()], &self.block[range])
    }

    /// Start of each block row in the list of blocks (length rows + 1).
    pub fn row_starts(&self) -> &[usize] {
        &self.row_start
    }

    /// All block columns, row by row.
    pub fn columns(&self) -> &[u32] {
        &self.column
    }

    /// All blocks, row by row.
    pub fn blocks(&self) -> &[Block] {
        &self.block
    }

    /// All blocks for updating in place; the pattern stays.
    pub fn blocks_mut(&mut self) -> &mut [Block] {
        &mut self.block
    }

    /// Position of block (i, j) in the list of blocks, if it is stored.
    pub fn position(&self, i: usize, j: usize) -> Option<usize> {
        let (columns, _) = self.row(i);
        columns.binary_search(&(j as u32)).ok().map(|k| self.row_start[i] + k)
    }

    /// Block (i, j), zero where it is not stored.
    pub fn get(&self, i: usize, j: usize) -> Block {
        self.position(i, j).map_or([0.0; 9], |k| self.block[k])
    }

    /// y <- A x, both of length 3 rows. Threads share the rows; the bits do not depend on their number.
    pub fn multiply(&self, x: &[f64], y: &mut [f64]) {
        assert_eq!(x.len(), 3 * self.num_rows());
        assert_eq!(y.len(), x.len());
        y.par_chunks_mut(3 * CHUNK).enumerate().for_each(|(chunk, y)| {
            for (offset, y) in y.chunks_exact_mut(3).enumerate() {
                y.copy_from_slice(&self.row_times(chunk * CHUNK + offset, x));
            }
        });
    }

    /// The three entries of A x in block row i.
    #[inline]
    pub fn row_times(&self, i: usize, x: &[f64]) -> [f64; 3] {
        let (columns, blocks) = self.row(i);
        let mut sum = [0.0; 3];
        for (&j, b) in columns.iter().zip(blocks) {
            let x = &x[3 * j as usize..3 * j as usize + 3];
            sum[0] += b[0] * x[0] + b[1] * x[1] + b[2] * x[2];
            sum[1] += b[3] * x[0] + b[4] * x[1] + b[5] * x[2];
            sum[2] += b[6] * x[0] + b[7] * x[1] + b[8] * x[2];
        }
        sum
    }

    /// max |A - A^T| / max |A| over all entries: 0 for a symmetric matrix.
    pub fn asymmetry(&self) -> f64 {
        let (mut difference, mut largest) = (0.0_f64, 0.0_f64);
        for i in 0..self.num_rows() {
            let (columns, blocks) = self.row(i);
            for (&j, b) in columns.iter().zip(blocks) {
                let t = self.get(j as usize, i);
                for a in 0..3 {
                    for c in 0..3 {
                        difference = difference.max((b[3 * a + c] - t[3 * c + a]).abs());
                        largest = largest.max(b[3 * a + c].abs());
                    }
                }
            }
        }
        if largest > 0.0 { difference / largest } else { 0.0 }
    }
}
