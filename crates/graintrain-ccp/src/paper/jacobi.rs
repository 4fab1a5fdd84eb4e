//! `pj`: projected Jacobi.
//!
//! Source: A. Tasora, M. Anitescu, "A matrix-free cone complementarity approach for solving large-scale,
//! nonsmooth, rigid body dynamics", Computer Methods in Applied Mechanics and Engineering 200:439-453, 2011.

use crate::solver::combination::Accumulate;
use crate::solver::first_order::{FirstOrderMethod, Iterate};
use crate::solver::lanes::{Batch, Vector, add, add_scaled, dot, sub};
use crate::solver::scaling::{ContactBatch, Kernel, KernelInput, ScaledProblem};
use crate::solver::tasks::Tally;

/// Projected Jacobi: all contacts at once from the same velocities,
///
/// ```text
/// x+ = P( x - omega (N' x + r') )
/// ```
///
/// in the metric of the scaled problem (the diagonal of N). It converges for omega below 2 / (largest
/// eigenvalue of N'); omega starts at the inverse of an estimate of it and shrinks whenever the curvature met
/// along a step shows that it was too long. One iteration costs one fused pass.
pub struct Jacobi;

/// Returns d = P(x - omega u) - x and adds it to x; tallies |d|^2.
struct Step {
    omega: f64,
}

impl Kernel<1> for Step {
    #[inline(always)]
    fn point<V: Vector>(&self, _: ContactBatch<V>, u: &Batch<V>, [x]: [&Batch<V>; 1]) -> Batch<V> {
        add_scaled(x, -self.omega, u)
    }

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        KernelInput { projected, .. }: KernelInput<V>,
        [x]: [&mut Batch<V>; 1],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        let d = sub(&projected, x);
        tally.sum[0] += dot(&d, &d);
        *x = add(x, &d);
        d
    }
}

impl FirstOrderMethod for Jacobi {
    const NAME: &'static str = "pj";
    const TURNING: bool = true;

    fn run(&mut self, scaled: &ScaledProblem, it: &mut Iterate<'_>) {
        let mut omega = 1.0 / it.largest_curvature(scaled);
        while it.proceed(scaled) {
            let (totals, curvature) =
                scaled.pass_onto([&mut it.image], [&mut it.x], &mut it.work, &Step { omega }, |_| Accumulate);
            if omega * curvature > 1.5 * totals.sum[0] {
                omega = totals.sum[0] / curvature;
            }
        }
    }
}
