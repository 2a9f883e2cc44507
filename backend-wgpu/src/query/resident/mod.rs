//! Scenes of many objects that are wholly on a device: rays find the instances that they enter there.
//!
//! In each wave every ray that is not done enters its next instance, and is traced there
//! ([`QueryKernel::WAVE`](splitplane_core::kernel::QueryKernel::WAVE), `MASKED_WAVE` where there are opacity masks, and `TraceShapes` where there are
//! shapes). Several waves are one submission; then the host reads how many
//! rays are done. What is on the device is the scene as [`packed`](splitplane_core::backend::scene::packed) has it.

mod bindings;
mod failed;
mod gone;
mod held;
mod near;
mod reserved;
mod room;
mod scene;
mod waves;

pub use bindings::SceneBindings;
pub use scene::WgpuScene;
