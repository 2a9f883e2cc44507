//! What the device tests share: one device a process, and small kernels run over words.

#![allow(dead_code, reason = "each test uses a part")]

use std::sync::{Arc, OnceLock};

use splitplane_wgpu::{Gpu, OpenOptions};

/// The device of this process, with WebGPU's default limits. `SPLITPLANE_ADAPTER` names another
/// adapter than the first.
///
/// # Panics
/// If no device can be opened: a test without a device must not pass.
pub(crate) fn gpu() -> Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    let open = || {
        let adapter = std::env::var("SPLITPLANE_ADAPTER").ok();
        let options = OpenOptions { default_limits: true, adapter, ..Default::default() };
        match Gpu::open(&options) {
            Ok(gpu) => Arc::new(gpu),
            Err(error) => panic!("the device tests need a GPU or a software Vulkan: {error}"),
        }
    };
    GPU.get_or_init(open).clone()
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

/// Whether the device is Mesa's software rasteriser.
pub(crate) fn is_llvmpipe() -> bool {
    gpu().info().name.contains("llvmpipe")
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
