//! The layout that queries read, made from a tree: wide nodes ([`super::wide`]) and blocks of triangles
//! ([`super::record`]), and for the rare rays that need more care the tree's own nodes.

use rayon::prelude::*;
use splitplane_core::backend::BuildError;
use splitplane_core::node::{KdNode, NodeKind};
use splitplane_core::tree::KdTreeView;
use splitplane_core::triangle::Triangle;

use super::instruction_set::InstructionSet;
use super::record::{Packer, Record, TAIL, UNIT};
#[cfg(target_arch = "aarch64")]
use super::simd::Neon;
#[cfg(target_arch = "x86_64")]
use super::simd::{Avx2, Avx512};
use super::simd::{Portable, Simd};
use super::wide::{WideNodes, WideScratch};
use crate::lookout::{self, Lookout};
use crate::scatter::Scatter;

/// Units that children can name, but for what ends a stack.
const MOST_UNITS: usize = (1 << 31) - 1;
/// Nodes looked through at a time.
const PIECE: usize = 1 << 12;

/// A node of the tree as its leaves name their blocks, 8 bytes in preorder like the canonical ones: the
/// axis in bits 0 and 1 of the second word (3 for a leaf), above them the right child, or the number of
/// blocks.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct WalkNode {
    /// Bits of the split position, or the leaf's first block in units of [`UNIT`] words.
    pub word: u32,
    /// Axis, and right child or number of blocks.
    pub tagged: u32,
}

impl WalkNode {
    /// Where child and count begin.
    pub const SHIFT: u32 = 2;
    /// Most nodes of a tree.
    pub const MOST: u32 = 1 << 28;
}

/// Nodes and triangles of a tree, for queries.
#[derive(Debug)]
pub(crate) struct Blocks {
    /// For which the layout is made.
    set: InstructionSet,
    pub(crate) nodes: Vec<WalkNode>,
    pub(crate) wide: WideNodes,
    pub(crate) words: Vec<u32>,
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
    /// Most bytes that the layout of a tree may take.
    ///
    /// # Errors
    /// [`BuildError::TooLarge`] when children could not name all blocks.
    pub(crate) fn bytes_for(tree: &KdTreeView<'_>, lanes: usize) -> Result<u64, BuildError> {
        let words = |nodes: &[KdNode]| {
            let words = |node: &KdNode| match node.kind() {
                // Without a shared corner: 13 words and a part of the first a triangle.
                NodeKind::Leaf { count, .. } => 14 * count as usize + 2 * UNIT,
                NodeKind::Interior { .. } => 0,
            };
            nodes.iter().map(words).sum::<usize>()
        };
        let words = TAIL + tree.nodes.par_chunks(PIECE).map(words).sum::<usize>();
        let (nodes, references) = (tree.nodes.len() as u64, tree.references.len() as u64);
        if words / UNIT >= MOST_UNITS || nodes > u64::from(WalkNode::MOST) {
            return Err(BuildError::TooLarge { nodes, references });
        }
        let bytes = nodes * size_of::<WalkNode>() as u64 + (words * size_of::<u32>()) as u64;
        Ok(bytes + WideNodes::most_bytes(tree, lanes))
    }

    /// Makes the layout of a tree from the snapped corners of its triangles, for an instruction set that
    /// the processor has. Of no use when the lookout has ended it.
    pub(crate) fn new(
        tree: &KdTreeView<'_>,
        triangles: &[Triangle],
        set: InstructionSet,
        look: &Lookout<'_>,
        scratch: &mut LayoutScratch,
    ) -> Blocks {
        let wide = WideNodes::new(set.lanes());
        let mut blocks = Blocks { set, nodes: Vec::new(), wide, words: Vec::new() };
        blocks.fill(tree, triangles, look, scratch);
        blocks
    }

    /// Makes the layout of another tree in the same memory.
    pub(crate) fn fill(
        &mut self,
        tree: &KdTreeView<'_>,
        triangles: &[Triangle],
        look: &Lookout<'_>,
        scratch: &mut LayoutScratch,
    ) {
        let Blocks { set, nodes, wide, words } = self;
        let LayoutScratch { parts, starts, wide: wide_scratch } = scratch;
        let set = *set;
        let lanes = wide.lanes();
        let pieces = tree.nodes.len().div_ceil(PIECE);
        parts.resize_with(pieces.max(parts.len()), Vec::new);
        let parts = &mut parts[..pieces];
        let nothing = WalkNode { word: 0, tagged: 0 };
        lookout::resize(look, nodes, tree.nodes.len(), &nothing);
        if look.is_over() {
            return;
        }
        let pack = Pack { tree, triangles, look, lanes };
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
                node.word += (start / UNIT) as u32;
            }
        });
        wide.fill(tree, nodes, (words, (length / UNIT) as u32), look, wide_scratch);
    }

    /// Bytes held for queries.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.nodes[..]) + size_of_val(&self.words[..])) as u64 + self.wide.bytes()
    }

    /// The blocks of a leaf of the tree's own nodes.
    #[inline]
    pub(crate) fn leaf(&self, node: &WalkNode) -> impl Iterator<Item = Record<'_>> {
        leaf(&self.words, node)
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
                    let word = (out.len() / UNIT) as u32;
                    let references = self.tree.leaf(first, count);
                    // SAFETY: the caller's contract.
                    let blocks = unsafe { packer.leaf(references, self.triangles, out) };
                    self.look.advance(u64::from(count));
                    WalkNode { word, tagged: blocks << WalkNode::SHIFT | 3 }
                }
            };
        }
    }
}
