//! Predictions as tables.

use std::fmt::Write as _;

use splitplane::gpu::KernelTime;

use super::devices::Device;
use super::predict::{self, Predicted};
use super::shaders;
use crate::count::build::CountedBuild;
use crate::count::rays::{CountedRays, Through};
use crate::count::tally::{LANES_IN_STEP, Tally};

/// Time measured beside the time predicted.
fn beside(measured: Option<f64>, predicted: f64) -> String {
    match measured {
        Some(ms) => format!("{ms:.3} | {:.2}", ms / predicted),
        None => "- | -".into(),
    }
}

/// A build, kernel by kernel. `times` are those of a profiled build, which records levels that have nothing to do too: of
/// such dispatches the launch is added to what is predicted.
pub(crate) fn build(device: &Device, of: &CountedBuild, times: &[KernelTime]) -> String {
    let mut out = String::from(
        "| kernel | dispatches | MiB | launch | bytes | instructions | chain | predicted, ms | bound by | measured \
         | measured / predicted |\n|---|--:|--:|--:|--:|--:|--:|--:|---|--:|--:|\n",
    );
    let mut all = Predicted::default();
    let mut row = |name: &str, dispatches: u64, bytes: u64, p: &Predicted, measured| {
        let _ = writeln!(
            out,
            "| {name} | {dispatches} | {:.1} | {:.3} | {:.3} | {:.3} | {:.3} | **{:.3}** | {} | {} |",
            bytes as f64 / f64::from(1 << 20),
            p.launch,
            p.bytes,
            p.instructions,
            p.chain,
            p.time,
            p.bound(),
            beside(measured, p.time),
        );
    };
    let mut recorded = 0;
    for kernel in &of.kernels {
        let shader = shaders::find(kernel.text, device.compiler);
        let time = times.iter().find(|time| time.kernel.name() == kernel.kernel);
        let tally = kernel.all();
        let mut predicted = predict::kernel(device, &shader, kernel);
        let spare =
            time.map_or(0, |time| u64::from(time.dispatches).saturating_sub(tally.dispatches));
        predicted = Predicted::sum([predicted, predict::empty(device, spare)]);
        recorded += tally.dispatches + spare;
        // A star: no compiler was asked about it.
        let name = format!("`{}`{}", kernel.kernel, if shader.known { "" } else { " *" });
        let measured = time.map(|time| time.nanoseconds * 1e-6);
        row(&name, tally.dispatches + spare, tally.bytes(), &predicted, measured);
        all = Predicted::sum([all, predicted]);
    }
    // Levels to spare, and what belongs to no kernel of the table.
    let rest = u64::from(of.rebuild.dispatches).saturating_sub(recorded);
    if rest > 0 {
        let empty = predict::empty(device, rest);
        row("without work", rest, 0, &empty, None);
        all = Predicted::sum([all, empty]);
    }
    let measured = times.iter().map(|time| time.nanoseconds * 1e-6).sum();
    let measured = (!times.is_empty()).then_some(measured);
    row("all", recorded + rest, of.all().bytes(), &all, measured);
    out
}

/// Closest hits: as many rays as asked for, from those that were counted. `measured` are million rays a second, and what
/// those went through.
pub(crate) fn rays(
    device: &Device,
    of: &[CountedRays],
    rays: u64,
    measured: Option<(Through, f64)>,
) -> String {
    let mut out = String::from(
        "| through | nodes a ray | triangles a ray | rounds a ray | instructions a ray | a node or triangle | loads a ray \
         | lanes at work | warps resident | instructions, ms | chain, ms | bound by | predicted, Mray/s | measured \
         | measured / predicted |\n|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|--:|--:|--:|\n",
    );
    let mut shown = String::new();
    for of in of {
        let shader = shaders::find(of.kernel.text, device.compiler);
        let tally = more(of, rays);
        let each = |count: u64| count as f64 / rays as f64;
        let lanes = of.kernel.lanes;
        let p = predict::dispatch(device, &shader, lanes, &tally);
        let groups = predict::resident(device, &shader, lanes);
        let warps = groups * f64::from(lanes.div_ceil(LANES_IN_STEP));
        let instructions = each(tally.operations) * shader.per_operation;
        let step = instructions / (of.nodes + of.triangles).max(1.0);
        let in_step = f64::from(LANES_IN_STEP) * tally.in_step as f64;
        let together = tally.operations as f64 / in_step.max(1.0);
        let mrays = rays as f64 / p.time * 1e-3;
        let here = measured.filter(|(through, _)| *through == of.through);
        let measured = beside(here.map(|(_, mrays)| mrays), mrays);
        let _ = writeln!(
            out,
            "| {} | {:.1} | {:.1} | {:.1} | {instructions:.0} | {step:.1} | {:.1} | {:.0} % | {warps:.0} of {:.0} \
             | {:.3} | {:.3} | {} | **{mrays:.0}** | {measured} |",
            of.through.name(),
            of.nodes,
            of.triangles,
            each(tally.rounds),
            each(tally.loads),
            1e2 * together,
            device.warps.number,
            p.instructions,
            p.chain,
            p.bound(),
        );
        let _ = writeln!(shown, "- {}: {}", of.through.name(), sum(device, &shader, lanes, &tally));
    }
    out + "\n" + &shown
}

/// The counts of more rays of the same kind.
fn more(of: &CountedRays, rays: u64) -> Tally {
    let counted = of.kernel.all();
    let more = |count: u64| (count as f64 / of.rays as f64 * rays as f64).round() as u64;
    Tally {
        workgroups: more(counted.workgroups),
        busy: more(counted.busy),
        operations: more(counted.operations),
        loads: more(counted.loads),
        rounds: more(counted.rounds),
        in_step: more(counted.in_step),
        busy_operations: more(counted.busy_operations),
        busy_loads: more(counted.busy_loads),
        busy_in_step: more(counted.busy_in_step),
        read: more(counted.read),
        written: more(counted.written),
        ..counted
    }
}

/// How the time of a dispatch that its instructions bind comes about, as a sum to check by hand.
fn sum(device: &Device, shader: &shaders::Shader, lanes: u32, of: &Tally) -> String {
    let issued = predict::issued(device, shader, lanes, of);
    let instructions = of.in_step as f64 * shader.per_operation;
    let slots = device.multiprocessors.number * device.schedulers.number;
    let cycles = instructions / (slots * issued.rate);
    format!(
        "{:.1} M operations of the longest lanes x {:.3} instructions each = {:.1} M instructions of warps. A warp can \
         issue every {:.1} cycles: {:.0} + {:.4} loads an instruction x {} x {:.0}. {:.1} warps a scheduler offer {:.2} \
         a cycle, of which it takes {:.2}. / ({:.0} multiprocessors x {:.0} schedulers x {:.2}) = {:.2} M cycles; \
         / {} GHz = {:.3} ms.",
        of.in_step as f64 * 1e-6,
        shader.per_operation,
        instructions * 1e-6,
        issued.wait,
        device.step.number,
        issued.loads,
        device.dependent.number,
        device.load.number,
        issued.warps,
        issued.warps / issued.wait,
        issued.rate,
        device.multiprocessors.number,
        device.schedulers.number,
        issued.rate,
        cycles * 1e-6,
        device.clock.number,
        cycles * 1e-6 / device.clock.number,
    )
}

/// What is assumed of the device, and what the device at hand does where that was measured.
pub(crate) fn assumptions(device: &Device, measured: &[(&str, f64)]) -> String {
    let mut out = format!(
        "Assumed of `{}`. Instructions are operations that were counted times those that {} made of each.\n\n\
         | what | assumed | measured here | measured / assumed | source |\n|---|--:|--:|--:|---|\n",
        device.name,
        match device.compiler {
            super::devices::Compiler::Cuda => "ptxas for sm_90",
            super::devices::Compiler::Aco => "ACO for AMD",
        }
    );
    for (name, assumed) in device.assumptions() {
        let found = measured.iter().find(|(of, _)| *of == name);
        let shown = found.map_or("- | -".into(), |(_, value)| {
            format!("{value:.3} | {:.2}", value / assumed.number)
        });
        let _ = writeln!(out, "| {name} | {} | {shown} | {} |", assumed.number, assumed.source);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::count::tally::Counted;
    use crate::model::devices::BY_HAND;
    use splitplane::core::kernel::Kernel;

    /// Ten dispatches of a kernel that moves 4.3 MB each, two more that do nothing, and one without a kernel.
    #[test]
    fn predictions_stand_beside_measurements() {
        let one = Tally { dispatches: 1, busy: 1, read: 4_300_000, ..Tally::default() };
        let kernel = Kernel::ALL[0];
        let counted = Counted {
            kernel: kernel.name(),
            text: kernel.name(),
            lanes: 64,
            dispatches: vec![one; 10],
        };
        let mut build_of =
            CountedBuild { triangles: 1, kernels: vec![counted], rebuild: Default::default() };
        build_of.rebuild.dispatches = 13;
        let times = [KernelTime { kernel, dispatches: 12, nanoseconds: 92_000.0 }];
        let text = build(&BY_HAND, &build_of, &times);
        // 12 launches of 3 us, ten times 1 us.
        assert!(text.contains("| **0.046** | launch | 0.092 | 2.00 |"), "{text}");
        assert!(text.contains("| without work | 1 |"), "{text}");
        assert!(text.contains("| all | 13 |"), "{text}");
    }

    #[test]
    fn assumptions_show_what_was_measured() {
        let text = assumptions(&BY_HAND, &[("copies, GB/s", 2150.0)]);
        assert!(text.contains("| copies, GB/s | 4300 | 2150.000 | 0.50 | assumed"), "{text}");
        assert!(text.contains("| multiprocessors | 132 | - | - |"), "{text}");
    }
}
