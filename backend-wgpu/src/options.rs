//! How to open a device.

use std::time::Duration;

/// How to open a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OpenOptions {
    /// Part of an adapter's name in any case, or its index in the list of adapters. When `None`,
    /// the environment variable `WGPU_ADAPTER_NAME` decides, and without it the kind of adapter.
    pub adapter: Option<String>,
    /// Request no more than WebGPU's default limits, whatever the adapter offers.
    pub default_limits: bool,
    /// How long to wait for the device before it counts as hanging.
    pub timeout: Duration,
}

impl OpenOptions {
    /// The time-out unless another one is given.
    pub const DEFAULT_TIMEOUT: Duration = Duration::from_secs(60);
}

impl Default for OpenOptions {
    fn default() -> OpenOptions {
        OpenOptions { adapter: None, default_limits: false, timeout: OpenOptions::DEFAULT_TIMEOUT }
    }
}
