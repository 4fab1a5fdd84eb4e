//! How far to go along Newton's direction: by the paper's tests, or by the barrier function.

use super::contact::Constraints;
use super::iterate::{Direction, Iterate};
use graintrain_linalg::real;

/// Steps to the boundary are not looked for beyond this one; none is longer than 1.
const FARTHEST: f64 = 10.0;

/// How far [`Pdip`](super::Pdip) goes along Newton's direction.
#[derive(Clone, Debug)]
pub struct StepParameters {
    /// Decrease asked of a step, as a fraction of what the linear model promises.
    pub decrease: f64,
    /// Factor by which backtracking shortens the step.
    pub backtrack: f64,
    /// Backtracking stops below this step.
    pub shortest_step: f64,
    /// Fraction of the way to the boundary of lambda > 0 that the paper's rule goes.
    pub paper_fraction: f64,
    /// The same for both boundaries in the rule of the barrier function.
    pub central_fraction: f64,
}

impl Default for StepParameters {
    fn default() -> Self {
        Self {
            decrease: 0.01,
            backtrack: 0.8,
            shortest_step: 1e-10,
            paper_fraction: 0.99,
            central_fraction: 0.9,
        }
    }
}

/// A step that was found, or how far each test let it come.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    /// Step of impulses and (paper) multipliers; zero where none was found.
    pub(super) taken: f64,
    /// Step of the multipliers.
    pub(super) multipliers: f64,
    /// Longest step that keeps the impulses inside their cones, at most [`FARTHEST`].
    pub(super) cone: f64,
}

/// Smallest positive root of f_1(g + a dg) = 0 or g_n + a dg_n = 0 over all contacts, at most [`FARTHEST`].
fn to_boundary(it: &Iterate<'_>, direction: &Direction) -> f64 {
    let mut longest = FARTHEST;
    for (i, &mu) in it.friction.iter().enumerate() {
        let (g, d) = (&it.g[3 * i..3 * i + 3], &direction.g[3 * i..3 * i + 3]);
        longest = longest.min(contact_to_boundary(mu, g, d));
    }
    longest
}

/// As [`to_boundary`] for one contact. With 2 f_1(a) = c_0 + 2 c_1 a + c_2 a^2, c_0 < 0, the root that is
/// wanted is -c_0 / (c_1 + sqrt(c_1^2 - c_0 c_2)) in every case where there is one; the sum is formed without
/// cancellation.
fn contact_to_boundary(mu: f64, g: &[f64], d: &[f64]) -> f64 {
    let along = real::hypot(d[1], d[2]);
    let c0 = 2.0 * Constraints::new(mu, g).f[0];
    let c1 = g[1] * d[1] + g[2] * d[2] - mu * mu * g[0] * d[0];
    let c2 = (along - mu * d[0].abs()) * (along + mu * d[0].abs());
    let apex = if d[0] < 0.0 { -g[0] / d[0] } else { f64::INFINITY };
    let discriminant = c1 * c1 - c0 * c2;
    if discriminant < 0.0 {
        return apex;
    }
    let root = discriminant.sqrt();
    let divisor = if c1 >= 0.0 { c1 + root } else { -c0 * c2 / (root - c1) };
    if divisor > 0.0 { apex.min(-c0 / divisor) } else { apex }
}

/// Squared norm of (r_d, r_c) at a trial point, or `None` where it is not strictly feasible.
fn residual_square(it: &Iterate<'_>, step: f64, direction: &Direction, barrier: f64) -> Option<f64> {
    let mut sum = 0.0;
    for (i, &mu) in it.friction.iter().enumerate() {
        let at = |x: &[f64], d: &[f64], k: usize| x[k] + step * d[k];
        let g: [f64; 3] = std::array::from_fn(|k| at(&it.g, &direction.g, 3 * i + k));
        let lambda: [f64; 2] = std::array::from_fn(|k| at(&it.lambda, &direction.lambda, 2 * i + k));
        let constraints = Constraints::new(mu, &g);
        let push = constraints.combine(lambda);
        for k in 0..2 {
            if constraints.f[k] >= 0.0 || constraints.f[k].is_nan() {
                return None;
            }
            sum += (-lambda[k] * constraints.f[k] - barrier).powi(2);
        }
        for k in 0..3 {
            sum += (at(&it.u, &direction.u, 3 * i + k) + push[k]).powi(2);
        }
    }
    Some(sum)
}

/// The paper's tests: one step for impulses and multipliers that keeps lambda > 0, then f < 0, then
/// lowers |(r_d, r_c)|.
pub(super) fn by_residual(
    it: &Iterate<'_>,
    direction: &Direction,
    barrier: f64,
    parameters: &StepParameters,
) -> Step {
    let multipliers = it.longest_for_multipliers(parameters.paper_fraction, direction);
    let cone = to_boundary(it, direction);
    let before = residual_square(it, 0.0, direction, barrier).unwrap_or(f64::INFINITY).sqrt();
    let mut step = multipliers;
    while step >= parameters.shortest_step {
        let after = residual_square(it, step, direction, barrier);
        if after.is_some_and(|square| square.sqrt() <= (1.0 - parameters.decrease * step) * before) {
            return Step { taken: step, multipliers: step, cone };
        }
        step *= parameters.backtrack;
    }
    Step { taken: 0.0, multipliers, cone }
}

/// Change of 1/2 x^T N' x + r'^T x + proximal term - barrier sum_k log(-f_k) by a step; not a number outside
/// the cones.
fn barrier_change(it: &Iterate<'_>, step: f64, direction: &Direction, barrier: f64) -> f64 {
    let (mut smooth, mut logarithms) = (0.0, 0.0);
    for (i, &mu) in it.friction.iter().enumerate() {
        let trial: [f64; 3] = std::array::from_fn(|k| it.g[3 * i + k] + step * direction.g[3 * i + k]);
        let (before, after) = (it.constraints(i), Constraints::new(mu, &trial));
        for k in 0..2 {
            logarithms += real::ln(after.f[k] / before.f[k]);
        }
        for k in 3 * i..3 * i + 3 {
            smooth += step * direction.g[k] * (it.u[k] + 0.5 * step * direction.u[k]);
        }
        let move_n = step * direction.g[3 * i];
        smooth += it.proximal * move_n * (it.g[3 * i] - it.anchor[i] + 0.5 * move_n);
    }
    smooth - barrier * logarithms
}

/// Lowers the barrier function: Newton's direction is one of descent for it whatever lambda > 0 is, because
/// its matrix is positive definite and lambda cancels from its right-hand side. The multipliers take a step
/// of their own.
pub(super) fn by_barrier(
    it: &Iterate<'_>,
    direction: &Direction,
    barrier: f64,
    parameters: &StepParameters,
) -> Step {
    let cone = to_boundary(it, direction);
    let multipliers = it.longest_for_multipliers(parameters.central_fraction, direction);
    // Rounding in the sum of logarithms.
    let rounding = 1e-12 * barrier * it.num_contacts() as f64;
    let mut step = (parameters.central_fraction * cone).min(1.0);
    while direction.decrease > 0.0 && step >= parameters.shortest_step {
        // Not a number fails the test.
        if barrier_change(it, step, direction, barrier)
            <= rounding - parameters.decrease * step * direction.decrease
        {
            return Step { taken: step, multipliers, cone };
        }
        step *= parameters.backtrack;
    }
    Step { taken: 0.0, multipliers, cone }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Just before the boundary the point is inside, just after it is outside; without a boundary it
        /// stays inside.
        #[test]
        fn boundary_is_where_the_ray_leaves_the_cone(
            mu in 1e-3..2.0_f64,
            normal in 1e-3..10.0_f64,
            share in 0.0..0.999_f64,
            turn in 0.0..6.2_f64,
            d in prop::array::uniform3(-3.0..3.0_f64),
        ) {
            let g = [normal, share * mu * normal * turn.cos(), share * mu * normal * turn.sin()];
            let inside = |a: f64| {
                let x: [f64; 3] = std::array::from_fn(|k| g[k] + a * d[k]);
                x[1].hypot(x[2]) < mu * x[0]
            };
            let longest = contact_to_boundary(mu, &g, &d);
            if longest.is_finite() {
                prop_assert!(inside(0.999_999 * longest), "{longest}");
                prop_assert!(!inside(1.000_001 * longest), "{longest}");
            } else {
                for a in [0.1, 1.0, 10.0, 1e3, 1e6] {
                    prop_assert!(inside(a), "{a}");
                }
            }
        }
    }
}
