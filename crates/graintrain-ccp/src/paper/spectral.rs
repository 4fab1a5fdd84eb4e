//! Projected gradient with spectral (Barzilai-Borwein) steps: what `bb` and `spg` share.

use crate::solver::combination::Replace;
use crate::solver::first_order::Iterate;
use crate::solver::lanes::{Batch, Vector, add, add_scaled, dot, sub, zero};
use crate::solver::scaling::{ContactBatch, Image, Kernel, KernelInput, ScaledProblem};
use crate::solver::tasks::Tally;

/// Steps are kept between these multiples of 1 / (largest eigenvalue of N').
const STEP_RANGE: (f64, f64) = (0.1, 1e4);

/// What a step x+ = x + tau d, d = P(x - alpha u) - x, did.
pub(super) struct Change {
    /// |d|^2.
    length: f64,
    /// d^T N' d.
    curvature: f64,
    /// |N' d|^2, if it was asked for.
    image_length: Option<f64>,
}

/// The steps of a spectral projected gradient method. The gradient u of the iterate is kept contact by
/// contact, because the short step wants N' d contact by contact, too: a step is then one product, its two
/// halves a scatter pass and a look.
pub(super) struct Spectral {
    /// x before the last step.
    previous: Vec<Batch>,
    /// Image of the last d.
    image: Image,
    /// Whether the gradient lacks that image.
    behind: bool,
    range: (f64, f64),
    /// Objective relative to the start.
    pub objective: f64,
}

/// next <- P(x - alpha u); returns d = next - x, tallies |d|^2 and u^T d.
struct GradientStep {
    alpha: f64,
}

impl Kernel<3> for GradientStep {
    #[inline(always)]
    fn point<V: Vector>(&self, _: ContactBatch<V>, _: &Batch<V>, [x, u, _]: [&Batch<V>; 3]) -> Batch<V> {
        add_scaled(x, -self.alpha, u)
    }

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        KernelInput { projected, .. }: KernelInput<V>,
        [x, u, next]: [&mut Batch<V>; 3],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        let d = sub(&projected, x);
        tally.sum[0] += dot(&d, &d);
        tally.sum[1] += dot(u, &d);
        *next = projected;
        d
    }
}

/// [`FullStep`] for the last d, then [`GradientStep`].
struct FullThenGradientStep {
    alpha: f64,
}

impl Kernel<3> for FullThenGradientStep {
    const GRADIENT: bool = false;

    #[inline(always)]
    fn point<V: Vector>(&self, _: ContactBatch<V>, nd: &Batch<V>, [x, u, _]: [&Batch<V>; 3]) -> Batch<V> {
        add_scaled(x, -self.alpha, &add(u, nd))
    }

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        given: KernelInput<V>,
        [x, u, next]: [&mut Batch<V>; 3],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        *u = add(u, &given.u);
        GradientStep { alpha: self.alpha }.at(contact, given, [x, u, next], tally)
    }
}

/// u <- u + N' d from the image of d; tallies |N' d|^2.
struct FullStep;

impl Kernel<1> for FullStep {
    const SHORT: bool = true;
    const GRADIENT: bool = false;

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        KernelInput { u: nd, .. }: KernelInput<V>,
        [u]: [&mut Batch<V>; 1],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        tally.sum[0] += dot(&nd, &nd);
        *u = add(u, &nd);
        zero()
    }
}

/// As [`FullStep`] where only tau of the step d = x - previous is wanted: u <- u + tau N' d, x <- x - (1 -
/// tau) d.
struct ShortenedStep {
    tau: f64,
}

impl Kernel<3> for ShortenedStep {
    const SHORT: bool = true;
    const GRADIENT: bool = false;

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        KernelInput { u: nd, .. }: KernelInput<V>,
        [u, x, previous]: [&mut Batch<V>; 3],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        tally.sum[0] += dot(&nd, &nd);
        *u = add_scaled(u, self.tau, &nd);
        *x = add_scaled(x, self.tau - 1.0, &sub(x, previous));
        zero()
    }
}

impl Spectral {
    pub fn new(scaled: &ScaledProblem, it: &mut Iterate<'_>) -> (Self, f64) {
        let shortest = 1.0 / it.largest_curvature(scaled);
        let range = (STEP_RANGE.0 * shortest, STEP_RANGE.1 * shortest);
        it.keep_gradient(scaled);
        let spectral = Self {
            previous: scaled.zeros(),
            image: scaled.zero_image(),
            behind: false,
            range,
            objective: 0.0,
        };
        (spectral, shortest)
    }

    /// Takes the full step if the objective stays at or below `reference` plus a little of the slope (Grippo,
    /// Lampariello, Lucidi 1986), else the exact minimiser along d: the objective is quadratic, so its value
    /// needs no product. Unless `wants_short` or a check is next, the short step is not known afterwards and
    /// the gradient follows in the next call's pass.
    pub fn advance(
        &mut self,
        scaled: &ScaledProblem,
        it: &mut Iterate<'_>,
        alpha: f64,
        reference: f64,
        wants_short: bool,
    ) -> Change {
        let Self { previous, image, objective, behind, .. } = self;
        let wants_look = wants_short || it.checks_next();
        let Iterate { x, gradient: u, work, .. } = it;
        let vectors = [&mut x[..], u, previous];
        let (totals, curvature) = if *behind {
            scaled.pass_onto([image], vectors, work, &FullThenGradientStep { alpha }, |_| Replace)
        } else {
            work.count_product();
            scaled.scatter_pass(vectors, image, work, &GradientStep { alpha })
        };
        std::mem::swap(x, previous);
        let [length, slope, ..] = totals.sum;
        let full = *objective + slope + 0.5 * curvature <= reference + 1e-4 * slope;
        *behind = full && !wants_look;
        let (tau, image_length) = if *behind {
            (1.0, None)
        } else if full {
            (1.0, Some(scaled.look(image, [u], work, &FullStep).sum[0]))
        } else {
            let tau = (-slope / curvature).clamp(0.0, 1.0);
            let totals = scaled.look(image, [&mut u[..], x, previous], work, &ShortenedStep { tau });
            (tau, Some(totals.sum[0]))
        };
        *objective += tau * slope + 0.5 * tau * tau * curvature;
        Change { length, curvature, image_length }
    }

    /// First Barzilai-Borwein step, |d|^2 / d^T N' d: the long one.
    pub fn long_step(&self, change: &Change) -> f64 {
        self.keep(change.length / change.curvature)
    }

    /// Second Barzilai-Borwein step, d^T N' d / |N' d|^2: the short one, for which |N' d|^2 must have been
    /// asked.
    pub fn short_step(&self, change: &Change) -> f64 {
        self.keep(change.curvature / change.image_length.unwrap_or(f64::NAN))
    }

    /// A step within the range; the longest one where there was no curvature.
    fn keep(&self, step: f64) -> f64 {
        if step.is_nan() { self.range.1 } else { step.clamp(self.range.0, self.range.1) }
    }
}
