//! Preconditioned conjugate gradients (Hestenes and Stiefel 1952) and its flexible form (Notay 2000).

use super::{KrylovOutcome, KrylovReport, KrylovSettings, KrylovWork, Operator, xpay};
use crate::parallel::{axpy, dot, norm};

/// Solves A x = b, A symmetric positive definite, with a fixed symmetric positive definite preconditioner.
/// `x` holds the start on entry.
pub fn conjugate_gradient(
    operator: &mut Operator<'_>,
    preconditioner: &mut Operator<'_>,
    b: &[f64],
    x: &mut [f64],
    settings: KrylovSettings,
    work: &mut KrylovWork,
) -> KrylovReport {
    iterate(operator, preconditioner, b, x, settings, work, Variant::Fixed)
}

/// Conjugate gradients with a preconditioner that may change from one application to the next (an inner
/// iteration): directions are made conjugate with the Polak-Ribiere coefficient, which needs one more vector.
pub fn flexible_conjugate_gradient(
    operator: &mut Operator<'_>,
    preconditioner: &mut Operator<'_>,
    b: &[f64],
    x: &mut [f64],
    settings: KrylovSettings,
    work: &mut KrylovWork,
) -> KrylovReport {
    iterate(operator, preconditioner, b, x, settings, work, Variant::Flexible)
}

/// Conjugate gradients of which something else than |b - A x| / |b| has to fall below the tolerance, see
/// [`Measure`]; [`KrylovWork::history`] holds its values only.
pub fn conjugate_gradient_measured(
    operator: &mut Operator<'_>,
    preconditioner: &mut Operator<'_>,
    b: &[f64],
    x: &mut [f64],
    settings: KrylovSettings,
    work: &mut KrylovWork,
    measure: Measure<'_>,
) -> KrylovReport {
    iterate(operator, preconditioner, b, x, settings, work, Variant::Measured(measure))
}

/// Iterations between the first evaluations of a measure.
const MEASURE_EVERY: usize = 5;

/// What [`conjugate_gradient_measured`] makes small.
pub struct Measure<'a> {
    /// Any norm of b - A x that costs about as much as an iteration: it is evaluated when the number of
    /// iterations has grown by a tenth.
    pub norm: &'a mut dyn FnMut(&[f64]) -> f64,
    /// Whether the preconditioner may change from one application to the next.
    pub flexible: bool,
}

/// Which conjugate gradients.
enum Variant<'a> {
    Fixed,
    Flexible,
    Measured(Measure<'a>),
}

fn iterate(
    operator: &mut Operator<'_>,
    preconditioner: &mut Operator<'_>,
    b: &[f64],
    x: &mut [f64],
    settings: KrylovSettings,
    work: &mut KrylovWork,
    mut variant: Variant<'_>,
) -> KrylovReport {
    work.vectors(b.len());
    let KrylovWork { vectors: [residual, preconditioned, direction, image, previous, ..], history, patience } =
        work;
    operator(x, image);
    for k in 0..b.len() {
        residual[k] = b[k] - image[k];
    }
    let size = norm(b);
    let always = !matches!(variant, Variant::Measured(_));
    let flexible = matches!(variant, Variant::Flexible | Variant::Measured(Measure { flexible: true, .. }));
    let mut evaluate = |residual: &[f64]| match &mut variant {
        Variant::Measured(measure) => (measure.norm)(residual),
        _ if size > 0.0 => norm(residual) / size,
        _ => norm(residual),
    };
    let mut error = evaluate(residual);
    history.push(error);
    if error <= settings.relative_tolerance {
        return KrylovReport { iterations: 0, residual: error, outcome: KrylovOutcome::Converged };
    }
    preconditioner(residual, preconditioned);
    direction.copy_from_slice(preconditioned);
    let mut rho = dot(residual, preconditioned);
    // Iteration of the last evaluation, and of the next one.
    let (mut evaluated, mut due) = (0, MEASURE_EVERY);
    let mut outcome = KrylovOutcome::IterationLimit;
    let mut iterations = 0;
    while iterations < settings.max_iterations {
        if patience.is_over() {
            outcome = KrylovOutcome::Stopped;
            break;
        }
        operator(direction, image);
        let curvature = dot(direction, image);
        // Not a number fails the comparison as well.
        if !(curvature > 0.0 && rho > 0.0) {
            outcome = KrylovOutcome::Breakdown;
            break;
        }
        let step = rho / curvature;
        axpy(step, direction, x);
        if flexible {
            previous.copy_from_slice(residual);
        }
        axpy(-step, image, residual);
        iterations += 1;
        if always || iterations == due {
            error = evaluate(residual);
            history.push(error);
            (evaluated, due) = (iterations, iterations + MEASURE_EVERY.max(iterations / 10));
            if error <= settings.relative_tolerance {
                return KrylovReport { iterations, residual: error, outcome: KrylovOutcome::Converged };
            }
        }
        preconditioner(residual, preconditioned);
        let next = dot(residual, preconditioned);
        let correction = if flexible { dot(previous, preconditioned) } else { 0.0 };
        xpay(preconditioned, (next - correction) / rho, direction);
        rho = next;
    }
    if evaluated < iterations {
        error = evaluate(residual);
        history.push(error);
        if error <= settings.relative_tolerance {
            outcome = KrylovOutcome::Converged;
        }
    }
    KrylovReport { iterations, residual: error, outcome }
}
