//! The Schur complement S = N + H as a sparse matrix whose pattern is made once per problem.

use crate::delassus::Delassus;
use crate::problem::Ccp;
use graintrain_linalg::block3::{Block, BlockMatrix3};

/// S = N + H. The pattern is that of N; only the diagonal blocks change from one H to the next.
#[derive(Clone, Debug)]
pub struct SchurComplement {
    matrix: BlockMatrix3,
    /// Where the diagonal blocks lie.
    diagonal: Vec<usize>,
    /// N_ii.
    own: Vec<Block>,
}

impl SchurComplement {
    /// N of a problem, with H = 0. Off-diagonal blocks of a matrix read from a file may be asymmetric: S takes its
    /// symmetric part.
    pub fn new(problem: &Ccp) -> Self {
        let mut matrix = with_diagonal(problem.delassus.assemble());
        if matches!(problem.delassus, Delassus::Sparse(_)) && matrix.asymmetry() > 0.0 {
            matrix = symmetric_part(&matrix);
        }
        let diagonal: Vec<usize> = (0..matrix.num_rows()).filter_map(|i| matrix.position(i, i)).collect();
        let own = diagonal.iter().map(|&k| matrix.blocks()[k]).collect();
        Self { matrix, diagonal, own }
    }

    /// S <- N + H, in place.
    pub fn update(&mut self, added: &[Block]) {
        let blocks = self.matrix.blocks_mut();
        for ((&k, own), h) in self.diagonal.iter().zip(&self.own).zip(added) {
            for ((s, n), h) in blocks[k].iter_mut().zip(own).zip(h) {
                *s = n + h;
            }
        }
    }

    /// S.
    pub fn matrix(&self) -> &BlockMatrix3 {
        &self.matrix
    }
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
