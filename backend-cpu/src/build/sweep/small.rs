//! The least split of a small node, all axes at once.
//!
//! A reference's words are eight columns: its lower faces, its triangle, its upper faces, padding.
//! Upper faces are negated, so that in every column a lesser number lies further out on the near
//! side of its planes. Columns are sorted, each for itself, by a network that exchanges whole rows.
//! Then as many blocks of W references start before a plane as there are numbers at sorted places
//! 0, W, 2W and so on that are less than it: a few comparisons in place of one with every
//! reference. That bounds the costs of all planes from below in `f32`, relative to the area of the
//! cell; the few that can be the least are considered in `f64` as everywhere.

mod sort;

use core::cmp::Ordering;

use splitplane_core::layout::Reference;

use self::sort::{OCTET, place, sort};
use super::cost::{BestSplit, Cell, STEPS, Split, SplitCosts};
use crate::simd::InstructionSet;
use crate::simd::WIDTH;
use crate::simd::f32x16::{F32x16, Row16};
use crate::simd::{Compiled, Simd};

/// Most references that are searched this way.
pub(super) const MOST: usize = 128;
/// Rows of two references.
const ROWS: usize = MOST / 2;
/// Relative error of costs in `f32`: 2^-16. A sum of weights is off by 2^-24 a block, of
/// which there are at most 64; all else together by less than 2^-20.
const MARGIN: f64 = 1.0 / 65_536.0;
/// Extents whose squares and reciprocals have no trouble with the range of `f32`: 2^-60 to 2^60.
const FAIR: [f64; 2] = [8.673_617_379_884_035e-19, 1_152_921_504_606_846_976.0];

/// Scratch of one thread.
#[derive(Clone, Debug)]
#[repr(align(64))]
pub(super) struct Small {
    /// The references, two a row; sorted column by column as [`place`] says.
    rows: [Row16; ROWS],
    /// Bounds of the costs of what is in the rows.
    least: [Row16; ROWS],
}

impl Default for Small {
    fn default() -> Small {
        Small { rows: [[0.0; WIDTH]; ROWS], least: [[0.0; WIDTH]; ROWS] }
    }
}

/// The split of least (cost, axis, position) that costs less than `limit`. At most [`MOST`] references.
pub(super) fn best_split(
    set: InstructionSet,
    costs: &SplitCosts,
    cell: &Cell,
    references: &[Reference],
    limit: f64,
    small: &mut Small,
) -> Option<Split> {
    // SAFETY: only sets that the processor has come here.
    unsafe { set.run(SmallSearch { costs, cell, references, limit, small }) }
}

/// [`best`], compiled for each set.
struct SmallSearch<'a> {
    costs: &'a SplitCosts,
    cell: &'a Cell,
    references: &'a [Reference],
    limit: f64,
    small: &'a mut Small,
}

impl Compiled for SmallSearch<'_> {
    type Output = Option<Split>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Option<Split> {
        let SmallSearch { costs, cell, references, limit, small } = self;
        best::<S::F32x16>(costs, cell, references, limit, small)
    }
}

#[cfg_attr(not(unoptimised), inline(always))]
fn best<V: F32x16>(
    costs: &SplitCosts,
    cell: &Cell,
    references: &[Reference],
    limit: f64,
    small: &mut Small,
) -> Option<Split> {
    let references = &references[..references.len().min(MOST)];
    let octets = references.len().div_ceil(2 * OCTET);
    let planar = load::<V>(references, &mut small.rows[..octets * OCTET]);
    sort::<V>(&mut small.rows[..octets * OCTET]);
    let mut best = BestSplit::below(limit);
    let least = bound::<V>(costs, cell, references.len(), small);
    // A bound is off by less than the margin, and so is the value that it is compared with.
    let upper = |cost: f64| ((cost / cell.area) * (1.0 + 2.0 * MARGIN)) as f32;
    let mut most = least + least * (4.0 * MARGIN) as f32;
    most = if most < upper(limit) { most } else { upper(limit) };
    let rows = &small.rows[..octets * OCTET];
    loop {
        // The same plane often comes again: columns are sorted.
        let mut last = [f32::NAN; WIDTH];
        for (row, least) in rows.iter().zip(&small.least) {
            let mut open = V::load(least).not_above(V::splat(most));
            while open != 0 {
                let lane = open.trailing_zeros() as usize;
                open &= open - 1;
                let (axis, face) = (lane % 4, row[lane]);
                let position = if lane % 8 < 4 { face } else { 0.0 - face };
                // Columns that are no faces get here where a bound is NaN.
                if position == last[lane] || axis == 3 || !cell.contains(axis, position) {
                    continue;
                }
                last[lane] = position;
                let [left, right] = count::<V>(rows, axis, position);
                let planar = if planar >> axis & 1 == 1 {
                    count_planar::<V>(references, axis, position)
                } else {
                    0
                };
                best.consider(costs, cell, axis, position, [left, planar, right]);
            }
        }
        // Planar references make planes cost more than their bounds say.
        let enough = upper(best.cost);
        if enough.partial_cmp(&most) != Some(Ordering::Greater) {
            return best.split;
        }
        most = enough;
    }
}

/// Copies references to rows, which they fill except for the last few; upper faces are negated.
/// Returns a bit for each axis that a reference is planar on.
#[cfg_attr(not(unoptimised), inline(always))]
fn load<V: F32x16>(references: &[Reference], rows: &mut [Row16]) -> u16 {
    let words: &mut [f32] = rows.as_flattened_mut();
    let (full, rest) = words.split_at_mut(references.len() * 8);
    full.copy_from_slice(bytemuck::cast_slice(references));
    const NOTHING: [f32; 8] = {
        const FAR: f32 = f32::INFINITY;
        [FAR, FAR, FAR, FAR, -FAR, -FAR, -FAR, -FAR]
    };
    for rest in rest.as_chunks_mut::<8>().0 {
        *rest = NOTHING;
    }
    let mut planar = 0;
    for row in rows {
        let words = V::load(row);
        planar |= words.equal(words.crossed());
        words.faces().store(row);
    }
    planar | planar >> 8
}

/// Bounds the costs of the planes in all rows from below, except for [`MARGIN`], in units of the
/// cell's half area; infinite where a plane is not inside. Returns the least.
#[cfg_attr(not(unoptimised), inline(always))]
fn bound<V: F32x16>(costs: &SplitCosts, cell: &Cell, count: usize, small: &mut Small) -> f32 {
    let width = costs.width as usize;
    let blocks = count.div_ceil(width);
    // The near side of a plane is the one that its column's numbers begin on.
    let [mut near_end, mut far_end, mut slope, mut base] = [[0.0; 8]; 4];
    // Nothing is inside the columns that are no faces.
    (near_end[3], near_end[7]) = (f32::INFINITY, f32::INFINITY);
    for axis in 0..3 {
        let areas = &cell.axes[axis];
        let extent = areas.hi - areas.lo;
        let fair = FAIR[0] < extent && extent < FAIR[1];
        let share = if fair { 1.0 / cell.area } else { 0.0 };
        let (lo, hi) = (cell.bounds.lo[axis], cell.bounds.hi[axis]);
        for (column, lo, hi) in [(axis, lo, hi), (axis + 4, -hi, -lo)] {
            (near_end[column], far_end[column]) = (lo, hi);
            slope[column] = (areas.slope * share) as f32;
            base[column] = (areas.base * share) as f32;
        }
    }
    let [near_end, far_end] = [V::twice(&near_end), V::twice(&far_end)];
    let [slope, base] = [V::twice(&slope), V::twice(&base)];
    let step = V::splat((cell.step / cell.area) as f32);
    let [zero, infinite] = [V::splat(0.0), V::splat(f32::INFINITY)];
    let empty = V::splat(costs.empty as f32);
    let mut least = infinite;
    const GROUP: usize = 4;
    let used = count.div_ceil(2 * OCTET) * OCTET;
    for group in 0..used / GROUP {
        let rows: [V; GROUP] = core::array::from_fn(|i| V::load(&small.rows[group * GROUP + i]));
        let [mut near, mut far] = [[zero; GROUP]; 2];
        for block in 0..blocks {
            let (row, half) = place(block * width);
            let more = V::splat(costs.steps[block % STEPS]);
            let half: &[f32; 8] = small.rows[row][half..].first_chunk().unwrap_or(&[0.0; 8]);
            let own = V::twice(half);
            let other = zero.minus(own.crossed());
            for i in 0..GROUP {
                near[i] = near[i].plus_where_less(own, rows[i], more);
                far[i] = far[i].plus_where_less(rows[i], other, more);
            }
        }
        for i in 0..GROUP {
            let near_area = rows[i].minus(near_end).times(slope).plus(base);
            let far_area = far_end.minus(rows[i]).times(slope).plus(base);
            let cost = step.plus(near[i].times(near_area).plus(far[i].times(far_area)));
            let cost = cost.where_less(zero, near[i].least(far[i]), cost.times(empty));
            let cost = cost.where_less(near_end, rows[i], infinite);
            let cost = cost.where_less(rows[i], far_end, infinite);
            least = cost.least(least);
            cost.store(&mut small.least[group * GROUP + i]);
        }
    }
    least.least_lane()
}

/// How many references start before a plane, and how many end behind it.
#[cfg_attr(not(unoptimised), inline(always))]
fn count<V: F32x16>(rows: &[Row16], axis: usize, position: f32) -> [u32; 2] {
    let mut plane = [f32::NEG_INFINITY; 8];
    (plane[axis], plane[axis + 4]) = (position, -position);
    let plane = V::twice(&plane);
    let mut left = 0;
    let mut right = 0;
    for row in rows {
        let less = V::load(row).less(plane);
        left += (less & 0x0f0f).count_ones();
        right += (less & 0xf0f0).count_ones();
    }
    [left, right]
}

/// How many references are planar in a plane.
#[cfg_attr(not(unoptimised), inline(always))]
fn count_planar<V: F32x16>(references: &[Reference], axis: usize, position: f32) -> u32 {
    let words: &[f32] = bytemuck::cast_slice(references);
    let (rows, rest) = words.as_chunks::<WIDTH>();
    let plane = V::splat(position);
    let both = |words: V| {
        let faces = words.equal(plane);
        faces & faces >> 4 & 0x101 << axis
    };
    let mut planar = 0;
    for row in rows {
        planar += both(V::load(row)).count_ones();
    }
    if let Some(rest) = rest.first_chunk() {
        planar += (both(V::twice(rest)) & 0xff).count_ones();
    }
    planar
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::sweep::oracle;
    use splitplane_test_support::random::Random;

    #[test]
    fn the_split_is_that_of_a_search_over_all() {
        let mut random = Random::new(77);
        let mut small = Small::default();
        let (mut found, mut rare) = (0, 0);
        for round in 0..4000 {
            let both = oracle::costs(&mut random);
            let costs = &both[round % 2];
            let count = 1 + random.below(if round % 8 == 0 { MOST } else { 40 });
            let (cell, references) = oracle::node(&mut random, costs, count);
            if cell.area <= 0.0 {
                continue;
            }
            let free = oracle::best_split(costs, &cell, &references, f64::INFINITY);
            let mut limits = vec![f64::INFINITY, costs.leaf(cell.area, count as u32)];
            limits.extend(free.map(|split| split.cost));
            for limit in limits {
                let expected = oracle::best_split(costs, &cell, &references, limit);
                for set in InstructionSet::available() {
                    let split = best_split(set, costs, &cell, &references, limit, &mut small);
                    assert_eq!(split, expected, "{set:?} {round} {limit}");
                }
                found += usize::from(expected.is_some());
                rare += usize::from(expected.is_some_and(|split| split.planar_right));
            }
        }
        assert!(found > 4000 && rare > 50, "{found} {rare}");
    }
}
