//! Projected gradient with spectral (Barzilai-Borwein) steps: what `bb` and `spg` share.

use super::first_order::Iterate;
use super::lanes::{Batch, Vector, add_scaled, dot, project, sub, zero};
use super::scaling::{Here, Image, Kernel, ScaledProblem};
use super::sweep::Tally;

/// Steps are kept between these multiples of 1 / (largest eigenvalue of N').
const STEP_RANGE: (f64, f64) = (0.1, 1e4);

/// What a step x+ = x + tau d, d = P(x - alpha u) - x, did.
pub(super) struct Change {
    /// |d|^2.
    length: f64,
    /// d^T N' d.
    curvature: f64,
    /// |N' d|^2.
    image_length: f64,
}

/// Iterate and direction of a spectral projected gradient method. The gradient u is kept contact by contact, because the
/// short step wants N' d contact by contact, too: a step is then one product, its two halves a scatter pass and a look.
pub(super) struct Spectral {
    u: Vec<Batch>,
    direction: Vec<Batch>,
    image: Image,
    range: (f64, f64),
    /// Objective relative to the start.
    pub objective: f64,
}

/// u <- N' x + r'.
struct StoreGradient;

impl Kernel<1> for StoreGradient {
    const SHORT: bool = true;

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: Here<V>,
        fresh: &Batch<V>,
        [u]: [&mut Batch<V>; 1],
        _: &mut Tally<V>,
    ) -> Batch<V> {
        *u = *fresh;
        zero()
    }
}

/// direction <- d = P(x - alpha u) - x, x <- x + d; tallies |d|^2 and u^T d.
struct GradientStep {
    alpha: f64,
}

impl Kernel<3> for GradientStep {
    #[inline(always)]
    fn at<V: Vector>(
        &self,
        here: Here<V>,
        _: &Batch<V>,
        [x, u, direction]: [&mut Batch<V>; 3],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        let new = project(here.mu, &add_scaled(x, -self.alpha, u));
        let d = sub(&new, x);
        tally.sum[0] += dot(&d, &d);
        tally.sum[1] += dot(u, &d);
        *x = new;
        *direction = d;
        d
    }
}

/// u <- u + N' d from the image of d; tallies |N' d|^2.
struct FullStep;

impl Kernel<1> for FullStep {
    const SHORT: bool = true;

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        here: Here<V>,
        product: &Batch<V>,
        [u]: [&mut Batch<V>; 1],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        let nd = sub(product, &here.r);
        tally.sum[0] += dot(&nd, &nd);
        *u = add_scaled(u, 1.0, &nd);
        zero()
    }
}

/// As [`FullStep`] where only tau of the step is wanted: u <- u + tau N' d, x <- x - (1 - tau) d.
struct ShortenedStep {
    tau: f64,
}

impl Kernel<3> for ShortenedStep {
    const SHORT: bool = true;

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        here: Here<V>,
        product: &Batch<V>,
        [u, x, d]: [&mut Batch<V>; 3],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        let nd = sub(product, &here.r);
        tally.sum[0] += dot(&nd, &nd);
        *u = add_scaled(u, self.tau, &nd);
        *x = add_scaled(x, self.tau - 1.0, d);
        zero()
    }
}

impl Spectral {
    pub fn new(scaled: &ScaledProblem, it: &mut Iterate<'_>) -> (Self, f64) {
        let shortest = 1.0 / it.largest_curvature(scaled);
        let range = (STEP_RANGE.0 * shortest, STEP_RANGE.1 * shortest);
        let (u, direction) = (scaled.zeros(), scaled.zeros());
        let spectral = Self { u, direction, image: scaled.zero_image(), range, objective: 0.0 };
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
        let Self { u, direction, image, objective, .. } = self;
        if it.was_refreshed() {
            scaled.look(&it.image, [u], &mut it.work, &StoreGradient);
        }
        let vectors = [&mut it.x[..], u, direction];
        let (totals, curvature) = scaled.scatter_pass(vectors, image, &mut it.work, &GradientStep { alpha });
        it.work.count_product();
        let [length, slope, ..] = totals.sum;
        let full = *objective + slope + 0.5 * curvature <= reference + 1e-4 * slope;
        let (tau, totals) = if full {
            (1.0, scaled.look(image, [u], &mut it.work, &FullStep))
        } else {
            let tau = (-slope / curvature).clamp(0.0, 1.0);
            let vectors = [&mut u[..], &mut it.x, direction];
            (tau, scaled.look(image, vectors, &mut it.work, &ShortenedStep { tau }))
        };
        it.add_image(tau, image);
        *objective += tau * slope + 0.5 * tau * tau * curvature;
        Change { length, curvature, image_length: totals.sum[0] }
    }

    /// First Barzilai-Borwein step, |d|^2 / d^T N' d: the long one.
    pub fn long_step(&self, change: &Change) -> f64 {
        self.keep(change.length / change.curvature)
    }

    /// Second Barzilai-Borwein step, d^T N' d / |N' d|^2: the short one.
    pub fn short_step(&self, change: &Change) -> f64 {
        self.keep(change.curvature / change.image_length)
    }

    /// A step within the range; the longest one where there was no curvature.
    fn keep(&self, step: f64) -> f64 {
        if step.is_nan() { self.range.1 } else { step.clamp(self.range.0, self.range.1) }
    }
}
