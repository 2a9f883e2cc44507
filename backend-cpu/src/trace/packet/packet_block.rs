//! Blocks as packets read them: all triangles at once for culling, and one triangle for all rays. All blocks of a layout are of one kind, so packets
//! are compiled for either and ask no block how its corners are stored.

use super::Packet;
use crate::layout::packed_block::PackedBlock;
use crate::simd::Simd;
use crate::trace::triangle_block::{TriangleBlock, WrittenBlock};

/// A packed block of a known kind.
pub(super) trait PacketBlock<'a>: TriangleBlock {
    /// The block as this kind, which it must be.
    fn of(block: PackedBlock<'a>) -> Self;

    /// Coordinates on an axis, where [`PacketBlock::places_of`] finds those of a triangle.
    fn row(&self, axis: usize) -> *const f32;

    /// The places of a triangle's corners.
    ///
    /// # Safety
    /// The triangle must be one of the block's.
    unsafe fn places_of(&self, index: usize) -> [usize; 3];

    /// The triangles that rays of the packet may meet, as [`Packet::cull`], for sheared corners that may be off by `slack`, and depths in a range.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    unsafe fn cull<S: Simd>(&self, packet: &Packet, slack: f32, range: [f32; 2]) -> u32;
}

impl<'a> PacketBlock<'a> for PackedBlock<'a> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn of(block: PackedBlock<'a>) -> PackedBlock<'a> {
        block
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn row(&self, axis: usize) -> *const f32 {
        PackedBlock::coordinates(self, axis)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn places_of(&self, index: usize) -> [usize; 3] {
        // SAFETY: the caller's contract.
        unsafe { PackedBlock::places_of(self, index) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn cull<S: Simd>(&self, packet: &Packet, slack: f32, range: [f32; 2]) -> u32 {
        // SAFETY: the caller's contract.
        unsafe { packet.cull_shared::<S>(self, slack, range) }
    }
}

impl<'a> PacketBlock<'a> for WrittenBlock<'a> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn of(block: PackedBlock<'a>) -> WrittenBlock<'a> {
        WrittenBlock::of_written(block)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn row(&self, axis: usize) -> *const f32 {
        self.packed().coordinates(axis)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn places_of(&self, index: usize) -> [usize; 3] {
        let count = self.count();
        [index, count + index, 2 * count + index]
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn cull<S: Simd>(&self, packet: &Packet, slack: f32, range: [f32; 2]) -> u32 {
        // SAFETY: the caller's contract.
        unsafe { packet.cull_written::<S>(self, slack, range) }
    }
}
