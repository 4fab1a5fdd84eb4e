//! The interior point itself: Mehrotra's predictor and corrector along the central path, with Gondzio's correctors.

use super::super::Status;
use super::cone::product;
use super::iterate::Work;
use super::pair::Pair;
use super::session::Session;
use crate::newton::driver::{NewtonDriver, ScaledBlocks};
use crate::problem::Ccp;
use graintrain_linalg::parallel::dot;

/// (r^T g)^2 / (g^T N g) relative to |r|^2 (scaled) above which the problem is taken as infeasible.
pub(in crate::solver) const UNBOUNDED: f64 = 1e9;
/// Gondzio correctors tried per iteration.
const CORRECTORS: usize = 2;
/// Complementarity products are pulled into this range around their target.
const PRODUCTS: [f64; 2] = [0.1, 10.0];
/// Proximal term of Newton's matrix, relative to eta: steps minimise the objective plus PROXIMAL / 2 |dg|^2, which
/// bounds the condition number of stiff contacts and leaves the solution as it is.
const PROXIMAL: f64 = 1e-9;
/// Barrier of a cold start: impulses in force chains are a few times larger than those of single contacts.
const COLD_BARRIER: f64 = 1e3;
/// Smallest barrier of a warm start.
const WARM_BARRIER: f64 = 1e-4;

/// Runs on the scaled problem with some compliance added to N. `impulse` (physical) gets the best iterate.
pub(super) fn run(
    newton: &mut NewtonDriver,
    session: &mut Session<'_>,
    impulse: &[f64],
    compliance: f64,
) -> Status {
    let scaled = session.scaled;
    let inner = &scaled.problem;
    let mut work = Work::new(inner);
    let contacts = work.contacts();
    let mut product_work = inner.delassus.work();
    // Compliance in the metric of the cone coordinates, compliance T_n^2 T^-2, so that it only adds to delta.
    let give: Vec<[f64; 3]> = work
        .t
        .iter()
        .map(|t| t.map(|x| if x > 0.0 { compliance * (t[0] / x).powi(2) } else { 0.0 }))
        .collect();
    let mut multiply = |g: &[f64], ng: &mut [f64]| {
        inner.delassus.multiply(g, ng, &mut product_work);
        for ((ng, g), give) in ng.iter_mut().zip(g).zip(give.as_flattened()) {
            *ng += give * g;
        }
    };
    let unbounded = UNBOUNDED * dot(&inner.r, &inner.r);

    // The start: the smoothed projection of g - u, from zero or from the impulses handed over.
    let warm = impulse.iter().any(|&g| g != 0.0);
    for i in 0..contacts {
        let g = std::array::from_fn(|k| impulse[3 * i + k] / scaled.impulse_unit[i]);
        let inside = inner.cone(i).project(g);
        work.g[3 * i..3 * i + 3].copy_from_slice(&inside);
    }
    multiply(&work.g, &mut work.ng);
    // The path starts inside the cones: impulses handed over that are good enough must not be lost on the way.
    let residual = session.judge(&work.g, &work.ng);
    if let Some(status) = session.status(residual) {
        return status;
    }
    let mut distance = 0.0;
    for i in 0..contacts {
        let g = [work.g[3 * i], work.g[3 * i + 1], work.g[3 * i + 2]];
        let image =
            inner.cone(i).project(std::array::from_fn(|k| g[k] - work.ng[3 * i + k] - inner.r[3 * i + k]));
        distance += (0..3).map(|k| (g[k] - image[k]).powi(2)).sum::<f64>();
    }
    let distance = (distance / contacts as f64).sqrt();
    let barrier = if warm { distance.clamp(WARM_BARRIER, 1.0) } else { COLD_BARRIER };
    for i in 0..contacts {
        let t = work.t[i];
        let z = std::array::from_fn(|k| {
            let (g, u) = (work.g[3 * i + k], work.ng[3 * i + k] + inner.r[3 * i + k]);
            if t[k] > 0.0 { g / t[k] - u * t[k] } else { 0.0 }
        });
        work.pairs[i] = Pair::start(inner.friction[i], z, barrier);
    }

    let (mut least, mut since_better) = (f64::INFINITY, 0);
    loop {
        work.impulses_from_pairs();
        multiply(&work.g, &mut work.ng);
        work.update_dual_residual(&inner.r);
        let residual = session.judge(&work.g, &work.ng);
        if let Some(status) = session.status(residual) {
            return status;
        }
        if residual < 0.9 * least {
            (least, since_better) = (residual, 0);
        } else {
            since_better += 1;
            if since_better > 15 {
                return Status::Stalled;
            }
        }
        let along = dot(&inner.r, &work.g);
        if along < 0.0 && along * along > unbounded * dot(&work.g, &work.ng) {
            return Status::Infeasible;
        }

        for i in 0..contacts {
            work.scalings[i] = work.pairs[i].scaling();
            let blocks = work.scalings[i].blocks(work.t[i], PROXIMAL + compliance);
            work.added[i] = blocks.added;
            work.factor[i] = blocks.factor;
            work.factor_inverse[i] = blocks.factor_inverse;
            work.to_step[i] = blocks.to_step;
            work.to_scaled[i] = blocks.to_scaled;
        }
        if newton.refresh(inner, work.blocks(), session.iterations, residual).is_err() {
            return Status::Stalled;
        }
        // Errors of the linear solves must stay below the residual reached, more so near the end.
        let linear_tolerance = (1e-3 * residual).clamp(1e-13, 1e-6);
        let barrier = work.barrier();

        work.affine_right_hand_side();
        linear_solve(newton, inner, &mut work, linear_tolerance);
        let affine_step = work.longest_step().min(1.0);
        let sigma = (work.barrier_after(affine_step) / barrier).clamp(0.0, 1.0).powi(3);
        let target = sigma * barrier;
        let [mut complementarity, mut trial] = std::mem::take(&mut work.complementarity);
        for i in 0..contacts {
            let l = work.scalings[i].lambda();
            // Of second order in the affine direction.
            let (square, second) = (product(l, l), product(work.scaled_dx[i], work.scaled_ds[i]));
            complementarity[i] = std::array::from_fn(|k| square[k] + second[k]);
            complementarity[i][0] -= target;
        }
        work.right_hand_side(1.0 - sigma, |i| complementarity[i]);
        linear_solve(newton, inner, &mut work, linear_tolerance);
        let mut step = work.longest_step();

        // Gondzio's correctors: pull outlying complementarity products of a longer step back.
        for _ in 0..CORRECTORS {
            if step >= 1.0 {
                break;
            }
            let aim = (1.5 * step + 0.1).min(1.0);
            for i in 0..contacts {
                let (dx, ds) = (work.scaled_dx[i], work.scaled_ds[i]);
                let correction = outlying(work.scalings[i].lambda(), aim, dx, ds, target);
                trial[i] = std::array::from_fn(|k| complementarity[i][k] + correction[k]);
            }
            work.save_direction();
            work.right_hand_side(1.0 - sigma, |i| trial[i]);
            linear_solve(newton, inner, &mut work, linear_tolerance);
            let longer = work.longest_step();
            if longer < step + 0.1 * (aim - step) {
                work.exchange_direction();
                break;
            }
            step = longer;
            std::mem::swap(&mut complementarity, &mut trial);
        }
        work.complementarity = [complementarity, trial];
        let fraction = (1.0 - 0.1 * barrier.sqrt()).clamp(0.9, 0.9995);
        let alpha = (fraction * step).min(1.0);
        work.advance(alpha);
        newton.end_iteration(alpha);
        session.iterations += 1;
        if !alpha.is_finite() || alpha < 1e-10 {
            return Status::Stalled;
        }
    }
}

fn linear_solve(newton: &mut NewtonDriver, inner: &Ccp, work: &mut Work, tolerance: f64) {
    let Work { added, factor, factor_inverse, rhs, z, .. } = work;
    let blocks = ScaledBlocks { added, factor, factor_inverse };
    newton.solve(inner, blocks, rhs, z, tolerance);
    work.scaled_directions();
}

/// Gondzio's correction of d_c: what the products of the step `aim` exceed the range around the target by, per
/// eigenvalue of (lambda + aim dx) o (lambda + aim ds), bounded below by minus the upper end of the range.
fn outlying(lambda: [f64; 3], aim: f64, dx: [f64; 3], ds: [f64; 3], target: f64) -> [f64; 3] {
    let x: [f64; 3] = std::array::from_fn(|k| lambda[k] + aim * dx[k]);
    let s: [f64; 3] = std::array::from_fn(|k| lambda[k] + aim * ds[k]);
    let v = product(x, s);
    let length = v[1].hypot(v[2]);
    let [low, high] = PRODUCTS.map(|factor| factor * target);
    let excess = |l: f64| (l - l.clamp(low, high)).min(high);
    let (a, b) = (excess(v[0] - length), excess(v[0] + length));
    let (mean, half) = (0.5 * (a + b), 0.5 * (b - a));
    if length > 0.0 { [mean, half * v[1] / length, half * v[2] / length] } else { [mean, 0.0, 0.0] }
}
