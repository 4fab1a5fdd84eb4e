//! N as a sparse matrix, packed for the first-order methods.

use super::combination::Combination;
use super::lanes::{Batch, LANES, Lanes, ZERO, dot};
use super::packing::EMPTY;
use super::tasks::{CHUNK, Tally, Totals, for_each_task};
use graintrain_linalg::block3::{Block, BlockMatrix3};

/// Block rows of N scaled from both sides, rows and columns as places in vectors of batches.
#[derive(Clone, Debug)]
pub(super) struct RowOperator {
    row_start: Vec<usize>,
    /// Batch and lane of each block column, as `batch * LANES + lane`.
    column: Vec<u32>,
    block: Vec<Block>,
}

impl RowOperator {
    /// Scales N by the factors of the normal and of the tangents per block row; `order` has the block row at
    /// each place.
    pub(super) fn new(matrix: &BlockMatrix3, scaling: &[[f64; 2]], order: &[u32]) -> Self {
        let mut place_of = vec![0; matrix.num_rows()];
        for (place, &i) in order.iter().enumerate().filter(|&(_, &i)| i != EMPTY) {
            place_of[i as usize] = place as u32;
        }
        let mut rows = Self { row_start: vec![0], column: Vec::new(), block: Vec::new() };
        for &i in order {
            let i = i as usize;
            if i != EMPTY as usize {
                for k in matrix.row_starts()[i]..matrix.row_starts()[i + 1] {
                    let j = matrix.columns()[k] as usize;
                    let mut block = matrix.blocks()[k];
                    for (entry, value) in block.iter_mut().enumerate() {
                        *value *= scaling[i][(entry / 3).min(1)] * scaling[j][(entry % 3).min(1)];
                    }
                    rows.column.push(place_of[j]);
                    rows.block.push(block);
                }
            }
            rows.row_start.push(rows.block.len());
        }
        rows
    }

    /// The row at place i of N x.
    #[inline(always)]
    pub(super) fn row_times(&self, i: usize, x: &[Batch]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        let range = self.row_start[i]..self.row_start[i + 1];
        for (&j, b) in self.column[range.clone()].iter().zip(&self.block[range]) {
            let from = &x[j as usize / LANES];
            let l = j as usize % LANES;
            let (x0, x1, x2) = (from[0].0[l], from[1].0[l], from[2].0[l]);
            sum[0] += b[0] * x0 + b[1] * x1 + b[2] * x2;
            sum[1] += b[3] * x0 + b[4] * x1 + b[5] * x2;
            sum[2] += b[6] * x0 + b[7] * x1 + b[8] * x2;
        }
        sum
    }

    /// Diagonal block at place i.
    pub(super) fn diagonal_block(&self, i: usize) -> Block {
        let range = self.row_start[i]..self.row_start[i + 1];
        let columns = &self.column[range.clone()];
        columns.iter().position(|&j| j as usize == i).map_or([0.0; 9], |k| self.block[range.start + k])
    }

    /// Bytes of the matrix.
    pub(super) fn pass_bytes(&self) -> usize {
        size_of_val(&self.block[..]) + size_of_val(&self.column[..]) + size_of_val(&self.row_start[..])
    }

    /// Combines N x with images; returns x^T N x.
    pub(super) fn multiply<const K: usize>(
        &self,
        x: &[Batch],
        images: [&mut [Lanes]; K],
        tallies: &mut [Tally],
        combination: &impl Combination<K>,
    ) -> f64 {
        let rows = self.row_start.len() - 1;
        let chunks = x.len().div_ceil(CHUNK);
        let tallies = &mut tallies[..chunks];
        let no_extra = &mut [] as &mut [()];
        let unit = CHUNK * 3;
        for_each_task(0..chunks, unit, images, no_extra, &|_| 0, tallies, &|chunk, images, _, tally| {
            let mut images = images.map(|image| image.as_chunks_mut::<3>().0);
            for offset in 0..images[0].len() {
                let batch = chunk * CHUNK + offset;
                let mut product = ZERO;
                for lane in 0..LANES.min(rows - batch * LANES) {
                    let i = batch * LANES + lane;
                    let sum = self.row_times(i, x);
                    for k in 0..3 {
                        product[k].0[lane] = sum[k];
                    }
                }
                tally.sum[0] += dot(&x[batch], &product);
                for (k, product) in product.into_iter().enumerate() {
                    let new = combination.of(product, images.each_ref().map(|image| image[offset][k]));
                    for (image, new) in images.iter_mut().zip(new) {
                        image[offset][k] = new;
                    }
                }
            }
        });
        Totals::of(tallies).sum[0]
    }
}
