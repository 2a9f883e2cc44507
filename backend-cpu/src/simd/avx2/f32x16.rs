//! [`F32x16`] in two vectors.

#![allow(
    clippy::undocumented_unsafe_blocks,
    reason = "one reason for all: functions are instantiated with this type only where they are compiled \
              for AVX2; loads and stores are of arrays as long as they read and write"
)]

use core::arch::x86_64::*;

use crate::simd::f32x16::{F32x16, Row16};

/// By AVX2: the lower eight, and the upper. To be used only where the processor has it.
#[derive(Clone, Copy)]
pub(crate) struct Avx2F32x16(__m256, __m256);

impl F32x16 for Avx2F32x16 {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn load(from: &Row16) -> Self {
        let from = from.as_ptr();
        unsafe { Avx2F32x16(_mm256_loadu_ps(from), _mm256_loadu_ps(from.add(8))) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn twice(from: &[f32; 8]) -> Self {
        let both = unsafe { _mm256_loadu_ps(from.as_ptr()) };
        Avx2F32x16(both, both)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn splat(x: f32) -> Self {
        let both = unsafe { _mm256_set1_ps(x) };
        Avx2F32x16(both, both)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn store(self, to: &mut Row16) {
        let to = to.as_mut_ptr();
        unsafe {
            _mm256_storeu_ps(to, self.0);
            _mm256_storeu_ps(to.add(8), self.1);
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn plus(self, other: Self) -> Self {
        unsafe { Avx2F32x16(_mm256_add_ps(self.0, other.0), _mm256_add_ps(self.1, other.1)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn minus(self, other: Self) -> Self {
        unsafe { Avx2F32x16(_mm256_sub_ps(self.0, other.0), _mm256_sub_ps(self.1, other.1)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn times(self, other: Self) -> Self {
        unsafe { Avx2F32x16(_mm256_mul_ps(self.0, other.0), _mm256_mul_ps(self.1, other.1)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn least(self, other: Self) -> Self {
        unsafe { Avx2F32x16(_mm256_min_ps(self.0, other.0), _mm256_min_ps(self.1, other.1)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn greatest(self, other: Self) -> Self {
        unsafe { Avx2F32x16(_mm256_max_ps(self.0, other.0), _mm256_max_ps(self.1, other.1)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn swapped(self) -> Self {
        Avx2F32x16(self.1, self.0)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn crossed(self) -> Self {
        unsafe {
            Avx2F32x16(
                _mm256_permute2f128_ps::<1>(self.0, self.0),
                _mm256_permute2f128_ps::<1>(self.1, self.1),
            )
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn faces(self) -> Self {
        unsafe {
            let zero = _mm256_setzero_ps();
            let signs = _mm256_setr_ps(0.0, 0.0, 0.0, 0.0, -0.0, -0.0, -0.0, -0.0);
            let negated = |half| _mm256_blend_ps::<0b1000_1000>(_mm256_xor_ps(half, signs), zero);
            Avx2F32x16(negated(self.0), negated(self.1))
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn halves(self, other: Self) -> Self {
        Avx2F32x16(self.0, other.1)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn plus_where_less(self, a: Self, b: Self, more: Self) -> Self {
        unsafe {
            let low = _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a.0, b.0), more.0);
            let high = _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a.1, b.1), more.1);
            self.plus(Avx2F32x16(low, high))
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn where_less(self, a: Self, b: Self, other: Self) -> Self {
        unsafe {
            let low = _mm256_cmp_ps::<_CMP_LT_OQ>(a.0, b.0);
            let high = _mm256_cmp_ps::<_CMP_LT_OQ>(a.1, b.1);
            Avx2F32x16(
                _mm256_blendv_ps(other.0, self.0, low),
                _mm256_blendv_ps(other.1, self.1, high),
            )
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn equal(self, other: Self) -> u16 {
        compared::<_CMP_EQ_OQ>(self, other)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn less(self, other: Self) -> u16 {
        compared::<_CMP_LT_OQ>(self, other)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn not_above(self, other: Self) -> u16 {
        compared::<_CMP_NGT_UQ>(self, other)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn least_lane(self) -> f32 {
        unsafe {
            let eight = _mm256_min_ps(self.0, self.1);
            let four = _mm_min_ps(_mm256_castps256_ps128(eight), _mm256_extractf128_ps::<1>(eight));
            let two = _mm_min_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_min_ss(two, _mm_movehdup_ps(two)))
        }
    }
}

/// The lanes for which a comparison holds, a bit each.
#[cfg_attr(not(unoptimised), inline(always))]
fn compared<const HOW: i32>(a: Avx2F32x16, b: Avx2F32x16) -> u16 {
    unsafe {
        let low = _mm256_movemask_ps(_mm256_cmp_ps::<HOW>(a.0, b.0));
        let high = _mm256_movemask_ps(_mm256_cmp_ps::<HOW>(a.1, b.1));
        (low | high << 8) as u16
    }
}
