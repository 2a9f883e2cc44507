//! The kernel set of queries to a tree of points on a device. There is no schedule: each is one dispatch over what the
//! host counts.

use crate::kernel_set;

kernel_set! {
    /// Nearest points, and points within a radius, on a device. Points and queries are four floats each, in the tree's unit;
    /// coordinates beyond the tree's dimensions are 0, which adds nothing to a distance.
    set PointQueries "point queries", counted by PointQueryCounter;
    every kernel: ;
    exchanged: ;

    /// The inputs of these kernels.
    uniforms PointQueryUniform {
        /// The tree's size, and what is asked: [`layout::PointBatch`](crate::layout::PointBatch).
        PointBatch "point_batch";
    }

    /// The buffers of queries to points.
    buffers PointQueryBuffer {
        /// The tree's nodes: the plane of each, and what searches know of its subtree (its axis, the least index).
        Nodes "nodes", 8;
        /// Its points, block by block: four `f32`.
        Points "points", 16;
        /// Their indices.
        Indices "indices", 4;
        /// Which of them count, a bit each, by place; not read where all do.
        Allowed "allowed", 4;
        /// The queries of a batch: four `f32`.
        Queries "queries", 16, live Queries;
        /// The keys of points: the bits of the squared distance, and the index. [`PointBatch::room`](crate::layout::PointBatch::room) for each query,
        /// in no order, those of no point with index `u32::MAX`; or lists of all within a radius, one behind the other.
        Found "found", 8;
        /// How many points are within the radius of each query.
        Counts "counts", 4, live Queries;
        /// Where the list of each query begins, and where the last one ends.
        Starts "starts", 4;
    }

    /// The kernels.
    kernels PointQueryKernel {
        /// The nearest point of each query.
        NearestPoint "nearest_point", Invocations(Queries, 64) =>
            reads Nodes, reads Points, reads Allowed, reads Queries, uniform PointBatch, reads Indices, writes Found;
        /// The nearest points of each query, up to [`PointQueryKernel::FEW`] of them.
        NearestPoints "nearest_points", Invocations(Queries, 64) =>
            reads Nodes, reads Points, reads Allowed, reads Queries, uniform PointBatch, reads Indices, writes Found;
        /// The same for any number.
        NearestPointsMany "nearest_points_many", Invocations(Queries, 64) =>
            reads Nodes, reads Points, reads Allowed, reads Queries, uniform PointBatch, reads Indices, writes Found;
        /// How many points are within the radius of each query.
        CountWithin "count_within", Invocations(Queries, 64) =>
            reads Nodes, reads Points, reads Allowed, reads Queries, uniform PointBatch, writes Counts;
        /// These points.
        ListWithin "list_within", Invocations(Queries, 64) =>
            reads Nodes, reads Points, reads Allowed, reads Queries, uniform PointBatch, reads Indices, scatters Found,
            writes Counts, reads Starts;
    }
}

/// What queries to points count: the host knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PointQueryCounter {
    /// The queries of a batch.
    Queries,
}

impl PointQueryKernel {
    /// Most points that `nearest_points` keeps for a query, in the memory of its workgroup.
    pub const FEW: usize = 16;

    /// The kernel for k nearest points.
    pub const fn nearest(k: usize) -> PointQueryKernel {
        match k {
            0..=1 => PointQueryKernel::NearestPoint,
            2..=Self::FEW => PointQueryKernel::NearestPoints,
            _ => PointQueryKernel::NearestPointsMany,
        }
    }
}
