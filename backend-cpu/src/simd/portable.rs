//! 8 lanes in plain Rust, which compilers turn into what the target has.

#![allow(clippy::undocumented_unsafe_blocks, reason = "one contract for all, that of the trait")]

use super::f32x16::ArrayF32x16;
use super::references::ReferenceOps;
use super::{Direction, Simd};

/// [`Simd`] by loops over arrays. Sets with intrinsics take its place where every processor has them.
#[derive(Clone, Copy)]
#[cfg_attr(
    not(test),
    allow(dead_code, reason = "not on targets whose every processor has vectors")
)]
pub(crate) struct Portable;

const N: usize = 8;

/// One lane after the other.
#[cfg_attr(not(unoptimised), inline(always))]
fn each<T>(of: impl FnMut(usize) -> T) -> [T; N] {
    core::array::from_fn(of)
}

impl ReferenceOps for Portable {}

// SAFETY of all blocks: the trait's contract, readable or writable memory.
impl Simd for Portable {
    const N: usize = N;
    type F32x16 = ArrayF32x16;
    type Eight = Portable;
    type Floats = [f32; N];
    type Places = [u8; N];
    type Mask = [bool; N];

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn splat(x: f32) -> [f32; N] {
        [x; N]
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn load(from: *const f32) -> [f32; N] {
        unsafe { from.cast::<[f32; N]>().read_unaligned() }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn store(to: *mut f32, x: [f32; N]) {
        unsafe { to.cast::<[f32; N]>().write_unaligned(x) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn add(a: [f32; N], b: [f32; N]) -> [f32; N] {
        each(|i| a[i] + b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn sub(a: [f32; N], b: [f32; N]) -> [f32; N] {
        each(|i| a[i] - b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mul(a: [f32; N], b: [f32; N]) -> [f32; N] {
        each(|i| a[i] * b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn div(a: [f32; N], b: [f32; N]) -> [f32; N] {
        each(|i| a[i] / b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mul_sub(a: [f32; N], b: [f32; N], c: [f32; N]) -> [f32; N] {
        each(|i| a[i] * b[i] - c[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn min(a: [f32; N], b: [f32; N]) -> [f32; N] {
        each(|i| if a[i] < b[i] { a[i] } else { b[i] })
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn max(a: [f32; N], b: [f32; N]) -> [f32; N] {
        each(|i| if a[i] > b[i] { a[i] } else { b[i] })
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn abs(a: [f32; N]) -> [f32; N] {
        each(|i| a[i].abs())
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn le(a: [f32; N], b: [f32; N]) -> [bool; N] {
        each(|i| a[i] <= b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn and(a: [bool; N], b: [bool; N]) -> [bool; N] {
        each(|i| a[i] & b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn keep(mask: [bool; N], a: [f32; N]) -> [f32; N] {
        each(|i| if mask[i] { a[i] } else { 0.0 })
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn select(mask: [bool; N], a: [f32; N], b: [f32; N]) -> [f32; N] {
        each(|i| if mask[i] { a[i] } else { b[i] })
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn mask(bits: u32) -> [bool; N] {
        each(|i| bits >> i & 1 != 0)
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn bits(mask: [bool; N]) -> u32 {
        (0..N).fold(0, |bits, i| bits | u32::from(mask[i]) << i)
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn least(of: u32, a: [f32; N]) -> u32 {
        let mut least = f32::INFINITY;
        for i in 0..N {
            least = if of >> i & 1 != 0 && a[i] < least { a[i] } else { least };
        }
        (0..N).fold(0, |bits, i| bits | u32::from(a[i] == least) << i)
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn cull(children: *mut u32, t: *mut f32, count: usize, stop: f32) -> usize {
        unsafe { cull(children, t, count, stop) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn places(from: *const u8) -> [u8; N] {
        unsafe { from.cast::<[u8; N]>().read_unaligned() }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn look_up(tables: [[f32; N]; 2], at: [u8; N]) -> [f32; N] {
        let table = tables.as_flattened();
        each(|i| table[at[i] as usize % (2 * N)])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn transpose(from: *const f32, stride: usize, to: *mut f32, to_stride: usize) {
        unsafe { transpose(from, stride, to, to_stride) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn push(
        children: *const u32,
        t: [f32; N],
        mask: [bool; N],
        order: *const u8,
        direction: &Direction,
        to_children: *mut u32,
        to_t: *mut f32,
    ) -> u32 {
        unsafe { push(children, &t, Self::bits(mask), order, direction, to_children, to_t) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn product_error(a: [f32; N], b: [f32; N]) -> [f32; N] {
        // 24 + 24 bits fit the 53 of an f64.
        each(|i| (f64::from(a[i]) * f64::from(b[i]) - f64::from(a[i] * b[i])) as f32)
    }
}

/// [`Simd::cull`] of any set of eight lanes.
///
/// # Safety
/// As there.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn cull(children: *mut u32, t: *mut f32, count: usize, stop: f32) -> usize {
    let mut end = 0;
    for i in 0..count {
        unsafe {
            let x = *t.add(i);
            (*t.add(end), *children.add(end)) = (x, *children.add(i));
            end += usize::from(x <= stop);
        }
    }
    end
}

/// [`Simd::transpose`] of any set of eight lanes.
///
/// # Safety
/// As there.
#[cfg_attr(not(unoptimised), inline(always))]
#[cfg_attr(target_arch = "x86_64", allow(dead_code, reason = "SSE2 has its own"))]
pub(super) unsafe fn transpose(from: *const f32, stride: usize, to: *mut f32, to_stride: usize) {
    for i in 0..N {
        for k in 0..N {
            unsafe { *to.add(k * to_stride + i) = *from.add(i * stride + k) }
        }
    }
}

/// [`Simd::push`] of any set of eight lanes: `numbers` are the lanes of `t`, `met` is the mask.
///
/// # Safety
/// As there.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn push(
    children: *const u32,
    numbers: &[f32; N],
    met: u32,
    order: *const u8,
    direction: &Direction,
    to_children: *mut u32,
    to_t: *mut f32,
) -> u32 {
    let (mut end, mut last) = (0, 0);
    for i in 0..N {
        unsafe {
            let place = *order.add(direction.places[i] as usize) as usize % N;
            let child = *children.add(place);
            *to_children.add(end) = child;
            *to_t.add(end) = numbers[place];
            let counts = met >> place & 1;
            end += counts as usize;
            last = if counts != 0 { child } else { last };
        }
    }
    last
}
