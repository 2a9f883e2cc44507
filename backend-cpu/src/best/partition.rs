//! References to the two sides of a split.

use splitplane_core::aabb::Aabb;
use splitplane_core::layout::Reference;
use splitplane_core::triangle::Triangle;

use super::clip::clip;
use super::cost::Split;

/// Moves the references of a node to the sides of a split: those that go right to the front of
/// `references`, those that go left to `left`, which must be as long. Both keep their order. Returns how
/// many go left and right.
pub(super) fn partition(
    clipped: bool,
    triangles: &[Triangle],
    cell: &Aabb,
    split: &Split,
    references: &mut [Reference],
    left: &mut [Reference],
) -> [usize; 2] {
    let (axis, plane) = (split.axis, split.position);
    let (mut below, mut above) = (0, 0);
    let left = &mut left[..references.len()];
    for i in 0..references.len() {
        let reference = references[i];
        let (lo, hi) = (reference.lo[axis], reference.hi[axis]);
        let planar = lo == hi && lo == plane;
        let goes_left = lo < plane || (planar && !split.planar_right);
        let goes_right = hi > plane || (planar && split.planar_right);
        if goes_left && goes_right {
            let [one, other] = sides(clipped, triangles, cell, split, &reference);
            left[below] = one.0;
            below += usize::from(one.1);
            references[above] = other.0;
            above += usize::from(other.1);
        } else {
            // Written to both sides, and counted on one. What goes right never overtakes what is read.
            left[below] = reference;
            below += usize::from(goes_left);
            references[above] = reference;
            above += usize::from(goes_right);
        }
    }
    [below, above]
}

/// Both parts of a straddling reference, and whether they are there. One that has nothing on either side,
/// because its bounds were wider than its part of the cell, stays on both as its bounds have it: a
/// reference never disappears.
fn sides(
    clipped: bool,
    triangles: &[Triangle],
    cell: &Aabb,
    split: &Split,
    reference: &Reference,
) -> [(Reference, bool); 2] {
    if clipped {
        let corners = &triangles[reference.triangle as usize];
        let parts = clip(corners, cell, &reference.bounds(), split.axis, split.position);
        if parts != [None, None] {
            return parts.map(|part| match part {
                Some(bounds) => (Reference::new(&bounds, reference.triangle), true),
                None => (*reference, false),
            });
        }
    }
    let (mut left, mut right) = (*reference, *reference);
    left.hi[split.axis] = split.position;
    right.lo[split.axis] = split.position;
    [(left, true), (right, true)]
}
