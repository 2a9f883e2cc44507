//! The kernel set of queries for what is near, through the tree of a mesh on a device. There is no schedule: each is one dispatch over
//! what the host counts.
//!
//! A device has no `f64`. It finds the triangles that matter, by bounds of their distances; the host decides between these.

use crate::kernel_set;
use crate::tree::node::KdNode;

kernel_set! {
    /// Closest points and overlaps on a device.
    set NearQueries "queries for what is near", counted by NearCounter;
    every kernel: ;
    exchanged: ;

    /// The inputs of these kernels.
    uniforms NearUniform {
        /// How many queries, and what they share: [`layout::NearBatch`](crate::layout::NearBatch).
        NearBatch "near_batch";
    }

    /// The buffers of these queries.
    buffers NearBuffer {
        /// The tree's nodes: [`KdNode`].
        Nodes "nodes", size_of::<KdNode>();
        /// The tree's references.
        LeafReferences "leaf_references", 4;
        /// Snapped corners by triangle index: 9 `f32`.
        Triangles "triangles", 36;
        /// The points of a batch, two times four `f32` each: the point and its unit; how far away triangles count, in that unit, and
        /// three zeros.
        NearPoints "near_points", 16;
        /// The volumes of a batch, [`NearBatch::VOLUME_ROWS`](crate::layout::NearBatch::VOLUME_ROWS) times four words each: an origin and
        /// the unit there; the lower corner of a box, and a radius in that unit; the upper corner, and the kind; the first of its half-spaces,
        /// their number, and two zeros.
        Volumes "volumes", 16;
        /// The half-spaces of all volumes, four `f32` each: normal and offset, as seen from the volume's origin in its unit.
        HalfSpaces "half_spaces", 16;
        /// What is found: [`NearBatch::room`](crate::layout::NearBatch::room) words a query.
        Found "found", 4;
    }

    /// The kernels.
    kernels NearKernel {
        /// The triangles of which one is the closest to each point.
        ClosestTriangles "closest_triangles", Invocations(Queries, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, uniform NearBatch, reads NearPoints, scatters Found;
        /// The triangles that each volume may meet, and which of them it certainly does.
        OverlappedTriangles "overlapped_triangles", Invocations(Queries, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, uniform NearBatch, reads Volumes, reads HalfSpaces, scatters Found;
    }
}

/// What these queries count: the host knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NearCounter {
    /// The queries of a batch.
    Queries,
}
