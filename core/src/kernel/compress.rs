//! The kernel set that makes compressed nodes from a finished tree.

use crate::kernel_set;
use crate::layout::{CompressCounters, Part};
use crate::query::compressed::{CHILDREN, CompressedNode};
use crate::tree::node::KdNode;

kernel_set! {
    /// Compressed nodes from a finished tree: see [`query::compressed`](crate::query::compressed). The parts of the tree that
    /// become nodes are a queue; the number of a node is the place of its part. Each round takes a batch from the front, and
    /// adds the children of its nodes to the end.
    set NodeCompressor "node compressor", counted by CompressCounter;
    every kernel: uniform Compress, reads Counters;
    exchanged: ;

    /// The inputs of kernels, which do not change.
    uniforms CompressUniform {
        /// Slack of the scene, and rooms: [`layout::Compress`](crate::layout::Compress).
        Compress "compress";
    }

    /// The buffers that kernels exchange.
    buffers CompressBuffer {
        /// [`CompressCounters`].
        Counters "counters", size_of::<CompressCounters>();
        /// The tree's nodes: [`KdNode`].
        Nodes "nodes", size_of::<KdNode>();
        /// The tree's references.
        LeafReferences "leaf_references", 4;
        /// Snapped corners by triangle index: 9 `f32`.
        Triangles "triangles", 36;
        /// The parts that become nodes: [`Part`].
        Parts "parts", size_of::<Part>(), live Queued;
        /// The children of each part of the batch: those that become nodes, then those that become leaves, then nothing.
        Children "children", CHILDREN * size_of::<Part>(), live Waiting;
        /// How many children of each become nodes, and how many references the others have.
        ChildCounts "child_counts", 8, live Waiting;
        /// The first child that is a node, and the first reference.
        Places "places", 8, live Active;
        /// [`CompressedNode`].
        CompressedNodes "compressed_nodes", size_of::<CompressedNode>(), live Made;
        /// Triangle indices, named by the leaves of compressed nodes.
        CompressedReferences "compressed_references", 4, live References;
    }

    /// The kernels.
    kernels CompressKernel {
        /// Opens each part of the batch until it has eight children, or only leaves.
        OpenParts "open_parts", Invocations(Waiting, 32) =>
            reads Nodes, reads LeafReferences, reads Triangles, reads Parts, writes Children, writes ChildCounts;
        /// Gives the children their places, in the order of the parts. The next batch waits.
        PlaceChildren "place_children", One =>
            updates Counters, reads ChildCounts, writes Places;
        /// Writes the nodes of the batch and their references, and queues the children that become nodes.
        EmitNodes "emit_nodes", Invocations(Active, 64) =>
            reads LeafReferences, reads Children, reads Places, scatters Parts, scatters CompressedNodes,
            scatters CompressedReferences;
    }
}

/// What kernels count. A counter's value is its index in [`CompressCounters`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CompressCounter {
    /// Parts of the batch that is next.
    Waiting,
    /// Parts of the batch that has its places.
    Active,
    /// Nodes that are made when that batch is.
    Made,
    /// Parts that were queued so far.
    Queued,
    /// References of all leaves so far.
    References,
    /// Parts beyond the room of the queue; then nothing waits and nothing is active.
    Outgrown,
}
