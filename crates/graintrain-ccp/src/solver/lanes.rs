//! Four contacts at a time: the arithmetic of the first-order methods, laid out so that the compiler vectorises it.

use std::ops::{Add, AddAssign, Mul, Neg, Sub};

/// Contacts per batch.
pub const LANES: usize = 4;

/// One number of each of four contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
pub struct Lanes(pub [f64; LANES]);

/// Three components (normal, tangent 1, tangent 2) of four contacts.
pub type Batch = [Lanes; 3];

/// A batch of zeros.
pub const ZERO: Batch = [Lanes([0.0; LANES]); 3];

impl Lanes {
    /// The same number four times.
    #[inline(always)]
    pub fn splat(x: f64) -> Self {
        Self([x; LANES])
    }

    /// f(a_l, b_l) lane by lane.
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self(std::array::from_fn(|l| f(self.0[l], other.0[l])))
    }

    /// Square roots.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self(self.0.map(f64::sqrt))
    }

    /// The larger of each pair; the second one where the first is NaN.
    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    /// The smaller of each pair; the second one where the first is NaN.
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    /// Quotients.
    #[inline(always)]
    pub fn divide(self, other: Self) -> Self {
        self.zip(other, |a, b| a / b)
    }

    /// `yes` where `self <= bound`, else `no`.
    #[inline(always)]
    pub fn at_most(self, bound: Self, yes: Self, no: Self) -> Self {
        Self(std::array::from_fn(|l| if self.0[l] <= bound.0[l] { yes.0[l] } else { no.0[l] }))
    }

    /// Sum of the lanes, in a fixed order.
    #[inline(always)]
    pub fn sum(self) -> f64 {
        (self.0[0] + self.0[1]) + (self.0[2] + self.0[3])
    }

    /// Largest lane; NaN if there is one.
    pub fn largest(self) -> f64 {
        self.0.into_iter().fold(0.0, |m, x| if x.is_nan() || x > m { x } else { m })
    }
}

impl Add for Lanes {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Lanes {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl Mul for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl Neg for Lanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}

/// a + b.
#[inline(always)]
pub fn add(a: &Batch, b: &Batch) -> Batch {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// a - b.
#[inline(always)]
pub fn sub(a: &Batch, b: &Batch) -> Batch {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// a + s b.
#[inline(always)]
pub fn add_scaled(a: &Batch, s: f64, b: &Batch) -> Batch {
    let s = Lanes::splat(s);
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

/// s a, with one factor per contact.
#[inline(always)]
pub fn scale(s: Lanes, a: &Batch) -> Batch {
    [s * a[0], s * a[1], s * a[2]]
}

/// Dot product per contact.
#[inline(always)]
pub fn dot(a: &Batch, b: &Batch) -> Lanes {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cross product per contact.
#[inline(always)]
pub fn cross(a: &Batch, b: &Batch) -> Batch {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Projection of four points on their friction cones: [`FrictionCone::project`](crate::cone::FrictionCone::project)
/// without branches.
#[inline(always)]
pub fn project(mu: Lanes, x: &Batch) -> Batch {
    let tangential = (x[1] * x[1] + x[2] * x[2]).sqrt();
    // normal = q |x_t| and factor = mu q with one division; |x_t| is zero or at least 1e-162, so that q is finite.
    let size = (Lanes::splat(1.0) + mu * mu) * tangential;
    let q = (x[0] + mu * tangential).divide(size.max(Lanes::splat(f64::MIN_POSITIVE))).max(Lanes::splat(0.0));
    let (normal, factor) = (q * tangential, mu * q);
    let bound = mu * x[0];
    [
        // With mu = 0 and x_t = 0 a negative x_n passes for a point inside.
        tangential.at_most(bound, x[0].max(Lanes::splat(0.0)), normal),
        tangential.at_most(bound, x[1], factor * x[1]),
        tangential.at_most(bound, x[2], factor * x[2]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cone::FrictionCone;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn projects_like_the_scalar_cone(
            x in prop::array::uniform12(-3.0..3.0_f64),
            mu in prop::array::uniform4(0.0..2.0_f64),
            flat in 0_usize..4,
        ) {
            let mut x = x;
            x[LANES + flat] = 0.0;
            x[2 * LANES + flat] = 0.0;
            let batch: Batch = std::array::from_fn(|k| Lanes(std::array::from_fn(|l| x[k * LANES + l])));
            let image = project(Lanes(mu), &batch);
            for l in 0..LANES {
                let expected = FrictionCone { mu: mu[l] }.project(std::array::from_fn(|k| batch[k].0[l]));
                for k in 0..3 {
                    prop_assert!((image[k].0[l] - expected[k]).abs() < 1e-14);
                }
            }
        }
    }
}
