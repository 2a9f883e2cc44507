#![doc = include_str!("../README.md")]

pub mod backend;
pub mod best;
pub mod buffers;
pub(crate) mod cached;
pub(crate) mod every_set;
pub mod executor;
pub(crate) mod kernels;
mod lookout;
pub mod query;
mod scatter;

pub use backend::CpuBackend;
pub use executor::CpuExecutor;
pub use query::{CpuAccelerator, InstructionSet};
