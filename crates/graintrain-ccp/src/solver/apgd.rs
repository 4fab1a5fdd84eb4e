//! `apgd`: accelerated projected gradient descent with adaptive step and restart.
//!
//! Source: H. Mazhar, T. Heyn, D. Negrut, A. Tasora, "Using Nesterov's method to accelerate multibody
//! dynamics with friction and contact", ACM Transactions on Graphics 34(3):32, 2015, after Nesterov (1983)
//! and, for the restart, O'Donoghue and Candes (2015).

use super::combination::Combination;
use super::first_order::{FirstOrderMethod, Iterate};
use super::lanes::{Batch, Numbers, Vector, add_scaled, dot, project_given, sub, within_disc, within_discs};
use super::momentum::{Memory, Momentum, extrapolated, nesterov};
use super::scaling::{ContactBatch, Image, Kernel, KernelInput, ScaledProblem, TurningBatch};
use super::single::SingleIterate;
use super::tasks::Tally;
use crate::residual::FrictionModel;

/// Accelerated projected gradient on the scaled problem:
///
/// ```text
/// x+ = P( y - t (N' y + r') ),   y+ = x+ + beta (x+ - x)
/// ```
///
/// t shrinks where the curvature met along a step, d^T N' d / |d|^2 with d = x+ - y, exceeds 1/t, and grows
/// slowly otherwise; beta restarts from zero where the step points uphill, (y - x+)^T (x+ - x) > 0. That
/// hardly ever happens: momentum that is too long keeps contacts opening and closing without pointing uphill.
/// So theta stays below `CAP`, or `CAP_GROWTH` times the iteration where
/// that is more, since the slow modes of a tight tolerance need it longer. In runs of settling beds this
/// saves a sixth of the iterations; cold solves of tall packings take a tenth more.
///
/// For exact Coulomb friction P takes the normal impulse first and projects the tangential one on the disc
/// that it allows, as [`GaussSeidel`](super::GaussSeidel) does. The exact problem has no objective that could
/// say when the momentum has lasted long enough: it has a [`Memory`].
///
/// Large problems over rigid bodies are begun in single precision and, where that is not enough, ended in
/// double precision. The first step is made for the curvature of the last solve, where the
/// [settings](super::SolveSettings::curvature) name it.
///
/// One iteration is one fused pass over the contacts and one over the bodies: because images are linear,
/// N' x+ = N' y + N' d needs no product of its own.
#[derive(Clone, Debug, Default)]
pub struct Apgd {
    /// The limit that the last iterations with exact friction ended with.
    found: Option<f64>,
}

/// Factor by which the step grows per iteration.
const GROWTH: f64 = 1.03;
/// Largest theta where friction is relaxed, in the first iterations.
const CAP: f64 = 50.0;
/// Largest theta per iteration made, where that is more than `CAP`.
const CAP_GROWTH: f64 = 0.2;
/// How long the momentum lasts where friction is exact.
pub(super) const MEMORY: Memory =
    Memory { first: 50.0, longer: 1.5, shorter: 0.5, range: [10.0, 3000.0], young: 5.0 };

/// previous <- x+ = P(y - t u) with y = x + beta (x - previous); returns d = x+ - y, tallies |d|^2 and d^T
/// (x+ - x).
///
/// Whether friction is exact is known to the compiler: asked per contact it costs a tenth of an iteration.
pub(super) struct Step<const EXACT: bool> {
    /// t
    pub(super) step: f64,
    /// beta of the point that the step starts from.
    pub(super) beta: f64,
}

impl<const EXACT: bool> Step<EXACT> {
    /// x + beta (x - previous).
    #[inline(always)]
    pub(super) fn extrapolated<V: Numbers>(&self, x: &Batch<V>, previous: &Batch<V>) -> Batch<V> {
        extrapolated(x, previous, self.beta)
    }

    /// y - t u.
    #[inline(always)]
    pub(super) fn point_from<V: Numbers>(&self, u: &Batch<V>, x: &Batch<V>, previous: &Batch<V>) -> Batch<V> {
        add_scaled(&self.extrapolated(x, previous), -self.step, u)
    }

    /// P, given |x_t|.
    #[inline(always)]
    pub(super) fn allowed<V: Numbers>(mu: V, point: &Batch<V>, tangential: V) -> Batch<V> {
        if EXACT { within_disc(mu, point, tangential) } else { project_given(mu, point, tangential) }
    }

    /// The rest of the step, given x+.
    #[inline(always)]
    pub(super) fn moved<V: Numbers>(
        &self,
        new: Batch<V>,
        [x, previous]: [&mut Batch<V>; 2],
        sum: &mut [V],
    ) -> Batch<V> {
        let d = sub(&new, &self.extrapolated(x, previous));
        sum[0] += dot(&d, &d);
        sum[1] += dot(&d, &sub(&new, x));
        *previous = new;
        d
    }
}

impl<const EXACT: bool> Kernel<2> for Step<EXACT> {
    #[inline(always)]
    fn point<V: Vector>(&self, _: ContactBatch<V>, u: &Batch<V>, [x, previous]: [&Batch<V>; 2]) -> Batch<V> {
        self.point_from(u, x, previous)
    }

    #[inline(always)]
    fn projected<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        _: &Batch<V>,
        point: &Batch<V>,
        tangential: V,
    ) -> Batch<V> {
        Self::allowed(contact.mu, point, tangential)
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
        vectors: [&mut Batch<V>; 2],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        self.moved(new, vectors, &mut tally.sum)
    }
}

/// Returns y = x + beta (x - previous): its image is wanted.
pub(super) struct Extrapolated {
    /// beta
    pub(super) beta: f64,
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

/// Where the iterations take place: in double or in single precision. Holds x, the x before, and the images
/// of x and y.
pub(super) trait Space {
    /// Which problem is solved.
    fn friction_model(&self) -> FrictionModel;

    /// What the first step is made for: the largest curvature known from an earlier solve, or that of power
    /// iterations.
    fn first_curvature(&mut self) -> f64;

    /// Counts an iteration and says whether to do it.
    fn proceed(&mut self, beta: f64) -> bool;

    /// A step from y; `next` makes the beta of the next y of |d|^2 and d^T (x+ - x). Returns |d|^2 and d^T N'
    /// d.
    fn step<const EXACT: bool>(
        &mut self,
        kernel: Step<EXACT>,
        next: impl FnOnce([f64; 2]) -> f64,
    ) -> [f64; 2];
}

/// The space of double precision.
struct Double<'a, 'b> {
    scaled: &'a ScaledProblem,
    it: &'a mut Iterate<'b>,
    previous: Vec<Batch>,
    image_y: Image,
}

impl Space for Double<'_, '_> {
    fn friction_model(&self) -> FrictionModel {
        self.scaled.friction_model()
    }

    fn first_curvature(&mut self) -> f64 {
        self.it.known_curvature().unwrap_or_else(|| self.it.largest_curvature(self.scaled))
    }

    fn proceed(&mut self, beta: f64) -> bool {
        let go = self.it.proceed(self.scaled);
        if go && self.it.was_refreshed() {
            // The image of y must not keep the rounding errors that the image of x has just lost: the
            // extrapolation would take the difference for a motion and multiply it.
            let Iterate { x, work, .. } = &mut *self.it;
            let vectors = [&mut x[..], &mut self.previous];
            self.scaled.scatter_pass(vectors, &mut self.image_y, work, &Extrapolated { beta });
        }
        go
    }

    fn step<const EXACT: bool>(
        &mut self,
        kernel: Step<EXACT>,
        next: impl FnOnce([f64; 2]) -> f64,
    ) -> [f64; 2] {
        let Iterate { x, image, work, .. } = &mut *self.it;
        let (images, vectors) = ([&mut self.image_y[..], image], [&mut x[..], &mut self.previous]);
        let (totals, curvature) = self.scaled.pass_onto(images, vectors, work, &kernel, |totals| {
            let [length, downhill, ..] = totals.sum;
            Extrapolation { beta: next([length, downhill]) }
        });
        std::mem::swap(x, &mut self.previous);
        [totals.sum[0], curvature]
    }
}

impl FirstOrderMethod for Apgd {
    const NAME: &'static str = "apgd";
    const EXACT: bool = true;
    const TURNING: bool = true;
    const SINGLE: bool = true;
    const SHARED: bool = true;

    fn remember(&mut self, memory: Option<f64>) {
        self.found = memory;
    }

    fn memory(&self) -> Option<f64> {
        self.found
    }

    fn run(&mut self, scaled: &ScaledProblem, it: &mut Iterate<'_>) {
        let (previous, image_y) = (it.x.clone(), it.image.clone());
        let mut space = Double { scaled, it, previous, image_y };
        let met = self.iterate_in(&mut space);
        it.met_curvature(met);
    }

    fn run_single(&mut self, it: &mut SingleIterate<'_>) {
        let met = self.iterate_in(it);
        it.met_curvature(met);
    }
}

impl Apgd {
    /// The iterations; the largest curvature met along a step, zero where none was made.
    fn iterate_in(&mut self, space: &mut impl Space) -> f64 {
        match space.friction_model() {
            FrictionModel::Relaxed => self.iterate::<false>(space),
            FrictionModel::Coulomb => self.iterate::<true>(space),
        }
    }

    /// The same, with exact friction or not.
    fn iterate<const EXACT: bool>(&mut self, space: &mut impl Space) -> f64 {
        // Found when it is needed: a start that is good enough needs none.
        let mut step = 0.0;
        let (mut theta, mut beta) = (1.0_f64, 0.0);
        let mut momentum = Momentum::new(&MEMORY, self.found);
        let (mut iteration, mut steepest) = (0.0, 0.0_f64);
        while space.proceed(beta) {
            if iteration == 0.0 {
                step = 1.0 / space.first_curvature();
            }
            iteration += 1.0;
            let kernel = Step::<EXACT> { step, beta };
            let [length, curvature] = space.step(kernel, |[length, downhill]| {
                beta = if EXACT {
                    momentum.next(length.sqrt() / step, downhill)
                } else if downhill < 0.0 {
                    theta = 1.0;
                    0.0
                } else {
                    let next = nesterov(theta).0.min(CAP.max(CAP_GROWTH * iteration));
                    let beta = (theta - 1.0) / next;
                    theta = next;
                    beta
                };
                beta
            });
            steepest = steepest.max(curvature / length);
            if curvature * step > length {
                step = 0.9 * length / curvature;
            } else {
                step *= GROWTH;
            }
        }
        if EXACT {
            self.found = Some(momentum.limit);
        }
        steepest
    }
}

/// From the images of y, x and d = x+ - y to those of the next y = x+ + beta (x+ - x) and of x+.
pub(super) struct Extrapolation {
    /// beta
    pub(super) beta: f64,
}

impl Combination<2> for Extrapolation {
    #[inline(always)]
    fn of<V: Numbers>(&self, d: V, [y, x]: [V; 2]) -> [V; 2] {
        let new = y + d;
        [new + V::splat(self.beta) * (new - x), new]
    }
}
