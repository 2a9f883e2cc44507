//! `splitplane points`: clouds of points.

mod answers;
mod picture;
mod planes;
mod report;
mod work;

use super::cloud;
use super::ending::{self, TimeLimit};
use super::failure::Failure;
use super::options::{bytes, distance, point, size};
use super::prepared::{counted, milliseconds, pool_of};
use super::{files, output, own_files, probe, progress, ray_file};
use clap::{Args, ValueEnum};
use report::PointsReport;
use splitplane::points::{Axes, PointOptions};
use splitplane::render::Size;
use splitplane::{BackendKind, OpenOptions};
use splitplane_scene::from_file::quoted_path;
use std::path::{Path, PathBuf};
use std::time::Instant;
use work::Work;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// A cloud: .ply, .npy of shape (n, 3), or text with a point a line (.xyz)
    #[arg(value_name = "CLOUD")]
    cloud: PathBuf,
    /// Write the --k nearest points of each query to this file, .npy or raw: as many records of f32 distance, u32
    /// point, nearest first; `inf 4294967295` where there are no more
    #[arg(long, value_name = "FILE")]
    nearest: Option<PathBuf>,
    /// Write all points within --radius of each query to this file, .npy or raw: the same records, and in a second file, .starts before its
    /// ending, where each query's begin, u64
    #[arg(long, value_name = "FILE", requires = "radius")]
    within: Option<PathBuf>,
    /// What --nearest and --within ask about: raw little-endian f32 `x y z`, or .npy of shape (n, 3); the cloud's own points when left out
    #[arg(long, value_name = "FILE")]
    queries: Option<PathBuf>,
    /// How many neighbours count: of --nearest, --normals (the point itself among them), --outliers and the picture's shades
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=4096))]
    k: u32,
    /// The greatest distance of --nearest; no limit when left out
    #[arg(long, value_name = "DISTANCE", value_parser = distance, requires = "nearest")]
    max_distance: Option<f32>,
    /// The distance of --within
    #[arg(long, value_name = "DISTANCE", value_parser = distance, requires = "within")]
    radius: Option<f32>,
    /// Write a normal for each point to this file, .npy or raw: records of f32 x, y, z, variation. It is that of the plane through the point's
    /// neighbours (least squares); the variation is their spread along it over all of their spread, 0 on a plane. Where there is no plane all
    /// are 0
    #[arg(long, value_name = "FILE")]
    normals: Option<PathBuf>,
    /// Normals look to the side of this point; when left out, to where their greatest coordinate is positive
    #[arg(long, value_name = "X,Y,Z", value_parser = point, requires = "normals")]
    viewpoint: Option<[f32; 3]>,
    /// Write one byte for each point to this file, .npy or raw: 1 for those whose mean distance to their neighbours is --deviations standard
    /// deviations above the mean of all, 2 for those left out, 0 for the others
    #[arg(long, value_name = "FILE")]
    outliers: Option<PathBuf>,
    /// How far --outliers are
    #[arg(long, value_name = "NUMBER", default_value_t = 2.0, value_parser = distance, requires = "outliers")]
    deviations: f32,
    /// Write a cloud to this file, .ply, .npy or text, in which no two points are nearer than --spacing: the first of each neighbourhood stays
    #[arg(long, value_name = "FILE", requires = "spacing")]
    thin: Option<PathBuf>,
    /// The least distance of --thin
    #[arg(long, value_name = "DISTANCE", value_parser = distance, requires = "thin")]
    spacing: Option<f32>,
    /// Draw the cloud as this .png file, coloured by height, y up
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Width and height of the picture in pixels
    #[arg(long, value_name = "WxH", default_value = "900x700", value_parser = size, requires = "picture")]
    size: Size,
    /// Which axis divides a node of the tree
    #[arg(long, value_enum, default_value_t = AxesName::Widest)]
    axes: AxesName,
    /// What builds the tree and finds nearest points and those within a distance; a GPU asked for is never replaced by the CPU
    #[arg(long, value_name = "auto|cpu|wgpu", default_value = "cpu")]
    backend: BackendKind,
    /// The GPU, by part of its name or by its number in the list of `splitplane adapters`
    #[arg(long, value_name = "NAME|INDEX")]
    adapter: Option<String>,
    /// Allow --backend wgpu a GPU whose results differ from the CPU's in some bits
    #[arg(long)]
    allow_structural: bool,
    /// Threads that share the work; all cores when left out
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Most bytes the tree, a search or an answer may hold besides the cloud; k, M and G stand for powers of 1024
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    max_memory: Option<u64>,
    /// Most bytes of a file that is read whole. Half of the machine's memory when left out, and 1G of what comes from a pipe or a device
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    max_file: Option<u64>,
    #[command(flatten)]
    time: TimeLimit,
    /// Report as one JSON object
    #[arg(long)]
    json: bool,
    /// Print nothing but errors and what --json asks for
    #[arg(long, short)]
    quiet: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum AxesName {
    /// That along which the node's points reach farthest
    Widest,
    /// One after the other, level by level
    Cycle,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.time.begin();
    ending::check()?;
    arguments.check()?;
    pool_of(arguments.threads)?.install(|| arguments.answer())
}

impl Arguments {
    /// What cannot be is said before a large file is read.
    fn check(&self) -> Result<(), Failure> {
        if self.queries.is_some() && self.nearest.is_none() && self.within.is_none() {
            return Err(Failure::usage("--queries: is for --nearest and --within"));
        }
        if let Some(path) = self.picture.as_ref().filter(|path| !files::ends_in(path, "png")) {
            let shown = quoted_path(path);
            return Err(Failure::usage(format!(
                "`{shown}` does not end in .png; the picture of a cloud is written as PNG"
            )));
        }
        let read = [Some(&self.cloud), self.queries.as_ref()];
        let written =
            [&self.nearest, &self.within, &self.normals, &self.outliers, &self.thin, &self.picture];
        own_files::check(
            read.into_iter().flatten().map(PathBuf::as_path),
            written.into_iter().flatten().map(PathBuf::as_path),
        )?;
        match self.within.as_ref().filter(|path| files::is_stream(path)) {
            Some(path) => Err(Failure::usage(format!(
                "--within writes two files, which `{}` cannot be; give the name of a file",
                quoted_path(path)
            ))),
            None => Ok(()),
        }
    }

    fn answer(&self) -> Result<(), Failure> {
        let opened = self.backend.open_engine(&probe::limited(OpenOptions {
            adapter: self.adapter.clone(),
            allow_structural: self.allow_structural,
            ..OpenOptions::default()
        }))?;
        let spinner = progress::spinner(self.quiet, "reading the cloud");
        let points = cloud::read(&self.cloud, self.max_file)?;
        let queries = match &self.queries {
            Some(path) => Some(ray_file::read_points(path, self.max_file)?),
            None => None,
        };
        spinner.finish_and_clear();
        ending::check()?;
        let axes = match self.axes {
            AxesName::Widest => Axes::Widest,
            AxesName::Cycle => Axes::Cycle,
        };
        let watch = progress::watch(self.quiet);
        let start = Instant::now();
        let options = PointOptions { axes, max_memory: self.max_memory, watch: Some(&watch) };
        let tree = opened.engine.points(&points, &options)?;
        let build_ms = milliseconds(start);
        drop(watch);
        let left_out = u64::from(tree.tree().report().dropped);
        if left_out > 0 && !self.quiet {
            let were = if left_out == 1 { "was" } else { "were" };
            output::note(&format!(
                "note: {} {were} left out: a coordinate is NaN or infinite",
                counted(left_out, "point")
            ));
        }
        let work = Work { tree, points: &points, limit: self.max_memory, quiet: self.quiet };
        let mut report = PointsReport::of(&self.cloud, &work, &opened, build_ms)?;
        let asked = queries.as_deref().unwrap_or(&points);
        let mut written: Vec<PathBuf> = Vec::new();
        let mut add = |path: &Path| written.push(path.to_owned());
        if let Some(path) = &self.nearest {
            let most = self.max_distance.unwrap_or(f32::INFINITY);
            report.nearest = Some(answers::nearest(&work, asked, self.k as usize, most, path)?);
            add(path);
        }
        if let (Some(path), Some(radius)) = (&self.within, self.radius) {
            let (found, starts) = answers::within(&work, asked, radius, path)?;
            report.within = Some(found);
            add(path);
            add(&starts);
        }
        if let Some(path) = &self.normals {
            let planes = planes::fit(&work, self.k as usize, self.viewpoint)?;
            report.without_normal = Some(answers::normals(&planes, path, self.max_memory)?);
            add(path);
        }
        if let Some(path) = &self.outliers {
            let found = answers::outliers(&work, self.k as usize, self.deviations, path)?;
            report.outliers = Some(found);
            add(path);
        }
        if let (Some(path), Some(spacing)) = (&self.thin, self.spacing) {
            report.thinned = Some(answers::thin(&work, spacing, path)?);
            add(path);
        }
        if let Some(path) = &self.picture {
            picture::draw(&work, self.k as usize, self.size, &report, path)?;
            add(path);
        }
        report.tell(self.json, self.quiet, &written)
    }
}
