//! Exact frames on a device: the CPU's bytes, by way of certain hits on the device and of the CPU for all other rays.

use crate::device;
use crate::device::scenes::{self, Scene};
use crate::device::{Both, both, gpu};
use splitplane_core::build::lockstep::{Difference, Lockstep, LockstepError};
use splitplane_core::ray::{Accuracy, Culling};
use splitplane_render::cpu::{Buffers, CpuExecutor, CpuRenderer};
use splitplane_render::kernel::Kernel;
use splitplane_render::wgpu::{WgpuExecutor, WgpuRenderer};
use splitplane_render::{FrameStats, RenderError, schedule};
use splitplane_shaders::{RenderFeatures, TriangleTest, join, render_parts, render_settle};

/// The scene with exact frames. Costs of rays are not compared: a device visits other nodes.
fn exact(mut scene: Scene) -> Both {
    scene.query.accuracy = Accuracy::Exact;
    scene.outputs.first_costs = false;
    both(scene)
}

/// Renders on both sides and compares every output.
fn same(renderer: &mut WgpuRenderer, both: &Both) -> FrameStats {
    let data = both.scene.data();
    let input = both.scene.input(&data);
    let mut cpu = CpuRenderer::new();
    let expected = cpu.render(&both.cpu, &input).expect("a frame");
    let found = renderer.render(&both.device, &input).expect("a frame");
    let name = both.scene.name;
    assert_eq!((found.paths, found.shadow_rays), (expected.paths, expected.shadow_rays), "{name}");
    let words = |x: &[[f32; 4]]| bytemuck::cast_slice::<_, u32>(x).to_vec();
    assert_eq!(words(&renderer.radiance().expect("radiance")), words(cpu.radiance()), "{name}");
    assert_eq!(renderer.pixels().expect("pixels"), cpu.pixels(), "{name}");
    assert_eq!(renderer.first_hits().expect("hits"), cpu.first_hits(), "{name}");
    println!("{name}: {} of {} rays redone", found.redone, found.rays());
    assert_eq!(expected.redone, 0);
    assert!(found.redone <= found.rays());
    found
}

/// Camera rays, shadow rays, rays through glass; some are left to the CPU, and most are not.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn pictures_have_the_bytes_of_the_cpus() {
    let mut renderer = device::renderer();
    let (mut rays, mut redone) = (0, 0);
    for mut scene in [
        scenes::diffuse(),
        scenes::mirrors(),
        scenes::glass(),
        scenes::textures(),
        scenes::smooth(),
        scenes::area_lights(),
        scenes::all(),
        scenes::empty(),
        scenes::degenerate(),
        scenes::doubled(),
    ] {
        scene.size = [64, 48];
        let stats = same(&mut renderer, &exact(scene));
        rays += stats.rays();
        redone += stats.redone;
    }
    assert!(redone > 100 && redone * 5 < rays, "{redone} of {rays}");
    // Another accuracy in the same memory.
    let mut plain = scenes::all();
    plain.outputs.first_costs = false;
    assert_eq!(same(&mut renderer, &both(plain)).redone, 0);
}

/// Scenes in which bounds of error decide nothing: every ray is the CPU's. Culling and slices.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn rays_of_every_kind() {
    let mut renderer = device::renderer();
    let huge = same(&mut renderer, &exact(scenes::all().scaled("huge", 1e15)));
    assert!(huge.redone * 2 > huge.rays(), "{huge:?}");
    let mut culled = scenes::diffuse();
    culled.query.culling = Culling::Back;
    culled.query.ignore = Some(3);
    same(&mut renderer, &exact(culled));
    renderer.limit_paths(700);
    let sliced = same(&mut renderer, &exact(scenes::mirrors().with_samples("slices", 3)));
    renderer.limit_paths(96);
    let first = renderer.plan(&scenes::overflowing().input(&scenes::overflowing().data()));
    let halved = same(&mut renderer, &exact(scenes::overflowing()));
    renderer.limit_paths(2);
    let deep = exact(scenes::overflowing());
    let error = renderer.render(&deep.device, &deep.scene.input(&deep.scene.data()));
    renderer.limit_paths(u32::MAX);
    assert!(sliced.plan.slices() > 1);
    assert!(halved.plan.slice_pixels() < first.expect("a plan").slice_pixels());
    assert!(matches!(error, Err(RenderError::PixelTooDeep { .. })), "{error:?}");
}

/// Without blocking between waves: the same bytes and counts, in one slice, in several, and repeated in smaller ones; dropped in the middle
/// and begun again.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn pictures_can_be_awaited() {
    let mut renderer = device::renderer();
    let mut redone = 0;
    for (scene, paths) in [
        (scenes::all(), u32::MAX),
        (scenes::mirrors().with_samples("slices", 3), 700),
        (scenes::overflowing(), 96),
    ] {
        let both = exact(scene);
        let data = both.scene.data();
        let input = both.scene.input(&data);
        renderer.limit_paths(paths);
        let expected = same(&mut renderer, &both);
        let (pixels, hits) = (renderer.pixels().expect("pixels"), renderer.first_hits());
        let mut left = Box::pin(renderer.render_for_host_async(&both.device, &input));
        let waker = std::task::Waker::noop();
        assert!(left.as_mut().poll(&mut std::task::Context::from_waker(waker)).is_pending());
        drop(left);
        let (found, gave_way) =
            device::awaited(renderer.render_for_host_async(&both.device, &input));
        let found = found.expect("a frame");
        assert_eq!(
            (found.plan, found.redone),
            (expected.plan, expected.redone),
            "{}",
            both.scene.name
        );
        assert_eq!((found.paths, found.shadow_rays), (expected.paths, expected.shadow_rays));
        // With each list of what is undecided: one of paths and one of shadow rays a wave.
        assert!(gave_way >= 2 * expected.plan.waves(), "it gave way {gave_way} times");
        assert_eq!(renderer.pixels().expect("pixels"), pixels);
        assert_eq!(renderer.first_hits(), hits);
        redone += found.redone;
    }
    assert!(redone > 0);
    // A device that does not tell what it leaves is found out.
    let both = exact(scenes::all());
    let data = both.scene.data();
    renderer.limit_paths(u32::MAX);
    same(&mut renderer, &both);
    let hits = renderer.first_hits();
    let settle = render_settle(Kernel::ClosestHits.name()).expect("a third shader");
    let leave = "leave_undecided(UNDECIDED_PATHS, index, found, first, second, vec3<f32>());";
    let silent = text(settle).replace(leave, "");
    assert_ne!(silent, text(settle), "{leave} is gone");
    renderer.replace_settle(Kernel::ClosestHits, Some(silent));
    let input = both.scene.input(&data);
    device::awaited(renderer.render_for_host_async(&both.device, &input)).0.expect("a frame");
    let silenced = renderer.first_hits();
    // Other tests share the renderer.
    renderer.replace_settle(Kernel::ClosestHits, None);
    assert_ne!(silenced, hits);
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn devices_that_were_not_tested_refuse() {
    let both = exact(scenes::diffuse());
    let mut renderer = WgpuRenderer::new(gpu()).expect("a renderer");
    let data = both.scene.data();
    let error = renderer.render(&both.device, &both.scene.input(&data)).expect_err("not tested");
    assert_eq!(error, RenderError::ExactOnDevice);
    let input = both.scene.input(&data);
    let (error, _) = device::awaited(renderer.render_for_host_async(&both.device, &input));
    assert_eq!(error.expect_err("not tested"), RenderError::ExactOnDevice);
}

fn in_step(renderer: &mut WgpuRenderer, both: &Both) -> Result<u32, Difference> {
    let data = both.scene.data();
    let input = both.scene.input(&data);
    let plan = renderer.plan(&input).expect("a plan");
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

/// The text of a shader of exact frames with all that a scene may have.
fn text(name: &str) -> String {
    let features = RenderFeatures { test: TriangleTest::Certain, ..RenderFeatures::ALL };
    join(&render_parts(name, &features).expect("a shader"))
}

/// Both sides in step; and a bound, a list or an answer that is wrong is seen at its kernel.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_named() {
    use Kernel as K;
    let mut renderer = device::renderer();
    let sized = |mut scene: Scene| {
        scene.size = [48, 32];
        exact(scene)
    };
    let (glass, opaque) = (sized(scenes::all()), sized(scenes::doubled()));
    for scene in [&glass, &opaque] {
        in_step(&mut renderer, scene).unwrap_or_else(|difference| panic!("{difference}"));
    }
    let mut missed = Vec::new();
    let mut seen = |found: Result<u32, Difference>, kernel: Kernel, fault: &str| match found {
        Err(difference) if difference.kernel == format!("{kernel:?}") => {}
        other => missed.push(format!("{kernel:?}, {fault}: {other:?}")),
    };
    let change = |name: &str, text: &str, from: &str, to: &str| {
        let planted = text.replace(from, to);
        assert_ne!(planted, text, "{name}: {from} is gone");
        planted
    };
    // What settles the records of paths.
    let settle = render_settle(K::ClosestHits.name()).expect("a third shader");
    let huge = sized(scenes::all().scaled("huge", 1e15));
    for (from, to) in [
        ("up == value.high && down == value.high", "true"),
        ("leave_undecided(UNDECIDED_PATHS, index, NO_TRIANGLE, first, second, vec3<f32>());", ""),
        ("leave_undecided(UNDECIDED_PATHS, index, found, first, second, vec3<f32>());", ""),
        ("atomicStore(&deferred_rays[at + 6u + k], second[k]);", ""),
        ("hits[index] = hit_words(record);", ""),
    ] {
        // In a scene of that size nothing is decided.
        let scene = if from.contains("NO_TRIANGLE") { &huge } else { &glass };
        renderer.replace_settle(K::ClosestHits, Some(change(settle, &text(settle), from, to)));
        seen(in_step(&mut renderer, scene), K::ClosestHits, from);
        renderer.replace_settle(K::ClosestHits, None);
    }
    // A kernel that leaves every hit open is not wrong; one that does not tell of it is.
    let open = ("if open || after", "if true || after");
    for (kernel, scene) in [(K::ClosestHits, &glass), (K::ShadowHits, &opaque)] {
        let doubts = change(kernel.name(), &text(kernel.name()), open.0, open.1);
        renderer.replace_kernel(kernel, Some(doubts));
        in_step(&mut renderer, scene).unwrap_or_else(|difference| panic!("{difference}"));
        renderer.replace_kernel(kernel, None);
    }
    // Shadow rays that are left, and those that are not.
    for (kernel, scene, from, to) in [
        (
            K::ShadowHitsThroughGlass,
            &glass,
            "let light = shadow_light[index].xyz;",
            "let light = vec3<f32>();",
        ),
        (K::ShadowHitsThroughGlass, &glass, "behind.t_min = scale_bits(next, power);", ""),
        (
            K::ShadowHitsThroughGlass,
            &glass,
            "!search.found || greatest_t",
            "!search.found && greatest_t",
        ),
    ] {
        let name = kernel.name();
        renderer.replace_kernel(kernel, Some(change(name, &text(name), from, to)));
        seen(in_step(&mut renderer, scene), kernel, from);
        renderer.replace_kernel(kernel, None);
    }
    let name = K::ShadowHits.name();
    let doubts = change(name, &text(name), open.0, open.1);
    let leave = "leave_undecided(UNDECIDED_SHADOW_RAYS, index, NO_TRIANGLE, first, second, light);";
    let silent = change(name, &doubts, leave, "");
    renderer.replace_kernel(K::ShadowHits, Some(silent));
    seen(in_step(&mut renderer, &opaque), K::ShadowHits, "silent");
    renderer.replace_kernel(K::ShadowHits, None);
    assert!(missed.is_empty(), "{missed:#?}");
}
