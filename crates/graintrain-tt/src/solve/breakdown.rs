//! What is tried where the projections of the sweeps break down: for a matrix that is not symmetric a
//! Galerkin projection may be singular although the matrix is not (a shift, projected onto a vector that it
//! moves away from itself).
//!
//! First another start, which has other projections; then the normal equations A^T A x = A^T y, whose
//! projections are never singular, at the price of the squared condition and ranks R^2. Whatever leaves the
//! smallest residual of A x = y is returned.

use super::{Method, SolveReport, SolveSettings, SolveStatus, measured_residual, solve_block};
use crate::{Stop, TtError, TtMatrix, TtVector};

/// A residual above this after all sweeps is a breakdown and not a lack of patience.
const BREAKDOWN: f64 = 0.1;
/// Largest rank of A for which the normal equations are tried.
const NORMAL_RANK: usize = 8;

/// The better of what the sweeps returned and what helps against a breakdown, if it was one.
pub(super) fn mended(
    a: &TtMatrix,
    y: &TtVector,
    first: (TtVector, SolveReport),
    settings: &SolveSettings,
    stop: Stop<'_>,
) -> Result<(TtVector, SolveReport), TtError> {
    let broken = |report: &SolveReport| {
        report.residual > settings.tolerance.max(BREAKDOWN) && report.status != SolveStatus::RankCapped
    };
    // (ALS keeps the ranks of its start.)
    if settings.method == Method::Als || !broken(&first.1) || a.relative_distance(&a.transpose())? < 1e-10 {
        return Ok(first);
    }
    let spectators = vec![1; a.num_cores()];
    let better = |one: (TtVector, SolveReport), other: (TtVector, SolveReport)| {
        let sweeps = one.1.sweeps + other.1.sweeps;
        let (x, report) = if other.1.residual < one.1.residual { other } else { one };
        (x, SolveReport { sweeps, ..report })
    };
    let start = TtVector::random(&a.rows, 3, settings.seed ^ 0xB4EA)?;
    let mut best = better(first, solve_block(a, y, &spectators, &start, settings, stop)?);
    if broken(&best.1) && a.max_rank() <= NORMAL_RANK {
        let transposed = a.transpose();
        let squared = transposed.times_matrix(a)?;
        let (x, mut report) =
            solve_block(&squared, &transposed.times_vector(y)?, &spectators, &best.0, settings, stop)?;
        let residual = measured_residual(a, &x, y, &spectators)?;
        (report.residual, report.floor) = (residual.value, residual.floor);
        report.status = match report.status {
            _ if residual.value <= settings.tolerance => SolveStatus::Converged,
            SolveStatus::Converged => SolveStatus::Stagnated,
            other => other,
        };
        best = better(best, (x, report));
    }
    Ok(best)
}
