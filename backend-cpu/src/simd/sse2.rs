//! 8 lanes: two vectors of four of SSE2, which every x86-64 processor has.

#![allow(clippy::undocumented_unsafe_blocks, reason = "one contract for all, that of the trait")]

use core::arch::x86_64::*;

use super::f32x16::ArrayF32x16;
use super::portable;
use super::references::ReferenceOps;
use super::{Direction, Simd};

/// [`Simd`] by SSE2.
#[derive(Clone, Copy)]
pub(crate) struct Sse2;

/// Eight lanes of floats, or of masks: all bits of a lane or none.
type Lanes = [__m128; 2];

macro_rules! each {
    ($of:expr) => {
        [$of(0), $of(1)]
    };
}

impl ReferenceOps for Sse2 {}

// SAFETY of all blocks: the trait's contract, readable or writable memory.
impl Simd for Sse2 {
    const N: usize = 8;
    type F32x16 = ArrayF32x16;
    type Eight = Sse2;
    type Floats = Lanes;
    /// A byte a lane.
    type Places = u64;
    type Mask = Lanes;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn splat(x: f32) -> Lanes {
        unsafe { [_mm_set1_ps(x); 2] }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn load(from: *const f32) -> Lanes {
        unsafe { each!(|i: usize| _mm_loadu_ps(from.add(4 * i))) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn store(to: *mut f32, x: Lanes) {
        unsafe {
            _mm_storeu_ps(to, x[0]);
            _mm_storeu_ps(to.add(4), x[1]);
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn add(a: Lanes, b: Lanes) -> Lanes {
        unsafe { each!(|i: usize| _mm_add_ps(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn sub(a: Lanes, b: Lanes) -> Lanes {
        unsafe { each!(|i: usize| _mm_sub_ps(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mul(a: Lanes, b: Lanes) -> Lanes {
        unsafe { each!(|i: usize| _mm_mul_ps(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn div(a: Lanes, b: Lanes) -> Lanes {
        unsafe { each!(|i: usize| _mm_div_ps(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mul_sub(a: Lanes, b: Lanes, c: Lanes) -> Lanes {
        unsafe { each!(|i: usize| _mm_sub_ps(_mm_mul_ps(a[i], b[i]), c[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn min(a: Lanes, b: Lanes) -> Lanes {
        unsafe { each!(|i: usize| _mm_min_ps(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn max(a: Lanes, b: Lanes) -> Lanes {
        unsafe { each!(|i: usize| _mm_max_ps(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn abs(a: Lanes) -> Lanes {
        unsafe { each!(|i: usize| _mm_andnot_ps(_mm_set1_ps(-0.0), a[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn le(a: Lanes, b: Lanes) -> Lanes {
        unsafe { each!(|i: usize| _mm_cmple_ps(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn and(a: Lanes, b: Lanes) -> Lanes {
        unsafe { each!(|i: usize| _mm_and_ps(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn keep(mask: Lanes, a: Lanes) -> Lanes {
        unsafe { each!(|i: usize| _mm_and_ps(mask[i], a[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn select(mask: Lanes, a: Lanes, b: Lanes) -> Lanes {
        unsafe {
            each!(|i: usize| _mm_or_ps(_mm_and_ps(mask[i], a[i]), _mm_andnot_ps(mask[i], b[i])))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mask(bits: u32) -> Lanes {
        unsafe {
            let all = _mm_set1_epi32(bits as i32);
            let lanes = [_mm_setr_epi32(1, 2, 4, 8), _mm_setr_epi32(16, 32, 64, 128)];
            each!(|i: usize| _mm_castsi128_ps(_mm_cmpeq_epi32(
                _mm_and_si128(all, lanes[i]),
                lanes[i]
            )))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn bits(mask: Lanes) -> u32 {
        unsafe { (_mm_movemask_ps(mask[0]) | _mm_movemask_ps(mask[1]) << 4) as u32 }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn least(of: u32, a: Lanes) -> u32 {
        unsafe {
            let a = Self::select(Self::mask(of), a, Self::splat(f32::INFINITY));
            let least = _mm_set1_ps(lowest(a));
            Self::bits(each!(|i: usize| _mm_cmpeq_ps(a[i], least)))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn lowest(of: Lanes) -> f32 {
        unsafe { lowest(of) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn highest(of: Lanes) -> f32 {
        unsafe {
            let a = _mm_max_ps(of[0], of[1]);
            let a = _mm_max_ps(a, _mm_movehl_ps(a, a));
            _mm_cvtss_f32(_mm_max_ss(a, _mm_shuffle_ps::<1>(a, a)))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn equal(from: *const u32, number: u32) -> u32 {
        unsafe {
            let number = _mm_set1_epi32(number as i32);
            Self::bits(each!(|i: usize| {
                let four = _mm_loadu_si128(from.add(4 * i).cast());
                _mm_castsi128_ps(_mm_cmpeq_epi32(four, number))
            }))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn cull(children: *mut u32, t: *mut f32, count: usize, stop: f32) -> usize {
        unsafe { portable::cull(children, t, count, stop) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn places(from: *const u8) -> u64 {
        unsafe { from.cast::<u64>().read_unaligned() }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn look_up(tables: [Lanes; 2], at: u64) -> Lanes {
        unsafe {
            let mut table = [0.0; 16];
            Self::store(table.as_mut_ptr(), tables[0]);
            Self::store(table.as_mut_ptr().add(8), tables[1]);
            let of = |lane: usize| table[(at >> (8 * lane)) as usize % 16];
            each!(|i: usize| _mm_setr_ps(of(4 * i), of(4 * i + 1), of(4 * i + 2), of(4 * i + 3)))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn look_up_low(table: Lanes, at: u64) -> Lanes {
        unsafe {
            let mut row = [0.0; 8];
            Self::store(row.as_mut_ptr(), table);
            let of = |lane: usize| row[(at >> (8 * lane)) as usize % 8];
            each!(|i: usize| _mm_setr_ps(of(4 * i), of(4 * i + 1), of(4 * i + 2), of(4 * i + 3)))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn transpose(from: *const f32, stride: usize, to: *mut f32, to_stride: usize) {
        unsafe {
            for (row, column) in [(0, 0), (0, 4), (4, 0), (4, 4)] {
                let at = |i: usize| _mm_loadu_ps(from.add((row + i) * stride + column));
                let [mut a, mut b, mut c, mut d] = [at(0), at(1), at(2), at(3)];
                _MM_TRANSPOSE4_PS(&mut a, &mut b, &mut c, &mut d);
                for (k, four) in [a, b, c, d].into_iter().enumerate() {
                    _mm_storeu_ps(to.add((column + k) * to_stride + row), four);
                }
            }
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push(
        children: *const u32,
        t: Lanes,
        mask: Lanes,
        order: *const u8,
        direction: &Direction,
        to_children: *mut u32,
        to_t: *mut f32,
    ) -> u32 {
        unsafe {
            let mut numbers = [0.0; 8];
            Self::store(numbers.as_mut_ptr(), t);
            let met = Self::bits(mask);
            portable::push(children, &numbers, met, order, direction, to_children, to_t)
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn product_error(a: Lanes, b: Lanes) -> Lanes {
        // 24 + 24 bits fit the 53 of an f64.
        unsafe {
            let of_two = |a: __m128, b: __m128, product: __m128| {
                let exact = _mm_mul_pd(_mm_cvtps_pd(a), _mm_cvtps_pd(b));
                _mm_cvtpd_ps(_mm_sub_pd(exact, _mm_cvtps_pd(product)))
            };
            let upper = |x: __m128| _mm_movehl_ps(x, x);
            each!(|i: usize| {
                let product = _mm_mul_ps(a[i], b[i]);
                let low = of_two(a[i], b[i], product);
                _mm_movelh_ps(low, of_two(upper(a[i]), upper(b[i]), upper(product)))
            })
        }
    }
}

/// The least of all lanes, none of which is no number.
///
/// # Safety
/// None is needed: SSE2 is part of x86-64.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn lowest(of: Lanes) -> f32 {
    unsafe {
        let a = _mm_min_ps(of[0], of[1]);
        let a = _mm_min_ps(a, _mm_movehl_ps(a, a));
        _mm_cvtss_f32(_mm_min_ss(a, _mm_shuffle_ps::<1>(a, a)))
    }
}
