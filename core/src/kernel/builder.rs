//! The kernel set of the tree builder: the ABI between its schedule and its executors.

use crate::kernel_set;
use crate::layout::{
    Chunk, ChunkBins, ChunkBounds, ChunkSides, Counters, Decision, Extent, LargeNode, MiddleRoot,
    Reference, Sides, SmallRoot, TopNode,
};
use crate::tree::node::KdNode;

kernel_set! {
    /// The tree builder (Zhou et al. 2008).
    set TreeBuilder "tree builder", counted by Counter;
    every kernel: uniform Parameters, reads Counters;
    exchanged: ActiveNodes with NextNodes, References with NextReferences;

    /// The inputs of kernels, which do not change.
    uniforms Uniform {
        /// Configuration and capacities: [`layout::Parameters`](crate::layout::Parameters).
        Parameters "parameters";
    }

    /// The buffers that kernels exchange. Between dispatches every backend holds the same bytes in the
    /// live range of each.
    buffers Buffer {
        /// Positions and indices as the caller has them.
        Input "input", 4;
        /// Snapped corners by triangle index: 9 `f32`.
        Triangles "triangles", 36, live Triangles;
        /// References of the active nodes: [`Reference`].
        References "references", size_of::<Reference>(), live ActiveReferences;
        /// References of the next level.
        NextReferences "next_references", size_of::<Reference>(), live NextReferences;
        /// References of the small roots.
        SmallReferences "small_references", size_of::<Reference>(), live SmallReferences;
        /// The active list: [`LargeNode`].
        ActiveNodes "active_nodes", size_of::<LargeNode>(), live ActiveNodes;
        /// The next list.
        NextNodes "next_nodes", size_of::<LargeNode>(), live NextNodes;
        /// Tight bounds of the active nodes: [`aabb::Aabb`](crate::aabb::Aabb).
        NodeBounds "node_bounds", 24, live ActiveNodes;
        /// [`Chunk`].
        Chunks "chunks", size_of::<Chunk>(), live Chunks;
        /// [`Sides`]: counts.
        ChunkCounts "chunk_counts", size_of::<Sides>(), live Chunks, in ChunkState;
        /// [`ChunkBounds`].
        ChunkBounds "chunk_bounds", size_of::<ChunkBounds>(), live Chunks, in ChunkState;
        /// The state of a chunk, under one binding: chunk counts, reference sides and chunk
        /// bounds.
        ChunkState "chunk_state",
            size_of::<Sides>() + size_of::<ChunkSides>() + size_of::<ChunkBounds>(), live Chunks;
        /// [`ChunkSides`] of each chunk.
        ReferenceSides "reference_sides", size_of::<ChunkSides>(), live Chunks, in ChunkState;
        /// [`ChunkBins`] of each chunk.
        ChunkBins "chunk_bins", size_of::<ChunkBins>(), live Chunks;
        /// [`Decision`] of each active node.
        Decisions "decisions", size_of::<Decision>(), live ActiveNodes;
        /// The top tree: [`TopNode`].
        TopNodes "top_nodes", size_of::<TopNode>(), live TopNodes;
        /// First top node emitted by each level.
        LevelStarts "level_starts", 4, live Levels;
        /// The small list: [`SmallRoot`]. Until the middle stage it holds what the levels hand over to that.
        SmallRoots "small_roots", size_of::<SmallRoot>(), live SmallRoots;
        /// The roots of the middle stage: [`MiddleRoot`].
        MiddleRoots "middle_roots", size_of::<MiddleRoot>(), live MiddleRoots;
        /// The references of the middle roots while these are being finished, each root's in a region of its own:
        /// not compared.
        MiddleReferences "middle_references", size_of::<Reference>();
        /// The trees of the middle roots, by regions: [`TopNode`], `right` of a leaf being its successor. Not compared.
        MiddleNodes "middle_nodes", size_of::<TopNode>();
        /// The leaves of these trees, by regions: [`SmallRoot`]. Not compared.
        MiddleLeaves "middle_leaves", size_of::<SmallRoot>();
        /// [`Extent`] of each middle root's subtree.
        MiddleSizes "middle_sizes", size_of::<Extent>(), live MiddleRoots;
        /// [`Extent`] of each small root's subtree.
        SmallSizes "small_sizes", size_of::<Extent>(), live SmallRoots;
        /// Subtrees that `build_small` keeps for `emit_small`, as many as the backend chooses and
        /// in a form of its own: not compared.
        Subtrees "subtrees", 4 * SUBTREE_WORDS as usize;
        /// The parents of the top tree's nodes, in a form of a device's own: not compared.
        TopParents "top_parents", 4;
        /// [`Extent`] of each top node's subtree.
        TopSizes "top_sizes", size_of::<Extent>(), live TopNodes;
        /// [`Extent`]: where each top node's subtree starts.
        TopAddresses "top_addresses", size_of::<Extent>(), live TopNodes;
        /// [`Extent`]: where each small root's subtree starts.
        SmallAddresses "small_addresses", size_of::<Extent>(), live SmallRoots;
        /// The tree's nodes: [`KdNode`].
        Nodes "nodes", size_of::<KdNode>(), live Nodes;
        /// The tree's references.
        LeafReferences "leaf_references", 4, live LeafReferences;
        /// [`Counters`].
        Counters "counters", size_of::<Counters>();
    }

    /// The kernels of the tree builder. Each is a file of the same name in every backend.
    kernels Kernel {
        /// Snaps triangles, decides which are kept, bounds each 256 of them.
        TriangleBounds "triangle_bounds", Each(InputChunks) =>
            reads Input, writes Triangles, writes ChunkCounts, writes ChunkBounds;
        /// Scans the numbers kept, bounds the scene, makes the root.
        ScanTriangles "scan_triangles", One =>
            updates Counters,
            updates ChunkCounts, reads ChunkBounds, writes ActiveNodes, writes TopNodes;
        /// Writes the references of the root.
        GatherReferences "gather_references", Each(InputChunks) =>
            reads Triangles, reads ChunkCounts, writes References;
        /// Names the chunks of every active node, and bounds it, cuts empty space off it and splits it at
        /// its spatial median.
        SplitMedian "split_median", Each(ActiveNodes) =>
            reads ActiveNodes, reads ChunkBounds, reads References, writes Chunks, writes Decisions;
        /// Names the chunks of every active node, and bounds it: segmented reduction over chunks.
        NodeBounds "node_bounds", Each(ActiveNodes) =>
            reads ActiveNodes, reads ChunkBounds, writes Chunks, writes NodeBounds;
        /// Counts by bins where the references of every chunk start and end.
        BinReferences "bin_references", Each(Chunks) =>
            reads Chunks, reads NodeBounds, reads References, writes ChunkBins;
        /// Cuts empty space and splits every active node by binned SAH.
        SplitBinned "split_binned", Each(ActiveNodes) =>
            reads ActiveNodes, reads NodeBounds, reads ChunkBins, writes Decisions;
        /// Finds the sides each reference goes to and counts them by chunk, by 128 chunks of a node and by node.
        ClassifyReferences "classify_references", Each(Chunks) =>
            updates Chunks, updates Decisions, reads References, reads Triangles,
            writes ReferenceSides, writes ChunkCounts;
        /// Gives children their places: next list, small list, top tree.
        AllocateChildren "allocate_children", One =>
            updates Counters,
            reads ActiveNodes, updates Decisions, writes NextNodes, scatters SmallRoots,
            scatters TopNodes, scatters LevelStarts;
        /// Moves references to the children, clipped by the triangles, and bounds them by chunk.
        ScatterReferences "scatter_references", Each(Chunks) =>
            reads Chunks, reads Decisions, reads References, reads Triangles, reads ReferenceSides,
            reads ChunkCounts, writes NextReferences, scatters SmallReferences, writes ChunkBounds;
        /// Splits what the levels have handed over until it has T references or cannot be split.
        BuildMiddle "build_middle", Each(MiddleRoots) =>
            reads SmallRoots, reads SmallReferences, reads Triangles, writes MiddleRoots,
            writes MiddleReferences, writes MiddleNodes, writes MiddleLeaves;
        /// Gives the leaves of the middle stage their places in the small list.
        ScanMiddle "scan_middle", One => updates Counters, updates MiddleRoots;
        /// Moves the leaves of the middle stage to the small list.
        PlaceMiddle "place_middle", Each(MiddleRoots) =>
            reads MiddleRoots, reads MiddleReferences, reads MiddleLeaves,
            writes SmallRoots, writes SmallReferences;
        /// Builds the subtree of every small root and measures it.
        BuildSmall "build_small", Each(SmallRoots) =>
            reads SmallRoots, reads SmallReferences, writes SmallSizes, writes Subtrees;
        /// Sums the sizes of every middle root's leaves.
        MeasureMiddle "measure_middle", Each(MiddleRoots) =>
            reads MiddleRoots, reads SmallSizes, writes MiddleSizes;
        /// Sizes of the subtrees of the top tree, bottom up.
        SubtreeSizes "subtree_sizes", Invocations(TopNodes, 256) =>
            reads TopNodes, reads SmallSizes, reads MiddleSizes, writes TopParents, writes TopSizes;
        /// Counts the nodes and references of the whole tree, and gives the nodes of the top tree their preorder addresses: devices by a
        /// second dispatch, of an invocation a node.
        PreorderAddresses "preorder_addresses", One =>
            updates Counters, reads TopParents, reads TopSizes, writes TopAddresses;
        /// Writes the nodes of the middle roots' trees, and the addresses of the small roots below.
        EmitMiddle "emit_middle", Each(MiddleRoots) =>
            reads MiddleRoots, reads MiddleNodes, reads SmallSizes, reads TopAddresses,
            scatters Nodes, writes SmallAddresses;
        /// Writes the nodes of the top tree, and the addresses of its small roots.
        EmitTop "emit_top", Invocations(TopNodes, 256) =>
            reads TopNodes, reads TopAddresses, scatters Nodes, scatters SmallAddresses;
        /// Writes the subtrees of the small roots.
        EmitSmall "emit_small", Each(SmallRoots) =>
            reads SmallRoots, reads SmallReferences, reads SmallSizes, reads Subtrees,
            reads SmallAddresses, scatters Nodes, writes LeafReferences;
    }
}

/// Nodes of a slot that devices keep for `emit_small`. Subtrees of more than their slots hold are built again.
pub const SUBTREE_NODES: u32 = 42;
/// Words of a slot: three per node.
pub const SUBTREE_WORDS: u32 = 126;

const _: () = assert!(SUBTREE_WORDS == 3 * SUBTREE_NODES);

/// Slots that the kept subtree of a small root may take, for leaves in blocks of this width (W). Where leaves have one triangle, subtrees of
/// sponza have 81 nodes on average: with one slot most of them were built twice, which took an H100 two fifths of a build.
pub const fn subtree_slots(block_width: u32) -> u32 {
    if block_width < 4 { 4 } else { 1 }
}

/// What kernels count, and where in [`Counters::words`].
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Counter {
    /// Triangles of the mesh.
    Triangles = 0,
    /// Chunks of 256 triangles of the mesh.
    InputChunks,
    /// Triangles dropped.
    Dropped,
    /// Triangles with a snapped coordinate.
    Snapped,
    /// Nodes of the active list.
    ActiveNodes,
    /// Nodes of the next list.
    NextNodes,
    /// References of the active nodes.
    ActiveReferences,
    /// References of the next nodes.
    NextReferences,
    /// Chunks of the active nodes; of the input until there is a root.
    Chunks,
    /// Chunks of the next nodes.
    NextChunks,
    /// Small roots so far.
    SmallRoots,
    /// References of the small roots.
    SmallReferences,
    /// Nodes of the top tree so far.
    TopNodes,
    /// Levels of the large-node stage so far.
    Levels,
    /// Nodes of the finished tree.
    Nodes,
    /// References of the finished tree.
    LeafReferences,
    /// Bits that say which capacity did not suffice: see [`Overflow`].
    Overflow,
    /// References that the splits of large nodes have added, those that a cap refused included.
    Growth,
    /// Roots of the middle stage: what was handed over so far. None where there is no such stage.
    MiddleRoots,
    /// Levels of the large-node stage, those within the middle stage included.
    MiddleLevels,
}

/// The bits of [`Counter::Overflow`]: lists that outgrew their capacity on a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Overflow {
    /// Nodes of the next list.
    Nodes = 1,
    /// References of the next nodes.
    References = 2,
    /// Small roots.
    SmallRoots = 4,
    /// References of the small roots.
    SmallReferences = 8,
    /// Nodes of the top tree.
    TopNodes = 16,
    /// Levels.
    Levels = 32,
    /// Nodes of the tree.
    TreeNodes = 64,
    /// References of the tree.
    LeafReferences = 128,
    /// Chunks.
    Chunks = 256,
    /// Not a list: the device's driver ended a loop before its end, so that the build is void.
    Unfinished = 512,
    /// Not a list: the middle stage cannot finish what was handed over to it, so that the build is void and must be repeated
    /// without it.
    MiddleStage = 1024,
    /// Regions of the middle roots.
    MiddleRegions = 2048,
}

impl Overflow {
    /// All bits.
    pub const ALL: [Overflow; 12] = [
        Overflow::Nodes,
        Overflow::References,
        Overflow::SmallRoots,
        Overflow::SmallReferences,
        Overflow::TopNodes,
        Overflow::Levels,
        Overflow::TreeNodes,
        Overflow::LeafReferences,
        Overflow::Chunks,
        Overflow::Unfinished,
        Overflow::MiddleStage,
        Overflow::MiddleRegions,
    ];
}

impl Counter {
    /// All counters, by their word.
    pub const ALL: [Counter; 20] = [
        Counter::Triangles,
        Counter::InputChunks,
        Counter::Dropped,
        Counter::Snapped,
        Counter::ActiveNodes,
        Counter::NextNodes,
        Counter::ActiveReferences,
        Counter::NextReferences,
        Counter::Chunks,
        Counter::NextChunks,
        Counter::SmallRoots,
        Counter::SmallReferences,
        Counter::TopNodes,
        Counter::Levels,
        Counter::Nodes,
        Counter::LeafReferences,
        Counter::Overflow,
        Counter::Growth,
        Counter::MiddleRoots,
        Counter::MiddleLevels,
    ];
}

impl core::ops::Index<Counter> for Counters {
    type Output = u32;
    fn index(&self, counter: Counter) -> &u32 {
        &self.words[counter as usize]
    }
}

impl core::ops::IndexMut<Counter> for Counters {
    fn index_mut(&mut self, counter: Counter) -> &mut u32 {
        &mut self.words[counter as usize]
    }
}
