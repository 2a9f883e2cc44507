//! Times of rounds: what is built twice, which rounds count as far off, and what a ray takes in each.

use crate::paper::median;

/// Times this much above the median of their rounds are measured again.
pub(super) const OUTLIER: f64 = 1.3;

/// Builds that take less are done twice in a row, and the second counts.
pub(super) const WARM_MS: f64 = 500.0;

/// The mean; 0 of none.
pub(super) fn mean(values: &[f64]) -> f64 {
    if values.is_empty() { 0.0 } else { values.iter().sum::<f64>() / values.len() as f64 }
}

/// Nanoseconds a ray in each round, the mean over the sets.
pub(super) fn ns_by_round(times: &[Vec<f64>; 4]) -> Vec<f64> {
    let rounds = times.iter().map(Vec::len).max().unwrap_or(0);
    let of = |round: usize| {
        let own: Vec<f64> = times.iter().filter_map(|set| set.get(round).copied()).collect();
        mean(&own)
    };
    (0..rounds).map(of).collect()
}

/// The first of at least three times that is this many times their median.
pub(super) fn far_above(times: &[f64], factor: f64) -> Option<usize> {
    let usual = median(times.to_vec());
    times.iter().position(|&time| times.len() >= 3 && time > factor * usual)
}
