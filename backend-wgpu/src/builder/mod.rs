//! Building trees on a device: the schedule's executor and what it works on.

pub(crate) mod buffers;
pub(crate) mod capacities;
pub mod executor;
mod middle_stage;
mod moved_mesh;
pub mod pending;
pub(crate) mod shared;
pub mod source;
pub mod views;

pub use crate::device::profile::{self, KernelTime};
pub use executor::{Build, WgpuExecutor};
pub use middle_stage::MiddleStage;
pub use moved_mesh::{MovedMesh, MovedMeshError};
pub use pending::{DeviceBuild, Effort, PendingBuild};
pub use source::DeviceMesh;
