//! The triangles of a leaf as tests read them: blocks of at most as many as a vector has lanes, with
//! corners that triangles share stored once.
//!
//! A block begins at a multiple of [`UNIT_WORDS`] words:
//!
//! | words | what |
//! |---|---|
//! | 1 | triangles in bits 0 to 5, whether corners are written out in bit 6, whether triangles are large in bit 7, corners in bits 8 to 15, words to their coordinates above |
//! | 3 n / 4, rounded up | a byte for each corner of n triangles: first corners, second, third |
//! | n | indices of the triangles in the mesh |
//! | 3 v | coordinates of v corners: all x, all y, all z |
//!
//! Neighbours in a mesh share corners: a corner is seldom stored more than 1.1 times a triangle instead of
//! three. So a block is half as long as one of corner copies, and what a ray must do with
//! each corner (move it, shear it) is done once.
//!
//! Corners that are a triangle's first come before the place that follows the lanes of a vector, so a test finds all first corners
//! in one vector. There are never more of them than triangles, and of these no more than lanes.
//!
//! Where hardly a corner is shared ([`super::corners`]) and vectors have [`LANES_TO_WRITE_OUT`] lanes, corners are *written out*: there are no
//! bytes, and v is 3 n. On each axis all first corners come first, then all second ones, then all third ones: nine rows, each as long as
//! there are triangles. All blocks of a layout are of one kind.

use splitplane_core::aabb::{Aabb, max, min};
use splitplane_core::triangle::Triangle;

use crate::simd::MOST_LANES;

/// Words at whose multiples blocks begin.
pub(crate) const UNIT_WORDS: usize = 4;
/// Words after the last block that vector loads may read.
pub(crate) const TAIL: usize = 3 * MOST_LANES;

/// Whether any block has its corners written out. Not in a browser, which loads all code before the first ray.
pub(crate) const WRITES_OUT: bool = !cfg!(target_family = "wasm");
/// Lanes of the vectors for which corners may be written out: with 16 a block has room for ten triangles that share none, and a
/// look-up is one operation.
pub(crate) const LANES_TO_WRITE_OUT: usize = 8;

/// A block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PackedBlock<'a> {
    /// The block's words and all that follow: one at least.
    words: &'a [u32],
}

impl PackedBlock<'_> {
    /// Set in the first word of a block of [large](super::large) triangles.
    const LARGE: u32 = 1 << 7;
    /// Set in the first word of a block with corners written out.
    const WRITTEN: u32 = 1 << 6;

    /// The first word of a block with these numbers of triangles and of different corners.
    pub(crate) const fn header(count: usize, corners: usize, large: bool) -> u32 {
        let before = PackedBlock::before_coordinates(count);
        let mark = if large { PackedBlock::LARGE } else { 0 };
        mark | count as u32 | (corners as u32) << 8 | (before as u32) << 16
    }

    /// Words before the coordinates of a block of `count` triangles.
    pub(crate) const fn before_coordinates(count: usize) -> usize {
        1 + (3 * count).div_ceil(4) + count
    }

    /// The first word of a block of `count` triangles with corners written out.
    pub(crate) const fn written_header(count: usize, large: bool) -> u32 {
        let mark = PackedBlock::WRITTEN | if large { PackedBlock::LARGE } else { 0 };
        mark | count as u32 | (3 * count as u32) << 8 | (1 + count as u32) << 16
    }

    /// Words of a block of `count` triangles with corners written out.
    pub(crate) const fn written_words(count: usize) -> usize {
        (1 + count + 9 * count).next_multiple_of(UNIT_WORDS)
    }

    /// Words of a block with these numbers of triangles and of different corners.
    pub(crate) const fn words(count: usize, corners: usize) -> usize {
        (PackedBlock::before_coordinates(count) + 3 * corners).next_multiple_of(UNIT_WORDS)
    }
}

impl<'a> PackedBlock<'a> {
    /// The block that begins at a unit.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn at(words: &'a [u32], unit: u32) -> PackedBlock<'a> {
        let words = &words[unit as usize * UNIT_WORDS..];
        assert!(!words.is_empty(), "a block has a first word");
        PackedBlock { words }
    }

    /// The same without a look at the bounds.
    ///
    /// # Safety
    /// The unit must be that of a block.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn at_unchecked(words: &'a [u32], unit: u32) -> PackedBlock<'a> {
        // SAFETY: the caller's contract.
        PackedBlock { words: unsafe { words.get_unchecked(unit as usize * UNIT_WORDS..) } }
    }

    /// The first word.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn first_word(&self) -> u32 {
        // SAFETY: there is one, as both ways to make a block ask for.
        unsafe { *self.words.get_unchecked(0) }
    }

    /// Triangles, 1 to 16.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn count(&self) -> usize {
        (self.first_word() & 0x3f) as usize
    }

    /// Whether these are [large](super::large) triangles, in a block of their own.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn is_large(&self) -> bool {
        self.first_word() & PackedBlock::LARGE != 0
    }

    /// Whether corners are written out.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn is_written(&self) -> bool {
        WRITES_OUT && self.first_word() & PackedBlock::WRITTEN != 0
    }

    /// Corners: different ones, at most 32, or three times the triangles where they are written out.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn corner_count(&self) -> usize {
        (self.first_word() >> 8 & 0xff) as usize
    }

    /// Words before the coordinates.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn before(&self) -> usize {
        (self.first_word() >> 16) as usize
    }

    /// Units to the next block.
    #[inline]
    pub(crate) fn units(&self) -> u32 {
        (self.before() + 3 * self.corner_count()).div_ceil(UNIT_WORDS) as u32
    }

    /// Places of the first, second or third corners, a byte each, where corners are shared.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn places(&self, corner: usize) -> *const u8 {
        self.words.as_ptr().wrapping_add(1).cast::<u8>().wrapping_add(corner * self.count())
    }

    /// The places of a triangle's corners, where corners are shared.
    ///
    /// # Safety
    /// The triangle must be one of the block's.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn places_of(&self, index: usize) -> [usize; 3] {
        let first = self.places(0);
        // SAFETY: three times as many bytes as triangles follow the first word.
        let place = unsafe {
            let second = first.add(self.count());
            [*first.add(index), *second.add(index), *second.add(self.count() + index)]
        };
        [place[0] as usize, place[1] as usize, place[2] as usize]
    }

    /// Coordinates of the corners on an axis.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn coordinates(&self, axis: usize) -> *const f32 {
        self.coordinates_at(size_of::<f32>() * axis)
    }

    /// The same, given the bytes from a corner's x to its coordinate on the axis, if these followed each other.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn coordinates_at(&self, bytes: usize) -> *const f32 {
        let x = self.words.as_ptr().wrapping_add(self.before());
        x.wrapping_byte_add(bytes * self.corner_count()).cast()
    }

    /// The triangles' indices in the mesh.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn triangles(&self) -> *const u32 {
        self.words.as_ptr().wrapping_add(self.before() - self.count())
    }

    /// The index of a triangle in the mesh.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn triangle(&self, index: usize) -> u32 {
        self.words[self.before() - self.count() + index]
    }

    /// The corners of a triangle.
    #[inline]
    pub(crate) fn corners(&self, index: usize) -> Triangle {
        let (start, count) = (self.before(), self.corner_count());
        let mut corners = [[0.0; 3]; 3];
        // Loops, since closures do not get the instructions of a caller's set.
        for (corner, coordinates) in corners.iter_mut().enumerate() {
            let byte = corner * self.count() + index;
            let place = if self.is_written() {
                byte
            } else {
                self.words[1 + byte / 4].to_ne_bytes()[byte % 4] as usize
            };
            for (axis, x) in coordinates.iter_mut().enumerate() {
                *x = f32::from_bits(self.words[start + axis * count + place]);
            }
        }
        corners
    }

    /// Bounds of all corners.
    pub(crate) fn bounds(&self) -> Aabb {
        let (start, count) = (self.before(), self.corner_count());
        let mut bounds = Aabb::EMPTY;
        for axis in 0..3 {
            let row = &self.words[start + axis * count..][..count];
            for x in row.iter().map(|&word| f32::from_bits(word)) {
                bounds.lo[axis] = min(x, bounds.lo[axis]);
                bounds.hi[axis] = max(x, bounds.hi[axis]);
            }
        }
        bounds
    }
}
