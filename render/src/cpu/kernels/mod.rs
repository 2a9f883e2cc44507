//! The kernels, a file each, by the names of their WGSL twins, and the order in which shadow rays are followed.

pub(crate) mod accumulate;
pub(crate) mod begin_slice;
pub(crate) mod begin_wave;
pub(crate) mod camera_rays;
pub(crate) mod first_costs;
pub(crate) mod first_hits;
pub(crate) mod next_paths;
pub(crate) mod resolve;
pub(crate) mod scan_spawned;
pub(crate) mod shade;
pub(crate) mod shadow_hits;
pub(crate) mod shadow_hits_through_glass;
pub(crate) mod shadow_rays;

/// Light is not followed beyond direct light.
pub(crate) const DIRECT: u32 = crate::settings::LightTransport::Direct as u32;
/// Paths of a chunk.
pub(crate) const CHUNK: usize = crate::kernel::CHUNK as usize;
