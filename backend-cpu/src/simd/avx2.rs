//! 8 lanes: AVX2 and FMA.

#![allow(clippy::undocumented_unsafe_blocks, reason = "one contract for all, that of the trait")]

use core::arch::x86_64::*;
use core::mem::MaybeUninit;

mod f32x16;
mod references;

use super::{Compiled, Direction, F32x4, LeastKeys, Simd, key_of};
use f32x16::Avx2F32x16;

/// [`Simd`] by AVX2.
#[derive(Clone, Copy)]
pub(crate) struct Avx2;

/// For each mask of eight its lanes, consecutively.
static LANES_OF: [[u8; 8]; 256] = lanes_of(false);
/// The same where numbers become pairs with others: each half of a vector has, of four pairs, two.
static LANES_OF_PAIRS: [[u8; 8]; 256] = lanes_of_pairs();
/// Forwards, then backwards: see [`Direction::table`].
static LANES_BY_DIRECTION: [[[u8; 8]; 256]; 2] = [lanes_of(false), lanes_of(true)];

const fn lanes_of(backwards: bool) -> [[u8; 8]; 256] {
    let mut table = [[0; 8]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut i, mut end) = (0, 0);
        while i < 8 {
            let lane = if backwards { 7 - i } else { i };
            if mask >> lane & 1 != 0 {
                table[mask][end] = lane as u8;
                end += 1;
            }
            i += 1;
        }
        mask += 1;
    }
    table
}

const fn lanes_of_pairs() -> [[u8; 8]; 256] {
    let (in_order, mut table) = (lanes_of(false), [[0; 8]; 256]);
    let places = [0, 1, 4, 5, 2, 3, 6, 7];
    let mut mask = 0;
    while mask < 256 {
        let mut i = 0;
        while i < 8 {
            table[mask][i] = in_order[mask][places[i]];
            i += 1;
        }
        mask += 1;
    }
    table
}

// SAFETY of all blocks: the trait's contract, the set and readable or writable memory.
impl Simd for Avx2 {
    const N: usize = 8;
    const WRITES_OUT: bool = true;
    const SPECIALISED: bool = true;
    type F32x16 = Avx2F32x16;
    type Eight = Avx2;
    type Floats = __m256;
    type Places = __m256i;
    type Mask = __m256;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn splat(x: f32) -> __m256 {
        unsafe { _mm256_set1_ps(x) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn load(from: *const f32) -> __m256 {
        unsafe { _mm256_loadu_ps(from) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn store(to: *mut f32, x: __m256) {
        unsafe { _mm256_storeu_ps(to, x) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn add(a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_add_ps(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn sub(a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_sub_ps(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mul(a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_mul_ps(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn div(a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_div_ps(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mul_sub(a: __m256, b: __m256, c: __m256) -> __m256 {
        unsafe { _mm256_fmsub_ps(a, b, c) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn min(a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_min_ps(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn max(a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_max_ps(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn abs(a: __m256) -> __m256 {
        unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), a) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn le(a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn and(a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_and_ps(a, b) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn keep(mask: __m256, a: __m256) -> __m256 {
        unsafe { _mm256_and_ps(mask, a) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn select(mask: __m256, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_blendv_ps(b, a, mask) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mask(bits: u32) -> __m256 {
        unsafe {
            let lanes = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let own = _mm256_and_si256(_mm256_set1_epi32(bits as i32), lanes);
            _mm256_castsi256_ps(_mm256_cmpeq_epi32(own, lanes))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn bits(mask: __m256) -> u32 {
        unsafe { _mm256_movemask_ps(mask) as u32 }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn lane(of: __m256, lane: usize) -> f32 {
        unsafe { _mm256_cvtss_f32(_mm256_permutevar8x32_ps(of, _mm256_set1_epi32(lane as i32))) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn least(of: u32, a: __m256) -> u32 {
        unsafe {
            let a = _mm256_blendv_ps(_mm256_set1_ps(f32::INFINITY), a, Self::mask(of));
            let b = _mm256_min_ps(a, _mm256_permute2f128_ps::<1>(a, a));
            let b = _mm256_min_ps(b, _mm256_permute_ps::<0b01_00_11_10>(b));
            let b = _mm256_min_ps(b, _mm256_permute_ps::<0b10_11_00_01>(b));
            _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_EQ_OQ>(a, b)) as u32
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn lowest(of: __m256) -> f32 {
        unsafe {
            let a = _mm_min_ps(_mm256_castps256_ps128(of), _mm256_extractf128_ps::<1>(of));
            let a = _mm_min_ps(a, _mm_movehl_ps(a, a));
            _mm_cvtss_f32(_mm_min_ss(a, _mm_movehdup_ps(a)))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn highest(of: __m256) -> f32 {
        unsafe {
            let a = _mm_max_ps(_mm256_castps256_ps128(of), _mm256_extractf128_ps::<1>(of));
            let a = _mm_max_ps(a, _mm_movehl_ps(a, a));
            _mm_cvtss_f32(_mm_max_ss(a, _mm_movehdup_ps(a)))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn compress(of: __m256, bits: u32, to: *mut f32) {
        unsafe { _mm256_storeu_ps(to, _mm256_permutevar8x32_ps(of, lanes_at(bits))) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn split(bits: u32, from: &[*mut u32], to: &[*mut u32], left: usize, right: usize) {
        unsafe {
            let (lefts, rights) = (lanes_at(bits), lanes_at(!bits));
            for (&from, &to) in from.iter().zip(to) {
                let all = _mm256_loadu_si256(from.cast());
                let own = _mm256_permutevar8x32_epi32(all, lefts);
                _mm256_storeu_si256(to.add(left).cast(), own);
                let own = _mm256_permutevar8x32_epi32(all, rights);
                _mm256_storeu_si256(to.add(right).cast(), own);
            }
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn keep_least(keys: &mut LeastKeys, numbers: *const f32, points: *const u32, near: u32) {
        unsafe {
            // Signed comparisons do, since no key has the sign.
            let all = keys.0.as_mut_ptr().cast::<__m256i>();
            let (mut low, mut high) = (_mm256_load_si256(all), _mm256_load_si256(all.add(1)));
            let mut left = near;
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                let key = key_of(*numbers.add(lane), *points.add(lane));
                let key = _mm256_set1_epi64x(key as i64);
                // All one place further, after a least one.
                let turned = _mm256_permute4x64_epi64::<0b10_01_00_11>(low);
                let above = _mm256_permute4x64_epi64::<0b10_01_00_11>(high);
                let above = _mm256_blend_epi32::<0b11>(above, turned);
                let turned = _mm256_blend_epi32::<0b11>(turned, _mm256_setzero_si256());
                low = lesser(low, greater(turned, key));
                high = lesser(high, greater(above, key));
            }
            _mm256_store_si256(all, low);
            _mm256_store_si256(all.add(1), high);
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn equal(from: *const u32, number: u32) -> u32 {
        unsafe {
            let all = _mm256_loadu_si256(from.cast());
            let equal = _mm256_cmpeq_epi32(all, _mm256_set1_epi32(number as i32));
            _mm256_movemask_ps(_mm256_castsi256_ps(equal)) as u32
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn cull(children: *mut u32, t: *mut f32, count: usize, stop: f32) -> usize {
        unsafe {
            let mut end = 0;
            let mut i = 0;
            while i < count {
                // The memory after it may never have been written.
                let there = _mm256_set1_epi32((count - i).min(8) as i32);
                let there = _mm256_cmpgt_epi32(there, _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
                let x = _mm256_maskload_ps(t.add(i), there);
                let y = _mm256_maskload_epi32(children.add(i).cast(), there);
                let kept = _mm256_cmp_ps::<_CMP_LE_OQ>(x, _mm256_set1_ps(stop));
                let kept = _mm256_and_ps(kept, _mm256_castsi256_ps(there));
                let kept = _mm256_movemask_ps(kept) as u32;
                let lanes = LANES_OF[kept as usize & 0xff].as_ptr();
                let lanes = _mm256_cvtepu8_epi32(_mm_loadl_epi64(lanes.cast()));
                _mm256_storeu_ps(t.add(end), _mm256_permutevar8x32_ps(x, lanes));
                let y = _mm256_permutevar8x32_epi32(y, lanes);
                _mm256_storeu_si256(children.add(end).cast(), y);
                end += kept.count_ones() as usize;
                i += 8;
            }
            end
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn places(from: *const u8) -> __m256i {
        unsafe { _mm256_cvtepu8_epi32(_mm_loadl_epi64(from.cast())) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn look_up([low, high]: [__m256; 2], at: __m256i) -> __m256 {
        unsafe {
            let low = _mm256_permutevar8x32_ps(low, at);
            let high = _mm256_permutevar8x32_ps(high, at);
            // Bit 3 of a place names the table; where the sign is decides. (Compared with 7 it takes three operations more:
            // the compiler compares the bytes that places come from.)
            let which = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(at));
            _mm256_blendv_ps(low, high, which)
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn look_up_low(table: __m256, at: __m256i) -> __m256 {
        unsafe { _mm256_permutevar8x32_ps(table, at) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn transpose(from: *const f32, stride: usize, to: *mut f32, to_stride: usize) {
        unsafe {
            let (low, high) = (fours(from, stride), fours(from.add(4 * stride), stride));
            for k in 0..4 {
                let column = _mm256_permute2f128_ps::<0x20>(low[k], high[k]);
                _mm256_storeu_ps(to.add(k * to_stride), column);
                let column = _mm256_permute2f128_ps::<0x31>(low[k], high[k]);
                _mm256_storeu_ps(to.add((k + 4) * to_stride), column);
            }
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push(
        children: *const u32,
        t: __m256,
        mask: __m256,
        order: *const u8,
        direction: &Direction,
        to_children: *mut u32,
        to_t: *mut f32,
    ) -> u32 {
        unsafe { push(children, t, mask, order, direction, to_children, to_t).0 }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push_met(
        children: *const u32,
        enter: __m256,
        exit: __m256,
        order: *const u8,
        direction: &Direction,
        to_children: *mut u32,
        to_t: *mut f32,
    ) -> (u32, usize) {
        unsafe {
            let met = Self::le(enter, exit);
            push(children, enter, met, order, direction, to_children, to_t)
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push_met_alone(
        children: *const u32,
        enter: __m256,
        exit: __m256,
        order: *const u8,
        direction: &Direction,
        to_children: *mut u32,
        to_t: *mut f32,
    ) -> (u32, usize) {
        unsafe {
            let read = _mm_loadl_epi64(direction.places.as_ptr().cast());
            let places = _mm_shuffle_epi8(_mm_loadl_epi64(order.cast()), read);
            let places = _mm256_cvtepu8_epi32(places);
            let all = _mm256_permutevar8x32_epi32(_mm256_loadu_si256(children.cast()), places);
            // All children in order, after the one that is next where none is met: written long before it is known which to read.
            let mut waiting = MaybeUninit::<[u32; 9]>::uninit();
            let waiting = waiting.as_mut_ptr().cast::<u32>();
            *waiting = *to_children.sub(1);
            _mm256_storeu_si256(waiting.add(1).cast(), all);
            // In order first, then compared: what comes next waits for nothing but the comparison.
            let t = _mm256_permutevar8x32_ps(enter, places);
            let met = _mm256_cmp_ps::<_CMP_LE_OQ>(t, _mm256_permutevar8x32_ps(exit, places));
            let met = _mm256_movemask_ps(met) as u32;
            let next = *waiting.add(32).offset(-(met.leading_zeros() as isize));
            let lanes = LANES_OF.get_unchecked(met as usize).as_ptr();
            let lanes = _mm256_cvtepu8_epi32(_mm_loadl_epi64(lanes.cast()));
            _mm256_storeu_ps(to_t, _mm256_permutevar8x32_ps(t, lanes));
            _mm256_storeu_si256(to_children.cast(), _mm256_permutevar8x32_epi32(all, lanes));
            (next, met.count_ones() as usize)
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn pick([low, high]: [F32x4; 2], places: &[u32; 8], to: &mut [f32; 8]) {
        unsafe {
            let places = _mm256_loadu_si256(places.as_ptr().cast());
            let both = _mm256_set_m128(high.0, low.0);
            _mm256_storeu_ps(to.as_mut_ptr(), _mm256_permutevar8x32_ps(both, places));
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn product_error(a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_fmsub_ps(a, b, _mm256_mul_ps(a, b)) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push_pairs(first: __m256, second: *const u32, bits: u32, to: *mut [u32; 2]) {
        unsafe {
            let lanes = LANES_OF_PAIRS.get_unchecked(bits as usize & 0xff).as_ptr();
            let lanes = _mm256_cvtepu8_epi32(_mm_loadl_epi64(lanes.cast()));
            let second = _mm256_castsi256_ps(_mm256_loadu_si256(second.cast()));
            let first = _mm256_permutevar8x32_ps(first, lanes);
            let second = _mm256_permutevar8x32_ps(second, lanes);
            let to = to.cast::<f32>();
            _mm256_storeu_ps(to, _mm256_unpacklo_ps(first, second));
            _mm256_storeu_ps(to.add(8), _mm256_unpackhi_ps(first, second));
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push_nearest_last(
        children: *const u32,
        t: __m256,
        mask: __m256,
        to_children: *mut u32,
        to_t: *mut f32,
    ) -> usize {
        unsafe {
            // A lane's number in the last bits, so that it goes where its number goes. Lanes that are not in the mask come last.
            let lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            let keys = _mm256_andnot_ps(_mm256_castsi256_ps(_mm256_set1_epi32(7)), t);
            let keys = _mm256_or_ps(keys, _mm256_castsi256_ps(lanes));
            let keys = _mm256_blendv_ps(_mm256_set1_ps(f32::NEG_INFINITY), keys, mask);
            // A bitonic network, the greatest first.
            let keys = exchanged::<0b1010_1010>(keys, _mm256_permute_ps::<0b10_11_00_01>(keys));
            let keys = exchanged::<0b1100_1100>(keys, _mm256_permute_ps::<0b00_01_10_11>(keys));
            let keys = exchanged::<0b1010_1010>(keys, _mm256_permute_ps::<0b10_11_00_01>(keys));
            let back = _mm256_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0);
            let keys = exchanged::<0b1111_0000>(keys, _mm256_permutevar8x32_ps(keys, back));
            let keys = exchanged::<0b1100_1100>(keys, _mm256_permute_ps::<0b01_00_11_10>(keys));
            let keys = exchanged::<0b1010_1010>(keys, _mm256_permute_ps::<0b10_11_00_01>(keys));
            // Of places only the last three bits count.
            let places = _mm256_castps_si256(keys);
            _mm256_storeu_ps(to_t, _mm256_permutevar8x32_ps(t, places));
            let all = _mm256_loadu_si256(children.cast());
            let all = _mm256_permutevar8x32_epi32(all, places);
            _mm256_storeu_si256(to_children.cast(), all);
            _mm256_movemask_ps(mask).count_ones() as usize
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn call<T: Compiled>(task: T) -> T::Output {
        unsafe { in_its_own_function(task) }
    }
}

/// The lanes of a mask, consecutively.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn lanes_at(bits: u32) -> __m256i {
    unsafe {
        let lanes = LANES_OF.get_unchecked(bits as usize & 0xff).as_ptr();
        _mm256_cvtepu8_epi32(_mm_loadl_epi64(lanes.cast()))
    }
}

/// The lesser of two numbers in the lanes of `LESSER`, the greater in the others.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn exchanged<const LESSER: i32>(a: __m256, b: __m256) -> __m256 {
    unsafe { _mm256_blend_ps::<LESSER>(_mm256_max_ps(a, b), _mm256_min_ps(a, b)) }
}

/// The lesser of whole numbers of 64 bits.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn lesser(a: __m256i, b: __m256i) -> __m256i {
    unsafe { _mm256_blendv_epi8(a, b, _mm256_cmpgt_epi64(a, b)) }
}

/// The greater ones.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn greater(a: __m256i, b: __m256i) -> __m256i {
    unsafe { _mm256_blendv_epi8(b, a, _mm256_cmpgt_epi64(a, b)) }
}

/// A function compiled for the set.
#[inline(never)]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
unsafe fn in_its_own_function<T: Compiled>(task: T) -> T::Output {
    // SAFETY: the caller's contract.
    unsafe { task.run::<Avx2>() }
}

/// [`Simd::push`], and how many count. The mask is brought into the stored order, whose direction matters only for which table
/// says where its lanes go.
///
/// # Safety
/// As for [`Simd::push`].
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn push(
    children: *const u32,
    t: __m256,
    mask: __m256,
    order: *const u8,
    direction: &Direction,
    to_children: *mut u32,
    to_t: *mut f32,
) -> (u32, usize) {
    unsafe {
        let stored = _mm_loadl_epi64(order.cast());
        let in_order = _mm256_permutevar8x32_ps(mask, _mm256_cvtepu8_epi32(stored));
        let in_order = _mm256_movemask_ps(in_order) as u32;
        let count = in_order.count_ones() as usize;
        let tables = LANES_BY_DIRECTION.as_ptr().cast::<u8>();
        let lanes = tables.add(8 * (in_order + direction.table) as usize);
        let places = _mm_shuffle_epi8(stored, _mm_loadl_epi64(lanes.cast()));
        let places = _mm256_cvtepu8_epi32(places);
        _mm256_storeu_ps(to_t, _mm256_permutevar8x32_ps(t, places));
        let all = _mm256_loadu_si256(children.cast());
        let met = _mm256_permutevar8x32_epi32(all, places);
        _mm256_storeu_si256(to_children.cast(), met);
        let last = *lanes.add(count.wrapping_sub(1) & 7) as usize;
        (*children.add(*order.add(last) as usize), count)
    }
}

/// Four rows as columns of four: the k-th vector has, in each half, a column.
///
/// # Safety
/// The processor must have the set, the rows must be readable.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn fours(from: *const f32, stride: usize) -> [__m256; 4] {
    unsafe {
        let a = _mm256_loadu_ps(from);
        let b = _mm256_loadu_ps(from.add(stride));
        let c = _mm256_loadu_ps(from.add(2 * stride));
        let d = _mm256_loadu_ps(from.add(3 * stride));
        let (ab_low, ab_high) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
        let (cd_low, cd_high) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
        [
            _mm256_shuffle_ps::<0x44>(ab_low, cd_low),
            _mm256_shuffle_ps::<0xee>(ab_low, cd_low),
            _mm256_shuffle_ps::<0x44>(ab_high, cd_high),
            _mm256_shuffle_ps::<0xee>(ab_high, cd_high),
        ]
    }
}
