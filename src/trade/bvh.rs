//! When a bounding volume hierarchy would likely serve better: a rule of thumb, with its figures.
//!
//! Each library that was measured beside the trees is a line of its own: what its build takes, as a part of
//! preset `fast`, and what a ray takes, as a multiple of the fastest of the trees. Build ratio and ray
//! ratios are of the same library. The line is laid beside those of all rows, each with its own
//! build and its own rays, and the lower envelope says for how many rays a build it is the least. A
//! hierarchy that is refitted, as over a scene that moves, is drawn without a build: a refit takes a
//! fraction of one. The ratios are of six scenes on one machine and are not measured here.
//!
//! Vinkler, Havran and Bittner (2014, 2016) found the same divide between the two structures on GPUs:
//! hierarchies win on simple and moderate scenes, kd-trees on complex ones of high depth complexity.

use super::document::ALL_THREADS;
use super::payback::{Line, count, envelope};
use super::recommend::{Wish, will_do};
use super::row::{Row, Sets};
use serde::{Deserialize, Serialize};

/// A ratio over the scenes on which it was measured: least, geometric mean and most.
pub type Spread = [f64; 3];

/// What was measured of a library's hierarchies beside the trees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Library {
    /// Its name.
    pub name: &'static str,
    /// Build time of preset `fast` over that of the hierarchy, both on 2 threads.
    pub build: Spread,
    /// Time a ray through the hierarchy over that through the best of the three presets, set by set: one
    /// thread, closest hits, accuracy `watertight`.
    pub ray: Sets<Spread>,
}

/// Embree 4's default hierarchy (`docs/measurements/presets-2026-11-21.md`, "Build times" and "Against
/// other libraries").
pub const EMBREE: Library = Library {
    name: "Embree 4",
    build: [1.72, 2.40, 3.92],
    ray: Sets {
        primary: [0.83, 1.37, 2.71],
        shadow: [0.58, 0.92, 1.75],
        bounce: [0.39, 0.54, 0.95],
        random: [0.47, 0.67, 0.82],
    },
};

/// The two-wide hierarchy of obvhs, medium quality (the same file; its builds were measured beside
/// Embree's on four of the scenes: `docs/measurements/trade-2026-11-21.md`).
pub const OBVHS: Library = Library {
    name: "obvhs",
    build: [0.76, 1.09, 1.53],
    ray: Sets {
        primary: [0.97, 1.92, 3.35],
        shadow: [0.82, 1.32, 2.15],
        bounce: [0.62, 1.12, 2.21],
        random: [0.90, 1.29, 1.86],
    },
};

/// Numbers of rays a build for which something is the least.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reach {
    /// From so many on.
    pub from: f64,
    /// Up to so many; none for any.
    pub to: Option<f64>,
}

/// What the rule says of one library.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Against {
    /// The library.
    pub library: String,
    /// Preset `fast` over its build.
    pub build_ratio: Spread,
    /// A ray through it over one through the fastest tree of each set: the mean over the sets, by this scene's
    /// times.
    pub ray_ratio: Spread,
    /// Where it is the least when it is refitted, the refit counted as free; none for nowhere. By the
    /// means of the ratios, as what follows.
    pub refitted: Option<Reach>,
    /// Where it is the least when it is built anew. Without a row of preset `fast` there is nothing to
    /// reckon its build by: then `build_known` is false, and this is none.
    pub rebuilt: Option<Reach>,
    /// Whether its build could be reckoned.
    pub build_known: bool,
    /// Whether it is likely to serve the wish better: refitted where frames move, else built anew.
    pub likely: bool,
}

/// What the rule says of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verdict {
    /// A verdict each library.
    pub against: Vec<Against>,
    /// All of it in words.
    pub words: String,
}

/// Applies the rule to the rows of the CPU that will do for a wish; none without any.
pub fn judge(rows: &[Row], wish: &Wish) -> Option<Verdict> {
    let own = |row: &&Row| row.threads.is_some() && row.field == ALL_THREADS;
    let usable: Vec<&Row> = rows.iter().filter(own).filter(|row| will_do(row, wish)).collect();
    if usable.is_empty() {
        return None;
    }
    // The ratios are to presets as they are, at accuracy `watertight`.
    let measured = |row: &&Row| row.knob.is_none() && row.accuracy == "watertight";
    let mut beside: Vec<&Row> = rows.iter().filter(own).filter(measured).collect();
    if beside.is_empty() {
        beside.clone_from(&usable);
    }
    let fastest: [Option<f64>; 4] = std::array::from_fn(|set| {
        beside.iter().filter_map(|row| row.trace.each()[set].ns).min_by(f64::total_cmp)
    });
    let fast = rows.iter().filter(own).find(|row| row.name == "fast").map(|row| row.build_ms);
    let lines: Vec<Line> = usable.iter().map(|row| row.line()).collect();
    let against = [EMBREE, OBVHS].map(|library| beside_of(&library, &lines, fastest, fast, wish));
    let words = in_words(&against, wish);
    Some(Verdict { against: against.into(), words })
}

fn beside_of(
    library: &Library,
    lines: &[Line],
    fastest: [Option<f64>; 4],
    fast_build_ms: Option<f64>,
    wish: &Wish,
) -> Against {
    let (mut ours, mut theirs, mut sets) = (0.0, [0.0; 3], 0.0);
    for (ns, ratios) in fastest.into_iter().zip(library.ray.each()) {
        let Some(ns) = ns else { continue };
        sets += 1.0;
        ours += ns;
        for (sum, ratio) in theirs.iter_mut().zip(ratios) {
            *sum += ns * ratio;
        }
    }
    let ray_ratio = if ours > 0.0 { theirs.map(|sum| sum / ours) } else { [1.0; 3] };
    let ns_per_ray = if sets > 0.0 { theirs[1] / sets } else { 0.0 };
    let refitted = reach(lines, Line { build_ms: 0.0, ns_per_ray });
    let rebuilt = fast_build_ms
        .and_then(|fast| reach(lines, Line { build_ms: fast / library.build[1], ns_per_ray }));
    let moves = wish.frames > 1 && !wish.still;
    let applies = if moves || fast_build_ms.is_none() { refitted } else { rebuilt };
    Against {
        library: library.name.to_owned(),
        build_ratio: library.build,
        ray_ratio,
        refitted,
        rebuilt,
        build_known: fast_build_ms.is_some(),
        likely: applies.is_some_and(|reach| reach.holds(wish.rays_per_build())),
    }
}

/// Where a line is the least beside others; of equal lines it is taken.
fn reach(lines: &[Line], own: Line) -> Option<Reach> {
    let reigns = envelope(&[&[own], lines].concat());
    let place = reigns.iter().position(|reign| reign.line == 0)?;
    Some(Reach { from: reigns[place].from, to: reigns.get(place + 1).map(|next| next.from) })
}

impl Reach {
    fn holds(&self, rays: f64) -> bool {
        rays >= self.from && self.to.is_none_or(|to| rays < to)
    }

    fn words(reach: Option<Reach>) -> String {
        match reach {
            None => "for no number of rays".into(),
            Some(Reach { from: 0.0, to: None }) => "for any number of rays".into(),
            Some(Reach { from: 0.0, to: Some(to) }) => format!("up to {} rays a build", count(to)),
            Some(Reach { from, to: None }) => format!("from {} rays a build on", count(from)),
            Some(Reach { from, to: Some(to) }) => {
                format!("from {} to {} rays a build", count(from), count(to))
            }
        }
    }
}

fn in_words(against: &[Against], wish: &Wish) -> String {
    let mut out =
        "Whether a bounding volume hierarchy on the CPU would serve better is a rule of thumb \
                   here, not a measurement of this scene."
            .to_owned();
    for Against { library, build_ratio, ray_ratio, .. } in against {
        out += &format!(
            " {library} takes {:.2} times as long a ray as the fastest tree above for each kind of ray (the \
             mean of six scenes, which had {:.2} to {:.2}), and preset fast {:.1} times as long to build as \
             it ({:.1} to {:.1}).",
            ray_ratio[1],
            ray_ratio[0],
            ray_ratio[2],
            build_ratio[1],
            build_ratio[0],
            build_ratio[2]
        );
    }
    for Against { library, refitted, rebuilt, build_known, likely, .. } in against {
        let rebuilt = match build_known {
            true => Reach::words(*rebuilt),
            false => "for an unknown number, as preset fast was not measured".into(),
        };
        out += &format!(
            " {library} would {} serve better for {} rays a build: by the means it does {rebuilt} when built \
             anew, and {} when refitted, the refit counted as free.",
            if *likely { "likely" } else { "likely not" },
            count(wish.rays_per_build()),
            Reach::words(*refitted),
        );
    }
    out + " High depth complexity favours the kd-tree (Vinkler, Havran and Bittner 2014, 2016)."
}

#[cfg(test)]
mod tests {
    use super::super::row::tests::row;
    use super::*;

    const LIBRARY: Library = Library {
        name: "a library",
        build: [1.0, 2.0, 3.0],
        ray: Sets { primary: [1.5; 3], shadow: [1.5; 3], bounce: [1.5; 3], random: [1.5; 3] },
    };

    fn wish(rays: u64, frames: u64) -> Wish {
        let least_accuracy = "watertight".to_owned();
        Wish { rays, frames, still: false, least_accuracy, max_error: None }
    }

    /// The hierarchy takes 300 ns a ray. It meets `fast` (100 ms, 250 ns) at 2 million rays when it is
    /// refitted and at 1 million when it is built in 50 ms; `best` (300 ms, 200 ns) only at 3 and
    /// 2.5 million. A tree of the build of one and the rays of the other, which there is not, it would
    /// meet at half as many.
    #[test]
    fn break_even_in_closed_form() {
        let lines = [(100.0, 250.0), (300.0, 200.0)]
            .map(|(build_ms, ns_per_ray)| Line { build_ms, ns_per_ray });
        let verdict = |rays, frames| {
            beside_of(&LIBRARY, &lines, [Some(200.0); 4], Some(100.0), &wish(rays, frames))
        };
        let found = verdict(1, 1);
        assert_eq!(found.ray_ratio, [1.5; 3]);
        assert_eq!(found.refitted, Some(Reach { from: 0.0, to: Some(2e6) }));
        assert_eq!(found.rebuilt, Some(Reach { from: 0.0, to: Some(1e6) }));
        // One frame has a build; frames that move have refits.
        assert!(verdict(999_999, 1).likely && !verdict(1_000_001, 1).likely);
        assert!(verdict(1_999_999, 2).likely && !verdict(2_000_001, 2).likely);
        // Faster rays and a slower build: it serves from some number on, then always.
        let slow = Library { build: [0.5; 3], ray: Sets::of([[0.5; 3]; 4]), ..LIBRARY };
        let found = beside_of(&slow, &lines, [Some(200.0); 4], Some(100.0), &wish(1, 1));
        // 200 ms and 100 ns against 100 ms and 250 ns.
        assert_eq!(found.rebuilt, Some(Reach { from: 1e8 / 150.0, to: None }));
        assert_eq!(found.refitted, Some(Reach { from: 0.0, to: None }));
        assert!(!found.likely);
        // Nothing to reckon a build by.
        let unknown = beside_of(&LIBRARY, &lines, [Some(200.0); 4], None, &wish(1, 1));
        assert_eq!((unknown.rebuilt, unknown.build_known), (None, false));
    }

    #[test]
    fn both_libraries_are_judged_by_rows_of_the_cpu() {
        let mut rows = vec![
            row("fast", "watertight", 100.0, 250.0),
            row("best", "watertight", 300.0, 200.0),
            row("fast", "watertight", 1.0, 1.0),
        ];
        // That row is a device's, and none of the CPU's.
        (rows[2].threads, rows[2].backend) = (None, "wgpu".into());
        let verdict = judge(&rows, &wish(1, 1)).unwrap();
        let [embree, obvhs] = &verdict.against[..] else { panic!("{verdict:?}") };
        let mean = |library: &Library| library.ray.each().map(|x| x[1]).iter().sum::<f64>() / 4.0;
        for (found, library) in [(embree, EMBREE), (obvhs, OBVHS)] {
            assert!((found.ray_ratio[1] - mean(&library)).abs() < 1e-12, "{found:?}");
            assert_eq!(found.build_ratio, library.build);
            assert!(verdict.words.contains(library.name), "{}", verdict.words);
        }
        // Faster by its rays and by its build.
        assert_eq!(embree.rebuilt, Some(Reach { from: 0.0, to: None }));
        // 1.4125 * 200 ns a ray: it meets `fast` where 32.5 ns a ray are as much as its build.
        let even = 1e8 / (1.4125 * 200.0 - 250.0);
        assert!((obvhs.refitted.unwrap().to.unwrap() / even - 1.0).abs() < 1e-9, "{obvhs:?}");
        assert_eq!(judge(&rows[2..], &wish(1, 1)), None);
    }
}
