//! The constraints of one contact and what they add to Newton's matrix.

use graintrain_linalg::block3::Block;
use graintrain_linalg::real;

/// One contact at scaled impulse g: constraints and what Newton's matrix needs of them.
pub(super) struct Constraints {
    /// f_1, f_2.
    pub(super) f: [f64; 2],
    /// grad f_1.
    pub(super) cone_gradient: [f64; 3],
}

impl Constraints {
    #[inline]
    pub(super) fn new(mu: f64, g: &[f64]) -> Self {
        let m = mu * mu;
        // (|g_t| - mu g_n) (|g_t| + mu g_n) / 2 loses no digits near the boundary.
        let tangential = real::hypot(g[1], g[2]);
        let cone = 0.5 * (tangential - mu * g[0]) * (tangential + mu * g[0]);
        Self { f: [cone, -g[0]], cone_gradient: [-m * g[0], g[1], g[2]] }
    }

    /// H = lambda_1 Hess f_1 + sum_k lambda_k / (-f_k) grad f_k grad f_k^T + proximal n n^T with its factors.
    ///
    /// Across the tangential impulse H is lambda_1. In the plane of the normal and that impulse, with rho
    /// = |g_t| and c = (mu^2 g_n^2 + rho^2) / (-2 f_1), which is never below 1,
    ///
    /// ```text
    /// H_rr = lambda_1 c,   H_nr = -lambda_1 mu^2 g_n rho / (-f_1),   H_nn = lambda_1 mu^2 c + (lambda_2 / g_n + proximal)
    /// det = lambda_1^2 mu^2 + lambda_1 c (lambda_2 / g_n + proximal)
    /// ```
    ///
    /// No term of the determinant cancels, so that the Cholesky factor H = B L L^T B^T, rows in the order r,
    /// n, s of the basis B, has full relative accuracy next to the boundary. F = B L^-T.
    #[inline]
    pub(super) fn newton_blocks(&self, mu: f64, g: &[f64], lambda: &[f64], proximal: f64) -> NewtonBlocks {
        let m = mu * mu;
        let rho = real::hypot(g[1], g[2]);
        let along = if rho > 0.0 { [g[1] / rho, g[2] / rho] } else { [1.0, 0.0] };
        let gap = -self.f[0];
        let c = ((m * g[0] * g[0] + rho * rho) / (2.0 * gap)).max(1.0);
        let other = lambda[1] / -self.f[1] + proximal;
        let (rr, nr) = (lambda[0] * c, -lambda[0] * m * g[0] * rho / gap);
        let nn = lambda[0] * m * c + other;
        let determinant = lambda[0] * (lambda[0] * m + c * other);
        // L = [[p, 0, 0], [q, s, 0], [0, 0, t]] in the order r, n, s.
        let (p, t) = (rr.sqrt(), lambda[0].sqrt());
        let (q, s) = (nr / p, (determinant / rr).sqrt());
        let [x, y] = along;
        // Columns of B: r = (0, x, y), n = (1, 0, 0), s = (0, -y, x).
        NewtonBlocks {
            added: [
                nn,
                nr * x,
                nr * y,
                nr * x,
                rr * x * x + lambda[0] * y * y,
                (rr - lambda[0]) * x * y,
                nr * y,
                (rr - lambda[0]) * x * y,
                rr * y * y + lambda[0] * x * x,
            ],
            // B L^-T, L^-T = [[1/p, -q/(p s), 0], [0, 1/s, 0], [0, 0, 1/t]].
            factor: [0.0, 1.0 / s, 0.0, x / p, -x * q / (p * s), -y / t, y / p, -y * q / (p * s), x / t],
            // L^T B^T, L^T = [[p, q, 0], [0, s, 0], [0, 0, t]].
            factor_inverse: [q, p * x, p * y, s, 0.0, 0.0, 0.0, -t * y, t * x],
            // L^-1 B^T grad f_1 with the difference taken in closed form.
            gradient: [rho / p, -m * g[0] / (c * s)],
        }
    }

    /// sum_k c_k grad f_k.
    #[inline]
    pub(super) fn combine(&self, c: [f64; 2]) -> [f64; 3] {
        let d = &self.cone_gradient;
        [c[0] * d[0] - c[1], c[0] * d[1], c[0] * d[2]]
    }
}

/// What one contact adds to Newton's matrix; see [`Constraints::newton_blocks`].
pub(super) struct NewtonBlocks {
    /// H.
    pub(super) added: Block,
    /// F.
    pub(super) factor: Block,
    /// F^-1.
    pub(super) factor_inverse: Block,
    /// First two components of F^T grad f_1; the third is zero.
    pub(super) gradient: [f64; 2],
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The Lagrangian's second derivatives by central differences of its first ones.
    #[test]
    fn newton_block_matches_finite_differences_of_the_eliminated_system() {
        let (mu, g, lambda, proximal) = (0.4, [1.3, 0.2, -0.3], [0.7, 0.25], 0.3);
        // With lambda eliminated by r_c = 0 linearised, the derivative of the push along dg is the block:
        // compare d/dg [ sum lambda_k(g) grad f_k(g) ] where lambda_k changes by dlambda_k = lambda_k grad
        // f_k . dg / (-f_k).
        let push = |g: [f64; 3]| {
            let base = Constraints::new(mu, &[1.3, 0.2, -0.3]);
            let change: [f64; 2] = std::array::from_fn(|k| {
                let gradient = if k == 0 { base.cone_gradient } else { [-1.0, 0.0, 0.0] };
                let along: f64 = (0..3).map(|d| gradient[d] * (g[d] - [1.3, 0.2, -0.3][d])).sum();
                lambda[k] * along / -base.f[k]
            });
            let push = Constraints::new(mu, &g).combine([lambda[0] + change[0], lambda[1] + change[1]]);
            [push[0] + proximal * g[0], push[1], push[2]]
        };
        let blocks = Constraints::new(mu, &g).newton_blocks(mu, &g, &lambda, proximal);
        let NewtonBlocks { added: block, factor, factor_inverse, gradient } = blocks;
        let unit = |r: usize, c: usize| f64::from(u8::from(r == c));
        for r in 0..3 {
            for c in 0..3 {
                let product: f64 = (0..3).map(|k| factor[3 * r + k] * factor_inverse[3 * k + c]).sum();
                assert!((product - unit(r, c)).abs() < 1e-13);
                // F^T H F = I.
                let product: f64 =
                    (0..9).map(|k| factor[3 * (k / 3) + r] * block[k] * factor[3 * (k % 3) + c]).sum();
                assert!((product - unit(r, c)).abs() < 1e-13);
            }
            let image: f64 =
                (0..3).map(|k| factor[3 * k + r] * Constraints::new(mu, &g).cone_gradient[k]).sum();
            assert!((image - [gradient[0], gradient[1], 0.0][r]).abs() < 1e-13);
        }
        let h = 1e-6;
        for c in 0..3 {
            let (mut plus, mut minus) = (g, g);
            plus[c] += h;
            minus[c] -= h;
            let (plus, minus) = (push(plus), push(minus));
            for r in 0..3 {
                let difference = (plus[r] - minus[r]) / (2.0 * h);
                assert!((block[3 * r + c] - difference).abs() < 1e-7, "({r}, {c}): {difference}");
            }
        }
        // Gradients and values of the constraints themselves.
        let constraints = Constraints::new(mu, &g);
        for c in 0..3 {
            let (mut plus, mut minus) = (g, g);
            plus[c] += h;
            minus[c] -= h;
            let (plus, minus) = (Constraints::new(mu, &plus), Constraints::new(mu, &minus));
            let cone = (plus.f[0] - minus.f[0]) / (2.0 * h);
            assert!((constraints.cone_gradient[c] - cone).abs() < 1e-8);
        }
        assert!((constraints.f[0] - 0.5 * (0.04 + 0.09 - 0.16 * 1.69)).abs() < 1e-15);
    }
}
