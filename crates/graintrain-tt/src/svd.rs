//! TT-SVD: the train of a full tensor (Oseledets 2011, Algorithm 1).
//!
//! Every pass over the data costs traffic, and a small mode shortens them little: n = 2 halves them at best. So several
//! modes are taken at once, as many as keep the unfolding at `GROUP_ROWS` rows: A = L Q of this unfolding with orthonormal
//! rows of Q, and the TT-SVD of the small tensor L gives the same cores as that of A.

use crate::error::at_core;
use crate::factor::leading_columns;
use crate::matrix::checked_product;
use crate::round::{Budget, ROUNDING};
use crate::scale::{binary_exponent, largest_finite, scale_by_power, share_power};
use crate::vector::Core;
use crate::{Truncation, TruncationReport, TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{Matrix, View, product, qr_triangle};

/// Unfoldings of more rows than this are not made by joining modes: the QR of a pass costs 2 rows flops per entry.
const GROUP_ROWS: usize = 32;

impl TtVector {
    /// TT-SVD of a full tensor (Oseledets 2011, Algorithm 1), first index fastest: truncated SVDs of the unfoldings,
    /// several modes in one pass. Each wide unfolding is first reduced to a small triangle by QR of its transpose.
    ///
    /// The report's error is the error itself. Entries of any finite size (they are scaled by a power of two).
    ///
    /// # Errors
    /// [`TtError::Shape`] if the length is not the product of the modes; [`TtError::Setting`] and [`TtError::Dense`]
    /// as for [`TtVector::round`].
    ///
    /// ```
    /// use graintrain_tt::{Truncation, TtVector};
    /// let full: Vec<f64> = (0..1024).map(|i| (0.01 * i as f64).sin()).collect();
    /// let (train, report) = TtVector::from_full(&full, &[2; 10], &Truncation::to(1e-12))?;
    /// assert_eq!(train.max_rank(), 2);
    /// assert!(report.error < 1e-12);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn from_full(
        full: &[f64],
        modes: &[usize],
        truncation: &Truncation,
    ) -> Result<(Self, TruncationReport), TtError> {
        truncation.check()?;
        let entries =
            modes.iter().try_fold(1usize, |product, &n| product.checked_mul(n)).unwrap_or(usize::MAX);
        let Some((&last, before_last)) = modes.split_last().filter(|_| entries == full.len() && entries > 0)
        else {
            return Err(TtError::Shape {
                what: "entries of a full tensor",
                expected: vec![entries],
                got: vec![full.len()],
            });
        };
        let power = binary_exponent(largest_finite(full).map_err(at_core(0))?);
        let mut rest = full.to_vec();
        scale_by_power(&mut rest, -power);
        let norm_squared = rest.iter().map(|x| x * x).sum::<f64>();
        let mut budget = Budget::new(truncation, norm_squared, before_last.len());
        let mut cores = Vec::with_capacity(modes.len());
        let mut left = 1;
        while cores.len() < before_last.len() {
            let group = group_of_modes(left, &before_last[cores.len()..]);
            rest = split_off_group(&mut cores, left, group, &rest, &mut budget)?;
            left = cores[cores.len() - 1].right;
        }
        cores.push(Core { left, mode: last, right: 1, data: rest });
        share_power(&mut cores, i64::from(power));
        let report = budget.report(norm_squared, ROUNDING * (modes.len() as f64).sqrt());
        let norm = report.norm * f64::from(power).exp2();
        Ok((Self { cores }, TruncationReport { norm, ..report }))
    }
}

/// The modes of the next pass: as many as keep the rows of the unfolding at [`GROUP_ROWS`], at least one.
fn group_of_modes(left: usize, modes: &[usize]) -> &[usize] {
    let mut rows = left;
    let fits = modes.iter().take_while(|&&mode| {
        rows = rows.saturating_mul(mode);
        rows <= GROUP_ROWS
    });
    &modes[..fits.count().max(1)]
}

/// Appends the left-orthogonal cores of the group and returns what remains, rank x (entries of the later modes).
fn split_off_group(
    cores: &mut Vec<Core>,
    left: usize,
    group: &[usize],
    rest: &[f64],
    budget: &mut Budget,
) -> Result<Vec<f64>, TtError> {
    let rows = left * group.iter().product::<usize>();
    let unfolding = View::new(rest, rows, rest.len() / rows);
    let mut small = lower_factor(unfolding);
    // The product of the cores of the group, rows x rank.
    let mut basis = Matrix::identity(left);
    for &mode in group {
        let left = basis.columns();
        let numbers = small.into_vec();
        let tensor = View::new(&numbers, left * mode, numbers.len() / (left * mode));
        let u = leading_columns(&lower_factor(tensor), budget).map_err(at_core(cores.len()))?;
        small = product(u.t(), tensor);
        let core = Core::from_left_unfolding(left, mode, u);
        basis = Matrix::from_vec(
            basis.rows() * mode,
            core.right,
            product(basis.view(), core.right_unfolding()).into_vec(),
        );
        cores.push(core);
    }
    Ok(product(basis.t(), unfolding).into_vec())
}

/// L with A A^T = L L^T and no more columns than A, by a QR of A^T that runs over blocks of columns: A = L Q with
/// orthonormal rows of Q has the singular values and left singular vectors of L. Only rows x rows numbers live at a time.
fn lower_factor(a: View<'_>) -> Matrix {
    let (m, n) = (a.rows(), a.columns());
    let block = (4 * m).max(256);
    let mut triangle = Matrix::zeros(0, m);
    for first in (0..n).step_by(block) {
        let (kept, width) = (triangle.rows(), block.min(n - first));
        let stacked = Matrix::from_fn(kept + width, m, |i, j| {
            if i < kept { triangle[(i, j)] } else { a.get(j, first + i - kept) }
        });
        triangle = qr_triangle(stacked);
    }
    triangle.transposed()
}

impl TtMatrix {
    /// TT-SVD of a full column-major matrix over paired modes.
    ///
    /// # Errors
    /// As for [`TtVector::from_full`].
    pub fn from_full(
        full: &Matrix,
        rows: &[usize],
        columns: &[usize],
        truncation: &Truncation,
    ) -> Result<(Self, TruncationReport), TtError> {
        let (m, n) = (checked_product(rows)?, checked_product(columns)?);
        if rows.len() != columns.len() || rows.is_empty() || m != full.rows() || n != full.columns() {
            return Err(TtError::Shape {
                what: "rows and columns of a full matrix",
                expected: vec![m, n],
                got: vec![full.rows(), full.columns()],
            });
        }
        let modes: Vec<usize> = rows.iter().zip(columns).map(|(m, n)| m * n).collect();
        let mut digits = vec![0; modes.len()];
        let mut paired = Vec::with_capacity(m * n);
        for _ in 0..m * n {
            let (mut i, mut j, mut row_step, mut column_step) = (0, 0, 1, 1);
            for (k, b) in digits.iter().enumerate() {
                i += row_step * (b % rows[k]);
                j += column_step * (b / rows[k]);
                row_step *= rows[k];
                column_step *= columns[k];
            }
            paired.push(full[(i, j)]);
            for (digit, &size) in digits.iter_mut().zip(&modes) {
                *digit += 1;
                if *digit < size {
                    break;
                }
                *digit = 0;
            }
        }
        let (train, report) = TtVector::from_full(&paired, &modes, truncation)?;
        Ok((Self { rows: rows.to_vec(), columns: columns.to_vec(), train }, report))
    }
}
