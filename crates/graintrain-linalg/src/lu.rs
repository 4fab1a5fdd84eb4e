//! Sparse LU factorisation of nonsymmetric block matrices whose pattern is symmetric, by the multifrontal
//! method.
//!
//! Analysed once per pattern like [`crate::cholesky`], with the same supernodes and assembly tree. The front
//! of a supernode is square and holds both triangles,
//!
//! ```text
//! [ A11 A12 ]    P A11 = L11 U11,   L21 = A21 U11^-1,   U12 = L11^-1 P A12,   update = A22 - L21 U12.
//! [ A21 A22 ]
//! ```
//!
//! Rows are exchanged inside a supernode only (P), never between supernodes: the pattern stays that of the
//! analysis and is known before the numbers are. The price is that a pivot block may be nearly singular
//! although the matrix is not; callers look at the residual of what [`SparseLu::solve`] gives. Sources: Duff
//! and Reid, "The multifrontal solution of unsymmetric sets of linear equations", SIAM J. Sci. Stat. Comput.
//! 5:633-641, 1984; Li and Demmel, "SuperLU_DIST", ACM TOMS 29:110-140, 2003 (pivoting inside blocks,
//! refinement outside).

use crate::cholesky::{FactorCost, factor_cost};
use crate::ordering::{Graph, Ordering};
use crate::supernodes::{Run, Supernodes};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::factor::{lu_in_place, lu_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_unit_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par};

/// Why a matrix could not be factorised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LuError {
    /// A pivot was zero or not finite after rows were exchanged inside its supernode.
    #[error("the pivot of row {row} is zero or not finite")]
    ZeroPivot {
        /// Scalar row of the matrix, up to the exchanges inside the supernode.
        row: usize,
    },
}

/// Factorisation of a matrix of square blocks.
pub struct SparseLu {
    block_size: usize,
    structure: Supernodes,
    /// Where the blocks of the matrix go, supernode by supernode.
    entries: Vec<Vec<Entry>>,
    /// Where the rows of each supernode lie in the front of its parent.
    runs: Vec<Vec<Run>>,
    children: Vec<Vec<u32>>,
    /// Start of each supernode's panels in `lower` and in `upper`.
    panel_start: Vec<[usize; 2]>,
    /// L11 and U11 over L21, column-major: (width + rows) x width of each supernode.
    lower: Vec<f64>,
    /// U12, column-major: width x rows.
    upper: Vec<f64>,
    /// Row of the pivot block that became row k, and the inverse.
    exchange: [Vec<usize>; 2],
    /// Stack of update matrices.
    updates: Vec<f64>,
    kernel_memory: MemBuffer,
    solution: Vec<f64>,
    gathered: Vec<f64>,
    sign: f64,
}

/// One block of the matrix inside a front; rows and columns in blocks from the corner of the front.
#[derive(Clone, Copy, Debug)]
struct Entry {
    block: u32,
    row: u32,
    column: u32,
}

impl SparseLu {
    /// Analyses a matrix of `block_size` x `block_size` blocks in compressed row form. Where a block is
    /// stored and its mirror is not, the mirror counts as zero.
    ///
    /// # Panics
    /// If the row starts do not fit the columns, or a column index is not below the number of rows.
    pub fn new(block_size: usize, row_start: &[usize], column: &[u32], ordering: Ordering) -> Self {
        let structure = Supernodes::new(&union_graph(row_start, column), ordering, block_size);
        let rows = structure.order.len();
        let holder = structure.holders();
        let mut entries: Vec<Vec<Entry>> = vec![Vec::new(); structure.len()];
        for i in 0..rows {
            for k in row_start[i]..row_start[i + 1] {
                let (p, q) = (structure.position[i], structure.position[column[k] as usize]);
                let s = holder[p.min(q) as usize] as usize;
                entries[s].push(Entry {
                    block: k as u32,
                    row: structure.local(s, p),
                    column: structure.local(s, q),
                });
            }
        }
        let (children, runs) = structure.assembly();
        let (mut panel_start, mut totals) = (vec![[0; 2]], [0; 2]);
        let (mut widest, mut tallest) = (0, 0);
        let (mut held, mut most) = (0_usize, 0_usize);
        for s in 0..structure.len() {
            let (width, below) = (block_size * structure.width(s), block_size * structure.rows[s].len());
            totals = [totals[0] + width * (width + below), totals[1] + width * below];
            panel_start.push(totals);
            widest = widest.max(width);
            tallest = tallest.max(below);
            most = most.max(held + below * below);
            for &c in &children[s] {
                held -= (block_size * structure.rows[c as usize].len()).pow(2);
            }
            held += below * below;
        }
        let need = lu_in_place_scratch::<usize, f64>(widest, widest, Par::Seq, Default::default());
        Self {
            block_size,
            entries,
            runs,
            children,
            panel_start,
            lower: vec![0.0; totals[0]],
            upper: vec![0.0; totals[1]],
            exchange: [vec![0; rows * block_size], vec![0; rows * block_size]],
            updates: vec![0.0; most],
            kernel_memory: MemBuffer::new(need),
            solution: vec![0.0; rows * block_size],
            gathered: vec![0.0; tallest.max(widest)],
            structure,
            sign: 0.0,
        }
    }

    /// Scalar dimension of the matrix.
    pub fn dimension(&self) -> usize {
        self.solution.len()
    }

    /// Work and memory of one factorisation.
    pub fn cost(&self) -> FactorCost {
        let symmetric = factor_cost(&self.structure, self.block_size);
        FactorCost { entries: self.lower.len() + self.upper.len(), flops: 2.0 * symmetric.flops }
    }

    /// Sign of the determinant of the last matrix: 1 or -1, 0 before the first success and after a failure.
    /// Where the factors are only nearly right, so is the sign.
    pub fn determinant_sign(&self) -> f64 {
        self.sign
    }

    /// Factorises the matrix whose blocks (row-major, in the order of the pattern given to [`Self::new`]) are
    /// concatenated in `blocks`. Cost twice that of the Cholesky factorisation of the same pattern.
    ///
    /// # Errors
    /// [`LuError::ZeroPivot`]; the factors are then unusable until the next success.
    ///
    /// # Panics
    /// If `blocks` is shorter than the pattern.
    pub fn factorize(&mut self, blocks: &[f64]) -> Result<(), LuError> {
        let b = self.block_size;
        self.sign = 0.0;
        let mut sign = 1.0;
        let mut top = 0;
        for s in 0..self.structure.len() {
            let (width, below) = (b * self.structure.width(s), b * self.structure.rows[s].len());
            let [lower_range, upper_range] =
                [0, 1].map(|side| self.panel_start[s][side]..self.panel_start[s + 1][side]);
            // The children's updates lie on top of the stack, the last child's highest.
            let size = |c: u32| b * self.structure.rows[c as usize].len();
            let held: usize = self.children[s].iter().map(|&c| size(c).pow(2)).sum();
            let (children, update) = self.updates[top - held..].split_at_mut(held);
            let mut front = Front {
                width,
                below,
                lower: &mut self.lower[lower_range],
                upper: &mut self.upper[upper_range],
                update: &mut update[..below * below],
            };
            front.clear();
            front.assemble(b, &self.entries[s], blocks);
            let mut from = 0;
            for &c in &self.children[s] {
                let square = size(c).pow(2);
                front.extend_add(&children[from..from + square], size(c), b, &self.runs[c as usize]);
                from += square;
            }
            let first = b * self.structure.first[s] as usize;
            let [forward, inverse] = &mut self.exchange;
            let exchange = [&mut forward[first..first + width], &mut inverse[first..first + width]];
            match front.eliminate(exchange, &mut self.gathered, &mut self.kernel_memory) {
                Ok(parity) => sign *= parity,
                Err(index) => {
                    let position = self.structure.first[s] as usize + index / b;
                    let row = self.structure.order[position] as usize * b + index % b;
                    return Err(LuError::ZeroPivot { row });
                }
            }
            self.updates.copy_within(top..top + below * below, top - held);
            top = top - held + below * below;
        }
        self.sign = sign;
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
            let panel = &self.lower[self.panel_start[s][0]..self.panel_start[s + 1][0]];
            let panel = MatRef::from_column_major_slice(panel, width + below, width);
            let (diagonal, lower) = panel.split_at_row(width);
            let first = b * structure.first[s] as usize;
            let head = &mut self.solution[first..first + width];
            let gathered = &mut self.gathered[..width];
            for (gathered, &row) in gathered.iter_mut().zip(&self.exchange[0][first..]) {
                *gathered = head[row];
            }
            head.copy_from_slice(gathered);
            let mut head = MatMut::from_column_major_slice_mut(head, width, 1);
            solve_unit_lower_triangular_in_place(diagonal, head.rb_mut(), Par::Seq);
            let gathered = &mut self.gathered[..below];
            let product = MatMut::from_column_major_slice_mut(gathered, below, 1);
            matmul(product, Accum::Replace, lower, head.rb(), 1.0, Par::Seq);
            for (product, &row) in gathered.chunks_exact(b).zip(&structure.rows[s]) {
                let target = &mut self.solution[b * row as usize..b * (row as usize + 1)];
                for (target, product) in target.iter_mut().zip(product) {
                    *target -= product;
                }
            }
        }
        for s in (0..structure.len()).rev() {
            let (width, below) = (b * structure.width(s), b * structure.rows[s].len());
            let panel = &self.lower[self.panel_start[s][0]..self.panel_start[s + 1][0]];
            let panel = MatRef::from_column_major_slice(panel, width + below, width);
            let diagonal = panel.subrows(0, width);
            let upper = &self.upper[self.panel_start[s][1]..self.panel_start[s + 1][1]];
            let upper = MatRef::from_column_major_slice(upper, width, below);
            let gathered = &mut self.gathered[..below];
            for (gathered, &row) in gathered.chunks_exact_mut(b).zip(&structure.rows[s]) {
                gathered.copy_from_slice(&self.solution[b * row as usize..b * (row as usize + 1)]);
            }
            let first = b * structure.first[s] as usize;
            let mut head =
                MatMut::from_column_major_slice_mut(&mut self.solution[first..first + width], width, 1);
            let below = MatRef::from_column_major_slice(gathered, below, 1);
            matmul(head.rb_mut(), Accum::Add, upper, below, -1.0, Par::Seq);
            solve_upper_triangular_in_place(diagonal, head, Par::Seq);
        }
        for (position, &row) in structure.order.iter().enumerate() {
            let row = row as usize;
            x[b * row..b * (row + 1)].copy_from_slice(&self.solution[b * position..b * (position + 1)]);
        }
    }
}

/// Graph with an edge wherever a block or its mirror is stored.
fn union_graph(row_start: &[usize], column: &[u32]) -> Graph {
    let rows = row_start.len() - 1;
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); rows];
    for i in 0..rows {
        for &j in &column[row_start[i]..row_start[i + 1]] {
            if j as usize != i {
                neighbours[i].push(j);
                neighbours[j as usize].push(i as u32);
            }
        }
    }
    let mut start = vec![0];
    for list in &mut neighbours {
        list.sort_unstable();
        list.dedup();
        start.push(start[start.len() - 1] + list.len());
    }
    Graph::from_rows(&start, &neighbours.concat())
}

/// The front of one supernode.
struct Front<'a> {
    width: usize,
    below: usize,
    lower: &'a mut [f64],
    upper: &'a mut [f64],
    update: &'a mut [f64],
}

impl Front<'_> {
    fn clear(&mut self) {
        self.lower.fill(0.0);
        self.upper.fill(0.0);
        self.update.fill(0.0);
    }

    /// Rows `row..row + length` of a column, all of them above or all of them below the border of the pivot
    /// block.
    fn column(&mut self, row: usize, column: usize, length: usize) -> &mut [f64] {
        let (width, below) = (self.width, self.below);
        if column < width {
            let start = column * (width + below) + row;
            &mut self.lower[start..start + length]
        } else if row < width {
            let start = (column - width) * width + row;
            &mut self.upper[start..start + length]
        } else {
            let start = (column - width) * below + row - width;
            &mut self.update[start..start + length]
        }
    }

    /// Adds blocks of the matrix.
    fn assemble(&mut self, b: usize, entries: &[Entry], blocks: &[f64]) {
        for entry in entries {
            let block = &blocks[entry.block as usize * b * b..(entry.block as usize + 1) * b * b];
            for c in 0..b {
                let target = self.column(entry.row as usize * b, entry.column as usize * b + c, b);
                for (r, target) in target.iter_mut().enumerate() {
                    *target += block[r * b + c];
                }
            }
        }
    }

    /// Adds a child's update matrix, `size` x `size`.
    fn extend_add(&mut self, child: &[f64], size: usize, b: usize, runs: &[Run]) {
        for columns in runs {
            for c in 0..columns.length as usize * b {
                let source_column = columns.from as usize * b + c;
                let source = &child[source_column * size..(source_column + 1) * size];
                let target_column = columns.to as usize * b + c;
                for rows in runs {
                    let length = rows.length as usize * b;
                    let from = rows.from as usize * b;
                    let target = self.column(rows.to as usize * b, target_column, length);
                    for (target, source) in target.iter_mut().zip(&source[from..from + length]) {
                        *target += source;
                    }
                }
            }
        }
    }

    /// Eliminates the columns of the pivot block. The sign of its determinant, or the index of a pivot that
    /// is of no use.
    fn eliminate(
        &mut self,
        [exchange, inverse]: [&mut [usize]; 2],
        gathered: &mut [f64],
        memory: &mut MemBuffer,
    ) -> Result<f64, usize> {
        let (width, below) = (self.width, self.below);
        let panel = MatMut::from_column_major_slice_mut(self.lower, width + below, width);
        let (mut diagonal, mut lower) = panel.split_at_row_mut(width);
        let (info, _) = lu_in_place(
            diagonal.rb_mut(),
            exchange,
            inverse,
            Par::Seq,
            MemStack::new(memory),
            Default::default(),
        );
        let mut sign = if info.transposition_count.is_multiple_of(2) { 1.0 } else { -1.0 };
        for k in 0..width {
            let pivot = diagonal[(k, k)];
            if pivot == 0.0 || !pivot.is_finite() {
                return Err(k);
            }
            sign *= pivot.signum();
        }
        if below > 0 {
            for column in self.upper.chunks_exact_mut(width) {
                for (gathered, &row) in gathered.iter_mut().zip(&*exchange) {
                    *gathered = column[row];
                }
                column.copy_from_slice(&gathered[..width]);
            }
            let mut upper = MatMut::from_column_major_slice_mut(self.upper, width, below);
            solve_unit_lower_triangular_in_place(diagonal.rb(), upper.rb_mut(), Par::Seq);
            solve_lower_triangular_in_place(
                diagonal.rb().transpose(),
                lower.rb_mut().transpose_mut(),
                Par::Seq,
            );
            let update = MatMut::from_column_major_slice_mut(self.update, below, below);
            matmul(update, Accum::Add, lower.rb(), upper.rb(), -1.0, Par::Seq);
        }
        Ok(sign)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::{Lu, Matrix, ViewMut};
    use proptest::prelude::Rng as _;
    use proptest::test_runner::{RngAlgorithm, TestRng};

    /// A random nonsymmetric block matrix on a random graph: row starts, columns, blocks. `dominance` is
    /// added to the diagonal.
    fn random_matrix(
        rows: usize,
        b: usize,
        edges: usize,
        dominance: f64,
        seed: u8,
    ) -> (Vec<usize>, Vec<u32>, Vec<f64>) {
        let mut rng = TestRng::from_seed(RngAlgorithm::ChaCha, &[seed; 32]);
        let mut pairs: Vec<(usize, usize)> = (0..rows).map(|i| (i, i)).collect();
        for _ in 0..edges {
            let (i, j) = (rng.next_u64() as usize % rows, rng.next_u64() as usize % rows);
            let j = if rng.next_u64().is_multiple_of(8) { j } else { (i + j % 7) % rows };
            pairs.push((i, j));
            // One block in four has no mirror.
            if !rng.next_u64().is_multiple_of(4) {
                pairs.push((j, i));
            }
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
        let mut blocks: Vec<f64> = (0..pairs.len() * b * b).map(|_| signed()).collect();
        for (k, &(i, j)) in pairs.iter().enumerate() {
            for r in 0..b * usize::from(i == j) {
                blocks[k * b * b + r * (b + 1)] += dominance * signed().signum();
            }
        }
        (start, pairs.iter().map(|&(_, j)| j as u32).collect(), blocks)
    }

    fn dense(rows: usize, b: usize, start: &[usize], column: &[u32], blocks: &[f64]) -> Matrix {
        let mut a = Matrix::zeros(rows * b, rows * b);
        for i in 0..rows {
            for k in start[i]..start[i + 1] {
                for r in 0..b {
                    for c in 0..b {
                        a[(i * b + r, column[k] as usize * b + c)] = blocks[k * b * b + r * b + c];
                    }
                }
            }
        }
        a
    }

    /// Sign of the determinant by plain elimination with row exchanges.
    fn determinant_sign(mut a: Matrix) -> f64 {
        let n = a.rows();
        let mut sign = 1.0;
        for k in 0..n {
            let best = (k..n).max_by(|&i, &j| a[(i, k)].abs().total_cmp(&a[(j, k)].abs())).unwrap();
            if best != k {
                sign = -sign;
                for c in 0..n {
                    let (x, y) = (a[(k, c)], a[(best, c)]);
                    (a[(k, c)], a[(best, c)]) = (y, x);
                }
            }
            sign *= a[(k, k)].signum();
            for i in k + 1..n {
                let factor = a[(i, k)] / a[(k, k)];
                for c in k..n {
                    a[(i, c)] -= factor * a[(k, c)];
                }
            }
        }
        sign
    }

    #[test]
    fn solutions_and_the_sign_of_the_determinant_agree_with_dense_elimination() {
        let mut signs = [0; 2];
        for seed in 0..24 {
            let (rows, b) = (1 + 5 * usize::from(seed), if seed % 2 == 0 { 3 } else { 6 });
            let ordering = [Ordering::Natural, Ordering::MinimumDegree, Ordering::NestedDissection]
                [usize::from(seed) % 3];
            let (start, column, blocks) = random_matrix(rows, b, 3 * rows, 40.0, seed);
            let a = dense(rows, b, &start, &column, &blocks);
            let mut lu = SparseLu::new(b, &start, &column, ordering);
            for (round, factor) in [1.0, -1.0].into_iter().enumerate() {
                // The second round goes through the same analysis; an odd dimension turns the sign.
                let scaled: Vec<f64> = blocks.iter().map(|x| factor * x).collect();
                lu.factorize(&scaled).unwrap();
                let right: Vec<f64> = (0..rows * b).map(|k| (k as f64 + 1.0).sin()).collect();
                let mut x = right.clone();
                lu.solve(&mut x);
                let mut expected = right.clone();
                Lu::new(a.clone()).unwrap().solve_in_place(ViewMut::new(&mut expected, rows * b, 1));
                let size = expected.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
                for (x, expected) in x.iter().zip(&expected) {
                    assert!((factor * x - expected).abs() < 1e-9 * size, "seed {seed}: {x} {expected}");
                }
                let flipped = if round == 1 && (rows * b) % 2 == 1 { -1.0 } else { 1.0 };
                assert_eq!(lu.determinant_sign(), flipped * determinant_sign(a.clone()), "seed {seed}");
                signs[usize::from(lu.determinant_sign() > 0.0)] += 1;
            }
        }
        assert!(signs.iter().all(|&count| count > 5), "both signs have to occur: {signs:?}");
    }

    #[test]
    fn a_singular_matrix_is_an_error_and_the_next_one_is_not() {
        let (start, column) = (vec![0, 2, 4], vec![0, 1, 0, 1]);
        let mut lu = SparseLu::new(1, &start, &column, Ordering::Natural);
        assert_eq!(lu.factorize(&[1.0, 2.0, 2.0, 4.0]), Err(LuError::ZeroPivot { row: 1 }));
        assert_eq!(lu.determinant_sign(), 0.0);
        // The first pivot is zero: rows are exchanged.
        lu.factorize(&[0.0, 2.0, 3.0, 1.0]).unwrap();
        assert_eq!(lu.determinant_sign(), -1.0);
        let mut x = [2.0, 5.0];
        lu.solve(&mut x);
        assert!((x[0] - 4.0 / 3.0).abs() < 1e-15 && (x[1] - 1.0).abs() < 1e-15);
        assert!(lu.factorize(&[f64::NAN, 2.0, 3.0, 1.0]).is_err());
    }

    #[test]
    fn an_empty_matrix_has_determinant_one() {
        let mut lu = SparseLu::new(6, &[0], &[], Ordering::NestedDissection);
        lu.factorize(&[]).unwrap();
        lu.solve(&mut []);
        assert_eq!(lu.determinant_sign(), 1.0);
    }
}
