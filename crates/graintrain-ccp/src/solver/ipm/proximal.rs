//! Newton's method on the projection: the proximal point method with semismooth Newton steps.
//!
//! With an anchor a in the cones and a step sigma, the next impulse minimises the objective plus
//! |g - a|^2 / (2 sigma) over the cones, which is
//!
//! ```text
//! g = P(a - sigma (N g + r)).
//! ```
//!
//! Any h with u = N h + r stands for a velocity; the function of h
//!
//! ```text
//! phi(h) = 1/2 h^T N h + |P(a - sigma u)|^2 / (2 sigma),     grad phi = N (h - T),     T = P(a - sigma u)
//! ```
//!
//! is convex and once differentiable, and its minimum is the impulse sought, g = T = h. With V the Jacobian
//! of P at a - sigma u, symmetric with eigenvalues in [0, 1], Newton's step is
//!
//! ```text
//! (I + sigma V N) d = -(h - T):    (I + F^T N F) z = F^T N (h - T),    d = F z - (h - T),    F = sqrt(sigma) V^(1/2).
//! ```
//!
//! This is the system of the interior point with other blocks: where a contact is open F = 0, where it sticks
//! F is sqrt(sigma), where it slides F has rank two. As soon as the contacts that are open, stick and slide
//! are known, one step is exact, and the anchor moves by a factor of about 1 / sigma. Nothing here is large:
//! the condition number is at most 1 + sigma |N|, where the interior point's grows beyond all bounds.
//!
//! Sources: R. T. Rockafellar, "Augmented Lagrangians and applications of the proximal point algorithm in
//! convex programming", Mathematics of Operations Research 1:97-116, 1976; L. Qi, J. Sun, "A nonsmooth
//! version of Newton's method", Mathematical Programming 58:353-367, 1993; X. Zhao, D. Sun, K.-C. Toh, "A
//! Newton-CG augmented Lagrangian method for semidefinite programming", SIAM J. Optimization
//! 20:1737-1765, 2010.

use super::super::report::Status;
use super::context::SolveContext;
use crate::delassus::DelassusWork;
use crate::newton::driver::NewtonDriver;
use crate::newton::system::ScaledBlocks;
use crate::newton::system::{apply_blocks, apply_blocks_in_place};
use crate::problem::Ccp;
use graintrain_linalg::block3::Block;
use graintrain_linalg::real;

/// sigma times the natural map: how far, in units of impulse, an error of the velocities may move the
/// argument of P.
const REACH: f64 = 10.0;
/// Range of sigma, in units of the scaled problem (trace N_ii = 3).
const SIGMA_RANGE: [f64; 2] = [1.0, 1e9];
/// Growth of sigma from one anchor to the next: at least, where the minimum was found in few systems, and at
/// most.
const SIGMA_GROWTH: [f64; 2] = [10.0, 100.0];
/// So many systems are few.
const EASY_SYSTEMS: usize = 3;
/// Factor on sigma where Newton's method does not find the minimum quickly.
const SIGMA_RETREAT: f64 = 0.03;
/// Newton systems allowed per anchor.
const SYSTEMS_PER_ANCHOR: usize = 6;
/// A step shorter than this tells that sigma is too large.
const SHORT_STEP: f64 = 0.05;
/// The anchor moves when the error of the minimum is this fraction of what sigma leaves.
const ANCHOR_ERROR: f64 = 0.3;
/// Newton systems allowed for a tenth of the residual.
const STALL_SYSTEMS: usize = 10;
/// Relative residual of the linear solves.
const LINEAR_TOLERANCE: f64 = 1e-10;
/// A line search ends where the slope along the direction has fallen to this fraction.
const LINE_SEARCH_SLOPE: f64 = 0.5;
/// Evaluations of a line search.
const LINE_SEARCH_TRIALS: usize = 30;

/// V^(1/2) of the projection on the cone at z, times `root`; zero outside.
fn projection_root(mu: f64, z: [f64; 3], root: f64) -> Block {
    let length = real::hypot(z[1], z[2]);
    if length <= mu * z[0] && mu > super::pair::FRICTIONLESS {
        return [root, 0.0, 0.0, 0.0, root, 0.0, 0.0, 0.0, root];
    }
    if mu * length <= -z[0] {
        return [0.0; 9];
    }
    // Eigenvalue 1 along (1, mu e), mu g_n / |z_t| across e, 0 along the normal of the mantle.
    let e = if length > 0.0 { [z[1] / length, z[2] / length] } else { [1.0, 0.0] };
    let norm = (1.0 + mu * mu).sqrt();
    let d = [1.0 / norm, mu * e[0] / norm, mu * e[1] / norm];
    let normal = (z[0] + mu * length) / (1.0 + mu * mu);
    let across = if length > 0.0 { (mu * normal / length).clamp(0.0, 1.0).sqrt() } else { 0.0 };
    let c = [0.0, e[1], -e[0]];
    std::array::from_fn(|k| root * (d[k / 3] * d[k % 3] + across * c[k / 3] * c[k % 3]))
}

/// Vectors of the method.
struct Vectors {
    anchor: Vec<f64>,
    /// h and N h.
    h: Vec<f64>,
    nh: Vec<f64>,
    /// T and N T.
    image: Vec<f64>,
    nimage: Vec<f64>,
    /// P(h) and N P(h).
    projected: Vec<f64>,
    nprojected: Vec<f64>,
    /// h - T and N (h - T).
    gap: Vec<f64>,
    ngap: Vec<f64>,
    rhs: Vec<f64>,
    z: Vec<f64>,
    direction: Vec<f64>,
    ndirection: Vec<f64>,
    factor: Vec<Block>,
}

fn largest(v: &[f64]) -> f64 {
    v.iter().fold(0.0_f64, |m, x| m.max(x.abs()))
}

/// Largest component of g - P(g - (N g + r)), given N g.
fn natural_map(problem: &Ccp, g: &[f64], ng: &[f64]) -> f64 {
    let mut largest = 0.0_f64;
    for i in 0..problem.num_contacts() {
        let z = std::array::from_fn(|k| g[3 * i + k] - ng[3 * i + k] - problem.r[3 * i + k]);
        for (k, image) in problem.cone(i).project(z).into_iter().enumerate() {
            largest = largest.max((g[3 * i + k] - image).abs());
        }
    }
    largest
}

impl Vectors {
    fn new(size: usize) -> Self {
        let zeros = || vec![0.0; size];
        Self {
            anchor: zeros(),
            h: zeros(),
            nh: zeros(),
            image: zeros(),
            nimage: zeros(),
            projected: zeros(),
            nprojected: zeros(),
            gap: zeros(),
            ngap: zeros(),
            rhs: zeros(),
            z: zeros(),
            direction: zeros(),
            ndirection: zeros(),
            factor: vec![[0.0; 9]; size / 3],
        }
    }

    /// h <- a.
    fn begin(&mut self, problem: &Ccp, work: &mut DelassusWork) {
        for i in 0..self.factor.len() {
            let a = [self.anchor[3 * i], self.anchor[3 * i + 1], self.anchor[3 * i + 2]];
            self.anchor[3 * i..3 * i + 3].copy_from_slice(&problem.cone(i).project(a));
        }
        self.h.copy_from_slice(&self.anchor);
        problem.delassus.multiply(&self.h, &mut self.nh, work);
        self.ndirection.fill(0.0);
    }

    /// T, V^(1/2) and P(h) at h.
    fn evaluate(&mut self, problem: &Ccp, sigma: f64, work: &mut DelassusWork) {
        for i in 0..self.factor.len() {
            let z = self.argument(problem, sigma, 0.0, i);
            self.factor[i] = projection_root(problem.friction[i], z, sigma.sqrt());
            self.image[3 * i..3 * i + 3].copy_from_slice(&problem.cone(i).project(z));
            let h = [self.h[3 * i], self.h[3 * i + 1], self.h[3 * i + 2]];
            self.projected[3 * i..3 * i + 3].copy_from_slice(&problem.cone(i).project(h));
        }
        for k in 0..self.h.len() {
            self.gap[k] = self.h[k] - self.image[k];
        }
        problem.delassus.multiply(&self.gap, &mut self.ngap, work);
        problem.delassus.multiply(&self.image, &mut self.nimage, work);
        problem.delassus.multiply(&self.projected, &mut self.nprojected, work);
    }

    /// Largest change of an impulse component from the anchor.
    fn distance(&self, g: &[f64]) -> f64 {
        g.iter().zip(&self.anchor).fold(0.0_f64, |m, (g, a)| m.max((g - a).abs()))
    }

    /// a - sigma (N (h + alpha d) + r) of contact i.
    fn argument(&self, problem: &Ccp, sigma: f64, alpha: f64, i: usize) -> [f64; 3] {
        std::array::from_fn(|k| {
            let k = 3 * i + k;
            self.anchor[k] - sigma * (self.nh[k] + alpha * self.ndirection[k] + problem.r[k])
        })
    }

    /// Slope of phi along the direction: d^T N (h + alpha d - T(alpha)).
    fn slope(&self, problem: &Ccp, sigma: f64, alpha: f64) -> f64 {
        let mut sum = 0.0;
        for i in 0..self.factor.len() {
            let image = problem.cone(i).project(self.argument(problem, sigma, alpha, i));
            for k in 0..3 {
                let at = 3 * i + k;
                sum += self.ndirection[at] * (self.h[at] + alpha * self.direction[at] - image[k]);
            }
        }
        sum
    }

    /// The direction of Newton's method at h; `false` where its system cannot be solved.
    fn newton_direction(
        &mut self,
        newton: &mut NewtonDriver,
        context: &SolveContext<'_>,
        residual: f64,
        work: &mut DelassusWork,
    ) -> bool {
        let inner = &context.scaled.problem;
        let blocks = ScaledBlocks { added: &[], factor: &self.factor, factor_inverse: &[] };
        if newton.refresh(inner, blocks, context.iterations, residual).is_err() {
            return false;
        }
        self.rhs.copy_from_slice(&self.ngap);
        apply_blocks_in_place(&self.factor, &mut self.rhs, true);
        newton.solve(inner, blocks, &self.rhs, &mut self.z, LINEAR_TOLERANCE);
        apply_blocks(&self.factor, &self.z, &mut self.direction, false);
        for (direction, gap) in self.direction.iter_mut().zip(&self.gap) {
            *direction -= gap;
        }
        inner.delassus.multiply(&self.direction, &mut self.ndirection, work);
        true
    }

    /// Step along the direction: 1 where the slope there is not steeply upwards, else near the minimum.
    fn step(&self, problem: &Ccp, sigma: f64) -> f64 {
        let start = self.slope(problem, sigma, 0.0);
        let bound = LINE_SEARCH_SLOPE * start.abs();
        let (mut low, mut slope_low) = (0.0, start);
        let (mut high, mut slope_high) = (1.0, self.slope(problem, sigma, 1.0));
        if start >= 0.0 || slope_high <= bound {
            return 1.0;
        }
        // The slope grows monotonically: regula falsi, with the Illinois rule.
        for _ in 0..LINE_SEARCH_TRIALS {
            let middle = low + (high - low) * slope_low / (slope_low - slope_high);
            let slope = self.slope(problem, sigma, middle);
            if slope.abs() <= bound {
                return middle;
            }
            if slope < 0.0 {
                (low, slope_low, slope_high) = (middle, slope, 0.5 * slope_high);
            } else {
                (high, slope_high, slope_low) = (middle, slope, 0.5 * slope_low);
            }
        }
        low
    }
}

/// Runs the method from `impulse` until the tolerance or a limit is reached, or it does not get on
/// ([`Status::Stalled`]). The best iterate is left with the context.
pub(super) fn run(newton: &mut NewtonDriver, context: &mut SolveContext<'_>, impulse: &[f64]) -> Status {
    let inner = &context.scaled.problem;
    let contacts = inner.num_contacts();
    let mut work: DelassusWork = inner.delassus.work();
    let mut v = Vectors::new(3 * contacts);
    context.scale(impulse, &mut v.anchor);
    v.begin(inner, &mut work);
    let mut residual = context.measure(&v.h, &v.nh);
    let mut best = v.h.clone();
    let mut sigma = (REACH / natural_map(inner, &v.h, &v.nh)).clamp(SIGMA_RANGE[0], SIGMA_RANGE[1]);
    let (mut systems, mut since_better, mut reference) = (0, 0, f64::INFINITY);
    loop {
        if let Some(status) = context.status(residual) {
            return status;
        }
        v.evaluate(inner, sigma, &mut work);
        // Two candidates. In exact arithmetic they agree at the minimum; T carries the rounding errors of u
        // times sigma, P(h) does not.
        let (by_image, by_projection) =
            (context.measure(&v.image, &v.nimage), context.measure(&v.projected, &v.nprojected));
        let (candidate, ncandidate, now) = if by_projection <= by_image {
            (&v.projected, &v.nprojected, by_projection)
        } else {
            (&v.image, &v.nimage, by_image)
        };
        if now < residual {
            residual = now;
            best.copy_from_slice(candidate);
        }
        if let Some(status) = context.status(residual) {
            return status;
        }
        if residual <= 0.1 * reference {
            (reference, since_better) = (residual, 0);
        }
        if since_better >= STALL_SYSTEMS {
            return Status::Stalled;
        }
        if systems > 0 {
            let left = v.distance(candidate) / sigma;
            let defect = natural_map(inner, candidate, ncandidate);
            // The second test is for rounding errors of u, which T has times sigma.
            if largest(&v.ngap) <= ANCHOR_ERROR * left || defect <= (1.0 + ANCHOR_ERROR) * left {
                v.anchor.copy_from_slice(candidate);
                v.begin(inner, &mut work);
                let least = if systems <= EASY_SYSTEMS { SIGMA_GROWTH[0] * sigma } else { sigma };
                sigma = (REACH / defect).clamp(least, SIGMA_GROWTH[1] * sigma).min(SIGMA_RANGE[1]);
                systems = 0;
                continue;
            }
        }
        if systems == SYSTEMS_PER_ANCHOR {
            sigma *= SIGMA_RETREAT;
            if sigma < SIGMA_RANGE[0] {
                return Status::Stalled;
            }
            v.anchor.copy_from_slice(&best);
            v.begin(inner, &mut work);
            systems = 0;
            continue;
        }
        if !v.newton_direction(newton, context, residual, &mut work) {
            return Status::Stalled;
        }
        let alpha = v.step(inner, sigma);
        newton.end_iteration(alpha);
        context.iterations += 1;
        systems = if alpha < SHORT_STEP { SYSTEMS_PER_ANCHOR } else { systems + 1 };
        since_better += 1;
        for (h, direction) in v.h.iter_mut().zip(&v.direction) {
            *h += alpha * direction;
        }
        inner.delassus.multiply(&v.h, &mut v.nh, &mut work);
    }
}
