//! Query kernels from any text, such as one with a fault.

use std::collections::HashMap;
use std::sync::Mutex;

use splitplane_core::kernel::QueryKernel;
use splitplane_core::ray::Ray;
use splitplane_wgpu::DeviceTree;

fn storage(bytes: usize) -> wgpu::Buffer {
    let usage =
        wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    super::gpu().buffer("test", bytes as u64, usage).expect("a buffer")
}

/// What a source was compiled to.
type Compiled = (wgpu::BindGroupLayout, wgpu::ComputePipeline);

/// The pipeline of a source. Compiled once: that takes longer than a batch, and a fault leaves one of two sources as it is.
fn compiled(source: &str, retries: bool, counts: bool) -> Compiled {
    static ALL: Mutex<Option<HashMap<(String, bool), Compiled>>> = Mutex::new(None);
    let key = (source.to_owned(), retries);
    if let Some(known) = ALL.lock().unwrap().get_or_insert_default().get(&key) {
        return known.clone();
    }
    let gpu = super::gpu();
    // Stated, since a fault may leave a binding unused.
    let stages = wgpu::ShaderStages::COMPUTE;
    let mut slots = DeviceTree::bind_group_layout_entries(0, stages).to_vec();
    let eighth = counts.then_some((8, false));
    for (binding, read_only) in [(4, true), (5, false), (7, retries)].into_iter().chain(eighth) {
        slots.push(wgpu::BindGroupLayoutEntry { binding, ..slots[0] });
        let slot = slots.last_mut().expect("pushed");
        slot.ty = wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only },
            has_dynamic_offset: false,
            min_binding_size: None,
        };
    }
    slots.push(wgpu::BindGroupLayoutEntry { binding: 6, ..slots[3] });
    let descriptor = wgpu::BindGroupLayoutDescriptor { label: None, entries: &slots };
    let layout = gpu.device().create_bind_group_layout(&descriptor);
    let pipeline = gpu.pipeline_with_layout("planted", source, &layout).expect("a pipeline");
    let made = (layout, pipeline);
    ALL.lock().unwrap().get_or_insert_default().insert(key, made.clone());
    made
}

/// What the sources of a lean kernel, and of that for the rays it defers, write: `each` bytes for each ray. And how many
/// rays were deferred. `room` is what the batch's uniform says of lists.
pub(crate) fn answers(
    sources: &[String; 2],
    tree: &DeviceTree,
    rays: &[Ray],
    each: usize,
    room: u32,
) -> (Vec<u8>, u32) {
    let gpu = super::gpu();
    let (given, results) = (storage(size_of_val(rays)), storage(each * rays.len()));
    // Kernels that count have their lists besides.
    let counts = sources[0].contains("@binding(8)");
    let lists = counts.then(|| storage(4 * room as usize * rays.len()));
    gpu.queue().write_buffer(&given, 0, bytemuck::cast_slice(rays));
    let deferred = storage(QueryKernel::deferred_bytes(rays.len() as u32) as usize);
    gpu.queue().write_buffer(&deferred, 0, &[0; 4]);
    let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
    let batch = gpu.buffer("batch", 16, usage).expect("a buffer");
    let words = [rays.len() as u32, 0, u32::MAX, room];
    gpu.queue().write_buffer(&batch, 0, bytemuck::cast_slice(&words));
    let mut entries = tree.bind_group_entries(0).to_vec();
    let fifth = lists.as_ref().unwrap_or(&results);
    let eighth = counts.then_some((8, &results));
    let bound = [(4, &given), (5, fifth), (6, &batch), (7, &deferred)];
    for (binding, buffer) in bound.into_iter().chain(eighth) {
        let resource = buffer.as_entire_binding();
        entries.push(wgpu::BindGroupEntry { binding, resource });
    }
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    for (retries, source) in [false, true].into_iter().zip(sources) {
        let (layout, pipeline) = compiled(source, retries, counts);
        let bindings = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &layout,
            entries: &entries,
        });
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        // Invocations of a retry may be fewer than the rays that are left to them.
        let workgroups = rays.len().div_ceil(if retries { 128 } else { 64 });
        pass.dispatch_workgroups(workgroups as u32, 1, 1);
    }
    gpu.submit([encoder.finish()]).expect("commands");
    let count = bytemuck::pod_read_unaligned(&super::read(&deferred)[..4]);
    (super::read(&results), count)
}
