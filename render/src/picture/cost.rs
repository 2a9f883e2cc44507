//! How what rays cost is distributed.

use super::FirstCost;
use rayon::slice::ParallelSliceMut;
use std::num::NonZeroU32;

/// The part of a ray's cost that a heat map shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Quantity {
    /// Nodes visited.
    Nodes,
    /// Triangles tested.
    Tests,
}

impl Quantity {
    /// `nodes` or `tests`.
    pub const fn name(self) -> &'static str {
        match self {
            Quantity::Nodes => "nodes",
            Quantity::Tests => "tests",
        }
    }

    /// Its value for one ray.
    pub const fn of(self, cost: &FirstCost) -> u32 {
        match self {
            Quantity::Nodes => cost.nodes,
            Quantity::Tests => cost.triangles,
        }
    }
}

/// How the cost of rays is distributed. Percentiles are by nearest rank: the least value that this part
/// of all values does not exceed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostStatistics {
    /// Arithmetic mean.
    pub mean: f64,
    /// Median.
    pub p50: u32,
    /// 95th percentile.
    pub p95: u32,
    /// 99.9th percentile.
    pub p999: u32,
    /// Greatest value.
    pub max: u32,
}

impl CostStatistics {
    /// The statistics of one quantity, over all rays, those that meet nothing included; `None` without
    /// rays.
    pub fn of(costs: &[FirstCost], quantity: Quantity) -> Option<CostStatistics> {
        let mut values: Vec<u32> = costs.iter().map(|cost| quantity.of(cost)).collect();
        values.par_sort_unstable();
        let max = *values.last()?;
        // Rank n q rounded up, in integers: floats would put 0.999 * 1000 at 1000.
        let percentile = |per_mille: usize| {
            let rank = (values.len() * per_mille).div_ceil(1000);
            values[rank - 1]
        };
        let sum: u64 = values.iter().map(|&value| u64::from(value)).sum();
        Some(CostStatistics {
            mean: sum as f64 / values.len() as f64,
            p50: percentile(500),
            p95: percentile(950),
            p999: percentile(999),
            max,
        })
    }

    /// The top of a scale that shows almost all of it: the 99.9th percentile, rounded up to 1, 1.2, 1.5,
    /// 2, 2.5, 3, 4, 5, 6 or 8 times a power of ten; at least 1. The few rays above would darken all
    /// others.
    pub fn scale_top(&self) -> NonZeroU32 {
        round_up(self.p999)
    }
}

fn round_up(value: u32) -> NonZeroU32 {
    const TENTHS: [u64; 10] = [10, 12, 15, 20, 25, 30, 40, 50, 60, 80];
    let tops = (0..=9).flat_map(|power| TENTHS.map(|tenths| tenths * 10_u64.pow(power)));
    // Only whole numbers: there is no 1.2 of a node.
    tops.filter(|top| top % 10 == 0)
        .map(|top| top / 10)
        .find(|&top| top >= u64::from(value))
        .and_then(|top| u32::try_from(top).ok())
        .and_then(NonZeroU32::new)
        .unwrap_or(NonZeroU32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn costs(values: impl IntoIterator<Item = u32>) -> Vec<FirstCost> {
        values.into_iter().map(|value| FirstCost { nodes: value, triangles: value / 2 }).collect()
    }

    #[test]
    fn statistics_of_one_to_a_thousand() {
        // In an order that is not sorted: 7 and 1000 have no common factor.
        let costs = costs((0..1000).map(|i| i * 7 % 1000 + 1));
        let found = CostStatistics::of(&costs, Quantity::Nodes).unwrap();
        let expected = CostStatistics { mean: 500.5, p50: 500, p95: 950, p999: 999, max: 1000 };
        assert_eq!(found, expected);
        assert_eq!(found.scale_top().get(), 1000);
        assert_eq!(CostStatistics::of(&costs, Quantity::Tests).unwrap().max, 500);
    }

    #[test]
    fn statistics_of_little() {
        assert_eq!(CostStatistics::of(&[], Quantity::Nodes), None);
        let one = CostStatistics::of(&costs([u32::MAX]), Quantity::Nodes).unwrap();
        assert_eq!((one.mean, one.p50, one.max), (f64::from(u32::MAX), u32::MAX, u32::MAX));
        assert_eq!(one.scale_top(), NonZeroU32::MAX);
        let zeros = CostStatistics::of(&costs([0; 9]), Quantity::Nodes).unwrap();
        assert_eq!((zeros.mean, zeros.p999, zeros.scale_top().get()), (0.0, 0, 1));
    }

    #[test]
    fn tops_are_pleasant() {
        let of = |value| round_up(value).get();
        assert_eq!([0, 1, 2, 3, 7, 9].map(of), [1, 1, 2, 3, 8, 10]);
        assert_eq!([11, 13, 21, 26, 31, 41].map(of), [12, 15, 25, 30, 40, 50]);
        assert_eq!([51, 61, 81, 101, 121].map(of), [60, 80, 100, 120, 150]);
        assert_eq!(of(4_000_000_000), 4_000_000_000);
        assert_eq!(of(4_000_000_001), u32::MAX);
    }
}
