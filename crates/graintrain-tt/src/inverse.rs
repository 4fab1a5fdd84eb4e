//! The inverse of a TT-matrix.
//!
//! A X = I is a linear system for the matrix X: its column digits are spectators, so every local system is
//! that of a vector unknown, factored once and solved for all of them (other libraries lift to (A (x) I) vec
//! X = vec I and pay n^3 times more per site). Four forms:
//!
//! * [`InverseForm::Energy`]: Galerkin, minimises tr(X^T A X) / 2 - tr X for symmetric positive definite A.
//!   The error is weighted by A: large eigenvalues are met first, and a truncated X may be indefinite.
//! * [`InverseForm::Residual`]: minimises ||A X - I||_F, any regular A: (A^T A) X = A^T with A^T A formed as
//!   a train.
//! * [`InverseForm::Galerkin`]: A X = I projected onto the span of the other cores for ANY regular matrix:
//!   local systems that are not symmetric are solved by LU, so the condition is not squared. A projection of
//!   an indefinite matrix may be singular; where the sweeps miss the tolerance the normal equations go on
//!   from the best iterate, and the better of both is returned.
//! * [`InverseForm::Symmetric`]: A X + X A = 2 I, whose exact solution is symmetric; ranks of the operator
//!   are 2 R and there is no spectator, so it is the dearest.
//!
//! [`newton_schulz`] is a second opinion: X <- 2 X - X A X with rounding.

use crate::solve::{
    MOST_TIGHTENING, SolveReport, SolveSettings, SolveStatus, measured_residual, solve_matrix_within,
    solve_within,
};
use crate::{Stop, Truncation, TtError, TtMatrix};
use serde::{Deserialize, Serialize};

/// Which equation defines the inverse.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum InverseForm {
    /// A X = I by Galerkin projection.
    Energy,
    /// (A^T A) X = A^T. The condition is squared: lines of more than about 2^10 points are out of its reach.
    Residual,
    /// A X = I by Galerkin projection for any regular matrix, normal equations where this fails.
    Galerkin,
    /// A X + X A = 2 I.
    Symmetric,
}

/// Approximates the inverse of A by AMEn (or ALS, DMRG: `settings.method`) from a hot start.
///
/// Without a start, X = c I with c = tr A / ||A||_F^2, which minimises ||I - c A||_F. The report's residual
/// is
/// ||A X - I||_F / ||I||_F for every form.
///
/// # Errors
/// [`TtError::Shape`] if A is not square or the start has other sizes; [`TtError::Setting`] and
/// [`TtError::Dense`] as for [`solve`](crate::solve::solve).
///
/// ```
/// use graintrain_tt::{inverse::{InverseForm, inverse}, qtt, solve::{SolveSettings, SolveStatus}};
/// let a = qtt::laplacian(6)?;
/// let settings = SolveSettings { tolerance: 1e-10, ..Default::default() };
/// let (x, report) = inverse(&a, InverseForm::Energy, None, &settings)?;
/// assert_eq!((report.status, x.max_rank()), (SolveStatus::Converged, 5));
/// // min(i, j) (n + 1 - max(i, j)) / (n + 1) at i = 3, j = 10 (from 1), n = 64
/// let entry = x.entries(&[(2, 9)])?[0];
/// assert!((entry - 3.0 * 55.0 / 65.0).abs() < 1e-8);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn inverse(
    a: &TtMatrix,
    form: InverseForm,
    start: Option<&TtMatrix>,
    settings: &SolveSettings,
) -> Result<(TtMatrix, SolveReport), TtError> {
    inverse_within(a, form, start, settings, &|| false)
}

/// As [`inverse`], as long as `stop` is false: it is asked at every site and for every right-hand side that
/// is iterated.
///
/// # Errors
/// As [`inverse`], and [`TtError::Stopped`].
pub fn inverse_within(
    a: &TtMatrix,
    form: InverseForm,
    start: Option<&TtMatrix>,
    settings: &SolveSettings,
    stop: Stop<'_>,
) -> Result<(TtMatrix, SolveReport), TtError> {
    a.check_square()?;
    settings.check()?;
    let identity = TtMatrix::identity(&a.rows)?;
    if a.train.log_norm() == f64::NEG_INFINITY {
        return Err(TtError::Setting { what: "norm of a matrix to invert", need: "positive", got: 0.0 });
    }
    let start = match start {
        Some(start) => {
            a.check_same_sizes(start)?;
            start.clone()
        }
        // (The norm may be too large to be squared.)
        None => identity.scale(a.trace()? / a.norm() / a.norm()),
    };
    let (x, mut report) = match form {
        InverseForm::Energy => return solve_matrix_within(a, &identity, Some(&start), settings, stop),
        InverseForm::Galerkin => {
            let projected = solve_matrix_within(a, &identity, Some(&start), settings, stop)?;
            if projected.1.status == SolveStatus::Converged {
                return Ok(projected);
            }
            let second = inverse_within(a, InverseForm::Residual, Some(&projected.0), settings, stop)?;
            let (mut better, worse) = if second.1.residual < projected.1.residual {
                (second, projected)
            } else {
                (projected, second)
            };
            better.1.sweeps += worse.1.sweeps;
            return Ok(better);
        }
        InverseForm::Residual => {
            // 2^p A^T A X = 2^p A^T with a power that keeps the square of A in range.
            let unit = (-(a.train.log_norm() / std::f64::consts::LN_2).round()).exp2();
            let transpose = a.transpose().scale(unit);
            let normal = transpose.times_matrix(a)?.round(&Truncation::to(1e-13))?.0;
            // The residual of the normal equations is not that of A X = I: go on, tighter, where the latter
            // is missed.
            let mut inner = *settings;
            let mut found = solve_matrix_within(&normal, &transpose, Some(&start), &inner, stop)?;
            while found.1.status == SolveStatus::Converged
                && inner.tolerance > settings.tolerance * MOST_TIGHTENING
                && inverse_residual(a, &found.0)? > settings.tolerance
            {
                inner.tolerance *= 0.2;
                let sweeps = found.1.sweeps;
                found = solve_matrix_within(&normal, &transpose, Some(&found.0), &inner, stop)?;
                found.1.sweeps += sweeps;
            }
            found
        }
        InverseForm::Symmetric => {
            let operator = sylvester(a)?;
            let twice = identity.train.scale(2.0);
            let (x, report) = solve_within(&operator, &twice, Some(&start.train), settings, stop)?;
            (start.map(|_| x), report)
        }
    };
    let residual = measured_residual(a, &x.train, &identity.train, &a.columns)?;
    (report.residual, report.floor) = (residual.value, residual.floor);
    if report.residual <= settings.tolerance {
        report.status = SolveStatus::Converged;
    } else if report.status == SolveStatus::Converged {
        report.status = SolveStatus::Stagnated;
    }
    Ok((x, report))
}

/// ||A X - I||_F / ||I||_F from the trains.
///
/// # Errors
/// [`TtError::Shape`] if the sizes do not fit.
pub fn inverse_residual(a: &TtMatrix, x: &TtMatrix) -> Result<f64, TtError> {
    let identity = TtMatrix::identity(&a.rows)?;
    crate::solve::relative_residual(a, &x.train, &identity.train, &a.columns)
}

/// X -> A X + X A as an operator on the paired digits (i, j).
fn sylvester(a: &TtMatrix) -> Result<TtMatrix, TtError> {
    let (mut on_rows, mut on_columns) = (Vec::new(), Vec::new());
    for (core, &n) in a.cores().iter().zip(&a.rows) {
        let pair = n * n;
        let lift = |rows: bool| {
            crate::Core::from_fn(core.left(), pair * pair, core.right(), |alpha, b, beta| {
                let (test, trial) = (b % pair, b / pair);
                let ((i, j), (k, l)) = ((test % n, test / n), (trial % n, trial / n));
                match (rows, i == k, j == l) {
                    (true, _, true) => core.get(alpha, i + n * k, beta),
                    // (X A)_{ij} = sum_l X_il A_lj
                    (false, true, _) => core.get(alpha, l + n * j, beta),
                    _ => 0.0,
                }
            })
        };
        on_rows.push(lift(true));
        on_columns.push(lift(false));
    }
    let sizes: Vec<usize> = a.rows.iter().map(|n| n * n).collect();
    let rows = TtMatrix::from_cores(on_rows, &sizes, &sizes)?;
    Ok(rows.add(&TtMatrix::from_cores(on_columns, &sizes, &sizes)?)?.round(&Truncation::to(1e-14))?.0)
}

/// What [`newton_schulz`] did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NewtonReport {
    /// Whether ||I - A X||_F fell to the stop value.
    pub converged: bool,
    /// What rounding leaves uncertain about the smallest ||I - A X||_F.
    pub floor: f64,
    /// ||I - A X||_F after every step (absolute).
    pub history: Vec<f64>,
}

/// X <- 2 X - X A X with rounding after every product (Newton-Schulz; Hotelling), quadratically convergent
/// while
/// ||I - A X|| < 1 and the rounding error is well below 1 / cond(A).
///
/// Stops at ||I - A X||_F <= `stop`, when the residual grows, or after `max_steps`; returns the best iterate.
///
/// # Errors
/// [`TtError::Shape`] if the sizes do not fit; [`TtError::Setting`] and [`TtError::Dense`] as for
/// [`TtMatrix::round`].
pub fn newton_schulz(
    a: &TtMatrix,
    start: &TtMatrix,
    truncation: &Truncation,
    stop: f64,
    max_steps: usize,
) -> Result<(TtMatrix, NewtonReport), TtError> {
    newton_schulz_within(a, start, truncation, stop, max_steps, &|| false)
}

/// As [`newton_schulz`], as long as `interrupt` is false: it is asked before every step.
///
/// # Errors
/// As for [`newton_schulz`], and [`TtError::Stopped`].
pub fn newton_schulz_within(
    a: &TtMatrix,
    start: &TtMatrix,
    truncation: &Truncation,
    stop: f64,
    max_steps: usize,
    interrupt: Stop<'_>,
) -> Result<(TtMatrix, NewtonReport), TtError> {
    a.check_square()?;
    a.check_same_sizes(start)?;
    let identity = TtMatrix::identity(&a.rows)?;
    let mut x = start.clone();
    let norm = identity.norm();
    let (mut best, mut floor) = ((f64::INFINITY, x.clone()), 0.0);
    let mut history = Vec::new();
    for step in 0..=max_steps {
        crate::go_on(interrupt)?;
        // Of the product itself: a rounded one would hide what the rounding of X has cost.
        let residual = measured_residual(a, &x.train, &identity.train, &a.columns)?;
        let size = residual.value * norm;
        let product = a.times_matrix_rounded(&x, truncation)?.0;
        history.push(size);
        if size < best.0 {
            best = (size, x.clone());
            floor = residual.floor * norm;
        }
        let rising = history.len() > 3 && size > 2.0 * history[history.len() - 2];
        if size <= stop || step == max_steps || rising || !size.is_finite() {
            break;
        }
        // X (2 I - A X)
        let correction = identity.scale(2.0).subtract(&product)?.round(truncation)?.0;
        x = x.times_matrix_rounded(&correction, truncation)?.0;
    }
    Ok((best.1, NewtonReport { converged: best.0 <= stop, floor, history }))
}
