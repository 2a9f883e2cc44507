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
    /// How long the driver may take to open the device, for all the pipelines together that
    /// [`WgpuBackend::new`](crate::WgpuBackend::new) makes, and for each one that is made later. When
    /// `None`, a minute, and half an hour for Mesa's llvmpipe. No time at all lets it compile nothing.
    /// On Linux the time in which this process could have run, but others did, does not count, up to fifteen times the limit.
    ///
    /// A driver compiles inside the process, and nothing can end the thread in which it does: after
    /// [`GpuError::DriverLimit`](crate::GpuError::DriverLimit) that thread continues to take time
    /// and memory until it is done or the process ends. To avoid that, try the adapter in a child
    /// process first, which can be killed. Adapters of the known vendors need none of this
    /// ([`Adapter::is_trusted`](crate::device::adapters::Adapter::is_trusted)).
    pub driver_time: Option<Duration>,
    /// By how many bytes the memory that this process has for itself may grow while the driver does one
    /// of these things. When `None`, 2 GiB. What other threads allocate meanwhile counts too; `u64::MAX` is no
    /// limit. On Linux only: elsewhere there is none but that of time.
    pub driver_memory: Option<u64>,
    /// Where rays keep what they have yet to visit. When `None`, [`RayStack::Workgroup`] for adapters of AMD, by the number of the vendor
    /// or, where there is none, the name, and [`RayStack::Private`] for all others. Answers are the same; only their time may
    /// differ. A device that a host owns tells less, in a browser nothing: see [`Gpu::with_ray_stack`](crate::Gpu::with_ray_stack).
    pub ray_stack: Option<RayStack>,
}

/// Where a ray keeps the nodes that it has yet to visit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RayStack {
    /// In the memory of the invocation, WGSL's address space `private`. On an H100 rays took 1.3 to 1.6 times as long without
    /// it: the memory of workgroups takes the nearest cache away from the tree.
    Private,
    /// In the memory of the workgroup, WGSL's address space `workgroup`, 9 KiB for 64 rays. Mesa's compiler for AMD keeps private
    /// arrays in registers and chooses among them by comparisons; without them closest hits take 64 registers in place of 112, and
    /// a fifth fewer instructions. How fast that is has been measured on no card of AMD's.
    Workgroup,
}
