//! `splitplane distances`: distances on a grid.

use super::failure::Failure;
use super::options::{Common, distance};
use super::prepared::{Prepared, counted, in_pool, milliseconds, print_json};
use super::{files, npy, output, own_files, progress};
use clap::Args;
use serde::Serialize;
use splitplane::{
    Aabb, Accelerator, ClosestPoint, ClosestPointOptions, LocateOptions, Location, QueryError,
    Rule, Watch,
};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Points that are answered at a time.
const SLICE: usize = 1 << 16;
/// More along one side are wrong usage, not a question of memory.
const MOST_SIDE: u32 = 1 << 16;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// An .obj, .ply, .stl, .gltf or .glb file, or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE")]
    scene: OsString,
    /// The file of distances, .npy of f32: that of shape (nx, ny, nz) has at i, j, k the distance of the point origin + step (i, j, k)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Steps along the longest side of the scene's box
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_SIDE)))]
    steps: u32,
    /// The distance between two points, in place of --steps
    #[arg(long, value_name = "DISTANCE", value_parser = distance, conflicts_with = "steps")]
    step: Option<f32>,
    /// How far the grid goes beyond the box on each side, in parts of its longest side
    #[arg(long, value_name = "PART", default_value_t = 0.125, value_parser = distance)]
    margin: f32,
    /// Distances of points inside a closed surface are negative
    #[arg(long)]
    signed: bool,
    /// The greatest distance that is looked for; beyond it distances are infinite
    #[arg(long, value_name = "DISTANCE", value_parser = distance)]
    max_distance: Option<f32>,
    #[command(flatten)]
    pub(super) common: Common,
}

/// How many points are inside, beyond the limit, and answered by the CPU in a device's place.
#[derive(Default)]
struct Filled {
    inside: usize,
    beyond: usize,
    answered_by_cpu: u64,
}

/// Where the points of a grid are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Grid {
    origin: [f64; 3],
    step: f64,
    shape: [usize; 3],
}

#[derive(Serialize)]
struct DistancesReport {
    #[serde(flatten)]
    grid: Grid,
    points: usize,
    signed: bool,
    /// Of which the nearest triangle is: `f64` or `exact`.
    accuracy: &'static str,
    build_ms: f64,
    answer_ms: f64,
    inside: usize,
    beyond: usize,
    /// Distances and locations that the CPU found in place of the backend's device.
    answered_by_cpu: u64,
    digest: String,
    output: String,
}

impl Grid {
    /// Over a box, with a margin in parts of its longest side, and so many steps along that, or steps of this length.
    fn over(bounds: &Aabb, margin: f64, steps: u32, step: Option<f64>) -> Result<Grid, Failure> {
        let extent = [0, 1, 2].map(|axis| f64::from(bounds.hi[axis]) - f64::from(bounds.lo[axis]));
        let longest = extent.into_iter().fold(0.0f64, f64::max);
        // A box that is one point has a grid around it all the same.
        let longest = if longest > 0.0 { longest } else { f64::from(f32::MIN_POSITIVE) };
        let step = step.unwrap_or(longest / f64::from(steps));
        let margin = (margin * longest / step).ceil();
        let counts = extent.map(|side| (side / step).ceil() + 2.0 * margin + 1.0);
        if counts.iter().any(|&count| count.is_nan() || count > f64::from(MOST_SIDE)) {
            let most = counts.into_iter().fold(0.0, f64::max);
            return Err(Failure::usage(format!(
                "a side of the grid has {most:.0} points, more than {MOST_SIDE}; give a greater --step or a smaller --margin"
            )));
        }
        let origin = [0, 1, 2].map(|axis| f64::from(bounds.lo[axis]) - margin * step);
        Ok(Grid { origin, step, shape: counts.map(|count| count as usize) })
    }

    /// How many points it has.
    fn points(&self) -> usize {
        self.shape.iter().fold(1, |all, &side| all.saturating_mul(side))
    }

    /// A point by its number, the last axis fastest.
    fn point(&self, number: usize) -> [f32; 3] {
        let [_, ny, nz] = self.shape;
        let place = [number / (ny * nz), number / nz % ny, number % nz];
        [0, 1, 2].map(|axis| (self.origin[axis] + self.step * place[axis] as f64) as f32)
    }
}

/// Bytes that the answer for so many points takes: the distances, and of a slice the points and what is closest to them.
fn held(points: usize) -> u64 {
    let slice = SLICE.min(points) as u64;
    let each = (size_of::<[f32; 3]>() + size_of::<ClosestPoint>()) as u64;
    (points as u64).saturating_mul(4).saturating_add(slice * each)
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    if arguments.step.is_some_and(|step| step == 0.0 || step.is_infinite()) {
        return Err(Failure::usage("--step: a grid has steps longer than 0, and finite"));
    }
    own_files::check([Path::new(&arguments.scene)], [arguments.out.as_path()])?;
    in_pool(&arguments.common, || arguments.answer())
}

impl Arguments {
    fn answer(&self) -> Result<(), Failure> {
        let common = &self.common;
        let no_rays = Err("--preset auto chooses for rays, not for distances; name a preset");
        let prepared = Prepared::open(&self.scene, common, no_rays)?;
        let bounds = prepared.accelerator.tree().bounds;
        if bounds.is_empty() {
            return Err(Failure::file("there is no triangle to measure distances to"));
        }
        let step = self.step.map(f64::from);
        let grid = Grid::over(&bounds, f64::from(self.margin), self.steps, step)?;
        let needed = held(grid.points());
        if let Some(limit) = common.max_memory.filter(|&limit| needed > limit) {
            return Err(QueryError::OutOfMemory { needed, limit }.into());
        }
        let mut bytes = npy::header_of("'<f4'", &grid.shape);
        let refused = |_| QueryError::OutOfMemory { needed, limit: needed };
        bytes.try_reserve_exact(4 * grid.points()).map_err(refused)?;
        let start = Instant::now();
        let left = common.max_memory.map(|limit| limit - needed);
        let Filled { inside, beyond, answered_by_cpu } =
            self.fill(&grid, &*prepared.accelerator, left, &mut bytes)?;
        let answer_ms = milliseconds(start);
        files::write(&self.out, &bytes)?;
        let report = DistancesReport {
            grid,
            points: grid.points(),
            signed: self.signed,
            accuracy: common.nearness_name(),
            build_ms: prepared.build_ms,
            answer_ms,
            inside,
            beyond,
            answered_by_cpu,
            digest: prepared.accelerator.tree().digest().to_string(),
            output: self.out.display().to_string(),
        };
        if common.json {
            return print_json(&report);
        }
        if common.quiet {
            return Ok(());
        }
        let ([nx, ny, nz], [x, y, z]) = (grid.shape, grid.origin);
        let inside = if self.signed { format!(", {inside} inside") } else { String::new() };
        let by_cpu = match answered_by_cpu {
            0 => String::new(),
            some => format!(", {some} answers by the CPU in the device's place"),
        };
        output::data(&format!(
            "{}grid     {nx} x {ny} x {nz} from {x} {y} {z} by {}\n\
             measured {} in {answer_ms:.2} ms{inside}, {beyond} beyond the limit{by_cpu}\nwritten  {}\n",
            prepared.built().describe(),
            grid.step,
            counted(grid.points() as u64, "point"),
            self.out.display()
        ))
    }

    /// Appends all distances.
    fn fill(
        &self,
        grid: &Grid,
        accelerator: &dyn Accelerator,
        max_memory: Option<u64>,
        bytes: &mut Vec<u8>,
    ) -> Result<Filled, Failure> {
        let total = grid.points();
        let mut filled = Filled::default();
        let watch: Option<&dyn Watch> = Some(&progress::Unseen);
        let options = ClosestPointOptions {
            max_distance: self.max_distance.unwrap_or(f32::INFINITY),
            accuracy: self.common.query_options().accuracy,
            watch,
            ..ClosestPointOptions::default()
        };
        let locate = LocateOptions { max_memory, watch };
        let bar = progress::bar(self.common.quiet, "distances", total as u64);
        let (mut points, mut closest) = (Vec::new(), Vec::new());
        let needed = held(total);
        let refused = |_| QueryError::OutOfMemory { needed, limit: needed };
        points.try_reserve_exact(SLICE.min(total)).map_err(refused)?;
        closest.try_reserve_exact(SLICE.min(total)).map_err(refused)?;
        closest.resize(SLICE.min(total), ClosestPoint::NONE);
        for first in (0..total).step_by(SLICE) {
            points.clear();
            points.extend((first..total.min(first + SLICE)).map(|number| grid.point(number)));
            let closest = &mut closest[..points.len()];
            let report = accelerator.closest_points(&points, closest, &options)?;
            filled.answered_by_cpu += report.answered_by_cpu;
            let located = match self.signed {
                true => Some(accelerator.locate(&points, &locate)?),
                false => None,
            };
            filled.answered_by_cpu += located.as_ref().map_or(0, |own| own.report.answered_by_cpu);
            for (place, own) in closest.iter().enumerate() {
                let is_inside = located.as_ref().is_some_and(|located| {
                    located.location(place, Rule::NonZero) == Location::Inside
                });
                filled.inside += usize::from(is_inside);
                filled.beyond += usize::from(!own.is_some());
                let distance = if is_inside { -own.distance() } else { own.distance() };
                bytes.extend(distance.to_le_bytes());
            }
            bar.inc(points.len() as u64);
        }
        bar.finish_and_clear();
        Ok(filled)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_cover_the_box_and_its_margin() {
        let bounds = Aabb { lo: [0.0, 0.0, 0.0], hi: [4.0, 2.0, 1.0] };
        let grid = Grid::over(&bounds, 0.25, 8, None).unwrap();
        assert_eq!(grid, Grid { origin: [-1.0; 3], step: 0.5, shape: [13, 9, 7] });
        assert_eq!(grid.point(0), [-1.0; 3]);
        assert_eq!(grid.point(1), [-1.0, -1.0, -0.5]);
        assert_eq!(grid.point(grid.points() - 1), [5.0, 3.0, 2.0]);
        let coarse = Grid::over(&bounds, 0.0, 8, Some(1.5)).unwrap();
        assert_eq!(coarse.shape, [4, 3, 2]);
        let point = Aabb { lo: [1.0; 3], hi: [1.0; 3] };
        assert_eq!(Grid::over(&point, 0.0, 8, None).unwrap().shape, [1; 3]);
        assert!(Grid::over(&bounds, 0.0, 8, Some(1e-9)).is_err());
        assert!(Grid::over(&bounds, 1e30, 8, None).is_err());
    }
}
