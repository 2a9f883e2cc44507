//! What the traversal asks of an instruction set, so that it is written once for all of them.
//!
//! A vector has [`Simd::N`] lanes. A node's children, a block's triangles, and in [`super::packet`]
//! a group's rays are lanes. Sums, differences, products and quotients round each by itself, as
//! scalar code does: only [`Simd::mul_sub`] may be fused, and nothing that decides a
//! hit is made with it. So every set gives the same hits.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "aarch64")]
mod neon;
mod portable;

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) use avx512::Avx512;
#[cfg(target_arch = "aarch64")]
pub(crate) use neon::Neon;
pub(crate) use portable::Portable;

use super::instruction_set::InstructionSet;

/// The most lanes of any set.
pub(crate) const MOST_LANES: usize = 16;

/// Whether an order is read forwards or backwards.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
pub(crate) struct Direction {
    /// Where each place of the order is.
    pub places: [u8; MOST_LANES],
}

impl Direction {
    /// For orders of so many.
    pub const fn new(lanes: usize, backwards: bool) -> Direction {
        let mut places = [0; MOST_LANES];
        let mut i = 0;
        while i < lanes {
            places[i] = if backwards { lanes - 1 - i } else { i } as u8;
            i += 1;
        }
        Direction { places }
    }
}

/// An instruction set.
///
/// # Safety
/// All methods: the processor must have the set, and pointers must be good for as many elements as
/// the method says; none needs alignment.
pub(crate) trait Simd: Copy {
    /// Lanes.
    const N: usize;
    /// Which it is.
    const SET: InstructionSet;
    /// `N` floats.
    type Floats: Copy;
    /// `N` places in a table of `2 N`, from `N` bytes.
    type Places: Copy;
    /// `N` yes or no.
    type Mask: Copy;
    /// Three rows of 32 words.
    type Corners: Copy;

    /// All words 0.
    fn no_corners() -> Self::Corners;
    /// The same number in all lanes.
    unsafe fn splat(x: f32) -> Self::Floats;
    /// `N` floats from memory.
    unsafe fn load(from: *const f32) -> Self::Floats;
    /// `N` floats to memory.
    unsafe fn store(to: *mut f32, x: Self::Floats);
    /// Sums.
    unsafe fn add(a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// Differences.
    unsafe fn sub(a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// Products.
    unsafe fn mul(a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// Quotients.
    unsafe fn div(a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// `a * b - c`, rounded once or twice.
    unsafe fn mul_sub(a: Self::Floats, b: Self::Floats, c: Self::Floats) -> Self::Floats;
    /// `a` where it is less than `b`, else `b`: so `b` where either is no number.
    unsafe fn min(a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// `a` where it is greater than `b`, else `b`.
    unsafe fn max(a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// Magnitudes.
    unsafe fn abs(a: Self::Floats) -> Self::Floats;
    /// Where `a <= b`; not where either is no number.
    unsafe fn le(a: Self::Floats, b: Self::Floats) -> Self::Mask;
    /// Both.
    unsafe fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// `a` where the mask says so, else 0.
    unsafe fn keep(mask: Self::Mask, a: Self::Floats) -> Self::Floats;
    /// `a` where the mask says so, else `b`.
    unsafe fn select(mask: Self::Mask, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// A bit a lane, the first lane lowest.
    unsafe fn bits(mask: Self::Mask) -> u32;
    /// The mask of such bits.
    unsafe fn mask(bits: u32) -> Self::Mask;
    /// The lanes of `of` (none of which is no number) with the least number of theirs, as bits; others may
    /// be among them.
    unsafe fn least(of: u32, a: Self::Floats) -> u32;
    /// Keeps, of `count` entries, those with a `t` of at most `stop`, in their order; how many. May read
    /// and write `N` entries more.
    unsafe fn cull(children: *mut u32, t: *mut f32, count: usize, stop: f32) -> usize;
    /// Places from `N` bytes, each below 2 `N`, or anything where the result does not matter.
    unsafe fn places(from: *const u8) -> Self::Places;
    /// Elements of a table of `2 N`.
    unsafe fn look_up(table: [Self::Floats; 2], at: Self::Places) -> Self::Floats;
    /// Puts words into a column of 32, and gives the first column that has them all.
    unsafe fn put_and_find(corners: &mut Self::Corners, words: [u32; 3], column: usize) -> usize;
    /// The columns, row by row.
    unsafe fn columns(corners: &Self::Corners) -> [[u32; 2 * MOST_LANES]; 3];
    /// Turns `N` rows of `N` floats, `stride` apart, into rows of what stood in columns, `to_stride`
    /// apart.
    unsafe fn transpose(from: *const f32, stride: usize, to: *mut f32, to_stride: usize);
    /// Writes the children of a mask to the end of a stack, in the order that `order` gives their
    /// places in (read in the order of `direction`), with the `t` of each. `N` elements are written in all,
    /// of which as many count as the mask has lanes. Gives the last one that counts, or anything where
    /// none does: reading it back would wait for the stores.
    unsafe fn push(
        children: *const u32,
        t: Self::Floats,
        mask: Self::Mask,
        order: *const u8,
        direction: &Direction,
        to_children: *mut u32,
        to_t: *mut f32,
    ) -> u32;

    /// The greater of two magnitudes.
    #[inline(always)]
    unsafe fn magnitude(a: Self::Floats, b: Self::Floats) -> Self::Floats {
        // SAFETY: the caller's contract.
        unsafe { Self::max(Self::abs(a), Self::abs(b)) }
    }
}

/// Asks for the cache line at an address that need not be readable.
#[inline(always)]
pub(crate) fn prefetch(at: *const u8) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: a prefetch reads nothing and faults nowhere; SSE is part of x86-64.
    unsafe {
        core::arch::x86_64::_mm_prefetch::<{ core::arch::x86_64::_MM_HINT_T0 }>(at.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = at;
}
