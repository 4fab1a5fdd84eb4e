//! `kucera`: projected conjugate gradients with expansion and proportioning.
//!
//! Source: R. Kucera, "Convergence rate of an optimization algorithm for minimizing quadratic functions with
//! separable convex constraints", SIAM Journal on Optimization 19:846-862, 2008 (after Dostal and Schoberl
//! 2005); used for contact by T. Heyn, PhD thesis, University of Wisconsin-Madison, 2013.

use super::face::{along_face, where_sticking};
use crate::solver::combination::Accumulate;
use crate::solver::first_order::{FirstOrderMethod, Iterate, add_image};
use crate::solver::lanes::{Batch, Vector, add_scaled, dot, scale, sub, zero};
use crate::solver::scaling::{ContactBatch, Kernel, KernelInput, ScaledProblem};
use crate::solver::tasks::{Tally, for_each_batch};

/// The gradient u = N' x + r' is split, contact by contact, into the part phi along the face of the cone on
/// which x lies (the whole space inside, the ray on the mantle, nothing at the apex) and the rest. While the
/// reduced boundary gradient beta satisfies |beta|^2 <= phi^T phi_reduced, conjugate gradients
/// minimise over the current faces; where their step would leave a cone, half of an expansion step goes to
/// its boundary and a projected step along phi follows; otherwise a proportioning step moves the boundary
/// contacts by a projected gradient step. An iteration costs a look at the gradient and one fused pass.
pub struct Kucera;

/// phi <- part of u along the faces; tallies phi^T phi_reduced, |beta|^2 and |phi|^2.
struct Split {
    step: f64,
}

impl Kernel<2> for Split {
    #[inline(always)]
    fn point<V: Vector>(&self, _: ContactBatch<V>, u: &Batch<V>, [x, _]: [&Batch<V>; 2]) -> Batch<V> {
        add_scaled(x, -self.step, u)
    }

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        KernelInput { u, projected }: KernelInput<V>,
        [x, phi]: [&mut Batch<V>; 2],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        let reduced = sub(x, &projected);
        // On the boundary the free part is a multiple of x, and so is its reduction: x - P(x - step
        // coefficient x).
        let coefficient = dot(x, &u).divide(dot(x, x).max(V::splat(f64::MIN_POSITIVE)));
        let shrink = (V::splat(self.step) * coefficient).min(V::splat(1.0));
        *phi = where_sticking(contact.mu, x, &u, &scale(coefficient, x));
        let reduced_free = where_sticking(contact.mu, x, &reduced, &scale(shrink, x));
        let boundary = sub(&reduced, &reduced_free);
        tally.sum[0] += dot(phi, &reduced_free);
        tally.sum[1] += dot(&boundary, &boundary);
        tally.sum[2] += dot(phi, phi);
        zero()
    }
}

/// p <- phi + conjugation p; tallies phi^T p and the largest inverse of a step x - alpha p that meets the
/// boundary.
struct Direction {
    conjugation: f64,
}

impl Kernel<3> for Direction {
    /// 1 / (largest alpha with x - alpha p in the cone); 0 where there is no bound.
    ///
    /// Inside, alpha is the smallest positive root of a alpha^2 - 2 b alpha + c = 0 with a = |p_t|^2 - mu^2
    /// p_n^2, b = x_t p_t - mu^2 x_n p_n, c = |x_t|^2 - mu^2 x_n^2 < 0, in the form without cancellation
    /// 1/alpha = (sqrt(b^2 - a c) - b) / (-c). On the boundary p points along the ray: 1/alpha = p_n / x_n.
    #[inline(always)]
    fn at<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        _: KernelInput<V>,
        [x, phi, p]: [&mut Batch<V>; 3],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        *p = add_scaled(phi, self.conjugation, p);
        tally.sum[0] += dot(phi, p);
        let (none, square) = (V::default(), contact.mu * contact.mu);
        // No root and no quotient where the shortest step met so far stays in the cones, as it does nearly
        // everywhere.
        let y = sub(&scale(tally.max, x), p);
        let outside = y[1] * y[1] + y[2] * y[2] - square * y[0] * y[0];
        let [outside, ..] = where_sticking(contact.mu, x, &[outside, none, none], &zero());
        if outside.max(-y[0]).all_at_most(none) {
            return *p;
        }
        let a = p[1] * p[1] + p[2] * p[2] - square * p[0] * p[0];
        let b = x[1] * p[1] + x[2] * p[2] - square * x[0] * p[0];
        let c = x[1] * x[1] + x[2] * x[2] - square * x[0] * x[0];
        let discriminant = b * b - a * c;
        // A negative discriminant: the mantle is never met, and p_n <= 0 keeps the apex away too.
        let numerator = none.at_most(discriminant, discriminant.max(none).sqrt() - b, none);
        let along_ray = x[0].at_most(none, none, p[0]);
        let [numerator, denominator, _] =
            where_sticking(contact.mu, x, &[numerator, -c, none], &[along_ray, x[0], none]);
        let inverse = numerator.divide(denominator.max(V::splat(f64::MIN_POSITIVE)));
        tally.max = tally.max.max(inverse.max(none));
        *p
    }
}

/// x <- P(x - step * the boundary contacts' part of u); returns the change.
struct Proportioning {
    step: f64,
}

impl Kernel<1> for Proportioning {
    #[inline(always)]
    fn point<V: Vector>(&self, contact: ContactBatch<V>, u: &Batch<V>, [x]: [&Batch<V>; 1]) -> Batch<V> {
        add_scaled(x, -self.step, &where_sticking(contact.mu, x, &zero(), u))
    }

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        KernelInput { projected: new, .. }: KernelInput<V>,
        [x]: [&mut Batch<V>; 1],
        _: &mut Tally<V>,
    ) -> Batch<V> {
        let d = sub(&new, x);
        *x = new;
        d
    }
}

/// From x to the boundary, x - alpha p, whose gradient is u, and on along the faces: x <- P(x - alpha p -
/// step phi(x - alpha p)); returns the change by the second half.
struct Expansion {
    alpha: f64,
    step: f64,
}

impl Kernel<2> for Expansion {
    #[inline(always)]
    fn point<V: Vector>(&self, contact: ContactBatch<V>, u: &Batch<V>, [x, p]: [&Batch<V>; 2]) -> Batch<V> {
        let boundary = add_scaled(x, -self.alpha, p);
        add_scaled(&boundary, -self.step, &along_face(contact.mu, &boundary, u))
    }

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        KernelInput { projected: new, .. }: KernelInput<V>,
        [x, p]: [&mut Batch<V>; 2],
        _: &mut Tally<V>,
    ) -> Batch<V> {
        let change = sub(&new, &add_scaled(x, -self.alpha, p));
        *x = new;
        change
    }
}

impl FirstOrderMethod for Kucera {
    const NAME: &'static str = "kucera";

    fn run(&mut self, scaled: &ScaledProblem, it: &mut Iterate<'_>) {
        let step = 1.7 / it.largest_curvature(scaled);
        let (mut phi, mut p) = (scaled.zeros(), scaled.zeros());
        let mut image_p = scaled.zero_image();
        let mut last_square = f64::INFINITY;
        while it.proceed(scaled) {
            let split = scaled.look(&it.image, [&mut it.x, &mut phi], &mut it.work, &Split { step });
            // Both reduced gradients are here times the step.
            let [free, boundary, square, ..] = split.sum;
            if boundary > step * free {
                let kernel = Proportioning { step };
                scaled.pass_onto([&mut it.image], [&mut it.x], &mut it.work, &kernel, |_| Accumulate);
                last_square = f64::INFINITY;
                continue;
            }
            let kernel = Direction { conjugation: square / last_square };
            let (totals, curvature) =
                scaled.scatter_pass([&mut it.x, &mut phi, &mut p], &mut image_p, &mut it.work, &kernel);
            it.work.count_product();
            let minimiser = totals.sum[0] / curvature;
            let feasible = 1.0 / totals.max;
            if square == 0.0 {
                continue;
            }
            let alpha = if minimiser.is_finite() { minimiser.min(feasible) } else { feasible };
            let alpha = if alpha.is_finite() { alpha } else { step };
            add_image(&mut it.image, -alpha, &image_p);
            last_square = square;
            if minimiser > feasible {
                let kernel = Expansion { alpha, step };
                scaled.pass_onto([&mut it.image], [&mut it.x, &mut p], &mut it.work, &kernel, |_| Accumulate);
                last_square = f64::INFINITY;
            } else {
                for_each_batch([&mut it.x, &mut p], it.work.tallies(), |_, [x, p], _| {
                    *x = add_scaled(x, -alpha, p);
                });
            }
        }
    }
}
