//! Where a node may be cut: empty-space cutoff, spatial median, the sides of a plane, the tie rule.

use crate::aabb::Aabb;
use crate::arithmetic::{Arithmetic, exponent, ordered_bits};
use crate::config::BuildConfig;
use crate::layout::Reference;
use crate::sah::{Extents, LEAST_EXPONENT};

/// A plane that cuts a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplitPlane {
    /// Axis the plane is perpendicular to, 0 to 2.
    pub axis: usize,
    /// Its position on that axis, strictly inside the node's cell.
    pub position: f32,
}

/// True when a plane lies strictly inside the cell on its axis. Rounding can put a median on a side;
/// then both children would not be smaller than their parent.
#[inline]
pub fn strictly_inside(cell: &Aabb, axis: usize, position: f32) -> bool {
    cell.lo[axis] < position && position < cell.hi[axis]
}

/// Whether a reference with bounds `lo..hi` on the plane's axis goes left: it has something below
/// the plane, or is planar in it. Planar references go left only.
#[inline]
pub fn goes_left(lo: f32, hi: f32, position: f32) -> bool {
    lo < position || hi <= position
}

/// Whether a reference goes right: it has something above the plane.
#[inline]
pub fn goes_right(hi: f32, position: f32) -> bool {
    hi > position
}

/// Empty-space cutoff (Zhou et al. 2008, Algorithm 2): the plane that cuts empty space off one side
/// of `cell`, when what lies between that side and the tight bounds of the node's references is
/// more than C_e of the cell's extent. Sides in the order x low, x high, y low, ... `side` counts
/// them from 0 to 5; even sides are low.
#[inline]
pub fn empty_cutoff<A: Arithmetic>(
    config: &BuildConfig,
    cell: &Aabb,
    tight: &Aabb,
    side: usize,
) -> Option<SplitPlane> {
    let axis = side / 2;
    let position = if side.is_multiple_of(2) { tight.lo[axis] } else { tight.hi[axis] };
    if !strictly_inside(cell, axis, position) {
        return None;
    }
    // Halved, so that nothing overflows.
    let extent = cell.half_extent_in::<A>(axis);
    if exponent(extent) < LEAST_EXPONENT {
        return None;
    }
    let gap = if side.is_multiple_of(2) {
        Aabb { lo: cell.lo, hi: tight.lo }.half_extent_in::<A>(axis)
    } else {
        Aabb { lo: tight.hi, hi: cell.hi }.half_extent_in::<A>(axis)
    };
    // The left product rounds once, the right one is exact: a power of two.
    let limit = A::product(extent, config.empty_cutoff() as f32 * (1.0 / 256.0));
    (gap > limit).then_some(SplitPlane { axis, position })
}

/// The spatial median of the longest axis; of the next longest when rounding leaves no float
/// strictly between its ends. `None` when no axis can be halved.
#[inline]
pub fn spatial_median<A: Arithmetic>(cell: &Aabb) -> Option<SplitPlane> {
    let half = [0, 1, 2].map(|axis| cell.half_extent_in::<A>(axis));
    let mut order = [0usize, 1, 2];
    // Insertion sort by descending extent; stable, so the lower axis wins ties.
    if half[order[1]] > half[order[0]] {
        order.swap(0, 1);
    }
    if half[order[2]] > half[order[1]] {
        order.swap(1, 2);
        if half[order[1]] > half[order[0]] {
            order.swap(0, 1);
        }
    }
    if exponent(half[order[0]]) < LEAST_EXPONENT {
        return None;
    }
    order.into_iter().find_map(|axis| {
        // Both halves are exact, so the sum rounds once however a compiler fuses it.
        let position = A::snapped_sum(
            A::snapped_product(cell.lo[axis], 0.5),
            A::snapped_product(cell.hi[axis], 0.5),
        );
        strictly_inside(cell, axis, position).then_some(SplitPlane { axis, position })
    })
}

/// How many references [`sampled_sweep`] takes its planes from.
pub const SWEEP_SAMPLES: usize = 64;
/// References between two checks for cancellation.
const SWEEP_PART: usize = 1 << 15;

/// The best plane by SAH among the faces of up to [`SWEEP_SAMPLES`] references, evenly spread over
/// the list: all of them for short lists. For large nodes whose spatial median separates nothing.
/// `None` when no face lies strictly inside the cell, or no such plane pays.
pub fn sampled_sweep<A: Arithmetic>(cell: &Aabb, references: &[Reference]) -> Option<SplitPlane> {
    sampled_sweep_while::<A>(cell, references, |_| true)
}

/// As [`sampled_sweep`]; `go_on` is called at intervals with the amount of work since the last
/// call, in references read and written. Once it returns false, the result is invalid.
pub fn sampled_sweep_while<A: Arithmetic>(
    cell: &Aabb,
    references: &[Reference],
    mut go_on: impl FnMut(u64) -> bool,
) -> Option<SplitPlane> {
    let extents = Extents::of::<A>(cell)?;
    let samples = references.len().min(SWEEP_SAMPLES);
    let whole = u64::from(Extents::half_area(extents.cells));
    // Least (cost, axis, position), if below the cost of a leaf.
    let mut best = (whole * references.len() as u64, 0, 0);
    let mut found = None;
    for axis in 0..3 {
        for face in 0..2 * samples {
            let sample = &references[(face / 2) * references.len() / samples];
            let position = if face % 2 == 0 { sample.lo[axis] } else { sample.hi[axis] };
            if !strictly_inside(cell, axis, position) {
                continue;
            }
            let plane = SplitPlane { axis, position };
            if found == Some(plane) {
                continue;
            }
            let (mut left, mut right) = (0u64, 0u64);
            for part in references.chunks(SWEEP_PART) {
                for reference in part {
                    let (lo, hi) = (reference.lo[axis], reference.hi[axis]);
                    left += u64::from(goes_left(lo, hi, position));
                    right += u64::from(goes_right(hi, position));
                }
                // Looking at one side's faces is about a tenth of that work.
                if !go_on(part.len() as u64 / 8) {
                    return None;
                }
            }
            let offset = extents.offset::<A>(cell.lo[axis], position);
            let [_, left_area, right_area] = extents.split_areas(axis, offset).map(u64::from);
            let rank = (left * left_area + right * right_area, axis, ordered_bits(position));
            if rank < best {
                (best, found) = (rank, Some(plane));
            }
        }
    }
    found
}

/// The order of split candidates: least cost, then lowest axis, then lowest position. Candidates
/// equal in all three are the same plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Rank {
    /// Integer SAH cost.
    pub cost: u32,
    /// Axis, 0 to 2.
    pub axis: u32,
    /// Position, as an integer of the same order.
    pub position: u32,
}

impl Rank {
    /// Greater than every candidate's.
    pub const WORST: Rank = Rank { cost: u32::MAX, axis: u32::MAX, position: u32::MAX };

    /// The rank of a candidate.
    #[inline]
    pub fn new(cost: u32, axis: usize, position: f32) -> Rank {
        Rank { cost, axis: axis as u32, position: ordered_bits(position) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::{Hostile, Strict};

    const UNIT: Aabb = Aabb { lo: [0.0; 3], hi: [4.0, 2.0, 1.0] };

    #[test]
    fn planes_in_a_side_are_not_inside() {
        let cell = Aabb { lo: [1.0; 3], hi: [2.0; 3] };
        for (position, inside) in
            [(0.5, false), (1.0, false), (1.5, true), (2.0, false), (3.0, false)]
        {
            assert_eq!(strictly_inside(&cell, 1, position), inside, "{position}");
        }
    }

    #[test]
    fn every_reference_goes_somewhere_and_planar_ones_left() {
        for (lo, hi, sides) in [
            (0.0, 1.0, (true, false)),
            (0.0, 2.0, (true, false)),
            (0.0, 3.0, (true, true)),
            (2.0, 2.0, (true, false)),
            (2.0, 3.0, (false, true)),
            (3.0, 3.0, (false, true)),
        ] {
            assert_eq!((goes_left(lo, hi, 2.0), goes_right(hi, 2.0)), sides, "{lo} {hi}");
        }
    }

    #[test]
    fn cutoff_needs_more_than_its_share() {
        let config = BuildConfig::default();
        let tight = |lo| Aabb { lo: [lo, 0.0, 0.0], hi: [4.0, 2.0, 1.0] };
        assert_eq!(empty_cutoff::<Strict>(&config, &UNIT, &tight(1.0), 0), None);
        let plane = empty_cutoff::<Strict>(&config, &UNIT, &tight(1.25), 0);
        assert_eq!(plane, Some(SplitPlane { axis: 0, position: 1.25 }));
        assert_eq!(empty_cutoff::<Hostile>(&config, &UNIT, &tight(1.25), 0), plane);
        for side in 1..6 {
            assert_eq!(empty_cutoff::<Strict>(&config, &UNIT, &tight(1.25), side), None);
        }
    }

    #[test]
    fn median_takes_the_longest_axis_that_has_a_middle() {
        assert_eq!(spatial_median::<Strict>(&UNIT), Some(SplitPlane { axis: 0, position: 2.0 }));
        // Neighbouring floats on the longest axis: the next one serves.
        let coarse = Aabb { lo: [1.7e7, 0.0, 0.0], hi: [1.7e7 + 2.0, 1.0, 0.5] };
        assert_eq!(spatial_median::<Strict>(&coarse), Some(SplitPlane { axis: 1, position: 0.5 }));
        let point = Aabb { lo: [1.0; 3], hi: [1.0; 3] };
        assert_eq!(spatial_median::<Strict>(&point), None);
        let whole = Aabb { lo: [-f32::MAX; 3], hi: [f32::MAX; 3] };
        assert_eq!(spatial_median::<Strict>(&whole), Some(SplitPlane { axis: 0, position: 0.0 }));
        // The order of extents, in every arrangement.
        for (extents, axis) in
            [([1.0, 2.0, 3.0], 2), ([1.0, 3.0, 2.0], 1), ([2.0, 2.0, 2.0], 0), ([1.0, 2.0, 2.0], 1)]
        {
            let cell = Aabb { lo: [0.0; 3], hi: extents };
            assert_eq!(spatial_median::<Strict>(&cell).unwrap().axis, axis);
        }
    }

    #[test]
    fn the_sweep_finds_what_the_median_does_not_separate() {
        let layer = |z: f32, triangle| {
            Reference::new(&Aabb { lo: [0.0, 0.0, z], hi: [10.0, 10.0, z] }, triangle)
        };
        let cell = Aabb { lo: [0.0; 3], hi: [10.0, 10.0, 1.0] };
        let layers: [Reference; 100] = core::array::from_fn(|i| layer(i as f32 / 99.0, i as u32));
        let plane = sampled_sweep::<Strict>(&cell, &layers).unwrap();
        assert_eq!(plane.axis, 2);
        let same: [Reference; 100] = core::array::from_fn(|i| Reference::new(&cell, i as u32));
        assert_eq!(sampled_sweep::<Strict>(&cell, &same), None);
    }

    /// Of planes that cost the same it takes the one of the lowest axis, then of the lowest position,
    /// however the references are listed; and none that costs the same as a leaf.
    #[test]
    fn the_sweep_breaks_ties_by_axis_then_position() {
        let sweep = |cell: &Aabb, boxes: &[[[f32; 2]; 3]]| {
            let forward: [Reference; 3] = core::array::from_fn(|i| {
                let ends = boxes[i % boxes.len()];
                let bounds = Aabb { lo: ends.map(|[lo, _]| lo), hi: ends.map(|[_, hi]| hi) };
                Reference::new(&bounds, i as u32)
            });
            let forward = &forward[..boxes.len()];
            let mut backward = [forward[0]; 3];
            let backward = &mut backward[..boxes.len()];
            backward.copy_from_slice(forward);
            backward.reverse();
            let found = sampled_sweep::<Strict>(cell, forward);
            assert_eq!(sampled_sweep::<Strict>(cell, backward), found);
            found.map(|plane| (plane.axis, plane.position))
        };
        let cube = |lo: f32, hi: f32| Aabb { lo: [lo; 3], hi: [hi; 3] };
        let all = [0.0, 8.0];
        // Planes at 2 and at 6, as far from either side.
        assert_eq!(
            sweep(&cube(0.0, 8.0), &[[[0.0, 2.0], all, all], [[6.0, 8.0], all, all]]),
            Some((0, 2.0))
        );
        let all = [-4.0, 4.0];
        let ends = [[all, [-4.0, -2.0], all], [all, [2.0, 4.0], all]];
        assert_eq!(sweep(&cube(-4.0, 4.0), &ends), Some((1, -2.0)));
        // The same on all axes.
        let corners = [[[0.0, 2.0]; 3], [[6.0, 8.0]; 3]];
        assert_eq!(sweep(&cube(0.0, 8.0), &corners), Some((0, 2.0)));
        // The higher position is on the lower axis.
        let beam = [[[6.0, 8.0], [0.0, 2.0], [0.0, 8.0]]];
        assert_eq!(sweep(&cube(0.0, 8.0), &beam), Some((0, 6.0)));
        // On a line: 3 references of 1,023 and 2 of 3 are 3 of 1,025.
        let line = Aabb { lo: [0.0; 3], hi: [8.0, 0.0, 0.0] };
        let (whole, short) =
            ([[0.0, 8.0], [0.0; 2], [0.0; 2]], [[0.0, 7.984_375], [0.0; 2], [0.0; 2]]);
        assert_eq!(sweep(&line, &[whole, short, whole]), None);
        // A little cheaper.
        assert_eq!(sweep(&line, &[whole, short, short]), Some((0, 7.984_375)));
    }

    #[test]
    fn ranks_break_ties_by_axis_then_position() {
        let mut ranks = [
            Rank::new(5, 1, 0.0),
            Rank::new(5, 0, 2.0),
            Rank::new(4, 2, 9.0),
            Rank::new(5, 0, -2.0),
        ];
        ranks.sort();
        assert_eq!(
            ranks,
            [
                Rank::new(4, 2, 9.0),
                Rank::new(5, 0, -2.0),
                Rank::new(5, 0, 2.0),
                Rank::new(5, 1, 0.0)
            ]
        );
        assert!(Rank::WORST > ranks[3]);
    }
}
