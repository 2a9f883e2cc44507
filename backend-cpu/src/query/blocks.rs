//! The layout that queries read: nodes whose leaves name blocks of corner copies.

use rayon::prelude::*;
use splitplane_core::node::{KdNode, NodeKind};
use splitplane_core::tree::KdTreeView;
use splitplane_core::triangle::Triangle;

use crate::lookout::{self, Lookout, UNWATCHED};
use crate::scatter::Scatter;

/// Triangles of a full block: the widest triangle test.
pub const BLOCK: usize = 16;
/// Rows of a block: nine coordinates (corner after corner) and the triangle index.
pub(crate) const ROWS: usize = 10;
/// Leaves start at multiples of this many words.
const UNIT: usize = 8;
/// Words behind the last block that a wide load may read.
const TAIL: usize = BLOCK;

/// Nodes looked through at a time.
const PIECE: usize = 1 << 15;

/// A node as queries read it, 8 bytes in preorder like the canonical ones: the axis in bits 0 and 1 of
/// the second word (3 for a leaf), in bits 2 and 3 whether the left and the right child are empty
/// leaves, above them the right child or the number of triangles. Most leaves that a ray passes are
/// empty: the bits spare visiting them.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct WalkNode {
    /// Bits of the split position, or the leaf's first block in units of 8 words.
    pub word: u32,
    /// Axis, empty children, right child or count.
    pub tagged: u32,
}

impl WalkNode {
    /// The left child is an empty leaf.
    pub const LEFT_EMPTY: u32 = 4;
    /// The right child is an empty leaf.
    pub const RIGHT_EMPTY: u32 = 8;
    /// Where child and count begin.
    pub const SHIFT: u32 = 4;
    /// Most nodes that the remaining 28 bits can name.
    pub const MOST: u32 = 1 << 28;
}

/// Nodes and leaf blocks.
///
/// A leaf of n triangles is a run of blocks of 16 and a last one of fewer; a block of m triangles is
/// a structure of arrays with rows of m rounded up to a multiple of 4, so short leaves waste little.
/// The nodes stand in the canonical preorder; a leaf's first word is its first block in units of 8
/// words.
#[derive(Debug)]
pub struct Blocks {
    pub(crate) nodes: Vec<WalkNode>,
    pub(crate) words: Vec<f32>,
    /// Leaves with triangles, while they are filled: first word, first reference, count.
    leaves: Vec<(usize, u32, u32)>,
}

/// One block of a leaf.
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

/// Length of a row that holds this many triangles.
fn stride(count: usize) -> usize {
    count.next_multiple_of(4)
}

/// Words of a leaf's blocks.
fn leaf_words(count: usize) -> usize {
    ROWS * (count / BLOCK * BLOCK + stride(count % BLOCK))
}

impl Blocks {
    /// Bytes of the layout of a tree.
    pub(crate) fn bytes_for(tree: &KdTreeView<'_>) -> u64 {
        let words = |nodes: &[KdNode]| {
            let words = |node: &KdNode| match node.kind() {
                NodeKind::Leaf { count, .. } => leaf_words(count as usize),
                NodeKind::Interior { .. } => 0,
            };
            nodes.iter().map(words).sum::<usize>()
        };
        let words = TAIL + tree.nodes.par_chunks(PIECE).map(words).sum::<usize>();
        (tree.nodes.len() * size_of::<WalkNode>() + words * size_of::<f32>()) as u64
    }

    /// Makes the layout of a tree from the snapped corners of its triangles.
    pub fn new(tree: &KdTreeView<'_>, triangles: &[Triangle]) -> Blocks {
        Blocks::watched(tree, triangles, &UNWATCHED)
    }

    /// As [`Blocks::new`]; of no use when the lookout has ended it.
    pub(crate) fn watched(
        tree: &KdTreeView<'_>,
        triangles: &[Triangle],
        look: &Lookout<'_>,
    ) -> Blocks {
        let mut blocks = Blocks { nodes: Vec::new(), words: Vec::new(), leaves: Vec::new() };
        blocks.refill(tree, triangles, look);
        blocks
    }

    /// Makes the layout of another tree in the same memory.
    pub fn fill(&mut self, tree: &KdTreeView<'_>, triangles: &[Triangle]) {
        self.refill(tree, triangles, &UNWATCHED);
    }

    fn refill(&mut self, tree: &KdTreeView<'_>, triangles: &[Triangle], look: &Lookout<'_>) {
        let Blocks { nodes, words, leaves } = self;
        nodes.clear();
        nodes.reserve_exact(tree.nodes.len());
        leaves.clear();
        let mut end = 0usize;
        let is_empty =
            |node: u32| matches!(tree.nodes[node as usize].kind(), NodeKind::Leaf { count: 0, .. });
        for (index, node) in tree.nodes.iter().enumerate() {
            if index % PIECE == 0 && look.worked(PIECE as u64 / 4) {
                return;
            }
            nodes.push(match node.kind() {
                NodeKind::Interior { axis, split, right } => {
                    let mut tagged = right << WalkNode::SHIFT | axis as u32;
                    if is_empty(index as u32 + 1) {
                        tagged |= WalkNode::LEFT_EMPTY;
                    }
                    if is_empty(right) {
                        tagged |= WalkNode::RIGHT_EMPTY;
                    }
                    WalkNode { word: split.to_bits(), tagged }
                }
                NodeKind::Leaf { first, count } => {
                    let start = end;
                    if count > 0 {
                        leaves.push((start, first, count));
                    }
                    end += leaf_words(count as usize);
                    WalkNode { word: (start / UNIT) as u32, tagged: count << WalkNode::SHIFT | 3 }
                }
            });
        }
        look.advance(tree.nodes.len() as u64);
        words.clear();
        words.reserve(end + TAIL);
        lookout::resize(look, words, end + TAIL, &0.0);
        if look.is_over() {
            return;
        }
        let out = Scatter::new(words);
        leaves.par_iter().with_min_len(64).for_each(|&(start, first, count)| {
            if look.worked(2 * u64::from(count)) {
                return;
            }
            let size = leaf_words(count as usize);
            // SAFETY: leaves follow each other without overlap.
            let mut words = unsafe { out.part(start, size) };
            for block in tree.leaf(first, count).chunks(BLOCK) {
                let stride = stride(block.len());
                let (rows, rest) = words.split_at_mut(ROWS * stride);
                for (i, &triangle) in block.iter().enumerate() {
                    let corners = &triangles[triangle as usize];
                    for (row, &x) in corners.as_flattened().iter().enumerate() {
                        rows[row * stride + i] = x;
                    }
                    rows[9 * stride + i] = f32::from_bits(triangle);
                }
                words = rest;
            }
            look.advance(u64::from(count));
        });
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.nodes[..]) + size_of_val(&self.words[..])) as u64
    }

    /// The blocks of a leaf of these nodes.
    #[inline]
    pub(crate) fn leaf(&self, first: u32, count: u32) -> impl Iterator<Item = Block<'_>> {
        let mut words = &self.words[first as usize * UNIT..];
        let mut left = count as usize;
        core::iter::from_fn(move || {
            if left == 0 {
                return None;
            }
            let count = left.min(BLOCK);
            let block = Block { words, stride: stride(count), count };
            words = &words[ROWS * block.stride..];
            left -= count;
            Some(block)
        })
    }
}
