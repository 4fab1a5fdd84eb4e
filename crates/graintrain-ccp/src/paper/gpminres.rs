//! `gpminres`: gradient-projected minimum residual.
//!
//! Source: T. Heyn, M. Anitescu, A. Tasora, D. Negrut, "Using Krylov subspace and spectral methods for
//! solving complementarity problems in many-body contact dynamics simulation", International Journal for
//! Numerical Methods in Engineering 95:541-561, 2013, after the gradient projection / conjugate gradient
//! method of J. More, G. Toraldo (1991).

use super::face::in_tangent_space;
use crate::solver::combination::Accumulate;
use crate::solver::first_order::{FirstOrderMethod, Iterate};
use crate::solver::lanes::{Batch, Vector, add, add_scaled, dot, sub, zero};
use crate::solver::scaling::{ContactBatch, Image, Kernel, KernelInput, ScaledProblem};
use crate::solver::tasks::Tally;

/// Two phases by turns. Gradient projection steps with a spectral step length find out which contacts stick,
/// slide or carry nothing. Then the minimum residual method solves the equations of that face, Z^T (N' (x +
/// w) + r') = 0 for w in the tangent space of the cones at x (Z), and a projected search x+ = P(x + tau w),
/// tau = 1, 1/2, 1/4, .., takes the first point with a lower objective. Minimum residuals are computed by the
/// conjugate residual recurrence (Stiefel 1955), the same iterates for the positive semi-definite N'. A
/// gradient step costs one fused pass, a minimum residual step a pass and a look.
pub struct GpMinres;

/// Gradient projection steps per turn.
const GRADIENT_STEPS: usize = 10;
/// Minimum residual steps per turn, at most.
const KRYLOV_STEPS: usize = 60;
/// A turn of minimum residuals ends when they fell by this factor.
const KRYLOV_TOLERANCE: f64 = 0.1;

/// x <- P(x - alpha u); tallies |d|^2.
struct GradientStep {
    alpha: f64,
}

impl Kernel<1> for GradientStep {
    #[inline(always)]
    fn point<V: Vector>(&self, _: ContactBatch<V>, u: &Batch<V>, [x]: [&Batch<V>; 1]) -> Batch<V> {
        add_scaled(x, -self.alpha, u)
    }

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        KernelInput { projected: new, .. }: KernelInput<V>,
        [x]: [&mut Batch<V>; 1],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        let d = sub(&new, x);
        tally.sum[0] += dot(&d, &d);
        *x = new;
        d
    }
}

/// For kernels whose first vector is x: Z Z^T u at the face of x.
macro_rules! at_face_of_first {
    ($vectors:literal) => {
        #[inline(always)]
        fn point<V: Vector>(
            &self,
            _: ContactBatch<V>,
            _: &Batch<V>,
            [x, ..]: [&Batch<V>; $vectors],
        ) -> Batch<V> {
            *x
        }

        #[inline(always)]
        fn projected<V: Vector>(
            &self,
            contact: ContactBatch<V>,
            u: &Batch<V>,
            x: &Batch<V>,
            tangential: V,
        ) -> Batch<V> {
            in_tangent_space(contact.mu, x, tangential, u)
        }
    };
}

/// rho <- -Z Z^T u, the start of the minimum residual method with w = 0; returns it, tallies |rho|^2.
struct FaceResidual;

impl Kernel<5> for FaceResidual {
    at_face_of_first!(5);

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        KernelInput { projected, .. }: KernelInput<V>,
        [_, w, rho, p, ap]: [&mut Batch<V>; 5],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        *rho = sub(&zero(), &projected);
        *w = zero();
        *p = zero();
        *ap = zero();
        tally.sum[0] += dot(rho, rho);
        *rho
    }
}

/// p <- rho + beta p, ap <- Z Z^T N' rho + beta ap from the image of rho; tallies |ap|^2.
struct Conjugate {
    beta: f64,
}

impl Kernel<4> for Conjugate {
    const GRADIENT: bool = false;

    at_face_of_first!(4);

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        KernelInput { projected, .. }: KernelInput<V>,
        [_, rho, p, ap]: [&mut Batch<V>; 4],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        *p = add_scaled(rho, self.beta, p);
        *ap = add_scaled(&projected, self.beta, ap);
        tally.sum[0] += dot(ap, ap);
        *ap
    }
}

/// w <- w + alpha p, rho <- rho - alpha ap; returns rho, tallies |rho|^2.
struct Advance {
    alpha: f64,
}

impl Kernel<4> for Advance {
    const SHORT: bool = true;

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        _: KernelInput<V>,
        [w, rho, p, ap]: [&mut Batch<V>; 4],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        *w = add_scaled(w, self.alpha, p);
        *rho = add_scaled(rho, -self.alpha, ap);
        tally.sum[0] += dot(rho, rho);
        *rho
    }
}

/// trial <- P(x + tau w) - x; tallies u^T trial.
struct Trial {
    tau: f64,
}

impl Kernel<3> for Trial {
    #[inline(always)]
    fn point<V: Vector>(&self, _: ContactBatch<V>, _: &Batch<V>, [x, w, _]: [&Batch<V>; 3]) -> Batch<V> {
        add_scaled(x, self.tau, w)
    }

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        KernelInput { u, projected }: KernelInput<V>,
        [x, _, trial]: [&mut Batch<V>; 3],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        *trial = sub(&projected, x);
        tally.sum[0] += dot(&u, trial);
        *trial
    }
}

/// Vectors of the minimum residual phase.
struct Face {
    w: Vec<Batch>,
    rho: Vec<Batch>,
    p: Vec<Batch>,
    ap: Vec<Batch>,
    image: Image,
    image_rho: Image,
}

impl FirstOrderMethod for GpMinres {
    const NAME: &'static str = "gpminres";

    fn run(&mut self, scaled: &ScaledProblem, it: &mut Iterate<'_>) {
        let shortest = 1.0 / it.largest_curvature(scaled);
        let mut face = Face {
            w: scaled.zeros(),
            rho: scaled.zeros(),
            p: scaled.zeros(),
            ap: scaled.zeros(),
            image: scaled.zero_image(),
            image_rho: scaled.zero_image(),
        };
        loop {
            let mut alpha = shortest;
            for _ in 0..GRADIENT_STEPS {
                if !it.proceed(scaled) {
                    return;
                }
                let kernel = GradientStep { alpha };
                let (totals, curvature) =
                    scaled.pass_onto([&mut it.image], [&mut it.x], &mut it.work, &kernel, |_| Accumulate);
                // The longest step that is sure to descend along this direction, not beyond two shortest
                // ones.
                let spectral = totals.sum[0] / curvature;
                alpha =
                    if spectral.is_finite() { spectral.clamp(shortest, 1.8 * shortest) } else { shortest };
            }
            if !minimise_on_face(scaled, it, &mut face) {
                return;
            }
            projected_search(scaled, it, &mut face);
        }
    }
}

/// w of the current face by minimum residuals; false where it is time to stop.
fn minimise_on_face(scaled: &ScaledProblem, it: &mut Iterate<'_>, face: &mut Face) -> bool {
    let Face { w, rho, p, ap, image_rho, .. } = face;
    let (totals, mut quadratic) =
        scaled.pass(&it.image, [&mut it.x, w, rho, p, ap], image_rho, &mut it.work, &FaceResidual);
    let target = KRYLOV_TOLERANCE * KRYLOV_TOLERANCE * totals.sum[0];
    let mut beta = 0.0;
    for _ in 0..KRYLOV_STEPS {
        if !it.count() {
            return it.check(scaled);
        }
        let length =
            scaled.look(image_rho, [&mut it.x, rho, p, ap], &mut it.work, &Conjugate { beta }).sum[0];
        let alpha = quadratic / length;
        if !alpha.is_finite() {
            break;
        }
        let last = quadratic;
        let (totals, new) = scaled.scatter_pass([w, rho, p, ap], image_rho, &mut it.work, &Advance { alpha });
        it.work.count_product();
        quadratic = new;
        beta = quadratic / last;
        if totals.sum[0] <= target || !beta.is_finite() {
            break;
        }
    }
    true
}

/// x <- P(x + tau w) for the first tau = 1, 1/2, .. that lowers the objective, whose change is u^T d + d^T N'
/// d / 2; x stays where none does.
fn projected_search(scaled: &ScaledProblem, it: &mut Iterate<'_>, face: &mut Face) {
    let Face { w, rho: trial, image, .. } = face;
    let mut tau = 1.0;
    for _ in 0..8 {
        let (totals, curvature) =
            scaled.pass(&it.image, [&mut it.x, w, trial], image, &mut it.work, &Trial { tau });
        if totals.sum[0] + 0.5 * curvature < 0.0 {
            for (x, d) in it.x.iter_mut().zip(trial.iter()) {
                *x = add(x, d);
            }
            it.add_image(1.0, image);
            return;
        }
        tau *= 0.5;
    }
}
