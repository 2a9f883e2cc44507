//! A row: one setting, what it costs and what it gets wrong.

use super::interval::Interval;
use super::pareto::Standing;
use super::payback::{Line, Payback};
use serde::{Deserialize, Serialize};
use splitplane_core::config::{BuildConfig, Preset};
use std::cmp::Ordering;

/// Something for each of the four sets of rays that are timed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sets<T> {
    /// Rays of the camera: closest hits.
    pub primary: T,
    /// From what the camera sees towards lights: any hits.
    pub shadow: T,
    /// From what the camera sees into the half-space above the surface: closest hits.
    pub bounce: T,
    /// Chords of the sphere around the scene: closest hits.
    pub random: T,
}

impl<T> Sets<T> {
    /// The names of the sets, in their order.
    pub const NAMES: [&'static str; 4] = ["primary", "shadow", "bounce", "random"];

    /// All four, in their order.
    pub fn each(&self) -> [&T; 4] {
        [&self.primary, &self.shadow, &self.bounce, &self.random]
    }

    /// The same from four values in their order.
    pub fn of([primary, shadow, bounce, random]: [T; 4]) -> Sets<T> {
        Sets { primary, shadow, bounce, random }
    }
}

/// Kinds of rays whose answers are judged.
pub const KINDS: usize = 6;

/// Something for each of the kinds of rays whose answers are judged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Aims<T> {
    /// Chords of the sphere around the scene.
    pub random: T,
    /// Aimed at points of edges.
    pub edge: T,
    /// Aimed at vertices.
    pub vertex: T,
    /// Rays of the camera, as many of the timed ones as there are.
    pub primary: T,
    /// From what the camera sees into the half-space above the surface, likewise.
    pub bounce: T,
    /// From what the camera sees towards lights, likewise; of these only is asked whether anything is hit, of the
    /// others, what is.
    pub shadow: T,
}

impl<T> Aims<T> {
    /// The names of the kinds, in their order.
    pub const NAMES: [&'static str; KINDS] =
        ["random", "edge", "vertex", "primary", "bounce", "shadow"];

    /// Those that are aimed where tests go wrong; real rays are hardly ever.
    pub const AIMED: [&'static str; 2] = ["edge", "vertex"];

    /// All of them, in their order.
    pub fn each(&self) -> [&T; KINDS] {
        [&self.random, &self.edge, &self.vertex, &self.primary, &self.bounce, &self.shadow]
    }

    /// The same from values in their order.
    pub fn of([random, edge, vertex, primary, bounce, shadow]: [T; KINDS]) -> Aims<T> {
        Aims { random, edge, vertex, primary, bounce, shadow }
    }
}

/// Time to trace one set of rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trace {
    /// Rays in the batch. 0 where the scene gives none: the camera sees nothing, or no light is above
    /// any surface.
    pub rays: usize,
    /// Nanoseconds a ray, the median of the repeats. None without rays.
    pub ns: Option<f64>,
    /// The same, the least of the repeats.
    pub least_ns: Option<f64>,
}

/// By how much the distances of some answers differ from the exact ones, in parts of the diagonal of the
/// scene's box: how far off the point is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Apart {
    /// Answers.
    pub answers: u64,
    /// The mean over them. 0 without any.
    pub mean: f64,
    /// The greatest.
    pub greatest: f64,
}

impl Apart {
    /// Takes one more answer. What is no number counts as the whole diagonal.
    pub fn take(&mut self, apart: f64) {
        let apart = if apart.is_finite() { apart } else { 1.0 };
        self.answers += 1;
        self.mean += (apart - self.mean) / self.answers as f64;
        self.greatest = self.greatest.max(apart);
    }

    /// Those of two sets of answers together.
    #[must_use]
    pub fn and(self, other: Apart) -> Apart {
        let answers = self.answers + other.answers;
        let sum = self.answers as f64 * self.mean + other.answers as f64 * other.mean;
        Apart {
            answers,
            mean: sum / answers.max(1) as f64,
            greatest: self.greatest.max(other.greatest),
        }
    }
}

/// Answers that differ from the exact ones; what each word means is in [`super::judge`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Errors {
    /// Rays judged.
    pub rays: u64,
    /// They hit, and the answer was a miss that rounding does not explain.
    pub missing: u64,
    /// They hit, and the answer was another place, farther or nearer than rounding explains.
    pub wrong: u64,
    /// They hit nothing, and the answer was a hit that rounding does not explain.
    pub phantom: u64,
    /// Answers of any of these kinds that rounding explains; they are no errors.
    pub rounded: u64,
    /// Right answers that name the exact triangle.
    pub same: Apart,
    /// Right answers that name another triangle.
    pub other: Apart,
    /// Rounded answers: the ray passes an outline within rounding, so they may be anywhere.
    pub outline: Apart,
    /// Wrong answers.
    pub off: Apart,
}

impl Errors {
    /// All errors.
    pub fn all(&self) -> u64 {
        self.missing + self.wrong + self.phantom
    }

    /// A count of these rays, for each million of them. 0 without rays.
    pub fn per_million(&self, count: u64) -> f64 {
        if self.rays == 0 { 0.0 } else { 1e6 * count as f64 / self.rays as f64 }
    }
}

/// What shaped a tree, as it stands in files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// K_T.
    pub traversal_cost: u32,
    /// K_I.
    pub intersection_cost: u32,
    /// W.
    pub block_width: u32,
    /// T.
    pub small_node_limit: u32,
    /// C_e, in 256ths.
    pub empty_cutoff: u32,
    /// Most levels below the root.
    pub max_depth: u32,
    /// Bins of an axis.
    pub bins: u32,
    /// Whether references are clipped.
    pub clip: bool,
    /// The cap on references, for each triangle.
    pub references_per_triangle: u32,
    /// The cap on nodes, for each triangle.
    pub nodes_per_triangle: u32,
    /// What a split with an empty side is forgiven, in 256ths.
    pub empty_bonus: u32,
    /// How many bad splits in a row are tried.
    pub bad_splits: u32,
}

/// Knobs that the builder does not have are 0.
impl From<BuildConfig> for Config {
    fn from(config: BuildConfig) -> Config {
        let [_, _, _, _, small_node_limit, empty_cutoff, _, _, nodes_per_triangle, bins, ..] =
            config.words();
        let [.., empty_bonus, bad_splits] = config.words();
        Config {
            traversal_cost: config.traversal_cost,
            intersection_cost: config.intersection_cost,
            block_width: config.block_width,
            small_node_limit,
            empty_cutoff,
            max_depth: config.max_depth,
            bins,
            clip: config.clip,
            references_per_triangle: config.references_per_triangle,
            nodes_per_triangle,
            empty_bonus,
            bad_splits,
        }
    }
}

impl Config {
    /// The configuration of a preset with those of these knobs that it has.
    pub fn with(&self, preset: Preset) -> BuildConfig {
        let mut config = BuildConfig {
            traversal_cost: self.traversal_cost,
            intersection_cost: self.intersection_cost,
            block_width: self.block_width,
            max_depth: self.max_depth,
            references_per_triangle: self.references_per_triangle,
            clip: self.clip,
            ..preset.config()
        };
        if let Some(stages) = config.stages_mut() {
            stages.small_node_limit = self.small_node_limit;
            stages.empty_cutoff = self.empty_cutoff;
            stages.nodes_per_triangle = self.nodes_per_triangle;
        }
        if let Some(bins) = config.bins_mut() {
            *bins = self.bins;
        }
        if let Some(sweep) = config.sweep_mut() {
            sweep.empty_bonus = self.empty_bonus;
            sweep.bad_splits = self.bad_splits;
        }
        config
    }
}

/// One setting, measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// Its number in tables and plots, from 1 on.
    pub number: usize,
    /// Preset and knob in words.
    pub name: String,
    /// The preset's name.
    pub preset: String,
    /// The knob that is not the preset's own; none for a preset as it is.
    pub knob: Option<String>,
    /// How the copies that queries read are laid out, by its name.
    pub layout: String,
    /// Settings of the same preset whose trees have the same nodes and references: they are this row too.
    pub also: Vec<String>,
    /// What shaped the tree.
    pub config: Config,
    /// `cpu` or `wgpu`.
    pub backend: String,
    /// Threads that built and traced; none for a device.
    pub threads: Option<usize>,
    /// The accuracy's name.
    pub accuracy: String,
    /// Milliseconds from triangles in host memory to a tree that rays can be traced through: the
    /// median of the repeats.
    pub build_ms: f64,
    /// The same, the least of the repeats.
    pub least_build_ms: f64,
    /// Where the median of the build times lies.
    pub build_interval: Interval,
    /// Time to trace each set.
    pub trace: Sets<Trace>,
    /// Nanoseconds a ray, the median over the rounds of the mean over the sets that have rays: as many rays of each kind.
    pub ns_per_ray: f64,
    /// Where the median of that mean lies.
    pub ns_interval: Interval,
    /// Rounds that were measured again, since a time in them was far off.
    pub again: usize,
    /// Bytes that queries read.
    pub query_bytes: u64,
    /// Most bytes that the build held at once besides the mesh.
    pub peak_bytes: u64,
    /// SAH cost of the tree with every triangle of a leaf counted, at the K_T and K_I of preset
    /// `fast` whatever shaped it.
    pub sah_cost: f64,
    /// The same by blocks of W triangles, at the W of preset `fast`.
    pub block_cost: f64,
    /// Nodes.
    pub nodes: usize,
    /// References of all leaves.
    pub references: usize,
    /// Most levels below the root.
    pub depth: u32,
    /// The tree's name, which says what shaped it, too.
    pub digest: String,
    /// A name of its nodes and references alone.
    pub tree: String,
    /// Answers that differ from the exact ones.
    pub errors: Aims<Errors>,
    /// Missing, wrong and phantom hits for each million rays, over all kinds.
    pub errors_per_million: f64,
    /// The same over the kinds that are not aimed at edges and vertices: what rays of pictures and chords lose.
    pub unaimed_errors_per_million: f64,
    /// Answers that differ from the exact ones within rounding, for each million rays.
    pub rounded_per_million: f64,
    /// Rays that the backend could not decide in its own arithmetic and had decided elsewhere, for
    /// each million of those judged.
    pub redone_per_million: f64,
    /// Which rows it competes with: those of equal words.
    pub field: String,
    /// Whether a row of its field beats it: is no worse in build time, trace time, memory, errors and
    /// rounded answers, and better in one of them beyond the noise.
    pub pareto: Standing,
    /// When its build pays against preset `fast`.
    pub payback: Payback,
}

impl Row {
    /// Preset, knob and accuracy in words, and the backend where it is not the CPU.
    pub fn short_title(&self) -> String {
        let on = if self.threads.is_none() { "; wgpu" } else { "" };
        format!("{}; {}{on}", self.name, self.accuracy)
    }

    /// The title, and the settings that are this row too.
    pub fn title_with_others(&self) -> String {
        match self.also.as_slice() {
            [] => self.title(),
            also => format!("{} (the same tree: {})", self.title(), also.join("; ")),
        }
    }

    /// Preset, knob, accuracy and who does the work, in words.
    pub fn title(&self) -> String {
        let by = match self.threads {
            Some(1) => "1 thread".to_owned(),
            Some(threads) => format!("{threads} threads"),
            None => self.backend.clone(),
        };
        format!("{}; {}; {by}", self.name, self.accuracy)
    }

    /// What it costs.
    pub fn line(&self) -> Line {
        Line { build_ms: self.build_ms, ns_per_ray: self.ns_per_ray }
    }

    /// Milliseconds for one build and this many rays.
    pub fn total_ms(&self, rays: f64) -> f64 {
        self.line().total_ms(rays)
    }

    /// Where the time for one build and this many rays lies, in milliseconds.
    pub fn total_interval(&self, rays: f64) -> Interval {
        self.build_interval.plus(self.ns_interval.times(rays * 1e-6))
    }

    /// When its build pays against another row's, as far as both are told apart.
    pub fn payback_against(&self, base: &Row) -> Payback {
        let [build, ray, ..] = self.compare(base);
        // The ends of the intervals that make the number of rays least and greatest.
        let rays = |own: (f64, f64), other: (f64, f64)| 1e6 * (own.0 - other.0) / (other.1 - own.1);
        let [own, other] = [self, base].map(|row| (row.build_interval, row.ns_interval));
        let ends = match build {
            Ordering::Greater => [
                rays((own.0.low, own.1.low), (other.0.high, other.1.high)),
                rays((own.0.high, own.1.high), (other.0.low, other.1.low)),
            ],
            _ => [
                rays((own.0.high, own.1.high), (other.0.low, other.1.low)),
                rays((own.0.low, own.1.low), (other.0.high, other.1.high)),
            ],
        };
        Payback::of(self.line(), base.line(), build, ray).within(ends)
    }

    /// How it compares with another row: build time, trace time, memory, errors and rounded answers. Times within
    /// their noise are equal, and so are those of the very same work, whatever the rounds say: rays of one accuracy
    /// through the same nodes and references by the same device, and builds of them by the same preset. Memory
    /// within [`super::interval::LEAST_APART`] is equal, too.
    pub fn compare(&self, other: &Row) -> [Ordering; 5] {
        let bytes = |row: &Row| Interval::exactly(row.query_bytes as f64);
        [
            self.compare_build(other),
            self.compare_ray(other),
            bytes(self).compare(bytes(other)),
            self.errors_per_million.total_cmp(&other.errors_per_million),
            self.rounded_per_million.total_cmp(&other.rounded_per_million),
        ]
    }

    /// The same with medians as they were measured, noise or not. Equal work is equal here, too.
    pub fn compare_medians(&self, other: &Row) -> [Ordering; 5] {
        let unless = |same: bool, own: f64, other: f64| match same {
            true => Ordering::Equal,
            false => own.total_cmp(&other),
        };
        [
            unless(self.is_built_as(other), self.build_ms, other.build_ms),
            unless(self.is_traced_as(other), self.ns_per_ray, other.ns_per_ray),
            self.query_bytes.cmp(&other.query_bytes),
            self.errors_per_million.total_cmp(&other.errors_per_million),
            self.rounded_per_million.total_cmp(&other.rounded_per_million),
        ]
    }

    /// How the time for one build and this many rays compares, with the same care.
    pub fn compare_total(&self, other: &Row, rays: f64) -> Ordering {
        match (self.is_built_as(other), self.is_traced_as(other)) {
            (true, _) => self.compare_ray(other),
            (false, true) => self.compare_build(other),
            (false, false) => self.total_interval(rays).compare(other.total_interval(rays)),
        }
    }

    fn compare_build(&self, other: &Row) -> Ordering {
        match self.is_built_as(other) {
            true => Ordering::Equal,
            false => self.build_interval.compare(other.build_interval),
        }
    }

    fn compare_ray(&self, other: &Row) -> Ordering {
        match self.is_traced_as(other) {
            true => Ordering::Equal,
            false => self.ns_interval.compare(other.ns_interval),
        }
    }

    /// Whether it has the nodes, references and layout of another row, on the same device and threads.
    fn is_like(&self, other: &Row) -> bool {
        (&self.tree, &self.layout) == (&other.tree, &other.layout)
            && (&self.backend, self.threads) == (&other.backend, other.threads)
    }

    fn is_built_as(&self, other: &Row) -> bool {
        self.is_like(other) && self.preset == other.preset
    }

    fn is_traced_as(&self, other: &Row) -> bool {
        self.is_like(other) && self.accuracy == other.accuracy
    }

    /// All errors of a kind, added up over the kinds of rays.
    pub fn sum(&self, of: impl Fn(&Errors) -> u64) -> u64 {
        self.errors.each().into_iter().map(of).sum()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A row of which only times matter.
    pub(in super::super) fn row(name: &str, accuracy: &str, build_ms: f64, ns: f64) -> Row {
        let trace = Trace { rays: 1000, ns: Some(ns), least_ns: Some(ns) };
        Row {
            number: 1,
            name: name.to_owned(),
            preset: name.to_owned(),
            knob: None,
            layout: "fast".into(),
            also: Vec::new(),
            config: BuildConfig::default().into(),
            backend: "cpu".into(),
            threads: Some(2),
            accuracy: accuracy.to_owned(),
            build_ms,
            least_build_ms: build_ms,
            build_interval: Interval { low: 0.99 * build_ms, high: 1.01 * build_ms },
            trace: Sets::of([trace; 4]),
            ns_per_ray: ns,
            ns_interval: Interval { low: 0.99 * ns, high: 1.01 * ns },
            again: 0,
            query_bytes: 1_000,
            peak_bytes: 2_000,
            sah_cost: 20.0,
            block_cost: 10.0,
            nodes: 3,
            references: 4,
            depth: 1,
            digest: "0".into(),
            tree: format!("{build_ms} {ns}"),
            errors: Aims::default(),
            errors_per_million: 0.0,
            unaimed_errors_per_million: 0.0,
            rounded_per_million: 0.0,
            redone_per_million: 0.0,
            field: "all".into(),
            pareto: Standing::Beaten,
            payback: Payback::Unknown,
        }
    }

    #[test]
    fn configurations_survive_a_file() {
        for preset in Preset::ALL {
            let config = BuildConfig { clip: false, max_depth: 9, ..preset.config() };
            let text = serde_json::to_string(&Config::from(config)).unwrap();
            let read: Config = serde_json::from_str(&text).unwrap();
            assert_eq!(read.with(preset), config);
        }
    }

    /// Times of equal trees are noise, however far apart they are.
    #[test]
    fn equal_trees_are_never_ranked() {
        let first = row("fast", "watertight", 100.0, 200.0);
        let planted =
            Row { knob: Some("depth 63".into()), ..row("fast", "watertight", 50.0, 400.0) };
        let planted = Row { tree: first.tree.clone(), ..planted };
        for (a, b) in [(&first, &planted), (&planted, &first)] {
            assert_eq!(a.compare(b), [Ordering::Equal; 5]);
            assert_eq!(a.compare_total(b, 1e6), Ordering::Equal);
            assert_eq!(a.payback_against(b), Payback::Alike);
        }
        // Another preset takes another way to the same tree: only builds may differ.
        let best = Row { preset: "best".into(), ..planted.clone() };
        assert_eq!(first.compare(&best)[..2], [Ordering::Greater, Ordering::Equal]);
        assert_eq!(first.compare_total(&best, 1e9), Ordering::Greater);
        // The same numbers of another tree do rank.
        let other = Row { tree: "other".into(), ..planted };
        assert_eq!(first.compare(&other)[..2], [Ordering::Greater, Ordering::Less]);
        assert_eq!(first.compare_total(&other, 1e9), Ordering::Less);
    }
}
