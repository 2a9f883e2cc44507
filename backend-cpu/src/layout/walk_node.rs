//! The tree's own nodes as scalar traversals read them: leaves name blocks of triangles, or references in the compact
//! layout.

use splitplane_core::tree::node::KdNode;

use super::packed_block::PackedBlock;

/// A node of the tree in the format of [`KdNode`]. Where blocks are packed, a leaf's first and count are not of references
/// but of blocks: the first one's unit ([`super::packed_block::UNIT_WORDS`] words each), and how many follow it.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct WalkNode(KdNode);

impl WalkNode {
    /// A leaf of `blocks` blocks, the first of which begins at `unit`.
    pub(crate) fn leaf(unit: u32, blocks: u32) -> WalkNode {
        WalkNode(KdNode::leaf(unit, blocks))
    }

    /// An interior node, as the tree has it.
    pub(crate) fn interior(node: KdNode) -> WalkNode {
        WalkNode(node)
    }

    /// The nodes of a tree whose leaves name references.
    pub(crate) fn of_tree(nodes: &[KdNode]) -> &[WalkNode] {
        bytemuck::cast_slice(nodes)
    }

    /// The nodes in the tree's format, for a walk that does not follow what leaves name.
    #[inline]
    pub(crate) fn as_tree(nodes: &[WalkNode]) -> &[KdNode] {
        bytemuck::cast_slice(nodes)
    }

    /// The node, to be decoded.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn node(&self) -> &KdNode {
        &self.0
    }

    /// The references of a leaf of the tree itself.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn references<'a>(&self, all: &'a [u32]) -> &'a [u32] {
        &all[self.0.first() as usize..][..self.0.count() as usize]
    }

    /// The blocks of a leaf.
    #[inline]
    pub(crate) fn blocks<'a>(&self, words: &'a [u32]) -> impl Iterator<Item = PackedBlock<'a>> {
        let mut unit = self.0.first();
        (0..self.0.count()).map(move |_| {
            let block = PackedBlock::at(words, unit);
            unit += block.units();
            block
        })
    }
}
