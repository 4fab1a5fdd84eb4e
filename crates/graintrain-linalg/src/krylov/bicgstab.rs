//! Stabilised bi-conjugate gradients (van der Vorst 1992), preconditioned from the right.

use super::{KrylovOutcome, KrylovReport, KrylovSettings, KrylovWork, Operator};
use crate::parallel::{axpy, dot, norm};

/// Solves A x = b for any regular A. `x` holds the start on entry and the iterate of least residual on exit.
/// One iteration costs two products with A and two applications of the preconditioner.
pub fn bicgstab(
    operator: &mut Operator<'_>,
    preconditioner: &mut Operator<'_>,
    b: &[f64],
    x: &mut [f64],
    settings: KrylovSettings,
    work: &mut KrylovWork,
) -> KrylovReport {
    let n = b.len();
    work.vectors(n);
    let KrylovWork {
        vectors: [residual, shadow, direction, image, half, change, hat, best, _],
        history,
        patience,
    } = work;
    operator(x, image);
    for k in 0..n {
        residual[k] = b[k] - image[k];
    }
    let size = norm(b);
    let relative = |norm: f64| if size > 0.0 { norm / size } else { norm };
    let mut error = relative(norm(residual));
    history.push(error);
    best.copy_from_slice(x);
    let mut least = error;
    let mut outcome = KrylovOutcome::IterationLimit;
    let mut iterations = 0;
    if error <= settings.relative_tolerance {
        return KrylovReport { iterations, residual: error, outcome: KrylovOutcome::Converged };
    }
    shadow.copy_from_slice(residual);
    direction.copy_from_slice(residual);
    let mut rho = dot(shadow, residual);
    while iterations < settings.max_iterations {
        if patience.is_over() {
            outcome = KrylovOutcome::Stopped;
            break;
        }
        preconditioner(direction, hat);
        operator(hat, image);
        let projection = dot(shadow, image);
        let alpha = rho / projection;
        if !alpha.is_finite() || projection == 0.0 {
            outcome = KrylovOutcome::Breakdown;
            break;
        }
        axpy(alpha, hat, x);
        half.copy_from_slice(residual);
        axpy(-alpha, image, half);
        preconditioner(half, hat);
        operator(hat, change);
        let square = dot(change, change);
        let omega = if square > 0.0 { dot(change, half) / square } else { 0.0 };
        axpy(omega, hat, x);
        residual.copy_from_slice(half);
        axpy(-omega, change, residual);
        iterations += 1;
        error = relative(norm(residual));
        history.push(error);
        if error < least {
            least = error;
            best.copy_from_slice(x);
        }
        if error <= settings.relative_tolerance {
            outcome = KrylovOutcome::Converged;
            break;
        }
        let next = dot(shadow, residual);
        let beta = next / rho * (alpha / omega);
        if !beta.is_finite() || !error.is_finite() {
            outcome = KrylovOutcome::Breakdown;
            break;
        }
        for k in 0..n {
            direction[k] = residual[k] + beta * (direction[k] - omega * image[k]);
        }
        rho = next;
    }
    x.copy_from_slice(best);
    KrylovReport { iterations, residual: least, outcome }
}
