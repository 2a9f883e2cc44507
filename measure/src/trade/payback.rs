//! After how many rays a slower build has paid for itself.

use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// What a tree costs: its build, and every ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Milliseconds.
    pub build_ms: f64,
    /// Nanoseconds.
    pub ns_per_ray: f64,
}

impl Line {
    /// Milliseconds for the build and this many rays.
    pub fn total_ms(&self, rays: f64) -> f64 {
        self.build_ms + rays * self.ns_per_ray * 1e-6
    }
}

/// How a setting compares with another, by the rays traced through each build.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Payback {
    /// It is the other.
    Base,
    /// It costs no more from the first ray on.
    Always,
    /// It costs more up to this many rays, and no more from there on.
    After {
        /// Rays, by the medians.
        rays: f64,
        /// The least and the most that the intervals of the times allow.
        within: [f64; 2],
    },
    /// It costs less up to this many rays, and more from there on.
    Until {
        /// Rays, by the medians.
        rays: f64,
        /// The least and the most that the intervals of the times allow.
        within: [f64; 2],
    },
    /// It costs more, however many rays.
    Never,
    /// Neither build nor rays are told apart from the other's.
    Alike,
    /// There is nothing to compare it with.
    Unknown,
}

impl Payback {
    /// Compares a setting with a base by their two lines: `b + n r` against `b' + n r'`, which meet
    /// at `n = (b - b') / (r' - r)`. `build` and `ray` say how the times compare beyond their
    /// noise; times that cannot be distinguished count as equal.
    pub fn of(own: Line, base: Line, build: Ordering, ray: Ordering) -> Payback {
        let rays = 1e6 * (own.build_ms - base.build_ms) / (base.ns_per_ray - own.ns_per_ray);
        match (build, ray) {
            (Ordering::Equal, Ordering::Equal) => Payback::Alike,
            (Ordering::Less | Ordering::Equal, Ordering::Less | Ordering::Equal) => Payback::Always,
            (Ordering::Greater, Ordering::Less) => Payback::After { rays, within: [rays; 2] },
            (Ordering::Less, Ordering::Greater) => Payback::Until { rays, within: [rays; 2] },
            (_, _) => Payback::Never,
        }
    }

    /// The same number of rays with what the intervals of the times allow.
    #[must_use]
    pub fn within(self, within: [f64; 2]) -> Payback {
        match self {
            Payback::After { rays, .. } => Payback::After { rays, within },
            Payback::Until { rays, .. } => Payback::Until { rays, within },
            other => other,
        }
    }

    /// In words for a table.
    pub fn words(&self) -> String {
        match self {
            Payback::Base => "is preset fast".into(),
            Payback::Always => "at once".into(),
            Payback::After { rays, within: [low, high] } => {
                format!("after {} ({} to {})", count(*rays), count(*low), count(*high))
            }
            Payback::Until { rays, within: [low, high] } => {
                format!("up to {} ({} to {})", count(*rays), count(*low), count(*high))
            }
            Payback::Never => "never".into(),
            Payback::Alike => "not told apart".into(),
            Payback::Unknown => "nothing to compare with".into(),
        }
    }
}

/// A number of rays with three digits: `950`, `1.25 k`, `12.5 M`, `3 G`.
pub fn count(rays: f64) -> String {
    let mut scaled = rays;
    for unit in ["", " k", " M", " G", " T"] {
        if scaled < 999.5 {
            let decimals = match scaled {
                s if unit.is_empty() || s >= 99.95 => 0,
                s if s >= 9.995 => 1,
                _ => 2,
            };
            let mut text = format!("{scaled:.decimals$}");
            if text.contains('.') {
                text.truncate(text.trim_end_matches('0').trim_end_matches('.').len());
            }
            return text + unit;
        }
        scaled /= 1e3;
    }
    format!("{rays:.1e}")
}

/// From this many rays on, this line is the least of all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reign {
    /// The place of the line.
    pub line: usize,
    /// Rays; 0 for the first.
    pub from: f64,
}

/// Which line is the least for how many rays: the lower envelope, by rays. The first is the cheapest
/// build, the last the fastest to trace. Of equal lines the first one stands.
pub fn envelope(lines: &[Line]) -> Vec<Reign> {
    let finite = |line: &Line| line.build_ms.is_finite() && line.ns_per_ray.is_finite();
    let cheaper = |a: &Line, b: &Line| {
        a.build_ms.total_cmp(&b.build_ms).then(a.ns_per_ray.total_cmp(&b.ns_per_ray))
    };
    let usable = || (0..lines.len()).filter(|&i| finite(&lines[i]));
    let Some(mut now) = usable().min_by(|&a, &b| cheaper(&lines[a], &lines[b])) else {
        return Vec::new();
    };
    let mut reigns = vec![Reign { line: now, from: 0.0 }];
    loop {
        let own = lines[now];
        // The next is the one that crosses first; of those that cross there, the one that then falls
        // behind least.
        let crossing = |i: &usize| {
            1e6 * (lines[*i].build_ms - own.build_ms) / (own.ns_per_ray - lines[*i].ns_per_ray)
        };
        let next = usable().filter(|&i| lines[i].ns_per_ray < own.ns_per_ray).min_by(|a, b| {
            let (x, y) = (crossing(a), crossing(b));
            x.total_cmp(&y).then(lines[*a].ns_per_ray.total_cmp(&lines[*b].ns_per_ray))
        });
        let Some(next) = next else { return reigns };
        reigns.push(Reign { line: next, from: crossing(&next) });
        now = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane_core::random::unit;

    fn line(build_ms: f64, ns_per_ray: f64) -> Line {
        Line { build_ms, ns_per_ray }
    }

    #[test]
    fn closed_forms() {
        let base = line(100.0, 200.0);
        // 50 ms more, 100 ns a ray less: 500,000 rays.
        let of = |own: Line| {
            let build = own.build_ms.total_cmp(&base.build_ms);
            Payback::of(own, base, build, own.ns_per_ray.total_cmp(&base.ns_per_ray))
        };
        assert_eq!(of(line(150.0, 100.0)), Payback::After { rays: 5e5, within: [5e5; 2] });
        assert_eq!(of(line(50.0, 300.0)), Payback::Until { rays: 5e5, within: [5e5; 2] });
        assert_eq!(of(line(50.0, 100.0)), Payback::Always);
        assert_eq!(of(base), Payback::Alike);
        assert_eq!(of(line(100.0, 199.0)), Payback::Always);
        assert_eq!(of(line(150.0, 200.0)), Payback::Never);
        assert_eq!(of(line(150.0, 300.0)), Payback::Never);
        assert_eq!(of(line(100.0, 300.0)), Payback::Never);
        // A build that is more expensive, but not beyond the noise, needs no paying back.
        let alike = Payback::of(line(101.0, 100.0), base, Ordering::Equal, Ordering::Less);
        assert_eq!(alike, Payback::Always);
    }

    #[test]
    fn counts_in_three_digits() {
        let texts = [
            (0.0, "0"),
            (949.6, "950"),
            (999.6, "1 k"),
            (1250.0, "1.25 k"),
            (12_500_000.0, "12.5 M"),
            (3e9, "3 G"),
            (999.9e9, "1 T"),
            (2e18, "2.0e18"),
        ];
        for (rays, text) in texts {
            assert_eq!(count(rays), text);
        }
    }

    #[test]
    fn an_envelope_by_hand() {
        let lines =
            [line(4.0, 1.0), line(1.0, 4.0), line(2.0, 2.0), line(9.0, 1.0), line(3.0, 3.0)];
        let reigns = envelope(&lines);
        let found: Vec<(usize, f64)> = reigns.iter().map(|r| (r.line, r.from)).collect();
        assert_eq!(found, [(1, 0.0), (2, 5e5), (0, 2e6)]);
        assert_eq!(envelope(&[]), []);
        assert_eq!(envelope(&[line(f64::NAN, 1.0)]), []);
    }

    /// Between its crossings, the line that reigns is the least of all; at a crossing two are equal.
    #[test]
    fn who_reigns_is_least() {
        for case in 0..500u64 {
            let count = 1 + case % 9;
            let draw = |i: u64, k: u64| (10.0 * unit(case, &[i, k])).floor() + 1.0;
            let lines: Vec<Line> = (0..count).map(|i| line(draw(i, 0), draw(i, 1))).collect();
            let reigns = envelope(&lines);
            assert_eq!(reigns[0].from, 0.0);
            for (place, reign) in reigns.iter().enumerate() {
                let end = reigns.get(place + 1).map_or(reign.from + 1e7, |next| next.from);
                assert!(end >= reign.from, "{lines:?} {reigns:?}");
                let least =
                    |n: f64| lines.iter().map(|l| l.total_ms(n)).fold(f64::INFINITY, f64::min);
                for part in [0.0, 0.3, 1.0] {
                    let n = reign.from + part * (end - reign.from);
                    let own = lines[reign.line].total_ms(n);
                    assert!(own <= least(n) * (1.0 + 1e-12), "{lines:?} {reigns:?} at {n}");
                }
            }
        }
    }
}
