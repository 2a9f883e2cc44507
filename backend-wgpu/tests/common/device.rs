//! The device of a test program, for this package's tests and others'.

#![allow(dead_code, reason = "each program uses a part")]

use std::sync::{Arc, OnceLock};

use splitplane_wgpu::{Gpu, OpenOptions};

/// How tests open devices: with WebGPU's default limits, on the first adapter or that which
/// `SPLITPLANE_ADAPTER` names. Memory has no limit while shaders compile: other tests take some of
/// it meanwhile.
pub(crate) fn options() -> OpenOptions {
    let adapter = std::env::var("SPLITPLANE_ADAPTER").ok();
    OpenOptions {
        default_limits: true,
        adapter,
        driver_memory: Some(u64::MAX),
        ..OpenOptions::default()
    }
}

/// A device of a test's own: one that it loses, or whose traffic no other test adds to.
///
/// # Panics
/// If no device can be opened: a test without a device must not pass.
pub(crate) fn own_gpu() -> Gpu {
    Gpu::open(&options())
        .unwrap_or_else(|error| panic!("the device tests need a GPU or a software Vulkan: {error}"))
}

/// The device that all tests of this process share.
pub(crate) fn gpu() -> Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| Arc::new(own_gpu())).clone()
}

/// Whether the device is Mesa's software rasteriser.
pub(crate) fn is_llvmpipe() -> bool {
    gpu().info().name.contains("llvmpipe")
}
