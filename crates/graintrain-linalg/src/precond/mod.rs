//! Preconditioners of symmetric sparse matrices of small dense blocks.
//!
//! | name | what it inverts | refresh | application |
//! |---|---|---|---|
//! | [`BlockJacobi`] | the diagonal blocks | O(rows) | O(rows) |
//! | [`IncompleteLu`] | the block LU factors restricted to the pattern of the matrix, ILU(0) | O(sum of row length^2) | as one product |
//! | [`IncompleteCholesky`] | the block Cholesky factor restricted to the pattern, IC(0), in single precision; blocks of 3 or 6 | half of ILU(0) | reads half of a product |

mod block_jacobi;
mod incomplete_cholesky;
mod incomplete_lu;

pub use block_jacobi::BlockJacobi;
pub use incomplete_cholesky::IncompleteCholesky;
pub use incomplete_lu::IncompleteLu;

use crate::block3::BlockMatrix3;

/// Why a preconditioner could not be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PreconditionerError {
    /// A diagonal block could not be inverted.
    #[error("the diagonal block of row {row} is singular or not positive definite")]
    Pivot {
        /// Block row.
        row: usize,
    },
    /// The matrix does not store one of its diagonal blocks.
    #[error("the diagonal block of row {row} is not stored")]
    MissingDiagonal {
        /// Block row.
        row: usize,
    },
}

/// An approximate inverse of a block matrix.
pub trait Preconditioner: Send {
    /// Adapts to new values of the matrix.
    ///
    /// # Errors
    /// [`PreconditionerError`]; the preconditioner is then unusable until the next success.
    fn refresh(&mut self, matrix: &BlockMatrix3) -> Result<(), PreconditionerError>;

    /// z <- P^-1 r, both of length 3 rows.
    fn apply(&self, r: &[f64], z: &mut [f64]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::krylov::{KrylovSettings, KrylovWork, bicgstab, conjugate_gradient};

    /// A positive definite block matrix of a ring of `rows` vertices with some chords.
    fn ring(rows: usize, chords: bool) -> BlockMatrix3 {
        let (mut start, mut column, mut blocks) = (vec![0], Vec::new(), Vec::new());
        for i in 0..rows {
            let mut neighbours = vec![i, (i + 1) % rows, (i + rows - 1) % rows];
            if chords {
                neighbours.extend([(i + 7) % rows, (i + rows - 7) % rows]);
            }
            neighbours.sort_unstable();
            neighbours.dedup();
            for j in neighbours {
                column.push(j as u32);
                if i == j {
                    blocks.push([4.2, 0.5, 0.0, 0.5, 4.4, 0.3, 0.0, 0.3, 4.6]);
                } else {
                    // Block (i, j) is the transpose of block (j, i).
                    let (a, b) = if i < j { (0.25, -0.5) } else { (-0.5, 0.25) };
                    blocks.push([-1.0, a, 0.0, b, -1.0, 0.0, 0.0, 0.0, 0.9]);
                }
            }
            start.push(column.len());
        }
        BlockMatrix3::from_rows(start, column, blocks)
    }

    fn iterations(matrix: &BlockMatrix3, preconditioner: &dyn Preconditioner, symmetric: bool) -> usize {
        let n = 3 * matrix.num_rows();
        let b: Vec<f64> = (0..n).map(|k| f64::cos(k as f64)).collect();
        let mut x = vec![0.0; n];
        let settings = KrylovSettings { relative_tolerance: 1e-10, max_iterations: 500 };
        let mut work = KrylovWork::default();
        let method = if symmetric { conjugate_gradient } else { bicgstab };
        let report = method(
            &mut |x, y| matrix.multiply(x, y),
            &mut |r, z| preconditioner.apply(r, z),
            &b,
            &mut x,
            settings,
            &mut work,
        );
        assert!(report.converged());
        let mut ax = vec![0.0; n];
        matrix.multiply(&x, &mut ax);
        assert!(ax.iter().zip(&b).all(|(ax, b)| (ax - b).abs() < 1e-8));
        report.iterations
    }

    #[test]
    fn incomplete_factors_beat_block_jacobi() {
        let matrix = ring(300, true);
        assert!(matrix.asymmetry() < 1e-15);
        let mut jacobi = BlockJacobi::new(3);
        let mut cholesky = IncompleteCholesky::<3, 9>::default();
        let mut lu = IncompleteLu::default();
        for preconditioner in [&mut jacobi as &mut dyn Preconditioner, &mut cholesky, &mut lu] {
            preconditioner.refresh(&matrix).unwrap();
        }
        let simple = iterations(&matrix, &jacobi, true);
        assert!(iterations(&matrix, &cholesky, true) < simple);
        assert!(2 * iterations(&matrix, &lu, false) < simple);
        // ILU(0) of a symmetric matrix is its IC(0): the two applications agree.
        let r: Vec<f64> = (0..900).map(|k| f64::sin(k as f64)).collect();
        let (mut by_cholesky, mut by_lu) = (vec![0.0; 900], vec![0.0; 900]);
        cholesky.apply(&r, &mut by_cholesky);
        lu.apply(&r, &mut by_lu);
        assert!(by_cholesky.iter().zip(&by_lu).all(|(a, b)| (a - b).abs() < 1e-6));
    }

    /// Without fill outside the pattern the incomplete factors are complete: one application solves the
    /// system.
    #[test]
    fn incomplete_factors_of_a_path_are_exact() {
        let (mut start, mut column, mut blocks) = (vec![0], Vec::new(), Vec::new());
        let rows = 40;
        for i in 0_usize..rows {
            for j in i.saturating_sub(1)..(i + 2).min(rows) {
                column.push(j as u32);
                blocks.push(if i == j {
                    [3.0, 0.1, 0.2, 0.1, 3.0, 0.0, 0.2, 0.0, 2.5]
                } else {
                    [-1.0, 0.0, 0.0, 0.0, -1.0, 0.2, 0.0, 0.2, -1.0]
                });
            }
            start.push(column.len());
        }
        let matrix = BlockMatrix3::from_rows(start, column, blocks);
        let exact: Vec<f64> = (0..3 * rows).map(|k| k as f64 - 7.0).collect();
        let mut b = vec![0.0; 3 * rows];
        matrix.multiply(&exact, &mut b);
        let mut cholesky = IncompleteCholesky::<3, 9>::default();
        let mut lu = IncompleteLu::default();
        // The factor of IC(0) is kept in single precision.
        for (preconditioner, tolerance) in [(&mut cholesky as &mut dyn Preconditioner, 1e-4), (&mut lu, 1e-9)]
        {
            preconditioner.refresh(&matrix).unwrap();
            let mut x = vec![0.0; 3 * rows];
            preconditioner.apply(&b, &mut x);
            assert!(x.iter().zip(&exact).all(|(x, exact)| (x - exact).abs() < tolerance));
        }
    }

    /// Blocks of six: the factors of a path are complete up to single precision; those of a ring are not, but
    /// symmetric positive definite.
    #[test]
    fn incomplete_cholesky_takes_larger_blocks() {
        let entry = |k: usize| f64::sin(1.7 * k as f64);
        for ring in [false, true] {
            let rows = 30_usize;
            let (mut columns, mut blocks) = (Vec::new(), Vec::new());
            for i in 0..rows {
                let mut row: Vec<u32> = (i.saturating_sub(1)..=i).map(|j| j as u32).collect();
                if ring && i + 1 == rows {
                    row.insert(0, 0);
                }
                let values: Vec<[f64; 36]> = row
                    .iter()
                    .map(|&j| {
                        std::array::from_fn(|e| match (j as usize == i, e % 7 == 0) {
                            (true, true) => 5.0,
                            (true, false) => 0.2,
                            _ => 0.4 * entry(i * 36 + e),
                        })
                    })
                    .collect();
                columns.push(row);
                blocks.push(values);
            }
            let multiply = |x: &[f64]| -> Vec<f64> {
                let mut y = vec![0.0; 6 * rows];
                for i in 0..rows {
                    for (&j, block) in columns[i].iter().zip(&blocks[i]) {
                        let j = j as usize;
                        for (e, value) in block.iter().enumerate() {
                            y[6 * i + e / 6] += value * x[6 * j + e % 6];
                            if i != j {
                                y[6 * j + e % 6] += value * x[6 * i + e / 6];
                            }
                        }
                    }
                }
                y
            };
            let mut factor = IncompleteCholesky::<6, 36>::default();
            factor.refresh_lower(rows, |i| (&columns[i], &blocks[i])).unwrap();
            assert_eq!((factor.shift(), factor.num_lower_blocks()), (0.0, rows - 1 + usize::from(ring)));
            let inverse_of_image = |x: &[f64]| {
                let mut z = vec![0.0; x.len()];
                factor.apply(&multiply(x), &mut z);
                z
            };
            let x: Vec<f64> = (0..6 * rows).map(entry).collect();
            let back = inverse_of_image(&x);
            let error = x.iter().zip(&back).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            if ring {
                assert!(error > 1e-5, "the factors of a ring have fill: {error}");
            } else {
                assert!(error < 1e-5, "{error}");
            }
            let y: Vec<f64> = (0..6 * rows).map(|k| entry(3 * k + 1)).collect();
            let (mut px, mut py) = (vec![0.0; x.len()], vec![0.0; x.len()]);
            factor.apply(&x, &mut px);
            factor.apply(&y, &mut py);
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            assert!((dot(&y, &px) - dot(&x, &py)).abs() < 1e-12 && dot(&x, &px) > 0.0);
        }
    }

    /// Matrices far outside the range of single precision, one with a pivot that is rounding: the factor has
    /// no unit.
    #[test]
    fn incomplete_cholesky_takes_any_unit() {
        let block =
            |diagonal: f64| -> [f64; 36] { std::array::from_fn(|e| if e % 7 == 0 { diagonal } else { 0.0 }) };
        for size in [1e-60, 1.0, 1e60] {
            let blocks = [block(size), block(3.0 * size), block(9.0 * size), block(5.0 * size)];
            let columns: [&[u32]; 3] = [&[0], &[0, 1], &[2]];
            let lists = [&blocks[..1], &blocks[1..3], &blocks[3..]];
            let mut factor = IncompleteCholesky::<6, 36>::default();
            factor.refresh_lower(3, |i| (columns[i], lists[i])).unwrap();
            // 9 - 3 * 3 = 0: the second body hangs on the first one rigidly.
            assert!(factor.shift() > 0.0);
            let mut z = vec![f64::NAN; 18];
            factor.apply(&[size; 18], &mut z);
            assert!(
                z.iter().all(|z| z.is_finite()) && (z[12] * (1.0 + factor.shift()) - 0.2).abs() < 1e-12,
                "{z:?}"
            );
        }
        let bad = [[f64::NAN; 36]];
        assert!(IncompleteCholesky::<6, 36>::default().refresh_lower(1, |_| (&[0], &bad)).is_err());
    }

    #[test]
    fn a_singular_diagonal_block_is_reported() {
        let matrix = BlockMatrix3::from_rows(vec![0, 1], vec![0], vec![[0.0; 9]]);
        let expected = Err(PreconditionerError::Pivot { row: 0 });
        assert_eq!(BlockJacobi::new(3).refresh(&matrix), expected);
        assert_eq!(IncompleteLu::default().refresh(&matrix), expected);
        assert_eq!(IncompleteCholesky::<3, 9>::default().refresh(&matrix), expected);
    }
}
