//! Wide nodes: the tree with several levels in one node, made when queries get it.
//!
//! A wide node has up to 8 or 16 children, as many as a vector has lanes. Each represents a subtree
//! of the kd-tree, a leaf's block of triangles, or a run of them, and has a box: the part of its
//! cell that its triangles reach into. A ray tests all boxes at once. The cells are apart, and the
//! planes between them say which come first for rays of an octant: so the order of the children is
//! known for every octant when the node is made, and nothing is sorted while a ray is under way.
//! Empty leaves and the planes beside them vanish in the boxes.
//!
//! Which levels go together has been planned ([`super::plan`]), and how many nodes a subtree
//! becomes: so all are written where they stay, by many tasks. A node's subtrees follow it
//! consecutively.

use splitplane_core::aabb::Aabb;
use splitplane_core::error::BuildError;
use splitplane_core::query::intersect::{longest_extent, widened};

use super::cells::part;
use super::large::Large;
use super::order::Order;
use super::packed_block::PackedBlock;
use super::plan::{Branch, run_nodes};
use super::scratch::LayoutSize;
use super::walk_node::WalkNode;
use super::wide_node::{self, CacheLine};
use crate::cancel::ProgressMeter;
use crate::memory::{Memory, bytes_of, resize};
use crate::parallel::{Parallel, ParallelSlice};
use crate::simd::{MOST_LANES, prefetch};
use crate::span;

/// Subtrees of more nodes are written by several tasks.
const TASK: usize = 1 << 8;
/// Nodes with this many above them are written by one task: all threads have work long before, and tasks within
/// tasks take a few times the stack.
const DIVIDED: usize = 8;

/// The nodes of a tree in the format of [`super::wide_node`], the root first.
#[derive(Debug)]
pub(crate) struct WideNodes {
    lanes: usize,
    lines: Vec<CacheLine>,
    /// Most nodes on a path from the root.
    depth: usize,
}

/// How leaves of a tree are represented as children of nodes.
#[derive(Clone, Copy)]
pub(crate) enum LeafChildren<'a> {
    /// Blocks: the tree's nodes that name them, the words, and the unit of a block without triangles.
    TreeLayout { nodes: &'a [WalkNode], words: &'a [u32], none: u32 },
    /// The tree's own leaves, which are children as they are, however many triangles they have.
    Nodes,
}

/// What nodes are written from.
#[derive(Clone, Copy)]
struct Writer<'a> {
    lanes: usize,
    leaves: LeafChildren<'a>,
    branches: &'a [Branch],
    large: &'a Large,
    /// The entry of places without a child. No ray goes there, and one that did would find a leaf
    /// without triangles.
    nothing: u32,
    meter: &'a ProgressMeter<'a>,
    /// Progress that a node counts for.
    share: u64,
}

/// A child of a node, and its box.
#[derive(Clone, Copy)]
struct Child {
    kind: ChildKind,
    bounds: Aabb,
}

#[derive(Clone, Copy)]
enum ChildKind {
    /// Of two subtrees at least.
    Branch(u32),
    /// Two or more blocks of a leaf that follow each other: the first one's unit and how many.
    Run(u32, u32),
    /// A block, or a leaf of the tree.
    Leaf(u32),
}

/// The children of a node, from left to right.
struct NodeChildren {
    children: [Child; MOST_LANES],
    count: usize,
    order: Order,
}

impl WideNodes {
    /// No nodes yet, for vectors of `lanes` lanes.
    pub(crate) fn new(lanes: usize) -> WideNodes {
        WideNodes { lanes, lines: Vec::new(), depth: 0 }
    }

    /// Lines of a node.
    pub(crate) fn node_lines(&self) -> usize {
        wide_node::lines_of_node(self.lanes)
    }

    /// The nodes, stored consecutively.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn lines(&self) -> &[CacheLine] {
        &self.lines
    }

    /// Capacity in bytes.
    pub(crate) fn held(&self) -> u64 {
        bytes_of(&self.lines)
    }

    /// Bytes of this number of nodes.
    pub(crate) fn bytes_for(&self, nodes: usize) -> u64 {
        (nodes * self.node_lines() * size_of::<CacheLine>()) as u64
    }

    /// Makes space for the planned nodes, which has been accounted for.
    ///
    /// # Errors
    /// As for [`Memory::reserve`].
    pub(crate) fn make_room(
        &mut self,
        size: &LayoutSize,
        memory: &Memory,
    ) -> Result<(), BuildError> {
        let lines = size.wide * self.node_lines();
        memory.reserve(&mut self.lines, lines)
    }

    /// Entries that a stack needs: of every node on the way down all children but one, and as many
    /// more as are written without counting.
    pub(crate) fn stack(&self) -> usize {
        (self.depth + 2) * self.lanes + MOST_LANES
    }

    /// Most nodes on a path from the root for which a stack of `entries` is enough.
    pub(crate) const fn deepest(lanes: usize, entries: usize) -> usize {
        (entries - MOST_LANES) / lanes - 2
    }

    /// Most nodes on a path from the root.
    pub(crate) fn depth(&self) -> usize {
        self.depth
    }

    /// Bytes of the nodes.
    pub(crate) fn bytes(&self) -> u64 {
        size_of_val(&self.lines[..]) as u64
    }

    /// Makes the planned nodes of a tree of `nodes` nodes, for which there is space. After
    /// cancellation they are incomplete and must not be used.
    pub(crate) fn fill(
        &mut self,
        leaves: LeafChildren<'_>,
        branches: &[Branch],
        size: &LayoutSize,
        nodes: usize,
        meter: &ProgressMeter<'_>,
    ) {
        let lines = size.wide * self.node_lines();
        resize(meter, &mut self.lines, lines, &CacheLine([0; 16]));
        self.depth = 0;
        if meter.is_cancelled() || lines == 0 {
            return;
        }
        let nothing = match leaves {
            LeafChildren::TreeLayout { none, .. } => none,
            // In preorder the last node is a leaf.
            LeafChildren::Nodes => nodes as u32 - 1,
        };
        let share = (nodes / 2 / size.wide) as u64;
        let nothing = wide_node::leaf_child(nothing);
        let large = &size.large;
        let writer = Writer { lanes: self.lanes, leaves, branches, large, nothing, meter, share };
        let mut made = NodeChildren::none();
        match size.root.map(|root| writer.child(root)) {
            root if !large.is_empty() => writer.spread_root(root, nodes as u32, &mut made),
            Some(root) => writer.spread(root, self.lanes, true, &mut made),
            None => {}
        }
        self.depth = writer.write(&made, 0, &mut self.lines, 0);
    }
}

impl Writer<'_> {
    /// A branch as a child.
    fn child(&self, branch: u32) -> Child {
        let Branch { bounds, .. } = self.branches[branch as usize];
        let kind = match self.leaves {
            _ if self.branches[branch as usize].axis().is_some() => ChildKind::Branch(branch),
            LeafChildren::Nodes => ChildKind::Leaf(branch),
            LeafChildren::TreeLayout { nodes, .. } => {
                let leaf = &nodes[branch as usize];
                Writer::run(leaf.node().first(), leaf.node().count())
            }
        };
        Child { kind, bounds }
    }

    /// One block or more.
    fn run(unit: u32, blocks: u32) -> ChildKind {
        if blocks > 1 { ChildKind::Run(unit, blocks) } else { ChildKind::Leaf(unit) }
    }

    /// Nodes that a child is made of.
    fn nodes(&self, child: &Child) -> usize {
        match child.kind {
            ChildKind::Branch(branch) => self.branches[branch as usize].nodes as usize,
            ChildKind::Run(_, blocks) => run_nodes(blocks, self.lanes as u32) as usize,
            ChildKind::Leaf(_) => 0,
        }
    }

    /// Writes the nodes of a subtree, given the children of its root, and says how many levels they have. `first`
    /// is the number of the first, `lines` are theirs, and `above` is the number of levels above them.
    fn write(
        &self,
        made: &NodeChildren,
        first: usize,
        lines: &mut [CacheLine],
        above: usize,
    ) -> usize {
        let lines_each = wide_node::lines_of_node(self.lanes);
        let nodes = lines.len() / lines_each;
        let (own, below) = lines.split_at_mut(lines_each);
        self.meter.advance(self.share);
        if self.meter.record_work(8) {
            return 0;
        }
        let children = &made.children[..made.count];
        let mut next = first + 1;
        let numbers = children.iter().map(|child| match child.kind {
            ChildKind::Leaf(leaf) => wide_node::leaf_child(leaf),
            _ => {
                let number = next;
                next += self.nodes(child);
                number as u32
            }
        });
        let mut named = [self.nothing; MOST_LANES];
        named.iter_mut().zip(numbers).for_each(|(to, number)| *to = number);
        let bounds = children.iter().map(|child| child.bounds);
        wide_node::write(self.lanes, bounds, &named, (&made.order, made.count), own);

        let below = children.iter().zip(&named).scan(below, |rest, (child, &number)| {
            let lines = self.nodes(child) * lines_each;
            let (lines, behind) = core::mem::take(rest).split_at_mut(lines);
            *rest = behind;
            Some((*child, number as usize, lines))
        });
        let below = below.filter(|(_, _, lines)| !lines.is_empty());
        let write = |(child, number, lines)| {
            let mut made = NodeChildren::none();
            self.spread(child, self.lanes, true, &mut made);
            self.write(&made, number, lines, above + 1)
        };
        let deepest = if nodes > TASK && above < DIVIDED {
            in_tasks(below, write)
        } else {
            below.map(write).max()
        };
        1 + deepest.unwrap_or(0)
    }

    /// The children of the root where there are large triangles: they, and the tree's root. `nodes` is the number of the
    /// tree's nodes.
    fn spread_root(&self, root: Option<Child>, nodes: u32, made: &mut NodeChildren) {
        let bounds = widened(&self.large.bounds, longest_extent(&self.large.bounds));
        match self.large.blocks {
            // The compact layout.
            [_, 0] => made.push(Child { kind: ChildKind::Leaf(nodes), bounds }),
            [unit, blocks] if (blocks as usize) < self.lanes => {
                self.share(unit, blocks, self.lanes - 1, &bounds, made);
            }
            [unit, blocks] => made.push(Child { kind: ChildKind::Run(unit, blocks), bounds }),
        }
        root.into_iter().for_each(|root| made.push(root));
        made.order = Order::default();
        made.order.in_a_row(0, made.count);
    }

    /// Distributes a child over some places of a node; over all of a node of its own, where it is `whole`.
    fn spread(&self, child: Child, places: usize, whole: bool, made: &mut NodeChildren) {
        match child.kind {
            ChildKind::Branch(branch) if places > 1 => {
                let branch = &self.branches[branch as usize];
                if let (Some(axis), Some(left)) = (branch.axis(), branch.left_places(places)) {
                    let [one, other] = branch.children;
                    let start = made.count;
                    self.spread(self.child(one), left, false, made);
                    let middle = made.count;
                    self.spread(self.child(other), places - left, false, made);
                    return made.order.separate(axis.into(), start, middle, made.count);
                }
                // It will be read soon.
                for &child in &branch.children {
                    prefetch(self.branches.as_ptr().wrapping_add(child as usize).cast());
                }
                made.push(child);
            }
            ChildKind::Run(unit, blocks) if whole || blocks as usize <= places => {
                self.share(unit, blocks, places, &child.bounds, made);
            }
            _ => made.push(child),
        }
    }

    /// Divides a leaf's blocks among as many places as there are, or as they need.
    fn share(&self, unit: u32, blocks: u32, places: usize, bounds: &Aabb, made: &mut NodeChildren) {
        let LeafChildren::TreeLayout { words, .. } = self.leaves else { return };
        let start = made.count;
        let places = blocks.min(places as u32);
        let (mut unit, more) = (unit, blocks % places);
        for place in 0..places {
            let blocks = blocks / places + u32::from(place < more);
            let leaf = WalkNode::leaf(unit, blocks);
            let kind = Writer::run(unit, blocks);
            let mut all = Aabb::EMPTY;
            for block in leaf.blocks(words) {
                all = all.union(&self.bounds(&block));
                unit += block.units();
            }
            // The leaf's box is widened for its largest triangle, each of these for its own.
            made.push(Child { kind, bounds: part(bounds, &widened(&all, longest_extent(&all))) });
        }
        made.order.in_a_row(start, made.count);
    }

    /// The bounds of a block of large triangles, or of a block's triangles that are not large.
    fn bounds(&self, record: &PackedBlock<'_>) -> Aabb {
        if record.is_large() || self.large.is_empty() {
            return record.bounds();
        }
        let triangle = |index: usize| (record.triangle(index), record.corners(index));
        self.large.bounds_of_others((0..record.count()).map(triangle))
    }
}

/// Does each part as a task and returns the greatest result. Separate from [`Writer::write`], so
/// that tasks take stack space only where there are some.
fn in_tasks<T: Send>(
    parts: impl Iterator<Item = T>,
    work: impl Fn(T) -> usize + Sync + Send,
) -> Option<usize> {
    let mut tasks = [const { None }; MOST_LANES];
    tasks.iter_mut().zip(parts).for_each(|(task, part)| *task = Some(part));
    let _loop = span::pieces_of(1);
    let part = |task: &mut Option<T>| {
        let part = task.take()?;
        let _piece = span::piece();
        Some(work(part))
    };
    tasks.par_iter_mut().reduce(None, part, |most, one| *most = one.max(*most))
}

impl NodeChildren {
    fn none() -> NodeChildren {
        let none = Child { kind: ChildKind::Leaf(0), bounds: Aabb::EMPTY };
        NodeChildren { children: [none; MOST_LANES], count: 0, order: Order::default() }
    }

    fn push(&mut self, child: Child) {
        self.children[self.count] = child;
        self.count += 1;
    }
}

#[cfg(test)]
mod tests;
