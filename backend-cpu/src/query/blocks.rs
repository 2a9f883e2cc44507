//! The layout that queries read: nodes whose leaves name blocks of corner copies.

use rayon::prelude::*;
use splitplane_core::node::{KdNode, NodeKind};
use splitplane_core::tree::KdTreeView;
use splitplane_core::triangle::Triangle;

use crate::scatter::Scatter;

/// Triangles of a full block: the widest triangle test.
pub const BLOCK: usize = 16;
/// Rows of a block: nine coordinates (corner after corner) and the triangle index.
pub(crate) const ROWS: usize = 10;
/// Leaves start at multiples of this many words.
const UNIT: usize = 8;
/// Words behind the last block that a wide load may read.
const TAIL: usize = BLOCK;

/// Nodes and leaf blocks.
///
/// A leaf of n triangles is a run of blocks of 16 and a last one of fewer; a block of m triangles is
/// a structure of arrays with rows of m rounded up to a multiple of 4, so short leaves waste little.
/// The nodes stand in the canonical preorder; a leaf's first word is its first block in units of 8
/// words.
#[derive(Debug)]
pub struct Blocks {
    pub(crate) nodes: Vec<KdNode>,
    pub(crate) words: Vec<f32>,
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
        core::array::from_fn(|corner| {
            core::array::from_fn(|axis| self.words[(corner * 3 + axis) * self.stride + index])
        })
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
    /// Makes the layout of a tree from the snapped corners of its triangles.
    pub fn new(tree: &KdTreeView<'_>, triangles: &[Triangle]) -> Blocks {
        let mut nodes = Vec::with_capacity(tree.nodes.len());
        let mut leaves = Vec::new();
        let mut end = 0usize;
        for node in tree.nodes {
            nodes.push(match node.kind() {
                NodeKind::Interior { .. } => *node,
                NodeKind::Leaf { first, count } => {
                    let start = end;
                    if count > 0 {
                        leaves.push((start, first, count));
                    }
                    end += leaf_words(count as usize);
                    KdNode::leaf((start / UNIT) as u32, count)
                }
            });
        }
        let mut words = vec![0.0; end + TAIL];
        let out = Scatter::new(&mut words);
        leaves.par_iter().with_min_len(64).for_each(|&(start, first, count)| {
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
        });
        Blocks { nodes, words }
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
