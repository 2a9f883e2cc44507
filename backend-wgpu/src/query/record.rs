//! Queries over rays that are on the device, recorded into a host's commands.

use bytemuck::{Pod, Zeroable};
#[cfg(doc)]
use splitplane_core::certify::UNDECIDED_HIT;
use splitplane_core::ray::{Culling, Hit, QueryOptions, Ray};
use splitplane_core::traverse::Query;

use super::error::DeviceQueryError;
use super::pipelines::{Queries, QueryKernel};
use super::tree::DeviceTree;
use crate::error::GpuError;
use crate::gpu::Gpu;

/// Invocations of a workgroup of the query kernels.
const WORKGROUP: u32 = 64;

/// The `triangle` of a hit on the device whose traversal the driver ended early; any hit then says 2.
/// Seen with Mesa's llvmpipe, which ends a shader's loops after 65,535 rounds.
pub const UNFINISHED: u32 = u32::MAX - 1;

/// Bytes of a ray.
pub(super) const RAY_BYTES: u64 = size_of::<Ray>() as u64;

/// Bytes of an answer on the device.
pub(super) const fn result_bytes(query: Query) -> u64 {
    match query {
        Query::Closest => size_of::<Hit>() as u64,
        Query::Any => size_of::<u32>() as u64,
    }
}

/// The uniform `batch` of the query kernels; twin of `Batch` in `query.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub(super) struct BatchUniform {
    count: u32,
    culling: u32,
    ignore: u32,
    padding: u32,
}

impl BatchUniform {
    pub(super) fn new(count: u32, options: &QueryOptions<'_>) -> BatchUniform {
        let culling = match options.culling {
            Culling::None => 0,
            Culling::Back => 1,
            Culling::Front => 2,
        };
        // No triangle has the index u32::MAX.
        let ignore = options.ignore.unwrap_or(u32::MAX);
        BatchUniform { count, culling, ignore, padding: 0 }
    }
}

/// Workgroups in rows: one dimension may be too short for all. The last row may reach beyond the
/// end; kernels compare their index with the count.
pub(super) fn workgroup_grid(gpu: &Gpu, workgroups: u32) -> [u32; 2] {
    let most = gpu.device().limits().max_compute_workgroups_per_dimension.max(1);
    if workgroups <= most {
        return [workgroups, 1];
    }
    let rows = workgroups.div_ceil(most);
    [workgroups.div_ceil(rows), rows]
}

/// The buffers of one dispatch of a query.
pub(super) struct QueryBuffers<'a> {
    pub(super) rays: &'a wgpu::Buffer,
    pub(super) results: &'a wgpu::Buffer,
    pub(super) batch: &'a wgpu::Buffer,
}

impl Queries {
    /// Records the closest hits of the first `count` rays of a buffer: 32 bytes a [`Ray`], 16 bytes
    /// a [`Hit`]. Both need the usage `STORAGE`; the rays may be written by commands before. Nothing
    /// crosses to the host. Under llvmpipe a hit may be [`UNFINISHED`].
    ///
    /// Under accuracy `exact` a hit whose triangle is [`UNDECIDED_HIT`] is left open, whatever the options
    /// say of such rays: nothing that may be hit is nearer than its `t`. That of the other hits is the
    /// exact one; their `t` is within a unit in the last place of the distances involved (which is
    /// more than one of its own where the ray starts next to the triangle), their weights likewise.
    ///
    /// How many rays one submission can take is the host's care: drivers end submissions that take
    /// seconds.
    ///
    /// # Errors
    /// Buffers that do not suit, more rays than one binding can hold, a device that fails, or accuracy
    /// `exact` on one whose arithmetic is not known to be the CPU's ([`Queries::is_certain`]).
    pub fn record_closest_hits(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        tree: &DeviceTree,
        rays: &wgpu::Buffer,
        hits: &wgpu::Buffer,
        count: u32,
        options: &QueryOptions<'_>,
    ) -> Result<(), DeviceQueryError> {
        self.record_for_host(encoder, tree, [rays, hits], count, options, Query::Closest)
    }

    /// Records, for the first `count` rays of a buffer, whether they hit anything: one `u32` a ray,
    /// 1 for a hit and 0 for none (2 for [`UNFINISHED`], 3 for [`UNDECIDED_HIT`]).
    /// Otherwise as [`Queries::record_closest_hits`].
    ///
    /// # Errors
    /// As for [`Queries::record_closest_hits`].
    pub fn record_any_hits(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        tree: &DeviceTree,
        rays: &wgpu::Buffer,
        occluded: &wgpu::Buffer,
        count: u32,
        options: &QueryOptions<'_>,
    ) -> Result<(), DeviceQueryError> {
        self.record_for_host(encoder, tree, [rays, occluded], count, options, Query::Any)
    }

    fn record_for_host(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        tree: &DeviceTree,
        [rays, results]: [&wgpu::Buffer; 2],
        count: u32,
        options: &QueryOptions<'_>,
        query: Query,
    ) -> Result<(), DeviceQueryError> {
        self.may_answer(options)?;
        if count == 0 {
            return Ok(());
        }
        self.suits("rays", rays, u64::from(count) * RAY_BYTES)?;
        self.suits("results", results, u64::from(count) * result_bytes(query))?;
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let batch = self.gpu().buffer("batch", size_of::<BatchUniform>() as u64, usage)?;
        // A buffer of its own a call: writes of the queue come before all recorded commands.
        let uniform = BatchUniform::new(count, options);
        self.gpu().queue().write_buffer(&batch, 0, bytemuck::bytes_of(&uniform));
        let buffers = QueryBuffers { rays, results, batch: &batch };
        self.dispatch(encoder, tree, &buffers, count, options, query)?;
        Ok(())
    }

    /// Whether a host's buffer can be bound for so many bytes.
    fn suits(
        &self,
        what: &'static str,
        buffer: &wgpu::Buffer,
        needed: u64,
    ) -> Result<(), DeviceQueryError> {
        if buffer.size() < needed {
            let bytes = buffer.size();
            return Err(DeviceQueryError::BufferTooSmall { what, bytes, needed });
        }
        if !buffer.usage().contains(wgpu::BufferUsages::STORAGE) {
            return Err(DeviceQueryError::BufferUsage { what });
        }
        let allowed = self.gpu().device().limits().max_storage_buffer_binding_size;
        if needed > allowed {
            let limit = "max_storage_buffer_binding_size";
            return Err(GpuError::Limit { what: what.into(), limit, needed, allowed }.into());
        }
        Ok(())
    }

    /// Records one dispatch. Only the parts of the buffers that the rays need are bound.
    pub(super) fn dispatch(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        tree: &DeviceTree,
        buffers: &QueryBuffers<'_>,
        count: u32,
        options: &QueryOptions<'_>,
        query: Query,
    ) -> Result<(), GpuError> {
        let kernel = QueryKernel::of(query, options);
        let pipeline = self.pipeline(kernel)?;
        let part = |buffer, bytes: u64| {
            wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer,
                offset: 0,
                size: wgpu::BufferSize::new(u64::from(count) * bytes),
            })
        };
        let [nodes, references, triangles, scene] = tree.bind_group_entries(0);
        let bindings = self.gpu().device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("query"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[
                nodes,
                references,
                triangles,
                scene,
                wgpu::BindGroupEntry { binding: 4, resource: part(buffers.rays, RAY_BYTES) },
                wgpu::BindGroupEntry {
                    binding: 5,
                    resource: part(buffers.results, result_bytes(query)),
                },
                wgpu::BindGroupEntry { binding: 6, resource: buffers.batch.as_entire_binding() },
            ],
        });
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("query"),
            timestamp_writes: None,
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        let [x, y] = workgroup_grid(self.gpu(), count.div_ceil(WORKGROUP));
        pass.dispatch_workgroups(x, y, 1);
        Ok(())
    }
}
