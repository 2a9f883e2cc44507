//! How well a time is known: an interval about its median, from the rounds alone.

use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// Where the median of a time lies: between order statistics of the rounds, whatever the times are distributed like.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interval {
    /// Its lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

/// Confidence that is aimed at; what so few rounds give may be less, see [`confidence`].
const WANTED: f64 = 0.9;
/// Times closer than this part are not distinguished, however quiet the rounds: memory lies
/// otherwise in the next run, and between runs medians of the same row were seen to move by 3 % in
/// most cases and 5 % in nearly all, beyond their intervals.
pub const LEAST_APART: f64 = 0.05;
/// Of one or two rounds nothing is known; they may be off by this factor.
const UNKNOWN: f64 = 1.5;

/// The probability that fewer than `k` of `n` times are below the median.
fn tail(n: usize, k: usize) -> f64 {
    let mut choose = 1.0;
    let mut sum = 0.0;
    for below in 0..k {
        sum += choose;
        choose *= (n - below) as f64 / (below + 1) as f64;
    }
    sum * 0.5f64.powi(n as i32)
}

/// How many of the least and of the greatest times lie outside.
fn outside(n: usize) -> usize {
    (1..n / 2).take_while(|&k| 1.0 - 2.0 * tail(n, k + 1) >= WANTED).last().unwrap_or(0)
}

/// The probability that the median lies in the interval of this many rounds: 0.9375 for five. 0 for
/// fewer than three.
pub fn confidence(rounds: usize) -> f64 {
    if rounds < 3 { 0.0 } else { 1.0 - 2.0 * tail(rounds, outside(rounds) + 1) }
}

impl Interval {
    /// The interval of the median of these times. One of no width at infinity without any.
    pub fn of(times: &[f64]) -> Interval {
        let mut sorted = times.to_vec();
        sorted.sort_by(f64::total_cmp);
        let out = outside(sorted.len());
        match (sorted.get(out), sorted.get(sorted.len().wrapping_sub(out + 1))) {
            (Some(&low), Some(&high)) if sorted.len() >= 3 => Interval { low, high },
            (Some(&low), Some(&high)) => Interval { low: low / UNKNOWN, high: high * UNKNOWN },
            _ => Interval { low: f64::INFINITY, high: f64::INFINITY },
        }
    }

    /// Of what has no noise.
    pub fn exactly(value: f64) -> Interval {
        Interval { low: value, high: value }
    }

    /// Both ends times a factor.
    #[must_use]
    pub fn times(self, factor: f64) -> Interval {
        Interval { low: self.low * factor, high: self.high * factor }
    }

    /// The sum, end by end: at least as wide as it need be.
    #[must_use]
    pub fn plus(self, other: Interval) -> Interval {
        Interval { low: self.low + other.low, high: self.high + other.high }
    }

    /// Which is less, beyond the noise of both; equal where they cannot be distinguished.
    pub fn compare(self, other: Interval) -> Ordering {
        if self.high * (1.0 + LEAST_APART) < other.low {
            Ordering::Less
        } else if other.high * (1.0 + LEAST_APART) < self.low {
            Ordering::Greater
        } else {
            Ordering::Equal
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane_core::random::unit;

    #[test]
    fn confidences_are_those_of_the_sign_test() {
        // 1 - 2 / 2^n while nothing is left out; 1 - 2 (1 + 8) / 2^8 with one out on each side.
        for (rounds, expected) in [
            (1, 0.0),
            (2, 0.0),
            (3, 0.75),
            (5, 0.9375),
            (7, 1.0 - 2.0 / 128.0),
            (8, 1.0 - 18.0 / 256.0),
        ] {
            assert!((confidence(rounds) - expected).abs() < 1e-12, "{rounds}");
        }
        for rounds in 5..200 {
            assert!(confidence(rounds) >= WANTED, "{rounds}");
        }
    }

    /// Of times drawn at random, of a skewed distribution, the interval holds the median as often as it says.
    #[test]
    fn medians_lie_in_their_intervals() {
        for rounds in [3usize, 5, 8, 21] {
            let cases = 20_000u64;
            let inside = (0..cases)
                .filter(|&case| {
                    let times: Vec<f64> = (0..rounds as u64)
                        .map(|i| 1.0 / (1.0 - unit(case, &[rounds as u64, i])))
                        .collect();
                    let interval = Interval::of(&times);
                    interval.low <= 2.0 && 2.0 <= interval.high
                })
                .count();
            let found = inside as f64 / cases as f64;
            assert!((found - confidence(rounds)).abs() < 0.01, "{rounds}: {found}");
        }
    }

    #[test]
    fn only_what_is_apart_compares() {
        let interval = |low, high| Interval { low, high };
        assert_eq!(interval(1.0, 2.0).compare(interval(1.9, 3.0)), Ordering::Equal);
        assert_eq!(interval(1.0, 2.0).compare(interval(2.09, 3.0)), Ordering::Equal);
        assert_eq!(interval(1.0, 2.0).compare(interval(2.11, 3.0)), Ordering::Less);
        assert_eq!(interval(2.11, 3.0).compare(interval(1.0, 2.0)), Ordering::Greater);
        let one = Interval::of(&[10.0]);
        assert_eq!(one.compare(Interval::of(&[20.0])), Ordering::Equal, "one round says nothing");
        assert_eq!(one.compare(Interval::of(&[30.0])), Ordering::Less);
    }
}
