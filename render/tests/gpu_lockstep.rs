//! CPU and GPU executors side by side over whole frames: equal live buffers after every dispatch, with
//! WebGPU's default limits requested.

mod device;

use device::scenes::{self, Scene};
use device::{Both, both};
use splitplane_core::lockstep::{Difference, Lockstep, LockstepError};
use splitplane_render::cpu::{Buffers, CpuExecutor};
use splitplane_render::wgpu::WgpuRenderer;
use splitplane_render::{Plan, Room, schedule};

/// Runs both executors in step; the number of dispatches that were compared.
fn in_step(renderer: &mut WgpuRenderer, both: &Both, room: Room) -> Result<u32, Difference> {
    let data = both.scene.data();
    let input = both.scene.input(&data);
    let plan = Plan::new(&data, input.size, input.settings, input.outputs, room).expect("a plan");
    let mut buffers = Buffers::default();
    let cpu = CpuExecutor::new(input, &both.cpu, plan, &mut buffers).expect("a frame");
    let run = |gpu: splitplane_render::wgpu::WgpuExecutor<'_>| {
        let mut lockstep = Lockstep::new(cpu, gpu);
        schedule::frame(&mut lockstep, &plan).map(|()| lockstep.dispatches())
    };
    match renderer.with_executor(&both.device, &input, &plan, run).expect("a device") {
        Ok(dispatches) => Ok(dispatches),
        Err(LockstepError::Differs(difference)) => Err(difference),
        Err(other) => panic!("{other}"),
    }
}

fn check(renderer: &mut WgpuRenderer, scene: Scene, room: Room) {
    let both = both(scene);
    let dispatches = in_step(renderer, &both, room)
        .unwrap_or_else(|difference| panic!("{}: {difference}", both.scene.name));
    println!("{}: {dispatches} dispatches", both.scene.name);
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn every_kind_of_surface_and_light() {
    let mut renderer = WgpuRenderer::new(device::gpu()).expect("a renderer");
    for scene in [
        scenes::diffuse(),
        scenes::mirrors(),
        scenes::glass(),
        scenes::textures(),
        scenes::smooth(),
        scenes::area_lights(),
        scenes::all(),
        scenes::empty(),
        scenes::degenerate(),
    ] {
        check(&mut renderer, scene, Room::GPU);
    }
}
