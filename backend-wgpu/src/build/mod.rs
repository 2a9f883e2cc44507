//! Building trees on a device: the schedule's executor and what it works on.

pub(crate) mod buffers;
pub(crate) mod capacities;
pub mod executor;
pub(crate) mod kernels;
pub mod pending;
pub mod profile;
pub mod source;

pub use executor::WgpuExecutor;
pub use pending::{DeviceBuild, Effort, PendingBuild};
pub use profile::KernelTime;
pub use source::DeviceMesh;
