//! Drivers: which of them are trusted, and what each may take where the caller does not say.

use std::time::Duration;

use super::bounded::Bounds;
use crate::options::{OpenOptions, RayStack};

/// The PCI numbers of vendors of GPUs: NVIDIA, AMD, Intel, Apple, Qualcomm, ARM.
const VENDORS: [u32; 6] = [0x10de, AMD, 0x8086, 0x106b, 0x5143, 0x13b5];

const AMD: u32 = 0x1002;

/// By how much memory may grow while a driver compiles.
const MEMORY: u64 = 2 << 30;

/// Whether this driver may compile in the program's own process without having been tried in another.
pub(super) fn is_trusted(info: &wgpu::AdapterInfo) -> bool {
    match info.device_type {
        wgpu::DeviceType::DiscreteGpu | wgpu::DeviceType::IntegratedGpu => {
            // Metal names no vendors; its drivers are Apple's, in a process of their own.
            VENDORS.contains(&info.vendor) || info.backend == wgpu::Backend::Metal
        }
        wgpu::DeviceType::Cpu => info.driver == "llvmpipe",
        wgpu::DeviceType::VirtualGpu | wgpu::DeviceType::Other => false,
    }
}

/// What the driver of this adapter may take.
pub(super) fn bounds(options: &OpenOptions, info: &wgpu::AdapterInfo) -> Bounds {
    Bounds {
        time: options.driver_time.unwrap_or_else(|| default_time(info)),
        memory: options.driver_memory.unwrap_or(MEMORY),
    }
}

/// How long the driver of this adapter may compile. Software shares the processors with whatever else runs:
/// where it is known to come to an end, it is waited for as for its other work.
pub(super) fn default_time(info: &wgpu::AdapterInfo) -> Duration {
    match is_trusted(info) {
        true => default_timeout(info.device_type),
        false => Duration::from_secs(60),
    }
}

/// Where rays keep their stacks on this adapter, unless the caller says so.
pub(super) fn ray_stack(info: &wgpu::AdapterInfo) -> RayStack {
    // Metal and browsers give no numbers of vendors.
    let name = info.name.to_lowercase();
    let of_amd =
        info.vendor == AMD || name.split(' ').any(|word| word == "amd" || word == "radeon");
    match of_amd && info.device_type != wgpu::DeviceType::Cpu {
        true => RayStack::Workgroup,
        false => RayStack::Private,
    }
}

/// How long to wait for a device of this type.
pub(super) fn default_timeout(device_type: wgpu::DeviceType) -> Duration {
    match device_type {
        wgpu::DeviceType::Cpu => Duration::from_secs(1800),
        _ => Duration::from_secs(60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_keep_their_stacks_where_the_vendors_compilers_do_best() {
        let stack = |device_type, vendor, name: &str, backend| {
            let info = wgpu::AdapterInfo::new(device_type, backend);
            ray_stack(&wgpu::AdapterInfo { vendor, name: name.into(), ..info })
        };
        use wgpu::Backend::{BrowserWebGpu, Metal, Vulkan};
        use wgpu::DeviceType::{Cpu, DiscreteGpu, IntegratedGpu, Other};
        assert_eq!(stack(DiscreteGpu, AMD, "Radeon RX 6800", Vulkan), RayStack::Workgroup);
        assert_eq!(stack(DiscreteGpu, 0, "AMD Radeon Pro 5500M", Metal), RayStack::Workgroup);
        assert_eq!(stack(Other, 0, "amd rdna-2", BrowserWebGpu), RayStack::Workgroup);
        assert_eq!(stack(DiscreteGpu, 0, "Radeon RX 580", Metal), RayStack::Workgroup);
        assert_eq!(stack(DiscreteGpu, 0x10de, "NVIDIA H100", Vulkan), RayStack::Private);
        assert_eq!(stack(IntegratedGpu, 0x8086, "Intel(R) Iris(R) Xe", Vulkan), RayStack::Private);
        assert_eq!(stack(Cpu, 0x10005, "llvmpipe on an AMD EPYC", Vulkan), RayStack::Private);
    }

    #[test]
    fn drivers_that_nobody_knows_are_not_trusted() {
        use wgpu::DeviceType::{Cpu, DiscreteGpu, IntegratedGpu, VirtualGpu};
        let trusted = |device_type, vendor, driver: &str, backend| {
            let info = wgpu::AdapterInfo::new(device_type, backend);
            is_trusted(&wgpu::AdapterInfo { vendor, driver: driver.into(), ..info })
        };
        use wgpu::Backend::{Metal, Vulkan};
        assert!(trusted(DiscreteGpu, 0x10de, "NVIDIA", Vulkan));
        assert!(trusted(IntegratedGpu, 0x8086, "Intel open-source Mesa driver", Vulkan));
        assert!(trusted(IntegratedGpu, 0, "", Metal));
        assert!(trusted(Cpu, 0x10005, "llvmpipe", Vulkan));
        assert!(!trusted(Cpu, 0x1ae0, "SwiftShader driver", Vulkan));
        assert!(!trusted(DiscreteGpu, 0x1ae0, "new", Vulkan));
        // Whatever passes commands on to a card may compile by itself.
        assert!(!trusted(VirtualGpu, 0x10de, "venus", Vulkan));
    }
}
