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

/// Why arrays are not a matrix in compressed block rows.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PatternError {
    /// The row starts do not lead through the list of blocks.
    #[error("the {starts} row starts must ascend from 0 to the number of blocks, {blocks}")]
    RowStarts {
        /// How many row starts there are: one more than block rows.
        starts: usize,
        /// How many blocks.
        blocks: usize,
    },
    /// The lists of columns and of blocks differ in length.
    #[error("there are {columns} column indices for {blocks} blocks")]
    Lengths {
        /// How many column indices.
        columns: usize,
        /// How many blocks.
        blocks: usize,
    },
    /// A column index beyond the matrix, or not above the one before in its row.
    #[error(
        "block row {row} has column {column}: columns must ascend strictly and be below the number of rows, {rows}"
    )]
    Column {
        /// The block row.
        row: usize,
        /// The block column.
        column: u32,
        /// Number of block rows.
        rows: usize,
    },
}

impl BlockMatrix3 {
    /// From compressed block rows: `column[row_start[i]..row_start[i + 1]]` are the block columns of row i,
    /// with rows + 1 row starts.
    ///
    /// ```
    /// use graintrain_linalg::block3::BlockMatrix3;
    /// let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    /// let matrix = BlockMatrix3::try_from_rows(vec![0, 1, 2], vec![0, 1], vec![identity; 2])?;
    /// assert_eq!(matrix.num_rows(), 2);
    /// assert!(BlockMatrix3::try_from_rows(vec![0, 1], vec![7], vec![identity]).is_err());
    /// # Ok::<(), graintrain_linalg::block3::PatternError>(())
    /// ```
    ///
    /// # Errors
    /// [`PatternError`] where the row starts do not ascend from 0 to the number of blocks, or the columns of
    /// a row do not strictly ascend below the number of rows.
    pub fn try_from_rows(
        row_start: Vec<usize>,
        column: Vec<u32>,
        block: Vec<Block>,
    ) -> Result<Self, PatternError> {
        let blocks = block.len();
        if column.len() != blocks {
            return Err(PatternError::Lengths { columns: column.len(), blocks });
        }
        let ends = row_start.first() == Some(&0) && row_start.last() == Some(&blocks);
        if !ends || row_start.windows(2).any(|row| row[0] > row[1]) {
            return Err(PatternError::RowStarts { starts: row_start.len(), blocks });
        }
        let rows = row_start.len() - 1;
        for (row, range) in row_start.windows(2).enumerate() {
            let mut last = None;
            for &c in &column[range[0]..range[1]] {
                if last.is_some_and(|last| last >= c) || c as usize >= rows {
                    return Err(PatternError::Column { row, column: c, rows });
                }
                last = Some(c);
            }
        }
        Ok(Self { row_start, column, block })
    }

    /// As [`Self::try_from_rows`] for arrays that are right by construction.
    ///
    /// # Panics
    /// Where they are not.
    #[track_caller]
    pub fn from_rows(row_start: Vec<usize>, column: Vec<u32>, block: Vec<Block>) -> Self {
        match Self::try_from_rows(row_start, column, block) {
            Ok(matrix) => matrix,
            Err(error) => panic!("{error}"),
        }
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

    /// All blocks with their block rows and columns, row by row.
    pub fn iter(&self) -> impl Iterator<Item = (usize, usize, Block)> + '_ {
        (0..self.num_rows()).flat_map(|i| {
            let (columns, blocks) = self.row(i);
            columns.iter().zip(blocks).map(move |(&j, block)| (i, j as usize, *block))
        })
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Whatever the arrays are, they are a matrix or an error, and a matrix can be used.
        #[test]
        fn arrays_are_a_matrix_or_an_error(
            starts in prop::collection::vec(0..6_usize, 0..5),
            columns in prop::collection::vec(0..5_u32, 0..6),
        ) {
            let blocks = vec![[1.0; 9]; columns.len()];
            if let Ok(matrix) = BlockMatrix3::try_from_rows(starts, columns, blocks) {
                let x = vec![1.0; 3 * matrix.num_rows()];
                let mut y = x.clone();
                matrix.multiply(&x, &mut y);
                prop_assert_eq!(y.iter().sum::<f64>(), 9.0 * matrix.num_blocks() as f64);
            }
        }
    }
}
