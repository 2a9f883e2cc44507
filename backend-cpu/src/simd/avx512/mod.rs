//! 16 lanes: AVX-512 F, DQ, BW and VL.

#![allow(clippy::undocumented_unsafe_blocks, reason = "one contract for all, that of the trait")]

use core::arch::x86_64::*;

mod f32x16;
mod references;

use crate::simd::avx2::Avx2;
use crate::simd::{Compiled, Direction, F32x4, LeastKeys, Simd, key_of};
use f32x16::Avx512F32x16;

/// [`Simd`] by AVX-512.
#[derive(Clone, Copy)]
pub(crate) struct Avx512;

// SAFETY of all blocks: the trait's contract, the set and readable or writable memory.
impl Simd for Avx512 {
    const N: usize = 16;
    const SPECIALISED: bool = true;
    type F32x16 = Avx512F32x16;
    type Eight = Avx2;
    type Floats = __m512;
    type Places = __m512i;
    type Mask = __mmask16;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn splat(x: f32) -> __m512 {
        unsafe { _mm512_set1_ps(x) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn load(from: *const f32) -> __m512 {
        unsafe { _mm512_loadu_ps(from) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn store(to: *mut f32, x: __m512) {
        unsafe { _mm512_storeu_ps(to, x) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn add(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_add_ps(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn sub(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_sub_ps(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mul(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_mul_ps(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn div(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_div_ps(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mul_sub(a: __m512, b: __m512, c: __m512) -> __m512 {
        unsafe { _mm512_fmsub_ps(a, b, c) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn min(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_min_ps(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn max(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_max_ps(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn abs(a: __m512) -> __m512 {
        unsafe { _mm512_abs_ps(a) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn le(a: __m512, b: __m512) -> __mmask16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn and(a: __mmask16, b: __mmask16) -> __mmask16 {
        a & b
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn keep(mask: __mmask16, a: __m512) -> __m512 {
        unsafe { _mm512_maskz_mov_ps(mask, a) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn select(mask: __mmask16, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_mask_mov_ps(b, mask, a) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mask(bits: u32) -> __mmask16 {
        bits as __mmask16
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn bits(mask: __mmask16) -> u32 {
        u32::from(mask)
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn lane(of: __m512, lane: usize) -> f32 {
        unsafe { _mm512_cvtss_f32(_mm512_permutexvar_ps(_mm512_set1_epi32(lane as i32), of)) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn least(of: u32, a: __m512) -> u32 {
        unsafe {
            let infinity = _mm512_set1_ps(f32::INFINITY);
            let a = _mm512_mask_mov_ps(infinity, of as __mmask16, a);
            let b = _mm512_min_ps(a, _mm512_shuffle_f32x4::<0b01_00_11_10>(a, a));
            let b = _mm512_min_ps(b, _mm512_shuffle_f32x4::<0b10_11_00_01>(b, b));
            let b = _mm512_min_ps(b, _mm512_shuffle_ps::<0b01_00_11_10>(b, b));
            let b = _mm512_min_ps(b, _mm512_shuffle_ps::<0b10_11_00_01>(b, b));
            u32::from(_mm512_cmp_ps_mask::<_CMP_EQ_OQ>(a, b))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn lowest(of: __m512) -> f32 {
        unsafe {
            let upper = _mm512_castps512_ps256(_mm512_shuffle_f32x4::<0b01_00_11_10>(of, of));
            Avx2::lowest(_mm256_min_ps(_mm512_castps512_ps256(of), upper))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn highest(of: __m512) -> f32 {
        unsafe {
            let upper = _mm512_castps512_ps256(_mm512_shuffle_f32x4::<0b01_00_11_10>(of, of));
            Avx2::highest(_mm256_max_ps(_mm512_castps512_ps256(of), upper))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn compress(of: __m512, bits: u32, to: *mut f32) {
        unsafe { _mm512_storeu_ps(to, _mm512_maskz_compress_ps(bits as __mmask16, of)) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn split(bits: u32, from: &[*mut u32], to: &[*mut u32], left: usize, right: usize) {
        unsafe {
            let lefts = bits as __mmask16;
            for (&from, &to) in from.iter().zip(to) {
                let all = _mm512_loadu_si512(from.cast());
                let own = _mm512_maskz_compress_epi32(lefts, all);
                _mm512_storeu_si512(to.add(left).cast(), own);
                let own = _mm512_maskz_compress_epi32(!lefts, all);
                _mm512_storeu_si512(to.add(right).cast(), own);
            }
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn keep_least(keys: &mut LeastKeys, numbers: *const f32, points: *const u32, near: u32) {
        unsafe {
            let mut all = _mm512_load_si512(keys.0.as_ptr().cast());
            let mut left = near;
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                let key = key_of(*numbers.add(lane), *points.add(lane));
                let key = _mm512_set1_epi64(key as i64);
                // All one place further, after a least one.
                let further = _mm512_alignr_epi64::<7>(all, _mm512_setzero_si512());
                all = _mm512_min_epu64(all, _mm512_max_epu64(further, key));
            }
            _mm512_store_si512(keys.0.as_mut_ptr().cast(), all);
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn equal(from: *const u32, number: u32) -> u32 {
        unsafe {
            let all = _mm512_loadu_si512(from.cast());
            u32::from(_mm512_cmpeq_epi32_mask(all, _mm512_set1_epi32(number as i32)))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn cull(children: *mut u32, t: *mut f32, count: usize, stop: f32) -> usize {
        unsafe {
            let mut end = 0;
            let mut i = 0;
            while i < count {
                let (old_t, old) = (t.add(i), children.add(i));
                // The memory after it may never have been written.
                let there = _bzhi_u32(0xffff, (count - i).min(16) as u32) as __mmask16;
                let x = _mm512_maskz_loadu_ps(there, old_t);
                let stop = _mm512_set1_ps(stop);
                let kept = _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(there, x, stop);
                let y = _mm512_maskz_loadu_epi32(there, old.cast());
                let y = _mm512_maskz_compress_epi32(kept, y);
                _mm512_storeu_ps(t.add(end), _mm512_maskz_compress_ps(kept, x));
                _mm512_storeu_si512(children.add(end).cast(), y);
                end += kept.count_ones() as usize;
                i += 16;
            }
            end
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn places(from: *const u8) -> __m512i {
        unsafe { _mm512_cvtepu8_epi32(_mm_loadu_si128(from.cast())) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn look_up([low, high]: [__m512; 2], at: __m512i) -> __m512 {
        unsafe { _mm512_permutex2var_ps(low, at, high) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn look_up_low(table: __m512, at: __m512i) -> __m512 {
        unsafe { _mm512_permutexvar_ps(at, table) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn transpose(from: *const f32, stride: usize, to: *mut f32, to_stride: usize) {
        unsafe {
            let quarters = [
                fours(from, stride),
                fours(from.add(4 * stride), stride),
                fours(from.add(8 * stride), stride),
                fours(from.add(12 * stride), stride),
            ];
            for k in 0..4 {
                let (a, b) = (quarters[0][k], quarters[1][k]);
                let (c, d) = (quarters[2][k], quarters[3][k]);
                // Quarters 0 and 2, then 1 and 3, of two vectors.
                let ab_even = _mm512_shuffle_f32x4::<0x88>(a, b);
                let ab_odd = _mm512_shuffle_f32x4::<0xdd>(a, b);
                let cd_even = _mm512_shuffle_f32x4::<0x88>(c, d);
                let cd_odd = _mm512_shuffle_f32x4::<0xdd>(c, d);
                let to = to.add(k * to_stride);
                _mm512_storeu_ps(to, _mm512_shuffle_f32x4::<0x88>(ab_even, cd_even));
                let to = to.add(4 * to_stride);
                _mm512_storeu_ps(to, _mm512_shuffle_f32x4::<0x88>(ab_odd, cd_odd));
                let to = to.add(4 * to_stride);
                _mm512_storeu_ps(to, _mm512_shuffle_f32x4::<0xdd>(ab_even, cd_even));
                let to = to.add(4 * to_stride);
                _mm512_storeu_ps(to, _mm512_shuffle_f32x4::<0xdd>(ab_odd, cd_odd));
            }
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push(
        children: *const u32,
        t: __m512,
        mask: __mmask16,
        order: *const u8,
        direction: &Direction,
        to_children: *mut u32,
        to_t: *mut f32,
    ) -> u32 {
        unsafe {
            let read = _mm_loadu_si128(direction.places.as_ptr().cast());
            let places = _mm_shuffle_epi8(_mm_loadu_si128(order.cast()), read);
            let places = _mm512_cvtepu8_epi32(places);
            // The mask in that order: whatever is not in it is infinitely far.
            let infinity = _mm512_set1_ps(f32::INFINITY);
            let t = _mm512_permutexvar_ps(places, _mm512_mask_mov_ps(infinity, mask, t));
            let mask = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(t, infinity);
            let in_order = _mm512_permutexvar_epi32(places, _mm512_loadu_si512(children.cast()));
            // To a register and then to memory: compressing to memory is slow on some processors.
            _mm512_storeu_ps(to_t, _mm512_maskz_compress_ps(mask, t));
            _mm512_storeu_si512(to_children.cast(), _mm512_maskz_compress_epi32(mask, in_order));
            let last = 15 - (u32::from(mask) | 1).leading_zeros() as usize % 16;
            let last = *direction.places.get_unchecked(last) as usize;
            *children.add(*order.add(last) as usize)
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn magnitude(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_range_ps::<0b1011>(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn bytes_in_ranges(
        bytes: &[[u8; 8]; 8],
        first: &[u8; 64],
        span: &[u8; 64],
        there: u64,
    ) -> u64 {
        unsafe {
            let bytes = _mm512_loadu_si512(bytes.as_ptr().cast());
            let first = _mm512_loadu_si512(first.as_ptr().cast());
            let span = _mm512_loadu_si512(span.as_ptr().cast());
            _mm512_mask_cmple_epu8_mask(there, _mm512_sub_epi8(bytes, first), span)
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn product_error(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_fmsub_ps(a, b, _mm512_mul_ps(a, b)) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn call<T: Compiled>(task: T) -> T::Output {
        unsafe { in_its_own_function(task) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push_met(
        children: *const u32,
        enter: __m512,
        exit: __m512,
        order: *const u8,
        direction: &Direction,
        to_children: *mut u32,
        to_t: *mut f32,
    ) -> (u32, usize) {
        unsafe {
            let read = _mm_loadu_si128(direction.places.as_ptr().cast());
            let places = _mm_shuffle_epi8(_mm_loadu_si128(order.cast()), read);
            let places = _mm512_cvtepu8_epi32(places);
            // In order first, then compared: what comes next waits for nothing but the comparison.
            let t = _mm512_permutexvar_ps(places, enter);
            let met = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(t, _mm512_permutexvar_ps(places, exit));
            let bits = u32::from(met);
            // The same from the other end, so that the last one comes first: without a look-up in memory.
            let read = _mm_loadu_si128(direction.reversed.as_ptr().cast());
            let reversed = _mm_shuffle_epi8(_mm_loadu_si128(order.cast()), read);
            let reversed = _mm512_cvtepu8_epi32(reversed);
            let met_there = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(
                _mm512_permutexvar_ps(reversed, enter),
                _mm512_permutexvar_ps(reversed, exit),
            );
            let all = _mm512_loadu_si512(children.cast());
            let from_there = _mm512_permutexvar_epi32(reversed, all);
            let last = _mm512_maskz_compress_epi32(met_there, from_there);
            let last = _mm512_cvtsi512_si32(last) as u32;
            let in_order = _mm512_permutexvar_epi32(places, all);
            // To a register and then to memory: compressing to memory is slow on some processors.
            _mm512_storeu_ps(to_t, _mm512_maskz_compress_ps(met, t));
            _mm512_storeu_si512(to_children.cast(), _mm512_maskz_compress_epi32(met, in_order));
            (last, bits.count_ones() as usize)
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn pick(rows: [F32x4; 2], places: &[u32; 8], to: &mut [f32; 8]) {
        unsafe { Avx2::pick(rows, places, to) }
    }
}

/// A function compiled for the set.
#[inline(never)]
#[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
unsafe fn in_its_own_function<T: Compiled>(task: T) -> T::Output {
    // SAFETY: the caller's contract.
    unsafe { task.run::<Avx512>() }
}

/// Four rows as columns of four: the k-th vector has, in each quarter, a column.
///
/// # Safety
/// The processor must have the set, the rows must be readable.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn fours(from: *const f32, stride: usize) -> [__m512; 4] {
    unsafe {
        let a = _mm512_loadu_ps(from);
        let b = _mm512_loadu_ps(from.add(stride));
        let c = _mm512_loadu_ps(from.add(2 * stride));
        let d = _mm512_loadu_ps(from.add(3 * stride));
        let ab_low = _mm512_castps_pd(_mm512_unpacklo_ps(a, b));
        let ab_high = _mm512_castps_pd(_mm512_unpackhi_ps(a, b));
        let cd_low = _mm512_castps_pd(_mm512_unpacklo_ps(c, d));
        let cd_high = _mm512_castps_pd(_mm512_unpackhi_ps(c, d));
        [
            _mm512_castpd_ps(_mm512_unpacklo_pd(ab_low, cd_low)),
            _mm512_castpd_ps(_mm512_unpackhi_pd(ab_low, cd_low)),
            _mm512_castpd_ps(_mm512_unpacklo_pd(ab_high, cd_high)),
            _mm512_castpd_ps(_mm512_unpackhi_pd(ab_high, cd_high)),
        ]
    }
}
