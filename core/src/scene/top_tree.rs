//! The tree over the boxes of instances.

use alloc::vec::Vec;

use super::world_box::WorldBox;
use crate::aabb::{Aabb, max};

/// Children of a node of the tree over instances.
pub const WIDTH: usize = 8;
/// A child of a node that is an instance; the other bits are its name.
pub const INSTANCE: u32 = 1 << 31;
/// No child of a node.
pub const NONE: u32 = u32::MAX;
/// Nothing is above the root.
pub(super) const NO_PARENT: u32 = u32::MAX;

/// A node: eight children, each with its box.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TopNode {
    /// Lower ends of the children's boxes, by axis.
    pub lo: [[f32; WIDTH]; 3],
    /// Upper ends.
    pub hi: [[f32; WIDTH]; 3],
    /// What boxes are widened by, per unit of a ray's origin: the greatest of all instances within.
    pub reach: [f32; WIDTH],
    /// A node, or an instance (the top bit is set; the others are its name), or `u32::MAX` for none. Those that are come
    /// first.
    pub children: [u32; WIDTH],
}

impl TopNode {
    pub(super) const EMPTY: TopNode = TopNode {
        lo: [[f32::MAX; WIDTH]; 3],
        hi: [[-f32::MAX; WIDTH]; 3],
        reach: [0.0; WIDTH],
        children: [NONE; WIDTH],
    };

    /// The box of a child.
    pub(super) fn child_box(&self, slot: usize) -> WorldBox {
        let bounds = Aabb {
            lo: [0, 1, 2].map(|axis| self.lo[axis][slot]),
            hi: [0, 1, 2].map(|axis| self.hi[axis][slot]),
        };
        WorldBox { bounds, reach: self.reach[slot] }
    }

    pub(super) fn set_child_box(&mut self, slot: usize, to: &WorldBox) {
        for axis in 0..3 {
            self.lo[axis][slot] = to.bounds.lo[axis];
            self.hi[axis][slot] = to.bounds.hi[axis];
        }
        self.reach[slot] = to.reach;
    }

    /// The box of all children.
    pub(super) fn whole_box(&self) -> WorldBox {
        let mut all = WorldBox { bounds: Aabb::EMPTY, reach: 0.0 };
        for slot in 0..WIDTH {
            if self.children[slot] != NONE {
                all = all.union(&self.child_box(slot));
            }
        }
        all
    }
}

impl WorldBox {
    /// The least box that serves both.
    #[must_use]
    pub(super) fn union(&self, other: &WorldBox) -> WorldBox {
        WorldBox { bounds: self.bounds.union(&other.bounds), reach: max(self.reach, other.reach) }
    }

    /// Half the area, in `f64`, where no finite box's overflows.
    #[inline]
    pub(super) fn half_area(&self) -> f64 {
        // A loop, since closures over arrays are not compiled into who calls this.
        let mut extents = [0.0; 3];
        for axis in 0..3 {
            let extent = f64::from(self.bounds.hi[axis]) - f64::from(self.bounds.lo[axis]);
            extents[axis] = if extent > 0.0 { extent } else { 0.0 };
        }
        let [x, y, z] = extents;
        x * y + y * z + z * x
    }
}

/// Where an instance is in the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) node: u32,
    pub(super) slot: u32,
}

impl Place {
    /// Nowhere.
    pub(super) const NOWHERE: Place = Place { node: u32::MAX, slot: 0 };
}

/// A bounding volume tree over the boxes of instances, eight children wide. Each instance is in one place, so that none
/// is entered twice, and an instance that moves changes only the nodes above it.
#[derive(Clone, Debug, Default)]
pub struct TopTree {
    /// The root first, each node before its children.
    pub(super) nodes: Vec<TopNode>,
    /// The node above each, and its place there.
    pub(super) parents: Vec<Place>,
    /// By the name of an instance.
    pub(super) places: Vec<Place>,
    /// Levels of nodes.
    pub(super) depth: usize,
    /// Sum of half the areas of all children's boxes: what rays cost, but for the root's area.
    pub(super) cost: f64,
    /// That sum when the tree was built.
    pub(super) cost_when_built: f64,
}

impl TopTree {
    /// The nodes, the root first.
    pub fn nodes(&self) -> &[TopNode] {
        &self.nodes
    }

    /// Levels of nodes; a traversal's stack has at most 7 entries for each, and one more.
    pub const fn depth(&self) -> usize {
        self.depth
    }

    /// The most that a box is widened by, per unit of a ray's origin.
    pub fn reach(&self) -> f32 {
        self.nodes.first().map_or(0.0, |root| root.reach.into_iter().fold(0.0, max))
    }

    /// The box of all instances, without what it is widened by for a ray.
    pub fn bounds(&self) -> Aabb {
        self.nodes.first().map_or(Aabb::EMPTY, |root| root.whole_box().bounds)
    }

    /// Bytes that are held.
    pub fn bytes(&self) -> u64 {
        (self.nodes.capacity() * size_of::<TopNode>()
            + (self.parents.capacity() + self.places.capacity()) * size_of::<Place>())
            as u64
    }
}
