//! What is said of a cloud.

use super::work::Work;
use crate::failure::Failure;
use crate::output;
use crate::prepared::{counted, print_json};
use serde::Serialize;
use splitplane::backend::OpenedEngine;
use splitplane::points::Axes;
use splitplane_scene::from_file::printable;
use std::path::{Path, PathBuf};

#[derive(Serialize)]
pub(super) struct PointsReport {
    cloud: String,
    points: usize,
    left_out: u32,
    /// Of the points that are kept; none where there are none.
    pub(super) bounds: Option<[[f32; 3]; 2]>,
    backend: String,
    adapter: Option<String>,
    reason: String,
    axes: &'static str,
    nodes: usize,
    bytes: u64,
    build_ms: f64,
    digest: String,
    pub(super) spacing: Option<Spacing>,
    pub(super) nearest: Option<Nearest>,
    pub(super) within: Option<Found>,
    pub(super) without_normal: Option<usize>,
    pub(super) outliers: Option<Outliers>,
    pub(super) thinned: Option<Thinned>,
    output: Vec<String>,
}

/// Distances from points to the nearest other one.
#[derive(Serialize)]
pub(super) struct Spacing {
    least: f32,
    mean: f64,
    pub(super) median: f32,
    greatest: f32,
    /// Points in the same place as another one.
    coincident: usize,
}

#[derive(Serialize)]
pub(super) struct Nearest {
    pub(super) queries: usize,
    pub(super) k: usize,
    pub(super) found: usize,
}

#[derive(Serialize)]
pub(super) struct Found {
    pub(super) queries: usize,
    pub(super) radius: f32,
    pub(super) found: usize,
}

#[derive(Serialize)]
pub(super) struct Outliers {
    /// The mean of all points' mean distances.
    pub(super) mean: f64,
    /// Points whose mean distance is greater are outliers.
    pub(super) beyond: f64,
    pub(super) found: usize,
}

#[derive(Serialize)]
pub(super) struct Thinned {
    pub(super) spacing: f32,
    pub(super) kept: usize,
}

impl PointsReport {
    /// What there is to say before anything is asked.
    pub(super) fn of(
        path: &Path,
        work: &Work<'_>,
        opened: &OpenedEngine,
        build_ms: f64,
    ) -> Result<PointsReport, Failure> {
        let (tree, info) = (work.tree.tree(), opened.engine.as_backend().describe());
        let finite = |point: &&[f32; 3]| point.iter().all(|x| x.is_finite());
        let mut bounds: Option<[[f32; 3]; 2]> = None;
        for point in work.points.iter().filter(finite) {
            let [lo, hi] = bounds.get_or_insert([*point; 2]);
            for axis in 0..3 {
                lo[axis] = lo[axis].min(point[axis]);
                hi[axis] = hi[axis].max(point[axis]);
            }
        }
        Ok(PointsReport {
            cloud: path.display().to_string(),
            points: work.points.len(),
            left_out: tree.report().dropped,
            bounds,
            backend: info.name,
            adapter: info.adapter,
            reason: opened.reason.clone(),
            axes: if tree.axes() == Axes::Cycle { "cycle" } else { "widest" },
            nodes: tree.nodes().len(),
            bytes: work.tree.bytes(),
            build_ms,
            digest: tree.digest().to_string(),
            spacing: spacing(work)?,
            nearest: None,
            within: None,
            without_normal: None,
            outliers: None,
            thinned: None,
            output: Vec::new(),
        })
    }

    pub(super) fn tell(
        mut self,
        json: bool,
        quiet: bool,
        written: &[PathBuf],
    ) -> Result<(), Failure> {
        self.output = written.iter().map(|path| path.display().to_string()).collect();
        if json {
            return print_json(&self);
        }
        if quiet { Ok(()) } else { output::data(&self.text()) }
    }

    fn text(&self) -> String {
        let PointsReport { cloud, points, left_out, axes, nodes, bytes, digest, .. } = self;
        let place = match &self.adapter {
            Some(adapter) => format!("{} on {}", self.backend, printable(adapter)),
            None => self.backend.clone(),
        };
        let mut text = format!(
            "cloud    {}: {}, {left_out} left out\n",
            printable(cloud),
            counted(*points as u64, "point"),
        );
        if let Some([[x, y, z], [u, v, w]]) = self.bounds {
            text += &format!("bounds   {x} {y} {z} to {u} {v} {w}\n");
        }
        text += &format!(
            "tree     {nodes} nodes, axes {axes}, {:.1} MB, built in {:.2} ms by {place}, digest {digest}\n",
            *bytes as f64 / 1e6,
            self.build_ms
        );
        if let Some(Spacing { least, mean, median, greatest, coincident }) = &self.spacing {
            text += &format!(
                "spacing  to the nearest other point: median {median}, mean {mean:.6}, {least} to {greatest}; {} in the place of another\n",
                counted(*coincident as u64, "point")
            );
        }
        if let Some(Nearest { queries, k, found }) = self.nearest {
            let queries = counted(queries as u64, "query").replace("querys", "queries");
            text += &format!("nearest  {k} of {queries}: {found} found\n");
        }
        if let Some(Found { queries, radius, found }) = self.within {
            let queries = counted(queries as u64, "query").replace("querys", "queries");
            text += &format!("within   {radius} of {queries}: {found} found\n");
        }
        if let Some(without) = self.without_normal {
            text += &format!("normals  {} without\n", counted(without as u64, "point"));
        }
        if let Some(Outliers { mean, beyond, found }) = self.outliers {
            text += &format!(
                "outliers {found}: farther than {beyond:.6} on average, the mean is {mean:.6}\n"
            );
        }
        if let Some(Thinned { spacing, kept }) = self.thinned {
            text += &format!("thinned  to {spacing}: {} kept\n", counted(kept as u64, "point"));
        }
        for path in &self.output {
            text += &format!("written  {}\n", printable(path));
        }
        text
    }
}

/// Distances to the nearest other point; `None` for fewer than two points.
fn spacing(work: &Work<'_>) -> Result<Option<Spacing>, Failure> {
    let mut all =
        work.map("spacing", work.points, (2, f32::INFINITY), f32::NAN, |_, found| match found {
            [_, other] => other.distance_squared.sqrt() as f32,
            _ => f32::NAN,
        })?;
    all.retain(|distance| !distance.is_nan());
    if all.is_empty() {
        return Ok(None);
    }
    all.sort_unstable_by(f32::total_cmp);
    let sum: f64 = all.iter().map(|&own| f64::from(own)).sum();
    Ok(Some(Spacing {
        least: all[0],
        mean: sum / all.len() as f64,
        median: all[all.len() / 2],
        greatest: all[all.len() - 1],
        coincident: all.iter().filter(|&&own| own == 0.0).count(),
    }))
}
