//! `build_small`: one workgroup a small root.
//!
//! Reads: small roots and their references. Writes: nodes and references of each root's subtree.
//! Ties: least cost, then axis, then position.
//!
//! The small-node stage of Zhou et al. 2008 on 64-bit masks: the candidates are the faces of the
//! references' bounds as they stand in the root; a candidate counts only where its own triangle is
//! in the node and the plane lies strictly inside. Depth first, left before right. A root emits at
//! most [`SMALL_ROOT_NODES`] nodes and [`SMALL_ROOT_REFERENCES`] references: a node whose split
//! would exceed either becomes a leaf. A root of more than T references is one leaf.

use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::config::{BuildConfig, SMALL_ROOT_NODES, SMALL_ROOT_REFERENCES};
use splitplane_core::layout::{Extent, Reference, SmallRoot};
use splitplane_core::node::{Axis, KdNode};
use splitplane_core::sah::{Extents, leaf_cost, split_cost};
use splitplane_core::split::{Rank, SplitPlane, goes_left, goes_right, strictly_inside};

/// Roots of one task. Their subtrees share two vectors.
pub const BATCH: usize = 32;

/// The subtrees of one batch, one behind the other. Indices count from each subtree's start.
#[derive(Debug, Default)]
pub struct Subtrees {
    /// Nodes.
    pub nodes: Vec<KdNode>,
    /// References.
    pub references: Vec<u32>,
}

impl Subtrees {
    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        (self.nodes.capacity() * size_of::<KdNode>() + self.references.capacity() * 4) as u64
    }
}

/// Runs the kernel. `subtrees` holds one element for each [`BATCH`] roots.
pub fn run(
    config: &BuildConfig,
    roots: &[SmallRoot],
    references: &[Reference],
    sizes: &mut [Extent],
    subtrees: &mut [Subtrees],
) {
    roots.par_chunks(BATCH).zip(sizes.par_chunks_mut(BATCH)).zip(subtrees).for_each(
        |((roots, sizes), out)| {
            out.nodes.clear();
            out.references.clear();
            let mut scratch = Root::new();
            for (root, size) in roots.iter().zip(sizes) {
                let mine = &references[root.first as usize..(root.first + root.count) as usize];
                let before = (out.nodes.len(), out.references.len());
                if root.count <= config.small_node_limit {
                    scratch.load(mine);
                    scratch.build(config, root, out);
                } else {
                    out.nodes.push(KdNode::leaf(0, root.count));
                    out.references.extend(mine.iter().map(|reference| reference.triangle));
                }
                *size = Extent {
                    nodes: (out.nodes.len() - before.0) as u32,
                    references: (out.references.len() - before.1) as u32,
                };
            }
        },
    );
}

/// A small root in cache: bounds, and the masks of every candidate.
struct Root {
    count: usize,
    triangles: [u32; 64],
    /// Lower and upper bounds by axis.
    lo: [[f32; 64]; 3],
    hi: [[f32; 64]; 3],
    /// Triangles left and right of the lower face of each triangle (0..64) and of its upper face
    /// (64..128), by axis.
    left: [[u64; 128]; 3],
    right: [[u64; 128]; 3],
}

/// A node not yet decided.
#[derive(Clone, Copy)]
struct Pending {
    mask: u64,
    cell: Aabb,
    depth: u32,
    /// The interior node whose right child this is; `u32::MAX` for a left child.
    parent: u32,
}

impl Root {
    fn new() -> Root {
        Root {
            count: 0,
            triangles: [0; 64],
            lo: [[0.0; 64]; 3],
            hi: [[0.0; 64]; 3],
            left: [[0; 128]; 3],
            right: [[0; 128]; 3],
        }
    }

    fn load(&mut self, references: &[Reference]) {
        self.count = references.len();
        for (i, reference) in references.iter().enumerate() {
            self.triangles[i] = reference.triangle;
            for axis in 0..3 {
                self.lo[axis][i] = reference.lo[axis];
                self.hi[axis][i] = reference.hi[axis];
            }
        }
        // Small roots below W never look at a mask other than by its extremes, but the paper's
        // preprocessing is cheap beside building.
        let n = self.count;
        for axis in 0..3 {
            let (lo, hi) = (&self.lo[axis][..n], &self.hi[axis][..n]);
            for candidate in 0..2 * n {
                let face = if candidate < n { candidate } else { 64 + candidate - n };
                let position = if candidate < n { lo[candidate] } else { hi[candidate - n] };
                let (mut left, mut right) = (0, 0);
                for j in 0..n {
                    left |= u64::from(goes_left(lo[j], hi[j], position)) << j;
                    right |= u64::from(goes_right(hi[j], position)) << j;
                }
                self.left[axis][face] = left;
                self.right[axis][face] = right;
            }
        }
    }

    fn build(&self, config: &BuildConfig, root: &SmallRoot, out: &mut Subtrees) {
        let first_node = out.nodes.len();
        let first_reference = out.references.len();
        let mask = if self.count == 64 { u64::MAX } else { (1 << self.count) - 1 };
        // Allocated so far, those pending included: what the caps of a root count.
        let (mut nodes, mut references) = (1, root.count);
        let mut stack = [Pending { mask, cell: root.cell(), depth: root.depth, parent: u32::MAX };
            splitplane_core::config::MAX_DEPTH as usize + 2];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let node = stack[top];
            let index = out.nodes.len() - first_node;
            if node.parent != u32::MAX {
                // The parent was written with its right child unknown.
                let parent = &mut out.nodes[first_node + node.parent as usize];
                let [split, tagged] = parent.words();
                *parent = KdNode::from_words([split, tagged | (index as u32) << 2]);
            }
            let count = node.mask.count_ones();
            let found =
                if node.depth < config.max_depth { self.best_split(config, &node) } else { None };
            if let Some((plane, left, right)) = found {
                let after = references + left.count_ones() + right.count_ones() - count;
                if nodes + 2 <= SMALL_ROOT_NODES && after <= SMALL_ROOT_REFERENCES {
                    nodes += 2;
                    references = after;
                    out.nodes.push(KdNode::interior(
                        Axis::from_index(plane.axis as u32),
                        plane.position,
                        0,
                    ));
                    let (mut left_cell, mut right_cell) = (node.cell, node.cell);
                    left_cell.hi[plane.axis] = plane.position;
                    right_cell.lo[plane.axis] = plane.position;
                    let depth = node.depth + 1;
                    stack[top] =
                        Pending { mask: right, cell: right_cell, depth, parent: index as u32 };
                    stack[top + 1] =
                        Pending { mask: left, cell: left_cell, depth, parent: u32::MAX };
                    top += 2;
                    continue;
                }
            }
            let first = (out.references.len() - first_reference) as u32;
            out.nodes.push(KdNode::leaf(first, count));
            let mut rest = node.mask;
            while rest != 0 {
                out.references.push(self.triangles[rest.trailing_zeros() as usize]);
                rest &= rest - 1;
            }
        }
    }

    /// The split of least rank, with the masks of its sides, if it costs less than a leaf.
    fn best_split(&self, config: &BuildConfig, node: &Pending) -> Option<(SplitPlane, u64, u64)> {
        let count = node.mask.count_ones();
        if count == 0 {
            return None;
        }
        let extents = Extents::of(&node.cell)?;
        let area = Extents::half_area(extents.cells);
        let leaf = leaf_cost(config, area, count);
        if leaf <= config.traversal_cost * area {
            return None;
        }
        let mut best = Rank { cost: leaf, axis: 0, position: 0 };
        let mut chosen = None;
        let mut consider = |axis: usize, face: usize, position: f32| {
            if !strictly_inside(&node.cell, axis, position) {
                return;
            }
            let left = node.mask & self.left[axis][face];
            let right = node.mask & self.right[axis][face];
            let areas = extents.split_areas(axis, extents.offset(node.cell.lo[axis], position));
            let cost = split_cost(config, areas, left.count_ones(), right.count_ones());
            if cost > best.cost {
                return;
            }
            let rank = Rank::new(cost, axis, position);
            if rank < best {
                best = rank;
                chosen = Some((SplitPlane { axis, position }, left, right));
            }
        };
        for axis in 0..3 {
            if count <= config.block_width {
                // With triangles on both sides a split costs no less than the leaf's one block: the
                // parts' areas add up to more than the whole's. Only planes with nothing on one
                // side can win, and the best of those touch the outermost bounds.
                let (mut lowest, mut highest) = ((f32::MAX, 0), (-f32::MAX, 0));
                let mut rest = node.mask;
                while rest != 0 {
                    let i = rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    if self.lo[axis][i] < lowest.0 {
                        lowest = (self.lo[axis][i], i);
                    }
                    if self.hi[axis][i] > highest.0 {
                        highest = (self.hi[axis][i], i);
                    }
                }
                consider(axis, lowest.1, lowest.0);
                consider(axis, 64 + highest.1, highest.0);
                continue;
            }
            let mut rest = node.mask;
            while rest != 0 {
                let i = rest.trailing_zeros() as usize;
                rest &= rest - 1;
                consider(axis, i, self.lo[axis][i]);
                consider(axis, 64 + i, self.hi[axis][i]);
            }
        }
        chosen
    }
}
