//! Frames through compressed nodes: the CPU's bytes after every dispatch, and faults in what is theirs alone are seen.

use crate::device;
use crate::device::scenes::{self, Scene};
use crate::device::{Both, both, gpu};
use splitplane_core::build::lockstep::{Difference, Lockstep, LockstepError};
use splitplane_core::ray::{Accuracy, Culling};
use splitplane_cpu::CpuBackend;
use splitplane_render::cpu::{Buffers, CpuExecutor, CpuRenderer};
use splitplane_render::kernel::Kernel;
use splitplane_render::tracer::{FrameRequest, Moved, Tracer};
use splitplane_render::wgpu::{WgpuExecutor, WgpuRenderer};
use splitplane_render::{FrameInput, Plan, Room, schedule};
use splitplane_shaders::{find, render_compressed};
use splitplane_wgpu::{Gpu, Queries, WgpuBackend};

/// The scene with compressed nodes beside its tree, made by the device.
fn compressed(scene: Scene) -> Both {
    let mut both = both(scene);
    both.device.compress_on_device(&Queries::new(gpu())).expect("compressed nodes");
    assert!(both.device.is_compressed(), "{}", both.scene.name);
    both
}

/// Runs both executors in step; the number of dispatches that were compared.
fn in_step(renderer: &mut WgpuRenderer, both: &Both, room: Room) -> Result<u32, Difference> {
    let data = both.scene.data();
    let input = both.scene.input(&data);
    let plan = Plan::new(&data, input.size, input.settings, input.outputs, room).expect("a plan");
    let mut buffers = Buffers::default();
    let cpu = CpuExecutor::new(input, &both.cpu, plan, &mut buffers).expect("a frame");
    let run = |gpu: WgpuExecutor<'_>| {
        let mut lockstep = Lockstep::new(cpu, gpu);
        schedule::frame(&mut lockstep, &plan).map(|()| lockstep.dispatches())
    };
    match renderer.with_executor(&both.device, &input, &plan, run).expect("a device") {
        Ok(dispatches) => Ok(dispatches),
        Err(LockstepError::Differs(difference)) => Err(difference),
        Err(other) => panic!("{other}"),
    }
}

#[track_caller]
fn check(renderer: &mut WgpuRenderer, scene: Scene, room: Room) {
    let both = compressed(scene);
    let dispatches = in_step(renderer, &both, room)
        .unwrap_or_else(|difference| panic!("{}: {difference}", both.scene.name));
    assert!(dispatches > 3, "{}", both.scene.name);
}

/// Camera rays, mirrors, shadows, light through glass and through more of it than it passes; slices and culling.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn every_kind_of_ray() {
    let mut renderer = device::renderer();
    for scene in [scenes::all().with_samples("many samples", 3), scenes::doubled()] {
        check(&mut renderer, scene, Room::GPU);
    }
    let mut culled = scenes::doubled();
    culled.query.culling = Culling::Back;
    culled.query.ignore = Some(3);
    check(&mut renderer, culled, Room { paths: 700, ..Room::GPU });
}

/// One renderer, by turns with compressed nodes and without, and by accuracies that do not use them: what it keeps of one frame
/// serves no other wrongly.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn frames_of_all_sorts_by_turns() {
    let mut renderer = device::renderer();
    let (mut with, without) = (compressed(scenes::doubled()), both(scenes::doubled()));
    let mut cpu = CpuRenderer::new();
    for (accuracy, tree) in [
        (Accuracy::Watertight, true),
        (Accuracy::Watertight, false),
        (Accuracy::Exact, true),
        (Accuracy::Watertight, true),
        (Accuracy::Exact, false),
    ] {
        with.scene.query.accuracy = accuracy;
        with.scene.outputs.first_costs = false;
        let data = with.scene.data();
        let input = with.scene.input(&data);
        cpu.render(&with.cpu, &input).expect("a frame");
        let device = if tree { &with.device } else { &without.device };
        renderer.render(device, &input).expect("a frame");
        let what = format!("{accuracy:?}, {tree}");
        let words = |x: &[[f32; 4]]| bytemuck::cast_slice::<_, u32>(x).to_vec();
        assert_eq!(words(&renderer.radiance().unwrap()), words(cpu.radiance()), "{what}");
        assert_eq!(renderer.pixels().unwrap(), cpu.pixels(), "{what}");
        assert_eq!(renderer.first_hits().unwrap(), cpu.first_hits(), "{what}");
    }
}

/// A tracer makes them after every build while it is asked to, of a mesh from the host and of one on the device; and no longer.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_tracer_makes_them_after_every_build() {
    let mut scene = scenes::all();
    scene.outputs.first_costs = false;
    let (options, data) = (device::options(), scene.data());
    let request = {
        let FrameInput { camera, size, settings, outputs, query, .. } = scene.input(&data);
        FrameRequest { camera, size, settings: *settings, outputs, query }
    };
    let backend = WgpuBackend::without_selftest(Gpu::clone(&gpu()));
    let mesh = scene.mesh();
    let [mut cpu, mut device] = scene.with_appearance(|appearance| {
        let cpu = Tracer::load(CpuBackend::new(), &mesh, appearance, &options);
        [cpu, Tracer::load(backend, &mesh, appearance, &options)]
            .map(|tracer| tracer.expect("a tree"))
    });
    let plain = device.tree_size().bytes;
    device.set_compressed(true).expect("compressed nodes");
    cpu.set_compressed(true).expect("nothing to do");
    assert!(device.tree_size().bytes > plain);
    let mut moved = scene.clone();
    for (round, compressed) in [(0, true), (1, true), (2, true), (3, false)] {
        let up = 0.05 * round as f32;
        for (to, from) in moved.triangles.iter_mut().zip(&scene.triangles) {
            *to = from.map(|[x, y, z]| [x, y + up, z]);
        }
        let mesh = moved.mesh();
        device.set_compressed(compressed).expect("compressed nodes");
        cpu.rebuild(&mesh, &options).expect("a tree");
        match round {
            0 => {}
            2 => {
                let moved = Moved { mesh, name: None };
                device.submit_rebuild(&moved, &options).expect("a build");
            }
            _ => device.rebuild(&mesh, &options).expect("a tree"),
        }
        device.submit_frame(&mesh, &request).expect("a frame");
        let expected = cpu.frame(&mesh, &request).expect("a frame");
        let found = device.finish_frame().expect("a frame");
        assert_eq!(found.pixels().unwrap(), expected.pixels().unwrap(), "{round}");
        assert_eq!(found.first_hits().unwrap(), expected.first_hits().unwrap(), "{round}");
        assert_eq!(device.tree_size().bytes > plain, compressed, "{round}");
    }
}

/// A fault in a shader that goes through compressed nodes is seen, at the first dispatch of its kernel: so it is these that run.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_named() {
    use Kernel as K;
    let plants = [
        (K::ClosestHits, "defer_ray(DEFERRED_PATHS, index, left_aside(hit));", ""),
        (K::ClosestHits, "child_of(entry.y, key & CHILD_PLACE)", "child_of(entry.y, 0u)"),
        (K::ShadowHits, "compressed_nodes[at + 4u]", "compressed_nodes[at + 3u]"),
        // What is behind glass.
        (K::ShadowHitsThroughGlass, "            at = 0u;\n", "            at = NO_NODE;\n"),
        (K::ShadowHitsThroughGlass, "bitcast<u32>(search.t) + 1u", "bitcast<u32>(search.t) + 0u"),
        (K::ShadowHitsThroughGlass, "defer_ray(DEFERRED_SHADOW_RAYS, index, vec3<u32>());", ""),
    ];
    let glass = compressed(scenes::all().with_samples("faults", 2));
    let opaque = compressed(scenes::doubled());
    let room = Room { paths: 600, ..Room::GPU };
    let mut renderer = device::renderer();
    let mut missed = Vec::new();
    for (kernel, text, fault) in plants {
        let name = render_compressed(kernel.name()).expect("a shader of its own");
        let source = find(name).expect("a shader").source();
        let planted = source.replace(text, fault);
        assert!(planted != source, "{name}: the text to change is gone: {text}");
        renderer.replace_kernel(kernel, Some(planted));
        let scene = if kernel == K::ShadowHitsThroughGlass { &glass } else { &opaque };
        let found = in_step(&mut renderer, scene, room);
        renderer.replace_kernel(kernel, None);
        match found {
            Ok(_) => missed.push(format!("{name}, {fault}: the fault was not seen")),
            Err(difference) if difference.kernel == format!("{kernel:?}") => {}
            Err(difference) => missed.push(format!("{name}, {fault}: {difference}")),
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
}
