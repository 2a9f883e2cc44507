//! What the device does with the least of each thing that predictions assume: a chain of operations, of loads, of
//! barriers, and as many operations as it takes.

use splitplane::gpu::Gpu;
use wgpu::BufferUsages as Usage;

use crate::Failure;
use crate::device::{Clock, warm};
use crate::options::Options;
use crate::stats::median;

/// Nanoseconds of one of a chain; and operations a second.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct Micro {
    pub step_ns: f64,
    pub load_ns: f64,
    pub barrier_ns: f64,
    /// Of 32 lanes each, in units of 10^9 a second.
    pub giga_instructions: f64,
    /// Workgroups of 64 lanes that are resident on the whole device, by bytes of memory that each has.
    pub resident: Vec<(u32, f64)>,
}

/// Rounds of each loop; llvmpipe ends an invocation after 65,535.
const ROUNDS: u32 = 4096;
/// Operations, loads or barriers of a round.
const EACH: u32 = 8;
/// Words of the list that loads go through.
const WORDS: u32 = 4 << 20;
/// Workgroups of 256 that fill a device.
const GROUPS: u32 = 4096;

const HEAD: &str = "@group(0) @binding(0) var<storage, read_write> words: array<u32>;
var<workgroup> shared_word: array<u32, 256>;
";

/// The list is a single cycle: each word is the index of the next, far away.
fn cycle() -> Vec<u32> {
    // A full period of this generator modulo a power of two: Hull and Dobell 1962.
    (0..WORDS).map(|i| (i.wrapping_mul(1_664_525).wrapping_add(1_013_904_223)) % WORDS).collect()
}

/// Bytes of memory of workgroups whose number on the device is measured.
const MEMORY: [u32; 6] = [256, 2048, 6144, 9216, 16_384, 32_768];

/// A kernel of 64 lanes whose workgroups have as many bytes of memory and wait for loads, so that twice as many resident
/// ones take no longer.
fn waiting_kernel(bytes: u32) -> String {
    format!(
        "@group(0) @binding(0) var<storage, read_write> words: array<u32>;
var<workgroup> room: array<u32, {words}>;
@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) lane: u32) {{
    room[lane] = words[lane];
    workgroupBarrier();
    var at = room[(lane + words[2]) % {words}u] & 1u;
    for (var round = 0u; round < 256u; round++) {{ at = words[at]; }}
    if at == {WORDS}u {{ words[0] = room[at]; }}
}}",
        words = bytes / 4,
    )
}

fn kernel(lanes: u32, body: &str) -> String {
    format!(
        "{HEAD}@compute @workgroup_size({lanes})
fn main(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) group: vec3<u32>) {{
    let rounds = {ROUNDS}u + words[0] / {WORDS}u;
    var at = words[1];
    var x = f32(words[2] + lane + group.x);
    let a = 1.0 / f32(words[3] + 2u);
    for (var round = 0u; round < rounds; round++) {{ {body} }}
    if x == 12345.678 || at == {WORDS}u {{ words[0] = at; }}
}}"
    )
}

impl Micro {
    pub(crate) fn measure(gpu: &Gpu, options: &Options) -> Result<Micro, Failure> {
        let buffer = gpu.buffer("words", 4 * u64::from(WORDS), Usage::STORAGE | Usage::COPY_DST)?;
        gpu.queue().write_buffer(&buffer, 0, bytemuck::cast_slice(&cycle()));
        let clock = Clock::new(gpu);
        let reps = if options.check { 1 } else { options.reps.clamp(3, 11) };
        let timed = |source: &str, groups: u32| -> Result<f64, Failure> {
            let pipeline = gpu.pipeline("micro", source)?;
            let bindings = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &pipeline.get_bind_group_layout(0),
                entries: &[wgpu::BindGroupEntry {
                    binding: 0,
                    resource: buffer.as_entire_binding(),
                }],
            });
            let once = || {
                clock.time(|encoder| {
                    let mut pass = encoder.begin_compute_pass(&Default::default());
                    pass.set_pipeline(&pipeline);
                    pass.set_bind_group(0, &bindings, &[]);
                    pass.dispatch_workgroups(groups, 1, 1);
                    Ok(())
                })
            };
            warm(gpu, || once().map(|_| ()))?;
            let times: Result<Vec<f64>, Failure> =
                (0..reps).map(|_| Ok(once()?.best_ms())).collect();
            Ok(median(&times?))
        };
        let time = |lanes: u32, groups: u32, line: &str| {
            timed(&kernel(lanes, &line.repeat(EACH as usize)), groups)
        };
        let most = gpu.limits().max_compute_workgroup_storage_size;
        let mut resident = Vec::new();
        for bytes in MEMORY.into_iter().filter(|&bytes| bytes <= most && !gpu.is_software()) {
            let source = waiting_kernel(bytes);
            let (one, full) = (timed(&source, 1)?, timed(&source, 8 * GROUPS)?);
            resident.push((bytes, f64::from(8 * GROUPS) * one / full));
        }
        let all = f64::from(ROUNDS * EACH);
        let groups = if gpu.is_software() { 4 } else { GROUPS };
        let operation = "x = fma(x, a, a);";
        let full = time(256, groups, operation)?;
        Ok(Micro {
            step_ns: 1e6 * time(32, 1, operation)? / all,
            load_ns: 1e6 * time(1, 1, "at = words[at];")? / all,
            barrier_ns: 1e6 * time(256, 1, "shared_word[lane] = round; workgroupBarrier();")? / all,
            giga_instructions: all * f64::from(groups) * 8.0 / full * 1e-6,
            resident,
        })
    }

    /// What is assumed of a device, as it is here: the clock is the assumed one.
    pub(crate) fn beside(&self, ghz: f64) -> [(&'static str, f64); 3] {
        [
            ("cycles to the next instruction of a warp", self.step_ns * ghz),
            ("cycles of a load", self.load_ns * ghz),
            ("cycles of a barrier", self.barrier_ns * ghz),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whoever follows the words meets every one of them.
    #[test]
    fn the_list_is_one_cycle() {
        let words = cycle();
        let (mut at, mut steps) = (0, 0);
        loop {
            (at, steps) = (words[at as usize], steps + 1);
            if at == 0 {
                break;
            }
        }
        assert_eq!(steps, WORDS);
    }
}
