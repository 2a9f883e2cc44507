//! The built-in scenes have the same picture on CPU and GPU, bit for bit.

use crate::device;
use splitplane::scene::{Scene, builtin};
use splitplane_core::backend::BuildOptions;
use splitplane_core::ray::QueryOptions;
use splitplane_cpu::CpuBackend;
use splitplane_render::cpu::CpuRenderer;
use splitplane_render::wgpu::WgpuRenderer;
use splitplane_render::{FrameInput, Outputs, RenderSettings, SceneData, Size};
use splitplane_wgpu::{DeviceTree, Queries};

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn built_in_scenes() {
    let mut renderer = WgpuRenderer::new(device::gpu()).expect("a renderer");
    let queries = Queries::new(device::gpu());
    for (name, _) in builtin::ALL {
        // The others come in one size.
        let size = if name == "city" { ":1000" } else { "" };
        let scene = Scene::open(format!("builtin:{name}{size}")).expect("a built-in scene");
        let mesh = scene.mesh().expect("a mesh");
        let options = BuildOptions::default();
        let cpu_tree = CpuBackend::new().build_accelerator(&mesh, &options).expect("a tree");
        let (tree, _) = CpuBackend::new().build_tree(&mesh, &options).expect("a tree");
        let snapped = |i| splitplane_core::triangle::prepare(&mesh.triangle(i)).corners;
        let corners: Vec<_> = (0..mesh.len()).map(snapped).collect();
        let tree = DeviceTree::upload(&queries, &tree.view(), &corners).expect("a device");
        let data = SceneData::new(&mesh, &scene.appearance()).expect("not too many words");
        let size = Size::new(96, 64).expect("a size");
        let settings = RenderSettings { depth: 4, ..RenderSettings::default() };
        let input = FrameInput {
            mesh,
            scene: &data,
            camera: scene.camera.expect("a view of its own").pinhole(size),
            size,
            settings: &settings,
            outputs: Outputs { radiance: true, ..Outputs::PIXELS },
            query: QueryOptions::default(),
        };
        let mut cpu = CpuRenderer::new();
        cpu.render(&cpu_tree, &input).expect("a frame");
        renderer.render(&tree, &input).expect("a frame");
        let found = renderer.radiance().expect("radiance");
        let differ = found.iter().zip(cpu.radiance()).filter(|(a, b)| a != b).count();
        assert_eq!(differ, 0, "{name}: of {} pixels", found.len());
        assert_eq!(renderer.pixels().expect("pixels"), cpu.pixels(), "{name}");
    }
}
