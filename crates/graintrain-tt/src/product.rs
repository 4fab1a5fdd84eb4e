//! Products within a tolerance, whose cores of rank R r are never formed.
//!
//! Rounding needs a train only through products of its cores with matrices from the left and from the right
//! (`cores.rs`). The cores of A X are sums over j of A(i, j) (x) X(j, s), and a product with such a core is a
//! product with that of X and one with that of A: O(t n (m R^2 r + s r^2 R)) for t rows instead of O(t m s
//! R^2 r^2), and no R^2 r^2 m s numbers in memory. Everything else, the error promise included, is that of
//! [`TtVector::round`].

use crate::cores::{Cores, core_exponent, squared};
use crate::round::round_cores;
use crate::vector::Core;
use crate::{Truncation, TruncationReport, TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{DenseError, Matrix, View, ViewMut, multiply};

/// A X, or A x with one spectator: rank indices (a, alpha) with that of A fastest, modes (i, s).
pub(crate) struct Product<'a> {
    pub(crate) a: &'a TtMatrix,
    pub(crate) x: &'a TtVector,
    pub(crate) spectators: &'a [usize],
}

impl Product<'_> {
    /// Core k of A and of X as 2^-exponent times themselves, exponents chosen by [`core_exponent`] (0 for a
    /// zero core), and what is left of `power` after both.
    fn scaled(&self, k: usize, power: i32) -> (Core, Core, i32) {
        let exponent = |core: &Core| core_exponent(core).ok().flatten().unwrap_or(0);
        let (a, x) = (&self.a.cores()[k], &self.x.cores[k]);
        let (p, q) = (exponent(a), exponent(x));
        (a.scaled(-p), x.scaled(-q), power + p + q)
    }
}

impl Cores for Product<'_> {
    fn modes(&self) -> Vec<usize> {
        self.a.rows.iter().zip(self.spectators).map(|(m, s)| m * s).collect()
    }

    fn exponent(&self, k: usize) -> Result<Option<i32>, DenseError> {
        let (a, x) = (core_exponent(&self.a.cores()[k])?, core_exponent(&self.x.cores[k])?);
        Ok(a.zip(x).map(|(a, x)| a + x))
    }

    fn ranks(&self, k: usize) -> (usize, usize) {
        let (a, x) = (&self.a.cores()[k], &self.x.cores[k]);
        (a.left * x.left, a.right * x.right)
    }

    fn weighted_square(&self, k: usize, left: &[f64], right: &[f64], power: i32) -> f64 {
        let (a, x, power) = self.scaled(k, power);
        let (n, s) = (self.a.columns[k], self.spectators[k]);
        // (sum of n terms)^2 <= n times the sum of the squares.
        let row = times_product(View::new(left, 1, left.len()), &squared(&a, 0), &squared(&x, 0), n, s);
        let sum = |(block, r): (&[f64], &f64)| r * block.iter().sum::<f64>();
        let total: f64 = row.data.chunks_exact(row.mode).zip(right).map(sum).sum();
        total * n as f64 * f64::from(2 * power).exp2()
    }

    fn multiply_left(&self, k: usize, matrix: View<'_>, power: i32, _memory: Vec<f64>) -> Core {
        let (a, x, power) = self.scaled(k, power);
        times_product(matrix, &a, &x, self.a.columns[k], self.spectators[k]).into_scaled(power)
    }

    fn multiply_right(&self, k: usize, matrix: View<'_>, power: i32, _memory: Vec<f64>) -> Core {
        let (a, x, power) = self.scaled(k, power);
        let (m, n, s, t) = (self.a.rows[k], self.a.columns[k], self.spectators[k], matrix.columns());
        // A((a, i, j), a') M(a', (alpha', t)) = Z(a, i, j, alpha', t)
        let numbers: Vec<f64> =
            (0..t).flat_map(|c| (0..matrix.rows()).map(move |r| matrix.get(r, c))).collect();
        let z = a.multiply_right(View::new(&numbers, a.right, x.right * t));
        // Z((a, i), (j, alpha')) X((j, alpha'), (alpha, s)) for every t
        let turned = Matrix::from_fn(n * x.right, x.left * s, |row, column| {
            x.get(column % x.left, row % n + n * (column / x.left), row / n)
        });
        let (block, result) = (a.left * m * n * x.right, a.left * m * x.left * s);
        let mut data = vec![0.0; result * t];
        for (from, to) in z.data.chunks_exact(block).zip(data.chunks_exact_mut(result)) {
            let from = View::new(from, a.left * m, n * x.right);
            multiply(1.0, from, turned.view(), ViewMut::new(to, a.left * m, x.left * s));
        }
        // (a, i, alpha, s, t) to (a, alpha, i, s, t)
        let data = exchange(data, a.left, m, x.left);
        Core { left: a.left * x.left, mode: m * s, right: t, data }.into_scaled(power)
    }
}

/// M times the core sum_j A(a, i, j, a') X(alpha, j, s, alpha') for n values of j, the columns of M being (a,
/// alpha).
fn times_product(matrix: View<'_>, a: &Core, x: &Core, n: usize, s: usize) -> Core {
    let (m, t) = (a.mode / n, matrix.rows());
    // M(t, (a, alpha)) X(alpha, (j, s, alpha')) = Z(t, a, j, s, alpha')
    let numbers: Vec<f64> =
        (0..matrix.columns()).flat_map(|c| (0..t).map(move |r| matrix.get(r, c))).collect();
    let rows = Core { left: t * a.left, mode: 1, right: x.left, data: numbers };
    let z = rows.multiply_right(x.right_unfolding());
    // Z(t, (a, j)) A((a, j), (i, a')) for every s and alpha'
    let turned = Matrix::from_fn(a.left * n, m * a.right, |row, column| {
        a.get(row % a.left, column % m + m * (row / a.left), column / m)
    });
    let (block, result) = (t * a.left * n, t * m * a.right);
    let mut data = vec![0.0; result * s * x.right];
    for (from, to) in z.data.chunks_exact(block).zip(data.chunks_exact_mut(result)) {
        multiply(1.0, View::new(from, t, a.left * n), turned.view(), ViewMut::new(to, t, m * a.right));
    }
    // (t, i, a', s, alpha') to (t, i, s, a', alpha')
    let data = exchange(data, t * m, a.right, s);
    Core { left: t, mode: m * s, right: a.right * x.right, data }
}

/// Exchanges the second and third index of numbers (p, q, r, ...), first index fastest.
fn exchange(data: Vec<f64>, p: usize, q: usize, r: usize) -> Vec<f64> {
    if q == 1 || r == 1 {
        return data;
    }
    let mut exchanged = Vec::with_capacity(data.len());
    for block in data.chunks_exact(p * q * r) {
        for second in 0..q {
            (0..r).for_each(|third| exchanged.extend_from_slice(&block[p * (second + q * third)..][..p]));
        }
    }
    exchanged
}

impl TtMatrix {
    /// A x within the truncation, without the cores of rank R r: the ranks and the error promise of
    /// `self.times_vector(x)?.round(truncation)`.
    ///
    /// # Errors
    /// As for [`TtMatrix::times_vector`] and [`TtVector::round`].
    ///
    /// ```
    /// use graintrain_tt::{Truncation, qtt};
    /// // The second difference of a sine is a multiple of it, but for the ends.
    /// let (a, x) = (qtt::laplacian(20)?, qtt::sine(20, 1e-3, 0.0)?);
    /// let (y, report) = a.times_vector_rounded(&x, &Truncation::to(1e-10))?;
    /// assert!(y.max_rank() <= 4 && report.error <= 1e-10);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn times_vector_rounded(
        &self,
        x: &TtVector,
        truncation: &Truncation,
    ) -> Result<(TtVector, TruncationReport), TtError> {
        self.check_columns(x)?;
        round_cores(&Product { a: self, x, spectators: &vec![1; self.num_cores()] }, truncation)
    }

    /// A B within the truncation, without the cores of rank R r; see [`TtMatrix::times_vector_rounded`].
    ///
    /// # Errors
    /// As for [`TtMatrix::times_matrix`] and [`TtMatrix::round`].
    pub fn times_matrix_rounded(
        &self,
        other: &Self,
        truncation: &Truncation,
    ) -> Result<(Self, TruncationReport), TtError> {
        self.check_inner(other)?;
        let product = Product { a: self, x: &other.train, spectators: &other.columns };
        let (train, report) = round_cores(&product, truncation)?;
        Ok((Self { rows: self.rows.clone(), columns: other.columns.clone(), train }, report))
    }
}
