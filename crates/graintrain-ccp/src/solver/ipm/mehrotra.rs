//! One step along the central path: Mehrotra's predictor and corrector, then Gondzio's correctors.

use super::cone::product;
use super::iterate::Work;
use crate::newton::system::ScaledBlocks;
use graintrain_linalg::real;

/// Gondzio's correctors tried per step.
const CORRECTORS: usize = 2;
/// Complementarity products are pulled into this range around their target.
const PRODUCTS: [f64; 2] = [0.1, 10.0];

/// Makes the step from scalings, blocks and dual residual of `work` and returns its length. `solve` solves
/// (I + F^T N F) z = b, given F, b and in z the last solution; it is called two to four times.
pub(crate) fn step(work: &mut Work, mut solve: impl FnMut(ScaledBlocks<'_>, &[f64], &mut [f64])) -> f64 {
    let contacts = work.contacts();
    let barrier = work.barrier();
    work.affine_right_hand_side();
    work.solve(&mut solve);
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
    work.right_hand_side(1.0 - sigma, |i, _| complementarity[i]);
    work.solve(&mut solve);
    let mut step = work.longest_step();

    // Gondzio's correctors: pull outlying complementarity products of a longer step back.
    for _ in 0..CORRECTORS {
        if step >= 1.0 {
            break;
        }
        let aim = (1.5 * step + 0.1).min(1.0);
        for i in 0..contacts {
            let (dx, ds) = (work.scaled_dx[i], work.scaled_ds[i]);
            let correction =
                outlying(work.scalings[i].lambda(), aim, dx, ds, PRODUCTS.map(|factor| factor * target));
            trial[i] = std::array::from_fn(|k| complementarity[i][k] + correction[k]);
        }
        work.save_direction();
        work.right_hand_side(1.0 - sigma, |i, _| trial[i]);
        work.solve(&mut solve);
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
    alpha
}

/// Gondzio's correction of d_c: what the products of the step `aim` exceed the range around the target by,
/// per eigenvalue of (lambda + aim dx) o (lambda + aim ds), bounded below by minus the upper end of the
/// range.
fn outlying(lambda: [f64; 3], aim: f64, dx: [f64; 3], ds: [f64; 3], [low, high]: [f64; 2]) -> [f64; 3] {
    let x: [f64; 3] = std::array::from_fn(|k| lambda[k] + aim * dx[k]);
    let s: [f64; 3] = std::array::from_fn(|k| lambda[k] + aim * ds[k]);
    let v = product(x, s);
    let length = real::hypot(v[1], v[2]);
    let excess = |l: f64| (l - l.clamp(low, high)).min(high);
    let (a, b) = (excess(v[0] - length), excess(v[0] + length));
    let (mean, half) = (0.5 * (a + b), 0.5 * (b - a));
    if length > 0.0 { [mean, half * v[1] / length, half * v[2] / length] } else { [mean, 0.0, 0.0] }
}
