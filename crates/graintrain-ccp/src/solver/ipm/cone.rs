//! One second-order cone of dimension 3 inside the interior point: points, Nesterov-Todd scaling, step
//! lengths.
//!
//! Points are kept as (gap, tangent) with gap = x_0 - |x_t|. Near the boundary, where x_0 and |x_t| agree in
//! most digits, the gap keeps its own: det x = gap (gap + 2 |x_t|) is exact to rounding, and so are the
//! scaling and the scaled variable, whatever the distance from the boundary.

use graintrain_linalg::real;

/// A point of the interior of { |x_t| <= x_0 }.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Point {
    /// x_0 - |x_t| > 0.
    pub gap: f64,
    /// x_t.
    pub tangent: [f64; 2],
}

fn norm(t: [f64; 2]) -> f64 {
    (t[0] * t[0] + t[1] * t[1]).sqrt()
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

impl Point {
    pub fn vector(&self) -> [f64; 3] {
        [self.gap + norm(self.tangent), self.tangent[0], self.tangent[1]]
    }

    /// det x = x_0^2 - |x_t|^2, without cancellation.
    pub fn determinant(&self) -> f64 {
        self.gap * (self.gap + 2.0 * norm(self.tangent))
    }

    /// Inner product x^T s of two points, without cancellation.
    pub fn dot(&self, other: &Self) -> f64 {
        let (a, b) = (norm(self.tangent), norm(other.tangent));
        // |x_t| |s_t| + x_t . s_t = |x_t| |s_t| |e_x + e_s|^2 / 2 with unit vectors e.
        let aligned = if a > 0.0 && b > 0.0 {
            let sum =
                [self.tangent[0] / a + other.tangent[0] / b, self.tangent[1] / a + other.tangent[1] / b];
            0.5 * a * b * dot(sum, sum)
        } else {
            0.0
        };
        self.gap * other.gap + self.gap * b + other.gap * a + aligned
    }

    /// x + alpha d. The change of |x_t| is taken as a difference of squares, so that the gap loses no digits.
    pub fn advance(&self, alpha: f64, d: [f64; 3]) -> Self {
        let old = norm(self.tangent);
        let tangent = [self.tangent[0] + alpha * d[1], self.tangent[1] + alpha * d[2]];
        let new = norm(tangent);
        let squares = alpha * (2.0 * dot(self.tangent, [d[1], d[2]]) + alpha * (d[1] * d[1] + d[2] * d[2]));
        let growth = if old + new > 0.0 { squares / (old + new) } else { 0.0 };
        let gap = self.gap + alpha * d[0] - growth;
        // The step length keeps the point inside; rounding must not take it out.
        Self { gap: gap.max(1e-6 * self.gap), tangent }
    }

    /// The pair x, s with x - s = z and x o s = mu e: the projection of z on the cone, smoothed.
    pub fn smoothed_pair(z: [f64; 3], mu: f64) -> (Self, Self) {
        let length = (z[1] * z[1] + z[2] * z[2]).sqrt();
        // (l + sqrt(l^2 + 4 mu)) / 2 without cancellation for negative l.
        let smooth = |l: f64| {
            let root = (l * l + 4.0 * mu).sqrt();
            if l >= 0.0 { 0.5 * (l + root) } else { 2.0 * mu / (root - l) }
        };
        let (low, high) = (smooth(z[0] - length), smooth(z[0] + length));
        let (dual_low, dual_high) = (mu / high, mu / low);
        let unit = if length > 0.0 { [z[1] / length, z[2] / length] } else { [0.0; 2] };
        let (half, dual_half) = (0.5 * (high - low), 0.5 * (dual_high - dual_low));
        (
            Self { gap: low, tangent: [half * unit[0], half * unit[1]] },
            Self { gap: dual_low, tangent: [-dual_half * unit[0], -dual_half * unit[1]] },
        )
    }
}

/// Nesterov-Todd scaling of a pair x, s: the symmetric W with W s = W^-1 x = lambda,
///
/// ```text
/// W = eta [ w_0  w_t^T ; w_t  I + w_t w_t^T / (1 + w_0) ],   w = (x' + J s') / (2 gamma),   gamma^2 = (1 + x'^T s') / 2
/// ```
///
/// with x' = x / sqrt(det x), s' likewise, eta = (det x / det s)^(1/4) (Nesterov, Todd 1997; Vandenberghe
/// 2010).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scaling {
    eta: f64,
    w: [f64; 3],
    /// lambda.
    pub lambda: [f64; 3],
    /// det lambda = sqrt(det x det s).
    determinant: f64,
}

impl Scaling {
    pub fn new(x: &Point, s: &Point) -> Self {
        let (det_x, det_s) = (x.determinant(), s.determinant());
        let determinant = (det_x * det_s).sqrt();
        let (root_x, root_s) = (det_x.sqrt(), det_s.sqrt());
        let gamma = (0.5 * (1.0 + x.dot(s) / determinant)).sqrt();
        let (xv, sv) = (x.vector().map(|c| c / root_x), s.vector().map(|c| c / root_s));
        let t = [(xv[1] - sv[1]) / (2.0 * gamma), (xv[2] - sv[2]) / (2.0 * gamma)];
        let w = [(1.0 + dot(t, t)).sqrt(), t[0], t[1]];
        let size = determinant.sqrt();
        let total = xv[0] + sv[0] + 2.0 * gamma;
        let mix = |k: usize| size * ((gamma + sv[0]) * xv[k] + (gamma + xv[0]) * sv[k]) / total;
        let lambda = [size * gamma, mix(1), mix(2)];
        Self { eta: (root_x / root_s).sqrt(), w, lambda, determinant }
    }

    /// W v, or W^-1 v with the sign of w_t turned and 1 / eta.
    fn apply(&self, v: [f64; 3], sign: f64, eta: f64) -> [f64; 3] {
        let t = [sign * self.w[1], sign * self.w[2]];
        let along = dot(t, [v[1], v[2]]);
        let push = v[0] + along / (1.0 + self.w[0]);
        [eta * (self.w[0] * v[0] + along), eta * (v[1] + push * t[0]), eta * (v[2] + push * t[1])]
    }

    /// W v.
    #[cfg(test)]
    pub fn times(&self, v: [f64; 3]) -> [f64; 3] {
        self.apply(v, 1.0, self.eta)
    }

    /// W^-1 v.
    pub fn inverse_times(&self, v: [f64; 3]) -> [f64; 3] {
        self.apply(v, -1.0, 1.0 / self.eta)
    }

    /// f(W^-2) for a function of its eigenvalues (w_0 + |w_t|)^2, 1 and (w_0 + |w_t|)^-2 (times eta^-2),
    /// whose eigenvectors are (1, -e), (0, e') and (1, e) with e = w_t / |w_t| and e' across: no differences.
    pub fn function(&self, f: impl Fn(f64) -> f64) -> [f64; 9] {
        let length = real::hypot(self.w[1], self.w[2]);
        let e = if length > 0.0 { [self.w[1] / length, self.w[2] / length] } else { [1.0, 0.0] };
        let spread = (self.w[0] + length).powi(2);
        let scale = 1.0 / (self.eta * self.eta);
        let [high, middle, low] = [scale * spread, scale, scale / spread].map(f);
        let (mean, half) = (0.5 * (high + low), 0.5 * (low - high));
        let (a, b) = (half * e[0], half * e[1]);
        let across = [e[1], -e[0]];
        let tangential = |i: usize, j: usize| mean * e[i] * e[j] + middle * across[i] * across[j];
        let mixed = tangential(0, 1);
        [mean, a, b, a, tangential(0, 0), mixed, b, mixed, tangential(1, 1)]
    }

    /// q with lambda o q = d.
    pub fn divide(&self, d: [f64; 3]) -> [f64; 3] {
        let l = self.lambda;
        let q = (l[0] * d[0] - l[1] * d[1] - l[2] * d[2]) / self.determinant;
        [q, (d[1] - q * l[1]) / l[0], (d[2] - q * l[2]) / l[0]]
    }

    /// Largest alpha with lambda + alpha d in the cone, for a scaled direction d (W^-1 dx or W ds).
    pub fn longest_step(&self, d: [f64; 3]) -> f64 {
        let l = self.lambda;
        let a = d[0] * d[0] - d[1] * d[1] - d[2] * d[2];
        let b = l[0] * d[0] - l[1] * d[1] - l[2] * d[2];
        let discriminant = b * b - a * self.determinant;
        if a >= 0.0 && (b >= 0.0 || discriminant < 0.0) {
            return f64::INFINITY;
        }
        self.determinant / (discriminant.max(0.0).sqrt() - b)
    }
}

/// Jordan product a o b = (a^T b, a_0 b_t + b_0 a_t).
pub(crate) fn product(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] * b[0] + a[1] * b[1] + a[2] * b[2], a[0] * b[1] + b[0] * a[1], a[0] * b[2] + b[0] * a[2]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use graintrain_linalg::block_ops::apply3;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Point> {
        (-12.0..2.0_f64, prop::array::uniform2(-2.0..2.0_f64))
            .prop_map(|(gap, tangent)| Point { gap: 10.0_f64.powf(gap), tangent })
    }

    fn close(a: [f64; 3], b: [f64; 3], tolerance: f64) -> bool {
        let size = a.iter().chain(&b).fold(0.0_f64, |m, x| m.max(x.abs()));
        (0..3).all(|k| (a[k] - b[k]).abs() <= tolerance * size)
    }

    proptest! {
        /// W s = W^-1 x = lambda, also for points 1e-12 from the boundary; W^-1 and the squares belong to W.
        #[test]
        fn scaling_maps_both_points_to_lambda(x in point(), s in point(), v in prop::array::uniform3(-1.0..1.0_f64)) {
            let w = Scaling::new(&x, &s);
            // W may be as large as 1 / gap: errors grow with it.
            let spread = w.w[0] * w.w[0];
            prop_assert!(close(w.times(s.vector()), w.lambda, 1e-14 * spread));
            prop_assert!(close(w.inverse_times(x.vector()), w.lambda, 1e-14 * spread));
            prop_assert!(close(w.inverse_times(w.times(v)), v, 1e-14 * spread * spread));
            for (f, twice) in [
                (f64::recip as fn(f64) -> f64, w.times(w.times(v))),
                (|e| e, w.inverse_times(w.inverse_times(v))),
                (f64::sqrt, w.inverse_times(v)),
            ] {
                prop_assert!(close(apply3(&w.function(f), v), twice, 1e-13 * spread));
            }
            let l = w.lambda;
            prop_assert!((product(l, l)[0] - x.dot(&s)).abs() <= 1e-14 * spread * x.dot(&s));
            // lambda itself is known to spread roundings; dividing by it multiplies them by lambda_0^2 / det
            // lambda.
            prop_assert!(close(product(l, w.divide(v)), v, 1e-14 * spread * l[0] * l[0] / w.determinant));
        }

        /// The step length ends on the boundary: half of it stays inside, a little more leaves.
        #[test]
        fn the_longest_step_ends_on_the_boundary(x in point(), s in point(), d in prop::array::uniform3(-1.0..1.0_f64)) {
            prop_assume!(x.gap > 1e-10 && s.gap > 1e-10);
            let w = Scaling::new(&x, &s);
            let alpha = w.longest_step(d);
            let margin = |alpha: f64| {
                let p: [f64; 3] = std::array::from_fn(|k| w.lambda[k] + alpha * d[k]);
                let size = w.lambda[0] + alpha * d.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
                (p[0] - p[1].hypot(p[2])) / size
            };
            if alpha.is_finite() {
                // lambda and its determinant agree to the roundings of W, about spread.
                let rounding = 1e-14 * w.w[0] * w.w[0];
                prop_assert!(margin(0.5 * alpha) > -rounding);
                prop_assert!(margin(1.01 * alpha) < 1e-12 + rounding);
            } else {
                prop_assert!(margin(1e3) > 0.0);
            }
        }

        #[test]
        fn smoothed_pairs_are_centred_and_differ_by_z(z in prop::array::uniform3(-5.0..5.0_f64), mu in 1e-10..1.0_f64) {
            let (x, s) = Point::smoothed_pair(z, mu);
            let (xv, sv) = (x.vector(), s.vector());
            prop_assert!((0..3).all(|k| (xv[k] - sv[k] - z[k]).abs() < 1e-13));
            prop_assert!((x.dot(&s) - mu).abs() < 1e-12 * mu.max(1e-3));
            prop_assert!(x.gap > 0.0 && s.gap > 0.0);
        }

        /// A step that shrinks the gap to a tiny one keeps its digits.
        #[test]
        fn advancing_agrees_with_extended_precision(x in point(), d in prop::array::uniform3(-1.0..1.0_f64)) {
            let alpha = 0.3 * x.gap;
            let moved = x.advance(alpha, d);
            let old = norm(x.tangent);
            let exact_growth = {
                let t = [x.tangent[0] + alpha * d[1], x.tangent[1] + alpha * d[2]];
                norm(t) - old
            };
            let expected = x.gap + alpha * d[0] - exact_growth;
            prop_assert!((moved.gap - expected.max(1e-6 * x.gap)).abs() < 1e-12 * x.gap + 1e-15 * (1.0 + old));
        }
    }
}
