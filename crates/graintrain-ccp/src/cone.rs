//! The friction cone Y = { (g_n, g_1, g_2) : |(g_1, g_2)| <= mu g_n }, and the one of contacts that resist
//! turning.

use graintrain_linalg::real;

/// Coulomb friction cone with coefficient mu >= 0; components are (normal, tangent 1, tangent 2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrictionCone {
    /// Coefficient of friction, dimensionless. Zero gives the half line g_n >= 0, g_t = 0.
    pub mu: f64,
}

/// |x_t| of a contact's vector (normal, tangent 1, tangent 2).
#[inline]
pub fn tangential_length(x: [f64; 3]) -> f64 {
    real::hypot(x[1], x[2])
}

impl FrictionCone {
    /// Euclidean projection P_Y(x).
    ///
    /// Inside the cone x itself; inside the polar cone (mu |x_t| <= -x_n) the apex; else the nearest point of
    /// the mantle, g_n = (x_n + mu |x_t|) / (1 + mu^2), g_t = mu g_n x_t / |x_t| (Tasora and Anitescu 2011).
    #[inline]
    pub fn project(self, x: [f64; 3]) -> [f64; 3] {
        let mu = self.mu;
        let tangential = tangential_length(x);
        // The apex first: for mu = 0 and x_t = 0 both comparisons hold, whatever the sign of x_n.
        if mu * tangential <= -x[0] {
            return [0.0; 3];
        }
        if tangential <= mu * x[0] {
            return x;
        }
        let normal = (x[0] + mu * tangential) / (1.0 + mu * mu);
        let scale = mu * normal / tangential;
        [normal, scale * x[1], scale * x[2]]
    }
}

/// Friction cone of a contact that resists turning: sliding, rolling and spinning friction share one normal
/// impulse,
///
/// ```text
/// Y  = { (g, h) : |(g_1, g_2)| <= mu g_n,  |(h_1, h_2)| <= rolling g_n,  |h_n| <= spinning g_n }
/// Y* = { (u, w) : u_n >= mu |(u_1, u_2)| + rolling |(w_1, w_2)| + spinning |w_n| }
/// ```
///
/// with h = (h_n, h_1, h_2) the moment about the normal and the two tangents over a length, N s, and w the
/// turning velocity times that length, m/s. Source: V. Acary, F. Bourrier, "Coulomb friction with rolling
/// resistance as a cone complementarity problem", European Journal of Mechanics A/Solids 85:104046, 2021,
/// where the third disc is absent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurningCone {
    /// Coefficient of friction, dimensionless.
    pub mu: f64,
    /// Coefficient of rolling friction over the length of the rows, dimensionless.
    pub rolling: f64,
    /// Coefficient of spinning friction over the length of the rows, dimensionless.
    pub spinning: f64,
}

impl TurningCone {
    /// Euclidean projection of (g, h).
    ///
    /// With a = (|g_t|, |(h_1, h_2)|, |h_n|) and m = (mu, rolling, spinning) the nearest point has the normal
    /// impulse s >= 0 where s - g_n - sum_k m_k max(0, a_k - m_k s) = 0. The left side is the least over all
    /// subsets A of the three of growing lines with the roots s_A = (g_n + sum_A m_k a_k) / (1 + sum_A
    /// m_k^2), so that its own root is the largest of these eight: no search, no order. Then every part is
    /// shortened to m_k s where it is longer.
    pub fn project(self, g: [f64; 3], h: [f64; 3]) -> [[f64; 3]; 2] {
        let coefficient = [self.mu, self.rolling, self.spinning];
        let length = [real::hypot(g[1], g[2]), real::hypot(h[1], h[2]), h[0].abs()];
        if g[0].is_nan() {
            return [[f64::NAN; 3]; 2];
        }
        let mut normal = g[0].max(0.0);
        for subset in 1..8_u32 {
            let (mut above, mut below) = (g[0], 1.0);
            for k in (0..3).filter(|k| subset >> k & 1 == 1) {
                above += coefficient[k] * length[k];
                below += coefficient[k] * coefficient[k];
            }
            normal = normal.max(above / below);
        }
        let factor: [f64; 3] = std::array::from_fn(|k| {
            let bound = coefficient[k] * normal;
            if length[k] <= bound { 1.0 } else { bound / length[k] }
        });
        [[normal, factor[0] * g[1], factor[0] * g[2]], [factor[2] * h[0], factor[1] * h[1], factor[1] * h[2]]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The nearest point by bisection of the normal impulse: the distance is convex in it, and its slope is
    /// written out.
    fn by_bisection(cone: TurningCone, g: [f64; 3], h: [f64; 3]) -> f64 {
        let parts =
            [(cone.mu, g[1].hypot(g[2])), (cone.rolling, h[1].hypot(h[2])), (cone.spinning, h[0].abs())];
        let slope = |s: f64| s - g[0] - parts.iter().map(|(m, a)| m * (a - m * s).max(0.0)).sum::<f64>();
        if slope(0.0) >= 0.0 {
            return 0.0;
        }
        let (mut low, mut high) = (0.0, 1e3);
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if slope(middle) < 0.0 { low = middle } else { high = middle }
        }
        low
    }

    proptest! {
        /// Moreau for the cone with turning: two parts at right angles, one in the cone and one in its polar;
        /// the normal impulse is the one that a bisection finds; without turning it is the friction cone.
        #[test]
        fn projection_with_turning_satisfies_moreau(
            g in prop::array::uniform3(-10.0..10.0_f64),
            h in prop::array::uniform3(-10.0..10.0_f64),
            coefficient in prop::array::uniform3(prop_oneof![Just(0.0), 0.0..2.0_f64]),
        ) {
            let [mu, rolling, spinning] = coefficient;
            let cone = TurningCone { mu, rolling, spinning };
            let [p, q] = cone.project(g, h);
            let difference = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
            let (pu, qu) = (difference(g, p), difference(h, q));
            prop_assert!((dot(p, pu) + dot(q, qu)).abs() < 1e-12 * (1.0 + dot(g, g) + dot(h, h)));
            prop_assert!(p[1].hypot(p[2]) <= mu * p[0] + 1e-12);
            prop_assert!(q[1].hypot(q[2]) <= rolling * p[0] + 1e-12);
            prop_assert!(q[0].abs() <= spinning * p[0] + 1e-12);
            let dual = mu * pu[1].hypot(pu[2]) + rolling * qu[1].hypot(qu[2]) + spinning * qu[0].abs();
            prop_assert!(dual <= -pu[0] + 1e-11);
            prop_assert!((p[0] - by_bisection(cone, g, h)).abs() < 1e-11);
            let [plain, still] = TurningCone { mu, rolling: 0.0, spinning: 0.0 }.project(g, h);
            prop_assert_eq!(still, [0.0; 3]);
            for (a, b) in plain.into_iter().zip(FrictionCone { mu }.project(g)) {
                prop_assert!((a - b).abs() < 1e-13);
            }
        }
    }

    fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }

    proptest! {
        /// Moreau: x = P_Y(x) + P_Y°(x) with the two parts orthogonal, P_Y(x) in Y and the rest in the polar
        /// cone.
        #[test]
        fn projection_satisfies_moreau(x in prop::array::uniform3(-10.0..10.0_f64), mu in 0.0..2.0_f64) {
            let p = FrictionCone { mu }.project(x);
            let q = [x[0] - p[0], x[1] - p[1], x[2] - p[2]];
            prop_assert!(dot(p, q).abs() < 1e-12 * (1.0 + dot(x, x)));
            prop_assert!(p[1].hypot(p[2]) <= mu * p[0] + 1e-12);
            prop_assert!(mu * q[1].hypot(q[2]) <= -q[0] + 1e-12);
        }

        /// The projection commutes with powers of two.
        #[test]
        fn projection_of_very_large_and_small_vectors(
            x in prop::array::uniform3(-10.0..10.0_f64),
            mu in 0.0..2.0_f64,
            power in -900..900_i32,
        ) {
            let (cone, unit) = (FrictionCone { mu }, f64::from(power).exp2());
            let (expected, found) = (cone.project(x), cone.project(x.map(|x| x * unit)));
            for k in 0..3 {
                prop_assert!((found[k] / unit - expected[k]).abs() <= 1e-13, "{found:?} {expected:?}");
            }
        }

        #[test]
        fn without_friction_the_cone_is_a_half_line(
            normal in -10.0..10.0_f64,
            tangential in prop::array::uniform2(prop_oneof![Just(0.0), -10.0..10.0_f64]),
        ) {
            let p = FrictionCone { mu: 0.0 }.project([normal, tangential[0], tangential[1]]);
            prop_assert_eq!(p, [normal.max(0.0), 0.0, 0.0]);
        }

        #[test]
        fn projection_is_idempotent_and_nonexpansive(
            x in prop::array::uniform3(-10.0..10.0_f64),
            y in prop::array::uniform3(-10.0..10.0_f64),
            mu in 0.0..2.0_f64,
        ) {
            let cone = FrictionCone { mu };
            let (p, q) = (cone.project(x), cone.project(y));
            let pp = cone.project(p);
            let difference = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
            let again = difference(p, pp);
            prop_assert!(dot(again, again).sqrt() < 1e-12);
            let (before, after) = (difference(x, y), difference(p, q));
            prop_assert!(dot(after, after) <= dot(before, before) * (1.0 + 1e-12) + 1e-24);
        }
    }
}
