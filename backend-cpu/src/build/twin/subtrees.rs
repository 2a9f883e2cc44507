//! Finished subtrees of small roots, kept until they are emitted.

use std::collections::TryReserveError;

use splitplane_core::tree::node::KdNode;

/// Consecutive subtrees, each in preorder. The caller says where indices count from.
#[derive(Debug, Default)]
pub(crate) struct Subtrees {
    /// Nodes.
    pub nodes: Vec<KdNode>,
    /// References.
    pub references: Vec<u32>,
}

impl Subtrees {
    /// Bytes held.
    pub(crate) fn bytes(&self) -> u64 {
        (self.nodes.capacity() * size_of::<KdNode>() + self.references.capacity() * 4) as u64
    }

    /// Removes all subtrees and keeps the memory.
    pub(crate) fn clear(&mut self) {
        self.nodes.clear();
        self.references.clear();
    }

    /// Appends a node.
    ///
    /// # Errors
    /// No memory for it.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn push(&mut self, node: KdNode) -> Result<(), TryReserveError> {
        self.nodes.try_reserve(1)?;
        self.nodes.push(node);
        Ok(())
    }

    /// Appends a leaf and its references. Indices of references count from `base`.
    ///
    /// # Errors
    /// No memory for it.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn leaf(
        &mut self,
        base: usize,
        references: impl ExactSizeIterator<Item = u32>,
    ) -> Result<(), TryReserveError> {
        self.references.try_reserve(references.len())?;
        let first = self.references.len() - base;
        self.push(KdNode::leaf(first as u32, references.len() as u32))?;
        self.references.extend(references);
        Ok(())
    }
}
