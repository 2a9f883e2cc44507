//! Boxes of nodes and leaves while a layout is made.

use splitplane_core::aabb::Aabb;
use splitplane_core::query::intersect::{longest_extent, widened};

/// The two parts of a cell at a plane.
pub(crate) fn halves(cell: &Aabb, axis: usize, split: f32) -> (Aabb, Aabb) {
    let (mut left, mut right) = (*cell, *cell);
    (left.hi[axis], right.lo[axis]) = (split, split);
    (left, right)
}

/// The part of a box in another one.
pub(crate) fn part(cell: &Aabb, bounds: &Aabb) -> Aabb {
    let part = bounds.intersection(cell);
    // Whatever rounding did to a box: what the leaf has is not to be lost.
    let lost = (0..3).any(|axis| part.lo[axis] > part.hi[axis]);
    if lost { *cell } else { part }
}

/// The part of some triangles' bounds in their cell, widened by as much as rays that are rounded
/// need for triangles of that size. So a large triangle widens the boxes of its own leaves, and no others.
pub(crate) fn within(cell: &Aabb, bounds: &Aabb) -> Aabb {
    widened(&part(cell, bounds), longest_extent(bounds))
}
