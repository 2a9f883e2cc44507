//! The least split of a small node, all axes at once.
//!
//! A reference's words are eight columns: its lower faces, its triangle, its upper faces, padding.
//! Upper faces are negated, so that in every column a lesser number lies further out on the near
//! side of its planes. Columns are sorted, each for itself, by a network that exchanges whole rows.
//! Then as many blocks of W references start before a plane as there are numbers at sorted places
//! 0, W, 2W and so on that are less than it: a few comparisons in place of one with every
//! reference. That bounds the costs of all planes from below in `f32`, relative to the area of the
//! cell; the few that can be the least are considered in `f64` as everywhere.

use core::cmp::Ordering;

use splitplane_core::layout::Reference;

use super::cost::{BestSplit, Cell, STEPS, Split, SplitCosts};
use crate::simd::InstructionSet;
use crate::simd::WIDTH;
use crate::simd::f32x16::{F32x16, Row16};
use crate::simd::{Compiled, Simd};

/// Most references that are searched this way.
pub(super) const MOST: usize = 128;
/// Rows that are sorted together: 16 references.
const OCTET: usize = 8;
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

/// Where the number at a place in sorted order is: row and first lane of its column's half.
#[cfg_attr(not(unoptimised), inline(always))]
fn place(sorted: usize) -> (usize, usize) {
    (sorted / (2 * OCTET) * OCTET + sorted % OCTET, sorted / OCTET % 2 * 8)
}

/// Sorts rows whose number is a multiple of [`OCTET`].
#[cfg_attr(not(unoptimised), inline(always))]
fn sort<V: F32x16>(rows: &mut [Row16]) {
    let octets = rows.as_chunks_mut::<OCTET>().0;
    for octet in octets.iter_mut() {
        sort_octet::<V>(octet);
    }
    // A network that sorts numbers sorts octets, where it exchanges what the lower and the upper half of
    // two belong to.
    for [one, other] in NETWORK {
        if other < octets.len() {
            let (low, high) = octets.split_at_mut(other);
            merge::<V>(&mut low[one], &mut high[0]);
        }
    }
}

/// A network that sorts eight numbers; without exchanges that involve the last ones, fewer.
const NETWORK: [[usize; 2]; 19] = [
    [0, 2],
    [1, 3],
    [4, 6],
    [5, 7],
    [0, 4],
    [1, 5],
    [2, 6],
    [3, 7],
    [0, 1],
    [2, 3],
    [4, 5],
    [6, 7],
    [2, 4],
    [3, 5],
    [1, 4],
    [3, 6],
    [1, 2],
    [3, 4],
    [5, 6],
];

/// Exchanges pairs of rows so that the former of each pair has what is less, column by column. A macro,
/// since compilers do not unroll loops of that length, and indices must be constants.
macro_rules! exchange {
    ($rows:ident: $($one:literal $other:literal),*) => {$(
        let (a, b) = ($rows[$one], $rows[$other]);
        ($rows[$one], $rows[$other]) = (a.least(b), a.greatest(b));
    )*};
}

/// Sorts eight rows: [`NETWORK`].
#[cfg_attr(not(unoptimised), inline(always))]
fn sort_rows<V: F32x16>(rows: &mut [V; OCTET]) {
    exchange!(rows: 0 2, 1 3, 4 6, 5 7, 0 4, 1 5, 2 6, 3 7, 0 1, 2 3, 4 5, 6 7, 2 4, 3 5, 1 4, 3 6,
        1 2, 3 4, 5 6);
}

/// Sorts eight rows that first rise and then fall, or the other way round.
#[cfg_attr(not(unoptimised), inline(always))]
fn sort_bitonic<V: F32x16>(rows: &mut [V; OCTET]) {
    exchange!(rows: 0 4, 1 5, 2 6, 3 7, 0 2, 1 3, 4 6, 5 7, 0 1, 2 3, 4 5, 6 7);
}

/// Sorts the columns of both halves, as one of 16: the upper half after the lower one.
#[cfg_attr(not(unoptimised), inline(always))]
fn sort_octet<V: F32x16>(octet: &mut [Row16; OCTET]) {
    let mut rows: [V; OCTET] = core::array::from_fn(|i| V::load(&octet[i]));
    sort_rows(&mut rows);
    rows = core::array::from_fn(|i| {
        let (one, other) = (rows[i], rows[OCTET - 1 - i].swapped());
        one.least(other).halves(one.greatest(other))
    });
    sort_bitonic(&mut rows);
    for i in 0..OCTET {
        rows[i].store(&mut octet[i]);
    }
}

/// Turns two sorted octets into one of the lesser and one of the greater numbers, both sorted.
#[cfg_attr(not(unoptimised), inline(always))]
fn merge<V: F32x16>(low: &mut [Row16; OCTET], high: &mut [Row16; OCTET]) {
    let one: [V; OCTET] = core::array::from_fn(|i| V::load(&low[i]));
    let other: [V; OCTET] = core::array::from_fn(|i| V::load(&high[OCTET - 1 - i]).swapped());
    let least = core::array::from_fn(|i| one[i].least(other[i]));
    let greatest = core::array::from_fn(|i| one[i].greatest(other[i]));
    for (mut rows, octet) in [(least, low), (greatest, high)] {
        rows = core::array::from_fn(|i| {
            let other = rows[i].swapped();
            rows[i].least(other).halves(rows[i].greatest(other))
        });
        sort_bitonic(&mut rows);
        for i in 0..OCTET {
            rows[i].store(&mut octet[i]);
        }
    }
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
mod tests;
