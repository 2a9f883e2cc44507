//! Pictures of the GPU are those of the CPU, bit for bit, by the way that callers take: one submission,
//! read back on request.

use crate::device;
use crate::device::scenes::{self, Scene};
use crate::device::{Both, both, gpu};
use splitplane_core::ray::Accuracy;
use splitplane_render::cpu::CpuRenderer;
use splitplane_render::kernel::Kernel;
use splitplane_render::wgpu::WgpuRenderer;
use splitplane_render::{
    Appearance, EnvironmentMap, FrameInput, FrameStats, Outputs, Part, RenderError, RenderSettings,
};
use std::sync::Arc;
use wgpu::BufferUsages as Usage;

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
    assert_eq!(renderer.first_costs().expect("costs"), cpu.first_costs(), "{name}");
    found
}

fn sized(mut scene: Scene, size: [u32; 2]) -> Scene {
    scene.size = size;
    scene
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn pictures_have_the_bits_of_the_cpus() {
    let mut renderer = device::renderer();
    same(&mut renderer, &both(sized(scenes::diffuse(), [96, 64])));
    for scene in [scenes::all(), scenes::empty()] {
        same(&mut renderer, &both(sized(scene, [48, 32])));
    }
    // A smaller picture in the same buffers, and other outputs.
    same(&mut renderer, &both(sized(scenes::all(), [31, 17])));
}

/// Frames that are awaited without blocking have the same bits, and come with all outputs.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn pictures_can_be_awaited() {
    use splitplane_core::backend::BuildOptions;
    use splitplane_render::tracer::{FrameRequest, Tracer};
    use splitplane_wgpu::{Gpu, WgpuBackend};

    let both = both(sized(scenes::all(), [48, 32]));
    let data = both.scene.data();
    let input = both.scene.input(&data);
    let mut cpu = CpuRenderer::new();
    let expected = cpu.render(&both.cpu, &input).expect("a frame");
    let (pixels, hits) = (cpu.pixels().to_vec(), cpu.first_hits().to_vec());

    let mut renderer = device::renderer();
    let (stats, gave_way) = device::awaited(renderer.render_for_host_async(&both.device, &input));
    let stats = stats.expect("a frame");
    assert_eq!((stats.paths, stats.shadow_rays), (expected.paths, expected.shadow_rays));
    assert!(gave_way > 0, "it did not wait");
    assert_eq!(renderer.pixels().expect("pixels"), pixels);
    assert_eq!(renderer.first_hits().expect("hits"), hits);
    // Void at first: the renderer repeats it in smaller slices.
    renderer.limit_paths(64);
    let (halved, _) = device::awaited(renderer.render_for_host_async(&both.device, &input));
    renderer.limit_paths(u32::MAX);
    assert_eq!(halved.expect("a frame").paths, expected.paths);
    assert_eq!(renderer.pixels().expect("pixels"), pixels);
    // Dropped in the middle, and asked again.
    let mut left = Box::pin(renderer.render_for_host_async(&both.device, &input));
    let waker = std::task::Waker::noop();
    assert!(left.as_mut().poll(&mut std::task::Context::from_waker(waker)).is_pending());
    drop(left);
    let (again, _) = device::awaited(renderer.render_for_host_async(&both.device, &input));
    assert!(again.is_ok());
    drop(renderer);

    // By the tracer, with its tree, and after a rebuild that is under way.
    let backend = WgpuBackend::without_selftest(Gpu::clone(&gpu()));
    let mesh = both.scene.mesh();
    both.scene.with_appearance(|appearance| {
        let options = BuildOptions::default();
        let (tracer, _) = device::awaited(Tracer::load_async(backend, &mesh, appearance, &options));
        let mut tracer = tracer.expect("a tracer");
        let request = FrameRequest {
            camera: input.camera,
            size: input.size,
            settings: *input.settings,
            outputs: input.outputs,
            query: input.query,
        };
        for again in 0..2 {
            let (frame, _) = device::awaited(tracer.frame_async(&mesh, &request));
            let frame = frame.expect("a frame");
            assert_eq!(&*frame.pixels().expect("pixels"), pixels, "{again}");
            assert_eq!(&*frame.first_hits().expect("hits"), hits, "{again}");
            let moved = splitplane_render::tracer::Moved { mesh, name: None };
            tracer.submit_rebuild(&moved, &options).expect("a build");
        }
        let (replaced, _) = device::awaited(tracer.replace_async(&mesh, appearance, &options));
        replaced.expect("a tree");
        assert!(tracer.accelerator().is_some());
    });
}

/// A device makes the pixels of a part and no others.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn parts_of_pictures_have_the_bits_of_the_whole() {
    let mut renderer = device::renderer();
    let both = both(sized(scenes::all(), [31, 17]));
    let data = both.scene.data();
    let input = both.scene.input(&data);
    let mut cpu = CpuRenderer::new();
    let whole = cpu.render(&both.cpu, &input).expect("a frame");
    let (mut pixels, mut hits, mut paths) = (Vec::new(), Vec::new(), 0);
    for index in 1..=3 {
        let part = Part::new(index, 3).expect("a part");
        let settings = RenderSettings { part, ..*input.settings };
        let input = FrameInput { settings: &settings, ..input };
        let stats = renderer.render(&both.device, &input).expect("a frame");
        let own = part.share(input.size.pixels());
        let own = own.start as usize..own.end as usize;
        pixels.extend_from_slice(&renderer.pixels().expect("pixels")[own.clone()]);
        hits.extend_from_slice(&renderer.first_hits().expect("hits")[own]);
        paths += stats.paths;
    }
    assert_eq!(pixels, cpu.pixels());
    assert_eq!(hits, cpu.first_hits());
    assert_eq!(paths, whole.paths);
}

/// What a device cannot render is refused by its type.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn environment_maps_are_refused() {
    let mut renderer = device::renderer();
    let both = both(sized(scenes::diffuse(), [8, 8]));
    let map = EnvironmentMap::new(1, 1, vec![[1.0; 3]]).expect("a map");
    let map = Arc::new(map);
    let appearance = Appearance { environment: Some(&map), ..Appearance::default() };
    let (plain, mut data) = (both.scene.data(), both.scene.data());
    let mesh = both.scene.input(&plain).mesh;
    data.describe_again(&mesh, &appearance).expect("data");
    let refused = renderer.render(&both.device, &both.scene.input(&data));
    assert_eq!(refused.expect_err("no maps"), RenderError::EnvironmentMapOnDevice);
}

/// Moeller and Trumbore's test may fuse, so its hits are not the CPU's to the bit.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_fast_test_gives_nearly_the_same_picture() {
    let mut scene = scenes::diffuse();
    scene.query.accuracy = Accuracy::Fast;
    let both = both(scene);
    let data = both.scene.data();
    let input = both.scene.input(&data);
    let mut renderer = device::renderer();
    renderer.render(&both.device, &input).expect("a frame");
    let mut cpu = CpuRenderer::new();
    cpu.render(&both.cpu, &input).expect("a frame");
    let found = renderer.pixels().expect("pixels");
    let differ = found.iter().zip(cpu.pixels()).filter(|(a, b)| a != b).count();
    assert!(differ * 20 < found.len(), "{differ} of {} pixels differ", found.len());
}

/// Glass that outgrows its room is made again in smaller slices, until it fits.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn frames_that_outgrow_their_room_are_halved() {
    let both = both(scenes::overflowing());
    let mut renderer = device::renderer();
    renderer.limit_paths(96);
    let data = both.scene.data();
    let first = renderer.plan(&both.scene.input(&data)).expect("a plan");
    let stats = same(&mut renderer, &both);
    assert!(stats.plan.slice_pixels() < first.slice_pixels());
    renderer.limit_paths(2);
    let error = renderer.render(&both.device, &both.scene.input(&data)).expect_err("too deep");
    renderer.limit_paths(u32::MAX);
    assert!(matches!(error, RenderError::PixelTooDeep { .. }), "{error}");
    assert!(matches!(renderer.pixels(), Err(RenderError::NoOutput { .. })));
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn pictures_go_to_buffers_of_the_caller() {
    let both = both(scenes::diffuse());
    let data = both.scene.data();
    let input = both.scene.input(&data);
    let mut renderer = device::renderer();
    renderer.render(&both.device, &input).expect("a frame");
    let expected = renderer.pixels().expect("pixels");
    let bytes = 4 * u64::from(input.size.pixels());
    let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
    let target = gpu().buffer("target", bytes, usage).expect("a buffer");
    renderer.render_into(&target, &both.device, &input).expect("a frame");
    assert_eq!(renderer.pixel_buffer(), Some(&target));
    assert_eq!(renderer.pixels().expect("pixels"), expected);
    renderer.render(&both.device, &input).expect("a frame");
    assert_ne!(renderer.pixel_buffer(), Some(&target));
    let small = gpu().buffer("small", bytes - 4, usage).expect("a buffer");
    let unusable = gpu().buffer("unusable", bytes, Usage::COPY_DST).expect("a buffer");
    for wrong in [small, unusable] {
        let error = renderer.submit_into(&wrong, &both.device, &input).expect_err("a target");
        assert!(matches!(error, RenderError::Target { .. }), "{error}");
    }
}

/// Submitted, polled, and rendered again: nothing is compiled or allocated a second time.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn frames_can_be_asked_for_later_and_cost_no_new_memory() {
    let mut both = both(scenes::smooth());
    let mut data = both.scene.data();
    let mut renderer = WgpuRenderer::new(gpu()).expect("a renderer");
    assert!(matches!(renderer.poll(), Err(RenderError::NoOutput { .. })));
    renderer.submit(&both.device, &both.scene.input(&data)).expect("a submission");
    let stats = loop {
        if let Some(stats) = renderer.poll().expect("a device") {
            break stats;
        }
        std::thread::yield_now();
    };
    assert!(stats.paths >= u64::from(stats.plan.size().pixels()));
    let (bytes, pipelines) = (renderer.bytes(), renderer.pipelines());
    let before = renderer.pixels().expect("pixels");
    // Normals in place; a camera elsewhere would do as well.
    for normal in &mut both.scene.normals {
        normal[0] += 0.3;
    }
    let again = both.scene.data();
    assert_ne!(again.revision(), data.revision());
    both.scene.update_normals(&mut data);
    same_words(&data, &again);
    renderer.render(&both.device, &both.scene.input(&data)).expect("a frame");
    let after = renderer.pixels().expect("pixels");
    assert_ne!(after, before);
    renderer.render(&both.device, &both.scene.input(&again)).expect("a frame");
    assert_eq!(renderer.pixels().expect("pixels"), after);
    assert_eq!((renderer.bytes(), renderer.pipelines()), (bytes, pipelines));
}

fn same_words(a: &splitplane_render::SceneData, b: &splitplane_render::SceneData) {
    assert_eq!(a.words(), b.words());
}

/// A scene pays for what it uses: no buffer and no shader for light where only hits are asked for.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn hits_alone_need_no_light() {
    let mut scene = scenes::all();
    scene.outputs =
        Outputs { pixels: false, radiance: false, first_hits: true, first_costs: false };
    let both = both(scene);
    let data = both.scene.data();
    let mut renderer = WgpuRenderer::new(gpu()).expect("a renderer");
    renderer.render(&both.device, &both.scene.input(&data)).expect("a frame");
    // The kernel that traces has two.
    assert_eq!(renderer.pipelines(), 5);
    assert!(matches!(renderer.pixels(), Err(RenderError::NoOutput { .. })));
    assert!(matches!(renderer.radiance(), Err(RenderError::NoOutput { .. })));
    assert_eq!(renderer.first_hits().expect("hits").len(), 24 * 16);
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn an_appearance_of_another_mesh_are_refused() {
    let small = both(scenes::empty());
    let large = both(scenes::diffuse());
    let data = large.scene.data();
    let mut renderer = device::renderer();
    let error = renderer.render(&small.device, &large.scene.input(&data)).expect_err("another");
    assert!(matches!(error, RenderError::WrongMesh { .. }), "{error}");
}

/// What the driver does not follow to its end is told: here it is two kernels that say so of a ray.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn rays_not_followed_to_their_end_are_told() {
    let both = both(scenes::diffuse());
    let data = both.scene.data();
    let input = both.scene.input(&data);
    let mut renderer = device::renderer();
    for (kernel, text, fault) in [
        (
            Kernel::ClosestHits,
            "let ray = ray_of_words(",
            "if index == 5u { hits[5] = vec4<u32>(0x7f800000u, UNFINISHED, 0u, 0u); return; }
            let ray = ray_of_words(",
        ),
        (
            Kernel::ShadowHits,
            "let hit = trace_ray(ray, options, true);",
            "var hit = trace_ray(ray, options, true);
            if index == 0u { hit.triangle = UNFINISHED; }",
        ),
    ] {
        let source = splitplane_shaders::find(kernel.name()).expect("a kernel").source();
        let planted = source.replace(text, fault);
        assert_ne!(planted, source);
        renderer.replace_kernel(kernel, Some(planted));
        renderer.render(&both.device, &input).expect("a frame");
        renderer.replace_kernel(kernel, None);
        let pixels = renderer.pixels().expect("pixels");
        let told: Vec<usize> = (0..pixels.len()).filter(|&i| pixels[i] >> 24 == 0).collect();
        let radiance = renderer.radiance().expect("radiance");
        let counted: Vec<usize> = (0..radiance.len()).filter(|&i| radiance[i][3] == 1.0).collect();
        assert_eq!((told.len(), &told), (1, &counted), "{kernel:?}");
        if kernel == Kernel::ClosestHits {
            assert_eq!(told, [5]);
            assert_eq!(renderer.first_hits().expect("hits")[5].triangle, u32::MAX - 1);
        }
    }
}
