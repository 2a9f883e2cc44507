//! What the device tests share: one device a process.

#![allow(dead_code, reason = "each test uses a part")]

use std::sync::{Arc, OnceLock};

use splitplane_wgpu::{Gpu, OpenOptions};

/// The device of this process, with WebGPU's default limits. `SPLITPLANE_ADAPTER` names another
/// adapter than the first.
///
/// # Panics
/// If no device can be opened: a test without a device must not pass.
pub(crate) fn gpu() -> Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    let open = || {
        let adapter = std::env::var("SPLITPLANE_ADAPTER").ok();
        let options = OpenOptions { default_limits: true, adapter, ..Default::default() };
        match Gpu::open(&options) {
            Ok(gpu) => Arc::new(gpu),
            Err(error) => panic!("the device tests need a GPU or a software Vulkan: {error}"),
        }
    };
    GPU.get_or_init(open).clone()
}

/// Whether the device is Mesa's software rasteriser.
pub(crate) fn is_llvmpipe() -> bool {
    gpu().info().name.contains("llvmpipe")
}
