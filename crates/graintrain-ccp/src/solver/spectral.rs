//! Projected gradient with spectral (Barzilai-Borwein) steps: what `bb` and `spg` share.

use super::first_order::Iterate;
use super::lanes::{Batch, add_scaled, dot, project, sub};
use super::scaling::{Here, Image, Kernel, ScaledProblem};
use super::sweep::{Tally, for_each_batch};

/// Steps are kept between these multiples of 1 / (largest eigenvalue of N').
const STEP_RANGE: (f64, f64) = (0.1, 1e4);

/// What a step x+ = x + tau d, d = P(x - alpha u) - x, did.
pub(super) struct Change {
    /// |d|^2.
    pub length: f64,
    /// d^T N' d.
    pub curvature: f64,
}

/// Iterate and direction of a spectral projected gradient method.
pub(super) struct Spectral {
    direction: Vec<Batch>,
    image: Image,
    range: (f64, f64),
    /// Objective relative to the start.
    pub objective: f64,
}

/// direction <- d = P(x - alpha u) - x, x <- x + d; tallies |d|^2 and u^T d.
struct GradientStep {
    alpha: f64,
}

impl Kernel<2> for GradientStep {
    #[inline(always)]
    fn at(&self, here: Here, u: &Batch, [x, direction]: [&mut Batch; 2], tally: &mut Tally) -> Batch {
        let new = project(here.mu, &add_scaled(x, -self.alpha, u));
        let d = sub(&new, x);
        tally.sum[0] += dot(&d, &d);
        tally.sum[1] += dot(u, &d);
        *x = new;
        *direction = d;
        d
    }
}

/// Tallies |N' d|^2.
struct ImageLength;

impl Kernel<0> for ImageLength {
    #[inline(always)]
    fn at(&self, here: Here, u: &Batch, _: [&mut Batch; 0], tally: &mut Tally) -> Batch {
        let nd = sub(u, &here.r);
        tally.sum[0] += dot(&nd, &nd);
        nd
    }
}

impl Spectral {
    pub fn new(scaled: &ScaledProblem, it: &mut Iterate<'_>) -> (Self, f64) {
        let shortest = 1.0 / it.largest_curvature(scaled);
        let range = (STEP_RANGE.0 * shortest, STEP_RANGE.1 * shortest);
        let spectral = Self { direction: scaled.zeros(), image: scaled.zero_image(), range, objective: 0.0 };
        (spectral, shortest)
    }

    /// Takes the full step if the objective stays at or below `reference` plus a little of the slope (Grippo, Lampariello,
    /// Lucidi 1986), else the exact minimiser along d: the objective is quadratic, so its value needs no product.
    pub fn advance(
        &mut self,
        scaled: &ScaledProblem,
        it: &mut Iterate<'_>,
        alpha: f64,
        reference: f64,
    ) -> Change {
        let kernel = GradientStep { alpha };
        let (totals, curvature) =
            scaled.pass(&it.image, [&mut it.x, &mut self.direction], &mut self.image, &mut it.work, &kernel);
        let [length, slope, ..] = totals.sum;
        let mut tau = 1.0;
        if self.objective + slope + 0.5 * curvature > reference + 1e-4 * slope {
            tau = (-slope / curvature).clamp(0.0, 1.0);
            for_each_batch([&mut it.x, &mut self.direction], it.work.tallies(), |_, [x, d], _| {
                *x = add_scaled(x, tau - 1.0, d);
            });
        }
        it.add_image(tau, &self.image);
        self.objective += tau * slope + 0.5 * tau * tau * curvature;
        Change { length, curvature }
    }

    /// First Barzilai-Borwein step, |d|^2 / d^T N' d: the long one.
    pub fn long_step(&self, change: &Change) -> f64 {
        self.keep(change.length / change.curvature)
    }

    /// Second Barzilai-Borwein step, d^T N' d / |N' d|^2: the short one. Costs a look at the image of d.
    pub fn short_step(&self, scaled: &ScaledProblem, it: &mut Iterate<'_>, change: &Change) -> f64 {
        let length = scaled.look(&self.image, [], &mut it.work, &ImageLength).sum[0];
        self.keep(change.curvature / length)
    }

    /// A step within the range; the longest one where there was no curvature.
    fn keep(&self, step: f64) -> f64 {
        if step.is_nan() { self.range.1 } else { step.clamp(self.range.0, self.range.1) }
    }
}
