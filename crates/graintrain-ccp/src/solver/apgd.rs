//! `apgd`: accelerated projected gradient descent with adaptive step and restart.
//!
//! Source: H. Mazhar, T. Heyn, D. Negrut, A. Tasora, "Using Nesterov's method to accelerate multibody dynamics with
//! friction and contact", ACM Transactions on Graphics 34(3):32, 2015, after Nesterov (1983) and, for the restart,
//! O'Donoghue and Candes (2015).

use super::combination::Combination;
use super::first_order::{FirstOrderMethod, Iterate};
use super::lanes::{Batch, Vector, add_scaled, dot, project_given, sub, within_disc, within_discs};
use super::scaling::{ContactBatch, Kernel, KernelInput, ScaledProblem, TurningBatch};
use super::tasks::Tally;
use crate::residual::FrictionModel;

/// Accelerated projected gradient on the scaled problem:
///
/// ```text
/// x+ = P( y - t (N' y + r') ),   y+ = x+ + beta (x+ - x)
/// ```
///
/// t shrinks where the curvature met along a step, d^T N' d / |d|^2 with d = x+ - y, exceeds 1/t, and grows slowly
/// otherwise; beta restarts from zero where the step points uphill, (y - x+)^T (x+ - x) > 0. That hardly ever happens: momentum that
/// is too long keeps contacts opening and closing without pointing uphill. So theta stays below [`cap`](Self::cap), or
/// [`cap_growth`](Self::cap_growth) times the iteration where that is more, since the slow modes of a tight tolerance need it longer. In
/// runs of settling beds this saves a sixth of the iterations; cold solves of tall packings take a tenth more.
///
/// For exact Coulomb friction P takes the normal impulse first and projects the tangential one on the disc that it allows, as
/// [`GaussSeidel`](super::GaussSeidel) does. The exact problem has no objective that could say when the momentum has lasted long enough: without a
/// limit the iterates may circle, with a short one they creep. So beta restarts also where theta reaches a limit, and the limit
/// grows by [`longer`](Self::longer) as long as the step |x+ - y| / t is shorter than at the last restart, else it shrinks by
/// [`shorter`](Self::shorter).
///
/// One iteration is one fused pass over the contacts and one over the bodies: because images are linear,
/// N' x+ = N' y + N' d needs no product of its own.
#[derive(Clone, Debug)]
pub struct Apgd {
    /// Factor by which the step grows per iteration.
    pub growth: f64,
    /// Largest theta where friction is relaxed, in the first iterations.
    pub cap: f64,
    /// Largest theta per iteration made, where that is more than `cap`.
    pub cap_growth: f64,
    /// theta at which beta restarts where friction is exact, after about twice as many iterations: the first limit.
    pub memory: f64,
    /// Factor on the limit where the iterates get on.
    pub longer: f64,
    /// Divisor of the limit where they do not.
    pub shorter: f64,
    /// Least and greatest limit of theta.
    pub memory_range: [f64; 2],
    /// A momentum whose theta is below this says nothing about the limit.
    pub young: f64,
}

impl Default for Apgd {
    fn default() -> Self {
        Self {
            growth: 1.03,
            cap: 50.0,
            cap_growth: 0.2,
            memory: 50.0,
            longer: 1.5,
            shorter: 2.0,
            memory_range: [10.0, 3000.0],
            young: 5.0,
        }
    }
}

/// x + beta (x - previous).
#[inline(always)]
fn extrapolated<V: Vector>(x: &Batch<V>, previous: &Batch<V>, beta: f64) -> Batch<V> {
    add_scaled(x, beta, &sub(x, previous))
}

/// previous <- x+ = P(y - t u) with y = x + beta (x - previous); returns d = x+ - y, tallies |d|^2 and d^T (x+ - x).
///
/// Whether friction is exact is known to the compiler: asked per contact it costs a tenth of an iteration.
struct Step<const EXACT: bool> {
    step: f64,
    beta: f64,
}

impl<const EXACT: bool> Kernel<2> for Step<EXACT> {
    #[inline(always)]
    fn point<V: Vector>(&self, _: ContactBatch<V>, u: &Batch<V>, [x, previous]: [&Batch<V>; 2]) -> Batch<V> {
        add_scaled(&extrapolated(x, previous, self.beta), -self.step, u)
    }

    #[inline(always)]
    fn projected<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        _: &Batch<V>,
        point: &Batch<V>,
        tangential: V,
    ) -> Batch<V> {
        if EXACT {
            within_disc(contact.mu, point, tangential)
        } else {
            project_given(contact.mu, point, tangential)
        }
    }

    #[inline(always)]
    fn projected_both<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        turning: &TurningBatch<V>,
        [point, turned]: [&Batch<V>; 2],
    ) -> [Batch<V>; 2] {
        if EXACT {
            within_discs([contact.mu, turning.rows.mu, turning.spinning], point, turned)
        } else {
            turning.project(contact.mu, [point, turned])
        }
    }

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        KernelInput { projected: new, .. }: KernelInput<V>,
        [x, previous]: [&mut Batch<V>; 2],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        let y = extrapolated(x, previous, self.beta);
        let d = sub(&new, &y);
        tally.sum[0] += dot(&d, &d);
        tally.sum[1] += dot(&d, &sub(&new, x));
        *previous = new;
        d
    }
}

/// Returns y = x + beta (x - previous): its image is wanted.
struct Extrapolated {
    beta: f64,
}

impl Kernel<2> for Extrapolated {
    const SHORT: bool = true;

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        _: KernelInput<V>,
        [x, previous]: [&mut Batch<V>; 2],
        _: &mut Tally<V>,
    ) -> Batch<V> {
        extrapolated(x, previous, self.beta)
    }
}

impl FirstOrderMethod for Apgd {
    const NAME: &'static str = "apgd";
    const EXACT: bool = true;
    const TURNING: bool = true;

    fn run(&mut self, scaled: &ScaledProblem, it: &mut Iterate<'_>) {
        match scaled.friction_model() {
            FrictionModel::Relaxed => self.iterate::<false>(scaled, it),
            FrictionModel::Coulomb => self.iterate::<true>(scaled, it),
        }
    }
}

impl Apgd {
    /// The iterations, with exact friction or not.
    fn iterate<const EXACT: bool>(&self, scaled: &ScaledProblem, it: &mut Iterate<'_>) {
        let mut step = 1.0 / it.largest_curvature(scaled);
        let mut previous = it.x.clone();
        let mut image_y = it.image.clone();
        let (mut theta, mut beta) = (1.0_f64, 0.0);
        let mut memory = if EXACT { self.memory } else { f64::INFINITY };
        let mut last_step = f64::INFINITY;
        let mut iteration = 0.0;
        while it.proceed(scaled) {
            iteration += 1.0;
            if it.was_refreshed() {
                // The image of y must not keep the rounding errors that the image of x has just lost: the extrapolation
                // would take the difference for a motion and multiply it.
                let Iterate { x, work, .. } = it;
                scaled.scatter_pass([x, &mut previous], &mut image_y, work, &Extrapolated { beta });
            }
            let kernel = Step::<EXACT> { step, beta };
            let images = [&mut image_y[..], &mut it.image];
            let vectors = [&mut it.x[..], &mut previous];
            let (totals, curvature) = scaled.pass_onto(images, vectors, &mut it.work, &kernel, |totals| {
                let [length, downhill, ..] = totals.sum;
                if downhill < 0.0 || theta > memory {
                    if EXACT && theta > self.young {
                        let now = length.sqrt() / step;
                        let factor = if now < last_step { self.longer } else { self.shorter.recip() };
                        memory = (factor * memory).clamp(self.memory_range[0], self.memory_range[1]);
                        last_step = now;
                    }
                    (theta, beta) = (1.0, 0.0);
                } else {
                    let mut next = 0.5 * (1.0 + (1.0 + 4.0 * theta * theta).sqrt());
                    if !EXACT {
                        next = next.min(self.cap.max(self.cap_growth * iteration));
                    }
                    (theta, beta) = (next, (theta - 1.0) / next);
                }
                Extrapolation { beta }
            });
            std::mem::swap(&mut it.x, &mut previous);
            let [length, ..] = totals.sum;
            if curvature * step > length {
                step = 0.9 * length / curvature;
            } else {
                step *= self.growth;
            }
        }
    }
}

/// From the images of y, x and d = x+ - y to those of the next y = x+ + beta (x+ - x) and of x+.
struct Extrapolation {
    beta: f64,
}

impl Combination<2> for Extrapolation {
    #[inline(always)]
    fn of<V: Vector>(&self, d: V, [y, x]: [V; 2]) -> [V; 2] {
        let new = y + d;
        [new + V::splat(self.beta) * (new - x), new]
    }
}
