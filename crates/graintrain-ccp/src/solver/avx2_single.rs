//! Eight numbers in single precision in a vector register of x86-64 processors with AVX2.
#![allow(unsafe_code)]

use super::avx2::{prefetch, register_operations};
use super::lanes::{Batch, Numbers};
use super::octet::{EIGHT, Octet, SingleVector};
use std::arch::x86_64::*;

/// Eight numbers. Nothing but [`run`](super::avx2::run) names the type: values exist only inside of that,
/// hence only where the processor has AVX2, which is what makes the calls of intrinsics below safe.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(super) struct SingleRegister(__m256);

register_operations! {
    SingleRegister of f32: _mm256_set1_ps _mm256_xor_ps _mm256_sqrt_ps _mm256_cmp_ps _mm256_blendv_ps;
    Add add _mm256_add_ps, Sub sub _mm256_sub_ps, Mul mul _mm256_mul_ps;
    max _mm256_max_ps, min _mm256_min_ps, divide _mm256_div_ps
}

/// Numbers 0 and 1 of both arguments, in each half, for `_mm256_shuffle_ps`.
const FIRST_TWO: i32 = 0x44;
/// Numbers 2 and 3 of both.
const LAST_TWO: i32 = 0xEE;
/// The low halves of two registers one after the other, for `_mm256_permute2f128_ps`.
const LOW_HALVES: i32 = 0x20;
/// The high halves.
const HIGH_HALVES: i32 = 0x31;
/// Numbers 1, 2, 0, 3 of each half, for `_mm256_permute_ps`.
const ROTATED: i32 = 0b11_00_10_01;

/// From four records (a, 0, b, 0) to the components of the four a in the low half and of the four b in the
/// high one.
#[inline(always)]
unsafe fn four_components(records: [__m256; 4]) -> [__m256; 3] {
    let [a, b, c, d] = records;
    // SAFETY: the caller's.
    unsafe {
        let (xy, more_xy) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
        let (z, more_z) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
        [
            _mm256_shuffle_ps::<FIRST_TWO>(xy, more_xy),
            _mm256_shuffle_ps::<LAST_TWO>(xy, more_xy),
            _mm256_shuffle_ps::<FIRST_TWO>(z, more_z),
        ]
    }
}

/// The way back.
#[inline(always)]
unsafe fn four_records([x, y, z]: [__m256; 3]) -> [__m256; 4] {
    // SAFETY: the caller's.
    unsafe {
        let zero = _mm256_setzero_ps();
        let (xy, more_xy) = (_mm256_unpacklo_ps(x, y), _mm256_unpackhi_ps(x, y));
        let (z, more_z) = (_mm256_unpacklo_ps(z, zero), _mm256_unpackhi_ps(z, zero));
        [
            _mm256_shuffle_ps::<FIRST_TWO>(xy, z),
            _mm256_shuffle_ps::<LAST_TWO>(xy, z),
            _mm256_shuffle_ps::<FIRST_TWO>(more_xy, more_z),
            _mm256_shuffle_ps::<LAST_TWO>(more_xy, more_z),
        ]
    }
}

impl SingleVector for SingleRegister {
    #[inline(always)]
    fn of(octet: Octet) -> Self {
        // SAFETY: see `SingleRegister`; the address is that of 32 aligned bytes.
        Self(unsafe { _mm256_load_ps(octet.0.as_ptr()) })
    }

    #[inline(always)]
    fn octet(self) -> Octet {
        let mut octet = Octet::default();
        // SAFETY: see `SingleRegister`; the address is that of 32 aligned bytes.
        unsafe { _mm256_store_ps(octet.0.as_mut_ptr(), self.0) };
        octet
    }

    #[inline(always)]
    fn of_slice(octets: &mut [Octet]) -> &mut [Self] {
        // SAFETY: both types are eight f32 in 32 aligned bytes, all of whose values are valid; the borrow is
        // handed on.
        unsafe { std::slice::from_raw_parts_mut(octets.as_mut_ptr().cast(), octets.len()) }
    }

    #[inline(always)]
    fn components([a, b, c, d, e, f, g, h]: [Self; EIGHT]) -> [Batch<Self>; 2] {
        // SAFETY: see `SingleRegister`. (No closures: they need not be compiled for the processor's vector
        // instructions.)
        unsafe {
            let [x, y, z] = four_components([a.0, b.0, c.0, d.0]);
            let [later_x, later_y, later_z] = four_components([e.0, f.0, g.0, h.0]);
            [
                [
                    Self(_mm256_permute2f128_ps::<LOW_HALVES>(x, later_x)),
                    Self(_mm256_permute2f128_ps::<LOW_HALVES>(y, later_y)),
                    Self(_mm256_permute2f128_ps::<LOW_HALVES>(z, later_z)),
                ],
                [
                    Self(_mm256_permute2f128_ps::<HIGH_HALVES>(x, later_x)),
                    Self(_mm256_permute2f128_ps::<HIGH_HALVES>(y, later_y)),
                    Self(_mm256_permute2f128_ps::<HIGH_HALVES>(z, later_z)),
                ],
            ]
        }
    }

    #[inline(always)]
    fn records([a, b]: [&Batch<Self>; 2]) -> [Self; EIGHT] {
        // SAFETY: see `SingleRegister`.
        unsafe {
            let [p, q, r, s] = four_records([
                _mm256_permute2f128_ps::<LOW_HALVES>(a[0].0, b[0].0),
                _mm256_permute2f128_ps::<LOW_HALVES>(a[1].0, b[1].0),
                _mm256_permute2f128_ps::<LOW_HALVES>(a[2].0, b[2].0),
            ]);
            let [t, u, v, w] = four_records([
                _mm256_permute2f128_ps::<HIGH_HALVES>(a[0].0, b[0].0),
                _mm256_permute2f128_ps::<HIGH_HALVES>(a[1].0, b[1].0),
                _mm256_permute2f128_ps::<HIGH_HALVES>(a[2].0, b[2].0),
            ]);
            [Self(p), Self(q), Self(r), Self(s), Self(t), Self(u), Self(v), Self(w)]
        }
    }

    #[inline(always)]
    fn rotated(self) -> Self {
        // SAFETY: see `SingleRegister`.
        Self(unsafe { _mm256_permute_ps::<ROTATED>(self.0) })
    }

    #[inline(always)]
    fn prefetch<T>(datum: &T) {
        prefetch(datum);
    }
}
