//! A row: one setting, what it costs and what it gets wrong.

mod config;
mod errors;
mod kinds;

use super::interval::Interval;
use super::pareto::Standing;
use super::payback::{Line, Payback};
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

pub use config::Config;
pub use errors::{Apart, Errors};
pub use kinds::{Aims, KINDS, Sets, Trace};

/// The field of rows that use all threads, or a device.
pub const ALL_THREADS: &str = "all";
/// The field of rows of one thread, where others use more.
pub const ONE_THREAD: &str = "one thread";

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
    use splitplane_core::config::BuildConfig;

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
