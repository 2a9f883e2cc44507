//! `splitplane query` of scenes of many objects.

use super::failure::Failure;
use super::hit_file::{self, Named};
use super::objects_built::{BuiltObjects, ObjectsReport};
use super::prepared::{counted, milliseconds, print_json};
use super::query_asked::{Asked, OfScene, accuracy_name};
use super::query_given::{Arguments, Kind, UndecidedName, median};
use super::{output, progress};
use serde::Serialize;
use splitplane::objects::{
    SceneAccelerator, SceneAllHitsOptions, SceneClosestPointOptions, SceneOptions, SceneReport,
};
use splitplane::{LocateOptions, QueryReport};
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    scene: ObjectsReport,
    rays: usize,
    hits: usize,
    kind: Kind,
    accuracy: &'static str,
    trace_ms: f64,
    mrays_per_s: f64,
    /// Instances entered by all rays together; null where that is not counted.
    entered: Option<u64>,
    /// Rays whose instances the CPU found for a device.
    placed_by_cpu: u64,
    answered_by_cpu: u64,
}

impl Asked<OfScene> {
    /// Traces once. Gives what is to be known of the answers, and whether instances that are entered are counted.
    fn trace(
        &mut self,
        scene: &dyn SceneAccelerator,
        options: &SceneOptions<'_>,
        max_memory: Option<u64>,
    ) -> Result<(SceneReport, bool), Failure> {
        let SceneOptions { accuracy, mask, watch, .. } = *options;
        let of = |report: QueryReport| {
            let mut all = SceneReport::default();
            all.geometries = report;
            (all, false)
        };
        let locate = LocateOptions { max_memory, watch };
        Ok(match self {
            Asked::Closest(rays, hits) => (scene.closest_hits(rays, hits, options)?, true),
            Asked::Any(rays, hits) => (scene.any_hits(rays, hits, options)?, true),
            Asked::All(rays, all) => {
                *all = None;
                let options = SceneAllHitsOptions { query: *options, max_memory };
                of(all.insert(scene.all_hits(rays, &options)?).report.clone())
            }
            Asked::Inside(points, located) => {
                *located = scene.locate(points, &locate)?;
                of(located.report.clone())
            }
            Asked::ClosestPoint { points, closest, signs, within } => {
                let (max_distance, ignore) = (*within, None);
                let options =
                    SceneClosestPointOptions { max_distance, accuracy, mask, ignore, watch };
                let mut report = scene.closest_points(points, closest, &options)?;
                if let Some(located) = signs {
                    *located = scene.locate(points, &locate)?;
                    report.append(located.report.clone(), 0)?;
                }
                of(report)
            }
        })
    }

    fn write(&self, path: &Path, built: &BuiltObjects) -> Result<Vec<PathBuf>, Failure> {
        let scene = &Named { scene: built.accelerator.scene(), table: &built.table };
        match self {
            Asked::Closest(_, hits) => hit_file::write_scene_closest(path, hits, scene)?,
            Asked::Any(_, hits) => hit_file::write_any(path, hits, &[])?,
            Asked::All(_, Some(all)) => {
                return Ok(hit_file::write_scene_all(path, all, scene)?.to_vec());
            }
            Asked::All(_, None) => return Ok(Vec::new()),
            Asked::Inside(_, located) => hit_file::write_inside(path, located)?,
            Asked::ClosestPoint { closest, signs, .. } => {
                hit_file::write_scene_closest_points(path, closest, signs.as_ref(), scene)?;
            }
        }
        Ok(vec![path.to_owned()])
    }
}

/// Answers a file's rays or points. To be called inside a pool.
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let common = &arguments.common;
    if arguments.undecided == UndecidedName::Flag {
        return Err(Failure::usage(
            "in a scene of many objects the CPU answers what a GPU leaves undecided; leave --undecided flag out",
        ));
    }
    if arguments.mask.is_some() && (arguments.kind == Kind::Inside || arguments.signed) {
        return Err(Failure::usage(
            "points are inside of the surfaces of all instances, whatever their masks; leave --mask out",
        ));
    }
    let mut asked = Asked::<OfScene>::read(arguments)?;
    let built = BuiltObjects::open(&arguments.scene, common)?;
    let watch = progress::watch(common.quiet);
    let options = SceneOptions {
        accuracy: common.query_options().accuracy,
        mask: arguments.mask.unwrap_or(u32::MAX),
        watch: Some(&watch),
        ..SceneOptions::default()
    };
    let (mut times, mut last, mut counts) = (Vec::new(), SceneReport::default(), false);
    for _ in 0..arguments.repeat {
        let start = Instant::now();
        (last, counts) = asked.trace(&*built.accelerator, &options, common.max_memory)?;
        times.push(milliseconds(start));
    }
    drop(watch);
    let written = match &arguments.hits {
        Some(path) => asked.write(path, &built)?,
        None => Vec::new(),
    };
    let trace_ms = median(&mut times);
    let accuracy = accuracy_name(arguments);
    let report = Report {
        scene: built.report(),
        rays: asked.count(),
        hits: asked.found(),
        kind: arguments.kind,
        accuracy,
        trace_ms,
        mrays_per_s: asked.count() as f64 / trace_ms.max(1e-6) / 1e3,
        entered: counts.then_some(last.entered),
        placed_by_cpu: last.placed_by_cpu,
        answered_by_cpu: last.geometries.answered_by_cpu,
    };
    if common.json {
        return print_json(&report);
    }
    if common.quiet {
        return Ok(());
    }
    let one = if arguments.kind.asks_points() { "point" } else { "ray" };
    let line = |path: &PathBuf| format!("written  {}\n", path.display());
    let entered = report.entered.map_or(String::new(), |all| format!(", {all} instances entered"));
    output::data(&format!(
        "{}traced   {} in {trace_ms:.2} ms ({:.1} million a second), accuracy {accuracy}: {} {}{entered}\n{}",
        built.describe(),
        counted(report.rays as u64, one),
        report.mrays_per_s,
        report.hits,
        arguments.kind.found(),
        written.iter().map(line).collect::<String>()
    ))
}
