//! Binned SAH: the planes between equal bins of a node's tight bounds, and their costs.
//!
//! After Shevtsov, Soupikov and Kapustin 2007: a reference is counted once in the bin where it
//! starts and once in the bin where it ends ("min-max binning"); the numbers on both sides of every
//! border are then prefix sums. Which bin a coordinate falls in is defined by the guarded
//! operations of [`BinAxis::place`], so that every device counts alike; beside a border, rounding
//! may count a reference on the wrong side of it. Counts only choose the plane.
//! [`build::split::goes_left`](crate::build::split::goes_left) and [`build::split::goes_right`](crate::build::split::goes_right) decide which references go where.

use crate::aabb::Aabb;
use crate::arithmetic::{Arithmetic, exponent, truncated};
use crate::build::split::{SplitPlane, strictly_inside};
use crate::config::{BuildConfig, MAX_BINS};
use crate::layout::ChunkBins;
use crate::sah::{Extents, LEAST_EXPONENT, expected_quarters};

/// The bins of one axis of a node: equal parts of its tight bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BinAxis {
    /// A quarter of the lower end.
    pub lower: f32,
    /// A quarter of the extent: half of the greatest possible extent would be too much for two
    /// bins, whose scale would be subnormal.
    pub quarter: f32,
    /// How many bins.
    pub bins: u32,
    /// Bins in a quarter of a unit of length: a place is a quarter of the distance from the lower end
    /// times this. Never subnormal.
    pub scale: f32,
}

impl BinAxis {
    /// The bins of an axis; `None` when the bounds are flat on it or too small to be divided on
    /// every device alike.
    #[inline]
    pub fn of<A: Arithmetic>(tight: &Aabb, axis: usize, bins: u32) -> Option<BinAxis> {
        let half = tight.half_extent_in::<A>(axis);
        if exponent(half) < LEAST_EXPONENT {
            return None;
        }
        let lower = A::snapped_product(tight.lo[axis], 0.25);
        let quarter = A::product(half, 0.5);
        Some(BinAxis { lower, quarter, bins, scale: A::quotient(bins as f32, quarter) })
    }

    /// Where a coordinate within the bounds lies, in bins from the lower end.
    #[inline(always)]
    pub fn place<A: Arithmetic>(&self, coordinate: f32) -> f32 {
        let distance = A::snapped_difference(A::snapped_product(coordinate, 0.25), self.lower);
        A::snapped_product(distance, self.scale)
    }

    /// The bins in which a reference from `lo` to `hi` starts and ends. One that ends exactly at a
    /// border ends in the bin below it, and a planar one there starts in it, too: both go left.
    #[inline(always)]
    pub fn range<A: Arithmetic>(&self, lo: f32, hi: f32) -> [u32; 2] {
        let (start, end) = (self.place::<A>(lo), self.place::<A>(hi));
        // Places are from 0 to the number of bins.
        let whole = truncated(end);
        let at_border = u32::from((whole as f32 == end) & (whole > 0));
        let last = (whole - at_border).min(self.bins - 1);
        [truncated(start).min(last), last]
    }

    /// The border below bin `index`, 1 to `bins - 1`: the plane at that part of the extent.
    #[inline]
    pub fn border<A: Arithmetic>(&self, index: u32) -> f32 {
        let part = A::quotient(index as f32, self.bins as f32);
        let quarter = A::snapped_sum(self.lower, A::snapped_product(self.quarter, part));
        // Exact, and within the bounds.
        A::product(quarter, 4.0)
    }
}

/// The cost of a split of a node of any size, times the node's half area: [`sah::split_cost`](crate::sah::split_cost)
/// in 64 bits. Below 2^63.
#[inline]
pub fn wide_split_cost(config: &BuildConfig, areas: [u32; 3], left: u32, right: u32) -> u64 {
    let blocks = [left, right].map(|count| count.div_ceil(config.block_width));
    weigh(config, areas, config.traversal_cost, blocks)
}

/// The same with children that cost what [`expected_quarters`] says, in quarters of K_I; borders
/// are compared by this. Below 2^62.
#[inline]
pub fn expected_split_cost(config: &BuildConfig, areas: [u32; 3], left: u32, right: u32) -> u64 {
    let quarters = [left, right].map(|count| expected_quarters(count.div_ceil(config.block_width)));
    weigh(config, areas, 4 * config.traversal_cost, quarters)
}

/// A step through the node, and both children's costs in units of K_I, by half area.
#[inline]
fn weigh(config: &BuildConfig, areas: [u32; 3], traversal: u32, children: [u32; 2]) -> u64 {
    let [node, left_area, right_area] = areas.map(u64::from);
    let [left, right] = children.map(u64::from);
    u64::from(traversal) * node
        + u64::from(config.intersection_cost) * (left * left_area + right * right_area)
}

/// The cost of a leaf of any size, times the node's half area. At most 2^30 references; below 2^62.
#[inline]
pub fn wide_leaf_cost(config: &BuildConfig, area: u32, triangles: u32) -> u64 {
    let blocks = u64::from(triangles.div_ceil(config.block_width));
    u64::from(config.intersection_cost) * blocks * u64::from(area)
}

/// How many references start and end in each bin of a node, by axis.
#[derive(Clone, Debug)]
pub struct NodeBins {
    /// Starts.
    pub starts: [[u32; MAX_BINS as usize]; 3],
    /// Ends.
    pub ends: [[u32; MAX_BINS as usize]; 3],
}

impl NodeBins {
    /// Nothing counted.
    pub const EMPTY: NodeBins =
        NodeBins { starts: [[0; MAX_BINS as usize]; 3], ends: [[0; MAX_BINS as usize]; 3] };

    /// Sums the bins of a node's chunks.
    pub fn sum(chunks: &[ChunkBins], bins: u32) -> NodeBins {
        let mut sum = NodeBins::EMPTY;
        for chunk in chunks {
            for axis in 0..3 {
                for bin in 0..bins as usize {
                    let word = chunk.words[axis][bin];
                    sum.starts[axis][bin] += word & 0xffff;
                    sum.ends[axis][bin] += word >> 16;
                }
            }
        }
        sum
    }

    /// The border of least expected cost among those that pay: where a split with children taken for
    /// leaves costs less than a leaf of all `count` references. Ties go to the lower axis, then to the
    /// lower border.
    #[inline(always)]
    pub fn best_border<A: Arithmetic>(
        &self,
        config: &BuildConfig,
        cell: &Aabb,
        tight: &Aabb,
        count: u32,
    ) -> Option<SplitPlane> {
        const BORDERS: usize = MAX_BINS as usize;
        let extents = Extents::of::<A>(cell)?;
        let leaf = wide_leaf_cost(config, Extents::half_area(extents.cells), count);
        let mut least = u64::MAX;
        let mut best = None;
        for axis in 0..3 {
            let Some(bins) = BinAxis::of::<A>(tight, axis, config.bins()) else { continue };
            // One step at a time for all borders: most of it in loops without branches, which
            // compilers turn into vector instructions. Border 0 is none.
            let borders = config.bins() as usize;
            let (mut left, mut right) = ([0; BORDERS], [0; BORDERS]);
            let (mut lefts, mut rights) = (0, count);
            for border in 1..borders {
                lefts += self.starts[axis][border - 1];
                rights -= self.ends[axis][border - 1];
                (left[border], right[border]) = (lefts, rights);
            }
            let mut position = [0.0; BORDERS];
            let mut areas = [[0; BORDERS]; 2];
            for border in 0..borders.min(BORDERS) {
                position[border] = bins.border::<A>(border as u32);
                let offset = extents.offset::<A>(cell.lo[axis], position[border]);
                let [_, left, right] = extents.split_areas(axis, offset);
                (areas[0][border], areas[1][border]) = (left, right);
            }
            let whole = Extents::half_area(extents.cells);
            for border in 1..borders {
                if !strictly_inside(cell, axis, position[border]) {
                    continue;
                }
                let areas = [whole, areas[0][border], areas[1][border]];
                let blocks =
                    [left[border], right[border]].map(|count| count.div_ceil(config.block_width));
                let pays = weigh(config, areas, config.traversal_cost, blocks) < leaf;
                let quarters = blocks.map(expected_quarters);
                let expected = weigh(config, areas, 4 * config.traversal_cost, quarters);
                if pays && expected < least {
                    least = expected;
                    best = Some(SplitPlane { axis, position: position[border] });
                }
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::{Hostile, Strict};
    use crate::config::Preset;

    const UNIT: Aabb = Aabb { lo: [-1.0, 0.0, 5.0], hi: [3.0, 2.0, 5.0] };

    #[test]
    fn places_and_borders_of_a_simple_box() {
        let bins = BinAxis::of::<Strict>(&UNIT, 0, 8).unwrap();
        assert_eq!(BinAxis::of::<Hostile>(&UNIT, 0, 8), Some(bins));
        assert_eq!(BinAxis::of::<Strict>(&UNIT, 2, 8), None, "flat");
        for (x, place) in [(-1.0, 0.0), (-0.5, 1.0), (1.25, 4.5), (3.0, 8.0)] {
            assert_eq!(bins.place::<Strict>(x), place);
        }
        assert_eq!(bins.border::<Strict>(3), 0.5);
        // Ends at a border: not beyond it. Planar in a border: left of it.
        assert_eq!(bins.range::<Strict>(-0.75, 0.5), [0, 2]);
        assert_eq!(bins.range::<Strict>(0.5, 0.5), [2, 2]);
        assert_eq!(bins.range::<Strict>(0.5, 0.75), [3, 3]);
        assert_eq!(bins.range::<Strict>(-1.0, -1.0), [0, 0]);
        assert_eq!(bins.range::<Strict>(3.0, 3.0), [7, 7]);
    }

    #[test]
    fn bins_of_any_size() {
        for exponent in [-100, 0, 100, 126] {
            let unit = crate::arithmetic::power_of_two(exponent);
            let tight = Aabb { lo: [-unit; 3], hi: [unit; 3] };
            let bins = BinAxis::of::<Strict>(&tight, 1, 64).unwrap();
            assert_eq!(bins.range::<Strict>(-unit, unit), [0, 63]);
            assert_eq!(bins.border::<Strict>(32), 0.0);
            assert_eq!(bins.border::<Strict>(48), 0.5 * unit);
        }
        let whole = Aabb { lo: [-f32::MAX; 3], hi: [f32::MAX; 3] };
        for count in [2, 3, 7, 31, 64] {
            let bins = BinAxis::of::<Strict>(&whole, 0, count).unwrap();
            assert!(bins.scale.is_normal(), "{count}: a device may flush {bins:?}");
            assert_eq!(BinAxis::of::<Hostile>(&whole, 0, count), Some(bins));
            assert_eq!(bins.range::<Strict>(-f32::MAX, f32::MAX), [0, count - 1]);
            assert_eq!(bins.range::<Hostile>(-f32::MAX, f32::MAX), [0, count - 1]);
            for border in 1..count {
                let plane = bins.border::<Strict>(border);
                assert!(strictly_inside(&whole, 0, plane), "{border} of {count}: {plane}");
                assert_eq!(
                    plane,
                    BinAxis::of::<Hostile>(&whole, 0, count).unwrap().border::<Hostile>(border)
                );
            }
        }
    }

    /// Two clusters with a gap: the border in the gap wins, and with nothing to gain there is none.
    #[test]
    fn the_best_border_separates_clusters() {
        let config = BuildConfig { block_width: 1, ..Preset::Balanced.config() }.with_bins(16);
        let cell = Aabb { lo: [0.0; 3], hi: [16.0, 1.0, 1.0] };
        let mut chunk = ChunkBins { words: [[0; 64]; 3] };
        let axes = [0, 1, 2].map(|axis| BinAxis::of::<Strict>(&cell, axis, 16).unwrap());
        for i in 0..100 {
            let x = if i < 50 { i as f32 / 50.0 } else { 15.0 + (i - 50) as f32 / 50.0 };
            for (axis, [lo, hi]) in [[x, x + 0.02], [0.0, 1.0], [0.0, 1.0]].into_iter().enumerate()
            {
                let [start, end] = axes[axis].range::<Strict>(lo, hi);
                chunk.words[axis][start as usize] += 1;
                chunk.words[axis][end as usize] += 1 << 16;
            }
        }
        let bins = NodeBins::sum(&[chunk], 16);
        let plane = bins.best_border::<Strict>(&config, &cell, &cell, 100).unwrap();
        assert_eq!(plane.axis, 0);
        assert!((1.0..=15.0).contains(&plane.position), "{plane:?}");
        // All of them everywhere: no border pays.
        let mut chunk = ChunkBins { words: [[0; 64]; 3] };
        for axis in 0..3 {
            chunk.words[axis][0] = 100;
            chunk.words[axis][15] += 100 << 16;
        }
        let bins = NodeBins::sum(&[chunk], 16);
        assert_eq!(bins.best_border::<Strict>(&config, &cell, &cell, 100), None);
    }

    #[test]
    fn the_greatest_costs_fit() {
        let config = BuildConfig {
            block_width: 1,
            intersection_cost: (BuildConfig::MAX_COST - 1) / 2,
            ..BuildConfig::default()
        }
        .with_stages(|stages| stages.small_node_limit = 1);
        assert_eq!(config.validate(), Ok(()));
        let area = 3 * 1023 * 1023;
        assert!(wide_leaf_cost(&config, area, 1 << 30) < 1 << 62);
        assert!(wide_split_cost(&config, [area; 3], 1 << 30, 1 << 30) < 1 << 63);
        assert!(expected_split_cost(&config, [area; 3], 1 << 30, 1 << 30) < 1 << 62);
    }
}
