//! What a child that is not a node represents in the two layouts: a block, or a leaf of the tree
//! whose triangles are gathered when a ray gets there.

use super::triangle_block::{TriangleBlock, WrittenBlock};
use crate::layout::gathered_block::GatheredBlock;
use crate::layout::indexed::{GatherBuffer, IndexedMesh};
use crate::layout::packed_block::{PackedBlock, UNIT_WORDS};
use crate::layout::tree_layout::TreeLayout;
use crate::layout::walk_node::WalkNode;
use crate::simd::Simd;

/// Where traversals find the triangles of a child. Children are numbers here, without their mark.
pub(crate) trait Leaves: Copy {
    /// Whether a child is always one block.
    const ONE: bool;
    /// The space in which a traversal gathers blocks.
    type Room;
    /// A block.
    type Block<'b>: TriangleBlock
    where
        Self: 'b;

    /// The same leaves where no block has its corners written out, so that none is asked.
    type Shared: Leaves;

    /// Space for one traversal.
    fn room() -> Self::Room;

    /// These leaves as those; no block may have its corners written out.
    fn shared(self) -> Self::Shared;

    /// A block as one with corners written out, if it is that and is not read so already.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn written<'b, S: Simd>(_: &Self::Block<'b>) -> Option<WrittenBlock<'b>>
    where
        Self: 'b,
    {
        None
    }

    /// The part of a child that is read first; must not be read for numbers of other children.
    fn address(self, child: u32) -> *const u8;

    /// A child's block that begins with its triangle `from`, and where the next one begins; 0 after the
    /// last.
    ///
    /// # Safety
    /// The child must be one that a node names.
    unsafe fn block<'b, S: Simd>(
        self,
        child: u32,
        from: usize,
        room: &'b mut Self::Room,
    ) -> (Self::Block<'b>, usize)
    where
        Self: 'b;
}

/// Blocks: a child is the unit at which its block begins. Each is asked how its corners are stored, for who goes from mesh to mesh or asks
/// little.
#[derive(Clone, Copy)]
pub(crate) struct PackedLeaves<'a> {
    words: &'a [u32],
}

impl<'a> PackedLeaves<'a> {
    /// The blocks of a layout.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn new(blocks: &'a TreeLayout) -> PackedLeaves<'a> {
        PackedLeaves { words: &blocks.words }
    }
}

impl<'a> Leaves for PackedLeaves<'a> {
    const ONE: bool = true;
    type Room = ();
    type Block<'b>
        = PackedBlock<'b>
    where
        Self: 'b;
    type Shared = SharedLeaves<'a>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn room() {}

    #[cfg_attr(not(unoptimised), inline(always))]
    fn shared(self) -> SharedLeaves<'a> {
        SharedLeaves(self)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn written<'b, S: Simd>(block: &PackedBlock<'b>) -> Option<WrittenBlock<'b>>
    where
        Self: 'b,
    {
        if S::WRITES_OUT { WrittenBlock::of(block) } else { None }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn address(self, child: u32) -> *const u8 {
        self.words.as_ptr().wrapping_add((child as usize).wrapping_mul(UNIT_WORDS)).cast()
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn block<'b, S: Simd>(
        self,
        child: u32,
        _: usize,
        (): &'b mut (),
    ) -> (Self::Block<'b>, usize)
    where
        Self: 'b,
    {
        // SAFETY: the caller's contract.
        (unsafe { PackedBlock::at_unchecked(self.words, child) }, 0)
    }
}

/// Blocks of which none has its corners written out.
#[derive(Clone, Copy)]
pub(crate) struct SharedLeaves<'a>(PackedLeaves<'a>);

impl Leaves for SharedLeaves<'_> {
    const ONE: bool = true;
    type Room = ();
    type Block<'b>
        = PackedBlock<'b>
    where
        Self: 'b;
    type Shared = Self;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn room() {}

    #[cfg_attr(not(unoptimised), inline(always))]
    fn shared(self) -> Self {
        self
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn address(self, child: u32) -> *const u8 {
        self.0.address(child)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn block<'b, S: Simd>(
        self,
        child: u32,
        from: usize,
        room: &'b mut (),
    ) -> (Self::Block<'b>, usize)
    where
        Self: 'b,
    {
        // SAFETY: the caller's contract.
        unsafe { self.0.block::<S>(child, from, room) }
    }
}

/// Blocks that all have their corners written out.
#[derive(Clone, Copy)]
pub(crate) struct WrittenLeaves<'a>(PackedLeaves<'a>);

impl<'a> WrittenLeaves<'a> {
    /// The blocks of a layout that [is written](TreeLayout::is_written).
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn new(layout: &'a TreeLayout) -> WrittenLeaves<'a> {
        debug_assert!(layout.is_written());
        WrittenLeaves(PackedLeaves::new(layout))
    }
}

impl Leaves for WrittenLeaves<'_> {
    const ONE: bool = true;
    type Room = ();
    type Block<'b>
        = WrittenBlock<'b>
    where
        Self: 'b;
    type Shared = Self;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn room() {}

    #[cfg_attr(not(unoptimised), inline(always))]
    fn shared(self) -> Self {
        self
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn address(self, child: u32) -> *const u8 {
        self.0.address(child)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn block<'b, S: Simd>(
        self,
        child: u32,
        from: usize,
        room: &'b mut (),
    ) -> (Self::Block<'b>, usize)
    where
        Self: 'b,
    {
        // SAFETY: the caller's contract.
        let (block, next) = unsafe { self.0.block::<S>(child, from, room) };
        (WrittenBlock::of_written(block), next)
    }
}

/// Leaves of the tree: a child is the leaf's place among the nodes, or after all of them, for the
/// large triangles.
#[derive(Clone, Copy)]
pub(crate) struct IndexedLeaves<'a> {
    pub nodes: &'a [WalkNode],
    pub references: &'a [u32],
    pub large: &'a [u32],
    pub mesh: &'a IndexedMesh,
}

impl<'a> IndexedLeaves<'a> {
    /// The leaves of a compact layout; `None` for layouts with blocks.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn of(layout: &'a TreeLayout) -> Option<IndexedLeaves<'a>> {
        let mesh = layout.mesh()?;
        let (references, large) = (&layout.tree.references[..], layout.large.triangles());
        Some(IndexedLeaves { nodes: layout.walk_nodes(), references, large, mesh })
    }
}

impl Leaves for IndexedLeaves<'_> {
    const ONE: bool = false;
    type Room = GatherBuffer;
    type Block<'b>
        = GatheredBlock<'b>
    where
        Self: 'b;
    type Shared = Self;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn shared(self) -> Self {
        self
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn room() -> GatherBuffer {
        GatherBuffer::EMPTY
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn address(self, child: u32) -> *const u8 {
        self.nodes.as_ptr().wrapping_add(child as usize).cast()
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn block<'b, S: Simd>(
        self,
        child: u32,
        from: usize,
        room: &'b mut GatherBuffer,
    ) -> (Self::Block<'b>, usize)
    where
        Self: 'b,
    {
        let (references, large) = match self.nodes.get(child as usize) {
            Some(node) => (node.references(self.references), false),
            None => (self.large, true),
        };
        let references = &references[from..];
        // As many as there are lanes at a time.
        let (some, next) = match references.split_at_checked(S::N) {
            Some((some, rest)) => (some, if rest.is_empty() { 0 } else { from + S::N }),
            None => (references, 0),
        };
        (GatheredBlock { large, ..self.mesh.gather(some, room) }, next)
    }
}
