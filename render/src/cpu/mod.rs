//! Frames on the cores of this machine: the kernels through rayon, the rays through any
//! [`Accelerator`](splitplane_core::backend::Accelerator).

mod buffers;
mod by_light;
mod columns;
mod executor;
mod kernels;
mod photons;
mod renderer;
mod scatter;
mod traced;

pub use buffers::Buffers;
pub use executor::CpuExecutor;
pub use photons::{PhotonEnergy, PhotonReport};
pub use renderer::CpuRenderer;
