//! When a bounding volume hierarchy would likely serve better: a rule of thumb, with its figures.
//!
//! A hierarchy over a scene that moves is refitted, which takes a fraction of any build (here it is
//! counted as free); one that is built anew is still built faster than a kd-tree. So it serves better
//! unless enough rays are traced through each tree, and a ray takes less through the kd-tree. Both ratios were measured on six
//! scenes and are in `docs/measurements`; they are not measured here. Vinkler, Havran and Bittner
//! (2014, 2016) found the same divide between the two structures on GPUs: hierarchies win on simple
//! and moderate scenes, kd-trees on complex ones of high depth complexity.

use super::payback::count;
use super::row::{Row, Sets};
use serde::{Deserialize, Serialize};

/// Build time of preset `fast` over that of Embree 4's default hierarchy, both on 2 threads: least and
/// most of six scenes (`docs/measurements/presets-2026-11-21.md`, "Build times").
pub const BUILD_RATIO: [f64; 2] = [1.7, 3.9];

/// Time a ray through a hierarchy of two children a node (obvhs, medium quality) over that through the
/// best of our three presets, one thread, closest hits: least, geometric mean and most of six scenes
/// (the same file, "Against other libraries").
pub const RAY_RATIO: Sets<[f64; 3]> = Sets {
    primary: [0.97, 1.92, 3.35],
    shadow: [0.82, 1.32, 2.15],
    bounce: [0.62, 1.12, 2.21],
    random: [0.90, 1.29, 1.86],
};

/// What the rule says of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verdict {
    /// Rays a build up to which a refitted hierarchy is likely to serve better, if rays through it take
    /// the mean of the measured ratios longer.
    pub refit_rays: Option<f64>,
    /// The same for a hierarchy that is built anew, by the mean of the measured build ratios.
    pub rebuild_rays: Option<f64>,
    /// The measured ratio of time a ray, the mean over the sets: least, mean and most of six scenes.
    pub ray_ratio: [f64; 3],
    /// Whether the wish is below the first of them.
    pub likely: bool,
    /// All of it in words.
    pub words: String,
}

/// The ratio over the sets of a row: total time by total time.
fn ray_ratio(row: &Row) -> [f64; 3] {
    let mut ours = 0.0;
    let mut theirs = [0.0; 3];
    for (trace, ratios) in row.trace.each().into_iter().zip(RAY_RATIO.each()) {
        let Some(ns) = trace.ns else { continue };
        ours += ns;
        for (sum, ratio) in theirs.iter_mut().zip(ratios) {
            *sum += ns * ratio;
        }
    }
    if ours > 0.0 { theirs.map(|sum| sum / ours) } else { [1.0; 3] }
}

/// Applies the rule: `base` is the row that builds fastest, `best` the one that traces fastest.
pub fn judge(base: &Row, best: &Row, rays: f64) -> Verdict {
    let ratio = ray_ratio(best);
    let mean_build = (BUILD_RATIO[0] * BUILD_RATIO[1]).sqrt();
    // The kd-tree costs b + n r; the hierarchy b / s + n r q, a refitted one about n r q.
    let even = |saved_ms: f64| {
        let dearer = best.ns_per_ray * (ratio[1] - 1.0);
        (dearer > 0.0).then(|| 1e6 * saved_ms / dearer)
    };
    let refit_rays = even(base.build_ms);
    let rebuild_rays = even(base.build_ms * (1.0 - 1.0 / mean_build));
    let likely = refit_rays.is_none_or(|even| rays < even);
    let words = format!(
        "A bounding volume hierarchy would {} serve better here. This is a rule of thumb, not a measurement \
         of this scene. A refitted hierarchy is likely to serve better up to about {} rays a build, its \
         refit counted as free; one that is built anew, {:.1} times as fast as preset fast, up to about {} \
         (Embree 4: {:.1} to {:.1} times as fast on six scenes). Both take a ray through a hierarchy of two \
         children a node to cost {:.2} times one through the fastest tree above: the mean of six scenes, \
         which had {:.2} to {:.2}. Where it is below 1, as among many small separate objects, the \
         hierarchy serves better however many the rays. High depth complexity favours the kd-tree \
         (Vinkler, Havran and Bittner 2014, 2016).",
        if likely { "likely" } else { "likely not" },
        refit_rays.map_or("any number of".into(), count),
        mean_build,
        rebuild_rays.map_or("any number".into(), count),
        BUILD_RATIO[0],
        BUILD_RATIO[1],
        ratio[1],
        ratio[0],
        ratio[2],
    );
    Verdict { refit_rays, rebuild_rays, ray_ratio: ratio, likely, words }
}

#[cfg(test)]
mod tests {
    use super::super::row::tests::row;
    use super::*;

    /// All sets take equally long, so the ratio is the mean of the four means, 1.4125: 100 ms pay
    /// for 100 ms / (200 ns * 0.4125) rays.
    #[test]
    fn break_even_in_closed_form() {
        let (base, best) =
            (row("fast", "watertight", 100.0, 250.0), row("best", "watertight", 300.0, 200.0));
        let verdict = judge(&base, &best, 1.0);
        assert!((verdict.ray_ratio[1] - 1.4125).abs() < 1e-12, "{:?}", verdict.ray_ratio);
        let even = 1e8 / (200.0 * 0.4125);
        assert!((verdict.refit_rays.unwrap() / even - 1.0).abs() < 1e-12);
        let anew = even * (1.0 - 1.0 / (1.7f64 * 3.9).sqrt());
        assert!((verdict.rebuild_rays.unwrap() / anew - 1.0).abs() < 1e-12);
        assert!(verdict.likely);
        assert!(!judge(&base, &best, even * 1.01).likely);
        assert!(judge(&base, &best, even * 0.99).likely);
    }
}
