use core::marker::PhantomData;

use super::range;
use crate::aabb::Aabb;
use crate::arithmetic::Arithmetic;
use crate::build::mask::TriangleMask;
use crate::build::split::{Rank, SplitPlane, goes_left, goes_right, strictly_inside};
use crate::config::{BuildConfig, MAX_DEPTH, SMALL_ROOT_NODES, SMALL_ROOT_REFERENCES};
use crate::layout::{Reference, SmallRoot};
use crate::sah::{Extents, leaf_cost, split_cost};

/// The small-node stage (Zhou et al. 2008) of one root of at most T references: its subtree, node by
/// node in preorder.
///
/// A node is a set of the root's references. Its candidates are the faces of its references'
/// bounds, as they are in the root, that lie strictly inside the node's cell. The candidate of
/// least cost by the integer heuristic ([`split_cost`]) splits the node, on a tie the one of the
/// lowest axis, then of the lowest position. A reference goes where its bounds say ([`goes_left`],
/// [`goes_right`]); it is not clipped again.
///
/// A node is a leaf
/// - where no candidate costs less than a leaf ([`leaf_cost`]);
/// - at the greatest depth;
/// - where its children would make the subtree exceed [`SMALL_ROOT_NODES`] nodes or
///   [`SMALL_ROOT_REFERENCES`] references. Everything that was decided before counts, nodes that
///   are not yet visited included, in preorder.
#[derive(Debug)]
pub struct SmallSubtree<'a, A> {
    config: &'a BuildConfig,
    /// The root's references.
    references: &'a [Reference],
    /// Nodes to come, the next one last.
    stack: [Pending; MAX_DEPTH as usize + 1],
    pending: usize,
    /// Nodes and references so far, those to come included.
    nodes: u32,
    allocated: u32,
    arithmetic: PhantomData<A>,
}

/// A node of a small root's subtree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SmallNode {
    /// An interior node, split by this plane. Its left subtree follows, then its right one.
    Interior(SplitPlane),
    /// A leaf of these references of the root.
    Leaf(TriangleMask),
}

/// A node not yet visited.
#[derive(Clone, Copy, Debug)]
struct Pending {
    triangles: TriangleMask,
    cell: Aabb,
    depth: u32,
}

impl<'a, A: Arithmetic> SmallSubtree<'a, A> {
    /// The subtree of a root. `small_references` are those of all roots.
    pub fn new(
        config: &'a BuildConfig,
        root: &SmallRoot,
        small_references: &'a [Reference],
    ) -> SmallSubtree<'a, A> {
        let triangles = TriangleMask::first(root.count);
        let whole = Pending { triangles, cell: root.cell(), depth: root.depth };
        SmallSubtree {
            config,
            references: &small_references[range(root.first, root.count)],
            stack: [whole; MAX_DEPTH as usize + 1],
            pending: 1,
            nodes: 1,
            allocated: root.count,
            arithmetic: PhantomData,
        }
    }

    /// The plane that splits a node, and the references of both children; `None` for a leaf.
    fn split(&self, node: &Pending) -> Option<(SplitPlane, [TriangleMask; 2])> {
        if node.depth >= self.config.max_depth {
            return None;
        }
        let plane = self.best_plane(node)?;
        let sides = self.sides(node.triangles, plane);
        let after = self.allocated + added(node.triangles, sides);
        let fits = self.nodes + 2 <= SMALL_ROOT_NODES && after <= SMALL_ROOT_REFERENCES;
        fits.then_some((plane, sides))
    }

    /// The candidate of least rank among those that cost less than a leaf.
    fn best_plane(&self, node: &Pending) -> Option<SplitPlane> {
        let extents = Extents::of::<A>(&node.cell)?;
        let area = Extents::half_area(extents.cells);
        let leaf = leaf_cost(self.config, area, node.triangles.count());
        let (mut best, mut found) = (Rank::WORST, None);
        for axis in 0..3 {
            for triangle in node.triangles.iter() {
                let reference = &self.references[triangle as usize];
                for position in [reference.lo[axis], reference.hi[axis]] {
                    if !strictly_inside(&node.cell, axis, position) {
                        continue;
                    }
                    let plane = SplitPlane { axis, position };
                    let [left, right] = self.sides(node.triangles, plane).map(TriangleMask::count);
                    let offset = extents.offset::<A>(node.cell.lo[axis], position);
                    let areas = extents.split_areas(axis, offset);
                    let cost = split_cost(self.config, areas, left, right);
                    let rank = Rank::new(cost, axis, position);
                    if cost < leaf && rank < best {
                        (best, found) = (rank, Some(plane));
                    }
                }
            }
        }
        found
    }

    /// Which of these references go left of a plane, and which right.
    fn sides(&self, triangles: TriangleMask, plane: SplitPlane) -> [TriangleMask; 2] {
        let SplitPlane { axis, position } = plane;
        let mut sides = [TriangleMask::EMPTY; 2];
        for triangle in triangles.iter() {
            let Reference { lo, hi, .. } = &self.references[triangle as usize];
            if goes_left(lo[axis], hi[axis], position) {
                sides[0] = sides[0].with(triangle);
            }
            if goes_right(hi[axis], position) {
                sides[1] = sides[1].with(triangle);
            }
        }
        sides
    }
}

/// How many references a split adds.
fn added(triangles: TriangleMask, [left, right]: [TriangleMask; 2]) -> u32 {
    left.count() + right.count() - triangles.count()
}

impl<A: Arithmetic> Iterator for SmallSubtree<'_, A> {
    type Item = SmallNode;

    fn next(&mut self) -> Option<SmallNode> {
        self.pending = self.pending.checked_sub(1)?;
        let node = self.stack[self.pending];
        let Some((plane, sides)) = self.split(&node) else {
            return Some(SmallNode::Leaf(node.triangles));
        };
        self.nodes += 2;
        self.allocated += added(node.triangles, sides);
        let mut cells = [node.cell; 2];
        cells[0].hi[plane.axis] = plane.position;
        cells[1].lo[plane.axis] = plane.position;
        // The left child comes first, so it lies on top.
        for side in [1, 0] {
            self.stack[self.pending] =
                Pending { triangles: sides[side], cell: cells[side], depth: node.depth + 1 };
            self.pending += 1;
        }
        Some(SmallNode::Interior(plane))
    }
}
