//! References to the two sides of a split.

use splitplane_core::aabb::Aabb;
use splitplane_core::layout::Reference;
use splitplane_core::triangle::Triangle;

use super::clip::{Clipper, Polygons, points};
use super::cost::Split;
use super::wide::for_every_set;

/// References that are moved before those of them that straddle are clipped.
const BLOCK: usize = 64;
/// Triangles whose corners are loaded together.
const AHEAD: usize = 8;

for_every_set! {
    /// Moves the references of a node to the sides of a split: those that go right to the front of
    /// `references`, those that go left to `left`, which must be as long. Both keep their order. Returns
    /// how many go left and right.
    pub(super) fn partition(
        clipped: bool,
        triangles: &[Triangle],
        cell: &Aabb,
        split: &Split,
        references: &mut [Reference],
        left: &mut [Reference],
    ) -> [usize; 2] {
        let (axis, plane) = (split.axis, split.position);
        let left = &mut left[..references.len()];
        let clipper = Clipper::new(cell, axis, plane);
        let mut polygons = Polygons::default();
        let mut corners = [[[0.0; 4]; 3]; AHEAD];
        let (mut below, mut above) = (0, 0);
        for first in (0..references.len()).step_by(BLOCK) {
            let starts = [below, above];
            // Where those that straddle stand on either side.
            let mut straddling = [[0u32; 2]; BLOCK];
            let mut straddlers = 0;
            for i in first..references.len().min(first + BLOCK) {
                let (lo, hi) = (references[i].lo[axis], references[i].hi[axis]);
                let reference = references[i];
                let planar = (lo == plane) & (hi == plane);
                let goes_left = (lo < plane) | (planar & !split.planar_right);
                let goes_right = (hi > plane) | (planar & split.planar_right);
                // Written to both sides without a branch, and counted where it goes. What goes right
                // never overtakes what is read.
                left[below] = reference;
                references[above] = reference;
                straddling[straddlers] = [below as u32, above as u32];
                straddlers += usize::from(goes_left & goes_right);
                below += usize::from(goes_left);
                above += usize::from(goes_right);
            }
            let straddling = &straddling[..straddlers];
            let mut lost = [0u64; 2];
            if clipped {
                for (k, &[low, high]) in straddling.iter().enumerate() {
                    if k % AHEAD == 0 {
                        // Corners of some first: these loads miss the caches, and do so side by side.
                        for (corners, &[low, _]) in corners.iter_mut().zip(&straddling[k..]) {
                            *corners = points(&triangles[left[low as usize].triangle as usize]);
                        }
                    }
                    let [low, high] = [low, high].map(|place| place as usize);
                    let reference = left[low];
                    let [one, other] =
                        clipper.clip(&corners[k % AHEAD], &reference, &mut polygons);
                    // One that has nothing on either side, because its bounds were wider than its part
                    // of the cell, stays on both as its bounds have it: a reference never disappears.
                    if one.1 | other.1 {
                        (left[low], references[high]) = (one.0, other.0);
                        lost[0] |= u64::from(!one.1) << k;
                        lost[1] |= u64::from(!other.1) << k;
                    } else {
                        (left[low], references[high]) = halves(&reference, split);
                    }
                }
            } else {
                for straddler in straddling {
                    let [low, high] = straddler.map(|place| place as usize);
                    (left[low], references[high]) = halves(&left[low], split);
                }
            }
            if lost[0] != 0 {
                below = without(left, starts[0], below, |k| straddling[k][0] as usize, lost[0]);
            }
            if lost[1] != 0 {
                above = without(references, starts[1], above, |k| straddling[k][1] as usize, lost[1]);
            }
        }
        [below, above]
    }
}

/// Removes from the end of a list the references at the places of the numbers in a set. Returns where it
/// ends then.
#[cold]
fn without(
    list: &mut [Reference],
    start: usize,
    end: usize,
    place: impl Fn(usize) -> usize,
    mut lost: u64,
) -> usize {
    let mut kept = start;
    for i in start..end {
        if lost != 0 && place(lost.trailing_zeros() as usize) == i {
            lost &= lost - 1;
        } else {
            list[kept] = list[i];
            kept += 1;
        }
    }
    kept
}

/// Both parts of a straddling reference, as its bounds have them.
#[inline(always)]
fn halves(reference: &Reference, split: &Split) -> (Reference, Reference) {
    let (mut left, mut right) = (*reference, *reference);
    left.hi[split.axis] = split.position;
    right.lo[split.axis] = split.position;
    (left, right)
}
