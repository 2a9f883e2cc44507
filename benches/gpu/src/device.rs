//! The device: what it says of itself, what a copy and a dispatch cost on it, and a clock for commands.

use std::time::{Duration, Instant};

use serde::Serialize;
use splitplane::gpu::{Gpu, GpuError, Parity, WgpuBackend};
use wgpu::BufferUsages as Usage;

use crate::Failure;
use crate::options::Options;
use crate::stats::{median, milliseconds};

/// What is known of the device without measuring.
#[derive(Debug, Serialize)]
pub(crate) struct Description {
    pub adapter: String,
    pub backend: &'static str,
    pub device_type: String,
    pub driver: String,
    pub driver_info: String,
    pub vendor: u32,
    pub device: u32,
    pub parity: &'static str,
    pub difference: Option<String>,
    pub timestamps: bool,
    pub timestamp_period_ns: f32,
    pub max_buffer_size: u64,
    pub max_storage_buffer_binding_size: u64,
    pub max_storage_buffers_per_shader_stage: u32,
    pub max_compute_invocations_per_workgroup: u32,
    pub max_compute_workgroup_storage_size: u32,
    pub max_compute_workgroups_per_dimension: u32,
    pub min_uniform_buffer_offset_alignment: u32,
    pub subgroup_size: [u32; 2],
    /// Opening the device and its self-test, which compiles the kernels.
    pub open_ms: f64,
    pub os: &'static str,
    pub architecture: &'static str,
    pub cpu_threads: usize,
    pub version: &'static str,
}

/// Describes the device of a backend that took `open_ms` to open.
pub(crate) fn describe(backend: &WgpuBackend, open_ms: f64) -> Description {
    let gpu = backend.gpu();
    let (info, limits) = (gpu.info(), gpu.limits());
    Description {
        adapter: info.name.clone(),
        backend: info.backend.to_str(),
        device_type: format!("{:?}", info.device_type),
        driver: info.driver.clone(),
        driver_info: info.driver_info.clone(),
        vendor: info.vendor,
        device: info.device,
        parity: backend.parity().map_or("not tested", Parity::name),
        difference: match backend.parity() {
            None | Some(Parity::Bitwise) => None,
            Some(Parity::Structural(difference)) => Some(difference.clone()),
        },
        timestamps: gpu.has_timestamps(),
        timestamp_period_ns: gpu.queue().get_timestamp_period(),
        max_buffer_size: limits.max_buffer_size,
        max_storage_buffer_binding_size: limits.max_storage_buffer_binding_size,
        max_storage_buffers_per_shader_stage: limits.max_storage_buffers_per_shader_stage,
        max_compute_invocations_per_workgroup: limits.max_compute_invocations_per_workgroup,
        max_compute_workgroup_storage_size: limits.max_compute_workgroup_storage_size,
        max_compute_workgroups_per_dimension: limits.max_compute_workgroups_per_dimension,
        min_uniform_buffer_offset_alignment: limits.min_uniform_buffer_offset_alignment,
        subgroup_size: [info.subgroup_min_size, info.subgroup_max_size],
        open_ms,
        os: std::env::consts::OS,
        architecture: std::env::consts::ARCH,
        cpu_threads: rayon::current_num_threads(),
        version: env!("CARGO_PKG_VERSION"),
    }
}

/// Time of commands, from their submission until the host knows that they are done, and between
/// timestamps of the device around them where it has any.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span {
    pub wall_ms: f64,
    pub device_ms: Option<f64>,
}

impl Span {
    /// The device's time, or the host's where there is none.
    pub(crate) fn best_ms(&self) -> f64 {
        self.device_ms.unwrap_or(self.wall_ms)
    }
}

/// How long a device works before it is timed. One that idles lowers its clock, to a fifth on some, and raises it again
/// only while it is busy.
const WARM: Duration = Duration::from_millis(300);

/// Does the work again and again, until the device's clock is what it is under load. Software needs none of it.
pub(crate) fn warm(
    gpu: &Gpu,
    mut work: impl FnMut() -> Result<(), Failure>,
) -> Result<(), Failure> {
    let begun = Instant::now();
    work()?;
    while !gpu.is_software() && begun.elapsed() < WARM {
        work()?;
    }
    Ok(())
}

/// Times commands on a device.
#[derive(Debug)]
pub(crate) struct Clock<'a> {
    gpu: &'a Gpu,
    set: Option<wgpu::QuerySet>,
}

impl<'a> Clock<'a> {
    pub(crate) fn new(gpu: &'a Gpu) -> Clock<'a> {
        let description = wgpu::QuerySetDescriptor {
            label: Some("span"),
            ty: wgpu::QueryType::Timestamp,
            count: 4,
        };
        let set = gpu.has_timestamps().then(|| gpu.device().create_query_set(&description));
        Clock { gpu, set }
    }

    /// Runs the commands that `record` records.
    pub(crate) fn time(
        &self,
        record: impl FnOnce(&mut wgpu::CommandEncoder) -> Result<(), Failure>,
    ) -> Result<Span, Failure> {
        let mut encoder = self.gpu.device().create_command_encoder(&Default::default());
        self.mark(&mut encoder, 0);
        record(&mut encoder)?;
        self.mark(&mut encoder, 2);
        let commands = encoder.finish();
        let (done, wall_ms) = milliseconds(|| -> Result<(), GpuError> {
            self.gpu.submit([commands])?;
            self.gpu.wait()
        });
        done?;
        Ok(Span { wall_ms, device_ms: self.read()? })
    }

    /// A pass without work, with a timestamp before and one after.
    fn mark(&self, encoder: &mut wgpu::CommandEncoder, first: u32) {
        let Some(set) = &self.set else { return };
        encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("mark"),
            timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
                query_set: set,
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(first + 1),
            }),
        });
    }

    /// From the end of the first mark to the beginning of the second.
    fn read(&self) -> Result<Option<f64>, Failure> {
        let (Some(set), gpu) = (&self.set, self.gpu) else { return Ok(None) };
        let resolved = gpu.buffer("ticks", 32, Usage::QUERY_RESOLVE | Usage::COPY_SRC)?;
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        encoder.resolve_query_set(set, 0..4, &resolved, 0);
        gpu.submit([encoder.finish()])?;
        let bytes = read_back(gpu, &resolved, 32)?;
        let ticks: Vec<u64> = bytemuck::pod_collect_to_vec(&bytes);
        let period = f64::from(gpu.queue().get_timestamp_period());
        // A device that writes no timestamps in empty passes leaves zeros.
        let passed = ticks[2].checked_sub(ticks[1]).filter(|passed| *passed > 0);
        Ok(passed.map(|passed| passed as f64 * period * 1e-6))
    }
}

/// The first bytes of a buffer with the usage `COPY_SRC`.
pub(crate) fn read_back(gpu: &Gpu, buffer: &wgpu::Buffer, bytes: u64) -> Result<Vec<u8>, GpuError> {
    let staging = gpu.buffer("staging", bytes, Usage::COPY_DST | Usage::MAP_READ)?;
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, bytes);
    gpu.submit([encoder.finish()])?;
    gpu.read_mapped(&staging, bytes)
}

/// What the least of everything costs on the device: the two floors under a build.
#[derive(Debug, Serialize)]
pub(crate) struct Costs {
    /// Bytes of a copy from buffer to buffer.
    pub copied_bytes: u64,
    /// Bytes read and written a second while the driver copies, in units of 10^9.
    pub copy_gb_per_s: f64,
    /// The same while a kernel copies, four words a lane.
    pub kernel_gb_per_s: f64,
    /// A dispatch of one workgroup that waits for the one before.
    pub dispatch_us: f64,
    /// A submission of nothing, until the host knows that it is done.
    pub submission_us: f64,
}

/// Copies in a submission.
const COPIES: u32 = 8;
/// Dispatches in a submission.
const DISPATCHES: u32 = 512;

const COPY: &str = "@group(0) @binding(0) var<storage, read> words: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> copied: array<vec4<u32>>;
@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let at = id.x + id.y * groups.x * 256u;
    if at < arrayLength(&words) { copied[at] = words[at]; }
}";

const EMPTY: &str = "@group(0) @binding(0) var<storage, read_write> word: array<u32>;
@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) lane: u32) {
    if lane == 0u { word[0] += 1u; }
}";

impl Costs {
    pub(crate) fn measure(gpu: &Gpu, options: &Options) -> Result<Costs, Failure> {
        let limits = gpu.limits();
        let most = limits.max_buffer_size.min(limits.max_storage_buffer_binding_size);
        let copied_bytes = options.copied_bytes().min(most) / 16 * 16;
        let reps = if options.check { 1 } else { options.reps.clamp(3, 21) };
        let clock = Clock::new(gpu);
        let repeated = |record: &dyn Fn(&mut wgpu::CommandEncoder)| -> Result<f64, Failure> {
            let one = || -> Result<f64, Failure> {
                let recorded = |encoder: &mut wgpu::CommandEncoder| {
                    record(encoder);
                    Ok(())
                };
                Ok(clock.time(recorded)?.best_ms())
            };
            warm(gpu, || one().map(|_| ()))?;
            let times: Result<Vec<f64>, Failure> = (0..reps).map(|_| one()).collect();
            Ok(median(&times?))
        };

        let usage = Usage::COPY_SRC | Usage::COPY_DST | Usage::STORAGE;
        let a = gpu.buffer("copied", copied_bytes, usage)?;
        let b = gpu.buffer("copy", copied_bytes, usage)?;
        let copy_ms = repeated(&|encoder| {
            for copy in 0..COPIES {
                let (from, to) = if copy % 2 == 0 { (&a, &b) } else { (&b, &a) };
                encoder.copy_buffer_to_buffer(from, 0, to, 0, copied_bytes);
            }
        })?;

        let pipeline = gpu.pipeline("copy", COPY)?;
        let bound = |from: &wgpu::Buffer, to: &wgpu::Buffer| {
            let resources = [from, to].map(wgpu::Buffer::as_entire_binding);
            let entries = [0, 1].map(|binding: u32| wgpu::BindGroupEntry {
                binding,
                resource: resources[binding as usize].clone(),
            });
            gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &pipeline.get_bind_group_layout(0),
                entries: &entries,
            })
        };
        let groups = [bound(&a, &b), bound(&b, &a)];
        let workgroups = copied_bytes.div_ceil(16 * 256) as u32;
        let rows = workgroups.div_ceil(limits.max_compute_workgroups_per_dimension);
        let kernel_ms = repeated(&|encoder| {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            for copy in 0..COPIES as usize {
                pass.set_bind_group(0, &groups[copy % 2], &[]);
                pass.dispatch_workgroups(workgroups.div_ceil(rows), rows, 1);
            }
        })?;

        let pipeline = gpu.pipeline("empty", EMPTY)?;
        let word = gpu.buffer("word", 16, Usage::STORAGE)?;
        let group = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: word.as_entire_binding() }],
        });
        let dispatch_ms = repeated(&|encoder| {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            for _ in 0..DISPATCHES {
                pass.dispatch_workgroups(1, 1, 1);
            }
        })?;

        let submissions: Result<Vec<f64>, GpuError> = (0..reps.max(3))
            .map(|_| {
                let encoder = gpu.device().create_command_encoder(&Default::default());
                let commands = encoder.finish();
                let (done, ms) = milliseconds(|| {
                    gpu.submit([commands])?;
                    gpu.wait()
                });
                done.map(|()| ms)
            })
            .collect();
        let moved = 2.0 * copied_bytes as f64 * f64::from(COPIES);
        Ok(Costs {
            copied_bytes,
            copy_gb_per_s: moved / copy_ms * 1e-6,
            kernel_gb_per_s: moved / kernel_ms * 1e-6,
            dispatch_us: dispatch_ms * 1e3 / f64::from(DISPATCHES),
            submission_us: median(&submissions?) * 1e3,
        })
    }
}
