//! `splitplane query`.

use super::failure::Failure;
use super::prepared::{Prepared, counted, in_pool, milliseconds, print_json};
use super::query_asked::{Asked, OfMesh, accuracy_name};
pub(super) use super::query_given::Arguments;
use super::query_given::{Kind, UndecidedName, median};
use super::{hit_file, output, progress, query_objects};
use serde::Serialize;
use splitplane::scene::InstancedScene;
use splitplane::{
    Accelerator, AllHitsOptions, ClosestPointOptions, Hit, LocateOptions, QueryOptions, Undecided,
};
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Serialize)]
struct QueryReport {
    rays: usize,
    hits: usize,
    kind: Kind,
    accuracy: &'static str,
    build_ms: f64,
    trace_ms: f64,
    mrays_per_s: f64,
    undecided: u64,
    undecided_share: f64,
    flagged: usize,
    answered_by_cpu: u64,
    digest: String,
}

impl Asked<OfMesh> {
    /// Traces once. Gives what is to be known of the answers.
    fn trace(
        &mut self,
        accelerator: &dyn Accelerator,
        options: &QueryOptions<'_>,
        max_memory: Option<u64>,
    ) -> Result<splitplane::QueryReport, Failure> {
        let QueryOptions { accuracy, culling, ignore, watch, .. } = *options;
        Ok(match self {
            Asked::Closest(rays, hits) => accelerator.closest_hits(rays, hits, options)?,
            Asked::Any(rays, hits) => accelerator.any_hits(rays, hits, options)?,
            Asked::All(rays, all) => {
                let options = AllHitsOptions { culling, ignore, max_memory, watch };
                *all = None;
                all.insert(accelerator.all_hits(rays, &options)?).report.clone()
            }
            Asked::Inside(points, located) => {
                *located = accelerator.locate(points, &LocateOptions { max_memory, watch })?;
                located.report.clone()
            }
            Asked::ClosestPoint { points, closest, signs, within } => {
                let options =
                    ClosestPointOptions { max_distance: *within, accuracy, ignore, watch };
                let mut report = accelerator.closest_points(points, closest, &options)?;
                if let Some(located) = signs {
                    *located = accelerator.locate(points, &LocateOptions { max_memory, watch })?;
                    report.append(located.report.clone(), 0)?;
                }
                report
            }
        })
    }

    fn write(&self, path: &Path, flagged: &[usize]) -> Result<Vec<PathBuf>, Failure> {
        match self {
            Asked::Closest(_, hits) => hit_file::write_closest(path, hits)?,
            Asked::Any(_, hits) => hit_file::write_any(path, hits, flagged)?,
            Asked::All(_, Some(all)) => return Ok(hit_file::write_all(path, all)?.to_vec()),
            Asked::All(_, None) => return Ok(Vec::new()),
            Asked::Inside(_, located) => hit_file::write_inside(path, located)?,
            Asked::ClosestPoint { closest, signs, .. } => {
                hit_file::write_closest_points(path, closest, signs.as_ref())?;
            }
        }
        Ok(vec![path.to_owned()])
    }

    /// What stands in the place of a flagged ray is no answer.
    fn forget(&mut self, flagged: &[usize]) {
        for &place in flagged {
            match self {
                Asked::Closest(_, hits) => hits[place] = Hit::MISS,
                Asked::Any(_, hits) => hits[place] = false,
                Asked::All(..) | Asked::Inside(..) | Asked::ClosestPoint { .. } => {}
            }
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let common = &arguments.common;
    in_pool(common, || {
        if InstancedScene::is_named_by(&arguments.scene) {
            return query_objects::run(arguments);
        }
        if arguments.mask.is_some() {
            return Err(Failure::usage(
                "--mask is for scenes of many objects: one mesh has no instances",
            ));
        }
        let mut asked = Asked::<OfMesh>::read(arguments)?;
        let announced = match arguments.kind.asks_points() {
            true => Err("--preset auto chooses for rays, not for points; name a preset"),
            false => Ok(asked.count() as u64 * u64::from(arguments.repeat)),
        };
        let prepared = Prepared::open(&arguments.scene, common, announced)?;
        let undecided = match arguments.undecided {
            UndecidedName::Redo => Undecided::Redo,
            UndecidedName::Flag => Undecided::Flag,
        };
        let watch = progress::watch(common.quiet);
        let options = QueryOptions { undecided, watch: Some(&watch), ..common.query_options() };
        let mut times = Vec::new();
        let mut last = splitplane::QueryReport::default();
        for _ in 0..arguments.repeat {
            let start = Instant::now();
            last = asked.trace(&*prepared.accelerator, &options, common.max_memory)?;
            times.push(milliseconds(start));
        }
        drop(watch);
        let written = match &arguments.hits {
            Some(path) => asked.write(path, &last.flagged)?,
            None => Vec::new(),
        };
        asked.forget(&last.flagged);
        let trace_ms = median(&mut times);
        let report = QueryReport {
            rays: asked.count(),
            hits: asked.found(),
            kind: arguments.kind,
            accuracy: accuracy_name(arguments),
            build_ms: prepared.build_ms,
            trace_ms,
            mrays_per_s: asked.count() as f64 / trace_ms.max(1e-6) / 1e3,
            undecided: last.undecided,
            undecided_share: last.undecided as f64 / asked.count().max(1) as f64,
            flagged: last.flagged.len(),
            answered_by_cpu: last.answered_by_cpu,
            digest: prepared.accelerator.tree().digest().to_string(),
        };
        let one = if arguments.kind.asks_points() { "point" } else { "ray" };
        if report.undecided > 0 && !common.quiet {
            let what = if report.flagged > 0 { "they have no answer" } else { "the CPU did" };
            output::note(&format!(
                "note: the device could not decide {} exactly, a share of {:.1e}; {what}",
                counted(report.undecided, one),
                report.undecided_share
            ));
        }
        if last.unfinished > 0 && !common.quiet {
            output::note(&format!(
                "note: the driver did not follow {} to the end; the CPU answered instead",
                counted(last.unfinished, one)
            ));
        }
        if common.json {
            return print_json(&report);
        }
        if common.quiet {
            return Ok(());
        }
        let found = arguments.kind.found();
        let line = |path: &PathBuf| format!("written  {}\n", path.display());
        output::data(&format!(
            "{}traced   {} in {trace_ms:.2} ms ({:.1} million a second), accuracy {}: {} {found}\n{}",
            prepared.built().describe(),
            counted(report.rays as u64, one),
            report.mrays_per_s,
            report.accuracy,
            report.hits,
            written.iter().map(line).collect::<String>()
        ))
    })
}
