//! References to the two sides of a split.

use splitplane_core::aabb::Aabb;
use splitplane_core::layout::Reference;
use splitplane_core::triangle::Triangle;

use super::clip::{Clipper, Polygons, points};
use super::cost::Split;
use crate::simd::every_set::for_every_set;

/// References that are moved before those of them that straddle are clipped.
const BLOCK: usize = 64;
/// Triangles whose corners are loaded together.
const AHEAD: usize = 8;

for_every_set! {
    /// Moves the references of a node to the sides of a split: those that go right to the front of
    /// `references`, those that go left to `left`, which must be as long. Both keep their order. Returns
    /// how many go left and right.
    pub(super) fn partition<S>(
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
            // The places of straddling references on either side.
            let mut straddling = [[0u32; 2]; BLOCK];
            let mut straddlers = 0;
            for i in first..references.len().min(first + BLOCK) {
                let (lo, hi) = (references[i].lo[axis], references[i].hi[axis]);
                let reference = references[i];
                let planar = (lo == plane) & (hi == plane);
                let goes_left = (lo < plane) | (planar & !split.planar_right);
                let goes_right = (hi > plane) | (planar & split.planar_right);
                // Written to both sides without a branch, and counted on the side where it goes.
                // Writes to the right never overtake the reads.
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
                        // The corners of several references first: these loads miss the caches, and
                        // the misses overlap.
                        for (corners, &[low, _]) in corners.iter_mut().zip(&straddling[k..]) {
                            *corners = points(&triangles[left[low as usize].triangle as usize]);
                        }
                    }
                    let [low, high] = [low, high].map(|place| place as usize);
                    let reference = left[low];
                    let [one, other] =
                        clipper.clip(&corners[k % AHEAD], &reference, &mut polygons);
                    // A reference with nothing on either side, because its bounds were wider than
                    // its part of the cell, stays on both sides with its bounds: a reference never
                    // disappears.
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
#[cfg_attr(not(unoptimised), inline(always))]
fn halves(reference: &Reference, split: &Split) -> (Reference, Reference) {
    let (mut left, mut right) = (*reference, *reference);
    left.hi[split.axis] = split.position;
    right.lo[split.axis] = split.position;
    (left, right)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::sweep::clip::clip;
    use crate::build::sweep::cost::SplitCosts;
    use crate::build::sweep::oracle;
    use crate::simd::InstructionSet;
    use splitplane_core::config::{BuildConfig, Sweep};
    use splitplane_test_support::random::Random;

    /// One reference at a time.
    fn plain(
        clipped: bool,
        triangles: &[Triangle],
        cell: &Aabb,
        split: &Split,
        references: &[Reference],
    ) -> [Vec<Reference>; 2] {
        let mut sides = [Vec::new(), Vec::new()];
        for reference in references {
            let (lo, hi) = (reference.lo[split.axis], reference.hi[split.axis]);
            let planar = lo == split.position && hi == split.position;
            let goes_left = lo < split.position || (planar && !split.planar_right);
            let goes_right = hi > split.position || (planar && split.planar_right);
            let (mut left, mut right) = (Some(*reference), Some(*reference));
            if goes_left && goes_right {
                let triangle = reference.triangle;
                let corners = &triangles[triangle as usize];
                let bounds = reference.bounds();
                let parts = clip(corners, cell, &bounds, split.axis, split.position);
                if clipped && parts != [None, None] {
                    [left, right] =
                        parts.map(|part| part.map(|bounds| Reference::new(&bounds, triangle)));
                } else {
                    let halves = halves(reference, split);
                    (left, right) = (Some(halves.0), Some(halves.1));
                }
            }
            sides[0].extend(left.filter(|_| goes_left));
            sides[1].extend(right.filter(|_| goes_right));
        }
        sides
    }

    #[test]
    fn references_go_where_they_go_one_by_one() {
        let mut random = Random::new(21);
        let costs =
            &SplitCosts::both(&BuildConfig::default(), &Sweep { empty_bonus: 0, bad_splits: 0 })[0];
        let mut lost = 0;
        for round in 0..600 {
            let count = 1 + random.below(200);
            let (cell, references) = oracle::node(&mut random, costs, count);
            // Bounds are those of boxes; a corner of each box belongs to the triangle, the others lie
            // somewhere near it, so that much of a box may hold nothing.
            let triangles: Vec<Triangle> = references
                .iter()
                .map(|reference| {
                    let mut corners = [reference.lo, reference.hi, reference.lo];
                    let axis = random.below(3);
                    corners[2][axis] = reference.hi[axis];
                    corners
                })
                .collect();
            let axis = random.below(3);
            let face = references[random.below(count)];
            let position = random.pick(&[face.lo[axis], face.hi[axis]]);
            if !cell.contains(axis, position) {
                continue;
            }
            let planar_right = random.below(2) == 1;
            let split = Split { cost: 0.0, axis, position, planar_right, counts: [0; 2] };
            // A cell that cuts some of them, too.
            let mut bounds = cell.bounds;
            let inner = random.pick(&references);
            if round % 2 == 0 {
                let other = (axis + 1) % 3;
                bounds.hi[other] = inner.hi[other];
            }
            for clipped in [true, false] {
                let expected = plain(clipped, &triangles, &bounds, &split, &references);
                for set in InstructionSet::available() {
                    let (mut right, mut left) = (references.clone(), references.clone());
                    let counts =
                        partition(set, clipped, &triangles, &bounds, &split, &mut right, &mut left);
                    assert_eq!(counts, [expected[0].len(), expected[1].len()]);
                    let bytes = |list: &[Reference]| bytemuck::cast_slice(list).to_vec();
                    let words: [Vec<u32>; 2] =
                        [bytes(&left[..counts[0]]), bytes(&right[..counts[1]])];
                    assert_eq!(words, [bytes(&expected[0]), bytes(&expected[1])]);
                }
                let straddling = expected[0].len() + expected[1].len() - count;
                let by_bounds = plain(false, &triangles, &bounds, &split, &references);
                lost += by_bounds[0].len() + by_bounds[1].len() - count - straddling;
            }
        }
        assert!(lost > 30, "{lost}");
    }
}
