//! Four contacts at a time: the arithmetic of the first-order methods.

use super::octet::{Octet, SingleVector};
use std::ops::{Add, AddAssign, Mul, Neg, Sub};

/// Contacts per batch.
pub const LANES: usize = 4;

/// One number of each of four contacts, as it lies in memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(32))]
pub struct Lanes(pub [f64; LANES]);

/// Three components (normal, tangent 1, tangent 2) of four contacts.
pub type Batch<V = Lanes> = [V; 3];

/// A batch of zeros.
pub const ZERO: Batch = [Lanes([0.0; LANES]); 3];

/// Numbers that an operation treats together, one of each of several contacts.
pub trait Numbers:
    Copy + Default + Add<Output = Self> + AddAssign + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// The least positive normal number.
    const TINY: f64;

    /// The same number for every contact, rounded to the precision of these.
    fn splat(x: f64) -> Self;

    /// Square roots.
    fn sqrt(self) -> Self;

    /// The larger of each pair; the second one where one is NaN.
    fn max(self, other: Self) -> Self;

    /// The smaller of each pair; the second one where one is NaN.
    fn min(self, other: Self) -> Self;

    /// Quotients.
    fn divide(self, other: Self) -> Self;

    /// `yes` where `self <= bound`, else `no`.
    fn at_most(self, bound: Self, yes: Self, no: Self) -> Self;
}

/// Four numbers in double precision: [`Lanes`] on any processor, a vector register where it has AVX2 (module
/// `avx2`). Both give the same bits: there is no fused multiply-add.
pub trait Vector: Numbers {
    /// Eight numbers in single precision on the same processor.
    type Single: SingleVector;

    /// These numbers.
    fn of(lanes: Lanes) -> Self;

    /// The numbers.
    fn lanes(self) -> Lanes;

    /// Numbers in memory, to change in place.
    fn of_slice(lanes: &mut [Lanes]) -> &mut [Self];

    /// Number K, four times.
    fn broadcast<const K: i32>(self) -> Self;

    /// Whether every number is at most its bound.
    fn all_at_most(self, bound: Self) -> bool;

    /// Asks for a datum that will be read soon.
    fn prefetch<T>(datum: &T);

    /// From four records to the first three components of all of them: number l of component k is number k of
    /// record l.
    fn components(records: [Self; LANES]) -> Batch<Self>;

    /// The way back; the fourth number of each record is zero.
    fn records(components: &Batch<Self>) -> [Self; LANES];
}

impl Lanes {
    /// f(a_l, b_l) lane by lane.
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self(std::array::from_fn(|l| f(self.0[l], other.0[l])))
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

/// [`Numbers`] of an array, one by one.
macro_rules! numbers_one_by_one {
    ($array:ident, $number:ty, $count:expr) => {
        impl Numbers for $array {
            const TINY: f64 = <$number>::MIN_POSITIVE as f64;

            #[inline(always)]
            fn splat(x: f64) -> Self {
                Self([x as $number; $count])
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                Self(self.0.map(<$number>::sqrt))
            }

            #[inline(always)]
            fn max(self, other: Self) -> Self {
                self.zip(other, |a, b| if a > b { a } else { b })
            }

            #[inline(always)]
            fn min(self, other: Self) -> Self {
                self.zip(other, |a, b| if a < b { a } else { b })
            }

            #[inline(always)]
            fn divide(self, other: Self) -> Self {
                self.zip(other, |a, b| a / b)
            }

            #[inline(always)]
            fn at_most(self, bound: Self, yes: Self, no: Self) -> Self {
                Self(std::array::from_fn(|l| if self.0[l] <= bound.0[l] { yes.0[l] } else { no.0[l] }))
            }
        }
    };
}

pub(super) use numbers_one_by_one;

numbers_one_by_one!(Lanes, f64, LANES);

impl Vector for Lanes {
    type Single = Octet;

    #[inline(always)]
    fn of(lanes: Lanes) -> Self {
        lanes
    }

    #[inline(always)]
    fn lanes(self) -> Lanes {
        self
    }

    #[inline(always)]
    fn of_slice(lanes: &mut [Lanes]) -> &mut [Self] {
        lanes
    }

    #[inline(always)]
    fn broadcast<const K: i32>(self) -> Self {
        Self([self.0[K as usize]; LANES])
    }

    #[inline(always)]
    fn all_at_most(self, bound: Self) -> bool {
        (0..LANES).all(|l| self.0[l] <= bound.0[l])
    }

    #[inline(always)]
    fn prefetch<T>(_: &T) {}

    #[inline(always)]
    fn components(records: [Self; LANES]) -> Batch<Self> {
        std::array::from_fn(|k| Self(std::array::from_fn(|l| records[l].0[k])))
    }

    #[inline(always)]
    fn records(components: &Batch<Self>) -> [Self; LANES] {
        std::array::from_fn(|l| Self([components[0].0[l], components[1].0[l], components[2].0[l], 0.0]))
    }
}

/// `+`, `+=`, `-`, `*` and unary `-`, lane by lane, of a type that wraps an array of numbers and has `zip`.
macro_rules! lane_operators {
    ($lanes:ty) => {
        impl std::ops::Add for $lanes {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                self.zip(other, |a, b| a + b)
            }
        }

        impl std::ops::AddAssign for $lanes {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }

        impl std::ops::Sub for $lanes {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                self.zip(other, |a, b| a - b)
            }
        }

        impl std::ops::Mul for $lanes {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                self.zip(other, |a, b| a * b)
            }
        }

        impl std::ops::Neg for $lanes {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self(self.0.map(|x| -x))
            }
        }
    };
}
pub(super) use lane_operators;

lane_operators!(Lanes);

/// Zeros.
#[inline(always)]
pub fn zero<V: Numbers>() -> Batch<V> {
    [V::default(); 3]
}

/// A batch from memory.
#[inline(always)]
pub fn load<V: Vector>(a: &Batch) -> Batch<V> {
    [V::of(a[0]), V::of(a[1]), V::of(a[2])]
}

/// A batch for memory.
#[inline(always)]
pub fn store<V: Vector>(a: &Batch<V>) -> Batch {
    [a[0].lanes(), a[1].lanes(), a[2].lanes()]
}

/// Batches in memory, to change in place.
#[inline(always)]
pub fn in_place<V: Vector>(vector: &mut [Batch]) -> &mut [Batch<V>] {
    V::of_slice(vector.as_flattened_mut()).as_chunks_mut().0
}

/// a + b.
#[inline(always)]
pub fn add<V: Numbers>(a: &Batch<V>, b: &Batch<V>) -> Batch<V> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// a - b.
#[inline(always)]
pub fn sub<V: Numbers>(a: &Batch<V>, b: &Batch<V>) -> Batch<V> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// a + s b.
#[inline(always)]
pub fn add_scaled<V: Numbers>(a: &Batch<V>, s: f64, b: &Batch<V>) -> Batch<V> {
    let s = V::splat(s);
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

/// s a, with one factor per contact.
#[inline(always)]
pub fn scale<V: Numbers>(s: V, a: &Batch<V>) -> Batch<V> {
    [s * a[0], s * a[1], s * a[2]]
}

/// Dot product per contact.
#[inline(always)]
pub fn dot<V: Numbers>(a: &Batch<V>, b: &Batch<V>) -> V {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cross product per contact.
#[inline(always)]
pub fn cross<V: Numbers>(a: &Batch<V>, b: &Batch<V>) -> Batch<V> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Projection of four points on their friction cones:
/// [`FrictionCone::project`](crate::cone::FrictionCone::project) without branches.
#[inline(always)]
pub fn project<V: Numbers>(mu: V, x: &Batch<V>) -> Batch<V> {
    project_given(mu, x, tangential_length(x))
}

/// |x_t| per contact: the root of a projection.
#[inline(always)]
pub fn tangential_length<V: Numbers>(x: &Batch<V>) -> V {
    (x[1] * x[1] + x[2] * x[2]).sqrt()
}

/// [`project`] where |x_t| is known.
#[inline(always)]
pub fn project_given<V: Numbers>(mu: V, x: &Batch<V>, tangential: V) -> Batch<V> {
    // normal = q |x_t| and factor = mu q with one division; |x_t| is zero or at least 1e-162 (in single
    // precision 1e-23), so that q is finite.
    let size = (V::splat(1.0) + mu * mu) * tangential;
    let q = (x[0] + mu * tangential).divide(size.max(V::splat(V::TINY))).max(V::splat(0.0));
    let (normal, factor) = (q * tangential, mu * q);
    let bound = mu * x[0];
    [
        // With mu = 0 and x_t = 0 a negative x_n passes for a point inside.
        tangential.at_most(bound, x[0].max(V::splat(0.0)), normal),
        tangential.at_most(bound, x[1], factor * x[1]),
        tangential.at_most(bound, x[2], factor * x[2]),
    ]
}

/// The impulse of exact Coulomb friction nearest to x in the sense of Moreau and Jean: the normal component
/// first, then the tangential one projected on the disc that it allows; |x_t| is known.
///
/// ```text
/// n = max(0, x_n),   t = x_t min(1, mu n / |x_t|)
/// ```
#[inline(always)]
pub fn within_disc<V: Numbers>(mu: V, x: &Batch<V>, tangential: V) -> Batch<V> {
    let normal = x[0].max(V::splat(0.0));
    let bound = mu * normal;
    let factor = tangential.at_most(bound, V::splat(1.0), bound.divide(tangential.max(V::splat(V::TINY))));
    [normal, factor * x[1], factor * x[2]]
}

/// Lengths of the parts of an impulse that share a normal component: sliding, rolling, spinning.
#[inline(always)]
fn lengths<V: Numbers>(x: &Batch<V>, turning: &Batch<V>) -> [V; 3] {
    [tangential_length(x), tangential_length(turning), turning[0].max(-turning[0])]
}

/// The parts of four impulses whose normal components are given, each shortened to its coefficient times that
/// where it is longer.
#[inline(always)]
fn shortened<V: Numbers>(
    coefficient: [V; 3],
    normal: V,
    x: &Batch<V>,
    turning: &Batch<V>,
    length: [V; 3],
) -> [Batch<V>; 2] {
    let mut factor = [V::splat(1.0); 3];
    for k in 0..3 {
        let bound = coefficient[k] * normal;
        let shorter = bound.divide(length[k].max(V::splat(V::TINY)));
        factor[k] = length[k].at_most(bound, factor[k], shorter);
    }
    [
        [normal, factor[0] * x[1], factor[0] * x[2]],
        [factor[2] * turning[0], factor[1] * turning[1], factor[1] * turning[2]],
    ]
}

/// Projection of four points on cones with coefficients of sliding, rolling and spinning:
/// [`TurningCone::project`](crate::cone::TurningCone::project).
#[inline(always)]
pub fn project_turning<V: Numbers>(coefficient: [V; 3], x: &Batch<V>, turning: &Batch<V>) -> [Batch<V>; 2] {
    let length = lengths(x, turning);
    let mut normal = x[0].max(V::splat(0.0));
    let (mut above, mut below) = ([V::default(); 3], [V::default(); 3]);
    for k in 0..3 {
        (above[k], below[k]) = (coefficient[k] * length[k], coefficient[k] * coefficient[k]);
    }
    for subset in 1..8_usize {
        let (mut numerator, mut denominator) = (x[0], V::splat(1.0));
        for k in 0..3 {
            if subset >> k & 1 == 1 {
                numerator += above[k];
                denominator += below[k];
            }
        }
        normal = normal.max(numerator.divide(denominator));
    }
    shortened(coefficient, normal, x, turning, length)
}

/// As [`within_disc`] with coefficients of sliding, rolling and spinning: the normal component first, then
/// the others within what it allows.
#[inline(always)]
pub fn within_discs<V: Numbers>(coefficient: [V; 3], x: &Batch<V>, turning: &Batch<V>) -> [Batch<V>; 2] {
    shortened(coefficient, x[0].max(V::splat(0.0)), x, turning, lengths(x, turning))
}

/// Work of one task, written as a type so that it can be compiled for more than one kind of [`Vector`].
pub trait TaskWork {
    /// Does the work. Implementations are `#[inline(always)]`.
    fn run<V: Vector>(self);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cone::{FrictionCone, TurningCone};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn projects_like_the_scalar_cone_with_turning(
            x in prop::collection::vec(prop_oneof![Just(0.0), -3.0..3.0_f64], 6 * LANES),
            c in prop::collection::vec(prop_oneof![Just(0.0), 0.0..2.0_f64], 3 * LANES),
        ) {
            let of = |all: &[f64], k: usize| Lanes(std::array::from_fn(|l| all[k * LANES + l]));
            let batch: Batch = std::array::from_fn(|k| of(&x, k));
            let turning: Batch = std::array::from_fn(|k| of(&x, 3 + k));
            let coefficient: [Lanes; 3] = std::array::from_fn(|k| of(&c, k));
            let image = project_turning(coefficient, &batch, &turning);
            let discs = within_discs(coefficient, &batch, &turning);
            for l in 0..LANES {
                let [mu, rolling, spinning] = coefficient.map(|c| c.0[l]);
                let [g, h] = [batch, turning].map(|b| b.map(|b| b.0[l]));
                let cone = TurningCone { mu, rolling, spinning };
                let expected = cone.project(g, h);
                let n = g[0].max(0.0);
                let cut = |c: f64, a: f64| if a > c * n { c * n / a } else { 1.0 };
                let factor = [cut(mu, g[1].hypot(g[2])), cut(rolling, h[1].hypot(h[2])), cut(spinning, h[0].abs())];
                let cut = [
                    [n, factor[0] * g[1], factor[0] * g[2]],
                    [factor[2] * h[0], factor[1] * h[1], factor[1] * h[2]],
                ];
                for part in 0..2 {
                    for k in 0..3 {
                        prop_assert!((image[part][k].0[l] - expected[part][k]).abs() < 1e-13);
                        prop_assert!((discs[part][k].0[l] - cut[part][k]).abs() < 1e-13);
                    }
                }
            }
        }

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
            let disc = within_disc(Lanes(mu), &batch, tangential_length(&batch));
            for l in 0..LANES {
                let (n, t) = (batch[0].0[l].max(0.0), [batch[1].0[l], batch[2].0[l]]);
                let length = t[0].hypot(t[1]);
                let factor = if length > mu[l] * n { mu[l] * n / length } else { 1.0 };
                for (k, expected) in [n, factor * t[0], factor * t[1]].into_iter().enumerate() {
                    prop_assert!((disc[k].0[l] - expected).abs() < 1e-14);
                }
                let expected = FrictionCone { mu: mu[l] }.project(std::array::from_fn(|k| batch[k].0[l]));
                for k in 0..3 {
                    prop_assert!((image[k].0[l] - expected[k]).abs() < 1e-14);
                }
            }
        }
    }
}
