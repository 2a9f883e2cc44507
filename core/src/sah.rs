//! The surface area heuristic: the paper's equations, and the integer form that decides.
//!
//! Equations are numbered as in Martin's survey of Zhou et al. 2008: 1 is the surface of a box, 2
//! the cost of a node by its children, 3 the sum of that over a tree, 4 the sum for the tree of its
//! Figure 8 (`report::worked` of the program), 5 the cost of a tree with triangles in its leaves, 6
//! the greedy cost of a split. They are here in `f64` to explain and to report; no tree of the
//! schedule depends on them. Those trees are decided by [`Extents`], [`split_cost`] and
//! [`expected_quarters`], the same heuristic in whole numbers on extents quantised to 10 bits,
//! which gives the same answer on every device. Preset `best` is built on CPUs only and computes
//! its costs in `f64`.

use crate::aabb::Aabb;
use crate::arithmetic::{Arithmetic, exponent, power_of_two, truncated};
use crate::config::BuildConfig;

/// Equation 1: the surface area of a box with sides l, m and n, `2 ((l + m) n + l m)`.
pub fn equation_1(extents: [f64; 3]) -> f64 {
    2.0 * half_area(extents)
}

/// Half the surface area of a box with these extents: Equation 1 without its factor of two, which cancels wherever areas
/// are divided by one another.
pub fn half_area(extents: [f64; 3]) -> f64 {
    let [l, m, n] = extents;
    (l + m) * n + l * m
}

/// Half the surface area of a box; 0 for an empty one.
pub fn half_area_of(bounds: &Aabb) -> f64 {
    if bounds.is_empty() {
        return 0.0;
    }
    half_area([0, 1, 2].map(|axis| f64::from(bounds.hi[axis]) - f64::from(bounds.lo[axis])))
}

/// Equation 2: the average cost of a node with `children` children (k), `k SA_self / SA_root`. The areas may be half
/// areas. 0 for a leaf, k for the root.
pub fn equation_2(children: u32, own_area: f64, root_area: f64) -> f64 {
    f64::from(children) * area_ratio(own_area, root_area)
}

/// The probability that a line that meets a box also meets a convex box inside it: the ratio of their surface
/// areas, which may be half areas (MacDonald and Booth 1990).
pub fn area_ratio(inner_area: f64, outer_area: f64) -> f64 {
    inner_area / outer_area
}

/// Equation 6: the greedy cost of a split, `C_ts + C_L SA_L / SA_parent + C_R SA_R / SA_parent`. `areas` are those of the
/// node and of its children; the children's costs are taken to be their numbers of triangles, as if both were
/// leaves, in units of K_I.
pub fn equation_6(cost_ratio: f64, areas: [f64; 3], left: f64, right: f64) -> f64 {
    let [node, left_area, right_area] = areas;
    cost_ratio + left * area_ratio(left_area, node) + right * area_ratio(right_area, node)
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

/// The expected cost of a subtree over this many blocks, in quarters of a block: their number up to
/// four blocks, beyond them `4 (b / 4)^(3/4)` for b blocks.
///
/// The greedy heuristic (Equation 6) takes both children of a split for leaves. A child of many
/// triangles will be split again and then costs far less than a leaf of them. Taking it for a leaf
/// makes planes too expensive that leave many triangles in a small part. Between powers of two this
/// is linear, rounded down, so that it is exact in whole numbers on every device. At most 2^30
/// blocks.
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
    use crate::arithmetic::Strict;

    /// Close to the power that it approximates, non-decreasing, and concave except for rounding.
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

    #[test]
    fn equation_1_is_the_sum_of_six_faces() {
        assert_eq!(equation_1([2.0, 3.0, 5.0]), 62.0);
        assert_eq!(half_area([4.0, 2.0, 10.0]), 68.0);
        assert_eq!(half_area([6.0, 10.0, 10.0]), 220.0);
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
