//! The triangles of a leaf as tests read them: blocks of at most as many as a vector has lanes, with
//! corners that triangles share stored once.
//!
//! A block begins at a multiple of [`UNIT`] words:
//!
//! | words | what |
//! |---|---|
//! | 1 | triangles in bits 0 to 7, different corners in bits 8 to 15, words to the corners above |
//! | 3 n / 4, rounded up | a byte for each corner of n triangles: first corners, second, third |
//! | n | indices of the triangles in the mesh |
//! | 3 v | coordinates of v corners: all x, all y, all z |
//!
//! Neighbours in a mesh share corners: a corner is seldom stored more than 1.1 times a triangle instead of
//! three. So a block is half as long as one of corner copies, and what a ray must do with
//! each corner (move it, shear it) is done once.

use splitplane_core::triangle::Triangle;

use super::blocks::Block;
use super::simd::{MOST_LANES, Simd};

/// Words at whose multiples blocks begin.
pub(crate) const UNIT: usize = 4;
/// Words behind the last block that vector loads may read.
pub(crate) const TAIL: usize = 3 * MOST_LANES;

/// A block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Record<'a> {
    /// The block's words and all that follow.
    words: &'a [u32],
}

impl<'a> Record<'a> {
    /// The block that begins at a unit.
    #[inline(always)]
    pub fn at(words: &'a [u32], unit: u32) -> Record<'a> {
        Record { words: &words[unit as usize * UNIT..] }
    }

    /// The same without a look at the bounds.
    ///
    /// # Safety
    /// The unit must be that of a block.
    #[inline(always)]
    pub unsafe fn at_unchecked(words: &'a [u32], unit: u32) -> Record<'a> {
        // SAFETY: the caller's contract.
        Record { words: unsafe { words.get_unchecked(unit as usize * UNIT..) } }
    }

    /// Triangles, 1 to 16.
    #[inline(always)]
    pub fn count(&self) -> usize {
        (self.words[0] & 0xff) as usize
    }

    /// Different corners, at most 32.
    #[inline(always)]
    pub fn corner_count(&self) -> usize {
        (self.words[0] >> 8 & 0xff) as usize
    }

    /// Words before the coordinates.
    #[inline(always)]
    fn before(&self) -> usize {
        (self.words[0] >> 16) as usize
    }

    /// Units to the next block.
    #[inline]
    pub fn units(&self) -> u32 {
        (self.before() + 3 * self.corner_count()).div_ceil(UNIT) as u32
    }

    /// Places of the first, second or third corners, a byte each.
    #[inline(always)]
    pub fn places(&self, corner: usize) -> *const u8 {
        self.words.as_ptr().wrapping_add(1).cast::<u8>().wrapping_add(corner * self.count())
    }

    /// The places of a triangle's corners.
    ///
    /// # Safety
    /// The triangle must be one of the block's.
    #[inline(always)]
    pub unsafe fn places_of(&self, index: usize) -> [usize; 3] {
        let first = self.places(0);
        // SAFETY: three times as many bytes as triangles follow the first word.
        let place = unsafe {
            let second = first.add(self.count());
            [*first.add(index), *second.add(index), *second.add(self.count() + index)]
        };
        [place[0] as usize, place[1] as usize, place[2] as usize]
    }

    /// Coordinates of the different corners on an axis.
    #[inline(always)]
    pub fn coordinates(&self, axis: usize) -> *const f32 {
        self.words.as_ptr().wrapping_add(self.before() + axis * self.corner_count()).cast()
    }

    /// The index of a triangle in the mesh.
    #[inline]
    pub fn triangle(&self, index: usize) -> u32 {
        self.words[self.before() - self.count() + index]
    }

    /// The corners of a triangle.
    #[inline]
    pub fn corners(&self, index: usize) -> Triangle {
        let (start, count) = (self.before(), self.corner_count());
        let mut corners = [[0.0; 3]; 3];
        // Loops, since closures do not get the instructions of a caller's set.
        for (corner, coordinates) in corners.iter_mut().enumerate() {
            let byte = corner * self.count() + index;
            let place = self.words[1 + byte / 4].to_ne_bytes()[byte % 4] as usize;
            for (axis, x) in coordinates.iter_mut().enumerate() {
                *x = f32::from_bits(self.words[start + axis * count + place]);
            }
        }
        corners
    }

    /// The least and greatest coordinates of all corners on an axis.
    pub fn extent(&self, axis: usize) -> (f32, f32) {
        let (start, count) = (self.before(), self.corner_count());
        let row = &self.words[start + axis * count..][..count];
        let bounds = (f32::INFINITY, f32::NEG_INFINITY);
        row.iter().map(|&x| f32::from_bits(x)).fold(bounds, |(lo, hi), x| (lo.min(x), hi.max(x)))
    }

    /// The same block with all corners written out.
    pub fn written_out<'b>(&self, room: &'b mut [f32; 10 * MOST_LANES + MOST_LANES]) -> Block<'b> {
        for index in 0..self.count() {
            for (row, &x) in self.corners(index).as_flattened().iter().enumerate() {
                room[row * MOST_LANES + index] = x;
            }
            room[9 * MOST_LANES + index] = f32::from_bits(self.triangle(index));
        }
        Block { words: room, stride: MOST_LANES, count: self.count() }
    }
}

/// Puts triangles together to blocks of at most so many.
pub(crate) struct Packer<S: Simd> {
    lanes: usize,
    corners: S::Corners,
    corner_count: usize,
    places: [[u8; MOST_LANES]; 3],
    triangles: [u32; MOST_LANES],
    count: usize,
}

impl<S: Simd> Packer<S> {
    /// For vectors of so many lanes.
    pub fn new(lanes: usize) -> Packer<S> {
        Packer {
            lanes,
            corners: S::no_corners(),
            corner_count: 0,
            places: [[0; MOST_LANES]; 3],
            triangles: [0; MOST_LANES],
            count: 0,
        }
    }

    /// Writes the blocks of a leaf behind what is there, and says how many.
    ///
    /// # Safety
    /// The processor must have the set.
    #[inline(always)]
    pub unsafe fn leaf(
        &mut self,
        references: &[u32],
        triangles: &[Triangle],
        out: &mut Vec<u32>,
    ) -> u32 {
        let mut blocks = 0;
        for &triangle in references {
            // Room for three corners is asked for even where some are known: it makes hardly a block more.
            if self.count == self.lanes || self.corner_count + 3 > 2 * self.lanes {
                // SAFETY: the caller's contract.
                unsafe { self.write(out) };
                blocks += 1;
            }
            for (k, corner) in triangles[triangle as usize].iter().enumerate() {
                // SAFETY: the caller's contract.
                self.places[k][self.count] = unsafe { self.place_of(corner) };
            }
            self.triangles[self.count] = triangle;
            self.count += 1;
        }
        if self.count > 0 {
            // SAFETY: the caller's contract.
            unsafe { self.write(out) };
            blocks += 1;
        }
        blocks
    }

    /// Where a corner stands, which is put there if it is new: without a branch, since nobody could
    /// foresee it. Corners are equal when all bits are.
    ///
    /// # Safety
    /// The processor must have the set.
    #[inline(always)]
    unsafe fn place_of(&mut self, corner: &[f32; 3]) -> u8 {
        let words = corner.map(f32::to_bits);
        let new = self.corner_count;
        // SAFETY: the caller's contract; what columns behind have is of no account, being behind.
        let place = unsafe { S::put_and_find(&mut self.corners, words, new) };
        self.corner_count += usize::from(place == new);
        place as u8
    }

    /// Writes the block and begins another.
    ///
    /// # Safety
    /// The processor must have the set.
    #[inline(always)]
    unsafe fn write(&mut self, out: &mut Vec<u32>) {
        let (count, corners) = (self.count, self.corner_count);
        let before = 1 + (3 * count).div_ceil(4) + count;
        out.push(count as u32 | (corners as u32) << 8 | (before as u32) << 16);
        let mut bytes = [0u8; 3 * MOST_LANES];
        for (k, places) in self.places.iter().enumerate() {
            bytes[k * count..(k + 1) * count].copy_from_slice(&places[..count]);
        }
        let words = bytes.as_chunks::<4>().0.iter().map(|&word| u32::from_ne_bytes(word));
        out.extend(words.take((3 * count).div_ceil(4)));
        out.extend_from_slice(&self.triangles[..count]);
        // SAFETY: the caller's contract.
        for row in unsafe { S::columns(&self.corners) } {
            out.extend_from_slice(&row[..corners]);
        }
        while !out.len().is_multiple_of(UNIT) {
            out.push(0);
        }
        (self.count, self.corner_count) = (0, 0);
    }
}
