//! The GPU backend of splitplane: the build schedule and the queries in WGSL, through wgpu.
//!
//! [`Gpu`] is a device, opened headless or borrowed from a host.

pub mod backend;
pub mod build;
pub mod error;
pub mod gpu;

pub use backend::WgpuBackend;
pub use build::{KernelTime, PendingBuild, WgpuExecutor};
pub use error::{GpuError, OpenError};
pub use gpu::{Gpu, OpenOptions};
