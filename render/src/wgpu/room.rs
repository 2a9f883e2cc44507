//! How much a frame may hold on a device, and how many workgroups its grids have.

use crate::kernel::{Kernel, TRACED};
use crate::plan::Room;
use splitplane_core::ray::Ray;
use splitplane_wgpu::Gpu;

/// Workgroups along one dimension, by WebGPU's default limits.
const MOST_GROUPS: u32 = 65_535;
/// Workgroups of a grid whose chunks all take about as long: enough to fill a large GPU.
const EVEN_GROUPS: u32 = 2048;

/// Limits of the queues of a frame on a device. No queue needs more workgroups than a grid has.
pub(super) fn of(gpu: &Gpu) -> Room {
    let limits = gpu.limits();
    let queue = u64::from(MOST_GROUPS) * u64::from(TRACED) * size_of::<Ray>() as u64;
    let bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    Room { buffer_bytes: bytes.min(queue), ..Room::GPU }
}

/// Workgroups of a grid for which `wanted` are requested. How long a ray takes varies, and on a
/// device that is a CPU so does all work. In both cases each chunk has a workgroup of its own,
/// since Mesa's llvmpipe silently ends the loops of an invocation after 65,535 rounds, and nothing
/// may follow a ray that took them all.
pub(super) fn groups(gpu: &Gpu, kernel: Kernel, wanted: u32) -> u32 {
    let most = if kernel.traces() || gpu.is_software() { MOST_GROUPS } else { EVEN_GROUPS };
    wanted.clamp(1, most)
}
