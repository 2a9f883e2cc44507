//! 8 lanes: two vectors of four of NEON, which every 64-bit Arm processor has.

#![allow(clippy::undocumented_unsafe_blocks, reason = "one contract for all, that of the trait")]

use core::arch::aarch64::*;

use super::f32x16::ArrayF32x16;
use super::portable;
use super::references::ReferenceOps;
use super::{Direction, Simd};

/// [`Simd`] by NEON.
#[derive(Clone, Copy)]
pub(crate) struct Neon;

type Floats = [float32x4_t; 2];
type Mask = [uint32x4_t; 2];

macro_rules! each {
    ($of:expr) => {
        [$of(0), $of(1)]
    };
}

impl ReferenceOps for Neon {}

// SAFETY of all blocks: the trait's contract, readable or writable memory.
impl Simd for Neon {
    const N: usize = 8;
    const WRITES_OUT: bool = true;
    const SPECIALISED: bool = true;
    type F32x16 = ArrayF32x16;
    type Eight = Neon;
    type Floats = Floats;
    /// The bytes of each lane's element in a table of 64.
    type Places = [uint8x16_t; 2];
    type Mask = Mask;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn splat(x: f32) -> Floats {
        unsafe { [vdupq_n_f32(x); 2] }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn load(from: *const f32) -> Floats {
        unsafe { each!(|i: usize| vld1q_f32(from.add(4 * i))) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn store(to: *mut f32, x: Floats) {
        unsafe {
            vst1q_f32(to, x[0]);
            vst1q_f32(to.add(4), x[1]);
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn add(a: Floats, b: Floats) -> Floats {
        unsafe { each!(|i: usize| vaddq_f32(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn sub(a: Floats, b: Floats) -> Floats {
        unsafe { each!(|i: usize| vsubq_f32(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mul(a: Floats, b: Floats) -> Floats {
        unsafe { each!(|i: usize| vmulq_f32(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn div(a: Floats, b: Floats) -> Floats {
        unsafe { each!(|i: usize| vdivq_f32(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mul_sub(a: Floats, b: Floats, c: Floats) -> Floats {
        unsafe { each!(|i: usize| vfmaq_f32(vnegq_f32(c[i]), a[i], b[i])) }
    }
    // Not `vminq_f32`: it gives no number where either is none.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn min(a: Floats, b: Floats) -> Floats {
        unsafe { each!(|i: usize| vbslq_f32(vcltq_f32(a[i], b[i]), a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn max(a: Floats, b: Floats) -> Floats {
        unsafe { each!(|i: usize| vbslq_f32(vcgtq_f32(a[i], b[i]), a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn abs(a: Floats) -> Floats {
        unsafe { each!(|i: usize| vabsq_f32(a[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn le(a: Floats, b: Floats) -> Mask {
        unsafe { each!(|i: usize| vcleq_f32(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn and(a: Mask, b: Mask) -> Mask {
        unsafe { each!(|i: usize| vandq_u32(a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn keep(mask: Mask, a: Floats) -> Floats {
        unsafe {
            each!(|i: usize| {
                vreinterpretq_f32_u32(vandq_u32(mask[i], vreinterpretq_u32_f32(a[i])))
            })
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn select(mask: Mask, a: Floats, b: Floats) -> Floats {
        unsafe { each!(|i: usize| vbslq_f32(mask[i], a[i], b[i])) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn bits(mask: Mask) -> u32 {
        unsafe {
            let (low, high) = (vld1q_u32(BITS.as_ptr()), vld1q_u32(BITS.as_ptr().add(4)));
            vaddvq_u32(vorrq_u32(vandq_u32(mask[0], low), vandq_u32(mask[1], high)))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mask(bits: u32) -> Mask {
        unsafe {
            let all = vdupq_n_u32(bits);
            each!(|i: usize| vtstq_u32(all, vld1q_u32(BITS.as_ptr().add(4 * i))))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn least(of: u32, a: Floats) -> u32 {
        unsafe {
            let a = Self::select(Self::mask(of), a, Self::splat(f32::INFINITY));
            let least = vdupq_n_f32(vminvq_f32(vminq_f32(a[0], a[1])));
            Self::bits(each!(|i: usize| vceqq_f32(a[i], least)))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn equal(from: *const u32, number: u32) -> u32 {
        unsafe {
            let number = vdupq_n_u32(number);
            Self::bits(each!(|i: usize| vceqq_u32(vld1q_u32(from.add(4 * i)), number)))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn cull(children: *mut u32, t: *mut f32, count: usize, stop: f32) -> usize {
        unsafe { portable::cull(children, t, count, stop) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn places(from: *const u8) -> [uint8x16_t; 2] {
        unsafe {
            let places = vld1_u8(from);
            let places = vcombine_u8(places, places);
            let within = vld1q_u8(WITHIN.as_ptr());
            each!(|i: usize| {
                // Each place four times, times four, and the bytes within.
                let four = vqtbl1q_u8(places, vld1q_u8(FOURS.as_ptr().add(16 * i)));
                vorrq_u8(vshlq_n_u8::<2>(four), within)
            })
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn look_up([low, high]: [Floats; 2], at: [uint8x16_t; 2]) -> Floats {
        unsafe {
            let table = uint8x16x4_t(
                vreinterpretq_u8_f32(low[0]),
                vreinterpretq_u8_f32(low[1]),
                vreinterpretq_u8_f32(high[0]),
                vreinterpretq_u8_f32(high[1]),
            );
            each!(|i: usize| vreinterpretq_f32_u8(vqtbl4q_u8(table, at[i])))
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn transpose(from: *const f32, stride: usize, to: *mut f32, to_stride: usize) {
        unsafe { portable::transpose(from, stride, to, to_stride) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push(
        children: *const u32,
        t: Floats,
        mask: Mask,
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
    unsafe fn product_error(a: Floats, b: Floats) -> Floats {
        unsafe { each!(|i: usize| vfmaq_f32(vnegq_f32(vmulq_f32(a[i], b[i])), a[i], b[i])) }
    }
}

/// A bit for each lane.
static BITS: [u32; 8] = [1, 2, 4, 8, 16, 32, 64, 128];
/// The bytes of a word.
static WITHIN: [u8; 16] = [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3];
/// Each lane four times.
#[rustfmt::skip]
static FOURS: [u8; 32] = [
    0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 5, 5, 5, 5, 6, 6, 6, 6, 7, 7, 7, 7,
];
