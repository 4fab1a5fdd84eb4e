//! Eight contacts at a time in single precision: the arithmetic of `solver/single`.

use super::lanes::{Batch, Numbers, TaskWork, Vector, lane_operators, numbers_one_by_one};

/// Numbers in an octet.
pub const EIGHT: usize = 8;

/// One number of each of eight contacts, or two vectors of a body, each followed by a zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(32))]
pub struct Octet(pub [f32; EIGHT]);

/// Eight numbers in single precision: [`Octet`] on any processor, a vector register where it has AVX2 (module
/// `avx2_single`). Both give the same bits.
pub trait SingleVector: Numbers {
    /// These numbers.
    fn of(octet: Octet) -> Self;

    /// The numbers.
    fn octet(self) -> Octet;

    /// Numbers in memory, to change in place.
    fn of_slice(octets: &mut [Octet]) -> &mut [Self];

    /// The same of batches.
    #[inline(always)]
    fn of_batches(batches: &mut [Batch<Octet>]) -> &mut [Batch<Self>] {
        Self::of_slice(batches.as_flattened_mut()).as_chunks_mut().0
    }

    /// From the records (a, 0, b, 0) of eight contacts to the components of all a and of all b.
    fn components(records: [Self; EIGHT]) -> [Batch<Self>; 2];

    /// The way back.
    fn records(components: [&Batch<Self>; 2]) -> [Self; EIGHT];

    /// From (a, 0, b, 0) with a = (x, y, z) to that with (y, z, x), and b alike.
    fn rotated(self) -> Self;

    /// Asks for a datum that will be read soon.
    fn prefetch<T>(datum: &T);
}

/// Work of one task in single precision, written as a type so that it can be compiled for more than one kind
/// of [`SingleVector`].
pub trait SingleWork {
    /// Does the work. Implementations are `#[inline(always)]`.
    fn run<V: SingleVector>(self);
}

/// [`SingleWork`] as a [`TaskWork`].
pub struct InSingle<W>(pub W);

impl<W: SingleWork> TaskWork for InSingle<W> {
    #[inline(always)]
    fn run<V: Vector>(self) {
        self.0.run::<V::Single>();
    }
}

impl Octet {
    /// The same number eight times.
    pub const fn splat(x: f32) -> Self {
        Self([x; EIGHT])
    }

    /// f(a_l, b_l) number by number.
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|l| f(self.0[l], other.0[l])))
    }

    /// Sum of the numbers in double precision, in a fixed order.
    pub fn sum(self) -> f64 {
        self.0.into_iter().map(f64::from).sum()
    }

    /// Largest number, at least zero; NaN if there is one.
    pub fn largest(self) -> f32 {
        self.0.into_iter().fold(0.0, |m, x| if x.is_nan() || x > m { x } else { m })
    }
}

numbers_one_by_one!(Octet, f32, EIGHT);

impl SingleVector for Octet {
    #[inline(always)]
    fn of(octet: Octet) -> Self {
        octet
    }

    #[inline(always)]
    fn octet(self) -> Octet {
        self
    }

    #[inline(always)]
    fn of_slice(octets: &mut [Octet]) -> &mut [Self] {
        octets
    }

    #[inline(always)]
    fn components(records: [Self; EIGHT]) -> [Batch<Self>; 2] {
        let half =
            |first: usize| std::array::from_fn(|k| Self(std::array::from_fn(|l| records[l].0[first + k])));
        [half(0), half(4)]
    }

    #[inline(always)]
    fn records([a, b]: [&Batch<Self>; 2]) -> [Self; EIGHT] {
        std::array::from_fn(|l| {
            Self([a[0].0[l], a[1].0[l], a[2].0[l], 0.0, b[0].0[l], b[1].0[l], b[2].0[l], 0.0])
        })
    }

    #[inline(always)]
    fn rotated(self) -> Self {
        let [x, y, z, o, p, q, r, s] = self.0;
        Self([y, z, x, o, q, r, p, s])
    }

    #[inline(always)]
    fn prefetch<T>(_: &T) {}
}

lane_operators!(Octet);

#[cfg(test)]
mod tests {
    use super::super::dispatch::vectorised;
    use super::super::lanes::{project_given, tangential_length};
    use super::*;
    use crate::cone::FrictionCone;
    use proptest::prelude::*;

    /// Writes the results of every operation on two vectors.
    struct Everything<'a> {
        a: Octet,
        b: Octet,
        results: &'a mut Vec<Octet>,
    }

    impl SingleWork for Everything<'_> {
        #[inline(always)]
        fn run<V: SingleVector>(self) {
            let (a, b) = (V::of(self.a), V::of(self.b));
            let mut assigned = a;
            assigned += b;
            let (ups, downs) = ([a, b, a - b], [b, a + b, a * b]);
            let records = V::records([&ups, &downs]);
            let [first, second] = V::components([a, b, a + b, a * b, a - b, b - a, a, b]);
            let mut in_place = [self.a, self.b];
            V::of_slice(&mut in_place)[1] = a;
            let results = [a + b, a - b, a * b, -a, assigned, a.sqrt(), a.max(b), a.min(b), a.divide(b)];
            let more = [a.at_most(b, a + a, b), V::splat(0.1), a.rotated(), V::default()];
            let all = results.iter().chain(&more).chain(&records).chain(&first).chain(&second);
            self.results.extend(all.map(|v| v.octet()));
            self.results.extend(in_place);
        }
    }

    proptest! {
        #[test]
        fn registers_give_the_bits_of_plain_arithmetic(
            a in prop::array::uniform8(prop::num::f32::ANY),
            b in prop::array::uniform8(prop::num::f32::ANY),
        ) {
            let (mut plain, mut registers) = (Vec::new(), Vec::new());
            Everything { a: Octet(a), b: Octet(b), results: &mut plain }.run::<Octet>();
            vectorised(InSingle(Everything { a: Octet(a), b: Octet(b), results: &mut registers }));
            prop_assert_eq!(plain.len(), registers.len());
            for (place, (plain, register)) in plain.iter().zip(&registers).enumerate() {
                for (p, r) in plain.0.iter().zip(&register.0) {
                    // Which NaN an operation gives is nobody's business.
                    prop_assert!(p.to_bits() == r.to_bits() || (p.is_nan() && r.is_nan()), "{place}: {p} {r}");
                }
            }
        }

        #[test]
        fn projects_like_the_scalar_cone(
            x in prop::collection::vec(-3.0..3.0_f32, 3 * EIGHT),
            mu in prop::array::uniform8(0.0..2.0_f32),
            flat in 0_usize..EIGHT,
        ) {
            let mut x = x;
            (x[EIGHT + flat], x[2 * EIGHT + flat]) = (0.0, 0.0);
            let batch: Batch<Octet> = std::array::from_fn(|k| Octet(std::array::from_fn(|l| x[k * EIGHT + l])));
            let image = project_given(Octet(mu), &batch, tangential_length(&batch));
            for l in 0..EIGHT {
                let cone = FrictionCone { mu: f64::from(mu[l]) };
                let expected = cone.project(std::array::from_fn(|k| f64::from(batch[k].0[l])));
                for k in 0..3 {
                    prop_assert!((f64::from(image[k].0[l]) - expected[k]).abs() < 3e-6);
                }
            }
        }
    }
}
