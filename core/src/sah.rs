//! The surface area heuristic: the paper's equations, and the integer form that decides.
//!
//! Equations 1 to 6 are numbered as in Martin's survey of Zhou et al. 2008. They are here in `f64`
//! to explain and to report; no tree of the schedule depends on them. Those trees are decided by
//! [`Extents`], [`split_cost`] and [`expected_quarters`], the same heuristic in whole numbers on
//! extents quantised to 10 bits, which gives the same answer on every device. Preset `best` is built
//! on CPUs only and computes its costs in `f64`.

use crate::aabb::Aabb;
use crate::arithmetic::{Arithmetic, exponent, power_of_two, truncated};
use crate::config::BuildConfig;

/// Half the surface area of a box with these extents.
pub fn half_area(extents: [f64; 3]) -> f64 {
    let [x, y, z] = extents;
    x * (y + z) + y * z
}

/// Half the surface area of a box; 0 for an empty one.
pub fn half_area_of(bounds: &Aabb) -> f64 {
    if bounds.is_empty() {
        return 0.0;
    }
    half_area([0, 1, 2].map(|axis| f64::from(bounds.hi[axis]) - f64::from(bounds.lo[axis])))
}

/// Equation 1: the expected cost of a ray through a node that is split, from the probabilities that
/// it meets the children and what they then cost.
pub fn equation_1(
    traversal: f64,
    p_left: f64,
    cost_left: f64,
    p_right: f64,
    cost_right: f64,
) -> f64 {
    traversal + p_left * cost_left + p_right * cost_right
}

/// Equation 2: the probability that a ray that meets a box also meets a box inside it: the ratio of
/// their surface areas.
pub fn equation_2(inner_half_area: f64, outer_half_area: f64) -> f64 {
    inner_half_area / outer_half_area
}

/// Equation 3: the cost of a node split into leaves of `left` and `right` triangles.
pub fn equation_3(traversal: f64, intersection: f64, area: [f64; 3], left: f64, right: f64) -> f64 {
    let [node, left_area, right_area] = area;
    equation_1(
        traversal,
        equation_2(left_area, node),
        intersection * left,
        equation_2(right_area, node),
        intersection * right,
    )
}

/// Equation 4: Equation 3 with free traversal and unit tests, the form of the survey's worked
/// example.
pub fn equation_4(area: [f64; 3], left: f64, right: f64) -> f64 {
    equation_3(0.0, 1.0, area, left, right)
}

/// Equation 5, corrected: the cost of a finished tree. The survey divides by the parent's area and
/// leaves the triangle count out; summed over a tree the areas are relative to the *root*, and a
/// leaf costs K_I for each of its triangles (as Aila, Karras and Laine 2013 print it).
///
/// `interior_area` is the sum of interior half areas, `leaf_area` the sum of leaf half areas each
/// times its triangle count.
pub fn equation_5(
    traversal: f64,
    intersection: f64,
    root_area: f64,
    interior_area: f64,
    leaf_area: f64,
) -> f64 {
    if root_area <= 0.0 {
        return 0.0;
    }
    (traversal * interior_area + intersection * leaf_area) / root_area
}

/// Equation 6: the greedy cost that the small-node stage minimises, in units of K_I.
pub fn equation_6(cost_ratio: f64, area: [f64; 3], left: f64, right: f64) -> f64 {
    equation_3(cost_ratio, 1.0, area, left, right)
}

/// A cell's extents, scaled by a power of two so that the longest is in `512..=1023`, as integers.
///
/// Scaling by a power of two is exact, truncation is exact, and so is all that follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extents {
    /// Quantised extents.
    pub cells: [u32; 3],
    /// The scale: quantised is `half extent * scale`, truncated.
    pub scale: f32,
}

/// A node whose longest half extent has a smaller exponent becomes a leaf: its short extents would
/// be subnormal, which devices may flush.
pub const LEAST_EXPONENT: i32 = -117;

impl Extents {
    /// The extents of a cell; `None` when it is too small to be split on every device alike (its
    /// longest extent is below 2^-116).
    #[inline]
    pub fn of<A: Arithmetic>(cell: &Aabb) -> Option<Extents> {
        let half =
            [cell.half_extent_in::<A>(0), cell.half_extent_in::<A>(1), cell.half_extent_in::<A>(2)];
        let longest = crate::aabb::max(crate::aabb::max(half[0], half[1]), half[2]);
        if exponent(longest) < LEAST_EXPONENT {
            return None;
        }
        let scale = power_of_two(9 - exponent(longest));
        Some(Extents { cells: half.map(|h| A::product(h, scale) as u32), scale })
    }

    /// The quantised distance from the cell's lower side to a plane inside it.
    #[inline]
    pub fn offset<A: Arithmetic>(&self, lower: f32, plane: f32) -> u32 {
        let half =
            A::snapped_difference(A::snapped_product(plane, 0.5), A::snapped_product(lower, 0.5));
        // At most 1,023.
        truncated(A::product(half, self.scale))
    }

    /// Half area of a box with these quantised extents. An extent of zero counts as one, so that
    /// cells that are flat in two directions still compare by length. At most 3 * 1023^2.
    #[inline]
    pub fn half_area(cells: [u32; 3]) -> u32 {
        let [x, y, z] = cells.map(|c| c.max(1));
        x * (y + z) + y * z
    }

    /// Half areas of the whole cell and of its two parts when a plane cuts `axis` at this offset.
    #[inline]
    pub fn split_areas(&self, axis: usize, offset: u32) -> [u32; 3] {
        let (mut left, mut right) = (self.cells, self.cells);
        left[axis] = offset;
        right[axis] = self.cells[axis].saturating_sub(offset);
        [Extents::half_area(self.cells), Extents::half_area(left), Extents::half_area(right)]
    }
}

/// The integer cost of a split, times the node's half area: Equation 6 with K_T and K_I separate and
/// leaves costed by blocks of W triangles. Fits 32 bits for any valid configuration and counts of
/// at most 64.
#[inline]
pub fn split_cost(config: &BuildConfig, areas: [u32; 3], left: u32, right: u32) -> u32 {
    let [node, left_area, right_area] = areas;
    let blocks_left = left.div_ceil(config.block_width);
    let blocks_right = right.div_ceil(config.block_width);
    config.traversal_cost * node
        + config.intersection_cost * (blocks_left * left_area + blocks_right * right_area)
}

/// The integer cost of not splitting, times the node's half area.
#[inline]
pub fn leaf_cost(config: &BuildConfig, area: u32, triangles: u32) -> u32 {
    config.intersection_cost * triangles.div_ceil(config.block_width) * area
}

/// What a subtree over so many blocks is expected to cost, in quarters of a block: as many as there
/// are up to four blocks, beyond them `4 (b / 4)^(3/4)` for b blocks.
///
/// The greedy heuristic (Equation 6) takes both children of a split for leaves. A child of many
/// triangles will be split again and then costs far less than a leaf of them; taking it for a leaf
/// makes planes too dear that leave many triangles in a small part. Between powers of two this is
/// linear, rounded down, so that it is exact in whole numbers on every device. At most 2^30 blocks.
#[inline]
pub fn expected_quarters(blocks: u32) -> u32 {
    if blocks <= 4 {
        return 4 * blocks;
    }
    let power = 31 - blocks.leading_zeros();
    let (low, high) = (quarters_of_power(power), quarters_of_power(power + 1));
    let beyond = u64::from(blocks - (1 << power));
    low + ((u64::from(high - low) * beyond) >> power) as u32
}

/// `16 * 2^(3/4 (power - 2))`, rounded: four times the power 3/4 of `2^power / 4`, in quarters.
/// `power` is 2 to 31.
#[inline]
fn quarters_of_power(power: u32) -> u32 {
    let (eights, rest) = ((power - 2) / 4, (power - 2) % 4);
    let base = [128, 215, 362, 609][rest as usize];
    if eights == 0 { (base + 4) >> 3 } else { base << (3 * (eights - 1)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Near the power it stands for, never falling, and concave but for the rounding.
    #[test]
    fn expected_costs_follow_the_power() {
        let power = |blocks: u32| 16.0 * libm_sqrt(libm_sqrt((f64::from(blocks) / 4.0).powi(3)));
        let mut last = 0;
        for blocks in 0..200_000 {
            let found = expected_quarters(blocks);
            assert!(found >= last);
            last = found;
            let exact = if blocks <= 4 { 4.0 * f64::from(blocks) } else { power(blocks) };
            assert!(
                (f64::from(found) - exact).abs() <= 1.0 + 0.025 * exact,
                "{blocks} {found} {exact}"
            );
        }
        for shift in 10..=30 {
            let (blocks, exact) = (1 << shift, power(1 << shift));
            assert!((f64::from(expected_quarters(blocks)) / exact - 1.0).abs() < 3e-3);
            assert!(expected_quarters(blocks - 1) <= expected_quarters(blocks));
        }
        for (a, b) in [(1, 9), (4, 4), (5, 5), (100, 3), (1000, 1000), (1 << 20, 77)] {
            let together = expected_quarters(a + b);
            assert!(expected_quarters(a) + expected_quarters(b) + 2 >= together, "{a} {b}");
        }
    }

    /// Newton's square root: the core has none.
    fn libm_sqrt(x: f64) -> f64 {
        let mut root = x.max(1.0);
        for _ in 0..200 {
            root = 0.5 * (root + x / root);
        }
        root
    }
    use crate::arithmetic::Strict;

    /// Two rows of the survey's Table 1 are mistyped: the half area of a 4 x 2 x 10 part is
    /// (4 + 2) 10 + 4 * 2 = 68, not 88, and that of a 6 x 10 x 10 part is
    /// (6 + 10) 10 + 6 * 10 = 220, where it prints 4 * 10.
    #[test]
    fn half_areas_of_the_worked_example() {
        assert_eq!(half_area([4.0, 2.0, 10.0]), 68.0);
        assert_eq!(half_area([6.0, 10.0, 10.0]), 220.0);
    }

    /// The survey's Equation 4 comes to 4.67. Here as a cube of side 10 cut in the middle with 2 and
    /// 5 triangles: (2 * 200 + 5 * 200) / 300. A part with no triangle adds nothing, whatever its
    /// area, which is why the misprint of 88 for 68 does not show in the survey's sum.
    #[test]
    fn the_worked_example_costs_4_67() {
        let whole = half_area([10.0; 3]);
        let half = half_area([5.0, 10.0, 10.0]);
        let cost = equation_4([whole, half, half], 2.0, 5.0);
        assert!((cost - 14.0 / 3.0).abs() < 1e-12, "{cost}");
        for misprint in [68.0, 88.0] {
            let with_empty = cost + 0.0 * equation_2(misprint, whole);
            assert_eq!(format_2(with_empty), 467);
        }
    }

    /// Hundredths, rounded.
    fn format_2(x: f64) -> u32 {
        (x * 100.0 + 0.5) as u32
    }

    #[test]
    fn equation_5_is_root_normalised_and_counts_triangles() {
        // One split of a unit cube in the middle, 3 and 5 triangles: root area 3, halves 2 each.
        let cost = equation_5(1.5, 2.0, 3.0, 3.0, 3.0 * 2.0 + 5.0 * 2.0);
        assert!((cost - (1.5 + 2.0 * 16.0 / 3.0)).abs() < 1e-12);
        // Which is Equation 3 for the same split.
        assert!((cost - equation_3(1.5, 2.0, [3.0, 2.0, 2.0], 3.0, 5.0)).abs() < 1e-12);
    }

    #[test]
    fn integers_follow_the_real_cost() {
        let cell = Aabb { lo: [-1.0, 2.0, 0.5], hi: [3.0, 4.5, 1.75] };
        let extents = Extents::of::<Strict>(&cell).unwrap();
        assert_eq!(extents.cells, [512, 320, 160]);
        let config = BuildConfig {
            traversal_cost: 3,
            intersection_cost: 2,
            block_width: 1,
            ..Default::default()
        };
        let offset = extents.offset::<Strict>(cell.lo[0], 0.25);
        let areas = extents.split_areas(0, offset);
        let real = equation_6(
            1.5,
            [
                half_area([4.0, 2.5, 1.25]),
                half_area([1.25, 2.5, 1.25]),
                half_area([2.75, 2.5, 1.25]),
            ],
            7.0,
            11.0,
        );
        let integer = f64::from(split_cost(&config, areas, 7, 11)) / f64::from(areas[0]) / 2.0;
        assert!((integer / real - 1.0).abs() < 3e-3, "{integer} {real}");
    }

    #[test]
    fn extents_of_any_size_quantise_alike() {
        for shift in [-100, -50, 0, 60, 120] {
            let unit = power_of_two(shift);
            let cell = Aabb { lo: [0.0; 3], hi: [1.9 * unit, unit, 0.3 * unit] };
            assert_eq!(Extents::of::<Strict>(&cell).unwrap().cells, [972, 512, 153]);
        }
        let tiny = Aabb { lo: [0.0; 3], hi: [power_of_two(-117); 3] };
        assert_eq!(Extents::of::<Strict>(&tiny), None);
        let whole = Aabb { lo: [-f32::MAX; 3], hi: [f32::MAX; 3] };
        assert_eq!(Extents::of::<Strict>(&whole).unwrap().cells, [1023; 3]);
    }
}
