//! The friction cone Y = { (g_n, g_1, g_2) : |(g_1, g_2)| <= mu g_n }.

/// Coulomb friction cone with coefficient mu >= 0; components are (normal, tangent 1, tangent 2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrictionCone {
    /// Coefficient of friction, dimensionless. Zero gives the half line g_n >= 0, g_t = 0.
    pub mu: f64,
}

/// |x_t| of a contact's vector (normal, tangent 1, tangent 2).
#[inline]
pub fn tangential_length(x: [f64; 3]) -> f64 {
    let square = x[1] * x[1] + x[2] * x[2];
    // hypot is slow, and needed only where the square leaves the range of the floats.
    if (1e-290..1e290).contains(&square) { square.sqrt() } else { x[1].hypot(x[2]) }
}

impl FrictionCone {
    /// Euclidean projection P_Y(x).
    ///
    /// Inside the cone x itself; inside the polar cone (mu |x_t| <= -x_n) the apex; else the nearest point of the
    /// mantle, g_n = (x_n + mu |x_t|) / (1 + mu^2), g_t = mu g_n x_t / |x_t|  (Tasora and Anitescu 2011).
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }

    proptest! {
        /// Moreau: x = P_Y(x) + P_Y°(x) with the two parts orthogonal, P_Y(x) in Y and the rest in the polar cone.
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
