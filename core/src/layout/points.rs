//! The records of kernels that work on points.

use bytemuck::{Pod, Zeroable};

/// Points of a chunk, which a workgroup of a device takes at a time: those of a node of [`SMALL_HEIGHT`].
pub const POINT_CHUNK: u32 = 1024;
/// The height of a node of a tree of points that is a chunk: nodes above it are large.
pub const SMALL_HEIGHT: u32 = 6;

/// A batch of queries to a tree of points: the WGSL struct of the same name.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct PointBatch {
    /// How many queries.
    pub count: u32,
    /// How many points are kept for each, where the nearest are asked for; at least 1.
    pub room: u32,
    /// Points of the tree.
    pub points: u32,
    /// Height of its root.
    pub height: u32,
    /// Bits of the greatest squared distance that counts, in the tree's unit.
    pub reach: u32,
    /// 1 where the buffer `allowed` says which points count.
    pub filtered: u32,
    /// Always 0, as in [`SceneUniform::zero`](crate::layout::SceneUniform::zero).
    pub zero: u32,
    /// Zero.
    pub padding: u32,
    /// Bits of the least coordinates of all points, in the tree's unit; 0 beyond the dimensions.
    pub lower: [u32; 4],
    /// Bits of the greatest coordinates.
    pub upper: [u32; 4],
}

impl PointBatch {
    /// In place of the number of points, or of the bits of the first distance: the driver did not let the query finish.
    pub const ENDED_EARLY: u32 = u32::MAX;
}

/// The inputs of the kernels that build a tree of points: the WGSL struct of the same name.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct PointBuild {
    /// Points given.
    pub given: u32,
    /// Coordinates of each, 1 to 4.
    pub dimensions: u32,
    /// 1 where axes are the widest, 0 where they take turns: [`Axes`](crate::points::tree::Axes).
    pub widest: u32,
    /// Always 0, as in [`SceneUniform::zero`](crate::layout::SceneUniform::zero).
    pub zero: u32,
}

/// A point that is being built over. 20 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct PointRecord {
    /// Coordinates as [`ordered_bits`](crate::arithmetic::ordered_bits) of units; those beyond the dimensions are of 0.
    pub x: u32,
    /// The second.
    pub y: u32,
    /// The third.
    pub z: u32,
    /// The fourth.
    pub w: u32,
    /// Index among the points given.
    pub point: u32,
}

impl PointRecord {
    /// The coordinate along an axis.
    pub fn along(&self, axis: u32) -> u32 {
        [self.x, self.y, self.z, self.w][axis as usize]
    }
}

/// The plane of a large node while it is searched for.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct PointSplit {
    /// The axis, or [`PointSplit::UNDIVIDED`].
    pub axis: u32,
    /// The first bits of the plane, [`PointSplit::known`] of them; the others are 0.
    pub bits: u32,
    /// How many points that begin with these bits go to the left child, in the order of coordinate and index.
    pub rank: u32,
    /// How many bits are known.
    pub known: u32,
}

impl PointSplit {
    /// The axis of a node that has no right child.
    pub const UNDIVIDED: u32 = 4;
}

/// Between which coordinates points lie, as [`ordered_bits`](crate::arithmetic::ordered_bits).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct PointExtent {
    /// The least along each axis.
    pub lower: [u32; 4],
    /// The greatest.
    pub upper: [u32; 4],
}

impl PointExtent {
    /// That of no points.
    pub const NONE: PointExtent = PointExtent { lower: [u32::MAX; 4], upper: [0; 4] };
}

/// The counters, by [`PointCounter`](crate::kernel::PointCounter).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct PointCounters {
    /// Their values; the last ones are not used.
    pub words: [u32; 16],
}
