//! The finished tree: one preorder array of nodes and one array of triangle references.

pub mod cost;
pub mod digest;
#[cfg(feature = "alloc")]
pub mod dump;
pub mod file;
pub mod node;
pub mod stats;
pub mod validate;

use crate::aabb::Aabb;
use crate::config::BuildConfig;
#[cfg(feature = "alloc")]
use crate::error::BuildError;
use crate::tree::digest::{Digest, Xxh64};
use crate::tree::node::{KdNode, NodeKind};
#[cfg(feature = "alloc")]
use alloc::vec::Vec;

/// A borrowed kd-tree: what every query, check and report takes.
///
/// `nodes[0]` is the root; a tree is never without one. The left child of node `i` is `i + 1`, the
/// whole left subtree is stored before the right one. Leaves name ranges of `references`, which
/// hold triangle indices in the order of the leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KdTreeView<'a> {
    /// The nodes in preorder.
    pub nodes: &'a [KdNode],
    /// Triangle indices, named by leaves.
    pub references: &'a [u32],
    /// Bounds of all triangles kept; the cell of the root. [`Aabb::EMPTY`] without triangles.
    pub bounds: Aabb,
    /// Triangles of the mesh, those dropped included: every reference is below it.
    pub triangles: u32,
    /// The configuration that shaped the tree.
    pub config: BuildConfig,
}

impl<'a> KdTreeView<'a> {
    /// The name of the tree: XXH64 with seed [`DIGEST_VERSION`] over, as little-endian 32-bit
    /// words, the configuration, the number of triangles, the six bounds (lower corner first), the
    /// number of nodes and of references, the nodes, the references. Of the configuration's words
    /// the last four count only where one of them is not zero.
    pub fn digest(&self) -> Digest {
        let mut state = Xxh64::new(DIGEST_VERSION);
        let config = self.config.words();
        let words = if config[9..] == [0; 4] { &config[..9] } else { &config[..] };
        state.write_words(words);
        state.write_words(&[self.triangles]);
        state.write_words(&self.bounds.lo.map(f32::to_bits));
        state.write_words(&self.bounds.hi.map(f32::to_bits));
        state.write_words(&[self.nodes.len() as u32, self.references.len() as u32]);
        state.write_words(bytemuck::cast_slice(self.nodes));
        state.write_words(self.references);
        Digest(state.finish())
    }

    /// The triangles of a leaf; empty for a range that does not exist.
    pub fn leaf(&self, first: u32, count: u32) -> &'a [u32] {
        let first = first as usize;
        first
            .checked_add(count as usize)
            .and_then(|end| self.references.get(first..end))
            .unwrap_or(&[])
    }

    /// Calls `visit(index, node, cell, depth)` for every node in preorder; children that point
    /// outside the array or backwards are skipped, so a damaged tree ends the walk early but never
    /// hangs it.
    pub fn walk(&self, mut visit: impl FnMut(usize, NodeKind, &Aabb, u32)) {
        let mut stack = [(0usize, Aabb::EMPTY, 0u32); crate::config::MAX_DEPTH as usize + 2];
        stack[0] = (0, self.bounds, 0);
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (index, cell, depth) = stack[top];
            let Some(node) = self.nodes.get(index) else { continue };
            let kind = node.kind();
            visit(index, kind, &cell, depth);
            if let NodeKind::Interior { axis, split, right } = kind
                && top + 2 <= stack.len()
                && right as usize > index + 1
            {
                let (mut left_cell, mut right_cell) = (cell, cell);
                left_cell.hi[axis.index()] = split;
                right_cell.lo[axis.index()] = split;
                stack[top] = (right as usize, right_cell, depth + 1);
                stack[top + 1] = (index + 1, left_cell, depth + 1);
                top += 2;
            }
        }
    }
}

/// Seed of the digest; raised whenever the same input may give other bytes.
pub const DIGEST_VERSION: u64 = 1;

/// An owned kd-tree.
#[cfg(feature = "alloc")]
#[derive(Clone, Debug, PartialEq)]
pub struct KdTree {
    /// The nodes in preorder.
    pub nodes: Vec<KdNode>,
    /// Triangle indices, named by leaves.
    pub references: Vec<u32>,
    /// Bounds of all triangles kept.
    pub bounds: Aabb,
    /// Triangles of the mesh, those dropped included.
    pub triangles: u32,
    /// The configuration that shaped the tree.
    pub config: BuildConfig,
}

#[cfg(feature = "alloc")]
impl KdTree {
    /// The tree, borrowed.
    pub fn view(&self) -> KdTreeView<'_> {
        KdTreeView {
            nodes: &self.nodes,
            references: &self.references,
            bounds: self.bounds,
            triangles: self.triangles,
            config: self.config,
        }
    }

    /// Shorthand for the digest of the view.
    pub fn digest(&self) -> Digest {
        self.view().digest()
    }
}

#[cfg(feature = "alloc")]
impl KdTreeView<'_> {
    /// A tree of its own with the same content.
    ///
    /// # Errors
    /// [`BuildError::OutOfMemory`] where the system has no memory for it.
    pub fn to_tree(&self) -> Result<KdTree, BuildError> {
        let (mut nodes, mut references) = (Vec::new(), Vec::new());
        let bytes = (size_of_val(self.nodes) + size_of_val(self.references)) as u64;
        let refused = |_| BuildError::OutOfMemory { needed: bytes, limit: bytes };
        nodes.try_reserve_exact(self.nodes.len()).map_err(refused)?;
        references.try_reserve_exact(self.references.len()).map_err(refused)?;
        nodes.extend_from_slice(self.nodes);
        references.extend_from_slice(self.references);
        let KdTreeView { bounds, triangles, config, .. } = *self;
        Ok(KdTree { nodes, references, bounds, triangles, config })
    }
}
