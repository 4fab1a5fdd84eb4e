//! TT-SVD: the train of a full tensor (Oseledets 2011, Algorithm 1).
//!
//! A large tensor is read twice. The unfolding nearest to square is A = Q B + what is left out, Q from a
//! random sketch that checks itself (`range.rs`), and the TT-SVD of Q B works on two matrices that are small.
//! Where the check says that this leaves out too much (the rank there exceeds 100, or the tolerance is 0),
//! the passes go from the fine modes to the coarse ones:
//!
//! Every pass over the data costs traffic, and a small mode shortens them little: n = 2 halves them at best.
//! So several modes are taken at once, as many as keep the unfolding at `GROUP_ROWS` rows: A = L Q of this
//! unfolding with orthonormal rows of Q, and the TT-SVD of the small tensor L gives the same cores as that of
//! A.

use crate::error::at_core;
use crate::factor::{SQUARES, SafeCholesky, leading_columns};
use crate::matrix::checked_product;
use crate::range::{Range, column_range};
use crate::round::{Budget, ROUNDING, sum_of_squares};
use crate::scale::{binary_exponent, largest_finite, scale_by_power, share_power};
use crate::vector::Core;
use crate::{FullMatrix, Truncation, TruncationReport, TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{Matrix, View, ViewMut, multiply, product, qr_triangle, symmetric_eigen};
use graintrain_linalg::triangles::gram;
use rayon::prelude::*;

/// Unfoldings of more rows than this are not made by joining modes: the QR of a pass costs 2 rows flops per
/// entry.
const GROUP_ROWS: usize = 64;
/// Tensors of fewer numbers than this are small: their reads cost nothing, so no sketches and no Gram
/// matrices of them.
const LARGE: usize = 1 << 18;
/// A basis from a sketch may leave out this part of the squared error allowed.
const RANGE_SHARE: f64 = 0.05;
/// A Gram matrix stands for its rows where the squared error that may be made is more than this part of its
/// trace.
const GRAM_SHARE: f64 = 1e-11;
/// Eigenvectors of a Gram matrix are singular vectors where the squared error that may be made is more than
/// this part of its trace: their own errors are some units of rounding.
const EIGENVECTOR_SHARE: f64 = 64.0 * f64::EPSILON;
/// Larger tensors are not turned onto eigenvectors in whole.
const LARGEST_TURNED: usize = 1 << 20;
/// Numbers per task of a read.
const TASK_NUMBERS: usize = 1 << 16;
/// Seed of the sketches: the same tensor gives the same train.
const SEED: u64 = 0x7EA5_0125;

impl TtVector {
    /// TT-SVD of a full tensor (Oseledets 2011, Algorithm 1), first index fastest: truncated SVDs of the
    /// unfoldings, several modes in one pass. Each wide unfolding is first reduced to a small triangle by QR
    /// of its transpose, or by a Gram matrix where the tolerance (above about 1e-5) allows it.
    ///
    /// From 2^18 entries on, and where the unfolding in the middle has a rank up to about 100 within the
    /// tolerance, a random sketch of it comes first (see the module): two reads, 2 r + 3 flops per entry, no
    /// copy of the input.
    ///
    /// The report's error is the error itself, what a sketch left out included (measured, squares to about
    /// 1e-15 of the squared norm). Entries of any finite size.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the length is not the product of the modes; [`TtError::Setting`] and
    /// [`TtError::Dense`] as for [`TtVector::round`].
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
        let Some((_, before_last)) = modes.split_last().filter(|_| entries == full.len() && entries > 0)
        else {
            return Err(TtError::Shape {
                what: "entries of a full tensor",
                expected: vec![entries],
                got: vec![full.len()],
            });
        };
        // Numbers of moderate size, as the sum of their squares tells, are not scaled and so not copied.
        let (bond, rows) = middle(modes);
        let allowed = truncation.tolerance.powi(2) * RANGE_SHARE;
        let (squares, range) = if full.len() >= LARGE && bond > 0 {
            column_range(full, rows, allowed, SEED)
        } else {
            (sum_of_squares(full), None)
        };
        if SQUARES.contains(&squares) {
            let mut cores = Vec::with_capacity(modes.len());
            // (The bond in the middle is shortened from both sides.)
            let mut budget =
                Budget::new(truncation, squares, before_last.len() + usize::from(range.is_some()));
            match range {
                Some(range) => from_range(range, modes, bond, &mut budget, &mut cores)?,
                None => split_off(&mut cores, 1, modes, Source::Borrowed(full), &mut budget)?,
            }
            let report = budget.report(squares, ROUNDING * (modes.len() as f64).sqrt());
            return Ok((Self { cores }, report));
        }
        let power = binary_exponent(largest_finite(full).map_err(at_core(0))?);
        let mut scaled = full.to_vec();
        scale_by_power(&mut scaled, -power);
        let norm_squared = sum_of_squares(&scaled);
        let mut budget = Budget::new(truncation, norm_squared, before_last.len());
        let mut cores = Vec::with_capacity(modes.len());
        split_off(&mut cores, 1, modes, Source::Owned(scaled), &mut budget)?;
        share_power(&mut cores, i64::from(power));
        let report = budget.report(norm_squared, ROUNDING * (modes.len() as f64).sqrt());
        let norm = report.norm * f64::from(power).exp2();
        Ok((Self { cores }, TruncationReport { norm, ..report }))
    }
}

/// Numbers that belong to the caller until the first pass has shortened them.
enum Source<'a> {
    Borrowed(&'a [f64]),
    Owned(Vec<f64>),
}

impl Source<'_> {
    fn numbers(&self) -> &[f64] {
        match self {
            Self::Borrowed(numbers) => numbers,
            Self::Owned(numbers) => numbers,
        }
    }
}

/// The bond whose unfolding is nearest to square and has no fewer columns than rows, and its rows; bond 0 if
/// there is none.
fn middle(modes: &[usize]) -> (usize, usize) {
    let entries: f64 = modes.iter().map(|&n| n as f64).product();
    let (mut bond, mut rows) = (0, 1);
    for (k, &n) in modes.iter().enumerate().take(modes.len().saturating_sub(1)) {
        if (rows * n) as f64 > entries.sqrt() {
            break;
        }
        (bond, rows) = (k + 1, rows * n);
    }
    (bond, rows)
}

/// All cores of the tensor of these modes with a left rank in front, appended to those left of it.
fn split_off(
    cores: &mut Vec<Core>,
    mut left: usize,
    modes: &[usize],
    numbers: Source<'_>,
    budget: &mut Budget,
) -> Result<(), TtError> {
    let (first, last) = modes.split_at(modes.len() - 1);
    let (mut rest, mut done) = (numbers, 0);
    while done < first.len() {
        let group = group_of_modes(left, &first[done..]);
        let (basis, projected) = pass(cores, left, group, rest.numbers(), budget)?;
        rest = Source::Owned(projected);
        left = basis.columns();
        done += group.len();
    }
    let data = match rest {
        Source::Borrowed(numbers) => numbers.to_vec(),
        Source::Owned(numbers) => numbers,
    };
    cores.push(Core { left, mode: last[0], right: 1, data });
    Ok(())
}

/// The cores of Q B, the unfolding at a bond: Q B has the left singular vectors of Q L with B = L times
/// orthonormal rows, and what remains of it right of the bond is (U^T Q) B for the basis U that the cores
/// left of the bond hold.
fn from_range(
    range: Range,
    modes: &[usize],
    bond: usize,
    budget: &mut Budget,
    cores: &mut Vec<Core>,
) -> Result<(), TtError> {
    budget.spend(range.left_out);
    let Range { basis, coefficients, .. } = range;
    let lower = lower_factor(coefficients.data(), coefficients.rows(), 0.0);
    // Side by side: Q L, which decides, and Q, which is carried along.
    let mut both = product(basis.view(), lower.view()).into_vec();
    let width = both.len();
    both.extend(basis.into_vec());
    let (mut left, mut done, mut first) = (1, 0, width);
    while done < bond {
        let group = group_of_modes(left, &modes[done..bond]);
        let (basis, kept) = pass(cores, left, group, &both[..first], budget)?;
        let carried = project(&basis, &both[first..]);
        first = kept.len();
        both = [kept, carried].concat();
        left = basis.columns();
        done += group.len();
    }
    let carried = View::new(&both[first..], left, coefficients.rows());
    let rest = product(carried, coefficients.view());
    // From the coarse end the first pass takes a whole group of modes; from the bond, with the full rank in
    // front, every mode would be a pass.
    let right = &modes[bond..];
    let mut turned: Vec<usize> = right.iter().rev().copied().collect();
    turned.push(left);
    let mut from_end = Vec::with_capacity(turned.len());
    split_off(&mut from_end, 1, &turned, Source::Owned(reversed(&rest, right)), budget)?;
    let centre =
        from_end.pop().unwrap_or_else(|| Core { left: 1, mode: left, right: 1, data: vec![1.0; left] });
    // The weights between both halves go into the core right of the bond.
    let weights = View::new(&centre.data, centre.left, left);
    let mut right_cores = TtVector { cores: from_end }.reverse().cores;
    if let Some(next) = right_cores.first_mut() {
        let data = product(weights.t(), next.right_unfolding()).into_vec();
        *next = Core { left, mode: next.mode, right: next.right, data };
    }
    cores.extend(right_cores);
    Ok(())
}

/// A matrix whose columns are numbered by digits of these sizes, first fastest, as the tensor of the digits
/// in reverse order, the row last.
fn reversed(matrix: &Matrix, sizes: &[usize]) -> Vec<f64> {
    let (rows, columns) = (matrix.rows(), matrix.columns());
    // Where column j goes: its digits with the places of the reversed order.
    let mut places = vec![0; 1];
    let mut place = columns;
    for &n in sizes {
        place /= n;
        places = (0..n).flat_map(|i| places.iter().map(move |p| p + place * i)).collect();
    }
    let mut turned = vec![0.0; rows * columns];
    for (place, column) in places.iter().zip(matrix.data().chunks_exact(rows.max(1))) {
        column.iter().enumerate().for_each(|(row, x)| turned[place + columns * row] = *x);
    }
    turned
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

/// Appends the left-orthogonal cores of the group; returns their product U, rows x rank, and U^T A.
fn pass(
    cores: &mut Vec<Core>,
    left: usize,
    group: &[usize],
    rest: &[f64],
    budget: &mut Budget,
) -> Result<(Matrix, Vec<f64>), TtError> {
    if let &[mode] = group
        && let Some((basis, projected)) = leading_by_eigenvectors(rest, left * mode, budget)
    {
        cores.push(Core::from_left_unfolding(left, mode, basis.clone()));
        return Ok((basis, projected));
    }
    let rows = left * group.iter().product::<usize>();
    let mut numbers = lower_factor(rest, rows, budget.share()).into_vec();
    let mut basis = Matrix::identity(left);
    for &mode in group {
        let (left, rows) = (basis.columns(), basis.columns() * mode);
        let (u, projected) = match leading_by_eigenvectors(&numbers, rows, budget) {
            Some(found) => found,
            None => {
                let u = leading_columns(&lower_factor(&numbers, rows, 0.0), budget)
                    .map_err(at_core(cores.len()))?;
                let tensor = View::new(&numbers, rows, numbers.len() / rows);
                let projected = product(u.t(), tensor).into_vec();
                (u, projected)
            }
        };
        numbers = projected;
        let core = Core::from_left_unfolding(left, mode, u);
        basis = Matrix::from_vec(
            basis.rows() * mode,
            core.right,
            product(basis.view(), core.right_unfolding()).into_vec(),
        );
        cores.push(core);
    }
    let projected = project(&basis, rest);
    Ok((basis, projected))
}

/// The leading left singular vectors U of a matrix A of m rows and U^T A: eigenvectors V of A A^T, and the
/// rank by the squares of the rows of V^T A, which are formed, so that what is left out is what it is however
/// V was found. None where the share of the budget is near what a Gram matrix resolves (a rank might be too
/// large then), for large tensors, of which this would make a copy, and where A has more rows than columns:
/// A A^T is larger than A then, and its eigenvectors would cost m^3 for a rank of at most the columns.
fn leading_by_eigenvectors(numbers: &[f64], m: usize, budget: &mut Budget) -> Option<(Matrix, Vec<f64>)> {
    if numbers.len() > LARGEST_TURNED || numbers.len() < m * m {
        return None;
    }
    let squares = sum_of_grams(numbers, m, None);
    let trace: f64 = (0..m).map(|i| squares[(i, i)]).sum();
    if !SQUARES.contains(&trace) || budget.share() < EIGENVECTOR_SHARE * trace {
        return None;
    }
    let (_, vectors) = symmetric_eigen(squares.view()).ok()?;
    let mut basis = Matrix::from_fn(m, m, |i, j| vectors[(i, m - 1 - j)]);
    let turned = project(&basis, numbers);
    let mut squares = vec![0.0; m];
    for column in turned.chunks_exact(m) {
        squares.iter_mut().zip(column).for_each(|(sum, x)| *sum += x * x);
    }
    let rank = budget.rank(&squares);
    basis.truncate_columns(rank);
    let kept = turned.chunks_exact(m).flat_map(|column| &column[..rank]).copied().collect();
    Some((basis, kept))
}

/// U^T A by blocks of columns, each a task.
fn project(basis: &Matrix, numbers: &[f64]) -> Vec<f64> {
    let (rows, rank) = (basis.rows(), basis.columns());
    let columns = numbers.len() / rows;
    let mut projected = vec![0.0; rank * columns];
    let task = (TASK_NUMBERS / rows).max(1);
    projected.par_chunks_mut(rank * task).zip(numbers.par_chunks(rows * task)).for_each(|(to, from)| {
        let width = from.len() / rows;
        multiply(1.0, basis.t(), View::new(from, rows, width), ViewMut::new(to, rank, width));
    });
    projected
}

/// L with A A^T = L L^T and no more columns than A: A = L Q with orthonormal rows of Q has the singular
/// values and left singular vectors of L. Only some times rows x rows numbers live at a time.
///
/// From Gram matrices ([`factor_by_gram`], which `share`, the squared error that may be made, makes cheaper),
/// else by a QR of A^T that runs over blocks of columns.
fn lower_factor(numbers: &[f64], m: usize, share: f64) -> Matrix {
    let n = numbers.len() / m;
    if n > 2 * m
        && let Some(lower) = factor_by_gram(numbers, m, share)
    {
        return lower;
    }
    let block = (4 * m).max(256);
    let mut triangle = Matrix::zeros(0, m);
    for first in (0..n).step_by(block) {
        let (kept, width) = (triangle.rows(), block.min(n - first));
        let mut stacked = Matrix::zeros(kept + width, m);
        for (j, column) in stacked.data_mut().chunks_exact_mut(kept + width).enumerate() {
            column[..kept].copy_from_slice(triangle.column(j));
        }
        transpose_into(&numbers[m * first..m * (first + width)], m, kept, kept + width, stacked.data_mut());
        triangle = qr_triangle(stacked);
    }
    triangle.transposed()
}

/// Writes the transpose of m x n numbers to rows `first`.. of a matrix of `height` rows, tile by tile.
fn transpose_into(numbers: &[f64], m: usize, first: usize, height: usize, to: &mut [f64]) {
    const TILE: usize = 8;
    let n = numbers.len() / m;
    for j in (0..n).step_by(TILE) {
        for i in (0..m).step_by(TILE) {
            for row in i..(i + TILE).min(m) {
                for column in j..(j + TILE).min(n) {
                    to[first + column + height * row] = numbers[row + m * column];
                }
            }
        }
    }
}

/// [`lower_factor`] at the rate of matrix products: the Cholesky factor of A A^T where its condition allows
/// that; where it does not, the rows are rotated onto the eigenvectors V of A A^T, which leaves them nearly
/// orthogonal and of all sizes, and V times the Cholesky factor of V^T A (V^T A)^T is as good as reflections
/// are (the condition that counts is that of rows brought to length one, see [`crate::factor`]). In a large
/// tensor the eigenvalues themselves do where `share` is far above their rounding. None where all this fails.
fn factor_by_gram(numbers: &[f64], m: usize, share: f64) -> Option<Matrix> {
    let total = sum_of_grams(numbers, m, None);
    let trace: f64 = (0..m).map(|i| total[(i, i)]).sum();
    if !SQUARES.contains(&trace) {
        return None;
    }
    if let Some(factor) = SafeCholesky::new(&total) {
        return Some(factor.lower());
    }
    let (values, vectors) = symmetric_eigen(total.view()).ok()?;
    if numbers.len() >= LARGE && share > GRAM_SHARE * trace {
        return Some(Matrix::from_fn(m, m, |i, j| vectors[(i, j)] * values[j].max(0.0).sqrt()));
    }
    let rotated = sum_of_grams(numbers, m, Some(&vectors));
    let factor = SafeCholesky::new(&rotated)?;
    Some(product(vectors.view(), factor.lower().view()))
}

/// A A^T, or V^T A A^T V, by blocks of columns that are tasks and are added in their order.
fn sum_of_grams(numbers: &[f64], m: usize, vectors: Option<&Matrix>) -> Matrix {
    let part = |part: &[f64]| {
        let part = View::new(part, m, part.len() / m);
        match vectors {
            None => gram(part.t()),
            Some(vectors) => gram(product(vectors.t(), part).t()),
        }
    };
    let parts: Vec<Matrix> = numbers.par_chunks((TASK_NUMBERS / m).max(1) * m).map(part).collect();
    let mut total = Matrix::zeros(m, m);
    for part in &parts {
        total.data_mut().iter_mut().zip(part.data()).for_each(|(sum, x)| *sum += x);
    }
    total
}

impl TtMatrix {
    /// TT-SVD of a full column-major matrix over paired modes.
    ///
    /// # Errors
    /// As for [`TtVector::from_full`].
    pub fn from_full(
        full: &FullMatrix,
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
