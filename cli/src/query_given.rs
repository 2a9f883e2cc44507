//! What `splitplane query` is asked: its arguments, and the rays or points of a file.

use super::failure::Failure;
use super::options::{Common, distance};
use super::{files, own_files, ray_file};
use clap::{Args, ValueEnum};
use serde::Serialize;
use splitplane::{QueryError, Ray};
use splitplane_scene::from_file::quoted_path;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

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

impl Arguments {
    /// The greatest distance of a closest point.
    pub(super) fn max_distance(&self) -> f32 {
        self.max_distance.unwrap_or(f32::INFINITY)
    }
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
        let read = [arguments.rays.as_deref(), arguments.points.as_deref()];
        own_files::check(
            read.into_iter().flatten().chain([Path::new(&arguments.scene)]),
            arguments.hits.as_deref(),
        )?;
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
