//! What a child that is no node stands for, in the two layouts: a block, or a leaf of the tree whose
//! triangles are gathered when a ray comes there.

use super::blocks::{Block, Blocks, WalkNode};
use super::indexed::{IndexedMesh, Room};
use super::leaf::Triangles;
use super::record::{Record, UNIT_WORDS};
use super::simd::Simd;

/// Where traversals find the triangles of a child. Children are numbers here, without their mark.
pub(crate) trait Leaves: Copy {
    /// Whether a child is always one block.
    const ONE: bool;
    /// What a traversal must have for blocks to be made in.
    type Room;
    /// A block.
    type Block<'b>: Triangles
    where
        Self: 'b;

    /// Room for one traversal.
    fn room() -> Self::Room;

    /// What of a child is read first; not to be read for numbers of other children.
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
pub(crate) struct Packed<'a> {
    words: &'a [u32],
}

impl<'a> Packed<'a> {
    /// The blocks of a layout.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(blocks: &'a Blocks) -> Packed<'a> {
        Packed { words: &blocks.words }
    }
}

impl Leaves for Packed<'_> {
    const ONE: bool = true;
    type Room = ();
    type Block<'b>
        = Record<'b>
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
        (unsafe { Record::at_unchecked(self.words, child) }, 0)
    }
}

/// Leaves of the tree: a child is the leaf's place among the nodes, or behind all of them, for the large triangles.
#[derive(Clone, Copy)]
pub(crate) struct Indexed<'a> {
    pub nodes: &'a [WalkNode],
    pub references: &'a [u32],
    pub large: &'a [u32],
    pub mesh: &'a IndexedMesh,
}

impl Leaves for Indexed<'_> {
    const ONE: bool = false;
    type Room = Room;
    type Block<'b>
        = Block<'b>
    where
        Self: 'b;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn room() -> Room {
        Room::EMPTY
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
        room: &'b mut Room,
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
        (Block { large, ..self.mesh.gather(some, room) }, next)
    }
}
