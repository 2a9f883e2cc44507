//! Queries over rays that are on the device, recorded into a host's commands.

use std::sync::PoisonError;

use splitplane_core::kernel::{QueryBuffer, QueryKernel, QueryUniform, RayQueries, Slot};
use splitplane_core::layout::BatchUniform;
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::QueryOptions;
#[cfg(doc)]
use splitplane_core::ray::{Hit, Ray};

use super::asked::Asked;
use super::error::DeviceQueryError;
#[cfg(doc)]
use super::layout::UNFINISHED;
use super::layout::{DEFERRED_USAGE, RAY_BYTES};
use super::pipelines::{Queries, triangles_of};
use super::tree::DeviceTree;
use crate::device::kernel_set::Bound;
use crate::device::once;
use crate::error::GpuError;

/// The buffers of one query.
pub(super) struct QueryBuffers<'a> {
    pub(super) rays: &'a wgpu::Buffer,
    pub(super) results: &'a wgpu::Buffer,
    /// Of at least [`Asked::scratch_bytes`] for each ray, where there are any.
    pub(super) scratch: Option<&'a wgpu::Buffer>,
    pub(super) batch: &'a wgpu::Buffer,
    /// Of at least [`QueryKernel::deferred_bytes`]; what it holds does not matter.
    pub(super) deferred: &'a wgpu::Buffer,
}

impl Queries {
    /// Records the closest hits of the first `count` rays of a buffer: 32 bytes per [`Ray`], 16
    /// bytes per [`Hit`]. Both need the usage `STORAGE`; the rays may be written by commands
    /// before. Nothing crosses to the host. Under llvmpipe a hit may be [`UNFINISHED`].
    ///
    /// Under accuracy `exact` a hit whose triangle is [`Hit::UNDECIDED`] is undecided, whatever the
    /// options say about such rays: nothing that may be hit is nearer than its `t`. That of the
    /// other hits is the exact one; their `t` is within a unit in the last place of the distances
    /// involved (which is more than one of its own where the ray starts next to the triangle),
    /// their weights likewise.
    ///
    /// How many rays one submission can take is the host's care: drivers end submissions that take
    /// seconds.
    ///
    /// # Errors
    /// Unsuitable buffers, more rays than one binding can hold, a device that fails, or accuracy
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

    /// Records, for the first `count` rays of a buffer, whether they hit anything: one `u32` per
    /// ray, 1 for a hit and 0 for none (2 for [`UNFINISHED`], 3 for [`Hit::UNDECIDED`]). Otherwise
    /// as [`Queries::record_closest_hits`].
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
        self.suits("results", results, u64::from(count) * QueryKernel::result_bytes(query))?;
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let batch = self.gpu().buffer("batch", size_of::<BatchUniform>() as u64, usage)?;
        // Each call needs its own buffer: writes of the queue come before all recorded commands.
        let uniform = BatchUniform::new(count, options);
        self.gpu().queue().write_buffer(&batch, 0, bytemuck::bytes_of(&uniform));
        let deferred = self.deferred_list(count)?;
        let buffers =
            QueryBuffers { rays, results, scratch: None, batch: &batch, deferred: &deferred };
        self.dispatch(encoder, tree, &buffers, count, options, Asked::Hit(query))?;
        Ok(())
    }

    /// Whether this many bytes of a host's buffer can be bound.
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

    /// Records a lean kernel, and the one for the rays that it defers. Only the parts of the buffers that the
    /// rays need are bound.
    pub(super) fn dispatch(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        tree: &DeviceTree,
        buffers: &QueryBuffers<'_>,
        count: u32,
        options: &QueryOptions<'_>,
        asked: Asked,
    ) -> Result<(), GpuError> {
        let variant = self.variant(asked.test(options), tree.triangles());
        let compressed = tree.compressed_for(options);
        let part = |buffer, bytes: u64| wgpu::BufferBinding {
            buffer,
            offset: 0,
            size: wgpu::BufferSize::new(u64::from(count) * bytes),
        };
        let whole = wgpu::Buffer::as_entire_buffer_binding;
        let find = |bound: &Bound<RayQueries>| match bound.slot {
            Slot::Uniform(QueryUniform::Scene) => Some(whole(tree.scene())),
            Slot::Uniform(QueryUniform::Batch) => Some(whole(buffers.batch)),
            Slot::Uniform(_) => None,
            Slot::Storage(binding) => match binding.buffer {
                QueryBuffer::Nodes => Some(whole(tree.nodes())),
                QueryBuffer::LeafReferences => Some(whole(tree.leaf_references())),
                QueryBuffer::Triangles => Some(triangles_of(bound, &variant, tree.triangles())),
                QueryBuffer::Rays => Some(part(buffers.rays, RAY_BYTES)),
                QueryBuffer::Listed if asked.scratch_bytes() > 0 => {
                    buffers.scratch.map(|scratch| part(scratch, asked.scratch_bytes()))
                }
                QueryBuffer::Hits
                | QueryBuffer::Occluded
                | QueryBuffer::Listed
                | QueryBuffer::Counted => Some(part(buffers.results, asked.result_bytes())),
                QueryBuffer::Deferred => Some(wgpu::BufferBinding {
                    buffer: buffers.deferred,
                    offset: 0,
                    size: wgpu::BufferSize::new(QueryKernel::deferred_bytes(count)),
                }),
                QueryBuffer::CompressedNodes => compressed.map(|part| whole(&part.nodes)),
                QueryBuffer::CompressedReferences => compressed.map(|part| whole(&part.references)),
                _ => None,
            },
        };
        // No ray is deferred yet.
        encoder.clear_buffer(buffers.deferred, 0, Some(4));
        for kernel in asked.kernels(compressed.is_some()) {
            once::record(self.gpu(), &self.pipelines, encoder, (kernel, &variant), count, find)?;
        }
        Ok(())
    }

    /// A list for the deferred rays of a batch. One serves all commands that hosts record: what is recorded later
    /// runs later.
    fn deferred_list(&self, rays: u32) -> Result<wgpu::Buffer, GpuError> {
        let mut held = self.deferred.lock().unwrap_or_else(PoisonError::into_inner);
        let needed = QueryKernel::deferred_bytes(rays);
        if let Some(list) = held.as_ref().filter(|list| list.size() >= needed) {
            return Ok(list.clone());
        }
        let list = self.gpu().buffer("deferred rays", needed, DEFERRED_USAGE)?;
        *held = Some(list.clone());
        Ok(list)
    }
}
