//! A device: found, opened, tested and held within limits; and whatever kernel set runs on it, compiled,
//! bound and recorded from the set's table.

pub mod adapters;
pub mod awaited;
pub mod bindings;
pub(crate) mod bounded;
pub(crate) mod clock;
pub(crate) mod compiler;
pub(crate) mod deferred;
mod driver;
pub mod executor;
pub mod gpu;
pub(crate) mod halves;
pub(crate) mod health;
pub(crate) mod host;
pub mod kernel_set;
pub(crate) mod needs;
pub(crate) mod once;
pub(crate) mod patience;
pub mod pipelines;
pub mod profile;
pub mod readback;
pub(crate) mod scope;
pub(crate) mod stopwatch;
#[cfg(not(target_family = "wasm"))]
mod ticks;
pub mod traffic;
pub(crate) mod wait;
#[cfg(target_family = "wasm")]
pub(crate) mod web;

pub use awaited::Awaited;
pub use bindings::BindGroups;
pub use executor::{DeviceExecutor, Job, LoopControl, Piece, Round};
pub use kernel_set::{Bound, DeviceSet, Text};
pub use pipelines::{Compiled, Instrument, Pipelines};
pub use traffic::Traffic;
#[doc(hidden)]
pub use wait::{Wait, blocking};
