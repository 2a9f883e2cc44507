//! The kernel set of the tree builder: names, buffers, bindings, grids. The ABI between the schedule
//! and whoever runs it.

use crate::layout::{
    Chunk, ChunkBins, ChunkBounds, ChunkSides, Counters, Decision, Extent, LargeNode, Reference,
    Sides, SmallRoot, TopNode,
};
use crate::node::KdNode;

/// A family of kernels that one schedule runs: the tree builder is one, a renderer another.
pub trait KernelSet {
    /// The kernels.
    type Kernel: Copy + core::fmt::Debug + PartialEq;
    /// The buffers they exchange.
    type Buffer: Copy + core::fmt::Debug + PartialEq;
    /// The numbers that end loops.
    type Counter: Copy + core::fmt::Debug + PartialEq;

    /// Calls `visit` with every buffer that a kernel writes, counters included.
    fn written(kernel: Self::Kernel, visit: &mut dyn FnMut(Self::Buffer));

    /// Bytes of one element of a buffer.
    fn element_size(buffer: Self::Buffer) -> usize;
}

/// The tree builder (Zhou et al. 2008).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TreeBuilder {}

impl KernelSet for TreeBuilder {
    type Kernel = Kernel;
    type Buffer = Buffer;
    type Counter = Counter;

    fn written(kernel: Kernel, visit: &mut dyn FnMut(Buffer)) {
        for binding in kernel.bindings() {
            if binding.access != Access::Read {
                visit(binding.buffer);
            }
        }
        if kernel.writes_counters() {
            visit(Buffer::Counters);
        }
    }

    fn element_size(buffer: Buffer) -> usize {
        buffer.element_size()
    }
}

/// The kernels of the tree builder. Each is a file of the same name in every backend.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kernel {
    /// Snaps triangles, decides which are kept, bounds each 256 of them.
    TriangleBounds,
    /// Scans the numbers kept, bounds the scene, makes the root.
    ScanTriangles,
    /// Writes the references of the root.
    GatherReferences,
    /// Bounds every active node: segmented reduction over chunks.
    NodeBounds,
    /// Scans the numbers of chunks of the active nodes.
    ChunkNodes,
    /// Names node and range of every chunk.
    AssignChunks,
    /// Cuts empty space and splits every active node at its spatial median.
    SplitLarge,
    /// Counts by bins where the references of every chunk start and end.
    BinReferences,
    /// Cuts empty space and splits every active node by binned SAH.
    SplitBinned,
    /// Finds the sides each reference goes to and counts them by chunk.
    ClassifyReferences,
    /// Scans the counts of each node's chunks.
    CountChildren,
    /// Gives children their places: next list, small list, top tree.
    AllocateChildren,
    /// Moves references to the children, clipped, and bounds them by chunk.
    ScatterReferences,
    /// Builds the subtree of every small root and measures it.
    BuildSmall,
    /// Sizes of the subtrees of the top tree, bottom up.
    SubtreeSizes,
    /// Preorder addresses of the top tree, top down.
    PreorderAddresses,
    /// Writes the nodes of the top tree.
    EmitTop,
    /// Writes the subtrees of the small roots.
    EmitSmall,
}

impl Kernel {
    /// All kernels, in the order of the schedule.
    pub const ALL: [Kernel; 18] = [
        Kernel::TriangleBounds,
        Kernel::ScanTriangles,
        Kernel::GatherReferences,
        Kernel::NodeBounds,
        Kernel::ChunkNodes,
        Kernel::AssignChunks,
        Kernel::SplitLarge,
        Kernel::BinReferences,
        Kernel::SplitBinned,
        Kernel::ClassifyReferences,
        Kernel::CountChildren,
        Kernel::AllocateChildren,
        Kernel::ScatterReferences,
        Kernel::BuildSmall,
        Kernel::SubtreeSizes,
        Kernel::PreorderAddresses,
        Kernel::EmitTop,
        Kernel::EmitSmall,
    ];

    /// The name of the kernel's file.
    pub const fn name(self) -> &'static str {
        match self {
            Kernel::TriangleBounds => "triangle_bounds",
            Kernel::ScanTriangles => "scan_triangles",
            Kernel::GatherReferences => "gather_references",
            Kernel::NodeBounds => "node_bounds",
            Kernel::SplitLarge => "split_large",
            Kernel::BinReferences => "bin_references",
            Kernel::SplitBinned => "split_binned",
            Kernel::ChunkNodes => "chunk_nodes",
            Kernel::AssignChunks => "assign_chunks",
            Kernel::ClassifyReferences => "classify_references",
            Kernel::CountChildren => "count_children",
            Kernel::AllocateChildren => "allocate_children",
            Kernel::ScatterReferences => "scatter_references",
            Kernel::BuildSmall => "build_small",
            Kernel::SubtreeSizes => "subtree_sizes",
            Kernel::PreorderAddresses => "preorder_addresses",
            Kernel::EmitTop => "emit_top",
            Kernel::EmitSmall => "emit_small",
        }
    }

    /// What the kernel's workgroups stand for.
    pub const fn grid(self) -> Grid {
        match self {
            Kernel::TriangleBounds | Kernel::GatherReferences => Grid::Each(Counter::InputChunks),
            Kernel::NodeBounds
            | Kernel::SplitLarge
            | Kernel::SplitBinned
            | Kernel::CountChildren => Grid::Each(Counter::ActiveNodes),
            Kernel::AssignChunks
            | Kernel::BinReferences
            | Kernel::ClassifyReferences
            | Kernel::ScatterReferences => Grid::Each(Counter::Chunks),
            Kernel::BuildSmall | Kernel::EmitSmall => Grid::Each(Counter::SmallRoots),
            Kernel::EmitTop => Grid::Each(Counter::TopNodes),
            Kernel::ScanTriangles
            | Kernel::ChunkNodes
            | Kernel::AllocateChildren
            | Kernel::SubtreeSizes
            | Kernel::PreorderAddresses => Grid::One,
        }
    }

    /// The buffers the kernel reads and writes, besides [`Buffer::Counters`]. What a device binds
    /// is [`Kernel::storage_bindings`].
    pub const fn bindings(self) -> &'static [Binding] {
        use Access::{Read, ReadWrite, Write};
        use Buffer as B;
        const fn b(buffer: Buffer, access: Access) -> Binding {
            Binding { buffer, access }
        }
        match self {
            Kernel::TriangleBounds => {
                const {
                    &[
                        b(B::Input, Read),
                        b(B::Triangles, Write),
                        b(B::ChunkCounts, Write),
                        b(B::ChunkBounds, Write),
                    ]
                }
            }
            Kernel::ScanTriangles => {
                const {
                    &[
                        b(B::ChunkCounts, ReadWrite),
                        b(B::ChunkBounds, Read),
                        b(B::ActiveNodes, Write),
                        b(B::TopNodes, Write),
                    ]
                }
            }
            Kernel::GatherReferences => {
                const { &[b(B::Triangles, Read), b(B::ChunkCounts, Read), b(B::References, Write)] }
            }
            Kernel::NodeBounds => {
                const { &[b(B::ActiveNodes, Read), b(B::ChunkBounds, Read), b(B::NodeBounds, Write)] }
            }
            Kernel::SplitLarge => {
                const {
                    &[
                        b(B::ActiveNodes, Read),
                        b(B::NodeBounds, Read),
                        b(B::References, Read),
                        b(B::Decisions, Write),
                    ]
                }
            }
            Kernel::BinReferences => {
                const {
                    &[
                        b(B::Chunks, Read),
                        b(B::NodeBounds, Read),
                        b(B::References, Read),
                        b(B::ChunkBins, Write),
                    ]
                }
            }
            Kernel::SplitBinned => {
                const {
                    &[
                        b(B::ActiveNodes, Read),
                        b(B::NodeBounds, Read),
                        b(B::ChunkBins, Read),
                        b(B::Decisions, Write),
                    ]
                }
            }
            Kernel::ChunkNodes => const { &[b(B::ActiveNodes, ReadWrite)] },
            Kernel::AssignChunks => const { &[b(B::ActiveNodes, Read), b(B::Chunks, Write)] },
            Kernel::ClassifyReferences => {
                const {
                    &[
                        b(B::Chunks, Read),
                        b(B::Decisions, Read),
                        b(B::References, Read),
                        b(B::Triangles, Read),
                        b(B::ReferenceSides, Write),
                        b(B::ChunkCounts, Write),
                    ]
                }
            }
            Kernel::CountChildren => {
                const {
                    &[
                        b(B::ActiveNodes, Read),
                        b(B::ChunkCounts, ReadWrite),
                        b(B::Decisions, ReadWrite),
                    ]
                }
            }
            Kernel::AllocateChildren => {
                const {
                    &[
                        b(B::ActiveNodes, Read),
                        b(B::Decisions, ReadWrite),
                        b(B::NextNodes, Write),
                        b(B::SmallRoots, ReadWrite),
                        b(B::TopNodes, ReadWrite),
                        b(B::LevelStarts, ReadWrite),
                    ]
                }
            }
            Kernel::ScatterReferences => {
                // Triangles are read for clipping.
                const {
                    &[
                        b(B::Chunks, Read),
                        b(B::Decisions, Read),
                        b(B::References, Read),
                        b(B::Triangles, Read),
                        b(B::ReferenceSides, Read),
                        b(B::ChunkCounts, Read),
                        b(B::NextReferences, Write),
                        b(B::SmallReferences, ReadWrite),
                        b(B::ChunkBounds, Write),
                    ]
                }
            }
            Kernel::BuildSmall => {
                const {
                    &[
                        b(B::SmallRoots, Read),
                        b(B::SmallReferences, Read),
                        b(B::SmallSizes, Write),
                        b(B::Subtrees, Write),
                    ]
                }
            }
            Kernel::SubtreeSizes => {
                const {
                    &[
                        b(B::TopNodes, Read),
                        b(B::LevelStarts, Read),
                        b(B::SmallSizes, Read),
                        b(B::TopSizes, Write),
                    ]
                }
            }
            Kernel::PreorderAddresses => {
                const {
                    &[
                        b(B::TopNodes, Read),
                        b(B::LevelStarts, Read),
                        b(B::TopSizes, Read),
                        b(B::TopAddresses, Write),
                    ]
                }
            }
            Kernel::EmitTop => {
                const { &[b(B::TopNodes, Read), b(B::TopAddresses, Read), b(B::Nodes, ReadWrite)] }
            }
            Kernel::EmitSmall => {
                const {
                    &[
                        b(B::SmallRoots, Read),
                        b(B::SmallReferences, Read),
                        b(B::SmallSizes, Read),
                        b(B::Subtrees, Read),
                        b(B::TopAddresses, Read),
                        b(B::Nodes, ReadWrite),
                        b(B::LeafReferences, Write),
                    ]
                }
            }
        }
    }
}

impl Kernel {
    /// What a device binds for the kernel besides [`Buffer::Counters`]: its buffers, in order, with
    /// those that share a storage ([`Buffer::storage`]) named once, by it. At most seven, so that
    /// with the counters WebGPU's default of eight storage buffers suffices.
    pub fn storage_bindings(self) -> impl Iterator<Item = Binding> {
        let bindings = self.bindings();
        bindings.iter().enumerate().filter_map(move |(index, binding)| {
            let storage = binding.buffer.storage();
            let same = |other: &&Binding| other.buffer.storage() == storage;
            if bindings[..index].iter().any(|other| same(&other)) {
                return None;
            }
            let access = bindings[index..]
                .iter()
                .filter(same)
                .map(|other| other.access)
                .reduce(|a, b| if a == b { a } else { Access::ReadWrite })?;
            Some(Binding { buffer: storage, access })
        })
    }

    /// Whether the kernel writes counters. Only kernels of one workgroup do.
    pub const fn writes_counters(self) -> bool {
        matches!(
            self,
            Kernel::ScanTriangles
                | Kernel::ChunkNodes
                | Kernel::AllocateChildren
                | Kernel::SubtreeSizes
        )
    }
}

/// How many workgroups a dispatch means. Grids are fixed on devices; each workgroup loops until the
/// counter is reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grid {
    /// One workgroup does it all.
    One,
    /// One workgroup for each thing counted.
    Each(Counter),
}

/// What a kernel does with a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Reads.
    Read,
    /// Writes every live element.
    Write,
    /// Reads, or writes some elements and keeps others.
    ReadWrite,
}

/// A buffer and what a kernel does with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Binding {
    /// The buffer.
    pub buffer: Buffer,
    /// The access.
    pub access: Access,
}

/// The buffers that kernels exchange. Between dispatches every backend holds the same bytes in the
/// live range of each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Buffer {
    /// Positions and indices as the caller has them.
    Input,
    /// Snapped corners by triangle index: 9 `f32`.
    Triangles,
    /// References of the active nodes: [`Reference`].
    References,
    /// References of the next level.
    NextReferences,
    /// References of the small roots.
    SmallReferences,
    /// The active list: [`LargeNode`].
    ActiveNodes,
    /// The next list.
    NextNodes,
    /// Tight bounds of the active nodes: [`crate::aabb::Aabb`].
    NodeBounds,
    /// [`Chunk`].
    Chunks,
    /// [`Sides`]: counts, then offsets within the node.
    ChunkCounts,
    /// [`ChunkBounds`].
    ChunkBounds,
    /// Chunk counts, reference sides and chunk bounds under one binding.
    ChunkState,
    /// [`ChunkSides`] of each chunk.
    ReferenceSides,
    /// [`ChunkBins`] of each chunk.
    ChunkBins,
    /// [`Decision`] of each active node.
    Decisions,
    /// The top tree: [`TopNode`].
    TopNodes,
    /// First top node emitted by each level.
    LevelStarts,
    /// The small list: [`SmallRoot`].
    SmallRoots,
    /// [`Extent`] of each small root's subtree.
    SmallSizes,
    /// Subtrees that `build_small` keeps for `emit_small`, as far as a backend likes and in a form
    /// of its own: not compared.
    Subtrees,
    /// [`Extent`] of each top node's subtree.
    TopSizes,
    /// [`Extent`]: where each top node's subtree starts.
    TopAddresses,
    /// The tree's nodes: [`KdNode`].
    Nodes,
    /// The tree's references.
    LeafReferences,
    /// [`Counters`].
    Counters,
}

impl Buffer {
    /// Bytes of one element.
    pub const fn element_size(self) -> usize {
        match self {
            Buffer::Input | Buffer::LevelStarts | Buffer::LeafReferences => 4,
            Buffer::Triangles => 36,
            Buffer::References | Buffer::NextReferences | Buffer::SmallReferences => {
                size_of::<Reference>()
            }
            Buffer::ActiveNodes | Buffer::NextNodes => size_of::<LargeNode>(),
            Buffer::NodeBounds => 24,
            Buffer::Chunks => size_of::<Chunk>(),
            Buffer::ChunkCounts => size_of::<Sides>(),
            Buffer::ChunkBounds => size_of::<ChunkBounds>(),
            Buffer::ChunkState => {
                size_of::<Sides>() + size_of::<ChunkSides>() + size_of::<ChunkBounds>()
            }
            Buffer::ReferenceSides => size_of::<ChunkSides>(),
            Buffer::ChunkBins => size_of::<ChunkBins>(),
            Buffer::Decisions => size_of::<Decision>(),
            Buffer::TopNodes => size_of::<TopNode>(),
            Buffer::SmallRoots => size_of::<SmallRoot>(),
            Buffer::SmallSizes | Buffer::TopSizes | Buffer::TopAddresses => size_of::<Extent>(),
            Buffer::Nodes => size_of::<KdNode>(),
            Buffer::Subtrees => 4 * SUBTREE_WORDS as usize,
            Buffer::Counters => size_of::<Counters>(),
        }
    }

    /// The buffer whose storage holds this one on a device: what a chunk is known by shares one.
    pub const fn storage(self) -> Buffer {
        match self {
            Buffer::ChunkCounts | Buffer::ReferenceSides | Buffer::ChunkBounds => {
                Buffer::ChunkState
            }
            other => other,
        }
    }

    /// The counter that holds the number of live elements; `None` for a fixed length.
    pub const fn live(self) -> Option<Counter> {
        Some(match self {
            Buffer::Input | Buffer::Subtrees | Buffer::Counters => return None,
            Buffer::Triangles => Counter::Triangles,
            Buffer::References => Counter::ActiveReferences,
            Buffer::NextReferences => Counter::NextReferences,
            Buffer::SmallReferences => Counter::SmallReferences,
            Buffer::ActiveNodes | Buffer::NodeBounds | Buffer::Decisions => Counter::ActiveNodes,
            Buffer::NextNodes => Counter::NextNodes,
            Buffer::Chunks
            | Buffer::ChunkCounts
            | Buffer::ReferenceSides
            | Buffer::ChunkBounds
            | Buffer::ChunkBins
            | Buffer::ChunkState => Counter::Chunks,
            Buffer::TopNodes | Buffer::TopSizes | Buffer::TopAddresses => Counter::TopNodes,
            Buffer::LevelStarts => Counter::Levels,
            Buffer::SmallRoots | Buffer::SmallSizes => Counter::SmallRoots,
            Buffer::Nodes => Counter::Nodes,
            Buffer::LeafReferences => Counter::LeafReferences,
        })
    }
}

/// Nodes of a subtree that devices keep for `emit_small`; larger ones are built again.
pub const SUBTREE_NODES: u32 = 24;
/// References of such a subtree.
pub const SUBTREE_REFERENCES: u32 = 80;
/// Words of a subtree that is kept: two a node, then one a reference.
pub const SUBTREE_WORDS: u32 = 128;

const _: () = assert!(SUBTREE_WORDS == 2 * SUBTREE_NODES + SUBTREE_REFERENCES);

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
    /// Chunks of the active nodes; of the input before the first level.
    Chunks,
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
}

/// The bits of [`Counter::Overflow`]: lists that outgrew their room on a device.
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
}

impl Overflow {
    /// All bits.
    pub const ALL: [Overflow; 10] = [
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
    ];
}

impl Counter {
    /// All counters, by their word.
    pub const ALL: [Counter; 16] = [
        Counter::Triangles,
        Counter::InputChunks,
        Counter::Dropped,
        Counter::Snapped,
        Counter::ActiveNodes,
        Counter::NextNodes,
        Counter::ActiveReferences,
        Counter::NextReferences,
        Counter::Chunks,
        Counter::SmallRoots,
        Counter::SmallReferences,
        Counter::TopNodes,
        Counter::Levels,
        Counter::Nodes,
        Counter::LeafReferences,
        Counter::Overflow,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bindings_fit_the_default_limits_and_name_no_buffer_twice() {
        for kernel in Kernel::ALL {
            let bindings: [Option<Binding>; 12] = {
                let mut storage = kernel.storage_bindings();
                core::array::from_fn(|_| storage.next())
            };
            assert!(bindings.iter().flatten().count() <= 7, "{kernel:?}");
            for (i, a) in bindings.iter().flatten().enumerate() {
                let mut before = bindings.iter().flatten().take(i);
                assert!(before.all(|b| b.buffer != a.buffer), "{kernel:?}");
            }
            let named = kernel.bindings();
            for (i, a) in named.iter().enumerate() {
                assert!(named[..i].iter().all(|b| b.buffer != a.buffer), "{kernel:?}");
            }
        }
    }
}
