//! Figures of now beside those of an earlier run: what got worse.

use super::TradeError;
use super::budget::{Fixed, FixedRays};
use super::document::{Amounts, FORMAT, Subject, Trade};
use super::plan::{Device, Station};
use super::row::{Row, Sets};
use serde::{Deserialize, Serialize};
use splitplane_core::backend::QueryLayout;
use splitplane_core::config::Preset;
use splitplane_core::ray::Accuracy;
use splitplane_scene::from_file::{self, quoted, quoted_reason};
use std::path::{Path, PathBuf};

/// Greatest file that is read, in bytes; a row takes a few thousand.
const MOST: u64 = 64 << 20;
/// Most bytes of a name.
const MOST_OF_A_NAME: usize = 1024;

/// Whether a text of a file can be told as it is.
fn is_name(text: &str) -> bool {
    text.len() <= MOST_OF_A_NAME && !text.chars().any(char::is_control)
}

/// An earlier run, read from its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Old {
    path: PathBuf,
    /// The scene.
    pub scene: Subject,
    /// How much was measured.
    pub amounts: Amounts,
    /// The rows.
    pub rows: Vec<Row>,
}

/// What of a file matters here; conclusions are drawn anew.
#[derive(Deserialize)]
struct File {
    scene: Subject,
    amounts: Amounts,
    rows: Vec<Row>,
}

/// Only the format, which decides what else there may be.
#[derive(Deserialize)]
struct Head {
    format: u32,
}

/// How much worse a figure may be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Thresholds {
    /// Times, memory and costs: part of the earlier one, 0.25 for a quarter more.
    pub ratio: f64,
    /// Errors, and answers that were rounded or redone: more for each million rays.
    pub errors: f64,
}

/// A figure that got worse past the threshold.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Worse {
    /// The row's number, then and now.
    pub row: usize,
    /// The row in words.
    pub setting: String,
    /// The figure.
    pub figure: String,
    /// As it was.
    pub old: f64,
    /// As it is.
    pub new: f64,
}

/// A comparison.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// How much worse figures may be.
    pub thresholds: Thresholds,
    /// Figures compared.
    pub figures: usize,
    /// Those that got worse past the threshold.
    pub worse: Vec<Worse>,
    /// Rows whose tree is another one than it was, by their numbers.
    pub other_trees: Vec<usize>,
    /// Whether the timed rays are the same ones, bit for bit.
    pub same_rays: bool,
}

impl Old {
    /// Reads a file that `splitplane trade` wrote.
    ///
    /// # Errors
    /// [`TradeError::Old`]: it cannot be read, is damaged, or is of another format.
    pub fn read(path: &Path) -> Result<Old, TradeError> {
        let failed = |reason: String| TradeError::Old { path: path.to_owned(), reason };
        let text = from_file::read(path, MOST)
            .map_err(|error| failed(format!("cannot be read: {error}")))?;
        let damaged = |error: serde_json::Error| {
            // What it says may quote the file.
            let why = quoted_reason(&error.to_string());
            failed(format!("is no such report, or a damaged one: {why}"))
        };
        let head: Head = serde_json::from_slice(&text).map_err(damaged)?;
        if head.format != FORMAT {
            return Err(failed(format!(
                "is of format {}, but this version reads {FORMAT}; measure again",
                head.format
            )));
        }
        let File { scene, amounts, rows } = serde_json::from_slice(&text).map_err(damaged)?;
        let old = Old { path: path.to_owned(), scene, amounts, rows };
        old.check().map_err(failed)?;
        Ok(old)
    }

    /// Whether all of it can be measured again.
    fn check(&self) -> Result<(), String> {
        if self.rows.is_empty() {
            return Err("has no rows".into());
        }
        let Subject { name, mesh, .. } = &self.scene;
        if !is_name(name) || !is_name(mesh) {
            return Err("has a scene without a proper name".into());
        }
        let Amounts { repeat, sample_rays, gpu_sample_rays, error_rays, gpu_error_rays, .. } =
            self.amounts;
        let rays = [sample_rays as u64, gpu_sample_rays as u64, error_rays, gpu_error_rays];
        if !(1..1000).contains(&repeat) || rays.into_iter().any(|rays| rays > 1 << 26) {
            return Err("has amounts that cannot be measured".into());
        }
        for (place, row) in self.rows.iter().enumerate() {
            let bad = |what: &str| Err(format!("row {}: {what}", place + 1));
            if row.number != place + 1 {
                return bad("is not where its number says");
            }
            // It is told again.
            if row.also.len() > 64 || row.also.iter().any(|name| !is_name(name)) {
                return bad("has no proper names of the same tree");
            }
            if !is_name(&row.name) || row.knob.as_deref().is_some_and(|knob| !is_name(knob)) {
                return bad("has no proper name");
            }
            let Some(preset) = preset(&row.preset) else { return bad("no such preset") };
            if let Err(error) = row.config.with(preset).validate() {
                return bad(&error.to_string());
            }
            if layout(&row.layout).is_none() {
                return bad("no such layout in this version");
            }
            if accuracy(&row.accuracy).is_none() {
                return bad("no such accuracy in this version");
            }
            match (row.backend.as_str(), row.threads) {
                ("cpu", Some(1..=1024)) | ("wgpu", None) => {}
                _ => return bad("no such backend, or threads that it cannot have"),
            }
            let times = [row.build_ms, row.least_build_ms];
            let traces = row.trace.each().map(|trace| trace.least_ns);
            let intervals = [row.build_interval, row.ns_interval];
            let ends = intervals.map(|interval| [interval.low, interval.high]);
            let times = times.into_iter().chain(ends.into_iter().flatten());
            let all = times.chain(traces.into_iter().flatten());
            if all.clone().any(|time| !(time.is_finite() && time > 0.0)) {
                return bad("a time that is not above 0");
            }
        }
        Ok(())
    }

    /// Checks that the scene is the one that was measured.
    ///
    /// # Errors
    /// [`TradeError::Old`].
    pub fn check_scene(&self, name: &str, triangles: usize) -> Result<(), TradeError> {
        if triangles == self.scene.triangles {
            return Ok(());
        }
        Err(self.failed(format!(
            "was measured on `{}` of {} triangles, but `{name}` has {triangles}; give the same scene, or \
             measure it anew",
            self.scene.name,
            self.scene.triangles,
            name = quoted(name)
        )))
    }

    fn failed(&self, reason: String) -> TradeError {
        TradeError::Old { path: self.path.clone(), reason }
    }

    /// The stations of its rows.
    pub fn stations(&self) -> Vec<Station> {
        let mut stations: Vec<Station> = Vec::new();
        for row in &self.rows {
            let (Some(preset), Some(accuracy)) = (preset(&row.preset), accuracy(&row.accuracy))
            else {
                continue;
            };
            let device = if row.backend == "cpu" { Device::Cpu } else { Device::Gpu };
            let Some(layout) = layout(&row.layout) else { continue };
            let config = row.config.with(preset);
            let most = self.rows.iter().filter_map(|row| row.threads).max().unwrap_or(1);
            let threads = row.threads.unwrap_or(most);
            match stations.last_mut() {
                Some(last)
                    if (last.config, last.layout, last.device, last.threads)
                        == (config, layout, device, threads) =>
                {
                    last.accuracies.push(accuracy);
                }
                _ => stations.push(Station {
                    name: row.name.clone(),
                    knob: row.knob.clone(),
                    config,
                    layout,
                    device,
                    threads,
                    accuracies: vec![accuracy],
                }),
            }
        }
        stations
    }

    /// How much it measured, to be measured again.
    pub fn fixed(&self) -> Fixed {
        let Amounts { repeat, sample_rays, gpu_sample_rays, error_rays, gpu_error_rays, .. } =
            self.amounts;
        let rays = |sample, error| FixedRays { sample: Some(sample), error: Some(error) };
        Fixed {
            repeat: Some(repeat),
            cpu: rays(sample_rays, error_rays),
            gpu: rays(gpu_sample_rays, gpu_error_rays),
        }
    }

    /// Sets a new run beside it.
    ///
    /// # Errors
    /// [`TradeError::Old`]: the corners of the scene are others.
    pub fn compare(&self, new: &Trade, thresholds: Thresholds) -> Result<Comparison, TradeError> {
        if new.scene.mesh != self.scene.mesh {
            return Err(self.failed(format!(
                "was measured on other corners of `{}`: mesh {}, now {}; measure anew",
                quoted(&new.scene.name),
                self.scene.mesh,
                new.scene.mesh
            )));
        }
        let mut comparison = Comparison {
            thresholds,
            figures: 0,
            worse: Vec::new(),
            other_trees: Vec::new(),
            same_rays: new.amounts.rays == self.amounts.rays,
        };
        for (old, new) in self.rows.iter().zip(&new.rows) {
            comparison.row(old, new);
        }
        Ok(comparison)
    }
}

impl Comparison {
    /// Whether nothing got worse past the threshold.
    pub fn passed(&self) -> bool {
        self.worse.is_empty()
    }

    fn row(&mut self, old: &Row, new: &Row) {
        let Thresholds { ratio, errors } = self.thresholds;
        if old.digest != new.digest {
            self.other_trees.push(new.number);
        }
        let mut figure = |name: String, was: f64, is: f64, most: f64| {
            self.figures += 1;
            if is > most {
                let setting = new.title();
                self.worse.push(Worse {
                    row: new.number,
                    setting,
                    figure: name,
                    old: was,
                    new: is,
                });
            }
        };
        let mut by_ratio = |name: &str, was: f64, is: f64| {
            figure(name.to_owned(), was, is, was * (1.0 + ratio));
        };
        by_ratio("least build ms", old.least_build_ms, new.least_build_ms);
        let traces = old.trace.each().into_iter().zip(new.trace.each());
        for (name, (was, is)) in Sets::<()>::NAMES.into_iter().zip(traces) {
            if let (Some(was), Some(is)) = (was.least_ns, is.least_ns) {
                by_ratio(&format!("least ns of {name} rays"), was, is);
            }
        }
        by_ratio("query bytes", old.query_bytes as f64, new.query_bytes as f64);
        by_ratio("peak bytes", old.peak_bytes as f64, new.peak_bytes as f64);
        by_ratio("SAH cost", old.sah_cost, new.sah_cost);
        // A part in 10^9 more is the rounding of the division.
        let most = |was: f64| (was + errors) * (1.0 + 1e-9);
        let kinds = old.errors.each().into_iter().zip(new.errors.each());
        for (kind, (was, is)) in super::row::Aims::<()>::NAMES.into_iter().zip(kinds) {
            let rates = [
                ("missing", was.per_million(was.missing), is.per_million(is.missing)),
                ("wrong", was.per_million(was.wrong), is.per_million(is.wrong)),
                ("phantom", was.per_million(was.phantom), is.per_million(is.phantom)),
                // What is no error may still be a hole that is explained away.
                ("rounded", was.per_million(was.rounded), is.per_million(is.rounded)),
            ];
            for (what, was, is) in rates {
                figure(format!("{what} a million {kind} rays"), was, is, most(was));
            }
        }
        let (was, is) = (old.redone_per_million, new.redone_per_million);
        figure("redone a million judged rays".to_owned(), was, is, most(was));
    }

    /// All of it in words, a line each.
    pub fn words(&self) -> String {
        let mut out = String::new();
        for worse in &self.worse {
            let change = if worse.old > 0.0 {
                format!(", {:+.0} %", 100.0 * (worse.new / worse.old - 1.0))
            } else {
                String::new()
            };
            out += &format!(
                "worse    row {} ({}): {} was {:.4}, is {:.4}{change}\n",
                worse.row, worse.setting, worse.figure, worse.old, worse.new
            );
        }
        if !self.other_trees.is_empty() {
            out += &format!("trees    others than before in rows {:?}\n", self.other_trees);
        }
        if !self.same_rays {
            out += "rays     others than before, since the hits they start from differ: times compare roughly\n";
        }
        out += &format!(
            "compared {} figures; {} past {:.0} % or {} errors a million\n",
            self.figures,
            self.worse.len(),
            100.0 * self.thresholds.ratio,
            self.thresholds.errors
        );
        out
    }
}

fn preset(name: &str) -> Option<Preset> {
    Preset::ALL.into_iter().find(|preset| preset.name() == name)
}

fn layout(name: &str) -> Option<QueryLayout> {
    QueryLayout::ALL.into_iter().find(|layout| layout.name() == name)
}

fn accuracy(name: &str) -> Option<Accuracy> {
    Accuracy::ALL.into_iter().find(|accuracy| accuracy.name() == name)
}
