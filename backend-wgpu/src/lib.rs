#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]
#![cfg_attr(docsrs, feature(doc_cfg))]

pub mod backend;
pub mod builder;
pub mod device;
pub mod error;
pub mod options;
pub mod parity;
pub mod probe;
pub mod query;
mod scene_update;
pub mod selftest;

pub use device::{Traffic, adapters, gpu};

pub use adapters::{AdapterReport, Adapters, adapters};
pub use backend::WgpuBackend;
pub use builder::{
    DeviceBuild, DeviceMesh, Effort, KernelTime, MiddleStage, MovedMesh, MovedMeshError,
    PendingBuild, WgpuExecutor,
};
#[doc(hidden)]
pub use device::bounded::private_memory_of;
pub use device::health::panic_is_caught;
pub use error::{DriverLimit, GpuError, OpenError};
pub use gpu::Gpu;
pub use options::{OpenOptions, RayStack};
pub use parity::Parity;
pub use query::{
    DeviceQueryError, DeviceTree, Marked, Queries, SceneUniform, TreeParts, UNFINISHED,
    WgpuAccelerator, WgpuPointTree,
};

pub use scene_update::PendingSceneUpdate;
/// The version of wgpu that this crate is built with.
pub use wgpu;
