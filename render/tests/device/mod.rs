//! What the tests of the ray tracer share: one device a process, and small scenes with every kind of
//! surface and light.

pub(crate) mod scenes;
#[path = "../../../backend-wgpu/tests/common/device.rs"]
mod shared;

pub(crate) use shared::{gpu, own_gpu};

use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use splitplane_core::backend::BuildOptions;
use splitplane_core::config::BuildConfig;
use splitplane_cpu::CpuBackend;
use splitplane_render::wgpu::WgpuRenderer;
use splitplane_wgpu::{DeviceTree, Gpu, Parity, WgpuBackend};

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
