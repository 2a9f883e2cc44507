//! The GPU backend of splitplane: the build schedule and the queries in WGSL, through wgpu.
//!
//! [`Gpu`] is a device, opened headless or borrowed from a host.

pub mod error;
pub mod gpu;
pub mod query;

pub use error::{GpuError, OpenError};
pub use gpu::{Gpu, OpenOptions};
pub use query::{DeviceQueryError, DeviceTree, Queries, SceneUniform, TreeParts, WgpuAccelerator};
