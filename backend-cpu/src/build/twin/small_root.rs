//! The subtree of one small root, in cache: what `build_small` does for each, and the end of every branch of
//! [`build::depth_first`](crate::build::depth_first).
//!
//! The small-node stage of Zhou et al. 2008 on 64-bit masks: the candidates are the faces of the
//! references' bounds as they stand in the root; a candidate counts only where its own triangle is
//! in the node and the plane lies strictly inside. Depth first, left before right. A root emits at
//! most [`SMALL_ROOT_NODES`] nodes and [`SMALL_ROOT_REFERENCES`] references: a node whose split
//! would exceed either becomes a leaf. Ties: least cost, then axis, then position.

use std::collections::TryReserveError;

use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::{Arithmetic, truncated};
use splitplane_core::build::mask::TriangleMask;
use splitplane_core::build::split::{Rank, SplitPlane};
use splitplane_core::config::{BuildConfig, MAX_DEPTH, SMALL_ROOT_NODES, SMALL_ROOT_REFERENCES};
use splitplane_core::layout::Reference;
use splitplane_core::sah::Extents;
use splitplane_core::tree::node::{Axis, KdNode};

use super::subtrees::Subtrees;
use crate::simd::WIDTH;
use crate::simd::columns::Columns;
use crate::simd::references::{AxisFaces, Outermost, PlaneList, ReferenceOps};

/// A small root in cache: the bounds of its references, by axis, and what its nodes need on the way.
#[derive(Debug)]
pub(crate) struct SmallRootBuilder {
    count: usize,
    triangles: [u32; 64],
    faces: [AxisFaces; 3],
    stack: [Pending; MAX_DEPTH as usize + 2],
    /// The faces of the current node.
    gathered: AxisFaces,
    planes: PlaneList,
}

/// A node not yet decided.
#[derive(Clone, Copy, Debug)]
struct Pending {
    mask: u64,
    cell: Aabb,
    depth: u32,
    /// The interior node whose right child this is; `u32::MAX` for a left child.
    parent: u32,
}

impl SmallRootBuilder {
    /// No reference.
    pub(crate) fn new() -> SmallRootBuilder {
        let nothing = Pending { mask: 0, cell: Aabb::EMPTY, depth: 0, parent: u32::MAX };
        SmallRootBuilder {
            count: 0,
            triangles: [0; 64],
            faces: [AxisFaces::NONE; 3],
            stack: [nothing; MAX_DEPTH as usize + 2],
            gathered: AxisFaces::NONE,
            planes: [0.0; 2 * 64 + WIDTH],
        }
    }

    /// Takes up to 64 references.
    pub(crate) fn load(&mut self, references: &[Reference]) {
        self.count = references.len();
        for (i, reference) in references.iter().enumerate() {
            self.triangles[i] = reference.triangle;
            for axis in 0..3 {
                self.faces[axis].lo[i] = reference.lo[axis];
                self.faces[axis].hi[i] = reference.hi[axis];
            }
        }
    }

    /// Takes up to 64 rows of columns.
    pub(crate) fn load_rows(&mut self, columns: &Columns, first: usize, count: usize) {
        self.count = count;
        self.triangles[..count].copy_from_slice(columns.triangles(first, count));
        for (axis, faces) in self.faces.iter_mut().enumerate() {
            faces.lo[..count].copy_from_slice(columns.face(axis, first, count));
            faces.hi[..count].copy_from_slice(columns.face(3 + axis, first, count));
        }
    }

    /// Appends the subtree of the references taken to `out`. Indices count from `base`, which has a
    /// number of nodes and one of references.
    ///
    /// # Errors
    /// Less memory than it takes.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn build<A: Arithmetic, S: ReferenceOps>(
        &mut self,
        costs: &SmallRootCosts,
        cell: &Aabb,
        depth: u32,
        base: [usize; 2],
        out: &mut Subtrees,
    ) -> Result<(), TryReserveError> {
        let [first_node, first_reference] = base;
        let mask = TriangleMask::first(self.count as u32).bits();
        // Allocated so far, those pending included: what the caps of a root count.
        let (mut nodes, mut references) = (1, self.count as u32);
        self.stack[0] = Pending { mask, cell: *cell, depth, parent: u32::MAX };
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let node = self.stack[top];
            let index = out.nodes.len() - first_node;
            if node.parent != u32::MAX {
                // The parent was written with its right child unknown.
                let parent = &mut out.nodes[first_node + node.parent as usize];
                *parent = parent.with_right(index as u32);
            }
            let count = node.mask.count_ones();
            let plane = if node.depth < costs.max_depth {
                self.best_split::<A, S>(costs, &node)
            } else {
                None
            };
            if let Some(plane) = plane {
                // The paper makes the masks of all candidates beforehand; only a chosen plane needs them.
                let sides = S::sides(&self.faces[plane.axis], self.count, plane.position);
                let [left, right] = sides.map(|side| side & node.mask);
                let after = references + left.count_ones() + right.count_ones() - count;
                if nodes + 2 <= SMALL_ROOT_NODES && after <= SMALL_ROOT_REFERENCES {
                    nodes += 2;
                    references = after;
                    let axis = Axis::from_index(plane.axis as u32);
                    out.push(KdNode::interior(axis, plane.position, 0))?;
                    let (mut left_cell, mut right_cell) = (node.cell, node.cell);
                    left_cell.hi[plane.axis] = plane.position;
                    right_cell.lo[plane.axis] = plane.position;
                    let depth = node.depth + 1;
                    let parent = index as u32;
                    self.stack[top] = Pending { mask: right, cell: right_cell, depth, parent };
                    let parent = u32::MAX;
                    self.stack[top + 1] = Pending { mask: left, cell: left_cell, depth, parent };
                    top += 2;
                    continue;
                }
            }
            let mut rest = node.mask;
            let references = (0..count).map(|_| {
                let i = rest.trailing_zeros() as usize & 63;
                rest &= rest.wrapping_sub(1);
                self.triangles[i]
            });
            out.leaf(first_reference, references)?;
        }
        Ok(())
    }

    /// The split of least rank, if it costs less than a leaf.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn best_split<A: Arithmetic, S: ReferenceOps>(
        &mut self,
        costs: &SmallRootCosts,
        node: &Pending,
    ) -> Option<SplitPlane> {
        let count = node.mask.count_ones();
        if count == 0 {
            return None;
        }
        let extents = Extents::of::<A>(&node.cell)?;
        let area = Extents::half_area(extents.cells);
        let leaf = costs.intersection * costs.blocks(count) * area;
        if leaf <= costs.traversal * area {
            return None;
        }
        if count <= costs.block_width {
            return self.cut_empty::<A, S>(costs, node, &extents, leaf);
        }
        let mut best = BestByLane::above(leaf);
        for axis in 0..3 {
            let (low, high) = (node.cell.lo[axis], node.cell.hi[axis]);
            let (faces, planes) = (&mut self.gathered, &mut self.planes);
            let found = S::gather(&self.faces[axis], node.mask, low, high, faces, planes);
            // Planes at the cell's side are not candidates.
            planes[found..(found + WIDTH).min(2 * 64 + WIDTH)].fill(low);
            for start in (0..found).step_by(WIDTH) {
                let positions = core::array::from_fn(|k| planes[start + k]);
                let block = PlaneBlock { axis, positions, faces, count };
                consider::<A, S>(costs, &node.cell, &extents, &block, &mut best);
            }
        }
        best.plane(leaf)
    }

    /// The split of a node that fits one block. With triangles on both sides a split costs no less
    /// than the leaf's one block, since the parts' areas add up to more than the whole's. Only
    /// planes with nothing on one side can win, and the best of those touch the outermost bounds.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn cut_empty<A: Arithmetic, S: ReferenceOps>(
        &self,
        costs: &SmallRootCosts,
        node: &Pending,
        extents: &Extents,
        leaf: u32,
    ) -> Option<SplitPlane> {
        // Two planes of each axis side by side, the lowest face and the highest; then two that are none.
        let mut position = [0.0f32; 8];
        let mut lower = [0.0f32; 8];
        let mut usable = [false; 8];
        // Of the full side's half area: extent across the plane, what it is multiplied by, and the rest.
        let (mut whole, mut rim, mut cap) = ([0u32; 8], [0u32; 8], [0u32; 8]);
        for axis in 0..3 {
            let Outermost { lowest, highest, first_end } =
                S::outermost(&self.faces[axis], node.mask);
            let (low, high) = (node.cell.lo[axis], node.cell.hi[axis]);
            let [_, b, c] = [0, 1, 2].map(|k| extents.cells[(axis + k) % 3].max(1));
            // A triangle planar in the lowest plane goes left of it, which is then not empty.
            for (k, plane, empty) in
                [(2 * axis, lowest, first_end > lowest), (2 * axis + 1, highest, true)]
            {
                position[k] = plane;
                lower[k] = low;
                usable[k] = empty & (low < plane) & (plane < high);
                (whole[k], rim[k], cap[k]) = (extents.cells[axis], b + c, b * c);
            }
        }
        let mut cost = [u32::MAX; 8];
        for k in 0..8 {
            let half = A::snapped_difference(
                A::snapped_product(position[k], 0.5),
                A::snapped_product(lower[k], 0.5),
            );
            // Planes outside give any offset; it must only not overflow what follows.
            let offset = truncated(A::product(half, extents.scale)).min(whole[k]);
            let full = if k % 2 == 0 { whole[k] - offset } else { offset };
            let total = costs.traversal * (whole[k].max(1) * rim[k] + cap[k])
                + costs.intersection * (full.max(1) * rim[k] + cap[k]);
            cost[k] = if usable[k] { total } else { u32::MAX };
        }
        let mut best = Rank { cost: leaf, axis: 0, position: 0 };
        let mut plane = None;
        for k in 0..6 {
            if cost[k] <= best.cost {
                let rank = Rank::new(cost[k], k / 2, position[k]);
                if rank < best {
                    best = rank;
                    plane = Some(SplitPlane { axis: k / 2, position: position[k] });
                }
            }
        }
        plane
    }
}

/// The least candidates so far, one for each lane; [`BestByLane::plane`] compares the lanes.
#[derive(Debug)]
struct BestByLane {
    cost: [u32; WIDTH],
    axis: [u32; WIDTH],
    position: [f32; WIDTH],
}

impl BestByLane {
    /// Candidates must cost less than this.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn above(cost: u32) -> BestByLane {
        // No candidate has this axis: none wins by a tie.
        BestByLane { cost: [cost; WIDTH], axis: [3; WIDTH], position: [0.0; WIDTH] }
    }

    /// Takes a candidate for a lane if it is less. Candidates come in the order of their axes.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn offer(&mut self, lane: usize, cost: u32, axis: u32, position: f32) {
        let tie = (cost == self.cost[lane])
            & (axis == self.axis[lane])
            & (position < self.position[lane]);
        let less = (cost < self.cost[lane]) | tie;
        self.cost[lane] = if less { cost } else { self.cost[lane] };
        self.axis[lane] = if less { axis } else { self.axis[lane] };
        self.position[lane] = if less { position } else { self.position[lane] };
    }

    /// The least of all lanes, if any costs less than this.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn plane(&self, above: u32) -> Option<SplitPlane> {
        let least = self.cost.iter().fold(u32::MAX, |least, &cost| least.min(cost));
        if least >= above {
            return None;
        }
        let mut best = (3, 0.0);
        for lane in 0..WIDTH {
            let (axis, position) = (self.axis[lane], self.position[lane]);
            let first = (axis < best.0) | ((axis == best.0) & (position < best.1));
            if (self.cost[lane] == least) & first {
                best = (axis, position);
            }
        }
        Some(SplitPlane { axis: best.0 as usize, position: best.1 })
    }
}

/// The parts of the configuration that costs depend on. The division by W is a multiplication here.
#[derive(Debug)]
pub(crate) struct SmallRootCosts {
    traversal: u32,
    intersection: u32,
    block_width: u32,
    max_depth: u32,
    /// 2^16 / W, rounded up past any fraction: exact for numerators below 1,024.
    reciprocal: u32,
}

impl SmallRootCosts {
    /// Of a valid configuration.
    pub(crate) fn of(config: &BuildConfig) -> SmallRootCosts {
        SmallRootCosts {
            traversal: config.traversal_cost,
            intersection: config.intersection_cost,
            block_width: config.block_width,
            max_depth: config.max_depth,
            reciprocal: (1 << 16) / config.block_width + 1,
        }
    }

    /// `ceil(count / W)` for counts of at most 64.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn blocks(&self, count: u32) -> u32 {
        ((count + self.block_width - 1) * self.reciprocal) >> 16
    }
}

/// Planes of one axis of a node.
struct PlaneBlock<'a> {
    axis: usize,
    positions: [f32; WIDTH],
    /// Bounds of the node's references on that axis.
    faces: &'a AxisFaces,
    /// Their number.
    count: u32,
}

/// Evaluates the planes of a block, all at once: loops without branches over arrays, which compilers turn
/// into vector instructions.
#[cfg_attr(not(unoptimised), inline(always))]
fn consider<A: Arithmetic, S: ReferenceOps>(
    costs: &SmallRootCosts,
    cell: &Aabb,
    extents: &Extents,
    block: &PlaneBlock<'_>,
    best: &mut BestByLane,
) {
    let &PlaneBlock { axis, positions, faces, count } = block;
    let [left, ended] = S::count(faces, count as usize, &positions);
    let (low, high) = (cell.lo[axis], cell.hi[axis]);
    let half_low = A::snapped_product(low, 0.5);
    let [_, b, c] = [0, 1, 2].map(|k| extents.cells[(axis + k) % 3].max(1));
    let (rim, cap) = (b + c, b * c);
    let whole = extents.cells[axis];
    let area = whole.max(1) * rim + cap;
    for k in 0..WIDTH {
        let plane = positions[k];
        let inside = (low < plane) & (plane < high);
        // Planes outside give any offset; it must only not overflow what follows.
        let half = A::snapped_difference(A::snapped_product(plane, 0.5), half_low);
        let offset = truncated(A::product(half, extents.scale)).min(whole);
        let left_area = offset.max(1) * rim + cap;
        let right_area = (whole - offset).max(1) * rim + cap;
        let sum = costs.blocks(left[k]) * left_area + costs.blocks(count - ended[k]) * right_area;
        let total = costs.traversal * area + costs.intersection * sum;
        let cost = if inside { total } else { u32::MAX };
        best.offer(k, cost, axis as u32, plane);
    }
}

#[cfg(test)]
mod tests;
