//! The layout that queries read, made from a tree: wide nodes ([`super::wide`]) and blocks of triangles
//! ([`super::record`]), and for the rare rays that need more care the tree's own nodes. In the compact
//! layout the tree itself and a copy of the mesh ([`super::indexed`]) stand for blocks.

use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{BuildError, QueryLayout};
use splitplane_core::config::BuildConfig;
use splitplane_core::node::KdNode;
use splitplane_core::tree::{KdTree, KdTreeView};
use splitplane_core::triangle::Triangle;

use super::indexed::IndexedMesh;
use super::instruction_set::InstructionSet;
use super::large::Large;
use super::layout::{LayoutScratch, Size, Source};
use super::leaves::Indexed;
use super::record::{Record, TAIL, UNIT_WORDS};
use super::wide::{self, WideNodes};
use crate::buffers::{Memory, bytes_of};
use crate::lookout::{self, Lookout, UNWATCHED};

/// A node of the tree as its leaves name their blocks, 8 bytes in preorder like the canonical ones: the
/// axis in bits 0 and 1 of the second word (3 for a leaf), above them the right child, or the number of
/// blocks.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct WalkNode {
    /// Bits of the split position, or the leaf's first block in units of [`UNIT_WORDS`] words.
    pub word: u32,
    /// Axis, and right child or number of blocks.
    pub tagged: u32,
}

impl WalkNode {
    /// Where child and count begin.
    pub const SHIFT: u32 = 2;
    /// Most nodes of a tree.
    pub const MOST: u32 = 1 << 28;

    /// A leaf of so many blocks, the first of which begins at a unit.
    pub fn leaf(unit: u32, blocks: u32) -> WalkNode {
        WalkNode { word: unit, tagged: blocks << WalkNode::SHIFT | 3 }
    }

    /// The references of a leaf of the tree itself.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn references<'a>(&self, all: &'a [u32]) -> &'a [u32] {
        &all[self.word as usize..][..(self.tagged >> WalkNode::SHIFT) as usize]
    }
}

/// Nodes and triangles of a tree, for queries.
#[derive(Debug)]
pub(crate) struct Blocks {
    /// For which the layout is made.
    set: InstructionSet,
    pub(crate) tree: KdTree,
    /// The tree's nodes, with leaves that name their blocks. Neither they nor blocks are there in the
    /// compact layout.
    pub(crate) nodes: Vec<WalkNode>,
    pub(crate) wide: WideNodes,
    pub(crate) words: Vec<u32>,
    /// Triangles that are much larger than their leaves.
    pub(crate) large: Large,
    /// In the compact layout only.
    mesh: Option<IndexedMesh>,
}

/// A block with all corners written out: nine rows of coordinates (corner after corner) and one of
/// triangle indices.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block<'a> {
    /// The block's rows, and what follows them: a wide load of any row stays inside.
    pub words: &'a [f32],
    /// Length of a row.
    pub stride: usize,
    /// Triangles, 1 to 16.
    pub count: usize,
    /// Whether they are [`Large`], in a block of their own.
    pub large: bool,
}

impl Block<'_> {
    /// The corners of a triangle.
    #[inline]
    pub fn corners(&self, index: usize) -> Triangle {
        let mut corners = [[0.0; 3]; 3];
        for (row, x) in corners.as_flattened_mut().iter_mut().enumerate() {
            *x = self.words[row * self.stride + index];
        }
        corners
    }

    /// The index of a triangle in the mesh.
    #[inline]
    pub fn triangle(&self, index: usize) -> u32 {
        self.words[9 * self.stride + index].to_bits()
    }
}

impl Blocks {
    /// No layout yet; for an instruction set that the processor has.
    pub(crate) fn none(set: InstructionSet) -> Blocks {
        let config = BuildConfig::default();
        let (nodes, references, bounds) = (Vec::new(), Vec::new(), Aabb::EMPTY);
        Blocks {
            set,
            tree: KdTree { nodes, references, bounds, triangles: 0, config },
            nodes: Vec::new(),
            wide: WideNodes::new(set.lanes()),
            words: Vec::new(),
            large: Large::none(Aabb::EMPTY),
            mesh: None,
        }
    }

    /// Makes the layout of a tree; of no use when the lookout has ended it.
    ///
    /// # Errors
    /// As for [`Blocks::plan`].
    pub(crate) fn new(
        tree: KdTree,
        source: Source<'_>,
        set: InstructionSet,
        look: &Lookout<'_>,
        memory: &mut Memory,
        scratch: &mut LayoutScratch,
    ) -> Result<Blocks, BuildError> {
        let mut blocks = Blocks::none(set);
        let size = blocks.plan(&tree.view(), source, look, memory, scratch)?;
        blocks.make_room(source, tree.nodes.len(), &size, memory)?;
        blocks.tree = tree;
        blocks.fill(source, &size, look, scratch);
        Ok(blocks)
    }

    /// Makes the layout of another tree in the same memory. After an error everything is as it was.
    ///
    /// # Errors
    /// As for [`Blocks::plan`].
    pub(crate) fn replace(
        &mut self,
        tree: &KdTreeView<'_>,
        source: Source<'_>,
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
        lookout::extend(&UNWATCHED, nodes, tree.nodes);
        lookout::extend(&UNWATCHED, references, tree.references);
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
        source: Source<'_>,
        look: &Lookout<'_>,
        memory: &mut Memory,
        scratch: &mut LayoutScratch,
    ) -> Result<Size, BuildError> {
        let size = scratch.plan(tree, source, self.set, look, memory)?;
        let of = |length: usize, each: usize| (length * each) as u64;
        let wide = self.wide.bytes_for(size.wide).max(self.wide.held());
        // What the other layout has is held until there is room for this one.
        let (mut nodes, mut words) = (bytes_of(&self.nodes), bytes_of(&self.words));
        let mut mesh = self.mesh.as_ref().map_or(0, IndexedMesh::held);
        match source.layout {
            QueryLayout::Compact => {
                let none = IndexedMesh::default();
                mesh = self.mesh.as_ref().unwrap_or(&none).held_with(source.mesh);
            }
            QueryLayout::Fast => {
                nodes = nodes.max(of(tree.nodes.len(), size_of::<WalkNode>()));
                words = words.max(of(size.words + TAIL, size_of::<u32>()));
            }
        }
        memory.take(size.scratch + wide + nodes + words + mesh)?;
        Ok(size)
    }

    /// Makes room for a planned layout of so many nodes. After an error what is here is what it was; else it is
    /// to be filled.
    ///
    /// # Errors
    /// As for [`Memory::reserve`].
    fn make_room(
        &mut self,
        source: Source<'_>,
        nodes: usize,
        size: &Size,
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
            QueryLayout::Fast => {
                memory.reserve(&mut self.nodes, nodes)?;
                memory.reserve(&mut self.words, size.words + TAIL)
            }
        }
    }

    /// Writes the layout of the tree that is here, which the scratch has planned, to the room made for it.
    fn fill(
        &mut self,
        source: Source<'_>,
        size: &Size,
        look: &Lookout<'_>,
        scratch: &mut LayoutScratch,
    ) {
        let Blocks { tree, nodes, wide, words, large, mesh, .. } = self;
        *large = size.large;
        let leaves = match source.layout {
            QueryLayout::Compact => {
                (*nodes, *words) = (Vec::new(), Vec::new());
                mesh.get_or_insert_default().fill(source.mesh, source.triangles, look);
                wide::LeafChildren::Nodes
            }
            QueryLayout::Fast => {
                *mesh = None;
                lookout::resize(look, nodes, tree.nodes.len(), &WalkNode::leaf(0, 0));
                lookout::resize(look, words, size.words + TAIL, &0);
                if look.is_over() {
                    return;
                }
                // A block without triangles, and what vector loads may read behind the last one.
                words[size.words..].fill(0);
                scratch.write(&tree.view(), nodes, &mut words[..size.words]);
                wide::LeafChildren::Blocks { nodes, words, none: (size.words / UNIT_WORDS) as u32 }
            }
        };
        if !look.is_over() {
            wide.fill(leaves, &scratch.branches, size, tree.nodes.len(), look);
        }
    }

    /// Bytes that tree and layout have room for.
    pub fn held(&self) -> u64 {
        let KdTree { nodes, references, .. } = &self.tree;
        let tree = bytes_of(nodes) + bytes_of(references);
        let mesh = self.mesh.as_ref().map_or(0, IndexedMesh::held);
        tree + bytes_of(&self.nodes) + bytes_of(&self.words) + self.wide.held() + mesh
    }

    /// Bytes of what queries read besides the tree.
    pub fn bytes(&self) -> u64 {
        let mesh = self.mesh.as_ref().map_or(0, IndexedMesh::bytes);
        let blocks = size_of_val(&self.nodes[..]) + size_of_val(&self.words[..]);
        blocks as u64 + self.wide.bytes() + mesh
    }

    /// The layout that this is.
    pub(crate) fn layout(&self) -> QueryLayout {
        if self.mesh.is_some() { QueryLayout::Compact } else { QueryLayout::Fast }
    }

    /// The leaves of the compact layout.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn indexed(&self) -> Option<Indexed<'_>> {
        let mesh = self.mesh.as_ref()?;
        let (references, large) = (&self.tree.references[..], self.large.triangles());
        Some(Indexed { nodes: self.walk_nodes(), references, large, mesh })
    }

    /// The tree's nodes, root first; their leaves are for [`Blocks::any_triangle`].
    #[inline]
    pub(crate) fn walk_nodes(&self) -> &[WalkNode] {
        match self.mesh {
            // Of the same format but for what a leaf names.
            Some(_) => bytemuck::cast_slice(&self.tree.nodes),
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
            None => leaf(&self.words, node).any(|record| {
                (0..record.count())
                    .any(|index| test(record.triangle(index), &record.corners(index)))
            }),
        }
    }
}

/// The blocks of a leaf.
#[inline]
pub(crate) fn leaf<'a>(words: &'a [u32], node: &WalkNode) -> impl Iterator<Item = Record<'a>> {
    let mut unit = node.word;
    (0..node.tagged >> WalkNode::SHIFT).map(move |_| {
        let record = Record::at(words, unit);
        unit += record.units();
        record
    })
}
