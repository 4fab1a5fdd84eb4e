//! Rows of a tall matrix that span it well: the maximal-volume principle.

use crate::error::at_core;
use crate::{FullMatrix, TtError};
use graintrain_linalg::dense::{DenseError, Lu, Matrix, View, ViewMut, multiply_add};

/// Largest allowed |B_ij| - 1 before a swap.
const EXCESS: f64 = 0.05;
/// Most swaps: each multiplies the volume by more than 1 + EXCESS.
const MAX_SWAPS: usize = 200;

/// The r rows of an m x r matrix (m >= r) with locally maximal volume, and B = A A(rows, :)^-1, which has the
/// identity at those rows and entries of at most 1.05 in size elsewhere.
///
/// LU with row pivoting gives the start, then rows are swapped one at a time (Goreinov, Oseledets,
/// Savostyanov, Tyrtyshnikov, Zamarashkin 2010). O(m r^2) to start, O(m r) per swap.
///
/// # Errors
/// [`TtError::Dense`] (singular, core 0) if the columns are linearly dependent, as more columns than rows are
/// (orthogonalise them first).
///
/// ```
/// use graintrain_tt::{FullMatrix, maxvol::maxvol};
/// let a = FullMatrix::new(4, 1, vec![1.0, -4.0, 2.0, 3.0])?;
/// let (rows, b) = maxvol(&a)?;
/// assert_eq!((rows, b.data()), (vec![1], &[-0.25, 1.0, -0.5, -0.75][..]));
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn maxvol(a: &FullMatrix) -> Result<(Vec<usize>, FullMatrix), TtError> {
    let (rows, b) = dominant_rows(&a.clone().into_matrix()).map_err(at_core(0))?;
    Ok((rows, FullMatrix::of(b)))
}

/// [`maxvol`] on the matrices of this workspace.
pub(crate) fn dominant_rows(a: &Matrix) -> Result<(Vec<usize>, Matrix), DenseError> {
    let (m, r) = (a.rows(), a.columns());
    if m < r {
        return Err(DenseError::Singular { index: m });
    }
    let mut rows = Lu::new(a.clone())?.pivot_rows()[..r].to_vec();
    // B^T = A(rows, :)^-T A^T
    let mut transposed = a.transposed();
    let square = Matrix::from_fn(r, r, |i, j| a[(rows[j], i)]);
    Lu::new(square)?.solve_in_place(ViewMut::new(transposed.data_mut(), r, m));
    let mut b = transposed.transposed();
    for _ in 0..MAX_SWAPS {
        let (mut best, mut at) = (0.0, 0);
        for (e, x) in b.data().iter().enumerate() {
            if x.abs() > best {
                (best, at) = (x.abs(), e);
            }
        }
        if best <= 1.0 + EXCESS {
            break;
        }
        // B <- B + B(:, j) (e_j - B(i, :)) / B(i, j)
        let (i, j) = (at % m, at / m);
        let column: Vec<f64> = b.column(j).to_vec();
        let row: Vec<f64> = (0..r).map(|k| (f64::from(k == j) - b[(i, k)]) / column[i]).collect();
        multiply_add(1.0, View::new(&column, m, 1), View::new(&row, 1, r), b.view_mut());
        rows[j] = i;
    }
    for (j, &row) in rows.iter().enumerate() {
        (0..r).for_each(|k| b[(row, k)] = f64::from(k == j));
    }
    Ok((rows, b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rows_dominate_and_rebuild_the_matrix(m in 1usize..40, r in 1usize..9, seed in any::<u64>()) {
            let r = r.min(m);
            let mut random = Random::new(seed);
            let a = Matrix::from_fn(m, r, |_, _| random.symmetric());
            let (rows, b) = dominant_rows(&a).unwrap();
            prop_assert!(b.data().iter().all(|x| x.abs() <= 1.0 + EXCESS + 1e-9));
            let mut distinct = rows.clone();
            distinct.sort_unstable();
            distinct.dedup();
            prop_assert_eq!(distinct.len(), r);
            for i in 0..m {
                for j in 0..r {
                    let rebuilt: f64 = (0..r).map(|k| b[(i, k)] * a[(rows[k], j)]).sum();
                    prop_assert!((rebuilt - a[(i, j)]).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn dependent_columns_are_refused() {
        let a = Matrix::from_fn(9, 3, |i, j| (i as f64) * if j == 1 { 0.0 } else { 1.0 });
        assert!(dominant_rows(&a).is_err());
    }
}
