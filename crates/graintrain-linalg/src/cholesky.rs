//! Sparse Cholesky factorisation of symmetric block matrices by the multifrontal method.
//!
//! The matrix is analysed once per pattern ([`SparseCholesky::new`]) and factorised many times. Every supernode s of
//! the factor assembles a dense front from its entries of the matrix and the update matrices of its children in the
//! assembly tree, eliminates its columns with dense kernels,
//!
//! ```text
//! [ A11  .  ]    L11 L11^T = A11,   L21 = A21 L11^-T,   update = A22 - L21 L21^T,
//! [ A21 A22 ]
//! ```
//!
//! and hands the update to its parent (Duff and Reid 1983; Liu 1992). Working in blocks (3x3 in contact space, 6x6 in
//! body space) makes the analysis 9 or 36 times cheaper than in scalars and moves whole blocks in the assembly.

use crate::ordering::{Graph, Ordering};
use crate::supernodes::{Run, Supernodes};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{
    LltError, LltRegularization, cholesky_in_place, cholesky_in_place_scratch,
};
use faer::linalg::matmul::triangular::{BlockStructure, matmul as triangular_matmul};
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par, Spec};

/// Why a matrix could not be factorised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CholeskyError {
    /// A pivot was not positive (or not finite): the matrix is not numerically positive definite.
    #[error("the matrix is not positive definite: the pivot of row {row} is not positive")]
    NotPositiveDefinite {
        /// Scalar row of the matrix.
        row: usize,
    },
}

/// Work and memory of a factorisation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FactorCost {
    /// Scalar entries stored for the factor.
    pub entries: usize,
    /// Floating point operations of one numeric factorisation.
    pub flops: f64,
}

/// Factorisation of a symmetric positive definite matrix of square blocks.
pub struct SparseCholesky {
    block_size: usize,
    structure: Supernodes,
    /// Where the blocks of the matrix go, supernode by supernode.
    entries: Vec<Vec<Entry>>,
    /// Where the rows of each supernode lie in the front of its parent.
    runs: Vec<Vec<Run>>,
    /// Start of each supernode's panel in `values`.
    panel_start: Vec<usize>,
    /// Panels of L, column-major: (width + rows) x width of each supernode.
    values: Vec<f64>,
    /// Stack of update matrices.
    updates: Vec<f64>,
    children: Vec<Vec<u32>>,
    kernel_memory: MemBuffer,
    solution: Vec<f64>,
    gathered: Vec<f64>,
}

/// One block of the matrix inside the panel of a supernode; rows and columns in blocks from the panel's corner.
#[derive(Clone, Copy, Debug)]
struct Entry {
    block: u32,
    row: u32,
    column: u32,
    transposed: bool,
}

impl SparseCholesky {
    /// Analyses a symmetric matrix of `block_size` x `block_size` blocks in compressed row form. Of each pair of
    /// mirrored blocks only the lower one (column <= row) is read; the upper ones may be stored or not.
    /// Every diagonal block must be stored.
    ///
    /// # Panics
    /// If the row starts do not fit the columns, or a column index is not below the number of rows.
    pub fn new(block_size: usize, row_start: &[usize], column: &[u32], ordering: Ordering) -> Self {
        let structure = Supernodes::new(&symmetric_graph(row_start, column), ordering, block_size);
        let rows = structure.order.len();
        let mut entries: Vec<Vec<Entry>> = vec![Vec::new(); structure.len()];
        let holder = structure.holders();
        for i in 0..rows {
            for k in row_start[i]..row_start[i + 1] {
                let j = column[k] as usize;
                if j > i {
                    continue;
                }
                let (p, q) = (structure.position[i], structure.position[j]);
                let (row, column, transposed) = if p >= q { (p, q, false) } else { (q, p, true) };
                let s = holder[column as usize] as usize;
                entries[s].push(Entry {
                    block: k as u32,
                    row: structure.local(s, row),
                    column: column - structure.first[s],
                    transposed,
                });
            }
        }
        let (children, runs) = structure.assembly();
        let (mut panel_start, mut total) = (vec![0], 0);
        let (mut widest, mut tallest) = (0, 0);
        let (mut held, mut most) = (0_usize, 0_usize);
        for s in 0..structure.len() {
            let (width, below) = (block_size * structure.width(s), block_size * structure.rows[s].len());
            total += width * (width + below);
            panel_start.push(total);
            widest = widest.max(width);
            tallest = tallest.max(below);
            most = most.max(held + below * below);
            for &c in &children[s] {
                held -= (block_size * structure.rows[c as usize].len()).pow(2);
            }
            held += below * below;
        }
        let kernel_memory =
            MemBuffer::new(cholesky_in_place_scratch::<f64>(widest, Par::Seq, Spec::default()));
        Self {
            block_size,
            entries,
            runs,
            panel_start,
            values: vec![0.0; total],
            updates: vec![0.0; most],
            children,
            kernel_memory,
            solution: vec![0.0; rows * block_size],
            gathered: vec![0.0; tallest],
            structure,
        }
    }

    /// Scalar dimension of the matrix.
    pub fn dimension(&self) -> usize {
        self.solution.len()
    }

    /// Work and memory of one factorisation.
    pub fn cost(&self) -> FactorCost {
        factor_cost(&self.structure, self.block_size)
    }

    /// Factorises the matrix whose blocks (row-major, in the order of the pattern given to [`Self::new`]) are
    /// concatenated in `blocks`.
    ///
    /// # Errors
    /// [`CholeskyError::NotPositiveDefinite`]; the factor is then unusable until the next success.
    ///
    /// # Panics
    /// If `blocks` is shorter than the pattern.
    pub fn factorize(&mut self, blocks: &[f64]) -> Result<(), CholeskyError> {
        let b = self.block_size;
        let mut top = 0;
        for s in 0..self.structure.len() {
            let (width, below) = (b * self.structure.width(s), b * self.structure.rows[s].len());
            let height = width + below;
            let panel = &mut self.values[self.panel_start[s]..self.panel_start[s + 1]];
            panel.fill(0.0);
            assemble_entries(panel, height, b, &self.entries[s], blocks);

            // The children's updates lie on top of the stack, the last child's highest.
            let held: usize =
                self.children[s].iter().map(|&c| (b * self.structure.rows[c as usize].len()).pow(2)).sum();
            let (children, update) = self.updates[top - held..].split_at_mut(held);
            let update = &mut update[..below * below];
            for column in 0..below {
                update[column * below + column..(column + 1) * below].fill(0.0);
            }
            let mut from = 0;
            for &c in &self.children[s] {
                let size = b * self.structure.rows[c as usize].len();
                let child = &children[from..from + size * size];
                extend_add(panel, width, height, update, child, size, b, &self.runs[c as usize]);
                from += size * size;
            }

            let mut front = MatMut::from_column_major_slice_mut(panel, height, width);
            let (mut diagonal, mut lower) = front.rb_mut().split_at_row_mut(width);
            cholesky_in_place(
                diagonal.rb_mut(),
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut self.kernel_memory),
                Spec::default(),
            )
            .map_err(|error| {
                let LltError::NonPositivePivot { index } = error;
                let position = self.structure.first[s] as usize + index / b;
                let row = self.structure.order[position] as usize * b + index % b;
                CholeskyError::NotPositiveDefinite { row }
            })?;
            if below > 0 {
                solve_lower_triangular_in_place(diagonal.rb(), lower.rb_mut().transpose_mut(), Par::Seq);
                triangular_matmul(
                    MatMut::from_column_major_slice_mut(update, below, below),
                    BlockStructure::TriangularLower,
                    Accum::Add,
                    lower.rb(),
                    BlockStructure::Rectangular,
                    lower.rb().transpose(),
                    BlockStructure::Rectangular,
                    -1.0,
                    Par::Seq,
                );
                self.updates.copy_within(top..top + below * below, top - held);
            }
            top = top - held + below * below;
        }
        Ok(())
    }

    /// x <- A^-1 x with the last factorisation.
    ///
    /// # Panics
    /// If x does not have the dimension of the matrix.
    pub fn solve(&mut self, x: &mut [f64]) {
        assert_eq!(x.len(), self.dimension(), "the right-hand side has the dimension of the matrix");
        let b = self.block_size;
        let structure = &self.structure;
        for (position, &row) in structure.order.iter().enumerate() {
            let row = row as usize;
            self.solution[b * position..b * (position + 1)].copy_from_slice(&x[b * row..b * (row + 1)]);
        }
        for s in 0..structure.len() {
            let (width, below) = (b * structure.width(s), b * structure.rows[s].len());
            let panel = panel(&self.values[self.panel_start[s]..self.panel_start[s + 1]], width, below);
            let (diagonal, lower) = panel.split_at_row(width);
            let first = b * structure.first[s] as usize;
            let mut head =
                MatMut::from_column_major_slice_mut(&mut self.solution[first..first + width], width, 1);
            solve_lower_triangular_in_place(diagonal, head.rb_mut(), Par::Seq);
            let gathered = &mut self.gathered[..below];
            faer::linalg::matmul::matmul(
                MatMut::from_column_major_slice_mut(gathered, below, 1),
                Accum::Replace,
                lower,
                head.rb(),
                1.0,
                Par::Seq,
            );
            for (product, &row) in gathered.chunks_exact(b).zip(&structure.rows[s]) {
                let target = &mut self.solution[b * row as usize..b * (row as usize + 1)];
                for (target, product) in target.iter_mut().zip(product) {
                    *target -= product;
                }
            }
        }
        for s in (0..structure.len()).rev() {
            let (width, below) = (b * structure.width(s), b * structure.rows[s].len());
            let panel = panel(&self.values[self.panel_start[s]..self.panel_start[s + 1]], width, below);
            let (diagonal, lower) = panel.split_at_row(width);
            let gathered = &mut self.gathered[..below];
            for (gathered, &row) in gathered.chunks_exact_mut(b).zip(&structure.rows[s]) {
                gathered.copy_from_slice(&self.solution[b * row as usize..b * (row as usize + 1)]);
            }
            let first = b * structure.first[s] as usize;
            let mut head =
                MatMut::from_column_major_slice_mut(&mut self.solution[first..first + width], width, 1);
            faer::linalg::matmul::matmul(
                head.rb_mut(),
                Accum::Add,
                lower.transpose(),
                MatRef::from_column_major_slice(gathered, below, 1),
                -1.0,
                Par::Seq,
            );
            solve_upper_triangular_in_place(diagonal.transpose(), head, Par::Seq);
        }
        for (position, &row) in structure.order.iter().enumerate() {
            let row = row as usize;
            x[b * row..b * (row + 1)].copy_from_slice(&self.solution[b * position..b * (position + 1)]);
        }
    }
}

fn panel(values: &[f64], width: usize, below: usize) -> MatRef<'_, f64> {
    MatRef::from_column_major_slice(values, width + below, width)
}

/// Work and memory a factorisation in this order would need, without any numeric storage.
pub fn predicted_cost(
    block_size: usize,
    row_start: &[usize],
    column: &[u32],
    ordering: Ordering,
) -> FactorCost {
    factor_cost(&Supernodes::new(&symmetric_graph(row_start, column), ordering, block_size), block_size)
}

pub(crate) fn factor_cost(structure: &Supernodes, block_size: usize) -> FactorCost {
    let mut cost = FactorCost { entries: 0, flops: 0.0 };
    for s in 0..structure.len() {
        let (width, below) = (block_size * structure.width(s), block_size * structure.rows[s].len());
        cost.entries += width * (width + below);
        let (w, m) = (width as f64, below as f64);
        cost.flops += w * w * w / 3.0 + w * w * m + w * m * m;
    }
    cost
}

/// Graph with an edge wherever one of the two mirrored blocks is stored.
fn symmetric_graph(row_start: &[usize], column: &[u32]) -> Graph {
    let rows = row_start.len() - 1;
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); rows];
    for i in 0..rows {
        for &j in &column[row_start[i]..row_start[i + 1]] {
            if (j as usize) < i {
                neighbours[i].push(j);
                neighbours[j as usize].push(i as u32);
            }
        }
    }
    let mut start = vec![0];
    for list in &mut neighbours {
        list.sort_unstable();
        start.push(start[start.len() - 1] + list.len());
    }
    Graph::from_rows(&start, &neighbours.concat())
}

/// Adds blocks of the matrix to a panel.
fn assemble_entries(panel: &mut [f64], height: usize, b: usize, entries: &[Entry], blocks: &[f64]) {
    for entry in entries {
        let block = &blocks[entry.block as usize * b * b..(entry.block as usize + 1) * b * b];
        let (row, column) = (entry.row as usize * b, entry.column as usize * b);
        for c in 0..b {
            let target = &mut panel[(column + c) * height + row..(column + c) * height + row + b];
            for (r, target) in target.iter_mut().enumerate() {
                *target += if entry.transposed { block[c * b + r] } else { block[r * b + c] };
            }
        }
    }
}

/// Adds a child's update matrix (lower triangle, `size` x `size`) to its parent's front: panel and update.
fn extend_add(
    panel: &mut [f64],
    width: usize,
    height: usize,
    update: &mut [f64],
    child: &[f64],
    size: usize,
    b: usize,
    runs: &[Run],
) {
    let below = height - width;
    for (index, columns) in runs.iter().enumerate() {
        for c in 0..columns.length as usize * b {
            let source_column = columns.from as usize * b + c;
            let target_column = columns.to as usize * b + c;
            let source = &child[source_column * size..(source_column + 1) * size];
            let (target, offset) = if target_column < width {
                (&mut panel[target_column * height..(target_column + 1) * height], 0)
            } else {
                let column = target_column - width;
                (&mut update[column * below..(column + 1) * below], width)
            };
            for (k, rows) in runs[index..].iter().enumerate() {
                // In the run of the column itself only the lower triangle counts.
                let skip = if k == 0 { c } else { 0 };
                let length = rows.length as usize * b;
                let from = rows.from as usize * b;
                let to = rows.to as usize * b - offset;
                let source = &source[from + skip..from + length];
                for (target, source) in target[to + skip..to + length].iter_mut().zip(source) {
                    *target += source;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::Rng as _;
    use proptest::test_runner::{RngAlgorithm, TestRng};

    /// A random symmetric positive definite block matrix on a random graph, lower blocks only.
    fn random_matrix(rows: usize, b: usize, edges: usize, seed: u8) -> (Vec<usize>, Vec<u32>, Vec<f64>) {
        let mut rng = TestRng::from_seed(RngAlgorithm::ChaCha, &[seed; 32]);
        let mut pairs: Vec<(usize, usize)> = (0..rows).map(|i| (i, i)).collect();
        for _ in 0..edges {
            let (i, j) = (rng.next_u64() as usize % rows, rng.next_u64() as usize % rows);
            // Mostly near neighbours, so that there are small and large separators.
            let j = if rng.next_u64().is_multiple_of(8) { j } else { (i + j % 7) % rows };
            pairs.push((i.max(j), i.min(j)));
        }
        pairs.sort_unstable();
        pairs.dedup();
        let mut start = vec![0; rows + 1];
        for &(i, _) in &pairs {
            start[i + 1] += 1;
        }
        for i in 0..rows {
            start[i + 1] += start[i];
        }
        let mut signed = || (rng.next_u64() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0;
        let mut blocks: Vec<f64> =
            pairs.iter().flat_map(|_| (0..b * b).map(|_| 0.0).collect::<Vec<_>>()).collect();
        blocks.iter_mut().for_each(|x| *x = signed());
        let degree = pairs.len() as f64;
        for (k, &(i, j)) in pairs.iter().enumerate() {
            if i == j {
                let block = &mut blocks[k * b * b..(k + 1) * b * b];
                for r in 0..b {
                    for c in 0..r {
                        block[c * b + r] = block[r * b + c];
                    }
                    block[r * b + r] = degree.min(60.0 * b as f64);
                }
            }
        }
        (start, pairs.iter().map(|&(_, j)| j as u32).collect(), blocks)
    }

    fn times(b: usize, start: &[usize], column: &[u32], blocks: &[f64], x: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; x.len()];
        for i in 0..start.len() - 1 {
            for k in start[i]..start[i + 1] {
                let j = column[k] as usize;
                for r in 0..b {
                    for c in 0..b {
                        let a = blocks[k * b * b + r * b + c];
                        y[i * b + r] += a * x[j * b + c];
                        if i != j {
                            y[j * b + c] += a * x[i * b + r];
                        }
                    }
                }
            }
        }
        y
    }

    #[test]
    fn solves_random_systems_in_every_ordering() {
        for (case, &(rows, b, edges)) in
            [(1, 3, 0), (5, 6, 4), (40, 1, 60), (150, 3, 500), (300, 6, 900), (700, 3, 2500)]
                .iter()
                .enumerate()
        {
            let (start, column, blocks) = random_matrix(rows, b, edges, case as u8);
            let exact: Vec<f64> = (0..rows * b).map(|k| f64::sin(k as f64) + 0.3).collect();
            let rhs = times(b, &start, &column, &blocks, &exact);
            for ordering in [Ordering::Natural, Ordering::MinimumDegree, Ordering::NestedDissection] {
                let mut factor = SparseCholesky::new(b, &start, &column, ordering);
                // Twice: the second factorisation must not see anything of the first.
                for scale in [2.0, 1.0] {
                    let scaled: Vec<f64> = blocks.iter().map(|x| scale * x).collect();
                    factor.factorize(&scaled).unwrap();
                    let mut x: Vec<f64> = rhs.iter().map(|x| scale * x).collect();
                    factor.solve(&mut x);
                    for (x, exact) in x.iter().zip(&exact) {
                        assert!((x - exact).abs() < 1e-9, "{rows} {b} {ordering:?}: {x} for {exact}");
                    }
                }
            }
        }
    }

    #[test]
    fn predicted_entries_count_at_least_the_true_fill_and_not_much_more() {
        let (start, column, blocks) = random_matrix(400, 3, 1200, 11);
        let mut triplets = Vec::new();
        for i in 0..400 {
            for k in start[i]..start[i + 1] {
                for r in 0..3 {
                    for c in 0..3 {
                        let (row, col) = (3 * i + r, 3 * column[k] as usize + c);
                        if row >= col {
                            triplets.push(faer::sparse::Triplet::new(row, col, blocks[9 * k + 3 * r + c]));
                        }
                    }
                }
            }
        }
        let matrix =
            faer::sparse::SparseColMat::<usize, f64>::try_new_from_triplets(1200, 1200, &triplets).unwrap();
        let reference = faer::sparse::linalg::cholesky::factorize_symbolic_cholesky(
            matrix.symbolic(),
            faer::Side::Lower,
            faer::sparse::linalg::cholesky::SymmetricOrdering::Amd,
            Default::default(),
        )
        .unwrap();
        let ours = predicted_cost(3, &start, &column, Ordering::MinimumDegree).entries as f64;
        let theirs = reference.len_val() as f64;
        assert!(ours > 0.6 * theirs && ours < 1.6 * theirs, "{ours} entries, faer {theirs}");
    }

    #[test]
    fn an_indefinite_matrix_is_reported_with_its_row() {
        let blocks = [1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, -1.0];
        let mut factor = SparseCholesky::new(2, &[0, 1, 2], &[0, 1], Ordering::Natural);
        assert_eq!(factor.factorize(&blocks), Err(CholeskyError::NotPositiveDefinite { row: 3 }));
    }
}
