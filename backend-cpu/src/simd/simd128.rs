//! 8 lanes: two vectors of four of WebAssembly, for programs that are compiled with `-C target-feature=+simd128`. What a browser makes
//! of them rounds each operation by itself, as scalar code does.

#![allow(clippy::undocumented_unsafe_blocks, reason = "one contract for all, that of the trait")]

use core::arch::wasm32::*;

use super::f32x16::ArrayF32x16;
use super::portable;
use super::references::ReferenceOps;
use super::{Direction, Simd};

/// [`Simd`] by WebAssembly's vectors.
#[derive(Clone, Copy)]
pub(crate) struct Simd128;

/// Eight lanes of floats, or of masks: all bits of a lane or none.
type Lanes = [v128; 2];

macro_rules! each {
    ($of:expr) => {
        [$of(0), $of(1)]
    };
}

impl ReferenceOps for Simd128 {}

// SAFETY of all blocks: the trait's contract, readable or writable memory.
impl Simd for Simd128 {
    const N: usize = 8;
    type F32x16 = ArrayF32x16;
    type Eight = Simd128;
    type Floats = Lanes;
    /// The bytes of each lane's element in a table of 64.
    type Places = Lanes;
    type Mask = Lanes;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn splat(x: f32) -> Lanes {
        [f32x4_splat(x); 2]
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn load(from: *const f32) -> Lanes {
        unsafe { each!(|i: usize| v128_load(from.add(4 * i).cast())) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn store(to: *mut f32, x: Lanes) {
        unsafe {
            v128_store(to.cast(), x[0]);
            v128_store(to.add(4).cast(), x[1]);
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn add(a: Lanes, b: Lanes) -> Lanes {
        each!(|i: usize| f32x4_add(a[i], b[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn sub(a: Lanes, b: Lanes) -> Lanes {
        each!(|i: usize| f32x4_sub(a[i], b[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mul(a: Lanes, b: Lanes) -> Lanes {
        each!(|i: usize| f32x4_mul(a[i], b[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn div(a: Lanes, b: Lanes) -> Lanes {
        each!(|i: usize| f32x4_div(a[i], b[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mul_sub(a: Lanes, b: Lanes, c: Lanes) -> Lanes {
        each!(|i: usize| f32x4_sub(f32x4_mul(a[i], b[i]), c[i]))
    }
    // `f32x4_pmin(x, y)` is `y` where `y < x`, else `x`; `f32x4_min` would give no number where either is none.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn min(a: Lanes, b: Lanes) -> Lanes {
        each!(|i: usize| f32x4_pmin(b[i], a[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn max(a: Lanes, b: Lanes) -> Lanes {
        each!(|i: usize| f32x4_pmax(b[i], a[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn abs(a: Lanes) -> Lanes {
        each!(|i: usize| f32x4_abs(a[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn le(a: Lanes, b: Lanes) -> Lanes {
        each!(|i: usize| f32x4_le(a[i], b[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn and(a: Lanes, b: Lanes) -> Lanes {
        each!(|i: usize| v128_and(a[i], b[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn keep(mask: Lanes, a: Lanes) -> Lanes {
        each!(|i: usize| v128_and(mask[i], a[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn select(mask: Lanes, a: Lanes, b: Lanes) -> Lanes {
        each!(|i: usize| v128_bitselect(a[i], b[i], mask[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn bits(mask: Lanes) -> u32 {
        u32::from(i32x4_bitmask(mask[0])) | u32::from(i32x4_bitmask(mask[1])) << 4
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mask(bits: u32) -> Lanes {
        let all = u32x4_splat(bits);
        let lanes = [u32x4(1, 2, 4, 8), u32x4(16, 32, 64, 128)];
        each!(|i: usize| u32x4_ne(v128_and(all, lanes[i]), u32x4_splat(0)))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn least(of: u32, a: Lanes) -> u32 {
        unsafe {
            let a = Self::select(Self::mask(of), a, Self::splat(f32::INFINITY));
            let least = f32x4_pmin(a[0], a[1]);
            let least = f32x4_pmin(least, i32x4_shuffle::<2, 3, 0, 1>(least, least));
            let least = f32x4_pmin(least, i32x4_shuffle::<1, 0, 3, 2>(least, least));
            Self::bits(each!(|i: usize| f32x4_eq(a[i], least)))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn equal(from: *const u32, number: u32) -> u32 {
        let number = u32x4_splat(number);
        unsafe { Self::bits(each!(|i: usize| u32x4_eq(v128_load(from.add(4 * i).cast()), number))) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn cull(children: *mut u32, t: *mut f32, count: usize, stop: f32) -> usize {
        unsafe { portable::cull(children, t, count, stop) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn places(from: *const u8) -> Lanes {
        let places = unsafe { v128_load64_zero(from.cast()) };
        // Each place four times, times four, and the bytes within.
        let low = i8x16_shuffle::<0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3>(places, places);
        let high = i8x16_shuffle::<4, 4, 4, 4, 5, 5, 5, 5, 6, 6, 6, 6, 7, 7, 7, 7>(places, places);
        let within = u32x4_splat(0x0302_0100);
        [low, high].map(|four| v128_or(u8x16_shl(four, 2), within))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn look_up([low, high]: [Lanes; 2], at: Lanes) -> Lanes {
        each!(|i: usize| {
            // A place outside of a quarter of the table gives 0 there.
            let in_quarter = |quarter: v128, first: u8| {
                i8x16_swizzle(quarter, u8x16_sub(at[i], u8x16_splat(first)))
            };
            let lower = v128_or(in_quarter(low[0], 0), in_quarter(low[1], 16));
            let upper = v128_or(in_quarter(high[0], 32), in_quarter(high[1], 48));
            v128_or(lower, upper)
        })
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn transpose(from: *const f32, stride: usize, to: *mut f32, to_stride: usize) {
        unsafe { portable::transpose(from, stride, to, to_stride) }
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
        let of_two = |a: v128, b: v128, product: v128| {
            let exact = f64x2_mul(f64x2_promote_low_f32x4(a), f64x2_promote_low_f32x4(b));
            f32x4_demote_f64x2_zero(f64x2_sub(exact, f64x2_promote_low_f32x4(product)))
        };
        let upper = |x: v128| i64x2_shuffle::<1, 0>(x, x);
        each!(|i: usize| {
            let product = f32x4_mul(a[i], b[i]);
            let low = of_two(a[i], b[i], product);
            let high = of_two(upper(a[i]), upper(b[i]), upper(product));
            i64x2_shuffle::<0, 2>(low, high)
        })
    }
}
