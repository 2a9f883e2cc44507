//! `splitplane stats`.

use super::failure::Failure;
use super::options::Common;
use super::prepared::{BuildReport, Prepared, in_pool, print_json};
use super::table::{bars, bytes, grouped, percent};
use super::{output, progress};
use clap::Args;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Map, Value};
use splitplane::core::query::lines::{Lines, Measured, Tally, scene_scale, trace_lines};
use splitplane::core::tree::stats::{RayCost, TreeStats, leaf_sizes_of_class};
use std::ffi::OsString;
use std::fmt::Write;

/// Lines that a thread traces at a time.
const TASK: u64 = 1024;
/// The lines are the same in every run.
const SEED: u64 = 1;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// An .obj, .ply, .stl, .gltf or .glb file, or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE")]
    scene: OsString,
    /// Random lines to trace through the bounds
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    rays: u64,
    #[command(flatten)]
    pub(super) common: Common,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let common = &arguments.common;
    in_pool(common, || {
        let prepared = Prepared::open(&arguments.scene, common, Ok(arguments.rays))?;
        let measured = measure(&prepared, arguments)?;
        let report = Report {
            tree: TreeStats::of(&prepared.accelerator.tree().view()),
            kept: {
                let summary = prepared.accelerator.summary();
                summary.triangles - summary.dropped
            },
            query_bytes: prepared.accelerator.query_bytes(),
            block_width: prepared.accelerator.tree().config.block_width,
            cost_ratio: prepared.accelerator.tree().config.cost_ratio(),
            measured,
        };
        if common.json {
            return print_json(&report.json(prepared.built().report()));
        }
        if common.quiet {
            return Ok(());
        }
        output::data(&(prepared.built().describe() + &report.describe()))
    })
}

/// Traces the lines; of none where the bounds have no area.
fn measure(prepared: &Prepared, arguments: &Arguments) -> Result<Measured, Failure> {
    let tree = prepared.accelerator.tree().view();
    let Some(lines) = Lines::through(&tree.bounds, SEED) else { return Ok(Measured::default()) };
    let mesh = prepared.scene.mesh()?;
    let scale = scene_scale(&tree, &mesh);
    let options = arguments.common.query_options();
    let (quiet, rays) = (arguments.common.quiet, arguments.rays);
    let bar = progress::bar(quiet, "tracing", rays);
    let measured = (0..rays.div_ceil(TASK))
        .into_par_iter()
        .map(|task| {
            let numbers = task * TASK..rays.min((task + 1) * TASK);
            let count = numbers.end - numbers.start;
            let measured = trace_lines(&tree, &mesh, &scale, &lines, numbers, &options);
            bar.inc(count);
            measured
        })
        .reduce(Measured::default, Measured::union);
    bar.finish_and_clear();
    Ok(measured)
}

/// All there is to say of a tree.
struct Report {
    tree: TreeStats,
    /// Triangles that were not dropped.
    kept: u32,
    query_bytes: u64,
    block_width: u32,
    cost_ratio: f64,
    measured: Measured,
}

impl Report {
    fn describe(&self) -> String {
        format!(
            "\n{}\n{}\nLeaves by depth\n{}\nLeaves by number of references\n{}",
            self.describe_tree(),
            self.describe_rays(),
            bars(&self.by_depth()),
            bars(&self.by_size())
        )
    }

    fn describe_tree(&self) -> String {
        let tree = &self.tree;
        let per_triangle = |amount: u64| amount as f64 / f64::from(self.kept.max(1));
        let part = |part: usize, whole: usize| percent(part as f64, whole as f64);
        let rows = [
            ("interior nodes", grouped(tree.interior as u64), String::new()),
            (
                "leaves",
                grouped(tree.leaves as u64),
                format!(
                    "{} of them empty, {}",
                    grouped(tree.empty_leaves as u64),
                    part(tree.empty_leaves, tree.leaves)
                ),
            ),
            (
                "references",
                grouped(tree.references as u64),
                format!("{:.2} a triangle", tree.duplication(self.kept)),
            ),
            (
                "depth",
                tree.max_depth.to_string(),
                format!("{:.1} on average over the leaves", tree.mean_leaf_depth()),
            ),
            ("largest leaf", grouped(u64::from(tree.largest_leaf)), "references".to_owned()),
            (
                "tree",
                bytes(tree.bytes),
                format!("{:.1} bytes a triangle", per_triangle(tree.bytes)),
            ),
            (
                "query layout",
                bytes(self.query_bytes),
                format!("{:.1} bytes a triangle", per_triangle(self.query_bytes)),
            ),
        ];
        let mut text = String::from("Tree\n");
        for (name, value, more) in rows {
            let line = format!("  {name:<16}{value:>13}  {more}");
            text += line.trim_end();
            text.push('\n');
        }
        text
    }

    fn describe_rays(&self) -> String {
        let Measured { passing, closest } = self.measured;
        if passing.rays == 0 {
            return "No line meets the bounds: they have no area.\n".to_owned();
        }
        let blocks = format!("blocks of {}", self.block_width);
        let names = ["traversal steps", "leaves", "empty leaves", "triangle tests", &blocks];
        let (expected, rays) = (self.tree.expected, [passing, closest]);
        let [means, errors] = [rays.map(|t| t.mean()), rays.map(|t| t.standard_error())];
        let mut text = format!(
            "A random line through the bounds, mean of {}\n  {:16}{:>13}{:>22}{:>22}\n",
            grouped(passing.rays),
            "",
            "by SAH",
            "passing through",
            "to the closest hit"
        );
        for (k, name) in names.into_iter().enumerate() {
            let cell = |way: usize| {
                let (mean, error) = (means[way].to_array()[k], errors[way].to_array()[k]);
                format!("{mean:.2} ± {error:<6.3}")
            };
            let line = format!(
                "  {name:16}{:>13.2}{:>22}{:>22}",
                expected.to_array()[k],
                cell(0),
                cell(1)
            );
            text += line.trim_end();
            text.push('\n');
        }
        for (name, by_blocks) in [("cost, by tests", false), ("cost, by blocks", true)] {
            let [a, b, c] = [expected, means[0], means[1]].map(|counts| match by_blocks {
                true => counts.by_blocks(self.cost_ratio),
                false => counts.by_tests(self.cost_ratio),
            });
            // In the columns of the means above; their errors depend on one another.
            let _ = writeln!(text, "  {name:16}{a:>13.2}{b:>13.2}{c:>22.2}");
        }
        let hits = percent(closest.hits as f64, closest.rays as f64);
        text + &format!(
            "  {hits} of the lines hit. ± is one standard error; costs are in units of K_I, with K_T/K_I {}.\n",
            self.cost_ratio
        )
    }

    /// From the least depth with leaves to the greatest; more than 32 depths two, four... a row.
    fn by_depth(&self) -> Vec<(String, u64)> {
        let depths = &self.tree.leaves_by_depth[..=self.tree.max_depth as usize];
        let first = depths.iter().position(|&leaves| leaves > 0).unwrap_or(0);
        let width = (depths.len() - first).div_ceil(32).next_power_of_two();
        let rows = depths[first..].chunks(width).enumerate().map(|(row, leaves)| {
            let (from, to) = (first + row * width, first + row * width + leaves.len() - 1);
            let name = if from == to { from.to_string() } else { format!("{from}-{to}") };
            (name, leaves.iter().map(|&count| u64::from(count)).sum())
        });
        rows.collect()
    }

    /// Up to the last class that has leaves.
    fn by_size(&self) -> Vec<(String, u64)> {
        let sizes = &self.tree.leaf_sizes;
        let used = sizes.iter().rposition(|&leaves| leaves > 0).map_or(0, |last| last + 1);
        let rows = sizes[..used].iter().enumerate().map(|(class, &leaves)| {
            let [from, to] = leaf_sizes_of_class(class);
            let name = match (from, to) {
                (_, u32::MAX) => format!("{from} or more"),
                _ if from == to => from.to_string(),
                _ => format!("{from}-{to}"),
            };
            (name, u64::from(leaves))
        });
        rows.collect()
    }

    fn json(&self, build: BuildReport) -> JsonReport {
        let tree = &self.tree;
        let sizes = tree.leaf_sizes.iter().enumerate().filter(|(_, leaves)| **leaves > 0);
        JsonReport {
            build,
            interior: tree.interior,
            largest_leaf: tree.largest_leaf,
            mean_leaf_depth: tree.mean_leaf_depth(),
            duplication: tree.duplication(self.kept),
            block_cost: tree.block_cost,
            tree_bytes: tree.bytes,
            leaves_by_depth: tree.leaves_by_depth[..=tree.max_depth as usize].to_vec(),
            leaf_sizes: sizes
                .map(|(class, &leaves)| {
                    let [from, to] = leaf_sizes_of_class(class);
                    LeafSizes { from, to: (to < u32::MAX).then_some(to), leaves }
                })
                .collect(),
            expected: named(tree.expected),
            passing: Rays::of(&self.measured.passing),
            closest: Rays::of(&self.measured.closest),
        }
    }
}

#[derive(Serialize)]
struct JsonReport {
    #[serde(flatten)]
    build: BuildReport,
    interior: usize,
    largest_leaf: u32,
    mean_leaf_depth: f64,
    duplication: f64,
    block_cost: f64,
    tree_bytes: u64,
    leaves_by_depth: Vec<u32>,
    leaf_sizes: Vec<LeafSizes>,
    expected: Map<String, Value>,
    passing: Rays,
    closest: Rays,
}

/// Leaves of `from` to `to` references; no end where `to` is null.
#[derive(Serialize)]
struct LeafSizes {
    from: u32,
    to: Option<u32>,
    leaves: u32,
}

#[derive(Serialize)]
struct Rays {
    rays: u64,
    hits: u64,
    mean: Map<String, Value>,
    standard_error: Map<String, Value>,
}

impl Rays {
    fn of(tally: &Tally) -> Rays {
        let (mean, standard_error) = (named(tally.mean()), named(tally.standard_error()));
        Rays { rays: tally.rays, hits: tally.hits, mean, standard_error }
    }
}

fn named(cost: RayCost) -> Map<String, Value> {
    let names = RayCost::NAMES.iter().map(|&name| name.to_owned());
    names.zip(cost.to_array().map(Value::from)).collect()
}
