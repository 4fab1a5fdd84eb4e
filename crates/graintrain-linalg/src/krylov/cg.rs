//! Preconditioned conjugate gradients (Hestenes and Stiefel 1952) and its flexible form (Notay 2000).

use super::{KrylovOutcome, KrylovReport, KrylovSettings, KrylovWork, Operator, xpay};
use crate::parallel::{axpy, dot, norm};

/// Solves A x = b, A symmetric positive definite, with a fixed symmetric positive definite preconditioner. `x` holds
/// the start on entry.
pub fn conjugate_gradient(
    operator: &mut Operator<'_>,
    preconditioner: &mut Operator<'_>,
    b: &[f64],
    x: &mut [f64],
    settings: KrylovSettings,
    work: &mut KrylovWork,
) -> KrylovReport {
    iterate(operator, preconditioner, b, x, settings, work, false)
}

/// Conjugate gradients with a preconditioner that may change from one application to the next (an inner iteration):
/// directions are made conjugate with the Polak-Ribiere coefficient, which needs one more vector.
pub fn flexible_conjugate_gradient(
    operator: &mut Operator<'_>,
    preconditioner: &mut Operator<'_>,
    b: &[f64],
    x: &mut [f64],
    settings: KrylovSettings,
    work: &mut KrylovWork,
) -> KrylovReport {
    iterate(operator, preconditioner, b, x, settings, work, true)
}

fn iterate(
    operator: &mut Operator<'_>,
    preconditioner: &mut Operator<'_>,
    b: &[f64],
    x: &mut [f64],
    settings: KrylovSettings,
    work: &mut KrylovWork,
    flexible: bool,
) -> KrylovReport {
    work.vectors(b.len());
    let KrylovWork { vectors: [residual, preconditioned, direction, image, previous, ..], history, patience } =
        work;
    operator(x, image);
    for k in 0..b.len() {
        residual[k] = b[k] - image[k];
    }
    let size = norm(b);
    let relative = |norm: f64| if size > 0.0 { norm / size } else { norm };
    let mut error = relative(norm(residual));
    history.push(error);
    if error <= settings.relative_tolerance {
        return KrylovReport { iterations: 0, residual: error, outcome: KrylovOutcome::Converged };
    }
    preconditioner(residual, preconditioned);
    direction.copy_from_slice(preconditioned);
    let mut rho = dot(residual, preconditioned);
    for iteration in 0..settings.max_iterations {
        if patience.is_over() {
            return KrylovReport { iterations: iteration, residual: error, outcome: KrylovOutcome::Stopped };
        }
        operator(direction, image);
        let curvature = dot(direction, image);
        // Not a number fails the comparison as well.
        if !(curvature > 0.0 && rho > 0.0) {
            return KrylovReport {
                iterations: iteration,
                residual: error,
                outcome: KrylovOutcome::Breakdown,
            };
        }
        let step = rho / curvature;
        axpy(step, direction, x);
        if flexible {
            previous.copy_from_slice(residual);
        }
        axpy(-step, image, residual);
        error = relative(norm(residual));
        history.push(error);
        if error <= settings.relative_tolerance {
            return KrylovReport {
                iterations: iteration + 1,
                residual: error,
                outcome: KrylovOutcome::Converged,
            };
        }
        preconditioner(residual, preconditioned);
        let next = dot(residual, preconditioned);
        let correction = if flexible { dot(previous, preconditioned) } else { 0.0 };
        xpay(preconditioned, (next - correction) / rho, direction);
        rho = next;
    }
    KrylovReport {
        iterations: settings.max_iterations,
        residual: error,
        outcome: KrylovOutcome::IterationLimit,
    }
}
