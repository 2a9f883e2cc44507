//! What the tests of the ray tracer share: one device a process, and small scenes with every kind of
//! surface and light.

#![allow(dead_code, reason = "each test uses a part")]

pub(crate) mod scenes;

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use splitplane_core::backend::BuildOptions;
use splitplane_core::config::BuildConfig;
use splitplane_cpu::CpuBackend;
use splitplane_render::wgpu::WgpuRenderer;
use splitplane_wgpu::{DeviceTree, Gpu, OpenOptions, Parity, WgpuBackend};

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

/// Polls a future to its end, as an executor without anything else to do; and how often it gave way.
pub(crate) fn awaited<F: Future>(future: F) -> (F::Output, u32) {
    use std::task::{Context, Poll, Waker};
    let (mut future, mut gave_way) = (std::pin::pin!(future), 0);
    loop {
        match future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(out) => return (out, gave_way),
            Poll::Pending => gave_way += 1,
        }
        std::thread::sleep(std::time::Duration::from_micros(200));
    }
}

/// The renderer of this process, for one test at a time: what it compiled serves the next.
pub(crate) fn renderer() -> MutexGuard<'static, WgpuRenderer> {
    static RENDERER: OnceLock<Mutex<WgpuRenderer>> = OnceLock::new();
    let make = || {
        let mut renderer = WgpuRenderer::new(gpu()).expect("a renderer");
        renderer.set_parity(&Parity::Bitwise);
        Mutex::new(renderer)
    };
    let renderer = RENDERER.get_or_init(make);
    renderer.lock().unwrap_or_else(PoisonError::into_inner)
}

/// How the trees of the tests are built.
pub(crate) fn options() -> BuildOptions<'static> {
    BuildOptions::from(BuildConfig::default())
}

/// A scene with its tree on both sides.
pub(crate) struct Both {
    pub scene: scenes::Scene,
    pub cpu: splitplane_cpu::CpuAccelerator,
    pub device: DeviceTree,
}

/// Builds the tree of a scene on both sides.
pub(crate) fn both(scene: scenes::Scene) -> Both {
    static BACKEND: OnceLock<WgpuBackend> = OnceLock::new();
    let backend = BACKEND.get_or_init(|| WgpuBackend::without_selftest(Gpu::clone(&gpu())));
    let cpu = CpuBackend::new().build_accelerator(&scene.mesh(), &options()).expect("a tree");
    let device = backend.build_on_device(&scene.mesh(), &options()).expect("a tree").tree;
    Both { scene, cpu, device }
}
