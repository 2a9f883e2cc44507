//! How to open a device.

use std::time::Duration;

/// How to open a device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OpenOptions {
    /// Part of an adapter's name in any case, or its index in the list of adapters. When `None`,
    /// the environment variable `WGPU_ADAPTER_NAME` decides, and without it the kind of adapter.
    pub adapter: Option<String>,
    /// Request no more than WebGPU's default limits, whatever the adapter offers.
    pub default_limits: bool,
    /// How long to wait for the device before it counts as hanging. When `None`, a minute for
    /// hardware and half an hour for software, which may take that long for what hardware does at
    /// once.
    pub timeout: Option<Duration>,
}

/// How long to wait for a device of this type.
pub(crate) fn default_timeout(device_type: wgpu::DeviceType) -> Duration {
    match device_type {
        wgpu::DeviceType::Cpu => Duration::from_secs(1800),
        _ => Duration::from_secs(60),
    }
}
