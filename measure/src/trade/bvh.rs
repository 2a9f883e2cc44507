//! When a bounding volume hierarchy would serve better: one is built, refitted and traced beside the rows, in the same rounds.
//!
//! Its builds, refits and rays are lines and intervals like those of every row. For the wish it is laid beside the row that is
//! recommended, and the lower envelope with the presets as they are says for how many rays a build it takes less than any of
//! them. A refit here moves nothing, so the hierarchy keeps its shape; how rays slow down as triangles move on is in Table 4 of
//! the verb `paper`.
//!
//! Vinkler, Havran and Bittner (2014, 2016) compared the two structures on GPUs: hierarchies win on simple and moderate scenes,
//! kd-trees on complex ones of high depth complexity.

use super::interval::Interval;
use super::payback::{Line, count, envelope};
use super::recommend::{Wish, will_do};
use super::row::{ALL_THREADS, Row, Sets, Trace};
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// What was measured of a hierarchy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// Whose it is.
    pub name: String,
    /// Threads that built and traced: all.
    pub threads: usize,
    /// Milliseconds from triangles in host memory to a hierarchy, the median of the rounds.
    pub build_ms: f64,
    /// Where the median lies.
    pub build_interval: Interval,
    /// Milliseconds to take over where the triangles are, the median of the rounds.
    pub refit_ms: f64,
    /// Where the median lies.
    pub refit_interval: Interval,
    /// Time to trace each set.
    pub trace: Sets<Trace>,
    /// Nanoseconds a ray, the mean over the sets that have rays.
    pub ns_per_ray: f64,
    /// Where the median of that mean lies.
    pub ns_interval: Interval,
    /// Rays of which it was asked whether they hit anything and the exact answer is known.
    pub judged: u64,
    /// Those of which it says otherwise: its test is not watertight.
    pub otherwise: u64,
}

/// Numbers of rays a build for which something is the least.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reach {
    /// From so many on.
    pub from: f64,
    /// Up to so many; none for any.
    pub to: Option<f64>,
}

/// Whether the hierarchy takes less for the wish than the row it is laid beside.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Serves {
    /// It takes less, beyond the noise.
    Better,
    /// They are not told apart.
    Alike,
    /// It takes more, beyond the noise.
    Worse,
}

/// What follows for a wish.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verdict {
    /// The hierarchy.
    pub hierarchy: Measured,
    /// Where it takes less than every preset when it is built anew, by the medians; none for nowhere.
    pub rebuilt: Option<Reach>,
    /// The same when it is refitted.
    pub refitted: Option<Reach>,
    /// Milliseconds for all frames of the wish: built once and then refitted where frames move, else built once.
    pub total_ms: f64,
    /// How that compares with the row it is laid beside.
    pub serves: Serves,
    /// All of it in words.
    pub words: String,
}

/// Lays a hierarchy beside the recommended row and the presets as they are, on the CPU, that will do for a wish; turned knobs
/// count where no preset will do. None without any row of the CPU.
pub fn judge(
    hierarchy: Measured,
    rows: &[Row],
    recommended: Option<usize>,
    wish: &Wish,
) -> Option<Verdict> {
    let own = |row: &&Row| row.threads.is_some() && row.field == ALL_THREADS;
    let usable = || rows.iter().filter(own).filter(|row| will_do(row, wish));
    let plain: Vec<&Row> = usable().filter(|row| row.knob.is_none()).collect();
    let usable: Vec<&Row> = if plain.is_empty() { usable().collect() } else { plain };
    let rays = wish.rays_per_build();
    // What is recommended may be on a device.
    let least = usable
        .iter()
        .find(|row| Some(row.number) == recommended)
        .or_else(|| usable.iter().min_by(|a, b| a.total_ms(rays).total_cmp(&b.total_ms(rays))))?;
    let lines: Vec<Line> = usable.iter().map(|row| row.line()).collect();
    let line = |build_ms: f64| Line { build_ms, ns_per_ray: hierarchy.ns_per_ray };
    let rebuilt = reach(&lines, line(hierarchy.build_ms));
    let refitted = reach(&lines, line(hierarchy.refit_ms));
    let builds = wish.builds() as f64;
    // The first frame's build, a refit for each of the others, and the rays of all.
    let total = |build: Interval, refit: Interval, ray: Interval| {
        build.plus(refit.times(builds - 1.0)).plus(ray.times(builds * rays * 1e-6))
    };
    let Measured { build_interval, refit_interval, ns_interval, .. } = hierarchy;
    let theirs = total(build_interval, refit_interval, ns_interval);
    let serves = match theirs.compare(least.total_interval(rays).times(builds)) {
        Ordering::Less => Serves::Better,
        Ordering::Equal => Serves::Alike,
        Ordering::Greater => Serves::Worse,
    };
    let [build, refit, ray] = [hierarchy.build_ms, hierarchy.refit_ms, hierarchy.ns_per_ray];
    let [build, refit, ray] = [build, refit, ray].map(Interval::exactly);
    let total_ms = total(build, refit, ray).low;
    let mut verdict =
        Verdict { hierarchy, rebuilt, refitted, total_ms, serves, words: String::new() };
    verdict.words = in_words(&verdict, least, wish);
    Some(verdict)
}

/// Where a line is the least beside others; of equal lines it is taken.
fn reach(lines: &[Line], own: Line) -> Option<Reach> {
    let reigns = envelope(&[&[own], lines].concat());
    let place = reigns.iter().position(|reign| reign.line == 0)?;
    Some(Reach { from: reigns[place].from, to: reigns.get(place + 1).map(|next| next.from) })
}

impl Reach {
    fn words(reach: Option<Reach>) -> String {
        match reach {
            None => "for no number of rays".into(),
            Some(Reach { from: 0.0, to: None }) => "for any number of rays".into(),
            Some(Reach { from: 0.0, to: Some(to) }) => {
                format!("up to about {} rays a build", count(to))
            }
            Some(Reach { from, to: None }) => format!("from about {} rays a build on", count(from)),
            Some(Reach { from, to: Some(to) }) => {
                format!("from about {} to {} rays a build", count(from), count(to))
            }
        }
    }
}

fn in_words(verdict: &Verdict, least: &Row, wish: &Wish) -> String {
    let Verdict { hierarchy, rebuilt, refitted, total_ms, serves, .. } = verdict;
    let rays = wish.rays_per_build();
    let ours = wish.builds() as f64 * least.total_ms(rays);
    let how = if wish.builds() > 1 { "built once and refitted" } else { "built once" };
    let serves = match serves {
        Serves::Better => "would serve better",
        Serves::Alike => "is not told apart from it",
        Serves::Worse => "would not serve better",
    };
    format!(
        "A bounding volume hierarchy ({}, {} threads, measured in the same rounds) takes {:.2} ms to build, {:.2} ms to refit and {:.0} ns a \
         ray. {} it takes {:.1} ms where row {} takes {:.1} ms, so it {serves}. By the medians it takes less than every preset {} when it is built \
         anew, and {} when it is refitted, as long as its shape fits the triangles. Of {} judged rays it answers {} otherwise than the exact \
         answer, hit or miss, outlines within rounding included. On GPUs hierarchies were found ahead on simple and moderate scenes, kd-trees on \
         complex ones of high depth complexity (Vinkler, Havran and Bittner 2014, 2016).",
        hierarchy.name,
        hierarchy.threads,
        hierarchy.build_ms,
        hierarchy.refit_ms,
        hierarchy.ns_per_ray,
        capitalised(how),
        total_ms,
        least.number,
        ours,
        Reach::words(*rebuilt),
        Reach::words(*refitted),
        hierarchy.judged,
        hierarchy.otherwise,
    )
}

fn capitalised(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::super::row::tests::row;
    use super::*;

    fn hierarchy(build_ms: f64, refit_ms: f64, ns: f64) -> Measured {
        let around = |time: f64| Interval { low: 0.99 * time, high: 1.01 * time };
        let trace = Trace { rays: 1000, ns: Some(ns), least_ns: Some(ns) };
        Measured {
            name: "a hierarchy".into(),
            threads: 2,
            build_ms,
            build_interval: around(build_ms),
            refit_ms,
            refit_interval: around(refit_ms),
            trace: Sets::of([trace; 4]),
            ns_per_ray: ns,
            ns_interval: around(ns),
            judged: 1000,
            otherwise: 3,
        }
    }

    fn wish(rays: u64, frames: u64) -> Wish {
        let least_accuracy = "watertight".to_owned();
        Wish { rays, frames, still: false, least_accuracy, max_error: None }
    }

    /// The hierarchy takes 300 ns a ray. It meets `fast` (100 ms, 250 ns) at 1 million rays when it is built in 50 ms
    /// and at 1.8 million when it is refitted in 10; `best` (300 ms, 200 ns) only at 2.5 and 2.9 million.
    #[test]
    fn break_even_in_closed_form() {
        let mut rows =
            vec![row("fast", "watertight", 100.0, 250.0), row("best", "watertight", 300.0, 200.0)];
        rows[1].number = 2;
        let verdict = |rays, frames| {
            judge(hierarchy(50.0, 10.0, 300.0), &rows, None, &wish(rays, frames)).unwrap()
        };
        let found = verdict(1, 1);
        let close = |reach: Option<Reach>, to: f64| {
            let reach = reach.unwrap();
            assert_eq!(reach.from, 0.0);
            assert!((reach.to.unwrap() / to - 1.0).abs() < 1e-9, "{reach:?}");
        };
        close(found.rebuilt, 1e6);
        close(found.refitted, 1.8e6);
        // One frame has a build; of many that move all but the first have a refit.
        assert_eq!(verdict(500_000, 1).serves, Serves::Better);
        assert_eq!(verdict(1_000_000, 1).serves, Serves::Alike);
        assert_eq!(verdict(2_000_000, 1).serves, Serves::Worse);
        assert_eq!(verdict(1_200_000, 100).serves, Serves::Better);
        assert_eq!(verdict(1_800_000, 1000).serves, Serves::Alike);
        assert_eq!(verdict(4_000_000, 100).serves, Serves::Worse);
        // 50 + 9 * 10 + 10 * 0.3
        assert!((verdict(1000, 10).total_ms - 143.0).abs() < 1e-9);
        let words = verdict(2_000_000, 1).words;
        assert!(words.contains("650.0 ms where row 1 takes 600.0 ms, so it would not"), "{words}");
    }

    /// With nothing moving a build serves all frames.
    #[test]
    fn still_scenes_are_built_once() {
        let rows = [row("fast", "watertight", 100.0, 250.0)];
        let still = Wish { still: true, ..wish(1_000_000, 10) };
        let found = judge(hierarchy(50.0, 10.0, 300.0), &rows, None, &still).unwrap();
        assert!((found.total_ms - 3050.0).abs() < 1e-9, "{found:?}");
        assert_eq!(found.serves, Serves::Worse);
    }

    #[test]
    fn only_rows_of_the_cpu_that_will_do_count() {
        let mut rows = vec![
            row("fast", "watertight", 100.0, 250.0),
            row("fast", "fast", 1.0, 1.0),
            row("fast", "watertight", 1.0, 1.0),
        ];
        // That row is a device's, and none of the CPU's.
        (rows[2].threads, rows[2].backend) = (None, "wgpu".into());
        let slow = hierarchy(200.0, 50.0, 200.0);
        let found = judge(slow.clone(), &rows, None, &wish(1, 1)).unwrap();
        assert_eq!(found.rebuilt, Some(Reach { from: 2e6, to: None }));
        assert_eq!(found.refitted, Some(Reach { from: 0.0, to: None }));
        assert_eq!(judge(slow.clone(), &rows[1..], None, &wish(1, 1)), None);
        // Turned knobs do not count beside presets, and what is recommended is what it is held against.
        let mut turned = row("fast", "watertight", 50.0, 100.0);
        (turned.number, turned.knob) = (4, Some("T 32".into()));
        let rows = [rows[0].clone(), turned];
        let found = judge(slow, &rows, Some(1), &wish(1, 1)).unwrap();
        assert_eq!(found.rebuilt, Some(Reach { from: 2e6, to: None }));
        assert!(found.words.contains("where row 1 takes 100.0 ms"), "{}", found.words);
    }
}
