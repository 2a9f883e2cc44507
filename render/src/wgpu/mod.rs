//! Frames on a GPU: the kernels in WGSL, over a tree that is on the device. Pictures have the same bits
//! as those of the CPU on devices whose parity is bitwise.
//!
//! A frame is recorded without reading its counters: as many waves as its plan allows, each kernel
//! over a fixed grid that loops to a counter on the device. What comes back is 64 bytes of
//! counters, and the requested outputs. A frame of one slice is one submission; of several, each
//! slice is one, so that none holds more than [`Room::GPU`](crate::Room::GPU) paths per wave.

mod brought;
mod buffers;
mod exact_frame;
mod executor;
mod keyframes;
mod renderer;
mod room;
mod undecided;

pub use executor::{FrameJob, WgpuExecutor};
pub use keyframes::{KEYFRAME_BYTES, Keyframes};
pub use renderer::WgpuRenderer;
pub(crate) use renderer::beyond_device;
#[cfg(feature = "cpu")]
pub(crate) use renderer::check_target;

/// Limits of the queues of a frame on a device, for plans that are made before a renderer is.
pub fn room(gpu: &splitplane_wgpu::Gpu) -> crate::Room {
    room::of(gpu)
}
