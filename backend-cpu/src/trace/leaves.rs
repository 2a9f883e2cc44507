//! What a child that is not a node represents in the two layouts: a block, or a leaf of the tree
//! whose triangles are gathered when a ray gets there.

use super::triangle_block::TriangleBlock;
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

    /// Space for one traversal.
    fn room() -> Self::Room;

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

/// Blocks: a child is the unit at which its block begins.
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

impl Leaves for PackedLeaves<'_> {
    const ONE: bool = true;
    type Room = ();
    type Block<'b>
        = PackedBlock<'b>
    where
        Self: 'b;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn room() {}

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
