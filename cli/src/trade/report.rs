//! What was measured, as files and as text.

use super::Arguments;
use crate::failure::Failure;
use crate::prepared::print_json;
use crate::{files, output};
use splitplane::Preset;
use splitplane_measure::paper::file::File;
use splitplane_measure::trade::compare::Comparison;
use splitplane_measure::trade::pareto::Standing;
use splitplane_measure::trade::plan::{Device, Station};
use splitplane_measure::trade::{Trade, plot};
use splitplane_scene::from_file::quoted;
use std::path::Path;

/// What a reader may look for and not find.
pub(super) fn left_out(stations: &[Station]) -> Vec<String> {
    let on = |device| stations.iter().filter(move |station| station.device == device);
    let best = on(Device::Cpu).any(|station| station.config.preset() == Preset::Best);
    let mut out = Vec::new();
    if best && on(Device::Gpu).next().is_some() {
        out.push("preset best on the GPU, since it is built on the CPU only".to_owned());
    }
    out
}

/// Writes all files and gives their paths.
pub(super) fn write(folder: &Path, trade: &Trade) -> Result<Vec<String>, Failure> {
    let json = serde_json::to_vec_pretty(trade)
        .map_err(|error| Failure::file(format!("cannot write the report as JSON: {error}")))?;
    let figures = plot::figures(trade)?;
    let shown: Vec<(&str, &str)> = figures
        .iter()
        .map(|figure| (figure.files[0].name.as_str(), figure.caption.as_str()))
        .collect();
    let text = trade.markdown(&shown);
    let mut files: Vec<File> = figures.into_iter().flat_map(|figure| figure.files).collect();
    files.push(File { name: "trade.csv".into(), bytes: trade.table().csv().into_bytes() });
    files.push(File { name: "trade.json".into(), bytes: json });
    // The text comes last: where it is, all that it shows is there.
    files.push(File { name: "trade.md".into(), bytes: text.into_bytes() });
    files::write_together(
        files.iter().map(|file| (folder.join(&file.name), file.bytes.as_slice())),
    )?;
    Ok(files.iter().map(|file| folder.join(&file.name).display().to_string()).collect())
}

impl Arguments {
    pub(super) fn tell(
        &self,
        trade: &Trade,
        comparison: Option<&Comparison>,
        output: Vec<String>,
    ) -> Result<(), Failure> {
        if self.json {
            #[derive(serde::Serialize)]
            struct Output<'a> {
                #[serde(flatten)]
                trade: &'a Trade,
                comparison: Option<&'a Comparison>,
                output: Vec<String>,
            }
            return print_json(&Output { trade, comparison, output });
        }
        if self.quiet {
            return Ok(());
        }
        let mut text = described(trade);
        if let Some(comparison) = comparison {
            text += &comparison.words();
        }
        if let Some(last) = output.last() {
            text += &format!("written  {last} and {} files beside it\n", output.len() - 1);
        }
        output::data(&text)
    }
}

/// The rows in a line each, and what to take.
fn described(trade: &Trade) -> String {
    let mut text = format!(
        "scene    {}: {} triangles\n\
         rays     {} of each kind timed, {} of each kind judged, {} rounds\n\
         exact    {}\n",
        quoted(&trade.scene.name),
        trade.scene.triangles,
        trade.amounts.sample_rays.max(trade.amounts.gpu_sample_rays),
        trade.amounts.error_rays.max(trade.amounts.gpu_error_rays),
        trade.amounts.repeat,
        trade.held.words()
    );
    for row in &trade.rows {
        text += &format!(
            "row {:>3}{} {:<44} build {:>9.2} ms  {:>7.0} ns a ray  {:>8.2} MB  SAH {:>7.2}  {:>8.1} errors/M  {:>8.1} rounded/M  pays {}\n",
            row.number,
            match row.pareto {
                Standing::Optimal => "*",
                Standing::Perhaps => "?",
                Standing::Beaten => " ",
            },
            row.title(),
            row.build_ms,
            row.ns_per_ray,
            row.query_bytes as f64 / 1e6,
            row.sah_cost,
            row.errors_per_million,
            row.rounded_per_million,
            row.payback.words()
        );
    }
    text += &format!("take     {}\n", trade.recommendation.words);
    if let Some(bvh) = &trade.bvh {
        text += &format!("bvh      {}\n", bvh.words);
    }
    text
}

/// What failed a comparison, in one line.
pub(super) fn failed(comparison: &Comparison) -> String {
    let named = comparison
        .worse
        .iter()
        .take(5)
        .map(|worse| format!("row {} ({}): {}", worse.row, worse.setting, worse.figure));
    let more = comparison.worse.len().saturating_sub(5);
    let more = if more > 0 { format!("; and {more} more") } else { String::new() };
    format!(
        "{} of {} figures got worse past the threshold: {}{more}",
        comparison.worse.len(),
        comparison.figures,
        named.collect::<Vec<_>>().join("; ")
    )
}
