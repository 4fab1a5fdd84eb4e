//! Products of which half is known: with triangles, and of a matrix with itself. By blocks of columns, each a
//! dense product without the part that is zero or known.
//!
//! Blocks of eight columns lose least: they waste four flops per number, and the kernels of dense products
//! take columns in fours. (Measured at 100 and 200 columns on one thread: 93 to 102 % of the rate of a large
//! product, with blocks of 13 and 25, eight in all, 75 to 84 %.)

use crate::dense::{Matrix, View, ViewMut, multiply, multiply_add};
use std::ops::Range;

/// Columns of a block.
const BLOCK: usize = 8;
/// Rows of a block: those of the kernels of dense products.
const ROWS: usize = 48;
/// Numbers of a block of the mirror image.
const TILE: usize = 16;

/// Which entries of a square matrix may differ from zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Triangle {
    /// On and below the diagonal.
    Lower,
    /// On and above the diagonal.
    Upper,
}

fn blocks(n: usize) -> impl Iterator<Item = Range<usize>> {
    (0..n).step_by(BLOCK).map(move |first| first..(first + BLOCK).min(n))
}

/// C <- alpha A T for a triangle T (n x n, zeros in the other half), C (m x n) column-major; m n^2 flops.
///
/// # Panics
/// If the shapes do not fit.
pub fn multiply_triangle(alpha: f64, a: View<'_>, t: View<'_>, triangle: Triangle, c: &mut [f64]) {
    let (m, n) = (a.rows(), t.columns());
    assert!(t.rows() == n && c.len() == m * n, "A T into a matrix of its shape");
    if m == 0 {
        return;
    }
    for columns in blocks(n) {
        let inner = match triangle {
            Triangle::Lower => columns.start..n,
            Triangle::Upper => 0..columns.end,
        };
        let to = &mut c[m * columns.start..m * columns.end];
        let to = ViewMut::new(to, m, columns.len());
        multiply(alpha, a.block(0..m, inner.clone()), t.block(inner, columns), to);
    }
}

/// C <- T B for a lower triangle T (n x n, zeros above) and B (n x k); k n^2 flops. By blocks of rows.
///
/// # Panics
/// If the shapes do not fit.
pub fn lower_times(t: View<'_>, b: View<'_>, c: &mut Matrix) {
    let (n, k) = (t.rows(), b.columns());
    assert!(b.rows() == n && (c.rows(), c.columns()) == (n, k), "T B into a matrix of its shape");
    if k == 0 {
        return;
    }
    for first in (0..n).step_by(ROWS) {
        let end = (first + ROWS).min(n);
        let to = ViewMut::with_stride(&mut c.data_mut()[first..], end - first, k, n);
        multiply(1.0, t.block(first..end, 0..end), b.block(0..end, 0..k), to);
    }
}

/// A^T A for A (m x n), symmetric to the bit; m n^2 flops.
pub fn gram(a: View<'_>) -> Matrix {
    let mut g = lower_gram(a);
    let n = g.rows();
    // Tile by tile: either side of the diagonal is strided.
    for first in (0..n).step_by(TILE) {
        for row in (0..=first).step_by(TILE) {
            for j in first..(first + TILE).min(n) {
                (row..(row + TILE).min(j)).for_each(|i| g[(i, j)] = g[(j, i)]);
            }
        }
    }
    g
}

/// The lower triangle of A^T A, with zeros or numbers of it above the diagonal.
pub fn lower_gram(a: View<'_>) -> Matrix {
    let (m, n) = (a.rows(), a.columns());
    let mut g = Matrix::zeros(n, n);
    for columns in blocks(n) {
        let first = columns.start;
        let below = &mut g.data_mut()[first + n * first..];
        let below = ViewMut::with_stride(below, n - first, columns.len(), n);
        multiply(1.0, a.block(0..m, first..n).t(), a.block(0..m, columns), below);
    }
    g
}

/// C <- C - F F^T in the lower triangle of C (n x n), F (n x k); k n^2 flops.
///
/// # Panics
/// If the shapes do not fit.
pub fn subtract_lower_square(f: View<'_>, c: &mut Matrix) {
    let (n, k) = (f.rows(), f.columns());
    for columns in blocks(n) {
        let first = columns.start;
        let below = &mut c.data_mut()[first + n * first..];
        let below = ViewMut::with_stride(below, n - first, columns.len(), n);
        multiply_add(-1.0, f.block(first..n, 0..k), f.block(columns, 0..k).t(), below);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::tests::{largest_difference, naive, sample};
    #[test]
    fn products_with_triangles_equal_the_triple_loop() {
        for (m, n) in [(1, 1), (0, 3), (3, 2), (5, 9), (9, 33), (40, 100), (2, 150)] {
            let (a, square) = (sample(m, n, 1), sample(n, n, 2));
            for triangle in [Triangle::Lower, Triangle::Upper] {
                let inside = |i: usize, j: usize| if triangle == Triangle::Lower { i >= j } else { i <= j };
                let t = Matrix::from_fn(n, n, |i, j| if inside(i, j) { square[(i, j)] } else { 0.0 });
                let expected = naive(&a, &t);
                if triangle == Triangle::Upper {
                    // The same, transposed.
                    let mut c = Matrix::from_vec(n, m, vec![7.0; m * n]);
                    lower_times(t.t(), a.t(), &mut c);
                    assert!(largest_difference(&c, &expected.transposed()) <= 1e-13 * n as f64);
                }
                for (a, t, turned) in [(a.view(), &t, false), (a.transposed().t(), &t.transposed(), true)] {
                    let mut c = vec![7.0; m * n];
                    multiply_triangle(2.0, a, if turned { t.t() } else { t.view() }, triangle, &mut c);
                    c.iter_mut().for_each(|x| *x *= 0.5);
                    assert!(largest_difference(&Matrix::from_vec(m, n, c), &expected) <= 1e-13 * n as f64);
                }
            }
        }
    }

    #[test]
    fn gram_is_the_product_with_the_transpose_and_symmetric() {
        for (m, n) in [(30, 11), (0, 3), (5, 40), (200, 127), (20, 130)] {
            let a = sample(m, n, 5);
            let turned = a.transposed();
            let expected = naive(&turned, &a);
            for view in [a.view(), turned.t()] {
                let g = gram(view);
                assert!(largest_difference(&g, &expected) < 1e-14 * (m + 1) as f64);
                assert_eq!(g, g.transposed());
                let half = lower_gram(view);
                assert!((0..n).all(|j| (j..n).all(|i| half[(i, j)] == g[(i, j)])));
                let mut rest = half;
                subtract_lower_square(turned.view(), &mut rest);
                assert!((0..n).all(|j| (j..n).all(|i| rest[(i, j)].abs() < 1e-14 * (m + 1) as f64)));
            }
        }
    }
}
