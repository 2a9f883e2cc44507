//! How rays lie on the device, and the mark of those that were not followed to their end.

use splitplane_core::ray::Ray;

/// The `triangle` of a hit on the device whose traversal the driver ended early; any hit then says 2.
/// Seen with Mesa's llvmpipe, which ends a shader's loops after 65,535 rounds.
pub const UNFINISHED: u32 = u32::MAX - 1;

/// Bytes of a ray.
pub(super) const RAY_BYTES: u64 = size_of::<Ray>() as u64;

/// What a list of deferred rays is used for.
pub(super) const DEFERRED_USAGE: wgpu::BufferUsages =
    wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST);
