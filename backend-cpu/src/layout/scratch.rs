//! Making the layout that queries read from a tree.
//!
//! A layout is made in two steps. *Planning* touches nothing but scratch: each task packs the
//! leaves of one subtree and plans its wide nodes; then the few nodes above the tasks are planned.
//! Now the size of everything is known to the byte and compared with the limit. Then all of it is
//! allocated, and *filling* writes to that. It cannot fail, so an old layout is replaced only by a
//! complete one.

mod packed_words;
mod planning;

use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU64};

use splitplane_core::aabb::Aabb;
use splitplane_core::backend::QueryLayout;
use splitplane_core::error::BuildError;
use splitplane_core::mesh::Mesh;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::{KdNode, NodeKind};
use splitplane_core::triangle::Triangle;

use self::packed_words::{Budget, PackedWords};
use self::planning::LayoutPlanning;
use super::cells::halves;
use super::corners::are_written_out;
use super::large::Large;
use super::packed_block::UNIT_WORDS;
use super::plan::{Branch, Branches, PlaceCosts, Planner, run_nodes};
use super::walk_node::WalkNode;
use super::wide_node::MOST_LEAVES;
use crate::build::MOST_NODES;
use crate::cancel::ProgressMeter;
use crate::memory::{Memory, Scatter, bytes_of};
use crate::parallel::{Parallel, ParallelSlice};
use crate::simd::InstructionSet;
use crate::span;

/// Subtrees of more nodes are divided among tasks.
const TASK: u32 = 1 << 11;
/// The parts of a layout, in addition to a tree.
#[derive(Clone, Copy)]
pub(crate) struct LayoutSource<'a> {
    pub mesh: &'a Mesh<'a>,
    /// Its triangles' snapped corners.
    pub triangles: &'a [Triangle],
    pub layout: QueryLayout,
}

/// What layouts are made with, kept for the next one.
#[derive(Debug, Default)]
pub(crate) struct LayoutScratch {
    /// By the number of their node. Elements of nodes that are no branch are unused.
    pub branches: Vec<Branch>,
    /// The nodes above all tasks, and the tasks, in preorder.
    pub top: Vec<u32>,
    pub tasks: Vec<PackTask>,
    /// What the tasks have packed.
    pub parts: Vec<PackedWords>,
    /// The blocks of large triangles, after all others.
    large: PackedWords,
}

/// A subtree that one task packs and plans.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PackTask {
    /// Its nodes.
    pub first: u32,
    pub end: u32,
    cell: Aabb,
    costs: PlaceCosts,
    /// The first of its words in the layout.
    pub start: usize,
}

/// How large a planned layout is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LayoutSize {
    /// Words of blocks, without those that vector loads may read after them.
    pub words: usize,
    /// Wide nodes.
    pub wide: usize,
    /// What is much larger than its leaves.
    pub large: Large,
    /// Whether blocks have their corners written out.
    pub written: bool,
    /// The root's branch, if the tree has triangles.
    pub root: Option<u32>,
    /// Bytes that the scratch has grown by.
    pub scratch: u64,
}

impl LayoutScratch {
    /// Bytes held.
    pub(crate) fn bytes(&self) -> u64 {
        let LayoutScratch { branches, top, tasks, parts, large } = self;
        let words = parts.iter().chain([large]).map(|part| bytes_of(&part.words)).sum::<u64>();
        words + bytes_of(branches) + bytes_of(top) + bytes_of(tasks) + bytes_of(parts)
    }

    /// Packs and plans. Where the limit of `memory` is met, the size is still right, but it cannot be filled:
    /// the caller that accounts for it meets the limit too.
    ///
    /// # Errors
    /// [`BuildError::Cancelled`] by the watch; [`BuildError::TooLarge`] when children could not name all
    /// blocks; no memory for branches and lists of tasks within the limit, or less than it allows.
    pub(crate) fn plan(
        &mut self,
        tree: &KdTreeView<'_>,
        source: LayoutSource<'_>,
        set: InstructionSet,
        meter: &ProgressMeter<'_>,
        memory: &mut Memory,
    ) -> Result<LayoutSize, BuildError> {
        let (nodes, references) = (tree.nodes.len() as u64, tree.references.len() as u64);
        let too_large = BuildError::TooLarge { nodes, references };
        if nodes > u64::from(MOST_NODES) {
            return Err(too_large);
        }
        let LayoutScratch { branches, top, tasks, parts, large: apart } = self;
        memory.grow_watched(branches, tree.nodes.len(), meter)?;
        top.clear();
        tasks.clear();
        let end = tree.nodes.len() as u32;
        // Of two children each, they have one task more below them.
        let above = nodes_above(tree.nodes, 0, end);
        memory.make_room(top, above)?;
        memory.make_room(tasks, above + 1)?;
        memory.make_room(parts, above + 1)?;
        divide(tree.nodes, 0, end, &tree.bounds, top, tasks);
        parts.resize_with(tasks.len().max(parts.len()), PackedWords::default);
        let budget = Budget {
            held: AtomicU64::new(memory.held),
            limit: memory.limit.unwrap_or(u64::MAX),
            failed: AtomicBool::new(false),
        };
        let planner = Planner::new(set.lanes(), &tree.bounds);
        let mut large = Large::of(tree, source.triangles, meter);
        let written = source.layout != QueryLayout::Compact
            && are_written_out(set, tree.references, source.triangles);
        let maker = LayoutPlanning {
            tree,
            source,
            set,
            meter,
            planner,
            budget: &budget,
            large: &large,
            written,
        };
        let out = Scatter::new(&mut branches[..tree.nodes.len()]);
        let packing = span::pieces_of(1);
        tasks.par_iter_mut().zip(&mut *parts).for_each(|(task, part)| {
            let _piece = span::piece();
            let count = (task.end - task.first) as usize;
            // SAFETY: tasks have nodes of their own.
            let branches = unsafe { out.part(task.first as usize, count) };
            maker.make(task, part, branches);
        });
        drop(packing);
        let large_blocks = maker.pack_large(apart);
        meter.check()?;
        if budget.failed.load(Relaxed) {
            let needed = budget.held.load(Relaxed);
            return Err(BuildError::OutOfMemory { needed, limit: needed });
        }
        let mut branches = Branches(0, branches);
        let root = maker.join(0, &mut tasks.iter(), &mut branches);
        let mut words = 0;
        for (task, part) in tasks.iter_mut().zip(&*parts) {
            task.start = words;
            words += part.used;
        }
        large.blocks = [(words / UNIT_WORDS) as u32, large_blocks.unwrap_or(0)];
        words += apart.used;
        if words / UNIT_WORDS >= MOST_LEAVES {
            return Err(too_large);
        }
        // A tree without triangles has a root without children: rays within its bounds read it.
        let wide = match large.is_empty() {
            _ if tree.bounds.is_empty() => 0,
            true => root.whole().max(1) as usize,
            // A root above the tree's nodes, if there are any, and those of the large triangles.
            false => {
                let (lanes, blocks) = (set.lanes() as u32, large.blocks[1]);
                let own = if blocks < lanes { 0 } else { run_nodes(blocks, lanes) };
                (1 + own + root.whole()) as usize
            }
        };
        let scratch = budget.held.into_inner() - memory.held;
        Ok(LayoutSize { words, wide, large, written, root: root.branch(), scratch })
    }

    /// Writes the blocks, and the nodes of the tree with leaves that name them, to memory of the
    /// planned size.
    pub(crate) fn write(&self, tree: &KdTreeView<'_>, nodes: &mut [WalkNode], words: &mut [u32]) {
        let apart = self.large.words();
        let behind = words.len() - apart.len();
        words[behind..].copy_from_slice(apart);
        for &node in &self.top {
            nodes[node as usize] = WalkNode::interior(tree.nodes[node as usize]);
        }
        let (nodes, words) = (Scatter::new(nodes), Scatter::new(words));
        let _loop = span::pieces_of(1);
        self.tasks.par_iter().zip(&self.parts).for_each(|(task, part)| {
            let _piece = span::piece();
            let (first, end) = (task.first as usize, task.end as usize);
            // SAFETY: tasks have nodes of their own, and parts follow each other.
            let (nodes, words) =
                unsafe { (nodes.part(first, end - first), words.part(task.start, part.used)) };
            words.copy_from_slice(part.words());
            let unit = (task.start / UNIT_WORDS) as u32;
            let from = tree.nodes[first..end].iter().zip(&self.branches[first..end]);
            for (to, (node, branch)) in nodes.iter_mut().zip(from) {
                *to = match node.kind() {
                    NodeKind::Interior { .. } => WalkNode::interior(*node),
                    NodeKind::Leaf { count: 0, .. } => WalkNode::leaf(0, 0),
                    NodeKind::Leaf { .. } => {
                        WalkNode::leaf(unit + branch.children[0], branch.children[1])
                    }
                };
            }
        });
    }
}

/// How many nodes [`divide`] will put above the tasks.
fn nodes_above(nodes: &[KdNode], node: u32, end: u32) -> usize {
    match nodes[node as usize].kind() {
        NodeKind::Interior { right, .. } if end - node > TASK => {
            1 + nodes_above(nodes, node + 1, right) + nodes_above(nodes, right, end)
        }
        _ => 0,
    }
}

/// Divides the tree below a node, of which `end` is the first node after it, into tasks.
fn divide(
    nodes: &[KdNode],
    node: u32,
    end: u32,
    cell: &Aabb,
    top: &mut Vec<u32>,
    tasks: &mut Vec<PackTask>,
) {
    match nodes[node as usize].kind() {
        NodeKind::Interior { axis, split, right } if end - node > TASK => {
            top.push(node);
            let (left_cell, right_cell) = halves(cell, axis as usize, split);
            divide(nodes, node + 1, right, &left_cell, top, tasks);
            divide(nodes, right, end, &right_cell, top, tasks);
        }
        _ => {
            let costs = PlaceCosts::NOTHING;
            tasks.push(PackTask { first: node, end, cell: *cell, costs, start: 0 });
        }
    }
}
