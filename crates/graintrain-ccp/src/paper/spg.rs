//! `spg`: preconditioned spectral projected gradient with fallback (P-SPG-FB).
//!
//! Source: T. Heyn, "On the modeling, simulation, and visualization of many-body dynamics problems with
//! friction and contact", PhD thesis, University of Wisconsin-Madison, 2013, after E. Birgin, J. Martinez, M.
//! Raydan, "Nonmonotone spectral projected gradient methods on convex sets", SIAM Journal on Optimization
//! 10:1196-1211, 2000.

use super::spectral::Spectral;
use crate::solver::first_order::{FirstOrderMethod, Iterate};
use crate::solver::scaling::ScaledProblem;

/// Direction d = P(x - alpha u) - x in the metric of the scaled problem (the diagonal preconditioner, one
/// factor for the normal and one for the tangents, so that cones stay cones), non-monotone line search
/// against the largest of the last ten objectives (Grippo, Lampariello, Lucidi 1986), alpha the short
/// spectral step where it is much shorter than the long one and the long one otherwise (adaptive choice of
/// Zhou, Gao and Dai 2006). The fallback: the iterate of least residual is what is returned. An iteration
/// costs one product.
pub struct SpectralProjectedGradient;

/// Objectives that the line search remembers.
const MEMORY: usize = 10;
/// The short step is taken where it is below this fraction of the long one.
const RATIO: f64 = 0.5;

impl FirstOrderMethod for SpectralProjectedGradient {
    const NAME: &'static str = "spg";

    fn run(&mut self, scaled: &ScaledProblem, it: &mut Iterate<'_>) {
        let (mut spectral, mut alpha) = Spectral::new(scaled, it);
        let mut last = [f64::NEG_INFINITY; MEMORY];
        last[0] = 0.0;
        let mut place = 0;
        while it.proceed(scaled) {
            let reference = last.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let change = spectral.advance(scaled, it, alpha, reference, true);
            place = (place + 1) % last.len();
            last[place] = spectral.objective;
            let long = spectral.long_step(&change);
            let short = spectral.short_step(&change);
            alpha = if short < RATIO * long { short } else { long };
        }
    }
}
