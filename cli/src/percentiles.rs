//! Middles and tails of times.

use serde::Serialize;

/// The values that 50, 95 and 99 of 100 do not exceed (nearest rank).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Percentiles {
    pub(super) p50: f64,
    pub(super) p95: f64,
    pub(super) p99: f64,
}

impl Percentiles {
    /// Of these values; zeros for none.
    pub(super) fn of(mut values: Vec<f64>) -> Percentiles {
        values.sort_by(f64::total_cmp);
        let rank = |percent: usize| {
            let rank = (values.len() * percent).div_ceil(100).max(1);
            values.get(rank - 1).copied().unwrap_or(0.0)
        };
        Percentiles { p50: rank(50), p95: rank(95), p99: rank(99) }
    }

    /// Of milliseconds: how many go into a second.
    pub(super) fn per_second(self) -> Percentiles {
        let rate = |ms: f64| if ms > 0.0 { 1e3 / ms } else { 0.0 };
        Percentiles { p50: rate(self.p50), p95: rate(self.p95), p99: rate(self.p99) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_ranks() {
        let p = Percentiles::of((1..=200).rev().map(f64::from).collect());
        assert_eq!(p, Percentiles { p50: 100.0, p95: 190.0, p99: 198.0 });
        assert_eq!(Percentiles::of(vec![7.0]), Percentiles { p50: 7.0, p95: 7.0, p99: 7.0 });
        assert_eq!(Percentiles::of(Vec::new()).per_second().p50, 0.0);
    }
}
