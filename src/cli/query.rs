//! `splitplane query`.

use super::failure::Failure;
use super::options::Common;
use super::prepared::{Prepared, counted, in_pool, milliseconds, print_json};
use super::{hit_file, output, progress, ray_file};
use clap::{Args, ValueEnum};
use serde::Serialize;
use splitplane::{Hit, QueryOptions, Undecided};
use std::path::PathBuf;
use std::time::Instant;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// An .obj file or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE")]
    scene: String,
    /// The rays: raw little-endian f32 `ox oy oz dx dy dz tmin tmax`, or .npy of shape (n, 8)
    #[arg(long, value_name = "FILE")]
    rays: PathBuf,
    /// What to find
    #[arg(long, value_enum, default_value_t = Kind::Closest)]
    kind: Kind,
    /// Write the answers to this file, .npy or raw: records of f32 t, u32 triangle, f32 u, f32 v
    /// for closest; one byte for any
    #[arg(long, value_name = "FILE")]
    hits: Option<PathBuf>,
    /// What becomes of rays that a GPU cannot decide within its bounds of error, under `--accuracy exact`
    #[arg(long, value_enum, default_value_t = UndecidedName::Redo)]
    undecided: UndecidedName,
    /// Trace so many times and report the median
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    repeat: u32,
    #[command(flatten)]
    common: Common,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    /// The nearest hit
    Closest,
    /// Whether there is a hit at all
    Any,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum UndecidedName {
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

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let common = &arguments.common;
    in_pool(common, || {
        let rays = ray_file::read(&arguments.rays)?;
        let prepared = Prepared::open(&arguments.scene, common)?;
        let undecided = match arguments.undecided {
            UndecidedName::Redo => Undecided::Redo,
            UndecidedName::Flag => Undecided::Flag,
        };
        let options = QueryOptions { undecided, ..common.query_options() };
        let mut closest = Vec::new();
        let mut any = Vec::new();
        match arguments.kind {
            Kind::Closest => closest.resize(rays.len(), Hit::MISS),
            Kind::Any => any.resize(rays.len(), false),
        }
        let bar = progress::bar(common.quiet, "tracing", u64::from(arguments.repeat));
        let mut times = Vec::new();
        let mut last = Default::default();
        for _ in 0..arguments.repeat {
            let start = Instant::now();
            let answers = match arguments.kind {
                Kind::Closest => prepared.accelerator.closest_hits(&rays, &mut closest, &options),
                Kind::Any => prepared.accelerator.any_hits(&rays, &mut any, &options),
            };
            last = answers?;
            times.push(milliseconds(start));
            bar.inc(1);
        }
        bar.finish_and_clear();
        if let Some(path) = &arguments.hits {
            match arguments.kind {
                Kind::Closest => hit_file::write_closest(path, &closest)?,
                Kind::Any => hit_file::write_any(path, &any, &last.flagged)?,
            }
        }
        // What stands in the place of a flagged ray is no answer.
        for &place in &last.flagged {
            match arguments.kind {
                Kind::Closest => closest[place] = Hit::MISS,
                Kind::Any => any[place] = false,
            }
        }
        let hits = closest.iter().filter(|hit| hit.is_hit()).count()
            + any.iter().filter(|hit| **hit).count();
        let trace_ms = median(&mut times);
        let report = QueryReport {
            rays: rays.len(),
            hits,
            kind: arguments.kind,
            accuracy: common.accuracy_name(),
            build_ms: prepared.build_ms,
            trace_ms,
            mrays_per_s: rays.len() as f64 / trace_ms.max(1e-6) / 1e3,
            undecided: last.undecided,
            undecided_share: last.undecided as f64 / rays.len().max(1) as f64,
            flagged: last.flagged.len(),
            answered_by_cpu: prepared.accelerator.answered_by_cpu(),
            digest: prepared.accelerator.tree().digest().to_string(),
        };
        if report.undecided > 0 && !common.quiet {
            let what = if report.flagged > 0 { "they have no answer" } else { "the CPU did" };
            output::note(&format!(
                "note: the device could not decide {} exactly, a share of {:.1e}; {what}",
                counted(report.undecided, "ray"),
                report.undecided_share
            ));
        }
        if report.answered_by_cpu > 0 && !common.quiet {
            output::note(&format!(
                "note: the driver did not follow {} to the end; the CPU answered instead",
                counted(report.answered_by_cpu, "ray")
            ));
        }
        if common.json {
            return print_json(&report);
        }
        if common.quiet {
            return Ok(());
        }
        let written = arguments.hits.as_ref().map(|path| format!("written  {}\n", path.display()));
        output::data(&format!(
            "{}traced   {} in {trace_ms:.2} ms ({:.1} million a second), accuracy {}: {} hit\n{}",
            prepared.built().describe(),
            counted(report.rays as u64, "ray"),
            report.mrays_per_s,
            report.accuracy,
            report.hits,
            written.unwrap_or_default()
        ))
    })
}

/// The middle of the times, the mean of the two middle ones for an even number.
fn median(times: &mut [f64]) -> f64 {
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
