#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod adapters;
pub mod backend;
mod bounded;
pub mod build;
mod compiler;
pub mod error;
pub mod gpu;
mod health;
mod host;
mod needs;
pub mod options;
pub mod parity;
pub mod probe;
pub mod query;
pub mod selftest;

pub use adapters::{AdapterReport, Adapters, adapters};
pub use backend::WgpuBackend;
pub use bounded::DriverLimit;
pub use build::{DeviceBuild, DeviceMesh, Effort, KernelTime, PendingBuild, WgpuExecutor};
pub use error::{GpuError, OpenError};
pub use gpu::Gpu;
pub use health::panic_is_caught;
pub use options::OpenOptions;
pub use parity::Parity;
pub use query::{
    DeviceQueryError, DeviceTree, Marked, Queries, SceneUniform, TreeParts, UNDECIDED_HIT,
    UNFINISHED, WgpuAccelerator,
};

/// The version of wgpu that this crate is built with.
pub use wgpu;
