#![doc = include_str!("../README.md")]

pub mod backend;
pub mod buffers;
pub mod executor;
pub mod kernels;
mod scatter;

pub use backend::CpuBackend;
pub use executor::CpuExecutor;
