//! What was measured and what follows from it, as JSON, CSV and Markdown.

use super::bvh::{self, Verdict};
use super::held::Held;
use super::measure::Measured;
use super::pareto;
use super::payback::{Payback, count};
use super::recommend::{self, Recommendation, Step, Wish};
use super::row::{Aims, Row, Sets};
use crate::report::machine::Machine;
use crate::report::table::{Cell, Table};
use serde::{Deserialize, Serialize};

/// The one version of the file's format.
pub const FORMAT: u32 = 2;
/// The field of rows that use all threads, or a device.
pub const ALL_THREADS: &str = "all";
/// The field of rows of one thread, where others use more.
pub const ONE_THREAD: &str = "one thread";

/// The scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Subject {
    /// As it was asked for.
    pub spec: String,
    /// Its name.
    pub name: String,
    /// Triangles.
    pub triangles: usize,
    /// A name of its corners.
    pub mesh: String,
}

/// How much was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Amounts {
    /// Rounds of which medians and minima are given.
    pub repeat: usize,
    /// Most rays of a timed set on the CPU.
    pub sample_rays: usize,
    /// The same on a GPU.
    pub gpu_sample_rays: usize,
    /// Rays of each kind that were judged on the CPU.
    pub error_rays: u64,
    /// The same on a GPU.
    pub gpu_error_rays: u64,
    /// The name of the timed rays.
    pub rays: String,
}

/// A report on a scene.
#[derive(Clone, Debug, Serialize)]
pub struct Trade {
    /// [`FORMAT`].
    pub format: u32,
    /// On what it was measured.
    pub machine: Machine,
    /// The scene.
    pub scene: Subject,
    /// How much was measured.
    pub amounts: Amounts,
    /// What the independent reference says of the exact answers.
    pub held: Held,
    /// A row each setting.
    pub rows: Vec<Row>,
    /// Which row to take for how many rays a build, by the wish's accuracy and errors.
    pub steps: Vec<Step>,
    /// What to take for the wish.
    pub recommendation: Recommendation,
    /// When another structure would likely serve better.
    pub bvh: Option<Verdict>,
    /// Settings that were not measured, a sentence each.
    pub left_out: Vec<String>,
}

impl Trade {
    /// Draws the conclusions from what was measured.
    pub fn of(
        spec: String,
        (name, triangles): (String, usize),
        machine: Machine,
        measured: Measured,
        wish: &Wish,
        left_out: Vec<String>,
    ) -> Trade {
        let Measured { budget, mut rows, held, rays, mesh, .. } = measured;
        conclude(&mut rows);
        let amounts = Amounts {
            repeat: budget.repeat,
            sample_rays: budget.cpu.sample_rays,
            gpu_sample_rays: budget.gpu.sample_rays,
            error_rays: budget.cpu.error_rays,
            gpu_error_rays: budget.gpu.error_rays,
            rays,
        };
        let bvh = bvh::judge(&rows, wish);
        Trade {
            format: FORMAT,
            machine,
            scene: Subject { spec, name, triangles, mesh },
            amounts,
            held,
            steps: recommend::steps(&rows, wish),
            recommendation: recommend::recommend(&rows, wish),
            bvh,
            rows,
            left_out,
        }
    }

    /// A line each setting, all figures.
    pub fn table(&self) -> Table {
        let mut table = Table::new(&[
            "row",
            "setting",
            "preset",
            "knob",
            "accuracy",
            "backend",
            "threads",
            "build_ms",
            "build_least_ms",
            "primary_ns",
            "shadow_ns",
            "bounce_ns",
            "random_ns",
            "ns_per_ray",
            "query_bytes",
            "peak_bytes",
            "sah_cost",
            "block_cost",
            "nodes",
            "references",
            "depth",
            "random_missing_per_million",
            "random_wrong_per_million",
            "random_phantom_per_million",
            "edge_missing_per_million",
            "edge_wrong_per_million",
            "edge_phantom_per_million",
            "vertex_missing_per_million",
            "vertex_wrong_per_million",
            "vertex_phantom_per_million",
            "shadow_missing_per_million",
            "shadow_wrong_per_million",
            "shadow_phantom_per_million",
            "errors_per_million",
            "rounded_per_million",
            "redone_per_million",
            "pays_back",
            "pays_back_rays",
            "field",
            "pareto",
            "digest",
        ]);
        for row in &self.rows {
            table.push(cells(row));
        }
        table
    }

    /// The text, with tables and plots.
    pub fn markdown(&self, plots: &[(&str, &str)]) -> String {
        let mut out = format!(
            "# Settings for `{}`: what they cost and what they get wrong\n\n{} triangles.\n\n{}",
            self.scene.name,
            self.scene.triangles,
            self.machine.markdown()
        );
        out += &format!(
            "- times: medians of {} rounds, in each of which every setting takes its turn; up to {} rays \
             of each kind\n- errors: {} random, edge-aimed and vertex-aimed rays each and up to as many \
             shadow rays, against the exact answers\n- exact answers: {}\n",
            self.amounts.repeat,
            self.amounts.sample_rays,
            self.amounts.error_rays,
            self.held.words()
        );
        if self.amounts.repeat < 3 {
            out += "\n**So few rounds are no measurement: the times only show that the program works.**\n";
        }
        for sentence in &self.left_out {
            out += &format!("\nLeft out: {sentence}.\n");
        }
        out += &format!("\n## Recommendation\n\n{}\n\n", self.recommendation.words);
        out += &self.steps_table().markdown();
        if let Some(bvh) = &self.bvh {
            out += &format!("\n{}\n", bvh.words);
        }
        for (file, caption) in plots {
            out += &format!("\n## {caption}\n\n![{caption}]({file})\n");
        }
        out += "\n## All settings\n\n\
                *opt* marks rows that no row of the same field beats in build time, ns a ray, memory, \
                errors and rounded answers at once. ns a ray: the mean over primary, shadow, bounce and random rays. SAH \
                costs are at the K_T, K_I and W of preset fast for all rows. Errors: missing, wrong and \
                phantom hits a million rays, over random, edge-aimed, vertex-aimed and shadow rays; rounded are \
                answers that differ from the exact ones within rounding, which are no errors. *pays* is after how many rays a build it \
                costs less than preset fast at the same accuracy, backend and threads.\n\n";
        out += &self.summary().markdown();
        out += "\n## Errors by kind of ray\n\n";
        out += &self.errors().markdown();
        out
    }

    fn steps_table(&self) -> Table {
        let mut table = Table::new(&["from rays a build", "row", "setting"]);
        for step in &self.steps {
            let title = self.row(step.row).map_or(String::new(), Row::title);
            table.push(vec![count(step.from_rays).into(), step.row.into(), title.into()]);
        }
        table
    }

    /// A row by its number.
    pub fn row(&self, number: usize) -> Option<&Row> {
        self.rows.iter().find(|row| row.number == number)
    }

    fn summary(&self) -> Table {
        let mut table = Table::new(&[
            "row",
            "setting",
            "opt",
            "build ms",
            "primary",
            "shadow",
            "bounce",
            "random",
            "ns a ray",
            "MB",
            "peak MB",
            "SAH cost",
            "block cost",
            "errors / M",
            "rounded / M",
            "pays",
        ]);
        for row in &self.rows {
            let [primary, shadow, bounce, random] =
                row.trace.each().map(|trace| Cell::number(trace.ns, 0));
            table.push(vec![
                row.number.into(),
                row.title().into(),
                if row.pareto { "opt" } else { "" }.into(),
                Cell::Number(row.build_ms, 2),
                primary,
                shadow,
                bounce,
                random,
                Cell::Number(row.ns_per_ray, 0),
                Cell::Number(row.query_bytes as f64 / 1e6, 2),
                Cell::Number(row.peak_bytes as f64 / 1e6, 2),
                Cell::Number(row.sah_cost, 2),
                Cell::Number(row.block_cost, 2),
                Cell::Number(row.errors_per_million, 1),
                Cell::Number(row.rounded_per_million, 1),
                row.payback.words().into(),
            ]);
        }
        table
    }

    fn errors(&self) -> Table {
        let mut table = Table::new(&[
            "row",
            "setting",
            "rays",
            "judged",
            "missing / M",
            "wrong / M",
            "phantom / M",
            "rounded / M",
        ]);
        for row in &self.rows {
            for (kind, errors) in Aims::<()>::NAMES.into_iter().zip(row.errors.each()) {
                let rate = |count| Cell::Number(errors.per_million(count), 1);
                table.push(vec![
                    row.number.into(),
                    row.title().into(),
                    kind.into(),
                    Cell::Count(errors.rays),
                    rate(errors.missing),
                    rate(errors.wrong),
                    rate(errors.phantom),
                    rate(errors.rounded),
                ]);
            }
        }
        table
    }
}

/// Marks fields, optimal rows, and when each pays back.
pub fn conclude(rows: &mut [Row]) {
    let most = rows.iter().filter_map(|row| row.threads).max().unwrap_or(1);
    for row in rows.iter_mut() {
        let single = row.threads == Some(1) && most > 1;
        row.field = if single { ONE_THREAD } else { ALL_THREADS }.to_owned();
    }
    let point = |row: &Row| {
        let bytes = row.query_bytes as f64;
        [row.build_ms, row.ns_per_ray, bytes, row.errors_per_million, row.rounded_per_million]
    };
    for field in [ALL_THREADS, ONE_THREAD] {
        let places: Vec<usize> = (0..rows.len()).filter(|&i| rows[i].field == field).collect();
        let points: Vec<[f64; 5]> = places.iter().map(|&i| point(&rows[i])).collect();
        for (place, optimal) in places.into_iter().zip(pareto::optimal(&points)) {
            rows[place].pareto = optimal;
        }
    }
    let base = |row: &Row| {
        rows.iter().find(|other| {
            other.name == "fast"
                && other.accuracy == row.accuracy
                && other.backend == row.backend
                && other.threads == row.threads
        })
    };
    let paybacks: Vec<Payback> = rows
        .iter()
        .map(|row| match base(row) {
            None => Payback::Unknown,
            Some(base) if base.number == row.number => Payback::Base,
            Some(base) => Payback::of(row.line(), base.line()),
        })
        .collect();
    for (row, payback) in rows.iter_mut().zip(paybacks) {
        row.payback = payback;
    }
}

fn cells(row: &Row) -> Vec<Cell> {
    let mut out: Vec<Cell> = vec![
        row.number.into(),
        row.name.as_str().into(),
        row.preset.as_str().into(),
        row.knob.as_deref().map_or(Cell::Missing, Cell::from),
        row.accuracy.as_str().into(),
        row.backend.as_str().into(),
        row.threads.map_or(Cell::Missing, Cell::from),
        Cell::Number(row.build_ms, 3),
        Cell::Number(row.least_build_ms, 3),
    ];
    let times: &Sets<_> = &row.trace;
    out.extend(times.each().map(|trace| Cell::number(trace.ns, 1)));
    out.extend([
        Cell::Number(row.ns_per_ray, 1),
        Cell::Count(row.query_bytes),
        Cell::Count(row.peak_bytes),
        Cell::Number(row.sah_cost, 3),
        Cell::Number(row.block_cost, 3),
        row.nodes.into(),
        row.references.into(),
        row.depth.into(),
    ]);
    for errors in row.errors.each() {
        let counts = [errors.missing, errors.wrong, errors.phantom];
        out.extend(counts.map(|count| Cell::Number(errors.per_million(count), 1)));
    }
    let (kind, rays) = match row.payback {
        Payback::Base => ("base", None),
        Payback::Always => ("always", None),
        Payback::After { rays } => ("after", Some(rays)),
        Payback::Until { rays } => ("until", Some(rays)),
        Payback::Never => ("never", None),
        Payback::Unknown => ("unknown", None),
    };
    out.extend([
        Cell::Number(row.errors_per_million, 1),
        Cell::Number(row.rounded_per_million, 1),
        Cell::Number(row.redone_per_million, 1),
        kind.into(),
        Cell::number(rays, 0),
        row.field.as_str().into(),
        if row.pareto { "yes" } else { "no" }.into(),
        row.digest.as_str().into(),
    ]);
    out
}
