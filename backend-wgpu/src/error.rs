//! What can go wrong on a device.

use thiserror::Error;

/// Why no device was opened.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum OpenError {
    /// No adapter was found.
    #[error("no GPU adapter was found")]
    NoAdapter,
    /// The adapter would not open.
    #[error("the adapter `{adapter}` cannot be opened: {reason}")]
    Unusable {
        /// The adapter's name.
        adapter: String,
        /// What wgpu says.
        reason: String,
    },
}

/// Why work on a device did not finish.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum GpuError {
    /// The device is gone; nothing can be done with it any more.
    #[error("the device was lost: {reason}")]
    Lost {
        /// What the driver says.
        reason: String,
    },
    /// The device did not finish in time.
    #[error("the device did not finish within {seconds} seconds")]
    TimedOut {
        /// How long was waited.
        seconds: u64,
    },
    /// A limit of the device is too low for what was asked.
    #[error("{what} needs {needed}, but the device's limit {limit} is {allowed}")]
    Limit {
        /// What was asked.
        what: String,
        /// The limit's name in WebGPU.
        limit: &'static str,
        /// What is needed.
        needed: u64,
        /// What the device allows.
        allowed: u64,
    },
    /// The device has no memory left.
    #[error("the device is out of memory: {what} needs {needed} bytes")]
    OutOfMemory {
        /// What was asked.
        what: String,
        /// Bytes asked for.
        needed: u64,
    },
    /// wgpu or the driver refused something that should be right: a bug here or there.
    #[error("the device refused a command: {0}")]
    Refused(String),
}

pub use splitplane_core::backend::BuildError;

impl From<GpuError> for BuildError {
    fn from(error: GpuError) -> BuildError {
        BuildError::Device(error.to_string())
    }
}
