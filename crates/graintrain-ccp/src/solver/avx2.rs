//! Four numbers in a vector register of x86-64 processors with AVX2.
//!
//! The compiler keeps [`Lanes`] together only along short chains of operations, and takes them apart where
//! they are gathered from bodies or spread over them. Measured with benches/product.rs at 18 299 contacts,
//! interleaved: the product with N takes 0.129 ms, with `Lanes` compiled for AVX2 and records without padding
//! it took 0.171 ms.
#![allow(unsafe_code)]

use super::avx2_single::SingleRegister;
use super::lanes::{Batch, LANES, Lanes, Numbers, TaskWork, Vector};
use std::arch::x86_64::*;

/// Four numbers. The type is private: values exist only inside [`run`], hence only where the processor has
/// AVX2, which is what makes the calls of intrinsics below safe.
#[derive(Clone, Copy)]
#[repr(transparent)]
struct Register(__m256d);

/// Does the work with vector registers if this processor has AVX2; hands it back if not.
#[inline(always)]
pub(super) fn run<W: TaskWork>(work: W) -> Result<(), W> {
    #[target_feature(enable = "avx2")]
    fn with_avx2(work: impl TaskWork) {
        work.run::<Register>();
    }
    // The same instructions, but thirty-two registers rather than sixteen.
    #[target_feature(enable = "avx2,avx512f,avx512vl,avx512dq")]
    fn with_avx512(work: impl TaskWork) {
        work.run::<Register>();
    }
    if std::arch::is_x86_feature_detected!("avx512vl")
        && std::arch::is_x86_feature_detected!("avx512f")
        && std::arch::is_x86_feature_detected!("avx512dq")
        && std::arch::is_x86_feature_detected!("avx2")
    {
        // SAFETY: the processor has all that `with_avx512` asks for.
        unsafe { with_avx512(work) };
        Ok(())
    } else if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2, which is all that `with_avx2` asks for.
        unsafe { with_avx2(work) };
        Ok(())
    } else {
        Err(work)
    }
}

/// `+`, `+=`, `-`, `*`, unary `-` and [`Numbers`] of a register, by the intrinsics named.
macro_rules! register_operations {
    (
        $register:ident of $number:ty: $splat:ident $xor:ident $sqrt:ident $compare:ident $blend:ident;
        $($operator:ident $method:ident $operation:ident),*; $($pairwise:ident $of_pairs:ident),*
    ) => {
        impl Default for $register {
            #[inline(always)]
            fn default() -> Self {
                Self::splat(0.0)
            }
        }

        $(impl std::ops::$operator for $register {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: see the type.
                Self(unsafe { $operation(self.0, other.0) })
            }
        })*

        impl std::ops::AddAssign for $register {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }

        impl std::ops::Neg for $register {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                // SAFETY: see the type.
                Self(unsafe { $xor(self.0, $splat(-0.0)) })
            }
        }

        impl Numbers for $register {
            const TINY: f64 = <$number>::MIN_POSITIVE as f64;

            #[inline(always)]
            fn splat(x: f64) -> Self {
                // SAFETY: see the type.
                Self(unsafe { $splat(x as $number) })
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                // SAFETY: see the type.
                Self(unsafe { $sqrt(self.0) })
            }

            $(#[inline(always)]
            fn $pairwise(self, other: Self) -> Self {
                // SAFETY: see the type.
                Self(unsafe { $of_pairs(self.0, other.0) })
            })*

            #[inline(always)]
            fn at_most(self, bound: Self, yes: Self, no: Self) -> Self {
                // SAFETY: see the type.
                Self(unsafe { $blend(no.0, yes.0, $compare::<_CMP_LE_OQ>(self.0, bound.0)) })
            }
        }
    };
}
pub(super) use register_operations;

register_operations! {
    Register of f64: _mm256_set1_pd _mm256_xor_pd _mm256_sqrt_pd _mm256_cmp_pd _mm256_blendv_pd;
    Add add _mm256_add_pd, Sub sub _mm256_sub_pd, Mul mul _mm256_mul_pd;
    max _mm256_max_pd, min _mm256_min_pd, divide _mm256_div_pd
}

impl Vector for Register {
    type Single = SingleRegister;

    #[inline(always)]
    fn of(lanes: Lanes) -> Self {
        // SAFETY: see `Register`; the address is that of 32 aligned bytes.
        Self(unsafe { _mm256_load_pd(lanes.0.as_ptr()) })
    }

    #[inline(always)]
    fn lanes(self) -> Lanes {
        let mut lanes = Lanes::default();
        // SAFETY: see `Register`; the address is that of 32 aligned bytes.
        unsafe { _mm256_store_pd(lanes.0.as_mut_ptr(), self.0) };
        lanes
    }

    #[inline(always)]
    fn of_slice(lanes: &mut [Lanes]) -> &mut [Self] {
        // SAFETY: both types are four f64 in 32 aligned bytes, all of whose values are valid; the borrow is
        // handed on.
        unsafe { std::slice::from_raw_parts_mut(lanes.as_mut_ptr().cast(), lanes.len()) }
    }

    #[inline(always)]
    fn broadcast<const K: i32>(self) -> Self {
        // SAFETY: see `Register`.
        Self(unsafe {
            match K {
                0 => _mm256_permute4x64_pd::<0b00_00_00_00>(self.0),
                1 => _mm256_permute4x64_pd::<0b01_01_01_01>(self.0),
                2 => _mm256_permute4x64_pd::<0b10_10_10_10>(self.0),
                _ => _mm256_permute4x64_pd::<0b11_11_11_11>(self.0),
            }
        })
    }

    #[inline(always)]
    fn all_at_most(self, bound: Self) -> bool {
        // SAFETY: see `Register`.
        unsafe { _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(self.0, bound.0)) == 0b1111 }
    }

    #[inline(always)]
    fn prefetch<T>(datum: &T) {
        prefetch(datum);
    }

    #[inline(always)]
    fn components([a, b, c, d]: [Self; LANES]) -> Batch<Self> {
        // SAFETY: see `Register`.
        unsafe {
            // (a0 b0 a2 b2), (c0 d0 c2 d2), (a1 b1 a3 b3), (c1 d1 c3 d3).
            let (even, more_even) = (_mm256_unpacklo_pd(a.0, b.0), _mm256_unpacklo_pd(c.0, d.0));
            let (odd, more_odd) = (_mm256_unpackhi_pd(a.0, b.0), _mm256_unpackhi_pd(c.0, d.0));
            [
                Self(_mm256_permute2f128_pd::<LOW_HALVES>(even, more_even)),
                Self(_mm256_permute2f128_pd::<LOW_HALVES>(odd, more_odd)),
                Self(_mm256_permute2f128_pd::<HIGH_HALVES>(even, more_even)),
            ]
        }
    }

    #[inline(always)]
    fn records([x, y, z]: &Batch<Self>) -> [Self; LANES] {
        // SAFETY: see `Register`.
        unsafe {
            // (x0 y0 x2 y2), (z0 0 z2 0), (x1 y1 x3 y3), (z1 0 z3 0).
            let zero = _mm256_setzero_pd();
            let (even, more_even) = (_mm256_unpacklo_pd(x.0, y.0), _mm256_unpacklo_pd(z.0, zero));
            let (odd, more_odd) = (_mm256_unpackhi_pd(x.0, y.0), _mm256_unpackhi_pd(z.0, zero));
            [
                Self(_mm256_permute2f128_pd::<LOW_HALVES>(even, more_even)),
                Self(_mm256_permute2f128_pd::<LOW_HALVES>(odd, more_odd)),
                Self(_mm256_permute2f128_pd::<HIGH_HALVES>(even, more_even)),
                Self(_mm256_permute2f128_pd::<HIGH_HALVES>(odd, more_odd)),
            ]
        }
    }
}

const CACHE_LINE: usize = 64;

/// Asks for a datum that will be read soon.
#[inline(always)]
pub(super) fn prefetch<T>(datum: &T) {
    for line in 0..size_of::<T>().div_ceil(CACHE_LINE) {
        let address = std::ptr::from_ref(datum).cast::<i8>().wrapping_add(line * CACHE_LINE);
        // SAFETY: a prefetch reads nothing, whatever the address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(address) };
    }
}

/// The low halves of two registers one after the other, for `_mm256_permute2f128_pd`.
const LOW_HALVES: i32 = 0x20;
/// The high halves.
const HIGH_HALVES: i32 = 0x31;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Writes the results of every operation on two vectors.
    struct Everything<'a> {
        a: Lanes,
        b: Lanes,
        results: &'a mut Vec<Lanes>,
    }

    impl TaskWork for Everything<'_> {
        #[inline(always)]
        fn run<V: Vector>(self) {
            let (a, b) = (V::of(self.a), V::of(self.b));
            let mut assigned = a;
            assigned += b;
            let [r0, r1, r2, r3] = V::records(&[a, b, a - b]);
            let [x, y, z] = V::components([a, b, a + b, a * b]);
            let mut in_place = [self.a, self.b];
            V::of_slice(&mut in_place)[1] = a;
            let results = [a + b, a - b, a * b, -a, assigned, a.sqrt(), a.max(b), a.min(b), a.divide(b)];
            let more = [a.at_most(b, a + a, b), V::splat(3.0), r0, r1, r2, r3, x, y, z, V::default()];
            let picked = [a.broadcast::<0>(), a.broadcast::<1>(), a.broadcast::<2>(), a.broadcast::<3>()];
            self.results.extend(results.iter().chain(&more).chain(&picked).map(|v| v.lanes()));
            self.results.extend(in_place);
            for all in [a.all_at_most(b), a.all_at_most(a), a.min(b).all_at_most(b)] {
                self.results.push(Lanes([f64::from(u8::from(all)); LANES]));
            }
        }
    }

    proptest! {
        #[test]
        fn registers_give_the_bits_of_plain_arithmetic(
            a in prop::array::uniform4(prop::num::f64::ANY),
            b in prop::array::uniform4(prop::num::f64::ANY),
        ) {
            let (mut plain, mut registers) = (Vec::new(), Vec::new());
            Everything { a: Lanes(a), b: Lanes(b), results: &mut plain }.run::<Lanes>();
            if run(Everything { a: Lanes(a), b: Lanes(b), results: &mut registers }).is_err() {
                println!("skipped: this processor has no AVX2");
                return Ok(());
            }
            prop_assert_eq!(plain.len(), registers.len());
            for (place, (plain, register)) in plain.iter().zip(&registers).enumerate() {
                for (p, r) in plain.0.iter().zip(&register.0) {
                    // Which NaN an operation gives is nobody's business.
                    prop_assert!(p.to_bits() == r.to_bits() || (p.is_nan() && r.is_nan()), "{place}: {p} {r}");
                }
            }
        }
    }
}
