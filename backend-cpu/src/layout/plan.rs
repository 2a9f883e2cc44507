//! Planning: which levels of the tree go together into one wide node ([`super::wide`]).
//!
//! As for wide bounding volume hierarchies (Ylitie, Karras and Laine 2017, section 3.1). A subtree may take one or more
//! places in a wide node above it. Bottom up, the planner finds for every number of places the least sum of the surface
//! areas of the wide nodes made of the subtree. With one place it becomes a node of its own; with more, its children
//! share the places.

use splitplane_core::aabb::Aabb;
use splitplane_core::config::MAX_DEPTH;
use splitplane_core::tree::node::{KdNode, NodeKind};

use crate::simd::MOST_LANES;
use crate::simd::every_set::for_every_set;

/// For every number of places. (A function that took a closure would not be compiled for vectors.)
macro_rules! every {
    ($place:ident => $line:expr) => {
        for $place in 0..MOST_LANES {
            $line;
        }
    };
}

/// A subtree that has triangles, but not all of them below one child.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Branch {
    /// The part of its cell that its triangles reach into.
    pub bounds: Aabb,
    /// The branches of its children, or the first branches below them. For a leaf: the unit of its first block and the
    /// number of its blocks.
    pub children: [u32; 2],
    /// Wide nodes made of it where it is a node of its own.
    pub nodes: u32,
    /// For each number of places but one how many its left child takes. The first is the axis, or
    /// [`Branch::LEAF`].
    plan: [u8; MOST_LANES],
}

impl Branch {
    /// A leaf's axis.
    const LEAF: u8 = 3;
    /// In a plan: a node of its own is no worse.
    const ALONE: u8 = 0;

    /// A leaf of `blocks` blocks, the first of which begins at `unit`.
    pub(crate) fn leaf(bounds: Aabb, unit: u32, blocks: u32) -> Branch {
        let plan = [Branch::LEAF; MOST_LANES];
        Branch { bounds, children: [unit, blocks], nodes: 0, plan }
    }

    /// The axis of the plane between the children; `None` for a leaf.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn axis(&self) -> Option<u8> {
        (self.plan[0] != Branch::LEAF).then_some(self.plan[0])
    }

    /// How many of some places, two at least, the left child takes; `None` where the branch had better be a
    /// node of its own.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn left_places(&self, places: usize) -> Option<usize> {
        let left = self.plan[places - 1];
        (left != Branch::ALONE).then_some(left.into())
    }
}

/// Areas are at most this, so that sums of all nodes' are finite: a cost that is not is no better than none, and then nodes are not
/// counted. In units of the tree's bounds areas are near one, but for boxes that are widened by more than these bounds are wide: of triangles on one line
/// at 1e33 two floats are 1e26 apart.
const MOST_AREA: f32 = 1e20;

/// No branch: a subtree without triangles.
const NONE: u32 = u32::MAX;

/// What a subtree costs its parent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlaceCosts {
    /// The branch that it is.
    branch: u32,
    /// More places than this gain nothing; 0 if there is no branch.
    useful: u32,
    /// For each number of places, one less than it and behind as many that say no places: the surface area of
    /// the nodes made of the subtree.
    areas: [f32; 2 * MOST_LANES],
    /// And how many those are.
    nodes: [u32; 2 * MOST_LANES],
}

/// Where one place is.
const ONE: usize = MOST_LANES;

impl PlaceCosts {
    /// The costs of nothing.
    pub(crate) const NOTHING: PlaceCosts = {
        let mut areas = [f32::INFINITY; 2 * MOST_LANES];
        let mut places = ONE;
        while places < areas.len() {
            areas[places] = 0.0;
            places += 1;
        }
        PlaceCosts { branch: NONE, useful: 0, areas, nodes: [0; 2 * MOST_LANES] }
    };

    /// The branch, if there is one.
    pub(crate) fn branch(&self) -> Option<u32> {
        (self.branch != NONE).then_some(self.branch)
    }

    /// Wide nodes made of the whole.
    pub(crate) fn whole(&self) -> u32 {
        self.nodes[ONE]
    }
}

/// The other data that planning needs, in addition to branches.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Planner {
    /// Places of a node.
    lanes: usize,
    /// A power of two that brings extents near one, so that areas neither overflow nor vanish.
    scale: f32,
}

impl Planner {
    /// For a tree with these bounds, which are not empty.
    pub(crate) fn new(lanes: usize, bounds: &Aabb) -> Planner {
        let half = (0..3).map(|axis| bounds.half_extent(axis)).fold(f32::MIN_POSITIVE, f32::max);
        let exponent = (half.to_bits() >> 23).clamp(1, 253);
        Planner { lanes, scale: f32::from_bits((254 - exponent) << 23) }
    }

    /// A power of two that brings extents near one.
    pub(crate) fn scale(&self) -> f32 {
        self.scale
    }

    /// Half the surface area, in whatever unit; at most [`MOST_AREA`].
    fn area(&self, bounds: &Aabb) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|axis| bounds.half_extent(axis) * self.scale);
        // Of no area and one that is beyond all numbers the minimum is the number.
        (x * y + y * z + z * x).min(MOST_AREA)
    }

    /// The costs of a leaf: a block is a child as it is, several have a place each or a node of their own.
    /// Where it has no bounds it is nothing.
    fn leaf(&self, node: u32, leaf: &Branch) -> PlaceCosts {
        if leaf.bounds.is_empty() {
            return PlaceCosts::NOTHING;
        }
        let blocks = leaf.children[1];
        let mut costs = PlaceCosts { branch: node, useful: 1, ..PlaceCosts::NOTHING };
        if blocks > 1 {
            let few = (blocks as usize - 1).min(MOST_LANES);
            costs.areas[ONE..][..few].fill(self.area(&leaf.bounds));
            costs.nodes[ONE..][..few].fill(run_nodes(blocks, self.lanes as u32));
            costs.useful = if few < self.lanes { blocks } else { 1 };
        }
        costs
    }

    /// Makes the branch of a node of its children's costs. What it costs takes the place of what the right
    /// child did; where one child is empty, it is the other one.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn join(
        &self,
        node: u32,
        axis: u8,
        left: &PlaceCosts,
        right: &mut PlaceCosts,
        branches: &mut Branches<'_>,
    ) {
        if left.branch == NONE {
            return;
        }
        if right.branch == NONE {
            *right = *left;
            return;
        }
        let boxes = [left, right].map(|child| branches.branch(child.branch).bounds);
        let bounds = boxes[0].union(&boxes[1]);
        let (mut areas, mut nodes) = ([f32::INFINITY; MOST_LANES], [0; MOST_LANES]);
        let mut lefts = [1; MOST_LANES];
        // Each line is one or two vectors, without a branch: masks are what compilers make vectors of.
        let mut better = [0; MOST_LANES];
        for k in 1..=(left.useful as usize).min(MOST_LANES - 1) {
            // Where the left child takes k places, the right one takes k fewer.
            let (area, count) = (left.areas[ONE + k - 1], left.nodes[ONE + k - 1]);
            let fewer = &right.areas[ONE - k..][..MOST_LANES];
            let counts = &right.nodes[ONE - k..][..MOST_LANES];
            let mut cost = [0.0; MOST_LANES];
            every!(i => cost[i] = area + fewer[i]);
            every!(i => better[i] = if cost[i] < areas[i] { u32::MAX } else { 0 });
            every!(i => areas[i] = pick_float(better[i], cost[i], areas[i]));
            every!(i => nodes[i] = pick(better[i], count + counts[i], nodes[i]));
            every!(i => lefts[i] = pick(better[i], k as u32, lefts[i]));
        }
        // A node of its own, which takes one place.
        let all = self.lanes - 1;
        let (alone, made) = (self.area(&bounds) + areas[all], 1 + nodes[all]);
        let whole = lefts[all] as u8;
        every!(i => better[i] = if areas[i] < alone { u32::MAX } else { 0 });
        every!(i => areas[i] = pick_float(better[i], areas[i], alone));
        every!(i => nodes[i] = pick(better[i], nodes[i], made));
        every!(i => lefts[i] = pick(better[i], lefts[i], Branch::ALONE.into()));
        let mut plan = lefts.map(|left| left as u8);
        plan[all] = whole;
        plan[0] = axis;
        let children = [left.branch, right.branch];
        *branches.branch(node) = Branch { bounds, children, nodes: made, plan };
        right.branch = node;
        right.useful = (left.useful + right.useful).min(all as u32);
        right.areas[ONE..].copy_from_slice(&areas);
        right.nodes[ONE..].copy_from_slice(&nodes);
    }

    /// Plans the subtree of these nodes, the first of which is its root. The branches of its leaves are
    /// there, the others are made.
    pub(crate) fn subtree(
        &self,
        set: crate::simd::InstructionSet,
        first: u32,
        nodes: &[KdNode],
        branches: &mut [Branch],
    ) -> PlaceCosts {
        subtree(set, self, first, nodes, branches)
    }
}

/// One or the other, by a mask of ones or zeros.
#[cfg_attr(not(unoptimised), inline(always))]
fn pick(mask: u32, one: u32, other: u32) -> u32 {
    one & mask | other & !mask
}

#[cfg_attr(not(unoptimised), inline(always))]
fn pick_float(mask: u32, one: f32, other: f32) -> f32 {
    f32::from_bits(pick(mask, one.to_bits(), other.to_bits()))
}

/// The branches of some nodes that follow each other, and the number of the first.
pub(crate) struct Branches<'a>(pub u32, pub &'a mut [Branch]);

impl Branches<'_> {
    /// The branch of a node.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn branch(&mut self, node: u32) -> &mut Branch {
        &mut self.1[(node - self.0) as usize]
    }
}

for_every_set! {
    /// See [`Planner::subtree`].
    fn subtree<S>(
        planner: &Planner, first: u32, nodes: &[KdNode], branches: &mut [Branch],
    ) -> PlaceCosts {
        let mut branches = Branches(first, branches);
        // From the last node to the first: the children of a node are the last two that were planned.
        let mut planned = [PlaceCosts::NOTHING; MAX_DEPTH as usize + 1];
        let mut end = 0;
        for (index, node) in nodes.iter().enumerate().rev() {
            let number = first + index as u32;
            match node.kind() {
                NodeKind::Leaf { count: 0, .. } => {
                    planned[end] = PlaceCosts::NOTHING;
                    end += 1;
                }
                NodeKind::Leaf { .. } => {
                    planned[end] = planner.leaf(number, branches.branch(number));
                    end += 1;
                }
                NodeKind::Interior { axis, .. } => {
                    end -= 1;
                    let (behind, left) = planned.split_at_mut(end);
                    let right = &mut behind[end - 1];
                    planner.join(number, axis as u8, &left[0], right, &mut branches);
                }
            }
        }
        planned[0]
    }
}

/// Wide nodes of a leaf of `blocks` blocks, 2 at least, which the nodes' places share evenly.
pub(crate) fn run_nodes(blocks: u32, lanes: u32) -> u32 {
    let below = |blocks: u32| if blocks > 1 { run_nodes(blocks, lanes) } else { 0 };
    if blocks <= lanes {
        return 1;
    }
    let more = blocks % lanes;
    1 + (lanes - more) * below(blocks / lanes)
        + if more > 0 { more * below(blocks / lanes + 1) } else { 0 }
}

#[cfg(test)]
mod tests;
