//! Tests of the ray tracer, one module a file, in one program. Those on a device share it and what
//! it compiled.

mod appearance;
mod common;
#[cfg(feature = "wgpu")]
mod device;
mod energy;
mod environment;
mod glass;
#[cfg(feature = "wgpu")]
mod gpu_compressed;
#[cfg(feature = "wgpu")]
mod gpu_exact;
#[cfg(feature = "wgpu")]
mod gpu_halves;
#[cfg(feature = "wgpu")]
mod gpu_light;
#[cfg(feature = "wgpu")]
mod gpu_lockstep;
mod gpu_marked;
#[cfg(feature = "wgpu")]
mod gpu_pictures;
#[cfg(feature = "wgpu")]
mod gpu_ray_stacks;
mod instance_updates;
mod instances;
mod parts;
mod paths;
mod photons;
mod rough;
mod shadows;
mod shapes;
mod shining_shapes;
mod slices;
