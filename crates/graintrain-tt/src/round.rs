//! Orthogonalisation, norms, rounding and TT-SVD.
//!
//! A train is left-orthogonal up to core k if the left unfoldings of cores 1..k-1 have orthonormal columns, and
//! right-orthogonal if the right unfoldings of cores k+1..d have orthonormal rows. Then the singular values of the
//! k-th unfolding of the whole tensor are those of core k, and a truncation there is a truncation of the tensor.

use crate::error::at_core;
use crate::vector::Core;
use crate::{TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{Matrix, Svd, View, ViewMut, multiply, thin_qr, thin_svd};
use serde::{Deserialize, Serialize};

/// How far a train may be shortened: relative Frobenius error and a cap on the ranks.
///
/// ```
/// let truncation = graintrain_tt::Truncation::default();
/// assert_eq!((truncation.tolerance, truncation.max_rank), (1e-10, usize::MAX));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Truncation {
    /// Relative error in the Frobenius norm that the truncation may make, in [0, 1).
    pub tolerance: f64,
    /// No rank above this. Where the cap binds, the error exceeds the tolerance and the achieved one is reported.
    pub max_rank: usize,
}

impl Default for Truncation {
    fn default() -> Self {
        Self { tolerance: 1e-10, max_rank: usize::MAX }
    }
}

impl Truncation {
    /// A tolerance without a cap on the ranks.
    pub fn to(tolerance: f64) -> Self {
        Self { tolerance, ..Self::default() }
    }

    /// A tolerance and a cap on the ranks.
    pub fn capped(tolerance: f64, max_rank: usize) -> Self {
        Self { tolerance, max_rank }
    }

    /// Fails unless the tolerance lies in [0, 1) and the cap is at least 1.
    pub(crate) fn check(&self) -> Result<(), TtError> {
        if !(0.0..1.0).contains(&self.tolerance) {
            return Err(TtError::Setting { what: "tolerance", need: "in [0, 1)", got: self.tolerance });
        }
        if self.max_rank == 0 {
            return Err(TtError::Setting { what: "max_rank", need: "at least 1", got: 0.0 });
        }
        Ok(())
    }
}

/// What a truncation did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruncationReport {
    /// Relative Frobenius error: sqrt(sum of all discarded squared singular values) / norm. The projections are
    /// nested, so this is the error itself, not a bound (up to rounding, about 1e-15).
    pub error: f64,
    /// Frobenius norm of the tensor before the truncation.
    pub norm: f64,
    /// Whether the cap on the ranks made the error exceed the tolerance.
    pub capped: bool,
}

/// The squared error still allowed, handed from bond to bond: what one bond does not use, later bonds may.
pub(crate) struct Budget {
    allowed: f64,
    used: f64,
    bonds: usize,
    max_rank: usize,
}

impl Budget {
    /// For a tensor of the given squared norm with `bonds` bonds left to truncate.
    pub(crate) fn new(truncation: &Truncation, norm_squared: f64, bonds: usize) -> Self {
        let allowed = truncation.tolerance.powi(2) * norm_squared;
        Self { allowed, used: 0.0, bonds, max_rank: truncation.max_rank }
    }

    /// The rank to keep from descending squared singular values, at least 1.
    pub(crate) fn rank(&mut self, squares: &[f64]) -> usize {
        let share = (self.allowed - self.used).max(0.0) / self.bonds.max(1) as f64;
        self.bonds = self.bonds.saturating_sub(1);
        let (mut rank, mut tail) = (squares.len(), 0.0);
        // Values below rounding level of the largest carry no information and are dropped at no charge.
        let negligible = squares.first().map_or(0.0, |s| s * f64::EPSILON.powi(2));
        while rank > 1 && (tail + squares[rank - 1] <= share || squares[rank - 1] <= negligible) {
            tail += squares[rank - 1];
            rank -= 1;
        }
        while rank > self.max_rank {
            tail += squares[rank - 1];
            rank -= 1;
        }
        self.used += tail;
        rank
    }

    /// The report for a tensor of this squared norm.
    pub(crate) fn report(&self, norm_squared: f64) -> TruncationReport {
        let error = if norm_squared > 0.0 { (self.used / norm_squared).sqrt() } else { 0.0 };
        // Rounding-level tails of exact ranks are not an effect of the cap.
        let capped = self.used > self.allowed.max(norm_squared * 1e-28);
        TruncationReport { error, norm: norm_squared.sqrt(), capped }
    }
}

/// diag(s) V^T restricted to the first `rank` rows.
pub(crate) fn scaled_rows(s: &[f64], v: &Matrix, rank: usize) -> Matrix {
    Matrix::from_fn(rank, v.rows(), |i, j| s[i] * v[(j, i)])
}

impl TtVector {
    /// Makes cores 1..d-1 left-orthogonal (QR sweep to the right); the last core then holds the norm. O(d n r^3).
    pub fn orthogonalise_left(&mut self) {
        for k in 0..self.num_cores() - 1 {
            self.shift_right(k);
        }
    }

    /// Makes cores 2..d right-orthogonal (LQ sweep to the left); the first core then holds the norm. O(d n r^3).
    pub fn orthogonalise_right(&mut self) {
        for k in (1..self.num_cores()).rev() {
            self.shift_left(k);
        }
    }

    /// QR of core k; R goes into core k + 1.
    pub(crate) fn shift_right(&mut self, k: usize) {
        let core = std::mem::replace(&mut self.cores[k], Core::new(0, 0, 0, Vec::new()));
        let (left, mode) = (core.left, core.mode);
        let (q, r) = thin_qr(core.into_left_unfolding());
        self.cores[k] = Core::from_left_unfolding(left, mode, q);
        self.cores[k + 1] = self.cores[k + 1].multiply_left(r.view());
    }

    /// LQ of core k; L goes into core k - 1.
    pub(crate) fn shift_left(&mut self, k: usize) {
        let core = &self.cores[k];
        let (mode, right) = (core.mode, core.right);
        let (q, r) = thin_qr(Matrix::from_vec(core.left, mode * right, core.data.clone()).transposed());
        self.cores[k] = Core::from_right_unfolding(mode, right, q.transposed());
        self.cores[k - 1] = self.cores[k - 1].multiply_right(r.t());
    }

    /// Frobenius norm by a QR sweep: relative accuracy near rounding level also for small differences of large trains,
    /// where `dot(x, x)` loses half the digits. O(d n r^3).
    pub fn norm(&self) -> f64 {
        let (mantissa, exponent) = self.norm_scaled();
        mantissa * exponent.exp2()
    }

    /// ln of the Frobenius norm (minus infinity for zero): does not overflow where the norm itself would.
    pub fn log_norm(&self) -> f64 {
        let (mantissa, exponent) = self.norm_scaled();
        mantissa.ln() + exponent * std::f64::consts::LN_2
    }

    /// The norm as mantissa * 2^exponent.
    fn norm_scaled(&self) -> (f64, f64) {
        let mut r = Matrix::identity(1);
        let mut exponent = 0.0;
        for core in &self.cores {
            let next = core.multiply_left(r.view());
            r = if next.left * next.mode > next.right {
                thin_qr(next.into_left_unfolding()).1
            } else {
                next.into_left_unfolding()
            };
            let largest = r.data().iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
            if largest == 0.0 || !largest.is_finite() {
                return (largest, 0.0);
            }
            let power = largest.log2().floor();
            r.data_mut().iter_mut().for_each(|x| *x *= (-power).exp2());
            exponent += power;
        }
        (r.data().iter().map(|x| x * x).sum::<f64>().sqrt(), exponent)
    }

    /// The shortest train within the truncation (Oseledets 2011, Algorithm 2): an LQ sweep to the left, then a sweep of
    /// truncated SVDs to the right. O(d n r^3). The error never exceeds the tolerance unless the cap binds.
    ///
    /// # Errors
    /// [`TtError::Setting`] for a tolerance outside [0, 1) or a zero cap, [`TtError::Dense`] for entries that are not
    /// finite.
    ///
    /// ```
    /// use graintrain_tt::{Truncation, TtVector};
    /// let x = TtVector::random(&[2; 12], 4, 1)?;
    /// let (twice, report) = x.add(&x)?.round(&Truncation::to(1e-12))?;
    /// assert_eq!(twice.ranks(), x.ranks());
    /// assert!(report.error <= 1e-12);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn round(&self, truncation: &Truncation) -> Result<(Self, TruncationReport), TtError> {
        truncation.check()?;
        let mut train = self.clone();
        let log_scale = train.balance_and_orthogonalise_right();
        let report = train.truncate_right(truncation)?;
        let scale = (log_scale / train.num_cores() as f64).exp();
        train.cores.iter_mut().for_each(|core| core.data.iter_mut().for_each(|x| *x *= scale));
        Ok((train, TruncationReport { norm: report.norm * log_scale.exp(), ..report }))
    }

    /// Right-orthogonalises while factoring out the size of every triangle, so that long trains do not overflow.
    /// Returns ln of the factor taken out; the first core then has norm one (or zero).
    fn balance_and_orthogonalise_right(&mut self) -> f64 {
        let mut log_scale = 0.0;
        for k in (0..self.num_cores()).rev() {
            let size = self.cores[k].data.iter().map(|x| x * x).sum::<f64>().sqrt();
            if size > 0.0 && size.is_finite() {
                self.cores[k].data.iter_mut().for_each(|x| *x /= size);
                log_scale += size.ln();
            }
            if k > 0 {
                self.shift_left(k);
            }
        }
        log_scale
    }

    /// Truncated SVDs from left to right of a train whose cores 2..d are right-orthogonal.
    pub(crate) fn truncate_right(&mut self, truncation: &Truncation) -> Result<TruncationReport, TtError> {
        let d = self.num_cores();
        let norm_squared = self.cores[0].data.iter().map(|x| x * x).sum::<f64>();
        let mut budget = Budget::new(truncation, norm_squared, d - 1);
        for k in 0..d - 1 {
            let core = std::mem::replace(&mut self.cores[k], Core::new(0, 0, 0, Vec::new()));
            let (left, mode) = (core.left, core.mode);
            let Svd { mut u, s, v } = thin_svd(core.left_unfolding()).map_err(at_core(k))?;
            let squares: Vec<f64> = s.iter().map(|s| s * s).collect();
            let rank = budget.rank(&squares);
            u.truncate_columns(rank);
            self.cores[k] = Core::from_left_unfolding(left, mode, u);
            self.cores[k + 1] = self.cores[k + 1].multiply_left(scaled_rows(&s, &v, rank).view());
        }
        Ok(budget.report(norm_squared))
    }

    /// TT-SVD of a full tensor (Oseledets 2011, Algorithm 1), first index fastest: truncated SVDs of the unfoldings
    /// from left to right. Each tall unfolding is first reduced to a small triangle by QR of its transpose.
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
        let entries: usize = modes.iter().product();
        if modes.is_empty() || entries != full.len() || entries == 0 {
            return Err(TtError::Shape {
                what: "entries of a full tensor",
                expected: vec![entries],
                got: vec![full.len()],
            });
        }
        let d = modes.len();
        let norm_squared = full.iter().map(|x| x * x).sum::<f64>();
        let mut budget = Budget::new(truncation, norm_squared, d - 1);
        let mut cores = Vec::with_capacity(d);
        let mut rest = full.to_vec();
        let mut left = 1;
        for k in 0..d - 1 {
            let rows = left * modes[k];
            let columns = rest.len() / rows;
            let unfolding = View::new(&rest, rows, columns);
            let Svd { mut u, s, .. } = left_singular(unfolding).map_err(at_core(k))?;
            let squares: Vec<f64> = s.iter().map(|s| s * s).collect();
            let rank = budget.rank(&squares);
            u.truncate_columns(rank);
            let mut next = vec![0.0; rank * columns];
            multiply(1.0, u.t(), unfolding, ViewMut::new(&mut next, rank, columns));
            rest = next;
            cores.push(Core::from_left_unfolding(left, modes[k], u));
            left = rank;
        }
        cores.push(Core::new(left, modes[d - 1], 1, rest));
        Ok((Self { cores }, budget.report(norm_squared)))
    }

    /// ||self - other|| / ||other|| by the norm of the difference train (no cancellation); infinite where other is zero
    /// and self is not.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the modes differ.
    pub fn relative_distance(&self, other: &Self) -> Result<f64, TtError> {
        let difference = self.subtract(other)?.log_norm();
        let log = difference - other.log_norm();
        Ok(if difference == f64::NEG_INFINITY { 0.0 } else { log.exp() })
    }
}

/// Left singular vectors and values of a wide matrix through blocks of columns: R^T of a running QR keeps
/// A A^T = R^T R, so the small factor has the same left singular vectors. Only rows x rows numbers live at a time.
fn left_singular(a: View<'_>) -> Result<Svd, graintrain_linalg::dense::DenseError> {
    let (m, n) = (a.rows(), a.columns());
    if n <= 2 * m {
        return thin_svd(a);
    }
    let block = (4 * m).max(256);
    let mut triangle = Matrix::zeros(0, m);
    let mut first = 0;
    while first < n {
        let width = block.min(n - first);
        let kept = triangle.rows();
        let stacked = Matrix::from_fn(kept + width, m, |i, j| {
            if i < kept { triangle[(i, j)] } else { a.get(j, first + i - kept) }
        });
        triangle = thin_qr(stacked).1;
        first += width;
    }
    thin_svd(triangle.t())
}

impl TtMatrix {
    /// Frobenius norm by a QR sweep; see [`TtVector::norm`].
    pub fn norm(&self) -> f64 {
        self.train.norm()
    }

    /// The shortest train within the truncation; see [`TtVector::round`].
    ///
    /// # Errors
    /// As for [`TtVector::round`].
    pub fn round(&self, truncation: &Truncation) -> Result<(Self, TruncationReport), TtError> {
        let (train, report) = self.train.round(truncation)?;
        Ok((self.map(|_| train), report))
    }

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
        let (m, n) = (rows.iter().product::<usize>(), columns.iter().product::<usize>());
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

    /// ||self - other||_F / ||other||_F; see [`TtVector::relative_distance`].
    ///
    /// # Errors
    /// [`TtError::Shape`] if the sizes differ.
    pub fn relative_distance(&self, other: &Self) -> Result<f64, TtError> {
        self.train.relative_distance(&other.train)
    }
}
