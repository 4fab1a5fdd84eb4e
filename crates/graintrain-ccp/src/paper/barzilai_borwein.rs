//! `bb`: projected Barzilai-Borwein gradient.
//!
//! Source: J. Barzilai, J. Borwein, "Two-point step size gradient methods", IMA Journal of Numerical Analysis
//! 8:141-148, 1988; Y.-H. Dai, R. Fletcher, "Projected Barzilai-Borwein methods for large-scale
//! box-constrained quadratic programming", Numerische Mathematik 100:21-47, 2005 (alternating steps, adaptive
//! reference value).

use super::spectral::Spectral;
use crate::solver::first_order::{FirstOrderMethod, Iterate};
use crate::solver::scaling::ScaledProblem;

/// x+ = P(x - alpha u) with the long step alpha = |d|^2 / d^T N' d and the short one d^T N' d / |N' d|^2 by
/// turns, on the scaled problem. The objective may rise, but not above the reference value of Dai and
/// Fletcher, the largest of the values since the last improvement, renewed when ten iterations brought none.
/// An iteration costs one product.
pub struct BarzilaiBorwein;

/// Iterations without a better objective after which the reference value is renewed.
const PATIENCE: usize = 10;

impl FirstOrderMethod for BarzilaiBorwein {
    const NAME: &'static str = "bb";

    fn run(&mut self, scaled: &ScaledProblem, it: &mut Iterate<'_>) {
        let (mut spectral, mut alpha) = Spectral::new(scaled, it);
        let (mut reference, mut best, mut candidate, mut without_progress) = (f64::INFINITY, 0.0, 0.0, 0);
        let mut long = true;
        while it.proceed(scaled) {
            let change = spectral.advance(scaled, it, alpha, reference, !long);
            let objective = spectral.objective;
            if objective < best {
                (best, candidate, without_progress) = (objective, objective, 0);
            } else {
                candidate = objective.max(candidate);
                without_progress += 1;
                if without_progress == PATIENCE {
                    (reference, candidate, without_progress) = (candidate, objective, 0);
                }
            }
            alpha = if long { spectral.long_step(&change) } else { spectral.short_step(&change) };
            long = !long;
        }
    }
}
