//! How rays lie on the device, and the mark of those that were not followed to their end.

use splitplane_core::ray::Ray;

/// The `triangle` of a hit on the device whose traversal the driver ended early; any hit then says 2.
/// Seen with Mesa's llvmpipe, which ends a shader's loops after 65,535 rounds.
pub const UNFINISHED: u32 = u32::MAX - 1;

/// The `triangle` of a hit that a lean kernel leaves to the retry, all of its walk or the last of it. Where no retry has taken it up, the ray was
/// not followed to its end.
pub(super) const DEFERRED: u32 = u32::MAX - 3;
/// See [`DEFERRED`].
pub(super) const UNSETTLED: u32 = u32::MAX - 4;

/// Bytes of a ray.
pub(super) const RAY_BYTES: u64 = size_of::<Ray>() as u64;

/// What a list of deferred rays is used for.
pub(super) const DEFERRED_USAGE: wgpu::BufferUsages =
    wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST);
