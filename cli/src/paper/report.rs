//! What was measured, as files and as text.

use super::Arguments;
use crate::failure::Failure;
use crate::prepared::print_json;
use crate::{files, output};
use splitplane_measure::paper::document::Report;
use splitplane_measure::paper::file::File;
use splitplane_measure::paper::scene::SceneReport;
use splitplane_scene::from_file::quoted;

impl Arguments {
    /// Writes all files and gives their names.
    pub(super) fn write(
        &self,
        report: &Report,
        pictures: Vec<File>,
    ) -> Result<Vec<String>, Failure> {
        let json = serde_json::to_vec_pretty(report)
            .map_err(|error| Failure::file(format!("cannot write the report as JSON: {error}")))?;
        let mut files = pictures;
        for (name, table) in report.tables() {
            files.push(File { name: format!("{name}.csv"), bytes: table.csv().into_bytes() });
        }
        files.push(File { name: "report.json".into(), bytes: json });
        // The text comes last: where it is, all that it shows is there.
        files.push(File { name: "report.md".into(), bytes: report.markdown().into_bytes() });
        for file in &files {
            files::write(&self.out.join(&file.name), &file.bytes)?;
        }
        Ok(files.into_iter().map(|file| file.name).collect())
    }

    pub(super) fn tell(&self, report: &Report, files: &[String]) -> Result<(), Failure> {
        let paths: Vec<String> =
            files.iter().map(|name| self.out.join(name).display().to_string()).collect();
        if self.json {
            #[derive(serde::Serialize)]
            struct Output<'a> {
                #[serde(flatten)]
                report: &'a Report,
                output: Vec<String>,
            }
            return print_json(&Output { report, output: paths });
        }
        if self.quiet {
            return Ok(());
        }
        let mut text = String::new();
        for scene in &report.scenes {
            text += &described(scene);
        }
        let last = paths.last().map_or("", String::as_str);
        text += &format!("written  {last} and {} files beside it\n", paths.len() - 1);
        output::data(&text)
    }
}

/// A scene's builders in a line each.
fn described(scene: &SceneReport) -> String {
    let mut text = format!(
        "scene    ({}) {}: {} triangles, lights: {}\n",
        scene.letter,
        quoted(&scene.name),
        scene.triangles,
        scene.lights
    );
    for row in &scene.builders {
        text += &format!(
            "built    {:<8} {:<5} knobs {:<4} tree {:8.2} ms, frame {:8.2} ms, SAH cost {:.2}\n",
            row.preset, row.knobs, row.backend, row.tree_ms, row.trace_ms, row.sah_cost
        );
    }
    text
}
