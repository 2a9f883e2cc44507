//! The layout that queries read, made from a tree: wide nodes ([`super::wide`]) and blocks of triangles
//! ([`super::packed_block`]), and for the rare rays that need more care the tree's own nodes. In the compact
//! layout the tree itself and a copy of the mesh ([`super::indexed`]) stand for blocks.

use splitplane_core::aabb::Aabb;
use splitplane_core::backend::QueryLayout;
use splitplane_core::config::BuildConfig;
use splitplane_core::error::BuildError;
use splitplane_core::tree::node::KdNode;
use splitplane_core::tree::{KdTree, KdTreeView};
use splitplane_core::triangle::Triangle;

use super::indexed::IndexedMesh;
use super::large::Large;
use super::packed_block::{TAIL, UNIT_WORDS, WRITES_OUT};
use super::scratch::{LayoutScratch, LayoutSize, LayoutSource};
use super::walk_node::WalkNode;
use super::wide;
use super::wide::WideNodes;
use crate::cancel::{ProgressMeter, UNWATCHED};
use crate::memory::{Memory, bytes_of, extend, resize};
use crate::simd::InstructionSet;

/// Nodes and triangles of a tree, for queries.
#[derive(Debug)]
pub(crate) struct TreeLayout {
    /// For which the layout is made.
    set: InstructionSet,
    pub(crate) tree: KdTree,
    /// The tree's nodes, with leaves that name their blocks. Neither they nor blocks are there in the
    /// compact layout.
    pub(crate) nodes: Vec<WalkNode>,
    pub(crate) wide: WideNodes,
    pub(crate) words: Vec<u32>,
    /// Whether all blocks have their corners written out; otherwise none has.
    written: bool,
    /// Triangles that are much larger than their leaves.
    pub(crate) large: Large,
    /// In the compact layout only.
    mesh: Option<IndexedMesh>,
}

impl TreeLayout {
    /// No layout yet; for an instruction set that the processor has.
    pub(crate) fn none(set: InstructionSet) -> TreeLayout {
        let config = BuildConfig::default();
        let (nodes, references, bounds) = (Vec::new(), Vec::new(), Aabb::EMPTY);
        TreeLayout {
            set,
            tree: KdTree { nodes, references, bounds, triangles: 0, config },
            nodes: Vec::new(),
            wide: WideNodes::new(set.lanes()),
            words: Vec::new(),
            written: false,
            large: Large::none(Aabb::EMPTY),
            mesh: None,
        }
    }

    /// Makes the layout of a tree. After cancellation it is incomplete and must not be used.
    ///
    /// # Errors
    /// As for [`TreeLayout::plan`].
    pub(crate) fn new(
        tree: KdTree,
        source: LayoutSource<'_>,
        set: InstructionSet,
        meter: &ProgressMeter<'_>,
        memory: &mut Memory,
        scratch: &mut LayoutScratch,
    ) -> Result<TreeLayout, BuildError> {
        let mut blocks = TreeLayout::none(set);
        let size = blocks.plan(&tree.view(), source, meter, memory, scratch)?;
        blocks.make_room(source, tree.nodes.len(), &size, memory)?;
        blocks.tree = tree;
        blocks.fill(source, &size, meter, scratch);
        Ok(blocks)
    }

    /// Makes the layout of another tree in the same memory. After an error everything is as it was.
    ///
    /// # Errors
    /// As for [`TreeLayout::plan`].
    pub(crate) fn replace(
        &mut self,
        tree: &KdTreeView<'_>,
        source: LayoutSource<'_>,
        memory: &mut Memory,
        scratch: &mut LayoutScratch,
    ) -> Result<(), BuildError> {
        let held = &self.tree;
        let nodes = tree.nodes.len().max(held.nodes.capacity()) * size_of::<KdNode>();
        let references = tree.references.len().max(held.references.capacity()) * size_of::<u32>();
        memory.take((nodes + references) as u64)?;
        let size = self.plan(tree, source, &UNWATCHED, memory, scratch)?;
        memory.reserve(&mut self.tree.nodes, tree.nodes.len())?;
        memory.reserve(&mut self.tree.references, tree.references.len())?;
        self.make_room(source, tree.nodes.len(), &size, memory)?;
        // From here on nothing can fail.
        let KdTree { nodes, references, bounds, triangles, config } = &mut self.tree;
        nodes.clear();
        references.clear();
        extend(&UNWATCHED, nodes, tree.nodes);
        extend(&UNWATCHED, references, tree.references);
        (*bounds, *triangles, *config) = (tree.bounds, tree.triangles, tree.config);
        self.fill(source, &size, &UNWATCHED, scratch);
        Ok(())
    }

    /// Packs and plans, and accounts for the layout and for what the scratch has grown by.
    ///
    /// # Errors
    /// As for [`LayoutScratch::plan`], and more memory than the limit allows.
    fn plan(
        &self,
        tree: &KdTreeView<'_>,
        source: LayoutSource<'_>,
        meter: &ProgressMeter<'_>,
        memory: &mut Memory,
        scratch: &mut LayoutScratch,
    ) -> Result<LayoutSize, BuildError> {
        let size = scratch.plan(tree, source, self.set, meter, memory)?;
        let of = |length: usize, each: usize| (length * each) as u64;
        let wide = self.wide.bytes_for(size.wide).max(self.wide.held());
        // The memory of the other layout is held until this one has its own.
        let (mut nodes, mut words) = (bytes_of(&self.nodes), bytes_of(&self.words));
        let mut mesh = self.mesh.as_ref().map_or(0, IndexedMesh::held);
        match source.layout {
            QueryLayout::Compact => {
                let none = IndexedMesh::default();
                mesh = self.mesh.as_ref().unwrap_or(&none).held_with(source.mesh);
            }
            _ => {
                nodes = nodes.max(of(tree.nodes.len(), size_of::<WalkNode>()));
                words = words.max(of(size.words + TAIL, size_of::<u32>()));
            }
        }
        memory.take(size.scratch + wide + nodes + words + mesh)?;
        Ok(size)
    }

    /// Makes space for a planned layout of `nodes` nodes. After an error the layout is unchanged;
    /// otherwise it must be filled.
    ///
    /// # Errors
    /// As for [`Memory::reserve`].
    fn make_room(
        &mut self,
        source: LayoutSource<'_>,
        nodes: usize,
        size: &LayoutSize,
        memory: &Memory,
    ) -> Result<(), BuildError> {
        self.wide.make_room(size, memory)?;
        match source.layout {
            QueryLayout::Compact => {
                if let Some(mesh) = &mut self.mesh {
                    return mesh.make_room(source.mesh, memory);
                }
                let mut mesh = IndexedMesh::default();
                mesh.make_room(source.mesh, memory)?;
                self.mesh = Some(mesh);
                Ok(())
            }
            _ => {
                memory.reserve(&mut self.nodes, nodes)?;
                memory.reserve(&mut self.words, size.words + TAIL)
            }
        }
    }

    /// Writes the layout of the tree that is here, which the scratch has planned, to the space made
    /// for it.
    fn fill(
        &mut self,
        source: LayoutSource<'_>,
        size: &LayoutSize,
        meter: &ProgressMeter<'_>,
        scratch: &mut LayoutScratch,
    ) {
        let TreeLayout { tree, nodes, wide, words, written, large, mesh, .. } = self;
        (*large, *written) = (size.large, size.written);
        let leaves = match source.layout {
            QueryLayout::Compact => {
                (*nodes, *words) = (Vec::new(), Vec::new());
                mesh.get_or_insert_default().fill(source.mesh, source.triangles, meter);
                wide::LeafChildren::Nodes
            }
            _ => {
                *mesh = None;
                resize(meter, nodes, tree.nodes.len(), &WalkNode::leaf(0, 0));
                resize(meter, words, size.words + TAIL, &0);
                if meter.is_cancelled() {
                    return;
                }
                // A block without triangles, and the words that vector loads may read after the
                // last one.
                words[size.words..].fill(0);
                scratch.write(&tree.view(), nodes, &mut words[..size.words]);
                wide::LeafChildren::TreeLayout {
                    nodes,
                    words,
                    none: (size.words / UNIT_WORDS) as u32,
                }
            }
        };
        if !meter.is_cancelled() {
            wide.fill(leaves, &scratch.branches, size, tree.nodes.len(), meter);
        }
    }

    /// Capacity of tree and layout in bytes.
    pub(crate) fn held(&self) -> u64 {
        let KdTree { nodes, references, .. } = &self.tree;
        let tree = bytes_of(nodes) + bytes_of(references);
        let mesh = self.mesh.as_ref().map_or(0, IndexedMesh::held);
        tree + bytes_of(&self.nodes) + bytes_of(&self.words) + self.wide.held() + mesh
    }

    /// Bytes that queries read, in addition to the tree.
    pub(crate) fn bytes(&self) -> u64 {
        let mesh = self.mesh.as_ref().map_or(0, IndexedMesh::bytes);
        let blocks = size_of_val(&self.nodes[..]) + size_of_val(&self.words[..]);
        blocks as u64 + self.wide.bytes() + mesh
    }

    /// The layout that this is.
    pub(crate) fn layout(&self) -> QueryLayout {
        if self.mesh.is_some() { QueryLayout::Compact } else { QueryLayout::Fast }
    }

    /// Whether all blocks have their corners written out, so that no block has to be asked.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn is_written(&self) -> bool {
        WRITES_OUT && self.written
    }

    /// The mesh of the compact layout.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn mesh(&self) -> Option<&IndexedMesh> {
        self.mesh.as_ref()
    }

    /// The tree's nodes, root first; their leaves are for [`TreeLayout::any_triangle`].
    #[inline]
    pub(crate) fn walk_nodes(&self) -> &[WalkNode] {
        match self.mesh {
            // In the same format, except for the contents of leaves.
            Some(_) => WalkNode::of_tree(&self.tree.nodes),
            None => &self.nodes,
        }
    }

    /// Hands the triangles of a leaf to `test` one by one until it says true; whether it did.
    #[inline]
    pub(crate) fn any_triangle(
        &self,
        node: &WalkNode,
        mut test: impl FnMut(u32, &Triangle) -> bool,
    ) -> bool {
        match &self.mesh {
            Some(mesh) => {
                let mut references = node.references(&self.tree.references).iter();
                references.any(|&triangle| test(triangle, &mesh.corners(triangle)))
            }
            None => node.blocks(&self.words).any(|record| {
                (0..record.count())
                    .any(|index| test(record.triangle(index), &record.corners(index)))
            }),
        }
    }
}
