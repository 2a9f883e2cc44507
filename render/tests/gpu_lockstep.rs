//! CPU and GPU executors side by side over whole frames: equal live buffers after every dispatch, with
//! WebGPU's default limits requested.

#[path = "../../backend-wgpu/tests/common/poison.rs"]
mod poison;

use crate::device;
use crate::device::scenes::{self, Scene};
use crate::device::{Both, both};
use splitplane_core::build::lockstep::{Difference, Lockstep, LockstepError};
use splitplane_core::ray::Culling;
use splitplane_render::cpu::{Buffers, CpuExecutor};
use splitplane_render::kernel::{Counter, Kernel};
use splitplane_render::wgpu::WgpuRenderer;
use splitplane_render::{Plan, Room, schedule};

/// What a frame in step came to.
struct InStep {
    /// Dispatches that were compared.
    dispatches: u32,
    /// Whether a queue outgrew its room.
    void: bool,
}

/// Runs both executors in step.
fn in_step(renderer: &mut WgpuRenderer, both: &Both, room: Room) -> Result<InStep, Difference> {
    let data = both.scene.data();
    let input = both.scene.input(&data);
    let plan = Plan::new(&data, input.size, input.settings, input.outputs, room).expect("a plan");
    let mut buffers = Buffers::default();
    let cpu = CpuExecutor::new(input, &both.cpu, plan, &mut buffers).expect("a frame");
    let run = |gpu: splitplane_render::wgpu::WgpuExecutor<'_>| {
        let mut lockstep = Lockstep::new(cpu, gpu);
        schedule::frame(&mut lockstep, &plan).map(|()| {
            let dispatches = lockstep.dispatches();
            let void = lockstep.into_inner().0.counters()[Counter::Overflow] != 0;
            InStep { dispatches, void }
        })
    };
    match renderer.with_executor(&both.device, &input, &plan, run).expect("a device") {
        Ok(done) => Ok(done),
        Err(LockstepError::Differs(difference)) => Err(difference),
        Err(other) => panic!("{other}"),
    }
}

fn check(renderer: &mut WgpuRenderer, scene: Scene, room: Room) -> InStep {
    let both = both(scene);
    let done = in_step(renderer, &both, room)
        .unwrap_or_else(|difference| panic!("{}: {difference}", both.scene.name));
    println!("{}: {} dispatches", both.scene.name, done.dispatches);
    done
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn every_kind_of_surface_and_light() {
    let mut renderer = device::renderer();
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
        assert!(!check(&mut renderer, scene, Room::GPU).void);
    }
}

/// Trees and distances at both ends of what floats can do.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn scenes_of_any_size() {
    let mut renderer = device::renderer();
    for (name, factor) in [("tiny", 1e-20), ("huge", 1e15)] {
        check(&mut renderer, scenes::all().scaled(name, factor), Room::GPU);
    }
}

/// Many samples; slices that end in the middle of rows and chunks; queues of several chunks.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn slices_and_samples() {
    let mut renderer = device::renderer();
    check(&mut renderer, scenes::all().with_samples("many samples", 9), Room::GPU);
    let room = Room { paths: 700, ..Room::GPU };
    check(&mut renderer, scenes::mirrors().with_samples("slices", 3), room);
    let mut accuracy = scenes::diffuse();
    accuracy.name = "culled";
    accuracy.query.culling = Culling::Back;
    accuracy.query.ignore = Some(3);
    check(&mut renderer, accuracy, room);
}

/// Glass that needs more room than there is: both executors stop in the same state.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn overflow() {
    let mut renderer = device::renderer();
    let room = Room { paths: 64, ..Room::GPU };
    assert!(check(&mut renderer, scenes::overflowing(), room).void);
}

/// No kernel reads memory of its workgroup that it has not written: that memory is not cleared.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn memory_of_workgroups_may_hold_anything() {
    let scene = both(scenes::all().with_samples("poisoned", 2));
    let room = Room { paths: 600, ..Room::GPU };
    let mut renderer = device::renderer();
    let mut seen = 0;
    for kernel in Kernel::ALL {
        let source = splitplane_shaders::find(kernel.name()).expect("a kernel").source();
        for source in poison::WORDS.iter().filter_map(|&word| poison::poisoned(&source, word)) {
            renderer.replace_kernel(kernel, Some(source));
            let found = in_step(&mut renderer, &scene, room);
            renderer.replace_kernel(kernel, None);
            if let Err(difference) = found {
                panic!("{kernel:?}: {difference}");
            }
            seen += 1;
        }
    }
    assert!(seen >= 10, "{seen}");
}

/// A fault in any kernel is seen, at the first dispatch of that kernel.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_named() {
    use Kernel as K;
    let plants = [
        (K::BeginSlice, "counters[COUNTER_WAVE] = 0u", "counters[COUNTER_WAVE] = 1u"),
        (K::CameraRays, "0x91e10da5u", "0x91e00da5u"),
        (K::FirstCosts, "counted.y += 1u", "counted.y += 2u"),
        (K::ClosestHits, "triangle < search.triangle", "triangle > search.triangle"),
        (K::ClosestHits, "defer_ray(DEFERRED_PATHS, index, left_aside(hit));", ""),
        (K::ShadowHits, "hit.triangle == DEFERRED || hit.triangle == UNSETTLED", "false"),
        (K::ShadowHitsThroughGlass, "defer_ray(DEFERRED_SHADOW_RAYS, index, vec3<u32>());", ""),
        (K::FirstHits, "dot3(normal, direction) > 0.0", "dot3(normal, direction) < 0.0"),
        (K::Shade, "OFFSET_UNITS: f32 = 64.0", "OFFSET_UNITS: f32 = 32.0"),
        (K::ScanSpawned, "spawned[chunk] = Spawned(before.x", "spawned[chunk] = Spawned(total.x"),
        (K::ShadowRays, "ONE_OVER_PI: f32 = 0.31830988", "ONE_OVER_PI: f32 = 0.31830978"),
        (K::ShadowHits, "trace_ray(ray, options, true)", "trace_ray(ray, default_options(), true)"),
        (K::ShadowHitsThroughGlass, "bitcast<u32>(search.t) + 1u", "bitcast<u32>(search.t) + 0u"),
        (K::Accumulate, "scaled3(light.xyz, frame.sample_weight)", "light.xyz"),
        (K::NextPaths, "product(2.0, cosine)", "product(1.9999999, cosine)"),
        (K::BeginWave, "COUNTER_WAVE] += 1u", "COUNTER_WAVE] += 2u"),
        (K::Resolve, "product(x, 0.25)", "product(x, 0.26)"),
    ];
    let glass = both(scenes::all().with_samples("faults", 2));
    // Without glass shadow rays end at what they meet; and of two equal triangles the first is hit.
    let opaque = both(scenes::doubled());
    let room = Room { paths: 600, ..Room::GPU };
    let mut renderer = device::renderer();
    let mut missed = Vec::new();
    for (kernel, text, fault) in plants {
        let shader = splitplane_shaders::find(kernel.name()).expect("a kernel");
        let source = shader.source();
        let planted = source.replace(text, fault);
        assert!(planted != source, "{kernel:?}: the text to change is gone");
        renderer.replace_kernel(kernel, Some(planted));
        let needs_opaque = matches!(kernel, K::ShadowHits | K::ClosestHits);
        let scene = if needs_opaque { &opaque } else { &glass };
        let found = in_step(&mut renderer, scene, room);
        renderer.replace_kernel(kernel, None);
        match found {
            Ok(_) => missed.push(format!("{kernel:?}: the fault was not seen")),
            Err(difference) if difference.kernel == format!("{kernel:?}") => {}
            Err(difference) => missed.push(format!("{kernel:?}: {difference}")),
        }
    }
    // What finishes the work of a kernel.
    for (kernel, text, fault) in [
        (K::ClosestHits, "let at = DEFERRED_HEAD + 4u * place", "let at = 1u + 4u * place"),
        (K::ShadowHits, "hit.triangle != NO_TRIANGLE", "true"),
        (
            K::ShadowHitsThroughGlass,
            "begin_light(shadow_light[index].xyz)",
            "begin_light(vec3<f32>(1.0))",
        ),
    ] {
        let name = splitplane_shaders::render_retry(kernel.name()).expect("a second shader");
        let source = splitplane_shaders::find(name).expect("a shader").source();
        let planted = source.replace(text, fault);
        assert!(planted != source, "{name}: the text to change is gone");
        renderer.replace_retry(kernel, Some(planted));
        let scene = if kernel == K::ShadowHitsThroughGlass { &glass } else { &opaque };
        let found = in_step(&mut renderer, scene, room);
        renderer.replace_retry(kernel, None);
        match found {
            Ok(_) => missed.push(format!("{name}: the fault was not seen")),
            Err(difference) if difference.kernel == format!("{kernel:?}") => {}
            Err(difference) => missed.push(format!("{name}: {difference}")),
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
}
