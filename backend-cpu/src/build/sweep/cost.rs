//! The costs of splits and leaves, and which of two splits is better. Every search for a plane uses
//! this, so all find the same one.

use core::array;

use splitplane_core::aabb::Aabb;
use splitplane_core::config::{BuildConfig, Sweep};

/// A bound is lowered by this much of itself, far more than its roundings: 2^-40.
pub(super) const LOWER: f64 = 1.0 - 1.0 / 1_099_511_627_776.0;

/// Length of the table of expected costs, by number of references.
const KNOWN: usize = 2049;
/// Length of the table of the cost of one more block, by number of blocks.
pub(super) const STEPS: usize = 128;

/// The part of the configuration that decides.
#[derive(Clone, Debug)]
pub(super) struct SplitCosts {
    /// K_T.
    pub traversal: f64,
    /// K_I.
    pub intersection: f64,
    /// W.
    pub width: u32,
    /// The factor on the cost of a split with an empty side.
    pub empty: f64,
    /// Most levels below the root.
    pub max_depth: u32,
    /// Splits in a row that do not pay.
    pub bad_splits: u32,
    /// 1 / W.
    inverse: f64,
    /// Whether children are also taken for leaves when planes are compared.
    pub leaves: bool,
    /// [`SplitCosts::expected`] of the blocks of a number of references.
    known: [f64; KNOWN],
    /// By number of blocks: what one more is expected to cost, times K_I; rounded.
    pub steps: [f32; STEPS],
}

impl SplitCosts {
    /// The costs of a configuration, and the same with children taken for leaves throughout.
    pub(super) fn both(config: &BuildConfig, sweep: &Sweep) -> [SplitCosts; 2] {
        [SplitCosts::of(config, sweep, false), SplitCosts::of(config, sweep, true)]
    }

    fn of(config: &BuildConfig, sweep: &Sweep, leaves: bool) -> SplitCosts {
        let width = config.block_width;
        let mut costs = SplitCosts {
            traversal: f64::from(config.traversal_cost),
            intersection: f64::from(config.intersection_cost),
            width,
            empty: 1.0 - f64::from(sweep.empty_bonus) / 256.0,
            max_depth: config.max_depth,
            bad_splits: sweep.bad_splits,
            inverse: 1.0 / f64::from(width),
            leaves,
            known: [0.0; KNOWN],
            steps: [0.0; STEPS],
        };
        costs.known = array::from_fn(|n| costs.expected(costs.blocks(n as u32)));
        costs.steps = array::from_fn(|blocks| {
            let [some, more] = [blocks, blocks + 1].map(|n| costs.expected(n as f64));
            (costs.intersection * (more - some)) as f32
        });
        costs
    }

    /// Blocks of `n` references: `ceil(n / W)`. At most 2^30 references.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn blocks(&self, n: u32) -> f64 {
        // Half a step above the quotient, which is thus at least 2^-7 from the next integer on either
        // side: two roundings of at most 2^-22 cannot carry it over.
        ((f64::from((n + self.width - 1) as i32) + 0.5) * self.inverse).floor()
    }

    /// The cost of a leaf, times the half area of the root.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn leaf(&self, area: f64, n: u32) -> f64 {
        self.intersection * (self.blocks(n) * area)
    }

    /// What a child of `blocks` blocks is expected to cost, in blocks: itself up to four, beyond
    /// them `4 (b / 4)^(3/4)` (see [`splitplane_core::sah::expected_quarters`], the same in whole
    /// numbers). Non-decreasing, and concave except for rounding: square roots round once.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn expected(&self, blocks: f64) -> f64 {
        if self.leaves {
            return blocks;
        }
        let root = (0.25 * blocks).sqrt();
        let power = 4.0 * (root * root.sqrt());
        // Below four blocks the power is the greater of the two.
        if power < blocks { power } else { blocks }
    }

    /// The cost of a split into leaves of these half areas and numbers of references, times the
    /// half area of the root; `step` is K_T times the half area of the node: Equation 6. It never
    /// decreases when any of the four grows, because every operation rounds once and none has a
    /// negative operand.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn split(&self, step: f64, areas: [f64; 2], counts: [u32; 2]) -> f64 {
        let blocks = [self.blocks(counts[0]), self.blocks(counts[1])];
        self.forgive(self.blocks_cost(step, areas, blocks), counts)
    }

    /// The same with children that cost what [`SplitCosts::expected`] says; planes are compared by
    /// this. Up to four blocks in all it is [`SplitCosts::split`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn expected_split(&self, step: f64, areas: [f64; 2], counts: [u32; 2]) -> f64 {
        let blocks = counts.map(|n| self.expected_of(n));
        self.forgive(self.blocks_cost(step, areas, blocks), counts)
    }

    /// [`SplitCosts::expected`] of the blocks of `n` references.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn expected_of(&self, n: u32) -> f64 {
        match self.known.get(n as usize) {
            Some(&known) => known,
            None => self.expected(self.blocks(n)),
        }
    }

    /// The cost of a split, less the bonus for an empty side.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn forgive(&self, cost: f64, counts: [u32; 2]) -> f64 {
        if counts[0] == 0 || counts[1] == 0 { cost * self.empty } else { cost }
    }

    /// Whether [`SplitCosts::expected_split`] is [`SplitCosts::split`] for every split of `count` references.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn few(&self, count: u32) -> bool {
        self.leaves || count <= 4 * self.width
    }

    /// The cost of a split from the costs of its children, in blocks.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn blocks_cost(&self, step: f64, areas: [f64; 2], blocks: [f64; 2]) -> f64 {
        step + self.intersection * (blocks[0] * areas[0] + blocks[1] * areas[1])
    }
}

/// Half the surface area of a box with these extents; the length of one that is flat in two
/// directions, so that the parts of such a box can still be compared.
#[inline]
pub(super) fn half_area([x, y, z]: [f64; 3]) -> f64 {
    let area = x * (y + z) + y * z;
    if area > 0.0 { area } else { x + y + z }
}

/// Half areas of the parts into which planes across one axis cut a cell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AxisAreas {
    /// Sides of the cell.
    pub lo: f64,
    pub hi: f64,
    /// Growth of the half area by length.
    pub slope: f64,
    /// Half area of the cross-section.
    pub base: f64,
}

impl AxisAreas {
    /// Half areas left and right of a plane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn at(&self, plane: f64) -> [f64; 2] {
        [self.below(plane), self.above(plane)]
    }

    /// Half area left of a plane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn below(&self, plane: f64) -> f64 {
        (plane - self.lo) * self.slope + self.base
    }

    /// Half area right of a plane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn above(&self, plane: f64) -> f64 {
        (self.hi - plane) * self.slope + self.base
    }
}

/// A node's cell and the values on which costs in it depend.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    /// The cell.
    pub bounds: Aabb,
    /// Its half area.
    pub area: f64,
    /// K_T times its half area.
    pub step: f64,
    /// By axis.
    pub axes: [AxisAreas; 3],
}

impl Cell {
    /// A cell; extents cannot overflow in `f64`.
    pub(super) fn new(costs: &SplitCosts, bounds: &Aabb) -> Cell {
        let (lo, hi) = (bounds.lo.map(f64::from), bounds.hi.map(f64::from));
        let extents = [0, 1, 2].map(|axis| hi[axis] - lo[axis]);
        let area = half_area(extents);
        let axes = [0, 1, 2].map(|axis| {
            let (one, other) = (extents[(axis + 1) % 3], extents[(axis + 2) % 3]);
            let flat = one + other <= 0.0;
            AxisAreas {
                lo: lo[axis],
                hi: hi[axis],
                slope: if flat { 1.0 } else { one + other },
                base: one * other,
            }
        });
        Cell { bounds: *bounds, area, step: costs.traversal * area, axes }
    }

    /// Whether a plane lies strictly inside.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn contains(&self, axis: usize, position: f32) -> bool {
        self.bounds.lo[axis] < position && position < self.bounds.hi[axis]
    }
}

/// A plane, and how it divides a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Split {
    /// [`SplitCosts::expected_split`].
    pub cost: f64,
    /// Axis the plane is perpendicular to, 0 to 2.
    pub axis: usize,
    /// Its position.
    pub position: f32,
    /// Whether references planar in the plane go right.
    pub planar_right: bool,
    /// References left and right, straddling ones on both sides.
    pub counts: [u32; 2],
}

/// The best split so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct BestSplit {
    /// Its cost, or the limit that a split must cost less than.
    pub cost: f64,
    /// The split.
    pub split: Option<Split>,
}

impl BestSplit {
    /// None so far; only splits that cost less than `limit` are accepted.
    pub(super) fn below(limit: f64) -> BestSplit {
        BestSplit { cost: limit, split: None }
    }

    /// Takes the better one of this and a plane, given the numbers of references that start before it, are planar
    /// in it, and end behind it: the least (cost, axis, position), planar references left on a tie.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn consider(
        &mut self,
        costs: &SplitCosts,
        cell: &Cell,
        axis: usize,
        position: f32,
        [left, planar, right]: [u32; 3],
    ) {
        let areas = cell.axes[axis].at(f64::from(position));
        let mut counts = [left + planar, right];
        let mut cost = costs.expected_split(cell.step, areas, counts);
        let mut planar_right = false;
        if planar > 0 {
            let other = [left, right + planar];
            let other_cost = costs.expected_split(cell.step, areas, other);
            if other_cost < cost {
                (cost, counts, planar_right) = (other_cost, other, true);
            }
        }
        if cost <= self.cost {
            self.offer(Split { cost, axis, position, planar_right, counts });
        }
    }

    /// Takes a split if it is better.
    #[inline]
    pub(super) fn offer(&mut self, split: Split) {
        let better = match &self.split {
            None => split.cost < self.cost,
            Some(best) => {
                split.cost < best.cost
                    || (split.cost == best.cost
                        && (split.axis, split.position) < (best.axis, best.position))
            }
        };
        if better {
            *self = BestSplit { cost: split.cost, split: Some(split) };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Sweep = Sweep { empty_bonus: 0, bad_splits: 0 };

    #[test]
    fn blocks_are_rounded_up_quotients() {
        for block_width in 1..=64 {
            let config = BuildConfig { block_width, ..BuildConfig::default() };
            let costs = SplitCosts::of(&config, &PLAIN, false);
            let check =
                |n: u32| assert_eq!(costs.blocks(n), f64::from(n.div_ceil(block_width)), "{n}");
            (0..1000).for_each(check);
            for n in (1 << 30) / block_width - 50..=(1 << 30) / block_width {
                for near in 0..3 {
                    check((n * block_width).saturating_sub(near));
                }
            }
            (0..64).for_each(|k| check((1 << 30) - k));
        }
    }

    #[test]
    fn expected_costs_never_fall_and_are_those_in_whole_numbers() {
        let costs = SplitCosts::of(&BuildConfig::default(), &PLAIN, false);
        assert_eq!(SplitCosts::of(&BuildConfig::default(), &PLAIN, true).expected(77.0), 77.0);
        let mut last = 0.0;
        for blocks in 0..100_000u32 {
            let found = costs.expected(f64::from(blocks));
            assert_eq!(costs.expected_of(blocks * costs.width), found);
            assert!(found >= last && found <= f64::from(blocks), "{blocks}");
            if blocks <= 4 {
                assert_eq!(found, f64::from(blocks));
            }
            let whole = f64::from(splitplane_core::sah::expected_quarters(blocks)) / 4.0;
            assert!((found - whole).abs() <= 0.25 + 0.025 * found, "{blocks} {found} {whole}");
            last = found;
        }
    }

    #[test]
    fn boxes_without_area_compare_by_length() {
        assert_eq!(half_area([2.0, 3.0, 4.0]), 26.0);
        assert_eq!(half_area([2.0, 3.0, 0.0]), 6.0);
        assert_eq!(half_area([0.0, 3.0, 0.0]), 3.0);
        let costs = SplitCosts::of(&BuildConfig::default(), &PLAIN, false);
        let cell = Cell::new(&costs, &Aabb { lo: [0.0, 1.0, 0.0], hi: [0.0, 4.0, 0.0] });
        assert_eq!(cell.axes[1].at(2.0), [1.0, 2.0]);
    }
}
