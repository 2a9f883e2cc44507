//! The report's tables: one for programs with all figures, the others for readers.

use super::document::Trade;
use super::interval::Interval;
use super::payback::{Payback, count};
use super::recommend::short;
use super::row::{Aims, Apart, Errors, Row, Sets};
use crate::paper::table::{Cell, Table};

/// Kinds of answers whose distances are held against the exact ones, as tables name them.
const APART: [&str; 4] = ["same triangle", "other triangle", "rounded", "wrong"];

/// These kinds, over all kinds of rays.
fn apart(row: &Row) -> [Apart; 4] {
    let sum = |of: fn(&Errors) -> Apart| {
        row.errors.each().into_iter().map(of).fold(Apart::default(), Apart::and)
    };
    [
        sum(|errors| errors.same),
        sum(|errors| errors.other),
        sum(|errors| errors.outline),
        sum(|errors| errors.off),
    ]
}

impl Trade {
    /// A line each setting, all figures.
    pub fn table(&self) -> Table {
        let mut table = Table::new(&[
            "row",
            "setting",
            "preset",
            "knob",
            "layout",
            "also",
            "accuracy",
            "backend",
            "threads",
            "build_ms",
            "build_least_ms",
            "build_low_ms",
            "build_high_ms",
            "primary_ns",
            "shadow_ns",
            "bounce_ns",
            "random_ns",
            "ns_per_ray",
            "ns_low",
            "ns_high",
            "measured_again",
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
            "primary_missing_per_million",
            "primary_wrong_per_million",
            "primary_phantom_per_million",
            "bounce_missing_per_million",
            "bounce_wrong_per_million",
            "bounce_phantom_per_million",
            "shadow_missing_per_million",
            "shadow_wrong_per_million",
            "shadow_phantom_per_million",
            "same_triangle_answers",
            "same_triangle_apart_mean",
            "same_triangle_apart_greatest",
            "other_triangle_answers",
            "other_triangle_apart_mean",
            "other_triangle_apart_greatest",
            "rounded_answers",
            "rounded_apart_mean",
            "rounded_apart_greatest",
            "wrong_answers",
            "wrong_apart_mean",
            "wrong_apart_greatest",
            "errors_per_million",
            "unaimed_errors_per_million",
            "rounded_per_million",
            "redone_per_million",
            "pays_back",
            "pays_back_rays",
            "pays_back_rays_low",
            "pays_back_rays_high",
            "field",
            "pareto",
            "tree",
            "digest",
        ]);
        for row in &self.rows {
            table.push(cells(row));
        }
        table
    }

    pub(super) fn steps_table(&self) -> Table {
        let mut table = Table::new(&["from rays a build", "row", "setting"]);
        for step in &self.steps {
            let title = self.row(step.row).map_or(String::new(), Row::title);
            table.push(vec![count(step.from_rays).into(), step.row.into(), title.into()]);
        }
        table
    }

    pub(super) fn summary(&self) -> Table {
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
            "not aimed",
            "rounded / M",
            "pays",
        ]);
        for row in &self.rows {
            let [primary, shadow, bounce, random] =
                row.trace.each().map(|trace| Cell::number(trace.ns, 0));
            table.push(vec![
                row.number.into(),
                row.title_with_others().into(),
                row.pareto.mark().into(),
                around(row.build_ms, row.build_interval),
                primary,
                shadow,
                bounce,
                random,
                around(row.ns_per_ray, row.ns_interval),
                short(row.query_bytes as f64 / 1e6).into(),
                short(row.peak_bytes as f64 / 1e6).into(),
                Cell::Number(row.sah_cost, 2),
                Cell::Number(row.block_cost, 2),
                Cell::Number(row.errors_per_million, 1),
                Cell::Number(row.unaimed_errors_per_million, 1),
                Cell::Number(row.rounded_per_million, 1),
                row.payback.words().into(),
            ]);
        }
        table
    }

    /// Errors by kind of ray. Of rows with equal figures the first stands for all.
    pub(super) fn errors(&self) -> Table {
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
        let mut told: Vec<&Aims<Errors>> = Vec::new();
        for row in &self.rows {
            if told.contains(&&row.errors) {
                continue;
            }
            told.push(&row.errors);
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

    /// How far off answers are. Of rows with equal figures the first stands for all.
    pub(super) fn sizes(&self) -> Table {
        let head = ["row", "setting", "answers", "count", "off by, mean", "off by at most"];
        let mut table = Table::new(&head);
        let mut told: Vec<[Apart; 4]> = Vec::new();
        for row in &self.rows {
            let own = apart(row);
            if told.contains(&own) {
                continue;
            }
            for (what, apart) in APART.into_iter().zip(own).filter(|(_, apart)| apart.answers > 0) {
                table.push(vec![
                    row.number.into(),
                    row.title().into(),
                    what.into(),
                    Cell::Count(apart.answers),
                    small(apart.mean),
                    small(apart.greatest),
                ]);
            }
            told.push(own);
        }
        table
    }
}

/// A number that may be far below 1.
fn small(value: f64) -> Cell {
    if value == 0.0 { "0".into() } else { format!("{value:.1e}").into() }
}

/// A median with its interval.
fn around(value: f64, Interval { low, high }: Interval) -> Cell {
    format!("{} ({} to {})", short(value), short(low), short(high)).into()
}

fn cells(row: &Row) -> Vec<Cell> {
    let mut out: Vec<Cell> = vec![
        row.number.into(),
        row.name.as_str().into(),
        row.preset.as_str().into(),
        row.knob.as_deref().map_or(Cell::Missing, Cell::from),
        row.layout.as_str().into(),
        row.also.join("; ").into(),
        row.accuracy.as_str().into(),
        row.backend.as_str().into(),
        row.threads.map_or(Cell::Missing, Cell::from),
        Cell::Number(row.build_ms, 3),
        Cell::Number(row.least_build_ms, 3),
        Cell::Number(row.build_interval.low, 3),
        Cell::Number(row.build_interval.high, 3),
    ];
    let times: &Sets<_> = &row.trace;
    out.extend(times.each().map(|trace| Cell::number(trace.ns, 1)));
    out.extend([
        Cell::Number(row.ns_per_ray, 1),
        Cell::Number(row.ns_interval.low, 1),
        Cell::Number(row.ns_interval.high, 1),
        row.again.into(),
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
        Payback::After { rays, within } => ("after", Some([rays, within[0], within[1]])),
        Payback::Until { rays, within } => ("until", Some([rays, within[0], within[1]])),
        Payback::Never => ("never", None),
        Payback::Alike => ("alike", None),
        Payback::Unknown => ("unknown", None),
    };
    for apart in apart(row) {
        out.extend([
            Cell::Count(apart.answers),
            Cell::Number(apart.mean, 9),
            Cell::Number(apart.greatest, 9),
        ]);
    }
    out.extend([
        Cell::Number(row.errors_per_million, 1),
        Cell::Number(row.unaimed_errors_per_million, 1),
        Cell::Number(row.rounded_per_million, 1),
        Cell::Number(row.redone_per_million, 1),
        kind.into(),
        Cell::number(rays.map(|rays| rays[0]), 0),
        Cell::number(rays.map(|rays| rays[1]), 0),
        Cell::number(rays.map(|rays| rays[2]), 0),
        row.field.as_str().into(),
        row.pareto.name().into(),
        row.tree.as_str().into(),
        row.digest.as_str().into(),
    ]);
    out
}
