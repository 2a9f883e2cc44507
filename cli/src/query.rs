//! `splitplane query`.

use super::failure::Failure;
use super::options::{Common, distance};
use super::prepared::{Prepared, counted, in_pool, milliseconds, print_json};
use super::{files, hit_file, output, progress, query_objects, ray_file};
use clap::{Args, ValueEnum};
use serde::Serialize;
use splitplane::scene::InstancedScene;
use splitplane::{
    Accelerator, AllHits, AllHitsOptions, ClosestPoint, ClosestPointOptions, Hit, LocateOptions,
    Located, Location, QueryError, QueryOptions, Ray, Rule, Undecided,
};
use splitplane_scene::from_file::quoted_path;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// An .obj, .ply, .stl, .gltf or .glb file, a .json or .scene file of many objects, or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE")]
    pub(super) scene: OsString,
    /// The rays: raw little-endian f32 `ox oy oz dx dy dz tmin tmax`, or .npy of shape (n, 8)
    #[arg(long, value_name = "FILE", required_unless_present = "points")]
    rays: Option<PathBuf>,
    /// The points of --kind inside and closest-point: raw little-endian f32 `x y z`, or .npy of shape (n, 3)
    #[arg(long, value_name = "FILE", conflicts_with = "rays")]
    points: Option<PathBuf>,
    /// What to find
    #[arg(long, value_enum, default_value_t = Kind::Closest)]
    pub(super) kind: Kind,
    /// Write the answers to this file, .npy or raw: records of f32 t, u32 triangle, f32 u, f32 v
    /// for closest; one byte for any; for all the same records with a u32 behind them, 1 where the ray comes
    /// from the front, and in a second file, .starts before its ending, where each ray's begin, u64; for
    /// inside one byte, 0 outside, 1 inside, 2 on a triangle; for closest-point records of f32 distance, u32
    /// triangle, f32 u, f32 v, f32 x, f32 y, f32 z. Of scenes of many objects u32 geometry, instance and id
    /// (the user's number of the instance) stand behind each record
    #[arg(long, value_name = "FILE")]
    pub(super) hits: Option<PathBuf>,
    /// Of scenes of many objects only instances answer that have a bit of these in their mask, decimal or 0x...;
    /// all bits when left out
    #[arg(long, value_name = "BITS", value_parser = mask)]
    pub(super) mask: Option<u32>,
    /// The greatest distance of --kind closest-point; no limit when left out
    #[arg(long, value_name = "DISTANCE", value_parser = distance)]
    max_distance: Option<f32>,
    /// Distances of --kind closest-point are negative for points inside a closed surface
    #[arg(long)]
    pub(super) signed: bool,
    /// What becomes of rays that a GPU cannot decide within its bounds of error, under `--accuracy exact`
    #[arg(long, value_enum, default_value_t = UndecidedName::Redo)]
    pub(super) undecided: UndecidedName,
    /// Trace so many times and report the median
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(super) repeat: u32,
    #[command(flatten)]
    pub(super) common: Common,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Kind {
    /// The nearest hit
    Closest,
    /// Whether there is a hit at all
    Any,
    /// Every crossing of a surface, in order, once even where it is met at an edge or a vertex
    All,
    /// Whether points lie inside a closed surface, exactly
    Inside,
    /// The closest point of the mesh to each point
    ClosestPoint,
}

impl Kind {
    /// Whether it asks about points, not rays.
    pub(super) fn asks_points(self) -> bool {
        matches!(self, Kind::Inside | Kind::ClosestPoint)
    }

    /// What its answers are, in words.
    pub(super) const fn found(self) -> &'static str {
        match self {
            Kind::Closest | Kind::Any => "hit",
            Kind::All => "crossings",
            Kind::Inside => "inside",
            Kind::ClosestPoint => "with a closest point",
        }
    }
}

/// Bits of a mask.
fn mask(text: &str) -> Result<u32, String> {
    let number = match text.strip_prefix("0x").or(text.strip_prefix("0X")) {
        Some(digits) => u32::from_str_radix(digits, 16),
        None => text.parse(),
    };
    number.map_err(|_| "give a number of 32 bits, such as 5 or 0xff".to_owned())
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum UndecidedName {
    /// The CPU traces them again
    Redo,
    /// They have no answer: triangle 4294967293, or byte 255 for any
    Flag,
}

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

/// What is asked, and what came back.
enum Asked {
    Closest(Vec<Ray>, Vec<Hit>),
    Any(Vec<Ray>, Vec<bool>),
    All(Vec<Ray>, AllHits),
    Inside(Vec<[f32; 3]>, Located),
    /// Where signs are asked for, with where the points lie.
    ClosestPoint {
        points: Vec<[f32; 3]>,
        closest: Vec<ClosestPoint>,
        signs: Option<Located>,
        within: f32,
    },
}

/// Room for so many answers.
pub(super) fn answers<T: Clone>(count: usize, none: T) -> Result<Vec<T>, QueryError> {
    let (mut answers, needed) = (Vec::new(), (count * size_of::<T>()) as u64);
    let refused = |_| QueryError::OutOfMemory { needed, limit: needed };
    answers.try_reserve_exact(count).map_err(refused)?;
    answers.resize(count, none);
    Ok(answers)
}

/// What a file gives to ask about.
pub(super) enum Given {
    Rays(Vec<Ray>),
    Points(Vec<[f32; 3]>),
}

impl Given {
    /// Checks what does not fit together, and reads the file.
    pub(super) fn read(arguments: &Arguments) -> Result<Given, Failure> {
        if let (Kind::All, Some(path)) = (arguments.kind, &arguments.hits)
            && files::is_stream(path)
        {
            return Err(Failure::usage(format!(
                "all hits are two files, which `{}` cannot be; give --hits the name of a file",
                quoted_path(path)
            )));
        }
        let kind = arguments.kind;
        let points = kind.asks_points();
        if kind != Kind::ClosestPoint && (arguments.signed || arguments.max_distance.is_some()) {
            return Err(Failure::usage("--signed and --max-distance are for --kind closest-point"));
        }
        let file = if points { &arguments.points } else { &arguments.rays };
        let Some(file) = file else {
            return Err(Failure::usage(if points {
                "--kind inside and closest-point ask about points; give them by --points"
            } else {
                "points are for --kind inside and closest-point; give rays by --rays"
            }));
        };
        let limit = arguments.common.max_file;
        Ok(match points {
            true => Given::Points(ray_file::read_points(file, limit)?),
            false => Given::Rays(ray_file::read(file, limit)?),
        })
    }
}

impl Asked {
    fn read(arguments: &Arguments) -> Result<Asked, Failure> {
        Ok(match Given::read(arguments)? {
            Given::Points(points) if arguments.kind == Kind::Inside => {
                Asked::Inside(points, Located::default())
            }
            Given::Points(points) => {
                let closest = answers(points.len(), ClosestPoint::NONE)?;
                let signs = arguments.signed.then(Located::default);
                let within = arguments.max_distance();
                Asked::ClosestPoint { points, closest, signs, within }
            }
            Given::Rays(rays) => {
                let count = rays.len();
                match arguments.kind {
                    Kind::Closest => Asked::Closest(rays, answers(count, Hit::MISS)?),
                    Kind::Any => Asked::Any(rays, answers(count, false)?),
                    Kind::All | Kind::Inside | Kind::ClosestPoint => {
                        Asked::All(rays, AllHits::none())
                    }
                }
            }
        })
    }

    fn count(&self) -> usize {
        match self {
            Asked::Closest(rays, _) | Asked::Any(rays, _) | Asked::All(rays, _) => rays.len(),
            Asked::Inside(points, _) | Asked::ClosestPoint { points, .. } => points.len(),
        }
    }

    /// Traces once. Gives what is to be known of the answers.
    fn trace(
        &mut self,
        accelerator: &dyn Accelerator,
        options: &QueryOptions<'_>,
        max_memory: Option<u64>,
    ) -> Result<splitplane::QueryReport, Failure> {
        let QueryOptions { culling, ignore, watch, .. } = *options;
        Ok(match self {
            Asked::Closest(rays, hits) => accelerator.closest_hits(rays, hits, options)?,
            Asked::Any(rays, hits) => accelerator.any_hits(rays, hits, options)?,
            Asked::All(rays, all) => {
                let options = AllHitsOptions { culling, ignore, max_memory, watch };
                *all = AllHits::none();
                *all = accelerator.all_hits(rays, &options)?;
                all.report.clone()
            }
            Asked::Inside(points, located) => {
                *located = accelerator.locate(points, &LocateOptions { max_memory, watch })?;
                located.report.clone()
            }
            Asked::ClosestPoint { points, closest, signs, within } => {
                let options = ClosestPointOptions { max_distance: *within, ignore, watch };
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
            Asked::All(_, all) => return Ok(hit_file::write_all(path, all)?.to_vec()),
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

    /// Rays that hit, crossings, points inside, or points that have a closest one.
    fn found(&self) -> usize {
        match self {
            Asked::Closest(_, hits) => hits.iter().filter(|hit| hit.is_hit()).count(),
            Asked::Any(_, hits) => hits.iter().filter(|hit| **hit).count(),
            Asked::All(_, all) => all.crossings.len(),
            Asked::Inside(_, located) => {
                let inside =
                    |&point: &usize| located.location(point, Rule::NonZero) == Location::Inside;
                (0..located.windings.len()).filter(inside).count()
            }
            Asked::ClosestPoint { closest, .. } => {
                closest.iter().filter(|closest| closest.is_some()).count()
            }
        }
    }
}

impl Arguments {
    /// The greatest distance of a closest point.
    pub(super) fn max_distance(&self) -> f32 {
        self.max_distance.unwrap_or(f32::INFINITY)
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
        let mut asked = Asked::read(arguments)?;
        let prepared = Prepared::open(&arguments.scene, common)?;
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
        let exact = matches!(arguments.kind, Kind::All | Kind::Inside);
        let report = QueryReport {
            rays: asked.count(),
            hits: asked.found(),
            kind: arguments.kind,
            accuracy: match arguments.kind {
                Kind::ClosestPoint => "f64",
                _ if exact => "exact",
                _ => common.accuracy_name(),
            },
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

/// The middle of the times, the mean of the two middle ones for an even number.
pub(super) fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    match times.len() {
        0 => 0.0,
        n if n % 2 == 1 => times[n / 2],
        n => 0.5 * (times[n / 2 - 1] + times[n / 2]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), 2.5);
        assert_eq!(median(&mut []), 0.0);
    }
}
