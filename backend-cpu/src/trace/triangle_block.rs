//! Blocks of triangles as the wide tests read them: packed ones share corners or have them written out, gathered ones do not share them.

use splitplane_core::triangle::Triangle;

use crate::layout::gathered_block::GatheredBlock;
use crate::layout::packed_block::PackedBlock;
use crate::simd::{MOST_LANES, Simd};

/// Triangles that are tested at once, as the test reads them.
pub(crate) trait TriangleBlock: Copy {
    /// Vectors that the corners' coordinates on an axis take: 2 or 3.
    const VECTORS: usize;

    /// How many, at most as many as there are lanes.
    fn count(&self) -> usize;

    /// Whether they are [large](crate::layout::large), in a block of their own.
    fn is_large(&self) -> bool;

    /// The index of a triangle in the mesh.
    fn triangle(&self, index: usize) -> u32;

    /// The indices of all, at the start of a vector that may be read.
    fn triangles(&self) -> *const u32;

    /// The corners of a triangle.
    fn corners(&self, index: usize) -> Triangle;

    /// A vector of coordinates on an axis.
    ///
    /// # Safety
    /// The processor must have the set, and a block of its width must follow the stored data.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn coordinates<S: Simd>(&self, axis: usize, vector: usize) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe { self.coordinates_at::<S>(size_of::<f32>() * axis, vector) }
    }

    /// The same, given the bytes from a corner's x to its coordinate on the axis, if these followed each other.
    ///
    /// # Safety
    /// As for [`TriangleBlock::coordinates`].
    unsafe fn coordinates_at<S: Simd>(&self, bytes: usize, vector: usize) -> S::Floats;

    /// The indices that find the corners of the triangles in such vectors.
    ///
    /// # Safety
    /// As for [`TriangleBlock::coordinates`].
    unsafe fn places<S: Simd>(&self) -> [S::Places; 3];

    /// The numbers of the triangles' corners, given a number of each corner.
    ///
    /// # Safety
    /// The processor must have the set.
    unsafe fn of_corners<S: Simd>(vectors: Vectors<S>, places: [S::Places; 3]) -> [S::Floats; 3];
}

/// Corners are shared: only some blocks need the second vector, but which ones cannot be predicted. A block with corners
/// [written out](PackedBlock::is_written) must be read as [`WrittenBlock`].
impl TriangleBlock for PackedBlock<'_> {
    const VECTORS: usize = 2;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn count(&self) -> usize {
        PackedBlock::count(self)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn is_large(&self) -> bool {
        PackedBlock::is_large(self)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn triangle(&self, index: usize) -> u32 {
        PackedBlock::triangle(self, index)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn triangles(&self) -> *const u32 {
        PackedBlock::triangles(self)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn corners(&self, index: usize) -> Triangle {
        PackedBlock::corners(self, index)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn coordinates_at<S: Simd>(&self, bytes: usize, vector: usize) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe { S::load(PackedBlock::coordinates_at(self, bytes).wrapping_add(vector * S::N)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn places<S: Simd>(&self) -> [S::Places; 3] {
        // SAFETY: the caller's contract.
        unsafe {
            [
                S::places(PackedBlock::places(self, 0)),
                S::places(PackedBlock::places(self, 1)),
                S::places(PackedBlock::places(self, 2)),
            ]
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn of_corners<S: Simd>(
        [low, high, _]: Vectors<S>,
        places: [S::Places; 3],
    ) -> [S::Floats; 3] {
        // SAFETY: the caller's contract.
        unsafe { of_corners::<S>([low, high], places) }
    }
}

/// A packed block with corners [written out](PackedBlock::is_written).
#[derive(Clone, Copy, Debug)]
pub(crate) struct WrittenBlock<'a>(PackedBlock<'a>);

impl<'a> WrittenBlock<'a> {
    /// The block as one with corners written out, if it is that.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn of(block: &PackedBlock<'a>) -> Option<WrittenBlock<'a>> {
        block.is_written().then_some(WrittenBlock(*block))
    }

    /// The block as it is packed.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn packed(&self) -> &PackedBlock<'a> {
        &self.0
    }

    /// The same as [`WrittenBlock::of`] of a block that must be that.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn of_written(block: PackedBlock<'a>) -> WrittenBlock<'a> {
        debug_assert!(block.is_written());
        WrittenBlock(block)
    }
}

/// Rows as long as there are triangles: one vector for the first corners, one for the second, one for the third. Lanes after the last
/// triangle hold what follows, and do not count.
impl TriangleBlock for WrittenBlock<'_> {
    const VECTORS: usize = 3;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn count(&self) -> usize {
        self.0.count()
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn is_large(&self) -> bool {
        self.0.is_large()
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn triangle(&self, index: usize) -> u32 {
        self.0.triangle(index)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn triangles(&self) -> *const u32 {
        self.0.triangles()
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn corners(&self, index: usize) -> Triangle {
        self.0.corners(index)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn coordinates_at<S: Simd>(&self, bytes: usize, vector: usize) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe { S::load(self.0.coordinates_at(bytes).wrapping_add(vector * self.0.count())) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn places<S: Simd>(&self) -> [S::Places; 3] {
        // SAFETY: the caller's contract. Nothing is looked up.
        unsafe { [S::places([0; MOST_LANES].as_ptr()); 3] }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn of_corners<S: Simd>(vectors: Vectors<S>, _: [S::Places; 3]) -> [S::Floats; 3] {
        vectors
    }
}

/// Corners are written out: one vector for the first ones, one for the second, one for the third.
impl TriangleBlock for GatheredBlock<'_> {
    const VECTORS: usize = 3;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn count(&self) -> usize {
        self.count
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn is_large(&self) -> bool {
        self.large
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn triangle(&self, index: usize) -> u32 {
        GatheredBlock::triangle(self, index)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn triangles(&self) -> *const u32 {
        self.words.as_ptr().wrapping_add(9 * self.stride).cast()
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn corners(&self, index: usize) -> Triangle {
        GatheredBlock::corners(self, index)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn coordinates_at<S: Simd>(&self, bytes: usize, vector: usize) -> S::Floats {
        let row = (3 * size_of::<f32>() * vector + bytes) * self.stride;
        // SAFETY: the caller's contract.
        unsafe { S::load(self.words.as_ptr().wrapping_byte_add(row)) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn places<S: Simd>(&self) -> [S::Places; 3] {
        // SAFETY: the caller's contract. Nothing is looked up.
        unsafe { [S::places([0; MOST_LANES].as_ptr()); 3] }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn of_corners<S: Simd>(vectors: Vectors<S>, _: [S::Places; 3]) -> [S::Floats; 3] {
        vectors
    }
}

/// A number of each corner. One vector is enough for some blocks, but which ones cannot be
/// predicted.
pub(crate) type Table<S> = [<S as Simd>::Floats; 2];

/// The numbers of the triangles' corners, given a number of each corner. First corners are all in the first vector.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) unsafe fn of_corners<S: Simd>(
    table: Table<S>,
    places: [S::Places; 3],
) -> [S::Floats; 3] {
    // SAFETY: the caller's contract.
    unsafe {
        let [a, b, c] = places;
        [S::look_up_low(table[0], a), S::look_up(table, b), S::look_up(table, c)]
    }
}

/// A number of each corner, in as many vectors as [`TriangleBlock::VECTORS`].
pub(crate) type Vectors<S> = [<S as Simd>::Floats; 3];
