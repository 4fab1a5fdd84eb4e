//! The search for a certificate: an interior point on a problem that always has a solution.
//!
//! With a = theta r (r of unit size) the impulses that minimise
//!
//! ```text
//! 1/2 g^T N g + 1/2 (1 + a^T g)^2    over the cones,    tau = 1 + a^T g,
//! ```
//!
//! satisfy N g + tau a in the dual cones, perpendicular to g. Where tau > 0, g / tau solves the problem with
//! r = a; the minimum is tau / 2. Where it is zero, N g = 0 and a^T g = -1: a ray that proves that there is
//! no solution. This is the homogeneous form of the problem, and because it has a solution whatever the
//! problem is, it also solves some on which the direct way stalls (Y. Ye, M. Todd, S. Mizuno, "An O(sqrt(n)
//! L)-iteration homogeneous and self-dual linear programming algorithm", Mathematics of Operations Research
//! 19:53-67, 1994) as a quadratic program. Its matrix is N + a a^T; Newton's systems go through the linear
//! solver at hand and the formula of Sherman and Morrison.

use super::super::driver::Limits;
use super::super::ipm::iterate::Work;
use super::super::ipm::mehrotra;
use super::super::ipm::scaled::Scaled;
use super::apart::places;
use super::certificate::{CERTAIN, Certificate, Evaluator, PROBABLE};
use crate::delassus::DelassusWork;
use crate::newton::driver::NewtonDriver;
use crate::newton::system::ScaledBlocks;
use crate::newton::system::{apply_blocks_in_place, multiply_scaled};
use crate::problem::Ccp;
use graintrain_linalg::parallel::dot;

/// (r^T g)^2 / (g^T N g) relative to |r|^2 (scaled) that makes a search worth its while.
const SUSPICIOUS: f64 = 1e9;

/// theta. The smaller, the more N g = 0 weighs against a^T g = -1, and the larger g gets.
const WEIGHT: f64 = 0.1;
/// Barrier of the start.
const BARRIER: f64 = 10.0;
/// Newton systems allowed.
const SYSTEMS: usize = 80;
/// Newton systems allowed without doubling the V found once that is large.
const PATIENCE: usize = 10;
/// Where the minimum is known to this fraction of itself it is not zero; small, for the sake of the solution
/// that comes of it.
const POSITIVE: f64 = 1e-12;
/// Proximal term relative to eta: rays get far larger than solutions, and 1e-9 would hold them back.
const PROXIMAL: f64 = 1e-13;
/// Relative residual of the linear solves.
const LINEAR: f64 = 1e-12;

/// Whether impulses of a scaled problem look like those of a problem without a solution: (r^T g)^2 / (g^T N
/// g) has grown out of proportion to |r|^2. The optimal value is at most minus half of it. Given r^T g, g^T N
/// g and |r|^2.
pub(crate) fn is_suspicious(along: f64, energy: f64, free: f64) -> bool {
    along < 0.0 && along * along > SUSPICIOUS * free * energy
}

/// Looks for a proof that `problem` has no solution; ends where one is found that is [`CERTAIN`], or no
/// better one can be expected. `scaled` is the problem taken [`apart`](super::apart), which `newton` must
/// have begun; `iterations` counts Newton systems. Each costs one right-hand side more than those of the
/// interior point, and a step of refinement for every one.
pub(crate) fn search(
    newton: &mut NewtonDriver,
    problem: &Ccp,
    scaled: &Scaled,
    limits: &Limits<'_>,
    iterations: &mut usize,
) -> Certificate {
    let inner = &scaled.problem;
    let a: Vec<f64> = inner.r.iter().map(|r| WEIGHT * r).collect();
    let mut evaluator = Evaluator::new(problem);
    // Nothing of r_d counts as noise: the smallest part of N g matters.
    let mut work = Work::new(inner, 0.0);
    (work.proximal, work.noise) = (PROXIMAL, 0.0);
    work.start(inner, &a, BARRIER);
    let mut rank_one = RankOne::new(inner);
    let places = places(problem);
    let mut physical = vec![0.0; places.len()];
    let mut best = Certificate { ray: physical.clone(), ..Certificate::default() };
    let (mut reference, mut since_better) = (0.0, 0);
    for _ in 0..SYSTEMS {
        work.impulses_from_pairs();
        work.multiply(inner);
        let along = dot(&a, &work.g);
        for (ng, a) in work.ng.iter_mut().zip(&a) {
            *ng += a * along;
        }
        work.update_dual_residual(&a);
        for (physical, place) in physical.iter_mut().zip(&places) {
            *physical = place.map_or(0.0, |k| scaled.impulse_unit[k / 3] * work.g[k]);
        }
        let needed_velocity = evaluator.needed_velocity(problem, &physical);
        if needed_velocity > best.needed_velocity {
            best.ray.copy_from_slice(&physical);
            best.needed_velocity = needed_velocity;
        }
        since_better += 1;
        if best.needed_velocity > 2.0 * reference {
            (reference, since_better) = (best.needed_velocity, 0);
        }
        let tau = 1.0 + along;
        let gap = work.barrier() * inner.num_contacts() as f64;
        let defect: f64 = work.residual_dual.iter().zip(&work.g).map(|(d, g)| (d * g).abs()).sum();
        if best.needed_velocity >= CERTAIN
            || (best.needed_velocity >= PROBABLE && since_better > PATIENCE)
            || gap + defect <= POSITIVE * tau
            || limits.status(*iterations, f64::MAX).is_some()
        {
            break;
        }
        work.update_blocks();
        let blocks = work.blocks();
        if newton.refresh(inner, blocks, *iterations, tau).is_err() {
            break;
        }
        rank_one.refresh(newton, inner, blocks, &a);
        let alpha = mehrotra::step(&mut work, |blocks, b, z| rank_one.solve(newton, inner, blocks, b, z));
        newton.end_iteration(alpha);
        *iterations += 1;
        if !alpha.is_finite() || alpha < 1e-10 {
            break;
        }
    }
    let tau = 1.0 + dot(&a, &work.g);
    // Taken apart, a problem keeps its rays alone.
    let solved = tau > 0.0 && problem.turning.is_empty();
    best.solution = solved.then(|| physical.iter().map(|g| g / (WEIGHT * tau)).collect());
    best
}

/// (S~ + c c^T) z = b with c = F^T a, w = S~^-1 c: z = z0 - w (c^T z0) / (1 + c^T w), refined once.
struct RankOne {
    c: Vec<f64>,
    w: Vec<f64>,
    weight: f64,
    defect: Vec<f64>,
    correction: Vec<f64>,
    product: DelassusWork,
    scratch: Vec<f64>,
}

impl RankOne {
    fn new(inner: &Ccp) -> Self {
        let zeros = vec![0.0; 3 * inner.num_contacts()];
        Self {
            c: zeros.clone(),
            w: zeros.clone(),
            weight: 0.0,
            defect: zeros.clone(),
            correction: zeros.clone(),
            product: inner.delassus.work(),
            scratch: zeros,
        }
    }

    /// For the matrix that the linear solver has just taken.
    fn refresh(&mut self, newton: &mut NewtonDriver, inner: &Ccp, blocks: ScaledBlocks<'_>, a: &[f64]) {
        self.c.copy_from_slice(a);
        apply_blocks_in_place(blocks.factor, &mut self.c, true);
        newton.solve(inner, blocks, &self.c, &mut self.w, LINEAR);
        self.weight = 1.0 / (1.0 + dot(&self.c, &self.w));
    }

    fn solve(
        &mut self,
        newton: &mut NewtonDriver,
        inner: &Ccp,
        blocks: ScaledBlocks<'_>,
        b: &[f64],
        z: &mut [f64],
    ) {
        let Self { c, w, weight, defect, correction, product, scratch } = self;
        let mut solve = |b: &[f64], z: &mut [f64]| {
            newton.solve(inner, blocks, b, z, LINEAR);
            let along = *weight * dot(c, z);
            for (z, w) in z.iter_mut().zip(&*w) {
                *z -= along * w;
            }
        };
        solve(b, z);
        multiply_scaled(inner, blocks.factor, z, defect, product, scratch);
        let along = dot(c, z);
        for (k, defect) in defect.iter_mut().enumerate() {
            *defect = b[k] - *defect - along * c[k];
        }
        solve(defect, correction);
        for (z, correction) in z.iter_mut().zip(&*correction) {
            *z += correction;
        }
    }
}
