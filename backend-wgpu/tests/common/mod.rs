//! What the device tests share: one device and what it compiled, and small kernels run over words.

pub(crate) mod by_sources;
mod device;
pub(crate) mod hostile;
pub(crate) mod odd_rays;
pub(crate) mod poison;

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use splitplane_core::ray::{Hit, Ray};
use splitplane_core::watch::{Progress, Watch};
use splitplane_wgpu::{Gpu, Parity, Queries, WgpuBackend};

pub(crate) use device::{gpu, is_llvmpipe, options, own_gpu};

/// Longer than anything takes by far, beside as many other tests as there are cores; what takes
/// longer hangs.
pub(crate) const PATIENCE: Duration = Duration::from_secs(600);

/// Queries of the shared device, which was not tested.
pub(crate) fn queries() -> Arc<Queries> {
    static QUERIES: OnceLock<Arc<Queries>> = OnceLock::new();
    QUERIES.get_or_init(|| Arc::new(Queries::new(gpu()))).clone()
}

/// Queries of the shared device, as if it was tested.
pub(crate) fn tested_queries() -> Arc<Queries> {
    static QUERIES: OnceLock<Arc<Queries>> = OnceLock::new();
    QUERIES.get_or_init(|| trusted(gpu())).clone()
}

/// Queries on a device that is as good as tested.
pub(crate) fn trusted(gpu: Arc<Gpu>) -> Arc<Queries> {
    let queries = Queries::new(gpu);
    queries.set_parity(&Parity::Bitwise);
    Arc::new(queries)
}

/// A backend of its own on the shared device.
pub(crate) fn backend() -> WgpuBackend {
    WgpuBackend::new(Gpu::clone(&gpu())).expect("a backend")
}

pub(crate) fn untested_backend() -> WgpuBackend {
    WgpuBackend::without_selftest(Gpu::clone(&gpu()))
}

/// The text of a kernel.
pub(crate) fn source_of(name: &str) -> String {
    splitplane_shaders::find(name).expect("a kernel").source()
}

/// Bits, so that -0 differs from 0.
pub(crate) fn bits(hit: &Hit) -> [u32; 4] {
    [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()]
}

/// Rays that run along x, spread a little, from the octaves of `scenes::octaves` on: deeper than
/// any short stack.
pub(crate) fn along_x(count: u32) -> Vec<Ray> {
    let slope = |i: u32| (i as f32 * 0.618_034).fract() * 0.5 - 0.25;
    let start = |i: u32| [0.5 * (1 << (i % 20)) as f32, 0.0, 0.0];
    (0..count).map(|i| Ray::new(start(i), [1.0, slope(i), slope(7 * i + 3)])).collect()
}

/// Ends work after so many calls.
#[derive(Debug)]
pub(crate) struct Limit(pub(crate) AtomicU64);

impl Watch for Limit {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        assert!(progress.done <= progress.total, "{progress:?}");
        match self.0.fetch_sub(1, Ordering::Relaxed) {
            1 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    }
}

/// Two other devices on the adapter of [`gpu`], of one instance, as a host has them: with limits of
/// their own.
///
/// # Panics
/// If the adapter gives no device with these limits.
pub(crate) fn host_devices(limits: &wgpu::Limits) -> [(wgpu::Device, wgpu::Queue); 2] {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let same = |adapter: &wgpu::Adapter| {
        let (info, used) = (adapter.get_info(), gpu().info().clone());
        (info.name, info.backend) == (used.name, used.backend)
    };
    let adapter = adapters.into_iter().find(same).expect("the adapter of the tests");
    let description = wgpu::DeviceDescriptor {
        required_limits: limits.clone(),
        ..wgpu::DeviceDescriptor::default()
    };
    [(); 2].map(|()| pollster::block_on(adapter.request_device(&description)).expect("a device"))
}

/// Runs a shader whose bindings are `input` (0, words), `output` (1, words) and a uniform of zeros
/// (2), one invocation per item in workgroups of 64. Returns the output.
pub(crate) fn run_words(
    source: &str,
    input: &[u32],
    output_words: usize,
    items: usize,
) -> Vec<u32> {
    use wgpu::BufferUsages as Usage;
    let gpu = gpu();
    let fail = |error: splitplane_wgpu::GpuError| -> ! { panic!("{error}\n{source}") };
    let buffer = |words: usize, usage| {
        gpu.buffer("test", 4 * words as u64, usage).unwrap_or_else(|error| fail(error))
    };
    let pipeline = gpu.pipeline("test", source).unwrap_or_else(|error| fail(error));
    let given = buffer(input.len(), Usage::STORAGE | Usage::COPY_DST);
    let found = buffer(output_words, Usage::STORAGE | Usage::COPY_SRC);
    let zeros = buffer(4, Usage::UNIFORM | Usage::COPY_DST);
    gpu.queue().write_buffer(&given, 0, bytemuck::cast_slice(input));
    gpu.queue().write_buffer(&zeros, 0, &[0; 16]);
    let bindings = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: given.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: found.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 2, resource: zeros.as_entire_binding() },
        ],
    });
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        pass.dispatch_workgroups(items.div_ceil(64) as u32, 1, 1);
    }
    gpu.submit([encoder.finish()]).expect("commands");
    bytemuck::pod_collect_to_vec(&read(&found))
}

/// The bytes of a buffer with the usage `COPY_SRC`.
pub(crate) fn read(buffer: &wgpu::Buffer) -> Vec<u8> {
    let gpu = gpu();
    let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
    let readback = gpu.buffer("read back", buffer.size(), usage).expect("a buffer");
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &readback, 0, buffer.size());
    gpu.submit([encoder.finish()]).expect("commands");
    gpu.read_mapped(&readback, buffer.size()).expect("bytes")
}
