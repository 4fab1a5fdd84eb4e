//! The Newton matrix in contact space as a sparse matrix whose pattern is made once per problem.

use super::system::{Form, ScaledBlocks};
use crate::delassus::Delassus;
use crate::problem::Ccp;
use graintrain_linalg::block_ops::multiply3;
use graintrain_linalg::block3::{Block, BlockMatrix3};
use rayon::prelude::*;

/// S = N + H or S~ = I + F^T N F. The pattern is that of N, with every diagonal block.
#[derive(Clone, Debug)]
pub struct SchurComplement {
    form: Form,
    /// N.
    own: BlockMatrix3,
    matrix: BlockMatrix3,
    /// Block row of every block.
    row: Vec<u32>,
}

/// Blocks per parallel task.
const TASK: usize = 4096;

impl SchurComplement {
    /// The pattern of a problem. Off-diagonal blocks of a matrix read from a file may be asymmetric: S takes
    /// its symmetric part.
    pub fn new(problem: &Ccp, form: Form) -> Self {
        let mut own = with_diagonal(problem.delassus.assemble());
        if matches!(*problem.delassus, Delassus::Sparse(_)) && own.asymmetry() > 0.0 {
            own = symmetric_part(&own);
        }
        let row = own
            .row_starts()
            .windows(2)
            .enumerate()
            .flat_map(|(row, range)| std::iter::repeat_n(row as u32, range[1] - range[0]))
            .collect();
        Self { form, matrix: own.clone(), own, row }
    }

    /// New values for the blocks H, in place.
    pub fn update(&mut self, blocks: ScaledBlocks<'_>) {
        let Self { form, own, matrix, row } = self;
        let (columns, own) = (own.columns(), own.blocks());
        matrix.blocks_mut().par_iter_mut().with_min_len(TASK).enumerate().for_each(|(k, s)| {
            let (i, j) = (row[k] as usize, columns[k] as usize);
            match form {
                Form::Plain => {
                    if i == j {
                        *s = std::array::from_fn(|e| own[k][e] + blocks.added[i][e]);
                    }
                }
                Form::Scaled => {
                    *s = multiply3(&transpose(&blocks.factor[i]), &multiply3(&own[k], &blocks.factor[j]));
                    if i == j {
                        // Rounding must not make S~ asymmetric.
                        for (a, b) in [(1, 3), (2, 6), (5, 7)] {
                            (s[a], s[b]) = (0.5 * (s[a] + s[b]), 0.5 * (s[a] + s[b]));
                        }
                        for d in 0..3 {
                            s[4 * d] += 1.0;
                        }
                    }
                }
            }
        });
    }

    /// The matrix.
    pub fn matrix(&self) -> &BlockMatrix3 {
        &self.matrix
    }
}

fn transpose(a: &Block) -> Block {
    std::array::from_fn(|e| a[3 * (e % 3) + e / 3])
}

/// The same matrix with every diagonal block stored (zero where it was not).
fn with_diagonal(matrix: BlockMatrix3) -> BlockMatrix3 {
    let rows = matrix.num_rows();
    if (0..rows).all(|i| matrix.position(i, i).is_some()) {
        return matrix;
    }
    let (mut start, mut column, mut blocks) = (vec![0], Vec::new(), Vec::new());
    for i in 0..rows {
        let (columns, row) = matrix.row(i);
        let mut entries: Vec<(u32, Block)> = columns.iter().copied().zip(row.iter().copied()).collect();
        if matrix.position(i, i).is_none() {
            entries.push((i as u32, [0.0; 9]));
            entries.sort_by_key(|&(j, _)| j);
        }
        for (j, block) in entries {
            column.push(j);
            blocks.push(block);
        }
        start.push(column.len());
    }
    BlockMatrix3::from_rows(start, column, blocks)
}

/// (A + A^T) / 2 on the union of both patterns.
fn symmetric_part(matrix: &BlockMatrix3) -> BlockMatrix3 {
    let rows = matrix.num_rows();
    let mut lists: Vec<Vec<u32>> = vec![Vec::new(); rows];
    for i in 0..rows {
        for &j in matrix.row(i).0 {
            lists[i].push(j);
            lists[j as usize].push(i as u32);
        }
    }
    let (mut start, mut blocks) = (vec![0], Vec::new());
    for (i, list) in lists.iter_mut().enumerate() {
        list.sort_unstable();
        list.dedup();
        for &j in list.iter() {
            let (a, t) = (matrix.get(i, j as usize), matrix.get(j as usize, i));
            blocks.push(std::array::from_fn(|k| 0.5 * (a[k] + t[3 * (k % 3) + k / 3])));
        }
        start.push(blocks.len());
    }
    BlockMatrix3::from_rows(start, lists.concat(), blocks)
}
