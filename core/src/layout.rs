//! The records that kernels exchange: what crosses to a device. Scalar fields only, every size a
//! multiple of 16 bytes where a record holds vectors, so that WGSL lays them out alike.

mod compress;
mod near;
mod points;
mod queries;

use crate::aabb::Aabb;
use crate::config::MAX_BINS;
use bytemuck::{Pod, Zeroable};

pub use compress::{Compress, CompressCounters, Part};
pub use near::NearBatch;
pub use points::{
    POINT_CHUNK, PointBatch, PointBuild, PointCounters, PointExtent, PointRecord, PointSplit,
    SMALL_HEIGHT,
};
pub use queries::{
    BatchUniform, CheckParameters, SceneBatch, SceneUniform, TriangleCount, VertexCount,
    culling_bits,
};

/// A reference to a triangle from one node: the bounds of the triangle's part in the node. 32
/// bytes, half a cache line: it is moved whole.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Reference {
    /// Lower corner of the clipped bounds.
    pub lo: [f32; 3],
    /// Index of the triangle in the mesh.
    pub triangle: u32,
    /// Upper corner of the clipped bounds.
    pub hi: [f32; 3],
    /// Zero.
    pub padding: u32,
}

impl Reference {
    /// A reference with these bounds.
    #[inline]
    pub fn new(bounds: &Aabb, triangle: u32) -> Reference {
        Reference { lo: bounds.lo, triangle, hi: bounds.hi, padding: 0 }
    }

    /// The clipped bounds.
    #[inline]
    pub fn bounds(&self) -> Aabb {
        Aabb { lo: self.lo, hi: self.hi }
    }
}

/// A node of the active list: more than T triangles, not yet split.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct LargeNode {
    /// Lower corner of the cell.
    pub lo: [f32; 3],
    /// First reference in the active references.
    pub first: u32,
    /// Upper corner of the cell.
    pub hi: [f32; 3],
    /// Number of references.
    pub count: u32,
    /// Its place in the top tree.
    pub node: u32,
    /// Levels below the root.
    pub depth: u32,
    /// First of its parent's chunks: their bounds of this side give the node's bounds.
    pub source: u32,
    /// How many chunks its parent had.
    pub source_chunks: u32,
    /// 0 for a left child, 1 for a right one.
    pub side: u32,
    /// 1 when the plane that made this node separated nothing: both children got all references.
    pub inseparable: u32,
    /// First of its own chunks.
    pub first_chunk: u32,
    /// Zero.
    pub padding: u32,
}

impl LargeNode {
    /// The cell.
    #[inline]
    pub fn cell(&self) -> Aabb {
        Aabb { lo: self.lo, hi: self.hi }
    }
}

/// Up to 256 consecutive references of one active node.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Chunk {
    /// Index in the active list.
    pub node: u32,
    /// First reference.
    pub first: u32,
    /// Number of references, 1 to 256.
    pub count: u32,
    /// Of the first chunk of a span, [`SPAN`](crate::config::SPAN) chunks of a node: how many references of the span go left,
    /// in the low half, and right, in the high one, where the node is split. `classify_references` adds them up; zero in other
    /// chunks, and until then.
    pub span_sides: u32,
}

/// A number for each side of a plane.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Sides {
    /// Left.
    pub left: u32,
    /// Right.
    pub right: u32,
}

/// Which references of a chunk go to which side: a bit each, the first of the chunk lowest in the
/// first word. How many of a chunk's go before one of them is a population count.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct ChunkSides {
    /// Those that go left.
    pub left: [u32; 8],
    /// Those that go right.
    pub right: [u32; 8],
}

impl ChunkSides {
    /// All of a chunk of `count` references go left.
    pub fn all_left(count: u32) -> ChunkSides {
        let word = |k: u32| match count.saturating_sub(32 * k) {
            left @ 0..32 => (1 << left) - 1,
            _ => u32::MAX,
        };
        ChunkSides { left: core::array::from_fn(|k| word(k as u32)), right: [0; 8] }
    }

    /// How many go left, and how many right.
    pub fn counts(&self) -> Sides {
        let count = |words: &[u32; 8]| words.iter().map(|word| word.count_ones()).sum();
        Sides { left: count(&self.left), right: count(&self.right) }
    }
}

/// The decision on an active node: up to six cuts of empty space, then a split or a transfer.
///
/// `split_median` or `split_binned` writes the planes, `classify_references` the counts, `allocate_children` the rest.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Decision {
    /// Positions of the empty-space cuts, in order.
    pub cuts: [f32; 6],
    /// How many there are.
    pub cut_count: u32,
    /// Their sides (0 to 5, see [`build::split::empty_cutoff`](crate::build::split::empty_cutoff)), 4 bits each, first lowest.
    pub cut_sides: u32,
    /// Axis of the split; [`Decision::TRANSFER`] when the node goes to the small list as it is.
    pub axis: u32,
    /// Position of the split.
    pub position: f32,
    /// References of each child, none until they are counted; for a transfer, all on the left.
    pub counts: Sides,
    /// First reference of each child in the buffer its class goes to.
    pub first: Sides,
    /// First top node that this node emits.
    pub first_node: u32,
    /// The node's first reference, copied for `scatter_references`.
    pub source_first: u32,
}

impl Decision {
    /// No split: the node goes to the small list as it is, a small root or a leaf too large to
    /// split.
    pub const TRANSFER: u32 = 3;

    /// A bit of `cut_sides` that no side needs: a device could not finish the decision, so that the
    /// build is void.
    pub const UNDECIDED: u32 = 0x8000_0000;

    /// Side of cut `index`.
    #[inline]
    pub fn cut_side(&self, index: u32) -> usize {
        (self.cut_sides >> (4 * index) & 0xf) as usize
    }
}

/// A node of the top tree, which the large-node stage makes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct TopNode {
    /// Axis 0 to 2 of an interior node, [`TopNode::SMALL_ROOT`] or [`TopNode::EMPTY`].
    pub kind: u32,
    /// Bits of the split position.
    pub split: u32,
    /// Interior: the left child. Small root: its place in the small list.
    pub left: u32,
    /// Interior: the right child.
    pub right: u32,
}

impl TopNode {
    /// The node is a root of the small-node stage.
    pub const SMALL_ROOT: u32 = 3;
    /// The node is an empty leaf.
    pub const EMPTY: u32 = 4;
}

/// A root of the small-node stage, or a leaf that could not be split when it has more than T
/// references.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SmallRoot {
    /// Lower corner of the cell.
    pub lo: [f32; 3],
    /// First reference in the small references.
    pub first: u32,
    /// Upper corner of the cell.
    pub hi: [f32; 3],
    /// Number of references.
    pub count: u32,
    /// Its place in the top tree.
    pub node: u32,
    /// Levels below the root.
    pub depth: u32,
    /// Levels of the large-node stage before the one that would split it.
    pub level: u32,
    /// Zero.
    pub padding: u32,
}

impl SmallRoot {
    /// The cell.
    #[inline]
    pub fn cell(&self) -> Aabb {
        Aabb { lo: self.lo, hi: self.hi }
    }
}

/// A root of the middle stage: a node that the levels handed over, and what became of it. See [`build::middle`](crate::build::middle).
///
/// `build_middle` writes what it counts, `scan_middle` the places.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct MiddleRoot {
    /// Its place in the top tree.
    pub node: u32,
    /// First of the references that were handed over.
    pub first: u32,
    /// How many there were.
    pub count: u32,
    /// Levels of the large-node stage down to its deepest split.
    pub levels: u32,
    /// Nodes of its tree; its leaves are small roots or empty.
    pub nodes: u32,
    /// How many of them are small roots.
    pub leaves: u32,
    /// References of these.
    pub references: u32,
    /// References that its splits added.
    pub growth: u32,
    /// Place of its first leaf in the small list.
    pub first_leaf: u32,
    /// Place of its first reference among those of the small roots.
    pub first_reference: u32,
    /// 1 when it cannot be finished in its regions.
    pub outgrown: u32,
    /// Zero.
    pub padding: u32,
}

/// A number of nodes and of references: the size of a subtree, or its address in the output.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Extent {
    /// Nodes.
    pub nodes: u32,
    /// References.
    pub references: u32,
}

/// The bounds of a chunk's references by the child they went to.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ChunkBounds {
    /// Bounds of the references that went left, and of those that went right.
    pub sides: [Aabb; 2],
}

/// Where the references of a chunk start and end, by bins of the node's tight bounds: for each axis
/// and bin, starts in the low half of a word and ends in the high half. A chunk has 256 references,
/// so neither half can overflow. Bins beyond the configured number are zero.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct ChunkBins {
    /// A word for each axis and bin.
    pub words: [[u32; MAX_BINS as usize]; 3],
}

/// Everything kernels count. One buffer of words, of which the last are not in use; see [`kernel::Counter`](crate::kernel::Counter) for the names.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Counters {
    /// The words.
    pub words: [u32; 32],
}

/// The uniform that a device's kernels read. The configuration, limits that follow from it, and the
/// capacity of each list that grows; a list that would outgrow its capacity sets its bit in
/// [`kernel::Counter::Overflow`](crate::kernel::Counter::Overflow).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Parameters {
    /// Zero, which no compiler can know: the rounding barrier's.
    pub zero: u32,
    /// 1 when active and next lists have changed places an odd number of times: then each has the
    /// other's counters.
    pub swapped: u32,
    /// First item of this slice of a grid.
    pub first: u32,
    /// Items in this slice.
    pub count: u32,
    /// K_T.
    pub traversal_cost: u32,
    /// K_I.
    pub intersection_cost: u32,
    /// W.
    pub block_width: u32,
    /// T.
    pub small_node_limit: u32,
    /// Most references of a node that the levels hand over: T where there is no middle stage.
    pub hand_over_limit: u32,
    /// C_e in 256ths.
    pub empty_cutoff: u32,
    /// Most levels below the root.
    pub max_depth: u32,
    /// Most references alive in the large-node stage.
    pub reference_cap: u32,
    /// Most nodes of the large-node stage.
    pub node_cap: u32,
    /// Word of the input where indices begin; `u32::MAX` for a soup.
    pub first_index: u32,
    /// Capacity for chunks.
    pub chunk_room: u32,
    /// Capacity for active nodes.
    pub node_room: u32,
    /// Capacity for references of active nodes.
    pub reference_room: u32,
    /// Capacity for small roots.
    pub small_root_room: u32,
    /// Capacity for references of small roots.
    pub small_reference_room: u32,
    /// Capacity for nodes of the top tree.
    pub top_node_room: u32,
    /// Capacity for levels.
    pub level_room: u32,
    /// Capacity for nodes of the tree.
    pub tree_node_room: u32,
    /// Capacity for references of the tree.
    pub leaf_reference_room: u32,
    /// Capacity for subtrees.
    pub subtree_room: u32,
    /// Capacity for references of the regions of middle roots.
    pub middle_reference_room: u32,
    /// Capacity for nodes of these regions.
    pub middle_node_room: u32,
    /// Capacity for leaves of these regions.
    pub middle_leaf_room: u32,
    /// Bins of each axis.
    pub bins: u32,
    /// 1 when references are clipped.
    pub clip: u32,
    /// Which halves of lists that several bindings hold a dispatch sees. Bit 0: the second half of what it reads; bit
    /// 1: the second half of what it writes; bit 2: it writes references of small roots, not of the next level.
    pub view: u32,
    /// How many references of active nodes the first half of their list has; `u32::MAX` where one binding holds them.
    pub reference_half: u32,
    /// The same of the references of small roots.
    pub small_reference_half: u32,
}

const _: () = {
    assert!(size_of::<Parameters>() == 128);
    assert!(size_of::<Reference>() == 32);
    assert!(size_of::<LargeNode>() == 64);
    assert!(size_of::<Chunk>() == 16);
    assert!(size_of::<ChunkBins>() == 768);
    assert!(size_of::<ChunkSides>() * 8 == 2 * crate::config::CHUNK as usize);
    assert!(size_of::<Decision>() == 64);
    assert!(size_of::<TopNode>() == 16);
    assert!(size_of::<SmallRoot>() == 48);
    assert!(size_of::<MiddleRoot>() == 48);
    assert!(size_of::<ChunkBounds>() == 48);
    assert!(size_of::<Counters>() == 128);
};
