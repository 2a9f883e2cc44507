//! The kernel set that builds trees of points.

use core::ops::{Index, IndexMut};

use crate::kernel_set;
use crate::layout::{POINT_CHUNK, PointCounters, PointExtent, PointRecord, PointSplit};

kernel_set! {
    /// Trees of points, built level by level: see [`build::points`](crate::build::points). The tree is implicit, so it is known
    /// before which places the points of a node will take, and all that is searched for is its plane. Points of a node always stand by
    /// index; so do those with equal coordinates, and their order needs no further key.
    set PointBuilder "point builder", counted by PointCounter;
    every kernel: uniform PointBuild, reads Counters;
    exchanged: Records with NextRecords;

    /// The inputs of kernels, which do not change.
    uniforms PointBuildUniform {
        /// Sizes and options: [`layout::PointBuild`](crate::layout::PointBuild).
        PointBuild "point_build";
    }

    /// The buffers that kernels exchange.
    buffers PointBuffer {
        /// [`PointCounters`].
        Counters "counters", size_of::<PointCounters>();
        /// The coordinates given, point by point: `f32` each.
        Input "input", 4;
        /// Of each chunk of the points given: how many are kept, and the bits of the size of their greatest coordinate.
        ChunkMeasures "chunk_measures", 8, live InputChunks;
        /// The place of the first point that is kept of each.
        ChunkPlaces "chunk_places", 4, live InputChunks;
        /// The points that are kept: [`PointRecord`].
        Records "records", size_of::<PointRecord>(), live Kept;
        /// The same at the next level.
        NextRecords "next_records", size_of::<PointRecord>(), live Kept;
        /// Between which coordinates the points of each chunk lie: [`PointExtent`].
        ChunkExtents "chunk_extents", size_of::<PointExtent>(), live ActiveChunks;
        /// The planes of large nodes: [`PointSplit`].
        Splits "splits", size_of::<PointSplit>(), live Large;
        /// How many points of each chunk have each digit: 256 numbers.
        ChunkDigits "chunk_digits", 1024, live ActiveChunks;
        /// How many points of each chunk are below their node's plane, and how many on it.
        ChunkSides "chunk_sides", 8, live ActiveChunks;
        /// How many points of its node are so before each chunk.
        SidesBefore "sides_before", 8, live ActiveChunks;
        /// The tree's nodes: [`PointNode`](crate::points::tree::PointNode).
        Nodes "nodes", 8, live Nodes;
        /// Its points, four `f32` each.
        Points "points", 16, live Kept;
        /// Their indices.
        Indices "indices", 4, live Kept;
    }

    /// The kernels.
    kernels PointKernel {
        /// Counts the points that are kept, and finds their greatest coordinate.
        MeasurePoints "measure_points", Each(InputChunks) =>
            reads Input, writes ChunkMeasures;
        /// Gives the points of each chunk their places, and finds the tree's unit and height.
        ScanPoints "scan_points", One =>
            updates Counters, reads ChunkMeasures, writes ChunkPlaces;
        /// Gathers the points that are kept, in the tree's unit.
        GatherPoints "gather_points", Each(InputChunks) =>
            reads Input, reads ChunkPlaces, writes Records;
        /// Finds between which coordinates the points of each chunk lie, where axes are the widest.
        PointExtents "point_extents", Each(ActiveChunks) =>
            reads Records, writes ChunkExtents;
        /// Chooses the axis of each large node.
        ChooseAxes "choose_axes", Each(Large) =>
            reads ChunkExtents, writes Splits;
        /// Counts the points that may be on the plane, by the next eight bits of their coordinate.
        CountDigits "count_digits", Each(ActiveChunks) =>
            reads Records, reads Splits, writes ChunkDigits;
        /// Finds the next eight bits of each plane.
        PickDigits "pick_digits", Each(Large) =>
            reads ChunkDigits, updates Splits;
        /// Counts the points below planes, and on them.
        CountSides "count_sides", Each(ActiveChunks) =>
            reads Records, reads Splits, writes ChunkSides;
        /// Sums them up before each chunk, and writes the tree's nodes.
        PlaceSides "place_sides", Each(Large) =>
            reads Splits, reads ChunkSides, writes SidesBefore, scatters Nodes;
        /// Moves the points to the children.
        ScatterPoints "scatter_points", Each(ActiveChunks) =>
            reads Records, reads Splits, reads SidesBefore, scatters NextRecords;
        /// Goes on to the next level.
        NextHeight "next_height", One =>
            updates Counters;
        /// Finishes the subtree of each chunk.
        BuildSmallPoints "build_small_points", Each(Chunks) =>
            reads Records, scatters Nodes, writes Points, writes Indices;
    }
}

/// What kernels count. A counter's value is its index in [`PointCounters`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PointCounter {
    /// Chunks of the points given.
    InputChunks,
    /// Points that are kept.
    Kept,
    /// Chunks of these.
    Chunks,
    /// The same while there are large nodes, and then 0.
    ActiveChunks,
    /// Large nodes of the level.
    Large,
    /// Height of the nodes of the level.
    Height,
    /// Height of the root.
    RootHeight,
    /// The exponent of the tree's unit, and 127.
    Unit,
    /// Nodes of the tree.
    Nodes,
}

impl PointCounters {
    /// The counters before the first kernel, for so many points given.
    pub fn at_start(points: u32) -> PointCounters {
        let mut counters = PointCounters::default();
        counters[PointCounter::InputChunks] = points.div_ceil(POINT_CHUNK);
        counters
    }
}

impl Index<PointCounter> for PointCounters {
    type Output = u32;

    fn index(&self, counter: PointCounter) -> &u32 {
        &self.words[counter as usize]
    }
}

impl IndexMut<PointCounter> for PointCounters {
    fn index_mut(&mut self, counter: PointCounter) -> &mut u32 {
        &mut self.words[counter as usize]
    }
}
