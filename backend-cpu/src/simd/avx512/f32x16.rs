//! [`F32x16`] in one vector.

#![allow(
    clippy::undocumented_unsafe_blocks,
    reason = "one reason for all: functions are instantiated with this type only where they are compiled \
              for AVX-512; loads and stores are of arrays as long as they read and write"
)]

use core::arch::x86_64::*;

use crate::simd::f32x16::{F32x16, Row16};

/// By AVX-512 (F and DQ). To be used only where the processor has it.
#[derive(Clone, Copy)]
pub(crate) struct Avx512F32x16(__m512);

impl F32x16 for Avx512F32x16 {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn load(from: &Row16) -> Self {
        unsafe { Avx512F32x16(_mm512_loadu_ps(from.as_ptr())) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn twice(from: &[f32; 8]) -> Self {
        unsafe { Avx512F32x16(_mm512_broadcast_f32x8(_mm256_loadu_ps(from.as_ptr()))) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn splat(x: f32) -> Self {
        unsafe { Avx512F32x16(_mm512_set1_ps(x)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn store(self, to: &mut Row16) {
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn plus(self, other: Self) -> Self {
        unsafe { Avx512F32x16(_mm512_add_ps(self.0, other.0)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn minus(self, other: Self) -> Self {
        unsafe { Avx512F32x16(_mm512_sub_ps(self.0, other.0)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn times(self, other: Self) -> Self {
        unsafe { Avx512F32x16(_mm512_mul_ps(self.0, other.0)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn least(self, other: Self) -> Self {
        unsafe { Avx512F32x16(_mm512_min_ps(self.0, other.0)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn greatest(self, other: Self) -> Self {
        unsafe { Avx512F32x16(_mm512_max_ps(self.0, other.0)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn swapped(self) -> Self {
        unsafe { Avx512F32x16(_mm512_shuffle_f32x4::<0b01_00_11_10>(self.0, self.0)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn crossed(self) -> Self {
        unsafe { Avx512F32x16(_mm512_shuffle_f32x4::<0b10_11_00_01>(self.0, self.0)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn faces(self) -> Self {
        unsafe {
            let sign = i32::MIN;
            let signs = _mm512_castsi512_ps(_mm512_set_epi32(
                sign, sign, sign, sign, 0, 0, 0, 0, sign, sign, sign, sign, 0, 0, 0, 0,
            ));
            Avx512F32x16(_mm512_maskz_xor_ps(0x7777, self.0, signs))
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn halves(self, other: Self) -> Self {
        unsafe { Avx512F32x16(_mm512_mask_blend_ps(0xff00, self.0, other.0)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn plus_where_less(self, a: Self, b: Self, more: Self) -> Self {
        unsafe {
            let mask = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a.0, b.0);
            Avx512F32x16(_mm512_mask_add_ps(self.0, mask, self.0, more.0))
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn where_less(self, a: Self, b: Self, other: Self) -> Self {
        unsafe {
            let mask = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a.0, b.0);
            Avx512F32x16(_mm512_mask_blend_ps(mask, other.0, self.0))
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn equal(self, other: Self) -> u16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(self.0, other.0) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn less(self, other: Self) -> u16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn not_above(self, other: Self) -> u16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_NGT_UQ>(self.0, other.0) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn least_lane(self) -> f32 {
        unsafe { _mm512_reduce_min_ps(self.0) }
    }
}
