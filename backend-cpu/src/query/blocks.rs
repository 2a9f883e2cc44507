//! The layout that queries read, made from a tree: wide nodes ([`super::wide`]) and blocks of triangles
//! ([`super::record`]), and for the rare rays that need more care the tree's own nodes. In the compact
//! layout the tree itself and a copy of the mesh ([`super::indexed`]) stand for blocks.

use rayon::prelude::*;
use splitplane_core::backend::{BuildError, QueryLayout};
use splitplane_core::mesh::Mesh;
use splitplane_core::node::{KdNode, NodeKind};
use splitplane_core::tree::{KdTree, KdTreeView};
use splitplane_core::triangle::Triangle;

use super::indexed::IndexedMesh;
use super::instruction_set::InstructionSet;
use super::leaves::Indexed;
use super::record::{Packer, Record, TAIL, UNIT_WORDS};
#[cfg(target_arch = "aarch64")]
use super::simd::Neon;
#[cfg(target_arch = "x86_64")]
use super::simd::{Avx2, Avx512};
use super::simd::{MOST_LANES, Portable, Simd, prefetch};
use super::wide::{Content, WideNodes, WideScratch};
use crate::lookout::{self, Lookout, UNWATCHED};
use crate::scatter::Scatter;

/// Units that children can name, but for what ends a stack.
const MOST_UNITS: usize = (1 << 31) - 1;
/// Nodes looked through at a time.
const PIECE: usize = 1 << 12;

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

    /// The references of a leaf of the tree itself.
    #[inline(always)]
    pub fn references<'a>(&self, all: &'a [u32]) -> &'a [u32] {
        &all[self.word as usize..][..(self.tagged >> WalkNode::SHIFT) as usize]
    }
}

/// What a layout is made of besides a tree.
#[derive(Clone, Copy)]
pub(crate) struct Source<'a> {
    pub mesh: &'a Mesh<'a>,
    /// Its triangles' snapped corners.
    pub triangles: &'a [Triangle],
    pub layout: QueryLayout,
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
    /// In the compact layout only.
    mesh: Option<IndexedMesh>,
}

/// What layouts are made with, kept for the next one.
#[derive(Debug, Default)]
pub(crate) struct LayoutScratch {
    /// The blocks of pieces of the tree, and where they go.
    parts: Vec<Vec<u32>>,
    starts: Vec<usize>,
    wide: WideScratch,
}

impl LayoutScratch {
    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let words = self.parts.iter().map(Vec::capacity).sum::<usize>();
        (words * size_of::<u32>()) as u64 + self.wide.bytes()
    }
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
    /// Most bytes that the layout of a tree may take; for the compact one over a mesh.
    ///
    /// # Errors
    /// [`BuildError::TooLarge`] when children could not name all blocks.
    pub(crate) fn bytes_for(
        tree: &KdTreeView<'_>,
        compact: Option<&Mesh<'_>>,
        lanes: usize,
    ) -> Result<u64, BuildError> {
        let wide = WideNodes::most_bytes(tree, lanes) + WideNodes::scratch_bytes(tree);
        let (nodes, references) = (tree.nodes.len() as u64, tree.references.len() as u64);
        if nodes > u64::from(WalkNode::MOST) {
            return Err(BuildError::TooLarge { nodes, references });
        }
        if let Some(mesh) = compact {
            return Ok(wide + IndexedMesh::bytes_for(mesh));
        }
        let words = |nodes: &[KdNode]| {
            let words = |node: &KdNode| match node.kind() {
                // Without a shared corner: 13 words and a part of the first a triangle.
                NodeKind::Leaf { count, .. } => 14 * count as usize + 2 * UNIT_WORDS,
                NodeKind::Interior { .. } => 0,
            };
            nodes.iter().map(words).sum::<usize>()
        };
        let words = TAIL + tree.nodes.par_chunks(PIECE).map(words).sum::<usize>();
        if words / UNIT_WORDS >= MOST_UNITS {
            return Err(BuildError::TooLarge { nodes, references });
        }
        // Once in pieces and once put together.
        Ok(nodes * size_of::<WalkNode>() as u64 + 2 * (words * size_of::<u32>()) as u64 + wide)
    }

    /// Makes the layout of a tree, for an instruction set that the processor has; of no use when the
    /// lookout has ended it.
    pub(crate) fn new(
        tree: KdTree,
        source: Source<'_>,
        set: InstructionSet,
        look: &Lookout<'_>,
        scratch: &mut LayoutScratch,
    ) -> Blocks {
        let mut blocks = Blocks {
            tree,
            nodes: Vec::new(),
            set,
            wide: WideNodes::new(set.lanes()),
            words: Vec::new(),
            mesh: None,
        };
        blocks.refill(source, look, scratch);
        blocks
    }

    /// Makes the layout of another tree in the same memory.
    pub(crate) fn fill(
        &mut self,
        tree: &KdTreeView<'_>,
        source: Source<'_>,
        scratch: &mut LayoutScratch,
    ) {
        self.tree.nodes.clear();
        self.tree.nodes.extend_from_slice(tree.nodes);
        self.tree.references.clear();
        self.tree.references.extend_from_slice(tree.references);
        self.tree.bounds = tree.bounds;
        self.tree.triangles = tree.triangles;
        self.tree.config = tree.config;
        self.refill(source, &UNWATCHED, scratch);
    }

    fn refill(&mut self, source: Source<'_>, look: &Lookout<'_>, scratch: &mut LayoutScratch) {
        match source.layout {
            QueryLayout::Fast => self.refill_blocks(source.triangles, look, scratch),
            QueryLayout::Compact => self.refill_mesh(source, look, scratch),
        }
    }

    /// The compact layout: the mesh in place of blocks.
    fn refill_mesh(&mut self, source: Source<'_>, look: &Lookout<'_>, scratch: &mut LayoutScratch) {
        let Blocks { tree, nodes, wide, words, mesh, .. } = self;
        (*nodes, *words) = (Vec::new(), Vec::new());
        mesh.get_or_insert_default().fill(source.mesh, source.triangles, look);
        if look.is_over() {
            return;
        }
        let content = Content::References(&tree.references, source.triangles);
        let walk = bytemuck::cast_slice(&tree.nodes);
        wide.fill(&tree.view(), walk, content, look, &mut scratch.wide);
        look.advance(tree.nodes.len() as u64);
    }

    fn refill_blocks(
        &mut self,
        triangles: &[Triangle],
        look: &Lookout<'_>,
        scratch: &mut LayoutScratch,
    ) {
        let Blocks { set, tree, nodes, wide, words, mesh } = self;
        let LayoutScratch { parts, starts, wide: wide_scratch } = scratch;
        let set = *set;
        let tree = tree.view();
        *mesh = None;
        let lanes = wide.lanes();
        let pieces = tree.nodes.len().div_ceil(PIECE);
        parts.resize_with(pieces.max(parts.len()), Vec::new);
        let parts = &mut parts[..pieces];
        let nothing = WalkNode { word: 0, tagged: 0 };
        lookout::resize(look, nodes, tree.nodes.len(), &nothing);
        if look.is_over() {
            return;
        }
        let pack = Pack { tree: &tree, triangles, look, lanes };
        // Leaves name their blocks within their piece first.
        let work = nodes.par_chunks_mut(PIECE).zip(tree.nodes.par_chunks(PIECE)).zip(&mut *parts);
        work.for_each(|((nodes, from), part)| {
            // SAFETY: the set was found on this processor.
            unsafe { pack.pack(set, nodes, from, part) };
        });
        look.advance(tree.nodes.len() as u64);
        starts.clear();
        let mut length = 0;
        for part in &*parts {
            starts.push(length);
            length += part.len();
        }
        lookout::resize(look, words, length + TAIL, &0);
        if look.is_over() {
            return;
        }
        // A block without triangles, and what vector loads may read behind the last one.
        words[length..].fill(0);
        let out = Scatter::new(words);
        let work = nodes.par_chunks_mut(PIECE).zip(&*parts).zip(&*starts);
        work.for_each(|((nodes, part), &start)| {
            // SAFETY: parts follow each other without overlap.
            unsafe { out.part(start, part.len()) }.copy_from_slice(part);
            for node in nodes.iter_mut().filter(|node| node.tagged & 3 == 3) {
                node.word += (start / UNIT_WORDS) as u32;
            }
        });
        let content = Content::Blocks(words, (length / UNIT_WORDS) as u32);
        wide.fill(&tree, nodes, content, look, wide_scratch);
    }

    /// Bytes held for queries besides the tree.
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
    #[inline(always)]
    pub(crate) fn indexed(&self) -> Option<Indexed<'_>> {
        let mesh = self.mesh.as_ref()?;
        Some(Indexed { nodes: self.walk_nodes(), references: &self.tree.references, mesh })
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

/// What leaves are packed from.
struct Pack<'a> {
    tree: &'a KdTreeView<'a>,
    triangles: &'a [Triangle],
    look: &'a Lookout<'a>,
    lanes: usize,
}

impl Pack<'_> {
    /// Packs the leaves among some nodes.
    ///
    /// # Safety
    /// The processor must have `set`.
    unsafe fn pack(
        &self,
        set: InstructionSet,
        nodes: &mut [WalkNode],
        from: &[KdNode],
        out: &mut Vec<u32>,
    ) {
        // SAFETY: the caller's contract.
        unsafe {
            match set {
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx512 => self.pack_avx512(nodes, from, out),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx2 => self.pack_avx2(nodes, from, out),
                #[cfg(target_arch = "aarch64")]
                InstructionSet::Neon => self.pack_in::<Neon>(nodes, from, out),
                _ => self.pack_in::<Portable>(nodes, from, out),
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma,bmi1,bmi2,popcnt")]
    unsafe fn pack_avx512(&self, nodes: &mut [WalkNode], from: &[KdNode], out: &mut Vec<u32>) {
        // SAFETY: as for `pack`.
        unsafe { self.pack_in::<Avx512>(nodes, from, out) }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,popcnt")]
    unsafe fn pack_avx2(&self, nodes: &mut [WalkNode], from: &[KdNode], out: &mut Vec<u32>) {
        // SAFETY: as for `pack`.
        unsafe { self.pack_in::<Avx2>(nodes, from, out) }
    }

    /// # Safety
    /// As for [`Pack::pack`].
    #[inline(always)]
    unsafe fn pack_in<S: Simd>(&self, nodes: &mut [WalkNode], from: &[KdNode], out: &mut Vec<u32>) {
        out.clear();
        let mut packer = Packer::<S>::new(self.lanes);
        for (node, from) in nodes.iter_mut().zip(from) {
            *node = match from.kind() {
                NodeKind::Interior { axis, split, right } => {
                    let tagged = right << WalkNode::SHIFT | axis as u32;
                    WalkNode { word: split.to_bits(), tagged }
                }
                NodeKind::Leaf { first, count } => {
                    if self.look.worked(2 * u64::from(count)) {
                        return;
                    }
                    let word = (out.len() / UNIT_WORDS) as u32;
                    let references = self.tree.leaf(first, count);
                    // The next leaf's triangles, which are all over the mesh.
                    let next = (first + count) as usize;
                    for &triangle in self.tree.references.iter().skip(next).take(MOST_LANES) {
                        let corners = self.triangles.as_ptr().wrapping_add(triangle as usize);
                        prefetch(corners.cast());
                        prefetch(corners.cast::<u8>().wrapping_add(size_of::<Triangle>() - 1));
                    }
                    // SAFETY: the caller's contract.
                    let blocks = unsafe { packer.leaf(references, self.triangles, out) };
                    self.look.advance(u64::from(count));
                    WalkNode { word, tagged: blocks << WalkNode::SHIFT | 3 }
                }
            };
        }
    }
}
