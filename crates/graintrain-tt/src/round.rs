//! Orthogonalisation, norms and rounding.
//!
//! A train is left-orthogonal up to core k if the left unfoldings of cores 1..k-1 have orthonormal columns,
//! and right-orthogonal if the right unfoldings of cores k+1..d have orthonormal rows. Then the singular
//! values of the k-th unfolding of the whole tensor are those of core k, and a truncation there is a
//! truncation of the tensor.

use crate::cores::{Cores, Sum};
use crate::error::at_core;
use crate::factor::{
    leading_columns, lower_triangle, moderate_row_factor, row_factor, safe_lower_triangle, triangle,
};
use crate::scale::{binary_exponent, factor_out, largest_finite, levelled, share_power};
use crate::vector::{Core, with_length};
use crate::{TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{Matrix, left_svd, multiply, product, thin_qr};
use serde::{Deserialize, Serialize};

/// Backward error of the products, factors and sums at one core, relative to its size, Gram matrices
/// included: by measurement on 1500 cancelling sums.
pub(crate) const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Cores of fewer numbers live in memory that no allocator returns.
const SMALL_CORE: usize = 1 << 12;
/// Matrices as large as a core that live at the same time in a sweep.
const CORES_AT_ONCE: usize = 8;
/// Most numbers that an allocator is asked to keep (31 MiB).
const MOST_KEPT: usize = 31 << 17;

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
    /// No rank above this. Where the cap binds, the error exceeds the tolerance and the achieved one is
    /// reported.
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

/// The factors of the parts right of every bond of a train, cores divided by powers of two so that they are
/// of moderate size.
pub(crate) struct RightFactors {
    /// powers\[k\]: what core k is divided by.
    powers: Vec<i32>,
    /// right\[k\]: the cores after the k-th (from 0), divided so, are right\[k\] Q with orthonormal rows of
    /// Q.
    right: Vec<Matrix>,
}

impl RightFactors {
    /// From the right to the left; none for the zero tensor. O(d n r^3).
    fn new(train: &impl Cores) -> Result<Option<Self>, TtError> {
        let d = train.modes().len();
        keep_memory(train);
        let (mut powers, mut right) = (vec![0; d], vec![Matrix::identity(1); d]);
        let mut memory = Vec::new();
        for k in (0..d).rev() {
            // Where the product has rows of moderate size nothing overflowed or vanished in it, and the core
            // need not be looked at.
            let part = train.multiply_right(k, right[k].view(), 0, memory);
            let moderate = moderate_row_factor(part.right_unfolding());
            memory = part.data;
            let (mut factor, power) = match moderate {
                Some(factor) => (factor, 0),
                None => {
                    let Some(power) = train.exponent(k).map_err(at_core(k))? else { return Ok(None) };
                    let part = train.multiply_right(k, right[k].view(), -power, memory);
                    let factor = row_factor(part.right_unfolding());
                    memory = part.data;
                    (factor, power)
                }
            };
            let Some(second) = factor_out(factor.data_mut()) else { return Ok(None) };
            powers[k] = power + second;
            if k > 0 {
                right[k - 1] = factor;
            }
        }
        Ok(Some(Self { powers, right }))
    }

    /// What rounding of core k does to the tensor, squared and over eps^2, in the units of the factors, where
    /// `left` has the squared lengths of the columns of the part left of the core.
    fn rounding_of(&self, train: &impl Cores, k: usize, left: &[f64]) -> f64 {
        let right = &self.right[k];
        let mut lengths = vec![0.0; right.rows()];
        for column in right.data().chunks_exact(right.rows().max(1)) {
            lengths.iter_mut().zip(column).for_each(|(sum, x)| *sum += x * x);
        }
        train.weighted_square(k, left, &lengths, -self.powers[k])
    }

    /// The sum of all powers.
    fn exponent(&self) -> i64 {
        self.powers.iter().map(|&power| i64::from(power)).sum()
    }
}

/// An error that was measured, and what rounding leaves uncertain about it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// The error.
    pub value: f64,
    /// Rounding may have added or hidden this much: below it `value` says nothing.
    pub floor: f64,
}

/// What a truncation did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruncationReport {
    /// Relative Frobenius error: sqrt(sum of all discarded squared singular values) / norm. The projections
    /// are nested, so this is the error itself, not a bound (up to rounding, see `floor`).
    pub error: f64,
    /// Bound on the relative error that rounding may have added: the true error is at most `error` + `floor`.
    /// Near 1e-15, but where a train cancels (a - a + 1e-12 b) its terms lose digits before anything is
    /// truncated; see [`TtVector::rounding_floor`].
    pub floor: f64,
    /// Frobenius norm of the tensor before the truncation (infinite where it exceeds the largest float).
    pub norm: f64,
    /// Whether the cap on the ranks made the error exceed the tolerance.
    pub capped: bool,
}

impl TruncationReport {
    /// For the zero tensor.
    pub(crate) fn zero() -> Self {
        Self { error: 0.0, floor: 0.0, norm: 0.0, capped: false }
    }
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

    /// The squared error that the next bond may make.
    pub(crate) fn share(&self) -> f64 {
        (self.allowed - self.used).max(0.0) / self.bonds.max(1) as f64
    }

    /// The cap on the ranks.
    pub(crate) fn max_rank(&self) -> usize {
        self.max_rank
    }

    /// Counts what one bond leaves out.
    pub(crate) fn charge(&mut self, left_out: f64) {
        self.bonds = self.bonds.saturating_sub(1);
        self.used += left_out;
    }

    /// Counts what no bond leaves out.
    pub(crate) fn spend(&mut self, left_out: f64) {
        self.used += left_out;
    }

    /// The rank to keep from descending squared singular values, at least 1; charges for the others.
    pub(crate) fn rank(&mut self, squares: &[f64]) -> usize {
        let (rank, tail) = self.split(squares);
        self.charge(tail);
        rank
    }

    /// The rank to keep from descending squared singular values, at least 1, and the sum of the others.
    pub(crate) fn split(&self, squares: &[f64]) -> (usize, f64) {
        let share = self.share();
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
        (rank, tail)
    }

    /// The report for a tensor of this squared norm, whose relative rounding errors are `floor`.
    pub(crate) fn report(&self, norm_squared: f64, floor: f64) -> TruncationReport {
        let error = if norm_squared > 0.0 { (self.used / norm_squared).sqrt() } else { 0.0 };
        // Rounding-level tails of exact ranks are not an effect of the cap.
        let capped = self.used > self.allowed.max(norm_squared * 1e-28);
        TruncationReport { error, floor, norm: norm_squared.sqrt(), capped }
    }
}

/// The norm of numbers whose largest is zero or not finite, with exponent 0.
fn not_scalable(data: &[f64]) -> (f64, f64) {
    (if data.iter().all(|x| *x == 0.0) { 0.0 } else { f64::NAN }, 0.0)
}

/// Asks for the memory of a sweep in one piece and gives it back untouched: allocators keep what they were
/// once asked for at hand, in place of returning every matrix of a core to the system and having it zeroed
/// again page by page (a tenth of the time at ranks 50 to 200).
pub(crate) fn keep_memory(train: &impl Cores) {
    let modes = train.modes();
    let numbers = |k: usize| train.ranks(k).0.saturating_mul(modes[k]).saturating_mul(train.ranks(k).1);
    let largest = (0..modes.len()).map(numbers).max().unwrap_or(0);
    if largest >= SMALL_CORE {
        let whole = Vec::<f64>::with_capacity(largest.saturating_mul(CORES_AT_ONCE).min(MOST_KEPT));
        drop(std::hint::black_box(whole));
    }
}

/// The shortest train within the truncation of one that is given by what its cores do: see
/// [`TtVector::round`].
pub(crate) fn round_cores(
    train: &impl Cores,
    truncation: &Truncation,
) -> Result<(TtVector, TruncationReport), TtError> {
    truncation.check()?;
    let modes = train.modes();
    let Some(factors) = RightFactors::new(train)? else {
        return Ok((TtVector::constant(&modes, 0.0)?, TruncationReport::zero()));
    };
    let mut cores = Vec::with_capacity(modes.len());
    let mut core = train.multiply_left(0, Matrix::identity(1).view(), -factors.powers[0], Vec::new());
    let mut unfolding = product(core.left_unfolding(), factors.right[0].view());
    let norm_squared = sum_of_squares(unfolding.data());
    let mut rounding = factors.rounding_of(train, 0, &[1.0]);
    let mut budget = Budget::new(truncation, norm_squared, modes.len() - 1);
    for k in 1..modes.len() {
        let u = leading_columns(&unfolding, &mut budget).map_err(at_core(k - 1))?;
        let carry = product(u.t(), core.left_unfolding());
        cores.push(Core::from_left_unfolding(core.left, core.mode, u));
        rounding += factors.rounding_of(train, k, &squares_of_columns(&carry));
        core = train.multiply_left(k, carry.view(), -factors.powers[k], core.data);
        let (rows, columns) = (core.left * core.mode, factors.right[k].columns());
        unfolding = Matrix::from_vec(rows, columns, with_length(unfolding.into_vec(), rows * columns));
        multiply(1.0, core.left_unfolding(), factors.right[k].view(), unfolding.view_mut());
    }
    core.data.shrink_to_fit();
    cores.push(core);
    share_power(&mut cores, factors.exponent());
    let report = budget.report(norm_squared, ROUNDING * (rounding / norm_squared).sqrt());
    let norm = report.norm * (factors.exponent() as f64).exp2();
    Ok((TtVector { cores }, TruncationReport { norm, ..report }))
}

/// The norm, the size of what rounding of the cores may add to it (see [`TtVector::rounding_floor`]), and the
/// power of two that both are to be multiplied by. Both from triangles: nothing is subtracted. O(d n r^3).
pub(crate) fn norm_and_rounding(train: &impl Cores) -> Result<(f64, f64, i64), TtError> {
    let Some(factors) = RightFactors::new(train)? else { return Ok((0.0, 0.0, 0)) };
    let (mut left, mut rounding, mut taken_out) = (Matrix::identity(1), 0.0, 0.0_f64);
    let mut norm = 0.0;
    let mut memory = Vec::new();
    for k in 0..factors.powers.len() {
        rounding += factors.rounding_of(train, k, &squares_of_columns(&left)) * (2.0 * taken_out).exp2();
        let core = train.multiply_left(k, left.view(), -factors.powers[k], memory);
        if k == 0 {
            norm = sum_of_squares(product(core.left_unfolding(), factors.right[0].view()).data()).sqrt();
        }
        left = triangle(core.left_unfolding());
        memory = core.data;
        taken_out += f64::from(factor_out(left.data_mut()).unwrap_or(0));
    }
    Ok((norm, ROUNDING * rounding.sqrt(), factors.exponent()))
}

/// ||x - y|| / ||y|| without the floor: half the work of [`measured`].
pub(crate) fn relative_norm(difference: &impl Cores, reference: &impl Cores) -> Result<f64, TtError> {
    let (difference, power) = norm_by_factors(difference)?.unwrap_or((0.0, 0));
    let (reference, unit) = norm_by_factors(reference)?.unwrap_or((0.0, 0));
    Ok(if difference == 0.0 { 0.0 } else { difference / reference * ((power - unit) as f64).exp2() })
}

/// The norm over a power of two, and the power; none for zero.
fn norm_by_factors(train: &impl Cores) -> Result<Option<(f64, i64)>, TtError> {
    let Some(factors) = RightFactors::new(train)? else { return Ok(None) };
    let first = train.multiply_right(0, factors.right[0].view(), -factors.powers[0], Vec::new());
    Ok(Some((sum_of_squares(&first.data).sqrt(), factors.exponent())))
}

/// ||x - y|| / ||y|| for the difference `difference` and its reference.
pub(crate) fn measured(difference: &impl Cores, reference: &impl Cores) -> Result<Measured, TtError> {
    let (norm, rounding, power) = norm_and_rounding(difference)?;
    let (size, _, unit) = norm_and_rounding(reference)?;
    let relative = |x: f64| if x == 0.0 { 0.0 } else { x / size * ((power - unit) as f64).exp2() };
    Ok(Measured { value: relative(norm), floor: relative(rounding) })
}

/// Squared lengths of the columns.
fn squares_of_columns(a: &Matrix) -> Vec<f64> {
    (0..a.columns()).map(|j| sum_of_squares(a.column(j))).collect()
}

pub(crate) fn sum_of_squares(data: &[f64]) -> f64 {
    data.iter().map(|x| x * x).sum()
}

/// diag(s) V^T restricted to the first `rank` rows.
pub(crate) fn scaled_rows(s: &[f64], v: &Matrix, rank: usize) -> Matrix {
    Matrix::from_fn(rank, v.rows(), |i, j| s[i] * v[(j, i)])
}

impl TtVector {
    /// Makes cores 1..d-1 left-orthogonal (QR sweep to the right); the last core then holds the norm. O(d n
    /// r^3).
    pub fn orthogonalise_left(&mut self) {
        for k in 0..self.num_cores() - 1 {
            self.shift_right(k);
        }
    }

    /// Makes cores 2..d right-orthogonal (LQ sweep to the left); the first core then holds the norm. O(d n
    /// r^3).
    pub fn orthogonalise_right(&mut self) {
        for k in (1..self.num_cores()).rev() {
            self.shift_left(k);
        }
    }

    /// QR of core k; R goes into core k + 1.
    pub(crate) fn shift_right(&mut self, k: usize) {
        let core =
            std::mem::replace(&mut self.cores[k], Core { left: 0, mode: 0, right: 0, data: Vec::new() });
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

    /// Frobenius norm by a sweep of triangles: relative accuracy near rounding level also for small
    /// differences of large trains, where `dot(x, x)` loses half the digits. O(d n r^3).
    pub fn norm(&self) -> f64 {
        let (mantissa, exponent) = self.norm_scaled();
        mantissa * exponent.exp2()
    }

    /// ln of the Frobenius norm (minus infinity for zero): does not overflow where the norm itself would.
    pub fn log_norm(&self) -> f64 {
        let (mantissa, exponent) = self.norm_scaled();
        mantissa.ln() + exponent * std::f64::consts::LN_2
    }

    /// The norm as mantissa * 2^exponent: by the factors of the parts on the right, whose triangles are half
    /// as dear on that side.
    fn norm_scaled(&self) -> (f64, f64) {
        keep_memory(self);
        let mut lower = Matrix::identity(1);
        let (mut exponent, mut memory) = (0.0, Vec::new());
        for core in self.cores.iter().rev() {
            // Where the Gram matrix of the product is safe, its rows are of moderate size: nothing
            // overflowed, and the core need not be looked at.
            let part = core.multiply_right_in(lower.view(), 0, memory);
            let safe = safe_lower_triangle(part.right_unfolding());
            memory = part.data;
            if let Some(mut triangle) = safe
                && let Some(power) = factor_out(triangle.data_mut())
            {
                exponent += f64::from(power);
                lower = triangle;
                continue;
            }
            // The core alone first: its product with the triangle might overflow.
            let size = largest_finite(&core.data).unwrap_or(f64::NAN);
            if size.is_nan() || size == 0.0 {
                return (size, 0.0);
            }
            let power = binary_exponent(size);
            let part = core.multiply_right_scaled(lower.view(), -power);
            lower = lower_triangle(part.right_unfolding());
            let Some(second) = factor_out(lower.data_mut()) else { return not_scalable(lower.data()) };
            exponent += f64::from(power + second);
        }
        (sum_of_squares(lower.data()).sqrt(), exponent)
    }

    /// What the relative error that rounding of its own cores makes in a train, and so in everything computed
    /// from it, does not exceed:
    ///
    /// 64 eps sqrt(sum_k sum_{alpha, i, beta} |A_{<k}(:, alpha)|^2 G_k(alpha, i, beta)^2 |A_{>k}(beta, :)|^2)
    /// / ||A||
    ///
    /// with A_{<k} and A_{>k} the unfoldings of the parts left and right of core k. Near 1e-14 sqrt(d r) for
    /// trains that do not cancel; where terms cancel, as in a - a + 1e-12 b, it says how many digits are left
    /// at least. A bound, not an estimate: errors that were measured lie 20 to 38 000 times below it. (64 eps
    /// sqrt(d) times the product of all core norms over the norm bounds it from above.) 0 for the zero
    /// tensor. O(d n r^3).
    ///
    /// # Errors
    /// [`TtError::Dense`] for entries that are not finite.
    ///
    /// ```
    /// use graintrain_tt::TtVector;
    /// let (a, b) = (TtVector::random(&[2; 20], 3, 1)?, TtVector::random(&[2; 20], 3, 2)?);
    /// assert!(a.rounding_floor()? < 1e-12);
    /// let rest = a.subtract(&a)?.add(&b.scale(1e-12))?;
    /// assert!(rest.rounding_floor()? > 1e-5);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn rounding_floor(&self) -> Result<f64, TtError> {
        let (norm, rounding, _) = norm_and_rounding(self)?;
        Ok(if norm > 0.0 { rounding / norm } else { 0.0 })
    }

    /// The shortest train within the truncation (Oseledets 2011, Algorithm 2). O(d n r^3). The error never
    /// exceeds the tolerance by more than the `floor` of the report unless the cap binds.
    ///
    /// The factors L_k of the parts A_{>k} = L_k Q_k come from the right (Q is never formed), already without
    /// what depends on other rows at rounding level; from the left, the leading left singular vectors U_k of
    /// G_k L_k are the new core (any basis of its columns where no rank can be saved), and U_k^T G_k goes
    /// into the next one. The result is left-orthogonal. Both kinds of factors come from Gram matrices where
    /// this costs no accuracy, from QR and SVD elsewhere. Every core and triangle is scaled by a power of
    /// two, so sizes from 1e-300 to 1e300 per core do no harm.
    ///
    /// # Errors
    /// [`TtError::Setting`] for a tolerance outside [0, 1) or a zero cap, [`TtError::Dense`] for entries that
    /// are not finite.
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
        round_cores(self, truncation)
    }

    /// The train as 2^exponent times cores of which the parts right of every bond have a norm near 1; none
    /// for the zero tensor. O(d n r^3).
    pub(crate) fn balanced(&self) -> Result<Option<(Self, i64)>, TtError> {
        let Some(factors) = RightFactors::new(self)? else { return Ok(None) };
        let cores =
            self.cores.iter().zip(&factors.powers).map(|(core, &power)| core.scaled(-power)).collect();
        Ok(Some((Self { cores }, factors.exponent())))
    }

    /// Singular values of every unfolding (i_1 ... i_k) x (i_{k+1} ... i_d), k = 1..d-1, descending: they
    /// tell the ranks that any tolerance needs. From the triangles of the parts left and right of the bond;
    /// O(d n r^3).
    ///
    /// # Errors
    /// [`TtError::Dense`] for entries that are not finite.
    ///
    /// ```
    /// use graintrain_tt::qtt;
    /// // sin has two singular values at every bond.
    /// let values = qtt::sine(10, 0.1, 0.3)?.singular_values()?;
    /// assert!(values.iter().all(|s| s.len() == 2 && s[1] > 1e-3 * s[0]));
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn singular_values(&self) -> Result<Vec<Vec<f64>>, TtError> {
        let d = self.num_cores();
        let Some(factors) = RightFactors::new(self)? else { return Ok(vec![vec![0.0]; d - 1]) };
        let mut values = Vec::with_capacity(d - 1);
        let (mut left, mut taken_out) = (Matrix::identity(1), factors.exponent());
        for k in 0..d - 1 {
            let core = self.cores[k].multiply_left_scaled(left.view(), -factors.powers[k]);
            left = triangle(core.left_unfolding());
            taken_out += i64::from(factor_out(left.data_mut()).unwrap_or(0));
            let (_, mut s) =
                left_svd(product(left.view(), factors.right[k].view()).view()).map_err(at_core(k))?;
            s.iter_mut().for_each(|s| *s *= (taken_out as f64).exp2());
            values.push(s);
        }
        Ok(values)
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

    /// [`TtVector::relative_distance`] with its rounding floor.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the modes differ, [`TtError::Dense`] for entries that are not finite.
    ///
    /// ```
    /// use graintrain_tt::TtVector;
    /// let x = TtVector::random(&[2; 20], 3, 1)?;
    /// let error = x.measured_distance(&x.scale(1.0 + 1e-9))?;
    /// assert!((error.value / 1e-9 - 1.0).abs() < 1e-3 && error.floor < 1e-12);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn measured_distance(&self, other: &Self) -> Result<Measured, TtError> {
        self.check_same_modes(other)?;
        let (first, second) = (levelled(self), levelled(other));
        measured(&Sum { terms: vec![(1.0, first.as_ref()), (-1.0, second.as_ref())] }, other)
    }

    /// sum_i w_i x_i within the truncation, without its block-diagonal cores: the ranks and the error promise
    /// of rounding the sum, at the cost of its nonzero blocks only. O(d n r^3) for the sum r of the ranks;
    /// terms that depend on others are left out on the way.
    ///
    /// # Errors
    /// [`TtError::Shape`] if there is no term or the modes differ, else as for [`TtVector::round`].
    ///
    /// ```
    /// use graintrain_tt::{Truncation, TtVector};
    /// let x = TtVector::random(&[2; 12], 4, 1)?;
    /// let (zero, _) = TtVector::sum_rounded(&[(1.0, &x), (2.0, &x), (-3.0, &x)], &Truncation::to(1e-12))?;
    /// assert!(zero.norm() <= 1e-14 * x.norm());
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn sum_rounded(
        terms: &[(f64, &Self)],
        truncation: &Truncation,
    ) -> Result<(Self, TruncationReport), TtError> {
        let Some((_, first)) = terms.first() else {
            return Err(TtError::Shape { what: "terms of a sum", expected: vec![1], got: vec![0] });
        };
        terms.iter().try_for_each(|(_, term)| first.check_same_modes(term))?;
        let levelled: Vec<_> = terms.iter().map(|&(weight, term)| (weight, levelled(term))).collect();
        let terms = levelled.iter().map(|(weight, term)| (*weight, term.as_ref() as &dyn Cores)).collect();
        round_cores(&Sum { terms }, truncation)
    }
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

    /// ||self - other||_F / ||other||_F; see [`TtVector::relative_distance`].
    ///
    /// # Errors
    /// [`TtError::Shape`] if the sizes differ.
    pub fn relative_distance(&self, other: &Self) -> Result<f64, TtError> {
        self.train.relative_distance(&other.train)
    }
}
