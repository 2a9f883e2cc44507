#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]

mod accelerator;
pub mod auto_preset;
mod backend;
mod build;
mod cancel;
#[doc(hidden)]
pub mod clock;
mod layout;
mod memory;
mod near;
mod parallel;
mod points;
mod scene;
mod simd;
#[doc(hidden)]
pub mod span;
#[doc(hidden)]
pub mod testing;
mod trace;

pub use accelerator::CpuAccelerator;
pub use backend::CpuBackend;
pub use build::twin::CpuExecutor;
#[doc(hidden)]
pub use build::twin::buffers;
#[doc(hidden)]
pub use memory::Memory;
pub use points::{CpuPointTree, KeptBytes};
pub use scene::CpuScene;
pub use simd::InstructionSet;
