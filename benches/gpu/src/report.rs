//! JSON lines as they come, tables at the end.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Value, json};
use splitplane::Preset;

use crate::Failure;
use crate::accuracy::Figures as OfAccuracy;
use crate::build::Figures as Build;
use crate::device::{Costs, Description};
use crate::floor::KernelFloor;
use crate::micro::Micro;
use crate::stats::median;
use crate::trace::Figures as Trace;

/// What is written so far.
pub(crate) struct Report {
    folder: PathBuf,
    lines: File,
    /// What the scene at hand is built by.
    preset: String,
    adapter: String,
    builds: String,
    sizes: String,
    kernels: String,
    traces: String,
    checks: String,
    accuracies: String,
    predicted: String,
    notes: Vec<String>,
}

impl Report {
    pub(crate) fn new(folder: &Path) -> Result<Report, Failure> {
        let shown = |error| format!("{}: {error}", folder.display());
        fs::create_dir_all(folder).map_err(shown)?;
        let lines = File::create(folder.join("gpu.jsonl")).map_err(shown)?;
        let empty = String::new;
        Ok(Report {
            folder: folder.to_owned(),
            lines,
            preset: Preset::default().name().to_owned(),
            adapter: empty(),
            builds: empty(),
            sizes: empty(),
            kernels: empty(),
            traces: empty(),
            checks: empty(),
            accuracies: empty(),
            predicted: empty(),
            notes: Vec::new(),
        })
    }

    /// What follows is by the preset of this name.
    pub(crate) fn begin(&mut self, preset: String) {
        self.preset = preset;
    }

    /// A line of raw figures: to the file and to standard output.
    fn line(
        &mut self,
        kind: &str,
        scene: Option<&str>,
        raw: impl Serialize,
    ) -> Result<(), Failure> {
        let mut object = json!({"kind": kind});
        if let Some(scene) = scene {
            object["scene"] = scene.into();
            object["preset"] = self.preset.clone().into();
        }
        if let (Value::Object(line), Value::Object(raw)) = (&mut object, serde_json::to_value(raw)?)
        {
            line.extend(raw);
        }
        println!("{object}");
        writeln!(self.lines, "{object}")?;
        Ok(())
    }

    pub(crate) fn adapter(&mut self, of: &Description) -> Result<(), Failure> {
        self.line("adapter", None, of)?;
        if let Some(difference) = &of.difference {
            self.notes.push(format!("self-test: structural parity: {difference}"));
        }
        let driver = format!("{} {}", of.driver, of.driver_info);
        self.adapter = format!(
            "Adapter: {} ({}), {}, driver {}; {} {}, {} CPU threads. Parity of the self-test: {}. \
             Timestamps: {}, {} ns a tick. Opening with self-test: {:.0} ms.\n",
            of.adapter,
            of.device_type,
            of.backend,
            driver.trim(),
            of.os,
            of.architecture,
            of.cpu_threads,
            of.parity,
            if of.timestamps { "yes" } else { "no" },
            of.timestamp_period_ns,
            of.open_ms,
        );
        Ok(())
    }

    pub(crate) fn costs(&mut self, costs: &Costs) -> Result<(), Failure> {
        self.line("costs", None, costs)?;
        writeln!(
            self.adapter,
            "Copies from buffer to buffer ({} MiB): {:.1} GB/s read and written by the driver, {:.1} \
             by a kernel. A dispatch that waits for the one before: {:.2} us. A submission of \
             nothing: {:.0} us.",
            costs.copied_bytes >> 20,
            costs.copy_gb_per_s,
            costs.kernel_gb_per_s,
            costs.dispatch_us,
            costs.submission_us,
        )?;
        Ok(())
    }

    pub(crate) fn build(
        &mut self,
        scene: &str,
        of: &Build,
        floor: Option<&[KernelFloor]>,
        costs: &Costs,
    ) -> Result<(), Failure> {
        self.line("build", Some(scene), of)?;
        let row = format!("{scene} | {}", self.preset);
        if !of.equal {
            let (cpu, gpu) = (&of.digest_cpu, &of.digest_gpu);
            self.notes.push(format!("{}: digest {gpu}, the CPU's is {cpu}", self.case(scene)));
        }
        writeln!(
            self.sizes,
            "| {row} | {} | {} | {} | {} | {} | `{}` | {} | {} | {} | {} | {} | {} |",
            of.triangles,
            of.levels,
            of.small_roots,
            of.nodes,
            of.references,
            of.digest_gpu,
            if of.equal { "yes" } else { "**no**" },
            mib(of.build_bytes),
            mib(of.tree_bytes),
            of.dispatches,
            of.submissions,
            of.readbacks,
        )?;
        let Some(floor) = floor else { return Ok(()) };
        let bytes: u64 = floor.iter().map(|kernel| kernel.bytes).sum();
        let floor_ms = |bytes: u64| bytes as f64 / costs.kernel_gb_per_s * 1e-6;
        let launch_ms = f64::from(of.dispatches) * costs.dispatch_us * 1e-3;
        writeln!(
            self.builds,
            "| {row} | {:.2} | {:.2} | {:.2} | {:.2} | {} | {:.2} | {:.2} | {:.3} | {} | {:.2} | {:.2} |",
            of.first_ms,
            of.rebuild(),
            median(&of.submit_ms),
            median(&of.upload_ms),
            of.kernels_ms.map_or("-".into(), |ms| format!("{ms:.2}")),
            of.with_host_copy_ms,
            of.cpu(),
            of.cpu() / of.rebuild(),
            mib(bytes),
            floor_ms(bytes),
            launch_ms,
        )?;
        for kernel in floor {
            self.line("kernel", Some(scene), kernel)?;
            let Some(ms) = kernel.ms else { continue };
            let least = floor_ms(kernel.bytes);
            writeln!(
                self.kernels,
                "| {row} | `{}` | {} | {ms:.3} | {:.1} % | {} | {least:.4} | {:.0} |",
                kernel.kernel,
                kernel.passes.unwrap_or(0),
                1e2 * ms / of.kernels_ms.unwrap_or(f64::NAN),
                mib(kernel.bytes),
                ms / least,
            )?;
        }
        Ok(())
    }

    pub(crate) fn trace(&mut self, scene: &str, of: &Trace) -> Result<(), Failure> {
        self.line("trace", Some(scene), of)?;
        let row = format!("{scene} | {}", self.preset);
        let (set, query) = (of.set, of.query.name());
        if let Some(first) = &of.first_difference {
            let different = of.different + of.resident_different.unwrap_or(0);
            let case = self.case(scene);
            self.notes.push(format!("{case}, {set}, {query}: {different} differ; first: {first}"));
        }
        if of.left_out > 0 {
            let left_out = of.left_out;
            let case = self.case(scene);
            self.notes
                .push(format!("{case}, {set}: {left_out} rays left out, no binding holds all"));
        }
        writeln!(
            self.checks,
            "| {row} | {set} | {query} | {} | {} | {} | {} | {} |",
            of.rays,
            of.hits,
            of.different,
            of.resident_different.map_or("-".into(), |different| different.to_string()),
            of.unfinished
        )?;
        if !of.cpu_s.is_empty() {
            let (resident, cpu) = (of.resident_mrays(), of.mrays(&of.cpu_s));
            writeln!(
                self.traces,
                "| {row} | {set} | {query} | {resident:.2} | {:.2} | {:.2} | {cpu:.2} | {:.3} | {} |",
                of.mrays(&of.resident_wall_s),
                of.mrays(&of.host_s),
                resident / cpu,
                of.dispatches,
            )?;
        }
        Ok(())
    }

    pub(crate) fn accuracy(&mut self, scene: &str, of: &OfAccuracy) -> Result<(), Failure> {
        self.line("accuracy", Some(scene), of)?;
        if let Some(different) = of.different.filter(|different| *different > 0) {
            let case = self.case(scene);
            self.notes.push(format!("{case}, {}: {different} exact hits differ", of.set));
        }
        let timed = |seconds: &[f64]| match seconds {
            [] => "-".to_owned(),
            seconds => format!("{:.2}", of.nanoseconds(seconds)),
        };
        writeln!(
            self.accuracies,
            "| {scene} | {} | {} | {} | {} | {} | {} | {} | {:.1e} | {} |",
            self.preset,
            of.set,
            of.accuracy,
            of.rays,
            timed(&of.resident_s),
            timed(&of.host_s),
            of.undecided,
            of.share(),
            of.different.map_or("-".into(), |different| different.to_string()),
        )?;
        Ok(())
    }

    /// What chains of the least things take.
    pub(crate) fn micro(&mut self, of: &Micro) -> Result<(), Failure> {
        self.line("micro", None, of)?;
        writeln!(
            self.adapter,
            "In a chain: {:.2} ns an operation, {:.1} ns a load of a 16 MiB list, {:.1} ns a barrier of 256. At once: {:.0} \
             billion instructions a second, of 32 lanes each.",
            of.step_ns, of.load_ns, of.barrier_ns, of.giga_instructions,
        )?;
        if !of.resident.is_empty() {
            let resident: Vec<_> = of
                .resident
                .iter()
                .map(|(bytes, groups)| format!("{groups:.0} with {bytes} bytes of memory"))
                .collect();
            writeln!(
                self.adapter,
                "Workgroups of 64 on the device at a time: {}.",
                resident.join(", ")
            )?;
        }
        Ok(())
    }

    /// Text about what was predicted.
    pub(crate) fn predicted(&mut self, text: &str) {
        self.predicted.push_str(text);
    }

    /// A scene and how it is built, in words.
    fn case(&self, scene: &str) -> String {
        format!("{scene} by {}", self.preset)
    }

    pub(crate) fn failure(&mut self, scene: &str, why: &str) -> Result<(), Failure> {
        self.line("failure", Some(scene), json!({"why": why}))?;
        self.notes.push(format!("{}: not measured: {why}", self.case(scene)));
        Ok(())
    }

    /// Writes the tables. True when there is nothing to complain about.
    /// Writes all there is so far; true when nothing is wrong.
    pub(crate) fn finish(self, check: bool) -> Result<bool, Failure> {
        let text = self.write(check)?;
        for note in &self.notes {
            eprintln!("{note}");
        }
        println!("{text}");
        Ok(self.notes.is_empty())
    }

    /// Writes the tables of all there is so far.
    pub(crate) fn write(&self, check: bool) -> Result<String, Failure> {
        let mut text = String::from("# GPU figures\n\n");
        text.push_str(&self.adapter);
        let mut table = |title: &str, head: &str, rows: &str| {
            if rows.is_empty() {
                return;
            }
            let columns = head.matches('|').count() - 1;
            let rule = "---|".repeat(columns);
            let _ = write!(text, "\n## {title}\n\n{head}\n|{rule}\n{rows}");
        };
        if !check {
            table(
                "Builds, milliseconds (medians; mesh in host memory, tree on the device)",
                "| scene | preset | first | rebuild | of it until submitted | mesh alone sent | sum of kernels \
                 | with host copy | CPU | CPU / rebuild | moved at least, MiB | floor by bandwidth \
                 | floor by dispatches |",
                &self.builds,
            );
        }
        table(
            "Trees",
            "| scene | preset | triangles | levels | small roots | nodes | references | digest | equal \
             | build, MiB | tree, MiB | dispatches | submissions | readbacks |",
            &self.sizes,
        );
        table(
            "Kernels",
            "| scene | preset | kernel | passes | ms | share | moved at least, MiB | floor, ms | over the floor |",
            &self.kernels,
        );
        table(
            "Queries, million rays a second (medians)",
            "| scene | preset | set | query | on the device | the same by the host's clock | from host memory \
             | CPU | device / CPU | dispatches a submission |",
            &self.traces,
        );
        table(
            "Answers against the CPU's, all words",
            "| scene | preset | set | query | rays | hits | different | different on the device | unfinished |",
            &self.checks,
        );
        table(
            "Accuracies: closest hits, nanoseconds a ray (medians)",
            "| scene | preset | set | accuracy | rays | on the device | from host memory | undecided \
             | share | different from the CPU's |",
            &self.accuracies,
        );
        if !self.predicted.is_empty() {
            text.push_str("\n## Predicted\n");
            text.push_str(&self.predicted);
        }
        if !self.notes.is_empty() {
            text.push_str("\n## What is wrong\n\n");
            for note in &self.notes {
                let _ = writeln!(text, "- {note}");
            }
        }
        fs::write(self.folder.join("gpu.md"), &text)?;
        Ok(text)
    }
}

fn mib(bytes: u64) -> String {
    format!("{:.1}", bytes as f64 / f64::from(1 << 20))
}
