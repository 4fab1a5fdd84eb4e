//! Sparse Cholesky factorisation of symmetric block matrices: faer's, in an order of blocks.
//!
//! The matrix is analysed once per pattern ([`SparseCholesky::new`]) and factorised many times. Bodies and
//! contacts are ordered, not scalars (6x6 blocks in body space, 3x3 in contact space): that is 9 or 36 times
//! less to look at, and in three dimensions nested dissection halves the time of a factorisation against the
//! minimum degree order of scalars that faer has (`docs/newton-solvers.md`).

use crate::ordering::{Graph, Ordering};
use crate::supernodes::Supernodes;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::Perm;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side, Spec};

/// Why a matrix could not be factorised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CholeskyError {
    /// A pivot was not positive (or not a number): the matrix is not numerically positive definite.
    #[error("the matrix is not positive definite: a pivot is not positive")]
    NotPositiveDefinite,
    /// The factor has more entries than memory can be asked for.
    #[error("the factor is too large")]
    TooLarge,
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
    /// Starts of the scalar columns of the lower triangle, their rows, and where in the blocks their values
    /// are.
    column_start: Vec<usize>,
    row: Vec<usize>,
    source: Vec<usize>,
    lower: Vec<f64>,
    symbolic: Option<SymbolicCholesky<usize>>,
    values: Vec<f64>,
    memory: MemBuffer,
}

impl SparseCholesky {
    /// Analyses a symmetric matrix of `block_size` x `block_size` blocks in compressed row form. Of each pair
    /// of mirrored blocks only the lower one (column <= row) is read; the upper ones may be stored or not. No
    /// block is stored twice, and every diagonal block is stored.
    ///
    /// # Panics
    /// If the row starts do not fit the columns, or a column index is not below the number of rows.
    pub fn new(block_size: usize, row_start: &[usize], column: &[u32], ordering: Ordering) -> Self {
        let (b, rows) = (block_size, row_start.len() - 1);
        let n = b * rows;
        let order = ordering.order(&Graph::of_lower(row_start, column));
        let mut blocks: Vec<Vec<(usize, usize)>> = vec![Vec::new(); rows];
        for i in 0..rows {
            for k in row_start[i]..row_start[i + 1] {
                if column[k] as usize <= i {
                    blocks[column[k] as usize].push((i, k));
                }
            }
        }
        let (mut column_start, mut row, mut source) = (vec![0], Vec::new(), Vec::new());
        for (j, blocks) in blocks.iter().enumerate() {
            for c in 0..b {
                for &(i, k) in blocks {
                    for r in if i == j { c..b } else { 0..b } {
                        row.push(b * i + r);
                        source.push((k * b + r) * b + c);
                    }
                }
                column_start.push(row.len());
            }
        }
        let forward: Vec<usize> =
            order.iter().flat_map(|&v| (0..b).map(move |d| b * v as usize + d)).collect();
        let mut inverse = vec![0; n];
        forward.iter().enumerate().for_each(|(k, &v)| inverse[v] = k);
        let order = Perm::new_checked(forward.into_boxed_slice(), inverse.into_boxed_slice(), n);
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &column_start, None, &row);
        let ordering = SymmetricOrdering::Custom(order.as_ref());
        let parameters = CholeskySymbolicParams::default();
        // Only a factor larger than memory ends in an error here.
        let symbolic = factorize_symbolic_cholesky(pattern, Side::Lower, ordering, parameters).ok();
        let (entries, scratch) = symbolic.as_ref().map_or((0, StackReq::EMPTY), |symbolic| {
            let factor = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default());
            (symbolic.len_val(), factor.or(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq)))
        });
        Self {
            lower: vec![0.0; row.len()],
            column_start,
            row,
            source,
            symbolic,
            values: vec![0.0; entries],
            memory: MemBuffer::new(scratch),
        }
    }

    /// Scalar dimension of the matrix.
    pub fn dimension(&self) -> usize {
        self.column_start.len() - 1
    }

    /// Scalar entries stored for the factor.
    pub fn entries(&self) -> usize {
        self.values.len()
    }

    /// Factorises the matrix whose blocks (row-major, in the order of the pattern given to [`Self::new`]) are
    /// concatenated in `blocks`.
    ///
    /// # Errors
    /// [`CholeskyError`]; the factor is then unusable until the next success.
    ///
    /// # Panics
    /// If `blocks` is shorter than the pattern.
    pub fn factorize(&mut self, blocks: &[f64]) -> Result<(), CholeskyError> {
        let n = self.dimension();
        let Some(symbolic) = &self.symbolic else { return Err(CholeskyError::TooLarge) };
        self.lower.iter_mut().zip(&self.source).for_each(|(value, &k)| *value = blocks[k]);
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &self.column_start, None, &self.row);
        symbolic
            .factorize_numeric_llt(
                &mut self.values,
                SparseColMatRef::new(pattern, &self.lower),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut self.memory),
                Spec::default(),
            )
            .map(|_| ())
            .map_err(|_| CholeskyError::NotPositiveDefinite)
    }

    /// x <- A^-1 x with the last factorisation.
    ///
    /// # Panics
    /// If x does not have the dimension of the matrix.
    pub fn solve(&mut self, x: &mut [f64]) {
        let n = self.dimension();
        assert_eq!(x.len(), n, "the right-hand side has the dimension of the matrix");
        let Some(symbolic) = &self.symbolic else { return };
        let x = MatMut::from_column_major_slice_mut(x, n, 1);
        let stack = MemStack::new(&mut self.memory);
        LltRef::new(symbolic, &self.values).solve_in_place_with_conj(Conj::No, x, Par::Seq, stack);
    }
}

/// Work and memory a factorisation in this order would need, without any numeric storage.
pub fn predicted_cost(
    block_size: usize,
    row_start: &[usize],
    column: &[u32],
    ordering: Ordering,
) -> FactorCost {
    factor_cost(&Supernodes::new(&Graph::of_lower(row_start, column), ordering, block_size), block_size)
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
    fn matrices_that_are_not_positive_definite_are_refused() {
        let blocks = [1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, -1.0];
        let mut factor = SparseCholesky::new(2, &[0, 1, 2], &[0, 1], Ordering::Natural);
        assert_eq!(factor.factorize(&blocks), Err(CholeskyError::NotPositiveDefinite));
        // Large enough for supernodes; afterwards a sound matrix is factorised as ever.
        let (start, column, blocks) = random_matrix(300, 6, 900, 5);
        let mut factor = SparseCholesky::new(6, &start, &column, Ordering::NestedDissection);
        for wrong in [-1.0, f64::NAN] {
            let mut broken = blocks.clone();
            broken[36 * (start[201] - 1) + 7 * 3] = wrong;
            assert_eq!(factor.factorize(&broken), Err(CholeskyError::NotPositiveDefinite));
        }
        factor.factorize(&blocks).unwrap();
        let exact: Vec<f64> = (0..1800).map(|k| f64::sin(f64::from(k))).collect();
        let mut x = times(6, &start, &column, &blocks, &exact);
        factor.solve(&mut x);
        assert!(x.iter().zip(&exact).all(|(x, exact)| (x - exact).abs() < 1e-9));
    }
}
