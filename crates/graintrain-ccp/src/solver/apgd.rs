//! `apgd`: accelerated projected gradient descent with adaptive step and restart.
//!
//! Source: H. Mazhar, T. Heyn, D. Negrut, A. Tasora, "Using Nesterov's method to accelerate multibody dynamics with
//! friction and contact", ACM Transactions on Graphics 34(3):32, 2015, after Nesterov (1983) and, for the restart,
//! O'Donoghue and Candes (2015).

use super::first_order::{FirstOrder, FirstOrderMethod, IMAGE_CHUNK, Iterate};
use super::lanes::{Batch, Lanes, Vector, add_scaled, dot, project, sub};
use super::scaling::{Here, Kernel, ScaledProblem};
use super::sweep::Tally;
use crate::residual::FrictionModel;
use rayon::prelude::*;

/// Accelerated projected gradient on the scaled problem:
///
/// ```text
/// x+ = P( y - t (N' y + r') ),   y+ = x+ + beta (x+ - x)
/// ```
///
/// t shrinks where the curvature met along a step, d^T N' d / |d|^2 with d = x+ - y, exceeds 1/t, and grows slowly
/// otherwise; beta restarts from zero where the step points uphill, (y - x+)^T (x+ - x) > 0.
///
/// For exact Coulomb friction mu' |u_t| is added to the normal component of u = N' y + r' before the projection (the fixed point of De
/// Saxce and Feng 1998, updated in every iteration), and the momentum is limited.
///
/// One iteration is one fused pass over the contacts and one over the bodies: because images are linear,
/// N' x+ = N' y + N' d needs no product of its own.
#[derive(Clone, Debug)]
pub struct Apgd {
    /// Factor by which the step grows per iteration.
    pub growth: f64,
    /// theta at which beta restarts where friction is exact (after about twice as many iterations). The exact problem
    /// has no objective that the other test for a restart could watch; without this one the iterates may circle.
    pub longest_memory: f64,
}

impl Default for Apgd {
    fn default() -> Self {
        Self { growth: 1.03, longest_memory: 50.0 }
    }
}

/// previous <- x+ = P(y - t u) with y = x + beta (x - previous); returns d = x+ - y, tallies |d|^2 and d^T (x+ - x).
struct Step {
    step: f64,
    beta: f64,
}

impl Kernel<2> for Step {
    #[inline(always)]
    fn at<V: Vector>(
        &self,
        here: Here<V>,
        u: &Batch<V>,
        [x, previous]: [&mut Batch<V>; 2],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        let y = add_scaled(x, self.beta, &sub(x, previous));
        let new = project(here.mu, &add_scaled(&y, -self.step, &here.drive(u)));
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
        _: Here<V>,
        _: &Batch<V>,
        [x, previous]: [&mut Batch<V>; 2],
        _: &mut Tally<V>,
    ) -> Batch<V> {
        add_scaled(x, self.beta, &sub(x, previous))
    }
}

impl FirstOrderMethod for Apgd {
    const NAME: &'static str = "apgd";
    const EXACT: bool = true;

    fn run(&mut self, scaled: &ScaledProblem, it: &mut Iterate<'_>) {
        let mut step = 1.0 / it.largest_curvature(scaled);
        let mut previous = it.x.clone();
        let (mut image_y, mut image_d) = (it.image.clone(), scaled.zero_image());
        let (mut theta, mut beta) = (1.0_f64, 0.0);
        let longest = match scaled.friction_model() {
            FrictionModel::Relaxed => f64::INFINITY,
            FrictionModel::Coulomb => self.longest_memory,
        };
        while it.proceed(scaled) {
            if it.was_refreshed() {
                // The image of y must not keep the rounding errors that the image of x has just lost: the extrapolation
                // would take the difference for a motion and multiply it.
                let Iterate { x, work, .. } = it;
                scaled.scatter_pass([x, &mut previous], &mut image_y, work, &Extrapolated { beta });
            }
            let kernel = Step { step, beta };
            let (totals, curvature) =
                scaled.pass(&image_y, [&mut it.x, &mut previous], &mut image_d, &mut it.work, &kernel);
            std::mem::swap(&mut it.x, &mut previous);
            let [length, downhill, ..] = totals.sum;
            if curvature * step > length {
                step = 0.9 * length / curvature;
            } else {
                step *= self.growth;
            }
            if downhill < 0.0 || theta > longest {
                (theta, beta) = (1.0, 0.0);
            } else {
                let next = 0.5 * (1.0 + (1.0 + 4.0 * theta * theta).sqrt());
                (theta, beta) = (next, (theta - 1.0) / next);
            }
            extrapolate(&mut it.image, &mut image_y, &image_d, beta);
        }
    }
}

/// From the images of x, y and d = x+ - y to those of x+ and of the next y = x+ + beta (x+ - x).
fn extrapolate(x: &mut [Lanes], y: &mut [Lanes], d: &[Lanes], beta: f64) {
    let beta = Lanes::splat(beta);
    let tasks =
        x.par_chunks_mut(IMAGE_CHUNK).zip(y.par_chunks_mut(IMAGE_CHUNK)).zip(d.par_chunks(IMAGE_CHUNK));
    tasks.for_each(|((x, y), d)| {
        for ((x, y), d) in x.iter_mut().zip(y).zip(d) {
            let new = *y + *d;
            *y = new + beta * (new - *x);
            *x = new;
        }
    });
}

/// Makes the solver by name; it has no linear solver.
pub(super) fn build(linear: Option<&str>) -> Result<Box<dyn super::CcpSolver>, crate::CcpError> {
    super::without_linear_solver(Apgd::NAME, linear)?;
    Ok(Box::new(FirstOrder::new(Apgd::default())))
}
