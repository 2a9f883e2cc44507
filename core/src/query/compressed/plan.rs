//! Which levels of a tree go together: boxes and costs of all its nodes, bottom up.

use super::encode::{rounded_down, rounded_up};
use super::{CHILDREN, LEAF_MOST};
use crate::aabb::Aabb;
use crate::query::intersect::{Limits, SIZE_SLACK, SceneScale};
use crate::query::traverse::Triangles;
use crate::tree::KdTreeView;
use crate::tree::node::NodeKind;
use alloc::vec;
use alloc::vec::Vec;

/// What a node costs a ray, in tests of a triangle: eight boxes, and a wait for memory.
const NODE_COST: f32 = 2.0;

/// A node of the tree.
#[derive(Clone, Copy)]
pub(super) struct Planned {
    /// The part of the cell that triangles reach into, widened; empty without triangles.
    pub(super) bounds: Aabb,
    /// The references below: they follow one another.
    pub(super) first: u32,
    pub(super) count: u32,
    /// Whether it becomes a leaf where it is one child; a long leaf becomes several.
    pub(super) is_leaf: bool,
    /// The least cost of the subtree as 1, 2, ... 8 children of a node.
    costs: [f32; CHILDREN],
}

/// The plan of a tree.
pub(super) struct Plan<'a> {
    pub(super) tree: &'a KdTreeView<'a>,
    pub(super) nodes: Vec<Planned>,
}

impl<'a> Plan<'a> {
    pub(super) fn new(
        tree: &'a KdTreeView<'a>,
        triangles: &(impl Triangles + ?Sized),
        scale: &SceneScale,
    ) -> Plan<'a> {
        let none = Planned {
            bounds: Aabb::EMPTY,
            first: 0,
            count: 0,
            is_leaf: true,
            costs: [0.0; CHILDREN],
        };
        let mut nodes = vec![none; tree.nodes.len()];
        // Cells top down, boxes bottom up: children come after their parents.
        if let Some(root) = nodes.first_mut() {
            root.bounds = tree.bounds;
        }
        for (index, node) in tree.nodes.iter().enumerate() {
            if let NodeKind::Interior { axis, split, right } = node.kind() {
                let cell = nodes[index].bounds;
                let (mut left, mut other) = (cell, cell);
                (left.hi[axis.index()], other.lo[axis.index()]) = (split, split);
                nodes[index + 1].bounds = left;
                nodes[right as usize].bounds = other;
            }
        }
        let extent = crate::query::intersect::longest_extent(&tree.bounds).max(f32::MIN_POSITIVE);
        let mut plan = Plan { tree, nodes };
        for index in (0..tree.nodes.len()).rev() {
            plan.nodes[index] = match tree.nodes[index].kind() {
                NodeKind::Leaf { first, count: 0 } => Planned { first, ..none },
                NodeKind::Leaf { first, count } => {
                    let named = tree.leaf(first, count);
                    let bounds = leaf_bounds(&plan.nodes[index].bounds, named, triangles, scale);
                    let cost = relative_area(&bounds, extent) * count as f32;
                    Planned { bounds, first, count, is_leaf: true, costs: [cost; CHILDREN] }
                }
                NodeKind::Interior { right, .. } => plan.interior(index as u32 + 1, right, extent),
            };
        }
        plan
    }

    fn interior(&self, left: u32, right: u32, extent: f32) -> Planned {
        let [one, other] = [left, right].map(|child| self.nodes[child as usize]);
        match (one.count, other.count) {
            (0, _) => return other,
            (_, 0) => return one,
            _ => {}
        }
        let bounds = one.bounds.union(&other.bounds);
        let (first, count) = (one.first, one.count + other.count);
        let area = relative_area(&bounds, extent);
        let mut costs = [0.0; CHILDREN];
        costs[0] = area * NODE_COST + divided(&one, &other, CHILDREN).1;
        // A few triangles that planes part may be had for less than a node.
        let as_leaf = area * count as f32;
        let is_leaf = count <= LEAF_MOST && as_leaf <= costs[0];
        if is_leaf {
            costs[0] = as_leaf;
        }
        for places in 2..=CHILDREN {
            costs[places - 1] = costs[places - 2].min(divided(&one, &other, places).1);
        }
        Planned { bounds, first, count, is_leaf, costs }
    }

    /// How many of `places` the first of two subtrees gets; `None` where the two together do better in fewer.
    pub(super) fn division(
        &self,
        left: u32,
        right: u32,
        whole: &Planned,
        places: usize,
    ) -> Option<usize> {
        let (first, cost) =
            divided(&self.nodes[left as usize], &self.nodes[right as usize], places);
        (cost < whole.costs[places - 2]).then_some(first)
    }

    /// How the places of a node are divided between the subtrees of its root.
    pub(super) fn root_division(&self, left: u32, right: u32) -> usize {
        divided(&self.nodes[left as usize], &self.nodes[right as usize], CHILDREN).0
    }
}

/// The best division of places between two subtrees, and its cost.
fn divided(one: &Planned, other: &Planned, places: usize) -> (usize, f32) {
    let mut best = (1, f32::INFINITY);
    for first in 1..places {
        let cost = one.costs[first - 1] + other.costs[places - first - 1];
        if cost < best.1 {
            best = (first, cost);
        }
    }
    best
}

/// Half the surface area in units of the scene's extent.
fn relative_area(bounds: &Aabb, extent: f32) -> f32 {
    let [x, y, z] = [0, 1, 2].map(|axis| 2.0 * (bounds.half_extent(axis) / extent));
    x * y + y * z + z * x
}

/// The part of a cell that triangles reach into, widened by what the longest of them and the scene need.
fn leaf_bounds(
    cell: &Aabb,
    named: &[u32],
    triangles: &(impl Triangles + ?Sized),
    scale: &SceneScale,
) -> Aabb {
    let (mut all, mut longest) = (Aabb::EMPTY, 0.0f32);
    for &triangle in named {
        let corners = triangles.corners(triangle);
        all = all.union(&Aabb::of_points(&corners));
        longest = longest.max(Limits::of(&corners).longest);
    }
    let part = all.intersection(cell);
    // Whatever rounding did to a cell: what the leaf has is not to be lost.
    let lost = (0..3).any(|axis| part.lo[axis] > part.hi[axis]);
    let part = if lost { *cell } else { part };
    let slack = f64::from(longest) * f64::from(SIZE_SLACK) + f64::from(scale.base_slack);
    Aabb {
        lo: part.lo.map(|x| rounded_down(f64::from(x) - slack)),
        hi: part.hi.map(|x| rounded_up(f64::from(x) + slack)),
    }
}
