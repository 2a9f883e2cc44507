//! Frames that the CPU shades while a device traces: light by paths and photons, passes, environment maps, many objects. They are the
//! CPU's, bit for bit; and whatever the device gets wrong is seen in them.

use crate::common::{ALL, World, along_z, cornell, cornell_camera, everything};
use crate::device;
use crate::device::own_gpu;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::error::{DeviceError, QueryError};
use splitplane_core::kernel::{PointQueryKernel, QueryKernel};
use splitplane_core::mesh::Mesh;
use splitplane_core::points::build::PointBuildError;
use splitplane_core::ray::{Accuracy, QueryOptions, Undecided};
use splitplane_core::scene::{IDENTITY, Instance, Scene, translation};
use splitplane_core::watch::{Progress, Stage, Watch};
use splitplane_cpu::CpuBackend;
use splitplane_render::cpu::CpuRenderer;
use splitplane_render::instances::Geometries;
use splitplane_render::scene_data::NONE;
use splitplane_render::tracer::{
    FrameRequest, InstanceTracer, InstancedLook, Moved, Shading, Tracer, TracerError,
};
use splitplane_render::{
    EnvironmentMap, FrameInput, FrameStats, Gather, LightTransport, Outputs, RenderError,
    RenderSettings, Room, Size,
};
use splitplane_shaders::TriangleTest;
use splitplane_wgpu::{Gpu, Parity, Queries, WgpuBackend};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use wgpu::BufferUsages as Usage;

/// A device of this file's: what crosses is counted for all of a device.
fn gpu() -> Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| Arc::new(own_gpu())).clone()
}

/// A tracer on each side, with the same scene.
struct Both {
    cpu: Tracer,
    gpu: Tracer,
    queries: Arc<Queries>,
}

/// Those of this process, for one test at a time: what they compiled serves the next.
fn both(world: &World) -> MutexGuard<'static, Both> {
    static BOTH: OnceLock<Mutex<Both>> = OnceLock::new();
    let mesh = Mesh::soup(&world.triangles).unwrap();
    let build = BuildOptions::default();
    let make = || {
        let backend = WgpuBackend::without_selftest(Gpu::clone(&gpu()));
        let queries = Arc::clone(backend.queries());
        queries.set_parity(&Parity::Bitwise);
        let cpu = Tracer::load(CpuBackend::new(), &mesh, &world.appearance(), &build).unwrap();
        let gpu = Tracer::load(backend, &mesh, &world.appearance(), &build).unwrap();
        Mutex::new(Both { cpu, gpu, queries })
    };
    let mut both = BOTH.get_or_init(make).lock().unwrap_or_else(PoisonError::into_inner);
    both.cpu.replace(&mesh, &world.appearance(), &build).unwrap();
    both.gpu.replace(&mesh, &world.appearance(), &build).unwrap();
    both
}

fn size() -> Size {
    Size::new(16, 12).unwrap()
}

fn request(settings: RenderSettings) -> FrameRequest<'static> {
    let new = FrameRequest::new(cornell_camera(size()), size());
    FrameRequest { settings, outputs: ALL, ..new }
}

/// Small frames of each kind that a device's kernels do not shade.
fn kinds() -> Vec<(&'static str, RenderSettings)> {
    let few = RenderSettings { samples: 2, passes: 2, depth: 4, seed: 3, ..Default::default() };
    let photons =
        RenderSettings { light: LightTransport::Photons, photons: 3000, neighbours: 12, ..few };
    vec![
        ("passes", few),
        ("paths", RenderSettings { light: LightTransport::Paths, ..few }),
        ("photons", photons),
        ("gathered", RenderSettings { gather: Gather::Final, passes: 1, ..photons }),
        ("many neighbours", RenderSettings { neighbours: 20, passes: 1, ..photons }),
    ]
}

/// All outputs of a frame, as words.
fn outputs(
    tracer: &mut Tracer,
    mesh: &Mesh<'_>,
    request: &FrameRequest<'_>,
) -> (Vec<u32>, FrameStats) {
    let frame = tracer.frame(mesh, request).unwrap();
    let mut words = frame.pixels().unwrap().into_owned();
    words.extend(frame.radiance().unwrap().iter().flatten().map(|part| part.to_bits()));
    let hits = frame.first_hits().unwrap();
    words.extend_from_slice(bytemuck::cast_slice(&hits));
    words.extend_from_slice(bytemuck::cast_slice(&frame.first_costs().unwrap()));
    (words, *frame.stats())
}

impl Both {
    #[track_caller]
    fn same(&mut self, name: &str, world: &World, request: &FrameRequest<'_>) -> FrameStats {
        let mesh = Mesh::soup(&world.triangles).unwrap();
        assert_eq!(self.gpu.shading(&request.settings), Shading::CpuWithRaysOnGpu, "{name}");
        assert_eq!(self.cpu.shading(&request.settings), Shading::Cpu);
        let (expected, on_cpu) = outputs(&mut self.cpu, &mesh, request);
        let before = self.gpu.traffic().unwrap();
        let (found, on_gpu) = outputs(&mut self.gpu, &mesh, request);
        assert!(expected == found, "{name}: another picture");
        let rays = |stats: &FrameStats| (stats.paths, stats.shadow_rays, stats.photon_rays);
        assert_eq!(rays(&on_gpu), rays(&on_cpu), "{name}");
        assert_eq!(on_gpu.plan, on_cpu.plan, "{name}");
        // Answers came from there: a word for a shadow ray, and more for others.
        let read = (self.gpu.traffic().unwrap() - before).bytes_down;
        assert!(read >= 4 * on_gpu.rays(), "{name}: {read} bytes for {} rays", on_gpu.rays());
        on_gpu
    }
}

fn room_with_a_map() -> World {
    let sun = |i: u32| if i == 5 { [40.0, 30.0, 20.0] } else { [0.1 * i as f32, 0.2, 0.3] };
    let map = EnvironmentMap::new(4, 2, (0..8).map(sun).collect()).unwrap();
    World { environment: Some(Arc::new(map)), ..everything() }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn pictures_are_those_of_the_cpu() {
    let world = everything();
    let mut both = both(&world);
    for (name, settings) in kinds() {
        let stats = both.same(name, &world, &request(settings));
        assert_eq!(stats.photon_rays > 0, settings.light == LightTransport::Photons, "{name}");
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn environment_maps_light_pictures_by_any_transport() {
    let world = room_with_a_map();
    let mut both = both(&world);
    let direct = RenderSettings { samples: 2, depth: 4, ..RenderSettings::default() };
    both.same("direct", &world, &request(direct));
    for (name, settings) in [kinds()[1], kinds()[2]] {
        both.same(name, &world, &request(RenderSettings { passes: 1, samples: 1, ..settings }));
    }
}

/// What the device leaves undecided the CPU answers, whatever the options say of such rays.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn exact_pictures_are_the_cpus_too() {
    let world = everything();
    let mut both = both(&world);
    let query = QueryOptions {
        accuracy: Accuracy::Exact,
        undecided: Undecided::Flag,
        ..QueryOptions::default()
    };
    let (_, paths) = kinds()[1];
    let stats = both.same("exact", &world, &FrameRequest { query, ..request(paths) });
    assert!(stats.redone > 0);
    // Of a device that is not known to round as the CPU does all rays are the CPU's.
    both.queries.set_parity(&Parity::Structural("quotients".into()));
    let mesh = Mesh::soup(&world.triangles).unwrap();
    let exact = FrameRequest { query, ..request(paths) };
    let [(expected, _), (found, stats)] = {
        let Both { cpu, gpu, .. } = &mut *both;
        [cpu, gpu].map(|tracer| outputs(tracer, &mesh, &exact))
    };
    both.queries.set_parity(&Parity::Bitwise);
    assert!(expected == found && stats.redone == stats.rays(), "{} {}", stats.redone, stats.rays());
}

/// Frames by the device's kernels and frames that the CPU shades take turns, over trees that are on the device alone, too.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn frames_of_both_kinds_take_turns() {
    let world = everything();
    let mut both = both(&world);
    let build = BuildOptions::default();
    let mesh = Mesh::soup(&world.triangles).unwrap();
    let direct = request(RenderSettings { depth: 2, ..RenderSettings::default() });
    assert_eq!(both.gpu.shading(&direct.settings), Shading::Gpu);
    let (expected, _) = outputs(&mut both.cpu, &mesh, &direct);
    let (_, photons) = kinds()[2];
    both.gpu.rebuild(&mesh, &build).unwrap();
    assert!(both.gpu.accelerator().is_none());
    both.same("a tree on the device", &world, &request(photons));
    assert!(both.gpu.accelerator().is_some());
    assert!(outputs(&mut both.gpu, &mesh, &direct).0 == expected);
    let digest = both.cpu.digest().unwrap();
    assert_eq!(both.gpu.digest().unwrap(), digest);
    // In flight: what was submitted before is forgotten.
    both.gpu.submit_frame(&mesh, &direct).unwrap();
    both.gpu.submit_rebuild(&Moved { mesh, name: None }, &build).unwrap();
    both.gpu.submit_frame(&mesh, &request(photons)).unwrap();
    assert!(both.gpu.is_frame_done());
    let by_photons = both.gpu.finish_frame().unwrap().pixels().unwrap().into_owned();
    assert_eq!(both.gpu.finish_frame().unwrap_err(), TracerError::NothingSubmitted);
    let (words, _) = outputs(&mut both.cpu, &mesh, &request(photons));
    assert_eq!(by_photons, words[..by_photons.len()]);
    // Into a buffer of the device.
    let usage = Usage::COPY_DST | Usage::COPY_SRC | Usage::STORAGE;
    let bytes = 4 * u64::from(size().pixels());
    let target = gpu().buffer("a target", bytes, usage).unwrap();
    let pixels = both
        .gpu
        .frame_into(&mesh, &request(photons), &target)
        .unwrap()
        .pixels()
        .unwrap()
        .into_owned();
    let read = splitplane_wgpu::device::readback::read(&gpu(), &target, 0, bytes).unwrap();
    assert!(bytemuck::cast_slice::<u32, u8>(&pixels) == read && pixels == by_photons);
    let unusable = gpu().buffer("a target", bytes, Usage::STORAGE).unwrap();
    let error = both.gpu.frame_into(&mesh, &request(photons), &unusable).unwrap_err();
    assert!(error.to_string().contains("lacks the usage COPY_DST"), "{error}");
    let small = gpu().buffer("a target", bytes - 4, usage).unwrap();
    let error = both.gpu.frame_into(&mesh, &request(photons), &small).unwrap_err();
    assert!(error.to_string().contains("are needed"), "{error}");
    // A mesh with other triangles.
    let few = Mesh::soup(&world.triangles[..4]).unwrap();
    let error = both.gpu.frame(&few, &request(photons)).unwrap_err();
    assert!(matches!(error, TracerError::Render(RenderError::WrongMesh { .. })), "{error}");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn objects_are_lit_by_photons_from_the_device() {
    let world = everything();
    let first_triangles = [0, 12];
    let mut scene = Scene::new();
    let parts = [&world.triangles[..12], &world.triangles[12..]];
    for (part, offset) in parts.into_iter().zip([0.0, 0.02]) {
        let geometry = scene.add_mesh(&Mesh::soup(part).unwrap()).unwrap();
        let moved = if offset > 0.0 { translation([offset, 0.0, 0.0]) } else { IDENTITY };
        scene.add_instance(Instance::new(geometry, moved)).unwrap();
    }
    let mesh = Mesh::soup(&world.triangles).unwrap();
    let geometries = Geometries { first_triangles: &first_triangles, materials: &[NONE; 2] };
    let look = InstancedLook { mesh, appearance: world.appearance(), geometries };
    let build = BuildOptions::default();
    let mut cpu = InstanceTracer::load(CpuBackend::new(), &scene, &look, &build).unwrap();
    let backend = WgpuBackend::without_selftest(Gpu::clone(&device::gpu()));
    let queries = Arc::clone(backend.queries());
    queries.set_parity(&Parity::Bitwise);
    let mut gpu = InstanceTracer::load(backend, &scene, &look, &build).unwrap();
    assert_eq!([cpu.shading(), gpu.shading()], [Shading::Cpu, Shading::CpuWithRaysOnGpu]);
    let (_, photons) = kinds()[2];
    let picture = |tracer: &mut InstanceTracer| {
        let stats = tracer.frame(&mesh, &request(photons)).unwrap();
        let radiance: Vec<u32> = bytemuck::cast_slice(tracer.radiance()).to_vec();
        (radiance, tracer.pixels().to_vec(), stats.photon_rays)
    };
    let expected = picture(&mut cpu);
    assert!(picture(&mut gpu) == expected && expected.2 > 0);
    // Their photons are looked up there: a fault in that is seen.
    let source = splitplane_shaders::POINTS[PointQueryKernel::NearestPoints as usize].source();
    let planted = source.replacen("snapped_product(d.z, d.z)", "snapped_product(d.z, d.y)", 1);
    assert_ne!(planted, source);
    queries.replace_point_kernel(PointQueryKernel::NearestPoints, Some(planted));
    assert!(picture(&mut gpu).0 != expected.0);
}

/// Both sides are timed over one wave of rays, from what the camera sees, or those of the camera; where there is no choice nothing is traced, and
/// no picture changes.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn rays_are_tried_on_both_sides() {
    let world = everything();
    let mut both = both(&world);
    let mesh = Mesh::soup(&world.triangles).unwrap();
    let (_, paths) = kinds()[1];
    let paths = RenderSettings { samples: 1, passes: 1, ..paths };
    let at = |z| FrameRequest { camera: along_z([0.0, 0.0, z], size(), 0.36), ..request(paths) };
    let seen = |tracer: &mut Tracer, frame: &FrameRequest<'_>| {
        let frame = tracer.frame(&mesh, frame).unwrap();
        frame.first_hits().unwrap().iter().filter(|hit| hit.triangle != u32::MAX).count()
    };
    let pixels = size().pixels() as usize;
    // The room fills the picture, is in its middle, and is behind the camera, whose own rays are traced then.
    for (z, some) in [(3.7, None), (9.0, None), (-20.0, Some(pixels))] {
        let hits = seen(&mut both.cpu, &at(z));
        assert_eq!(hits == 0, some.is_some(), "{z}");
        assert!(z < 9.0 || (hits > 4 && hits < pixels / 2), "{z}: {hits}");
        let before = both.gpu.traffic().unwrap();
        let trial = both.gpu.try_rays(&mesh, &at(z)).unwrap().unwrap();
        assert_eq!(trial.rays, some.unwrap_or(hits), "{z}");
        assert!(!trial.cpu.is_zero() && !trial.gpu.is_zero(), "{trial:?}");
        assert_eq!(trial.is_for_gpu(), trial.gpu < trial.cpu);
        // The camera's rays once, and those of the wave three times: hits of 16 bytes come back.
        let read = both.gpu.traffic().unwrap().bytes_down - before.bytes_down;
        assert_eq!(read, 16 * (pixels + 3 * trial.rays) as u64, "{z}");
    }
    both.same("after a trial", &world, &request(paths));
    let direct = request(RenderSettings { depth: 2, ..RenderSettings::default() });
    let before = both.gpu.traffic().unwrap();
    assert_eq!(both.gpu.shading(&direct.settings), Shading::Gpu);
    assert_eq!(both.gpu.try_rays(&mesh, &direct).unwrap(), None);
    assert_eq!(both.cpu.try_rays(&mesh, &at(3.7)).unwrap(), None);
    assert_eq!(both.gpu.traffic().unwrap(), before);
    // What ends a frame ends a trial: a watch, and settings out of range.
    let stop = |progress: &Progress| match progress.stage {
        Stage::Rays => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    let query = QueryOptions { watch: Some(&stop), ..QueryOptions::default() };
    let error = both.gpu.try_rays(&mesh, &FrameRequest { query, ..at(3.7) }).unwrap_err();
    let is_cancelled = matches!(
        error,
        TracerError::Render(RenderError::Query(QueryError::Cancelled { done: 0, .. }))
    );
    assert!(is_cancelled, "{error:?}");
    let none = RenderSettings { samples: 0, ..paths };
    let error = both.gpu.try_rays(&mesh, &request(none)).unwrap_err();
    assert!(matches!(error, TracerError::Render(_)), "{error:?}");
}

/// Every part of the work that is the device's: a fault in its kernel changes the picture.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_found() {
    let world = everything();
    let mut both = both(&world);
    let mesh = Mesh::soup(&world.triangles).unwrap();
    let kinds = kinds();
    let frame = request(kinds[2].1);
    let many = request(kinds[4].1);
    let rays = |kernel: QueryKernel| {
        splitplane_shaders::query(kernel.name(), TriangleTest::Watertight).unwrap().source()
    };
    let points = |kernel: PointQueryKernel| splitplane_shaders::POINTS[kernel as usize].source();
    let change = |source: String, from: &str, to: &str| {
        assert!(source.contains(from), "{from}: the text is not there");
        Some(source.replacen(from, to, 1))
    };
    let expected = outputs(&mut both.cpu, &mesh, &frame).0;
    for (kernel, planted) in [
        // Every other ray gets the hit of its neighbour.
        (
            QueryKernel::ClosestHit,
            change(rays(QueryKernel::ClosestHit), "batch_ray(index)", "batch_ray(index & ~1u)"),
        ),
        (
            QueryKernel::AnyHit,
            change(
                rays(QueryKernel::AnyHit),
                "occluded[index] = occluded_word(hit);",
                "occluded[index] = occluded_word(hit) * u32(index % 64u != 9u);",
            ),
        ),
    ] {
        both.queries.replace_kernel(kernel, planted);
        let found = outputs(&mut both.gpu, &mesh, &frame).0;
        both.queries.replace_kernel(kernel, None);
        assert!(found != expected, "{kernel:?}: the fault is not seen");
    }
    for (kernel, frame, from, to) in [
        (
            PointQueryKernel::NearestPoints,
            &frame,
            "snapped_product(d.z, d.z)",
            "snapped_product(d.z, d.y)",
        ),
        (
            PointQueryKernel::NearestPointsMany,
            &many,
            "vec2<u32>(bits, indices[place])",
            "vec2<u32>(bits, place)",
        ),
    ] {
        let expected = outputs(&mut both.cpu, &mesh, frame).0;
        both.queries.replace_point_kernel(kernel, change(points(kernel), from, to));
        let found = outputs(&mut both.gpu, &mesh, frame).0;
        both.queries.replace_point_kernel(kernel, None);
        assert!(found != expected, "{kernel:?}: the fault is not seen");
        assert!(outputs(&mut both.gpu, &mesh, frame).0 == expected);
    }
}

/// A watch ends rays, the build of photons' trees, and their look-up, on the device too; limits of memory hold there.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn frames_can_be_cancelled_and_limited() {
    let world = cornell();
    let mut both = both(&world);
    let mesh = Mesh::soup(&world.triangles).unwrap();
    let (_, photons) = kinds()[2];
    let mut render = |watch: &dyn Watch| {
        let query = QueryOptions { watch: Some(watch), ..QueryOptions::default() };
        both.gpu.frame(&mesh, &FrameRequest { query, ..request(photons) }).map(|_| ())
    };
    let stop = |when: bool| if when { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let rays = render(&|progress: &Progress| stop(progress.stage == Stage::Rays)).unwrap_err();
    let of_query = |error: &TracerError| {
        matches!(error, TracerError::Render(RenderError::Query(QueryError::Cancelled { .. })))
    };
    assert!(of_query(&rays), "{rays:?}");
    let tree = render(&|progress: &Progress| stop(progress.stage == Stage::Points)).unwrap_err();
    let of_tree = |error: &TracerError| {
        matches!(
            error,
            TracerError::Render(RenderError::PhotonMap(PointBuildError::Cancelled { .. }))
        )
    };
    assert!(of_tree(&tree), "{tree:?}");
    let is_built = AtomicBool::new(false);
    let after = render(&|progress: &Progress| {
        let is_tree = progress.stage == Stage::Points;
        is_built.fetch_or(is_tree, Ordering::Relaxed);
        stop(!is_tree && is_built.load(Ordering::Relaxed))
    });
    assert!(after.as_ref().is_err_and(of_query), "{after:?}");
    render(&|_: &Progress| stop(false)).unwrap();
    // The photons fit, their tree on the device does not.
    let scene = world.data();
    let accelerator = both.gpu.accelerator().unwrap();
    let settings = RenderSettings { photons: 5000, samples: 1, passes: 1, ..photons };
    let input = FrameInput {
        mesh,
        scene: &scene,
        camera: cornell_camera(size()),
        size: size(),
        settings: &settings,
        outputs: Outputs::PIXELS,
        query: QueryOptions::default(),
    };
    let shot = |bytes| {
        let room = Room { buffer_bytes: bytes, ..Room::CPU };
        let mut renderer = CpuRenderer::with_room(room).with_photons_on(Arc::clone(&both.queries));
        renderer.render(accelerator, &input).map(|_| *renderer.photons().unwrap())
    };
    let stored = shot(Room::CPU.buffer_bytes).unwrap().global;
    let error = shot(30 * stored).unwrap_err();
    assert!(
        matches!(error, RenderError::PhotonMap(PointBuildError::OutOfMemory { .. })),
        "{error}"
    );
    let error = shot(10_000).unwrap_err();
    assert!(matches!(error, RenderError::TooManyPhotons { .. }), "{error}");
}

/// A device that goes away is an error that says so, before a frame and in the middle of one.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_lost_device_is_told() {
    let world = cornell();
    let mesh = Mesh::soup(&world.triangles).unwrap();
    let build = BuildOptions::default();
    let backend = WgpuBackend::without_selftest(own_gpu());
    let device = backend.gpu().device().clone();
    // Trees come from the CPU, so that no kernel of the builder is compiled.
    let tree = CpuBackend::new().build_accelerator(&mesh, &build).unwrap();
    let accelerator = Backend::load(
        &backend,
        &mesh,
        splitplane_core::backend::Accelerator::tree(&tree).clone(),
        &build.for_loading(),
    )
    .unwrap();
    let (_, photons) = kinds()[2];
    let scene = world.data();
    let render = |watch: Option<&dyn Watch>| {
        let input = FrameInput {
            mesh,
            scene: &scene,
            camera: cornell_camera(size()),
            size: size(),
            settings: &photons,
            outputs: Outputs::PIXELS,
            query: QueryOptions { watch, ..QueryOptions::default() },
        };
        let mut renderer = CpuRenderer::new().with_photons_on(Arc::clone(backend.queries()));
        renderer.render(&*accelerator, &input).unwrap_err()
    };
    // When the trees of photons are built.
    let lose = |progress: &Progress| {
        if progress.stage == Stage::Points {
            device.destroy();
        }
        ControlFlow::Continue(())
    };
    let is_lost = |error: &RenderError| {
        matches!(
            error,
            RenderError::PhotonMap(PointBuildError::Device(DeviceError::Lost { .. }))
                | RenderError::Query(QueryError::Device(DeviceError::Lost { .. }))
        )
    };
    let error = render(Some(&lose));
    assert!(is_lost(&error), "{error:?}");
    let error = render(None);
    assert!(is_lost(&error), "{error:?}");
}
