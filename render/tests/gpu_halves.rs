//! Frames of scenes whose triangles one storage binding does not hold, on a device with small limits: the CPU's bytes.

use crate::device;
use crate::device::scenes::{self, Scene};
use splitplane_core::ray::Accuracy;
use splitplane_cpu::CpuBackend;
use splitplane_render::cpu::CpuRenderer;
use splitplane_render::kernel::Kernel;
use splitplane_render::wgpu::WgpuRenderer;
use splitplane_render::{Material, RenderError};
use splitplane_shaders::{RenderFeatures, join, render_parts};
use splitplane_wgpu::{Gpu, GpuError, Parity, WgpuBackend};
use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// Bytes of a storage binding.
const BINDING: u64 = 420_000;
/// Triangles of 36 bytes, more than a binding holds and less than two.
const DUST: u32 = 12_000;

/// The answer of a future that is there at once.
fn ready<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(answer) => answer,
        Poll::Pending => panic!("wgpu answers at once outside of browsers"),
    }
}

/// A device whose storage bindings hold no more than [`BINDING`].
fn gpu() -> Gpu {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let used = device::gpu().info().clone();
    let same = |adapter: &wgpu::Adapter| {
        let info = adapter.get_info();
        (info.name, info.backend) == (used.name.clone(), used.backend)
    };
    let adapters = ready(instance.enumerate_adapters(wgpu::Backends::all()));
    let adapter = adapters.into_iter().find(same).expect("the adapter of the tests");
    let required_limits =
        wgpu::Limits { max_storage_buffer_binding_size: BINDING, ..wgpu::Limits::default() };
    let description = wgpu::DeviceDescriptor { required_limits, ..Default::default() };
    let (device, queue) = ready(adapter.request_device(&description)).expect("a device");
    Gpu::borrow(device, queue)
}

/// The scene behind dust: all that it shows lies in the second half of the triangles, lamps too.
fn dusty(mut scene: Scene, grains: u32) -> Scene {
    let grain = |i: u32| {
        let [x, y, z] = [i % 37, i / 37 % 41, i / 1517].map(|k| k as f32 * 0.05);
        let at = [x - 1.0, y, z - 1.0];
        [at, [at[0] + 0.004, at[1], at[2]], [at[0], at[1] + 0.004, at[2]]]
    };
    scene.triangles.splice(0..0, (0..grains).map(grain));
    scene.material_of.splice(0..0, (0..grains).map(|_| 0));
    scene.outputs.first_costs = false;
    scene.size = [32, 24];
    scene
}

/// With glass and a lamp.
fn glass() -> Scene {
    let mut scene = scenes::glass();
    let lamp = scene.materials.len() as u32;
    scene.materials.push(Material::new("lamp", [0.0; 3]).with_emission([6.0; 3]));
    scene.triangles.push([[-0.5, 2.6, 0.5], [-0.5, 2.6, -0.5], [0.5, 2.6, -0.5]]);
    scene.material_of.push(lamp);
    scene
}

/// Both pictures: the CPU's and the device's.
fn pictures(
    renderer: &mut WgpuRenderer,
    backend: &WgpuBackend,
    scene: &Scene,
) -> Result<[Vec<u32>; 2], RenderError> {
    let data = scene.data();
    let input = scene.input(&data);
    let tree = CpuBackend::new().build_accelerator(&scene.mesh(), &device::options());
    let mut cpu = CpuRenderer::new();
    cpu.render(&tree.expect("a tree"), &input).expect("a frame");
    let built = backend.build_on_device(&scene.mesh(), &device::options()).expect("a tree");
    renderer.render(&built.tree, &input)?;
    assert_eq!(renderer.first_hits().expect("hits"), cpu.first_hits(), "{}", scene.name);
    Ok([cpu.pixels().to_vec(), renderer.pixels().expect("pixels")])
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn frames_beyond_one_binding_are_the_cpus() {
    let gpu = gpu();
    let backend = WgpuBackend::without_selftest(Gpu::clone(&gpu));
    let mut renderer = WgpuRenderer::under_any_limits(gpu.into()).expect("a renderer");
    renderer.set_parity(&Parity::Bitwise);
    let mut exact = dusty(glass(), DUST);
    exact.query.accuracy = Accuracy::Exact;
    let scenes = [dusty(glass(), DUST), dusty(scenes::diffuse(), DUST), exact, dusty(glass(), 100)];
    for scene in &scenes {
        let [cpu, device] = pictures(&mut renderer, &backend, scene).expect("a frame");
        assert!(cpu == device, "{} with {} triangles", scene.name, scene.triangles.len());
    }
    // Where a kernel takes what lies behind the words from another place, that is seen.
    let features = RenderFeatures { by_halves: true, ..RenderFeatures::ALL };
    for kernel in [Kernel::Shade, Kernel::ShadowRays, Kernel::ShadowHitsThroughGlass] {
        let source = join(&render_parts(kernel.name(), &features).expect("a kernel"));
        let planted =
            source.replace("frame.tail_at + (at - here)", "frame.tail_at + (at - here) % 9u");
        assert_ne!(planted, source, "{kernel:?}");
        renderer.replace_kernel(kernel, Some(planted));
        let [cpu, device] = pictures(&mut renderer, &backend, &scenes[0]).expect("a frame");
        renderer.replace_kernel(kernel, None);
        assert!(cpu != device, "{kernel:?}: the fault was not seen");
    }
    // The second half and the words of the scene must fit a binding together.
    let full = dusty(scenes::diffuse(), 20_000);
    let error = pictures(&mut renderer, &backend, &full).expect_err("too many");
    assert!(matches!(error, RenderError::Gpu(GpuError::Limit { .. })), "{error}");
}
