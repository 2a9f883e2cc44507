//! A kernel that no schedule runs, recorded by itself.

use super::bindings::bind;
use super::kernel_set::{Bound, DeviceSet};
use super::pipelines::Pipelines;
use crate::device::gpu::Gpu;
use crate::error::GpuError;

/// Workgroups in rows: one dimension may be too short for all. The last row may reach beyond the
/// end; kernels compare their index with the count.
fn rows(gpu: &Gpu, workgroups: u32) -> [u32; 2] {
    let most = gpu.limits().max_compute_workgroups_per_dimension.max(1);
    if workgroups <= most {
        return [workgroups, 1];
    }
    let rows = workgroups.div_ceil(most);
    [workgroups.div_ceil(rows), rows]
}

/// Records one dispatch of a kernel over this many items, with each binding as `find` has it.
///
/// # Errors
/// A kernel that the device refuses; a binding that `find` lacks.
pub(crate) fn record<'a, K: DeviceSet>(
    gpu: &Gpu,
    pipelines: &Pipelines,
    encoder: &mut wgpu::CommandEncoder,
    (kernel, variant): (K::Kernel, &K::Variant),
    things: u32,
    find: impl Fn(&Bound<K>) -> Option<wgpu::BufferBinding<'a>>,
) -> Result<(), GpuError> {
    let compiled = pipelines.get::<K>(gpu, kernel, variant)?;
    let bound = K::bindings(kernel, variant);
    let group = bind::<K>(gpu, &compiled.layout, kernel, &bound, pipelines.counted(), find)?;
    let row = K::kernel(kernel);
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
        label: Some(row.name),
        timestamp_writes: None,
    });
    pass.set_pipeline(&compiled.pipeline);
    pass.set_bind_group(0, &group, &[]);
    let [x, y] = rows(gpu, row.grid.workgroups(things));
    pass.dispatch_workgroups(x, y, 1);
    Ok(())
}
