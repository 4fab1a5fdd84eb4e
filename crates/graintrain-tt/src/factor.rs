//! Factors of unfoldings: from Gram matrices where their condition allows it, from reflections and singular
//! values where it does not. A Gram matrix runs at the rate of a matrix product, a QR of a core at a seventh
//! of it, an SVD at a twentieth.
//!
//! The Cholesky factor R of A^T A has R^T R = A^T A + E with |E_ij| <= c eps |a_i| |a_j| for columns a_i of
//! length |a_i|. With D = diag(|a_i|) the computed factor is therefore (I + F) times the exact one, ||F|| <=
//! c n eps ||D R^-1||_F^2: an error relative to whatever R is multiplied by later, which no cancellation
//! further along the train can enlarge. So
//! ||D R^-1||_F^2 (n for orthogonal columns of any lengths) is what decides; columns longer than [`CONDITION`] n in it go to
//! Householder reflections. (Al Daas, Ballard, Manning, Parallel tensor train rounding using Gram SVD, 2022,
//! take Gram matrices throughout and lose half the digits where trains cancel.)

use crate::round::{Budget, sum_of_squares};
use graintrain_linalg::dense::{
    Cholesky, DenseError, Matrix, View, left_svd, multiply_add, product, qr_triangle,
    solve_upper_on_the_right, symmetric_eigen, thin_qr,
};
use graintrain_linalg::triangles::{
    Triangle, gram, lower_gram, lower_times, multiply_triangle, subtract_lower_square,
};

/// Largest ||D R^-1||_F^2 / n at which a Gram matrix stands for its columns: at most two digits above
/// rounding level.
const CONDITION: f64 = 100.0;
/// Squared lengths of columns outside this range may overflow or vanish in products: no Gram matrix of them.
pub(crate) const SQUARES: std::ops::Range<f64> = 1e-200..1e200;
/// What is left of a row of length one is not resolved by the Gram matrix below this square.
const UNRESOLVED: f64 = 1e-8;
/// Rows are dependent on others if less than this part of their length is left: the backward error of a QR.
const DEPENDENT: f64 = 16.0 * f64::EPSILON;
/// Share of the squared norm above which the eigenvalues of a Gram matrix (errors about n eps of the largest)
/// can choose a rank.
const RESOLVED_SHARE: f64 = 1e-11;

/// R with A^T A = R^T R for well-conditioned columns of A.
pub(crate) struct SafeCholesky {
    factor: Cholesky,
    /// R^-T; zeros above the diagonal.
    inverse: Matrix,
    /// ||R^-1||_F^2, so that no singular value of A is below 1 / sqrt of it.
    inverse_squared: f64,
}

impl SafeCholesky {
    /// From the lower triangle of A^T A; none where the columns of A are too dependent (see the module), or
    /// where there are none.
    pub(crate) fn new(gram: &Matrix) -> Option<Self> {
        Self::accepted(moderate_cholesky(gram)?, gram)
    }

    /// From the factor of a Gram matrix.
    fn accepted(factor: Cholesky, gram: &Matrix) -> Option<Self> {
        let n = gram.rows();
        let inverse = factor.inverse_of_lower();
        let (mut size, mut inverse_squared) = (0.0, 0.0);
        for j in 0..n {
            let row = sum_of_squares(&inverse.column(j)[j..]);
            size += gram[(j, j)] * row;
            inverse_squared += row;
        }
        (size <= CONDITION * n as f64).then_some(Self { factor, inverse, inverse_squared })
    }

    /// L = R^T, with zeros above the diagonal.
    pub(crate) fn lower(&self) -> Matrix {
        without_upper_triangle(self.factor.lower().clone())
    }

    /// A R^-1: orthonormal columns if A is the matrix of the factor.
    pub(crate) fn orthonormal(&self, a: View<'_>) -> Matrix {
        let mut result = Matrix::zeros(a.rows(), a.columns());
        multiply_triangle(1.0, a, self.inverse.t(), Triangle::Upper, result.data_mut());
        result
    }

    /// R^-T A^T, given A^T: orthonormal rows if A is the matrix of the factor.
    fn orthonormal_rows(&self, transposed: View<'_>) -> Matrix {
        let mut result = Matrix::zeros(transposed.rows(), transposed.columns());
        lower_times(self.inverse.view(), transposed, &mut result);
        result
    }
}

/// [`SafeCholesky::lower`], without the inverse where a bound of it will do.
fn safe_lower(gram: &Matrix) -> Option<Matrix> {
    let factor = moderate_cholesky(gram)?;
    if bound_of_condition(factor.lower(), gram) <= CONDITION * gram.rows() as f64 {
        return Some(without_upper_triangle(factor.lower().clone()));
    }
    Some(SafeCholesky::accepted(factor, gram)?.lower())
}

/// The factor of a Gram matrix whose diagonal is of moderate size.
fn moderate_cholesky(gram: &Matrix) -> Option<Cholesky> {
    let moderate = (0..gram.rows()).all(|i| SQUARES.contains(&gram[(i, i)]));
    if gram.rows() > 0 && moderate { Cholesky::new(gram.clone()).ok() } else { None }
}

/// A bound of ||D R^-1||_F^2: the sums of the rows of |L^-1 D| are at most M^-1 d for the comparison matrix M
/// of L, |l_ii| on its diagonal and -|l_ij| below (Higham, Accuracy and Stability of Numerical Algorithms,
/// 2002, section 8.3). Close up to some thirty columns; n^2 flops, an inverse takes n^3 / 3.
fn bound_of_condition(lower: &Matrix, gram: &Matrix) -> f64 {
    let n = lower.rows();
    let mut sums: Vec<f64> = (0..n).map(|i| gram[(i, i)].sqrt()).collect();
    for j in 0..n {
        let column = &lower.column(j)[j..];
        sums[j] /= column[0];
        let sum = sums[j];
        sums[j + 1..].iter_mut().zip(&column[1..]).for_each(|(x, l)| *x += l.abs() * sum);
    }
    sum_of_squares(&sums)
}

/// Zeros above the diagonal.
fn without_upper_triangle(mut a: Matrix) -> Matrix {
    let n = a.rows();
    a.data_mut().chunks_exact_mut(n).enumerate().for_each(|(j, column)| column[..j].fill(0.0));
    a
}

/// The numbers of a view as a matrix of its own.
fn owned(a: View<'_>) -> Matrix {
    Matrix::from_fn(a.rows(), a.columns(), |i, j| a.get(i, j))
}

/// R with A^T A = R^T R and at most as many rows as A, for a matrix of any shape.
pub(crate) fn triangle(a: View<'_>) -> Matrix {
    if a.rows() <= a.columns() {
        return owned(a);
    }
    match SafeCholesky::new(&lower_gram(a)) {
        Some(factor) => factor.lower().transposed(),
        None => qr_triangle(owned(a)),
    }
}

/// L with A A^T = L L^T for a wide matrix A with well-conditioned rows of moderate size; none for others.
pub(crate) fn safe_lower_triangle(a: View<'_>) -> Option<Matrix> {
    if a.columns() <= a.rows() {
        return None;
    }
    safe_lower(&lower_gram(a.t()))
}

/// L with A A^T = L L^T and at most as many columns as A, for a matrix of any shape.
pub(crate) fn lower_triangle(a: View<'_>) -> Matrix {
    if a.columns() <= a.rows() {
        return owned(a);
    }
    safe_lower_triangle(a).unwrap_or_else(|| qr_triangle(owned(a.t())).transposed())
}

/// L with A = L Q for some orthonormal rows of Q, with as few columns as the rows of A have independent ones
/// at rounding level (where the Gram matrix tells; never more than rows or columns of A).
pub(crate) fn row_factor(a: View<'_>) -> Matrix {
    row_factor_by(a, &gram(a.t()))
}

/// [`row_factor`] of rows of moderate size; none for others.
pub(crate) fn moderate_row_factor(a: View<'_>) -> Option<Matrix> {
    let squares = gram(a.t());
    (0..a.rows()).all(|i| SQUARES.contains(&squares[(i, i)])).then(|| row_factor_by(a, &squares))
}

/// [`row_factor`] with A A^T.
fn row_factor_by(a: View<'_>, squares: &Matrix) -> Matrix {
    let wide = a.columns() > a.rows();
    if wide && let Some(lower) = safe_lower(squares) {
        return lower;
    }
    match dependent_rows(a, squares) {
        Some(lower) => lower,
        None if wide => qr_triangle(owned(a.t())).transposed(),
        None => owned(a),
    }
}

/// These rows of A.
fn some_rows(a: View<'_>, rows: &[usize]) -> Matrix {
    Matrix::from_fn(rows.len(), a.columns(), |i, j| a.get(rows[i], j))
}

/// [`row_factor`] of rows that depend on few of them A_S: L = A Q^T for an orthonormal basis Q of these, Q =
/// L_S^-1 A_S with A_S A_S^T = L_S L_S^T where they are well conditioned, else by reflections. What this
/// leaves of every row is formed and measured; none unless all of it is rounding.
fn dependent_rows(a: View<'_>, squares: &Matrix) -> Option<Matrix> {
    let (m, most) = (a.rows(), a.rows().min(a.columns()));
    let lengths: Vec<f64> = (0..m).map(|i| squares[(i, i)].sqrt()).collect();
    let pivots = independent_rows(squares, &lengths, most);
    if pivots.is_empty() || pivots.len() == most {
        return None;
    }
    let kept = Matrix::from_fn(pivots.len(), pivots.len(), |i, j| squares[(pivots[i], pivots[j])]);
    let kept_rows = some_rows(a, &pivots);
    let (lower, turned) = match SafeCholesky::new(&kept) {
        Some(factor) => {
            let products = Matrix::from_fn(m, pivots.len(), |i, j| squares[(i, pivots[j])]);
            (factor.orthonormal(products.view()), factor.orthonormal_rows(kept_rows.view()))
        }
        None => {
            let q = thin_qr(kept_rows.transposed()).0;
            (product(a, q.view()), q.transposed())
        }
    };
    // (Rows S are L_S Q but for the rounding of their factor.)
    let others: Vec<usize> = (0..m).filter(|i| !pivots.contains(i)).collect();
    let mut rest = some_rows(a, &others);
    let others_lower = some_rows(lower.view(), &others);
    multiply_add(-1.0, others_lower.view(), turned.view(), rest.view_mut());
    let mut left_over = vec![0.0; others.len()];
    for column in rest.data().chunks_exact(others.len()) {
        left_over.iter_mut().zip(column).for_each(|(sum, x)| *sum += x * x);
    }
    let negligible = |(square, &i): (&f64, &usize)| square.sqrt() <= DEPENDENT * lengths[i];
    left_over.iter().zip(&others).all(negligible).then_some(lower)
}

/// Rows S of A and C with A = C A_S, where every row keeps 16 eps of its own length; C is the identity on S.
/// None if no row can be left out. (C = A A_S^T (A_S A_S^T)^-1 is made from the Gram matrix and improved once
/// by what it leaves over.)
pub(crate) fn interpolative_rows(a: &Matrix) -> Option<(Vec<usize>, Matrix)> {
    let (m, n) = (a.rows(), a.columns());
    // Rows brought to length one, so that neither sums of squares nor combinations know their units.
    let largest = |i: usize| (0..n).fold(0.0_f64, |largest, j| a[(i, j)].abs().max(largest));
    let length = |i: usize| {
        let unit = largest(i);
        if unit > 0.0 { unit * (0..n).map(|j| (a[(i, j)] / unit).powi(2)).sum::<f64>().sqrt() } else { 0.0 }
    };
    let lengths: Vec<f64> = (0..m).map(length).collect();
    let unit = |i: usize, x: f64| if lengths[i] > 0.0 { x / lengths[i] } else { 0.0 };
    let rows = Matrix::from_fn(m, n, |i, j| unit(i, a[(i, j)]));
    let squares = gram(rows.t());
    let ones: Vec<f64> = lengths.iter().map(|&x| f64::from(x > 0.0)).collect();
    let kept = independent_rows(&squares, &ones, m.min(n));
    if kept.is_empty() || kept.len() == m {
        return None;
    }
    let factor =
        SafeCholesky::new(&Matrix::from_fn(kept.len(), kept.len(), |i, j| squares[(kept[i], kept[j])]))?;
    let basis = Matrix::from_fn(kept.len(), n, |i, j| rows[(kept[i], j)]);
    let solve = |mut of_basis: Matrix| {
        factor.factor.solve_in_place(of_basis.view_mut());
        of_basis.transposed()
    };
    let mut combinations = solve(product(basis.view(), rows.t()));
    let mut rest = rows.clone();
    multiply_add(-1.0, combinations.view(), basis.view(), rest.view_mut());
    let correction = solve(product(basis.view(), rest.t()));
    combinations.data_mut().iter_mut().zip(correction.data()).for_each(|(c, x)| *c += x);
    // Combinations of explicit constructions are small integers or zero: what is rounding around them goes.
    combinations.data_mut().iter_mut().for_each(|c| {
        if (*c - c.round()).abs() <= DEPENDENT {
            *c = c.round();
        }
    });
    for (s, &row) in kept.iter().enumerate() {
        (0..kept.len()).for_each(|j| combinations[(row, j)] = f64::from(j == s));
    }
    let mut rest = rows;
    multiply_add(-1.0, combinations.view(), basis.view(), rest.view_mut());
    let left_over = |i: usize| (0..n).map(|j| rest[(i, j)].powi(2)).sum::<f64>().sqrt();
    if (0..m).any(|i| left_over(i) > DEPENDENT) {
        return None;
    }
    let back = Matrix::from_fn(m, kept.len(), |i, j| combinations[(i, j)] * (lengths[i] / lengths[kept[j]]));
    Some((kept, back))
}

/// Pivots that are taken before the rest of the Gram matrix is brought up to date, at the rate of a product.
const PIVOTS_TOGETHER: usize = 32;

/// Pivots of the Cholesky factorization of the Gram matrix of rows brought to length one, until what is left
/// of every row is [`UNRESOLVED`] or `most` are found. O(m^2 most).
fn independent_rows(squares: &Matrix, lengths: &[f64], most: usize) -> Vec<usize> {
    let m = lengths.len();
    let inverse: Vec<f64> = lengths.iter().map(|x| if *x > 0.0 { 1.0 / x } else { 0.0 }).collect();
    let mut left: Vec<f64> = lengths.iter().map(|x| f64::from(*x > 0.0)).collect();
    let mut rest = Matrix::from_fn(m, m, |i, j| squares[(i, j)] * inverse[i] * inverse[j]);
    let (mut columns, mut pivots): (Vec<f64>, Vec<usize>) = (Vec::new(), Vec::new());
    while pivots.len() < most {
        let (mut pivot, mut largest) = (0, UNRESOLVED);
        for (i, x) in left.iter().enumerate() {
            if *x > largest {
                (pivot, largest) = (i, *x);
            }
        }
        if largest == UNRESOLVED {
            break;
        }
        if columns.len() == m * PIVOTS_TOGETHER {
            subtract_lower_square(View::new(&columns, m, PIVOTS_TOGETHER), &mut rest);
            columns.clear();
        }
        // (The lower triangle alone is kept up to date.)
        let mut column: Vec<f64> = (0..pivot).map(|i| rest[(pivot, i)]).collect();
        column.extend_from_slice(&rest.column(pivot)[pivot..]);
        for earlier in columns.chunks_exact(m) {
            let weight = earlier[pivot];
            column.iter_mut().zip(earlier).for_each(|(x, y)| *x -= weight * y);
        }
        let scale = 1.0 / largest.sqrt();
        column.iter_mut().zip(&mut left).for_each(|(x, left)| {
            *x *= scale;
            *left -= *x * *x;
        });
        left[pivot] = 0.0;
        columns.extend(column);
        pivots.push(pivot);
    }
    pivots
}

/// An orthonormal basis of the columns of A if every singular value certainly exceeds the root of `share` (so
/// that none may be left out) and the Gram matrix of the columns is well conditioned.
pub(crate) fn all_columns(a: &Matrix, share: f64) -> Option<Matrix> {
    if a.columns() == 0 {
        return Some(a.clone());
    }
    if a.rows() < a.columns() {
        return None;
    }
    let factor = SafeCholesky::new(&lower_gram(a.view()))?;
    (1.0 > 1.01 * share * factor.inverse_squared).then(|| factor.orthonormal(a.view()))
}

/// Orthonormal columns that hold A (its leading left singular vectors, or any basis of all its columns where
/// none can be left out) within the share of the budget, which is charged for what they leave out.
pub(crate) fn leading_columns(a: &Matrix, budget: &mut Budget) -> Result<Matrix, DenseError> {
    if a.columns() <= budget.max_rank()
        && let Some(basis) = all_columns(a, budget.share())
    {
        budget.charge(0.0);
        return Ok(basis);
    }
    if let Some((basis, left_out)) = columns_by_eigenvalues(a, budget)? {
        budget.charge(left_out);
        return Ok(basis);
    }
    if a.rows() < a.columns() {
        let (mut u, s) = left_svd(a.view())?;
        u.truncate_columns(budget.rank(&s.iter().map(|s| s * s).collect::<Vec<_>>()));
        return Ok(u);
    }
    // Whether a rank can be saved is known before any singular value: at the ends of a train, where
    // unfoldings are square and too ill conditioned for their Gram matrices, none can.
    let (q, r) = thin_qr(a.clone());
    if a.columns() <= budget.max_rank() && 1.0 > 1.01 * budget.share() * inverse_squared(&r) {
        budget.charge(0.0);
        return Ok(q);
    }
    let (u, s) = left_svd(r.view())?;
    let rank = budget.rank(&s.iter().map(|s| s * s).collect::<Vec<_>>());
    Ok(product(q.view(), u.first_columns(rank)))
}

/// ||R^-1||_F^2 of a triangle; not finite where a pivot is zero.
fn inverse_squared(r: &Matrix) -> f64 {
    let mut inverse = Matrix::identity(r.rows());
    solve_upper_on_the_right(inverse.view_mut(), r.view());
    inverse.data().iter().map(|x| x * x).sum()
}

/// Leading left singular vectors from the eigenvectors of a Gram matrix, and the squared norm of what they
/// leave out; none where eigenvalues do not resolve the share of the budget or did not choose enough.
fn columns_by_eigenvalues(a: &Matrix, budget: &Budget) -> Result<Option<(Matrix, f64)>, DenseError> {
    let tall = a.rows() >= a.columns();
    let squares = if tall { gram(a.view()) } else { gram(a.t()) };
    let norm_squared: f64 = (0..squares.rows()).map(|i| squares[(i, i)]).sum();
    if budget.share() < RESOLVED_SHARE * norm_squared || !SQUARES.contains(&norm_squared) {
        return Ok(None);
    }
    let (values, vectors) = symmetric_eigen(squares.view())?;
    let descending: Vec<f64> = values.iter().rev().map(|x| x.max(0.0)).collect();
    let (rank, _) = budget.split(&descending);
    let leading = (0..rank).flat_map(|j| vectors.column(values.len() - 1 - j)).copied().collect();
    let mut basis = Matrix::from_vec(values.len(), rank, leading);
    if tall {
        let image = product(a.view(), basis.view());
        let Some(factor) = SafeCholesky::new(&lower_gram(image.view())) else { return Ok(None) };
        basis = factor.orthonormal(image.view());
    }
    // What is left out, as it is and not as the eigenvalues have it.
    let mut rest = a.clone();
    multiply_add(-1.0, basis.view(), product(basis.t(), a.view()).view(), rest.view_mut());
    let left_out: f64 = rest.data().iter().map(|x| x * x).sum();
    Ok((left_out <= budget.share() || rank == budget.max_rank()).then_some((basis, left_out)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Truncation;
    use crate::random::Random;
    use graintrain_linalg::dense::thin_svd;
    use proptest::prelude::*;

    fn sample(rows: usize, columns: usize, random: &mut Random) -> Matrix {
        Matrix::from_fn(rows, columns, |_, _| random.symmetric())
    }

    /// Rows of which `rank` are independent, in units that differ by up to 10^spread, with a part of size
    /// 10^-near of full rank: dependent, nearly dependent or independent.
    fn rows(m: usize, n: usize, rank: usize, spread: f64, near: f64, random: &mut Random) -> Matrix {
        let mut a = product(sample(m, rank, random).view(), sample(rank, n, random).view());
        let noise = 10f64.powf(-near);
        let units: Vec<f64> = (0..m).map(|_| 10f64.powf(spread * random.symmetric())).collect();
        for (e, x) in a.data_mut().iter_mut().enumerate() {
            *x = (*x + noise * random.symmetric()) * units[e % m];
        }
        a
    }

    /// max |(X X^T - Y Y^T)_ij| / (|x_i| |x_j|) over rows.
    fn distance_of_rows(x: &Matrix, y: &Matrix) -> f64 {
        let (a, b) = (gram(x.t()), gram(y.t()));
        let m = x.rows();
        let entries = (0..m).flat_map(|i| (0..m).map(move |j| (i, j)));
        entries
            .map(|(i, j)| {
                (a[(i, j)] - b[(i, j)]).abs() / (a[(i, i)] * a[(j, j)]).sqrt().max(f64::MIN_POSITIVE)
            })
            .fold(0.0, f64::max)
    }

    proptest! {
        #[test]
        fn factors_keep_every_row_to_rounding(
            m in 1usize..30, n in 1usize..60, rank in 1usize..30, spread in 0.0..20.0f64, near in 0.0..18.0f64, seed in any::<u64>(),
        ) {
            let a = rows(m, n, rank, spread, near, &mut Random::new(seed));
            let lower = row_factor(a.view());
            prop_assert!(lower.columns() <= m.min(n));
            prop_assert!(distance_of_rows(&a, &lower) < 1e-13);
            if m > 1 && n > m && rank < m && near > 17.0 && spread < 1.0 {
                // (Rank many rows of a random matrix may be too ill conditioned for their Gram matrix.)
                prop_assert!(lower.columns() == rank || lower.columns() == m, "{} of {rank}", lower.columns());
            }
            let upper = triangle(a.t());
            prop_assert!(upper.rows() <= m.max(n) && distance_of_rows(&a, &upper.transposed()) < 1e-13);
        }

        #[test]
        fn leading_columns_are_as_few_and_as_good_as_those_of_the_svd(
            m in 1usize..40, n in 1usize..20, decay in 0.0..3.0f64, digits in 0.3..14.0f64, cap in 1usize..25, seed in any::<u64>(),
        ) {
            let mut random = Random::new(seed);
            let (left, right) = (sample(m, m.min(n), &mut random), sample(m.min(n), n, &mut random));
            let weighted = Matrix::from_fn(m, m.min(n), |i, j| left[(i, j)] * (-decay * j as f64).exp());
            let a = product(weighted.view(), right.view());
            let norm_squared: f64 = a.data().iter().map(|x| x * x).sum();
            let truncation = Truncation::capped(10f64.powf(-digits), cap);
            let mut budget = Budget::new(&truncation, norm_squared, 1);
            let expected = budget.split(&thin_svd(a.view()).unwrap().s.iter().map(|s| s * s).collect::<Vec<_>>());
            let basis = leading_columns(&a, &mut budget).unwrap();
            let report = budget.report(norm_squared, 0.0);
            let identity = product(basis.t(), basis.view());
            for (e, x) in identity.data().iter().enumerate() {
                prop_assert!((x - f64::from(e % (basis.columns() + 1) == 0)).abs() < 1e-11);
            }
            let mut rest = a.clone();
            multiply_add(-1.0, basis.view(), product(basis.t(), a.view()).view(), rest.view_mut());
            let truth = (rest.data().iter().map(|x| x * x).sum::<f64>() / norm_squared).sqrt();
            prop_assert!(report.capped || truth <= truncation.tolerance + 1e-13, "{truth} {truncation:?}");
            prop_assert!((truth - report.error).abs() <= 1e-6 * report.error + 1e-13, "{truth} {report:?}");
            prop_assert!(basis.columns() <= cap);
            // (One more where a singular value is at the limit to within the resolution of a Gram matrix.)
            prop_assert!(basis.columns() <= expected.0 + 1 && (basis.columns() == expected.0 || truth > 0.99 * truncation.tolerance - 1e-13));
        }
    }

    #[test]
    fn the_bound_of_the_condition_bounds_it() {
        let mut random = Random::new(7);
        for (m, n, spread) in [(1, 4, 0.0), (20, 80, 0.0), (20, 80, 20.0), (50, 60, 5.0), (100, 400, 0.0)] {
            let units: Vec<f64> = (0..m).map(|_| 10f64.powf(spread * random.symmetric())).collect();
            let a = Matrix::from_fn(m, n, |i, _| units[i] * random.symmetric());
            let squares = gram(a.t());
            let factor = Cholesky::new(squares.clone()).unwrap();
            let inverse = factor.inverse_of_lower();
            let exact: f64 =
                (0..m).map(|j| squares[(j, j)] * (j..m).map(|i| inverse[(i, j)].powi(2)).sum::<f64>()).sum();
            let bound = bound_of_condition(factor.lower(), &squares);
            assert!(bound >= exact * (1.0 - 1e-12), "{m} {n} {bound} {exact}");
            // Close enough to spare the inverse of a core of rank 20.
            assert!(m != 20 || bound <= CONDITION * m as f64, "{bound} {exact}");
        }
    }

    #[test]
    fn dependent_rows_are_left_out_and_nearly_dependent_ones_kept() {
        let mut random = Random::new(3);
        let a = sample(8, 60, &mut random);
        for (gap, expected) in [(0.0, 8), (1e-17, 8), (1e-12, 16), (1e-4, 16), (1.0, 16)] {
            let b = sample(8, 60, &mut random);
            let twice =
                Matrix::from_fn(16, 60, |i, j| a[(i % 8, j)] + if i < 8 { 0.0 } else { gap * b[(i - 8, j)] });
            assert_eq!(row_factor(twice.view()).columns(), expected, "{gap:e}");
        }
        assert_eq!(row_factor(Matrix::zeros(3, 7).view()), Matrix::zeros(3, 3));
        assert_eq!(row_factor(Matrix::zeros(0, 7).view()).rows(), 0);
    }
}
