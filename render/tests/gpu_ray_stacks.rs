//! Frames whose rays keep their stacks in the memory of the workgroup: the CPU's bytes.

use std::sync::Arc;

use crate::device::{both, gpu, scenes};
use splitplane_core::ray::Accuracy;
use splitplane_render::cpu::CpuRenderer;
use splitplane_render::wgpu::WgpuRenderer;
use splitplane_wgpu::{Gpu, Parity, Queries, RayStack};

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn frames_are_the_cpus() {
    let shared = Gpu::clone(&gpu()).with_ray_stack(RayStack::Workgroup);
    let mut renderer = WgpuRenderer::new(Arc::new(shared)).expect("a renderer");
    renderer.set_parity(&Parity::Bitwise);
    let mut cpu = CpuRenderer::new();
    for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
        for scene in [scenes::all().with_samples("two samples", 2), scenes::doubled()] {
            let mut both = both(scene);
            both.scene.query.accuracy = accuracy;
            both.scene.outputs.first_costs = false;
            let data = both.scene.data();
            let input = both.scene.input(&data);
            cpu.render(&both.cpu, &input).expect("a frame");
            for compressed in [false, true] {
                if compressed {
                    both.device.compress_on_device(&Queries::new(gpu())).expect("compressed nodes");
                }
                renderer.render(&both.device, &input).expect("a frame");
                let what = format!("{}, {accuracy:?}, compressed: {compressed}", both.scene.name);
                let words = |x: &[[f32; 4]]| bytemuck::cast_slice::<_, u32>(x).to_vec();
                assert_eq!(words(&renderer.radiance().unwrap()), words(cpu.radiance()), "{what}");
                assert_eq!(renderer.first_hits().unwrap(), cpu.first_hits(), "{what}");
            }
        }
    }
}
