//! A kernel that no schedule runs, recorded by itself.

use splitplane_core::kernel::Grid;

use super::bindings::bind;
use super::kernel_set::{Bound, DeviceSet};
use super::pipelines::Pipelines;
use crate::device::gpu::Gpu;
use crate::error::GpuError;

/// Workgroups of a grid that may have fewer invocations than items: enough to fill a large GPU. A device that is a CPU gets all, since
/// Mesa's llvmpipe ends the loops of an invocation after 65,535 rounds, and nothing may follow a ray that took them all.
///
/// A retry by as many invocations as rays took an H100 0.8 ms for two million rays of which hardly any was deferred, two fifths of a batch: each
/// sets up its stack before it sees that nothing is left for it.
pub(crate) const FEW_WORKGROUPS: u32 = 1024;

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
    let workgroups = row.grid.workgroups(things);
    let few = matches!(row.grid, Grid::Few(..)) && !gpu.is_software();
    let [x, y] = rows(gpu, if few { workgroups.min(FEW_WORKGROUPS) } else { workgroups });
    pass.dispatch_workgroups(x, y, 1);
    Ok(())
}
