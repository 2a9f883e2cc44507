//! Bounds of the costs in bins, from the numbers of faces in them.

use super::{Bins, CLOSED, Open};
use crate::build::sweep::cost::{Cell, LOWER, SplitCosts};
use crate::build::sweep::grid::{Grid, MOST};
use crate::simd::every_set::for_every_set;

/// Relative error of bounds of costs: numbers of blocks by at most 2^-16, all else by less
/// than 2^-20.
const MARGIN: f32 = 1.0 / 8192.0; // 2^-13
/// Numbers of references below this have their blocks counted without error in `f32`.
const EXACT: u32 = 1 << 22;

for_every_set! {
    /// Bounds the costs in every bin, and opens those that may hold the least split. Returns how many
    /// events they may have.
    pub(super) fn bound<S>(
        bins: &mut Bins,
        costs: &SplitCosts,
        cell: &Cell,
        grid: &Grid,
        count: u32,
        limit: f64,
    ) -> usize {
        let mut most = ((limit / cell.area) as f32) * (1.0 + MARGIN);
        let inverse = 1.0 / costs.width as f32;
        let blocks = |n: u32| (((n + costs.width - 1) as i32 as f32 + 0.5) * inverse).floor();
        let expected = |blocks: f32| {
            let root = (0.25 * blocks).sqrt();
            let power = 4.0 * (root * root.sqrt());
            if power < blocks && !costs.leaves { power } else { blocks }
        };
        let (step, weight) = (costs.traversal as f32, costs.intersection as f32);
        let empty = costs.empty as f32;
        // Where numbers cannot be counted exactly, the fact that every reference is on some side is
        // not used.
        let all = if count < EXACT { blocks(count) } else { 0.0 };
        // Expected costs of the references that start before a border, and of those that do not end
        // before it.
        let [mut near, mut far] = [[0.0f32; MOST + 1]; 2];
        for axis in 0..3 {
            let started = &mut bins.started[axis][..grid.bins + 1];
            let unfinished = &mut bins.unfinished[axis][..grid.bins + 1];
            let starts = &bins.faces[axis][..grid.bins];
            let ends = &bins.faces[axis + 4][..grid.bins];
            let (mut left, mut right) = (0, count);
            for bin in 0..grid.bins {
                (started[bin], unfinished[bin]) = (left, right);
                left += starts[bin];
                right -= ends[bin];
            }
            (started[grid.bins], unfinished[grid.bins]) = (left, right);
            let near = &mut near[..grid.bins + 1];
            let far = &mut far[..grid.bins + 1];
            for bin in 0..grid.bins + 1 {
                near[bin] = expected(blocks(started[bin]));
                far[bin] = expected(blocks(unfinished[bin]));
            }
            let areas = &cell.axes[axis];
            let growth = ((areas.hi - areas.lo) * areas.slope / cell.area) as f32;
            let base = (areas.base / cell.area) as f32;
            let borders = grid.borders(axis);
            let least = &mut bins.least[axis][..grid.bins];
            // Without branches, so that compilers use vector instructions.
            for bin in 0..grid.bins {
                let faces = starts[bin] + ends[bin];
                let [low, high] = borders.of(bin);
                // At least these are left and right of any plane in the bin, and every reference is
                // on some side.
                let (left, right) = (started[bin], unfinished[bin + 1]);
                let few = [blocks(left), blocks(right)];
                let rest = [all - few[1], all - few[0]];
                let many = [
                    expected(if rest[0] > few[0] { rest[0] } else { few[0] }),
                    expected(if rest[1] > few[1] { rest[1] } else { few[1] }),
                ];
                let small = [low * growth + base, (1.0 - high) * growth + base];
                // The expected cost is concave: it is least where all references that may be on
                // either side are on one.
                let all_left = many[0] * small[0] + far[bin + 1] * small[1];
                let all_right = near[bin] * small[0] + many[1] * small[1];
                let cost = if all_left < all_right { all_left } else { all_right };
                let cost = (step + weight * cost) * (1.0 - MARGIN);
                let cost = if left == 0 || right == 0 { cost * empty } else { cost };
                least[bin] = if faces > 0 { cost } else { f32::INFINITY };
                // The outermost bins may hold nothing but the sides of the cell.
                let inner = faces > 0 && bin > 0 && bin + 1 < grid.bins;
                let large = [high * growth + base, (1.0 - low) * growth + base];
                let cost = near[bin + 1] * large[0] + far[bin] * large[1];
                let cost = (step + weight * cost) * (1.0 + MARGIN);
                let cost = if inner { cost } else { f32::INFINITY };
                most = if cost < most { cost } else { most };
            }
        }
        bins.open.clear();
        let mut events = 0;
        for axis in 0..3 {
            for bin in 0..grid.bins {
                let least = bins.least[axis][bin];
                let number = &mut bins.numbers[axis][bin];
                *number = CLOSED;
                if least <= most && least < f32::INFINITY {
                    *number = bins.open.len() as u32;
                    let least = f64::from(least) * cell.area * LOWER;
                    let (axis, bin_here) = (axis as u32, bin as u32);
                    let first = events;
                    bins.open.push(Open { least, axis, bin: bin_here, first, end: first });
                    events += bins.faces[axis as usize][bin] + bins.faces[axis as usize + 4][bin];
                }
            }
        }
        events as usize
    }
}
