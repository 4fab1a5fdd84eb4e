//! Dense column-major kernels: products, QR, thin SVD, Cholesky, LU, symmetric eigenproblem.
//!
//! Thin wrappers over faer, always serial (`Par::Seq`): the matrices of tensor-train cores are small, and
//! threads belong to the caller. Entry (i, j) of an m x n matrix is at `i + m * j`; a [`View`] may have a
//! larger distance between columns and may be transposed, so a reshape or a block of a core is never copied.

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::{cholesky, evd, householder, lu, matmul, qr, svd, triangular_inverse, triangular_solve};
use faer::prelude::ReborrowMut;
use faer::{Accum, Conj, MatMut, MatRef, Par};
use std::cell::RefCell;
use std::ops::Range;

/// What a dense factorization can meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DenseError {
    /// The singular value or eigenvalue iteration failed: an entry is infinite or not a number.
    #[error("the singular value or eigenvalue iteration failed: the matrix has an entry that is not finite")]
    NotFinite,
    /// A Cholesky pivot is not positive.
    #[error("the matrix is not positive definite: pivot {index} is not positive")]
    NotPositiveDefinite {
        /// Zero-based index of the pivot.
        index: usize,
    },
    /// A zero (or not finite) pivot in LU.
    #[error("the matrix is singular: pivot {index} is zero or not finite")]
    Singular {
        /// Zero-based index of the pivot.
        index: usize,
    },
}

/// Read-only column-major matrix over a slice.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    data: &'a [f64],
    rows: usize,
    columns: usize,
    stride: usize,
    transposed: bool,
}

impl<'a> View<'a> {
    /// A rows x columns matrix with its columns one after the other.
    ///
    /// # Panics
    /// If the slice is too short.
    #[inline]
    pub fn new(data: &'a [f64], rows: usize, columns: usize) -> Self {
        Self::with_stride(data, rows, columns, rows)
    }

    /// A rows x columns matrix with `stride` numbers from one column to the next.
    ///
    /// # Panics
    /// If the slice is too short.
    #[inline]
    pub fn with_stride(data: &'a [f64], rows: usize, columns: usize, stride: usize) -> Self {
        assert!(rows == 0 || columns == 0 || data.len() >= stride * (columns - 1) + rows, "slice too short");
        Self { data, rows, columns, stride, transposed: false }
    }

    /// The transpose, without moving data.
    #[inline]
    pub fn t(self) -> Self {
        Self { transposed: !self.transposed, ..self }
    }

    /// Number of rows.
    #[inline]
    pub fn rows(&self) -> usize {
        if self.transposed { self.columns } else { self.rows }
    }

    /// Number of columns.
    #[inline]
    pub fn columns(&self) -> usize {
        if self.transposed { self.rows } else { self.columns }
    }

    /// Rows and columns of these ranges.
    ///
    /// # Panics
    /// If a range is not within the matrix.
    #[inline]
    pub fn block(self, rows: Range<usize>, columns: Range<usize>) -> Self {
        assert!(rows.end <= self.rows() && columns.end <= self.columns(), "block within the matrix");
        let (inner, outer) = if self.transposed { (&columns, &rows) } else { (&rows, &columns) };
        let first =
            if inner.is_empty() || outer.is_empty() { 0 } else { inner.start + self.stride * outer.start };
        Self { data: &self.data[first..], rows: inner.len(), columns: outer.len(), ..self }
    }

    /// Whether all entries above the diagonal are zero. O(1) for most others, n^2 / 2 for a triangle.
    pub fn is_lower_triangular(&self) -> bool {
        (1..self.columns()).rev().all(|j| (0..j.min(self.rows())).all(|i| self.get(i, j) == 0.0))
    }

    /// Entry (i, j).
    #[inline]
    pub fn get(&self, i: usize, j: usize) -> f64 {
        if self.transposed { self.data[j + self.stride * i] } else { self.data[i + self.stride * j] }
    }

    #[inline]
    fn faer(&self) -> MatRef<'a, f64> {
        let stride = self.stride.max(self.rows);
        let matrix = MatRef::from_column_major_slice_with_stride(self.data, self.rows, self.columns, stride);
        if self.transposed { matrix.transpose() } else { matrix }
    }
}

/// Writable column-major matrix over a slice.
#[derive(Debug)]
pub struct ViewMut<'a> {
    data: &'a mut [f64],
    rows: usize,
    columns: usize,
    stride: usize,
}

impl<'a> ViewMut<'a> {
    /// A rows x columns matrix with its columns one after the other.
    ///
    /// # Panics
    /// If the slice is too short.
    #[inline]
    pub fn new(data: &'a mut [f64], rows: usize, columns: usize) -> Self {
        Self::with_stride(data, rows, columns, rows)
    }

    /// A rows x columns matrix with `stride` numbers from one column to the next.
    ///
    /// # Panics
    /// If the slice is too short.
    #[inline]
    pub fn with_stride(data: &'a mut [f64], rows: usize, columns: usize, stride: usize) -> Self {
        assert!(rows == 0 || columns == 0 || data.len() >= stride * (columns - 1) + rows, "slice too short");
        Self { data, rows, columns, stride }
    }

    #[inline]
    fn faer(self) -> MatMut<'a, f64> {
        let stride = self.stride.max(self.rows);
        MatMut::from_column_major_slice_with_stride_mut(self.data, self.rows, self.columns, stride)
    }
}

/// Owned column-major matrix: entry (i, j) at `i + rows * j`.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrix {
    rows: usize,
    columns: usize,
    data: Vec<f64>,
}

impl Matrix {
    /// All zeros.
    pub fn zeros(rows: usize, columns: usize) -> Self {
        Self { rows, columns, data: vec![0.0; rows * columns] }
    }

    /// From column-major data.
    ///
    /// # Panics
    /// If the length is not rows * columns.
    #[inline]
    pub fn from_vec(rows: usize, columns: usize, data: Vec<f64>) -> Self {
        assert_eq!(data.len(), rows * columns, "column-major data of a {rows} x {columns} matrix");
        Self { rows, columns, data }
    }

    /// The n x n identity.
    pub fn identity(n: usize) -> Self {
        let mut matrix = Self::zeros(n, n);
        matrix.data.iter_mut().step_by(n + 1).for_each(|x| *x = 1.0);
        matrix
    }

    /// From a function of (row, column).
    pub fn from_fn(rows: usize, columns: usize, mut entry: impl FnMut(usize, usize) -> f64) -> Self {
        let mut data = Vec::with_capacity(rows * columns);
        for j in 0..columns {
            data.extend((0..rows).map(|i| entry(i, j)));
        }
        Self { rows, columns, data }
    }

    /// Number of rows.
    #[inline]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    #[inline]
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Column-major data.
    #[inline]
    pub fn data(&self) -> &[f64] {
        &self.data
    }

    /// Column-major data, writable.
    #[inline]
    pub fn data_mut(&mut self) -> &mut [f64] {
        &mut self.data
    }

    /// The data, for a reshape without a copy.
    #[inline]
    pub fn into_vec(self) -> Vec<f64> {
        self.data
    }

    /// Column j.
    #[inline]
    pub fn column(&self, j: usize) -> &[f64] {
        &self.data[j * self.rows..(j + 1) * self.rows]
    }

    /// The matrix as a view.
    #[inline]
    pub fn view(&self) -> View<'_> {
        View::new(&self.data, self.rows, self.columns)
    }

    /// The transpose as a view.
    #[inline]
    pub fn t(&self) -> View<'_> {
        self.view().t()
    }

    /// The first `columns` columns as a view.
    #[inline]
    pub fn first_columns(&self, columns: usize) -> View<'_> {
        View::new(&self.data, self.rows, columns)
    }

    /// The matrix as a writable view.
    #[inline]
    pub fn view_mut(&mut self) -> ViewMut<'_> {
        ViewMut::new(&mut self.data, self.rows, self.columns)
    }

    /// Keeps the first `columns` columns.
    pub fn truncate_columns(&mut self, columns: usize) {
        self.columns = self.columns.min(columns);
        self.data.truncate(self.rows * self.columns);
    }

    /// The transpose, copied.
    pub fn transposed(&self) -> Self {
        Self::from_fn(self.columns, self.rows, |i, j| self[(j, i)])
    }
}

impl std::ops::Index<(usize, usize)> for Matrix {
    type Output = f64;
    #[inline]
    fn index(&self, (i, j): (usize, usize)) -> &f64 {
        &self.data[i + self.rows * j]
    }
}

impl std::ops::IndexMut<(usize, usize)> for Matrix {
    #[inline]
    fn index_mut(&mut self, (i, j): (usize, usize)) -> &mut f64 {
        &mut self.data[i + self.rows * j]
    }
}

/// Scratch memory of faer, one growing buffer per thread.
fn with_scratch<T>(need: StackReq, run: impl FnOnce(&mut MemStack) -> T) -> T {
    thread_local!(static BUFFER: RefCell<(usize, Option<MemBuffer>)> = const { RefCell::new((0, None)) });
    let result = BUFFER.with_borrow_mut(|(size, buffer)| {
        if buffer.is_none() || *size < need.unaligned_bytes_required() {
            *size = need.unaligned_bytes_required().max(1 << 16);
            *buffer = Some(MemBuffer::new(StackReq::new_aligned::<u8>(*size, need.align_bytes().max(128))));
        }
        match buffer {
            Some(buffer) => run(MemStack::new(buffer)),
            None => run(MemStack::new(&mut MemBuffer::new(need))),
        }
    });
    clear_wide_registers();
    result
}

/// Zeroes the upper halves of the vector registers, which the kernels of products leave in use: until then
/// SSE instructions wait for them, and loops compiled for plain x86-64 that follow a product take 1.7 times
/// as long (measured on an EPYC with AVX-512, product of a TT-matrix and a TT-vector).
#[inline]
fn clear_wide_registers() {
    #[cfg(target_arch = "x86_64")]
    if std::is_x86_feature_detected!("avx") {
        // SAFETY: the processor has the instruction, and no caller may expect upper halves to survive a call.
        #[allow(unsafe_code)]
        unsafe {
            std::arch::x86_64::_mm256_zeroupper();
        }
    }
}

/// C <- alpha A B.
///
/// # Panics
/// If the shapes do not fit.
#[inline]
pub fn multiply(alpha: f64, a: View<'_>, b: View<'_>, c: ViewMut<'_>) {
    matmul::matmul(c.faer(), Accum::Replace, a.faer(), b.faer(), alpha, Par::Seq);
    clear_wide_registers();
}

/// C <- C + alpha A B.
///
/// # Panics
/// If the shapes do not fit.
#[inline]
pub fn multiply_add(alpha: f64, a: View<'_>, b: View<'_>, c: ViewMut<'_>) {
    matmul::matmul(c.faer(), Accum::Add, a.faer(), b.faer(), alpha, Par::Seq);
    clear_wide_registers();
}

/// A B as a new matrix.
///
/// # Panics
/// If the shapes do not fit.
pub fn product(a: View<'_>, b: View<'_>) -> Matrix {
    let mut c = Matrix::zeros(a.rows(), b.columns());
    multiply(1.0, a, b, c.view_mut());
    c
}

/// Thin QR, A = Q R: Q is m x min(m, n) with orthonormal columns, R is min(m, n) x n upper triangular
/// (trapezoidal).
///
/// A matrix without full rank still gets orthonormal columns. Cost 4 m n^2 flops for m >= n.
pub fn thin_qr(a: Matrix) -> (Matrix, Matrix) {
    let (m, n) = (a.rows, a.columns);
    let size = m.min(n);
    if size == 0 {
        return (Matrix::zeros(m, 0), Matrix::zeros(0, n));
    }
    let (a, factor) = householder_qr(a);
    let block = factor.rows;
    let r = upper_triangle(&a, size);
    let mut q = Matrix::zeros(m, size);
    q.data.iter_mut().step_by(m + 1).for_each(|x| *x = 1.0);
    let need =
        householder::apply_block_householder_sequence_on_the_left_in_place_scratch::<f64>(m, block, size);
    with_scratch(need, |stack| {
        householder::apply_block_householder_sequence_on_the_left_in_place_with_conj(
            a.first_columns(size).faer(),
            factor.view().faer(),
            Conj::No,
            q.view_mut().faer(),
            Par::Seq,
            stack,
        )
    });
    (q, r)
}

/// The factor R of [`thin_qr`] alone, without forming Q: half the cost.
pub fn qr_triangle(a: Matrix) -> Matrix {
    let size = a.rows.min(a.columns);
    if size == 0 {
        return Matrix::zeros(0, a.columns);
    }
    upper_triangle(&householder_qr(a).0, size)
}

/// The first `size` rows on and above the diagonal.
fn upper_triangle(a: &Matrix, size: usize) -> Matrix {
    Matrix::from_fn(size, a.columns, |i, j| if i <= j { a[(i, j)] } else { 0.0 })
}

/// Householder vectors below the diagonal with R above it, and the block factors that belong to them.
fn householder_qr(mut a: Matrix) -> (Matrix, Matrix) {
    let (m, n) = (a.rows, a.columns);
    let block = qr::no_pivoting::factor::recommended_block_size::<f64>(m, n);
    let mut factor = Matrix::zeros(block, m.min(n));
    let need = qr::no_pivoting::factor::qr_in_place_scratch::<f64>(m, n, block, Par::Seq, Default::default());
    with_scratch(need, |stack| {
        qr::no_pivoting::factor::qr_in_place(
            a.view_mut().faer(),
            factor.view_mut().faer(),
            Par::Seq,
            stack,
            Default::default(),
        )
    });
    (a, factor)
}

/// Thin singular value decomposition A = U diag(s) V^T.
#[derive(Clone, Debug)]
pub struct Svd {
    /// Left singular vectors, m x min(m, n).
    pub u: Matrix,
    /// Singular values, descending.
    pub s: Vec<f64>,
    /// Right singular vectors, n x min(m, n) (not transposed).
    pub v: Matrix,
}

/// Thin SVD.
///
/// # Errors
/// [`DenseError::NotFinite`] if an entry is not finite.
pub fn thin_svd(a: View<'_>) -> Result<Svd, DenseError> {
    let (m, n) = (a.rows(), a.columns());
    let size = m.min(n);
    let (mut u, mut s, mut v) = (Matrix::zeros(m, size), vec![0.0; size], Matrix::zeros(n, size));
    if size == 0 {
        return Ok(Svd { u, s, v });
    }
    let thin = svd::ComputeSvdVectors::Thin;
    let need = svd::svd_scratch::<f64>(m, n, thin, thin, Par::Seq, Default::default());
    with_scratch(need, |stack| {
        svd::svd(
            a.faer(),
            faer::diag::DiagMut::from_slice_mut(&mut s),
            Some(u.view_mut().faer()),
            Some(v.view_mut().faer()),
            Par::Seq,
            stack,
            Default::default(),
        )
    })
    .map_err(|_| DenseError::NotFinite)?;
    if s.iter().all(|x| x.is_finite()) { Ok(Svd { u, s, v }) } else { Err(DenseError::NotFinite) }
}

/// Left singular vectors (m x min(m, n)) and singular values (descending), without the right ones.
///
/// # Errors
/// [`DenseError::NotFinite`] if an entry is not finite.
pub fn left_svd(a: View<'_>) -> Result<(Matrix, Vec<f64>), DenseError> {
    let (m, n) = (a.rows(), a.columns());
    let size = m.min(n);
    let (mut u, mut s) = (Matrix::zeros(m, size), vec![0.0; size]);
    if size == 0 {
        return Ok((u, s));
    }
    let (thin, none) = (svd::ComputeSvdVectors::Thin, svd::ComputeSvdVectors::No);
    let need = svd::svd_scratch::<f64>(m, n, thin, none, Par::Seq, Default::default());
    with_scratch(need, |stack| {
        svd::svd(
            a.faer(),
            faer::diag::DiagMut::from_slice_mut(&mut s),
            Some(u.view_mut().faer()),
            None,
            Par::Seq,
            stack,
            Default::default(),
        )
    })
    .map_err(|_| DenseError::NotFinite)?;
    if s.iter().all(|x| x.is_finite()) { Ok((u, s)) } else { Err(DenseError::NotFinite) }
}

/// Eigenvalues (ascending) and orthonormal eigenvectors (columns) of a symmetric matrix; reads the lower
/// triangle.
///
/// # Errors
/// [`DenseError::NotFinite`] if an entry is not finite.
pub fn symmetric_eigen(a: View<'_>) -> Result<(Vec<f64>, Matrix), DenseError> {
    let n = a.rows();
    let (mut values, mut vectors) = (vec![0.0; n], Matrix::zeros(n, n));
    let yes = evd::ComputeEigenvectors::Yes;
    let need = evd::self_adjoint_evd_scratch::<f64>(n, yes, Par::Seq, Default::default());
    with_scratch(need, |stack| {
        evd::self_adjoint_evd(
            a.faer(),
            faer::diag::DiagMut::from_slice_mut(&mut values),
            Some(vectors.view_mut().faer()),
            Par::Seq,
            stack,
            Default::default(),
        )
    })
    .map_err(|_| DenseError::NotFinite)?;
    if values.iter().all(|x| x.is_finite()) { Ok((values, vectors)) } else { Err(DenseError::NotFinite) }
}

/// Cholesky factorization A = L L^T.
#[derive(Clone, Debug)]
pub struct Cholesky {
    lower: Matrix,
}

impl Cholesky {
    /// Factors a symmetric positive definite matrix; reads its lower triangle.
    ///
    /// # Errors
    /// [`DenseError::NotPositiveDefinite`] with the pivot that is not positive.
    pub fn new(mut a: Matrix) -> Result<Self, DenseError> {
        let n = a.rows;
        let need = cholesky::llt::factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default());
        with_scratch(need, |stack| {
            cholesky::llt::factor::cholesky_in_place(
                a.view_mut().faer(),
                Default::default(),
                Par::Seq,
                stack,
                Default::default(),
            )
        })
        .map_err(|error| match error {
            cholesky::llt::factor::LltError::NonPositivePivot { index } => {
                DenseError::NotPositiveDefinite { index }
            }
        })?;
        Ok(Self { lower: a })
    }

    /// B <- A^-1 B.
    pub fn solve_in_place(&self, b: ViewMut<'_>) {
        with_scratch(StackReq::EMPTY, |stack| {
            cholesky::llt::solve::solve_in_place(self.lower.view().faer(), b.faer(), Par::Seq, stack);
        });
    }

    /// The factor L (the strict upper triangle holds rubbish).
    pub fn lower(&self) -> &Matrix {
        &self.lower
    }

    /// L^-1, with zeros above the diagonal. n^3 / 3 flops.
    pub fn inverse_of_lower(&self) -> Matrix {
        let mut inverse = Matrix::zeros(self.lower.rows, self.lower.rows);
        triangular_inverse::invert_lower_triangular(
            inverse.view_mut().faer(),
            self.lower.view().faer(),
            Par::Seq,
        );
        clear_wide_registers();
        inverse
    }
}

/// LU factorization with row pivoting, P A = L U.
#[derive(Clone, Debug)]
pub struct Lu {
    factors: Matrix,
    row: Vec<usize>,
    row_inverse: Vec<usize>,
}

impl Lu {
    /// Factors an m x n matrix with m >= n (square for solving).
    ///
    /// # Errors
    /// [`DenseError::Singular`] if a pivot is zero or not finite.
    pub fn new(mut a: Matrix) -> Result<Self, DenseError> {
        let (m, n) = (a.rows, a.columns);
        let (mut row, mut row_inverse) = (vec![0; m], vec![0; m]);
        let need = lu::partial_pivoting::factor::lu_in_place_scratch::<usize, f64>(
            m,
            n,
            Par::Seq,
            Default::default(),
        );
        with_scratch(need, |stack| {
            lu::partial_pivoting::factor::lu_in_place(
                a.view_mut().faer(),
                &mut row,
                &mut row_inverse,
                Par::Seq,
                stack,
                Default::default(),
            );
        });
        match (0..m.min(n)).find(|&i| a[(i, i)] == 0.0 || !a[(i, i)].is_finite()) {
            Some(index) => Err(DenseError::Singular { index }),
            None => Ok(Self { factors: a, row, row_inverse }),
        }
    }

    /// Row of A that became row i of P A.
    pub fn pivot_rows(&self) -> &[usize] {
        &self.row
    }

    /// B <- A^-1 B for a square A.
    pub fn solve_in_place(&self, b: ViewMut<'_>) {
        let n = self.factors.rows;
        let need = lu::partial_pivoting::solve::solve_in_place_scratch::<usize, f64>(n, b.columns, Par::Seq);
        let permutation = faer::perm::PermRef::new_checked(&self.row, &self.row_inverse, n);
        let factors = self.factors.view().faer();
        with_scratch(need, |stack| {
            lu::partial_pivoting::solve::solve_in_place(
                factors,
                factors,
                permutation,
                b.faer(),
                Par::Seq,
                stack,
            );
        });
    }
}

/// X <- X U^-1 with U the upper triangle of a square matrix.
pub fn solve_upper_on_the_right(x: ViewMut<'_>, u: View<'_>) {
    let mut x = x.faer();
    triangular_solve::solve_lower_triangular_in_place(u.t().faer(), x.rb_mut().transpose_mut(), Par::Seq);
    clear_wide_registers();
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::triangles::gram;

    /// Entries in [-1, 1] from a fixed sequence.
    pub(crate) fn sample(rows: usize, columns: usize, seed: u64) -> Matrix {
        let mut state = seed;
        Matrix::from_fn(rows, columns, |_, _| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        })
    }

    pub(crate) fn largest_difference(a: &Matrix, b: &Matrix) -> f64 {
        assert_eq!((a.rows, a.columns), (b.rows, b.columns));
        a.data.iter().zip(&b.data).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
    }

    pub(crate) fn naive(a: &Matrix, b: &Matrix) -> Matrix {
        Matrix::from_fn(a.rows, b.columns, |i, j| (0..a.columns).map(|k| a[(i, k)] * b[(k, j)]).sum())
    }

    #[test]
    fn products_equal_the_triple_loop() {
        for (m, k, n) in [(1, 1, 1), (3, 5, 2), (17, 9, 33), (64, 40, 40), (5, 0, 4)] {
            let (a, b) = (sample(m, k, 1), sample(k, n, 2));
            let expected = naive(&a, &b);
            assert!(largest_difference(&product(a.view(), b.view()), &expected) < 1e-13 * (k + 1) as f64);
            let (at, bt) = (a.transposed(), b.transposed());
            assert!(largest_difference(&product(at.t(), bt.t()), &expected) < 1e-13 * (k + 1) as f64);
            let mut c = expected.clone();
            multiply_add(-1.0, a.view(), b.view(), c.view_mut());
            assert!(c.data.iter().all(|x| x.abs() < 1e-13 * (k + 1) as f64));
        }
    }

    #[test]
    fn a_strided_view_is_a_block() {
        let a = sample(7, 6, 3);
        let block = View::with_stride(&a.data()[2..], 4, 6, 7);
        let copy = Matrix::from_fn(4, 6, |i, j| a[(i + 2, j)]);
        let b = sample(6, 3, 4);
        assert_eq!(product(block, b.view()), product(copy.view(), b.view()));
    }

    #[test]
    fn triangles_are_distinguished_from_squares() {
        for n in [1, 2, 9] {
            let square = sample(n, n, 2);
            let t = Matrix::from_fn(n, n, |i, j| if i >= j { square[(i, j)] } else { 0.0 });
            assert!(t.view().is_lower_triangular());
            assert_eq!(t.t().is_lower_triangular(), n == 1);
        }
        assert!(!sample(4, 4, 3).view().is_lower_triangular());
        assert!(Matrix::zeros(0, 0).view().is_lower_triangular());
    }

    #[test]
    fn the_inverse_of_a_factor_is_its_inverse() {
        for n in [1, 2, 17, 60] {
            let half = sample(2 * n, n, 12);
            let factor = Cholesky::new(gram(half.view())).unwrap();
            let lower = Matrix::from_fn(n, n, |i, j| if i >= j { factor.lower()[(i, j)] } else { 0.0 });
            let inverse = factor.inverse_of_lower();
            assert!(inverse.view().is_lower_triangular());
            assert!(largest_difference(&naive(&lower, &inverse), &Matrix::identity(n)) < 1e-11);
        }
    }

    #[test]
    fn half_factorizations_equal_the_whole_ones() {
        for (m, n) in [(1, 1), (8, 3), (3, 8), (40, 40), (100, 17)] {
            let a = sample(m, n, 9);
            assert_eq!(qr_triangle(a.clone()), thin_qr(a.clone()).1);
            let (u, s) = left_svd(a.view()).unwrap();
            let whole = thin_svd(a.view()).unwrap();
            assert!(s.iter().zip(&whole.s).all(|(x, y)| (x - y).abs() < 1e-13 * whole.s[0]));
            // U spans the columns of A, and U^T A A^T U is diagonal with the squares of s.
            let projected = product(u.view(), product(u.t(), a.view()).view());
            assert!(largest_difference(&projected, &a) < 1e-13 * s[0]);
            let gram = product(product(u.t(), a.view()).view(), product(a.t(), u.view()).view());
            for i in 0..s.len() {
                assert!((gram[(i, i)] - s[i] * s[i]).abs() < 1e-12 * s[0] * s[0]);
            }
        }
        assert!(left_svd(Matrix::from_fn(3, 3, |_, _| f64::NAN).view()).is_err());
    }

    #[test]
    fn qr_is_orthonormal_and_exact_also_without_full_rank() {
        for (m, n) in [(1, 1), (8, 3), (3, 8), (40, 40), (100, 17)] {
            let mut a = sample(m, n, 6);
            if n > 2 {
                let first = a.column(0).to_vec();
                a.data_mut()[m..2 * m].copy_from_slice(&first);
            }
            let (q, r) = thin_qr(a.clone());
            assert!(largest_difference(&product(q.view(), r.view()), &a) < 1e-13);
            assert!(largest_difference(&product(q.t(), q.view()), &Matrix::identity(m.min(n))) < 1e-13);
        }
        let (q, r) = thin_qr(Matrix::zeros(5, 2));
        assert_eq!(product(q.view(), r.view()), Matrix::zeros(5, 2));
        assert!(largest_difference(&product(q.t(), q.view()), &Matrix::identity(2)) < 1e-15);
    }

    #[test]
    fn svd_rebuilds_the_matrix_with_descending_values() {
        for (m, n) in [(1, 1), (9, 4), (4, 9), (60, 20), (3, 3)] {
            let a = sample(m, n, 7);
            let Svd { mut u, s, v } = thin_svd(a.view()).unwrap();
            assert!(s.windows(2).all(|pair| pair[0] >= pair[1]));
            for (j, s) in s.iter().enumerate() {
                u.data_mut()[j * m..(j + 1) * m].iter_mut().for_each(|x| *x *= s);
            }
            assert!(largest_difference(&product(u.view(), v.t()), &a) < 1e-13);
        }
        let mut bad = sample(4, 4, 8);
        bad[(1, 2)] = f64::NAN;
        assert_eq!(thin_svd(bad.view()).unwrap_err(), DenseError::NotFinite);
    }

    #[test]
    fn eigenvalues_of_the_second_difference_are_known() {
        let n = 12;
        let a = Matrix::from_fn(n, n, |i, j| match i.abs_diff(j) {
            0 => 2.0,
            1 => -1.0,
            _ => 0.0,
        });
        let (values, vectors) = symmetric_eigen(a.view()).unwrap();
        for (k, value) in values.iter().enumerate() {
            let angle = std::f64::consts::PI * (k + 1) as f64 / (2 * (n + 1)) as f64;
            assert!((value - 4.0 * angle.sin().powi(2)).abs() < 1e-13);
        }
        let scaled = Matrix::from_fn(n, n, |i, j| vectors[(i, j)] * values[j]);
        assert!(largest_difference(&product(a.view(), vectors.view()), &scaled) < 1e-13);
    }

    #[test]
    fn cholesky_and_lu_solve_and_name_the_bad_pivot() {
        let n = 23;
        let half = sample(n, n, 9);
        let mut spd = gram(half.view());
        spd.data.iter_mut().step_by(n + 1).for_each(|x| *x += 0.1);
        let x = sample(n, 4, 10);
        let mut b = product(spd.view(), x.view());
        Cholesky::new(spd.clone()).unwrap().solve_in_place(b.view_mut());
        assert!(largest_difference(&b, &x) < 1e-9);
        let mut b = product(half.view(), x.view());
        Lu::new(half.clone()).unwrap().solve_in_place(b.view_mut());
        assert!(largest_difference(&b, &x) < 1e-9);
        spd[(4, 4)] = -1.0;
        assert_eq!(Cholesky::new(spd).unwrap_err(), DenseError::NotPositiveDefinite { index: 4 });
        assert_eq!(Lu::new(Matrix::zeros(3, 3)).unwrap_err(), DenseError::Singular { index: 0 });
    }

    #[test]
    fn triangular_solve_from_the_right() {
        let u = Matrix::from_fn(5, 5, |i, j| if i <= j { 1.0 + (i + 2 * j) as f64 } else { 0.0 });
        let x = sample(7, 5, 11);
        let mut y = product(x.view(), u.view());
        solve_upper_on_the_right(y.view_mut(), u.view());
        assert!(largest_difference(&y, &x) < 1e-12);
    }
}
