//! Rays through scenes of many objects from a host's own shader: the CPU's hits, bit for bit, with a function of the host's that decides which count
//! and without one.

use crate::common::{odd_rays::odd, own_gpu};
use splitplane_core::backend::scene::{SceneAccelerator, write_file};
use splitplane_core::backend::{Backend, BuildOptions, LoadOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Culling, Ray};
use splitplane_core::scene::file::SceneFile;
use splitplane_core::scene::{
    IgnoredTriangle, Instance, InstanceId, Scene, SceneBuildError, SceneHit, SceneOptions,
    translation,
};
use splitplane_cpu::CpuBackend;
use splitplane_shaders::{filtered_scene_traversal, scene_traversal};
use splitplane_test_support::objects::{self, Kind};
use splitplane_wgpu::query::{SceneBindings, WgpuScene};
use splitplane_wgpu::{Gpu, GpuError, UNFINISHED, WgpuBackend};

/// The host's shader. One word more than a hit's record for each ray; in place of the triangle what is told of rays that are not followed to their end.
const SHADER: &str = "
struct Asked { options: SceneOptions, any: u32, parity: u32 }
@group(0) @binding(0) var<storage, read> given: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> found: array<u32>;
@group(0) @binding(2) var<uniform> asked: Asked;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if 6u * id.x >= arrayLength(&found) { return; }
    let ray = ray_of_words(given[2u * id.x], given[2u * id.x + 1u]);
    var words = scene_hit_words(trace_scene(ray, asked.options, asked.any != 0u));
    for (var k = 0u; k < 6u; k++) { found[6u * id.x + k] = words[k]; }
}";

/// The host's function: all that it is told of a hit counts.
const ACCEPTS: &str = "
fn accept_hit(hit: SceneHit) -> bool {
    let number = hit.triangle + 3u * hit.instance + 5u * hit.geometry;
    let bits = bitcast<u32>(hit.t) + bitcast<u32>(hit.u) + bitcast<u32>(hit.v);
    return number % 2u == 1u && (bits & 3u) != 0u;
}";

/// The same on the CPU.
fn accepts(hit: &SceneHit) -> bool {
    let number = hit.triangle.wrapping_add(3 * hit.instance).wrapping_add(5 * hit.geometry);
    let bits = hit.t.to_bits().wrapping_add(hit.u.to_bits()).wrapping_add(hit.v.to_bits());
    number % 2 == 1 && bits & 3 != 0
}

fn source(filtered: bool) -> String {
    if filtered {
        filtered_scene_traversal(1, 2) + ACCEPTS + SHADER
    } else {
        scene_traversal(1, 2) + SHADER
    }
}

/// A host: its device, and its shader.
struct Host<'a> {
    gpu: &'a Gpu,
    pipeline: wgpu::ComputePipeline,
}

impl Host<'_> {
    fn new<'a>(gpu: &'a Gpu, source: &str) -> Host<'a> {
        let pipeline = gpu.pipeline("host", source).unwrap_or_else(|error| panic!("{error}"));
        Host { gpu, pipeline }
    }

    fn trace(
        &self,
        scene: &SceneBindings,
        rays: &[Ray],
        options: &SceneOptions<'_>,
        any: bool,
    ) -> Vec<SceneHit> {
        use wgpu::BufferUsages as Usage;
        let gpu = self.gpu;
        let buffer = |bytes: usize, usage| gpu.buffer("host", bytes as u64, usage).expect("memory");
        let given = buffer(size_of_val(rays), Usage::STORAGE | Usage::COPY_DST);
        let bytes = size_of::<SceneHit>() * rays.len();
        let found = buffer(bytes, Usage::STORAGE | Usage::COPY_SRC);
        let asked = buffer(32, Usage::UNIFORM | Usage::COPY_DST);
        let culling = splitplane_core::layout::culling_bits(options.culling);
        let ignored = options.ignore.map_or([u32::MAX; 2], |own| [own.instance.0, own.triangle]);
        let words = [culling, options.mask, ignored[0], ignored[1], u32::from(any), 0, 0, 0];
        gpu.queue().write_buffer(&given, 0, bytemuck::cast_slice(rays));
        gpu.queue().write_buffer(&asked, 0, bytemuck::cast_slice(&words));
        let group = |index, entries: &[wgpu::BindGroupEntry<'_>]| {
            let layout = &self.pipeline.get_bind_group_layout(index);
            let descriptor = wgpu::BindGroupDescriptor { label: None, layout, entries };
            gpu.device().create_bind_group(&descriptor)
        };
        let own = [&given, &found, &asked].into_iter().enumerate().map(|(binding, buffer)| {
            wgpu::BindGroupEntry { binding: binding as u32, resource: buffer.as_entire_binding() }
        });
        let groups = [group(0, &own.collect::<Vec<_>>()), group(1, &scene.bind_group_entries(2))];
        let readback = buffer(bytes, Usage::MAP_READ | Usage::COPY_DST);
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &groups[0], &[]);
            pass.set_bind_group(1, &groups[1], &[]);
            pass.dispatch_workgroups(rays.len().div_ceil(64) as u32, 1, 1);
        }
        encoder.copy_buffer_to_buffer(&found, 0, &readback, 0, bytes as u64);
        gpu.submit([encoder.finish()]).expect("commands");
        readback.map_async(wgpu::MapMode::Read, .., |result| result.expect("a mapped buffer"));
        gpu.device().poll(wgpu::PollType::wait_indefinitely()).expect("a device that works");
        bytemuck::pod_collect_to_vec(&readback.get_mapped_range(..).expect("a mapped buffer"))
    }

    /// How many of the host's answers are not the CPU's, and of how many rays it is told that they were not followed to their end.
    fn compare(&self, scene: &SceneBindings, case: &Case, which: usize) -> (usize, usize) {
        let (options, all) = &case.asked[which];
        let (mut wrong, mut unfinished) = (0, 0);
        let words = |hit: &SceneHit| bytemuck::cast::<SceneHit, [u32; 6]>(*hit);
        let closest = self.trace(scene, &case.rays, options, false);
        let any = self.trace(scene, &case.rays, options, true);
        for ((own, any), (hit, is_hit)) in closest.iter().zip(&any).zip(all) {
            unfinished += usize::from(own.triangle == UNFINISHED);
            unfinished += usize::from(any.triangle == UNFINISHED);
            wrong += usize::from(own.triangle != UNFINISHED && words(own) != words(hit));
            wrong += usize::from(any.triangle != UNFINISHED && any.is_hit() != *is_hit);
        }
        (wrong, unfinished)
    }
}

/// A scene, rays, and the CPU's answers under several settings.
struct Case {
    name: String,
    scene: Scene,
    rays: Vec<Ray>,
    asked: Vec<(SceneOptions<'static>, Vec<(SceneHit, bool)>)>,
}

impl Case {
    /// Masks from the bit 0 of `with`, shapes from the bit 1.
    fn new(kind: Kind, with: u32, filtered: bool, seed: u64) -> Case {
        let (mut scene, names) = objects::scene(kind, 60, 3800 + seed);
        let mut rays = objects::rays(&scene, 500, 3900 + seed);
        rays.extend(odd(&rays[..100]));
        if with & 1 != 0 {
            objects::mask(&mut scene, 4000 + seed);
        }
        if with & 2 != 0 {
            objects::add_shapes(&mut scene, &names, 4100 + seed);
        }
        let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default());
        let built = built.expect("a scene");
        let answers = |options: &SceneOptions<'_>| {
            let own: SceneOptions<'_> = *options;
            let own = if filtered { SceneOptions { filter: Some(&accepts), ..own } } else { own };
            let mut hits = vec![SceneHit::MISS; rays.len()];
            built.closest_hits(&rays, &mut hits, &own).expect("hits");
            let mut any = vec![false; rays.len()];
            built.any_hits(&rays, &mut any, &own).expect("hits");
            // The batch is that of all instances asked one after the other.
            for i in (0..rays.len()).step_by(7) {
                let one: SceneHit = built.scene().answer_by_all(&rays[i], &own);
                assert_eq!(one, hits[i]);
            }
            hits.into_iter().zip(any).collect::<Vec<_>>()
        };
        let all = SceneOptions::default();
        let hits = answers(&all);
        // A triangle that is hit, and not the first of its mesh.
        let hit = hits.iter().map(|(hit, _)| hit).find(|hit| hit.is_hit() && hit.triangle > 0);
        let ignore = hit.map(|hit| IgnoredTriangle {
            instance: InstanceId(hit.instance),
            triangle: hit.triangle,
        });
        let asked = [
            SceneOptions { culling: Culling::Back, ..all },
            SceneOptions { culling: Culling::Front, mask: 0x0f0f_00ff, ..all },
            SceneOptions { ignore, mask: 0x8000_0001, ..all },
            SceneOptions { ignore, ..all },
        ];
        let others = asked.into_iter().map(|options| (options, answers(&options)));
        let name = format!("{kind:?}, {with}");
        let asked = [(all, hits)].into_iter().chain(others).collect();
        Case { name, asked, scene, rays }
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_hosts_hits_are_those_of_the_cpu() {
    let gpu = own_gpu();
    let backend = WgpuBackend::without_selftest(gpu);
    let mut all_hits = [Vec::new(), Vec::new()];
    for filtered in [false, true] {
        let host = Host::new(backend.gpu(), &source(filtered));
        let (mut unfinished, mut asked, mut hits) = (0, 0, 0);
        for (number, kind) in Kind::ALL.into_iter().enumerate() {
            for with in 0..4 {
                let case = Case::new(kind, with, filtered, number as u64);
                let built = backend.build_wgpu_scene(&case.scene, &BuildOptions::default());
                let scene = built.expect("a scene").bindings().expect("on the device");
                for which in 0..case.asked.len() {
                    let (wrong, early) = host.compare(&scene, &case, which);
                    assert_eq!(wrong, 0, "{}, {which}, {filtered}", case.name);
                    unfinished += early;
                    asked += 2 * case.rays.len();
                    hits += case.asked[which].1.iter().filter(|(hit, _)| hit.is_hit()).count();
                    all_hits[usize::from(filtered)].push(case.asked[which].1.clone());
                }
            }
        }
        println!("{asked} answers, {hits} hits, {unfinished} told to be unfinished");
        assert!(hits > asked / 20 && unfinished < asked / 10, "{hits} {unfinished}");
    }
    // The host's function has a say in many of them.
    let [plain, filtered] = all_hits;
    let other = plain.concat().iter().zip(&filtered.concat()).filter(|(a, b)| a != b).count();
    assert!(other > 5_000, "{other}");
}

/// Equal distances in several instances: the least name that is accepted.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn ties_go_to_the_least_name_that_is_accepted() {
    let backend = WgpuBackend::without_selftest(own_gpu());
    let mut scene = Scene::new();
    // Two triangles in one place, in five instances in one place.
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let both = [corners, corners];
    let geometry = scene.add_mesh(&Mesh::soup(&both).expect("a mesh")).expect("a geometry");
    let names = [(); 5].map(|()| {
        let instance = Instance::new(geometry, translation([0.0, 0.0, 2.0]));
        scene.add_instance(instance).expect("an instance")
    });
    let built = backend.build_wgpu_scene(&scene, &BuildOptions::default()).expect("a scene");
    let bindings = built.bindings().expect("on the device");
    let ray = [Ray::new([0.25, 0.25, 0.0], [0.0, 0.0, 1.0])];
    let options = SceneOptions::default();
    for (accepts, instance, triangle) in [
        ("true", 0, 0),
        ("hit.triangle == 1u", 0, 1),
        ("hit.instance >= 2u", 2, 0),
        ("hit.instance + hit.triangle >= 5u", 4, 1),
        ("hit.t < 2.0", u32::MAX, u32::MAX),
    ] {
        let own = format!("fn accept_hit(hit: SceneHit) -> bool {{ return {accepts}; }}");
        let host = Host::new(backend.gpu(), &(filtered_scene_traversal(1, 2) + &own + SHADER));
        let [hit] = host.trace(&bindings, &ray, &options, false)[..] else { panic!("one ray") };
        assert_eq!((hit.instance, hit.triangle), (instance, triangle), "{accepts}");
        assert_eq!(hit.t, if instance == u32::MAX { f32::INFINITY } else { 2.0 });
    }
    assert_eq!(names.map(|name| name.0), [0, 1, 2, 3, 4]);
}

/// Scenes that become empty, move and grow, by the bindings asked for after each update; a scene that the device does not hold.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn bindings_are_those_of_the_scene_as_it_is() {
    let backend = WgpuBackend::without_selftest(own_gpu());
    let host = Host::new(backend.gpu(), &source(false));
    let (full, names) = objects::scene(Kind::Ordinary, 12, 31);
    let rays = objects::rays(&full, 200, 32);
    let (build, options) = (BuildOptions::default(), SceneOptions::default());
    let mut built = backend.build_wgpu_scene(&Scene::new(), &build).expect("a scene");
    let check = |built: &WgpuScene| {
        let hits = host.trace(&built.bindings().expect("on the device"), &rays, &options, false);
        let expected = |ray| built.scene().answer_by_all::<SceneHit>(ray, &options);
        let expected: Vec<SceneHit> = rays.iter().map(expected).collect();
        assert_eq!(hits, expected);
        hits.iter().filter(|hit| hit.is_hit()).count()
    };
    assert_eq!(check(&built), 0);
    let mut scene = full;
    backend.update_scene(&mut built, &scene, &build).expect("an update");
    assert!(check(&built) > 20);
    scene.move_instance(names[3], translation([0.25; 3])).expect("an edit");
    backend.update_scene(&mut built, &scene, &build).expect("an update");
    assert!(check(&built) > 20);
    let tight = BuildOptions { max_memory: Some(built.scene().bytes()), ..build };
    scene.move_instance(names[3], translation([0.5; 3])).expect("an edit");
    backend.update_scene(&mut built, &scene, &tight).expect("an update");
    let error = built.bindings().unwrap_err();
    let reason = built.placed_by_cpu().expect("a reason");
    assert!(matches!(&error, GpuError::NotHeld(why) if why == reason), "{error}");
    for name in names {
        scene.remove_instance(name).expect("an instance");
    }
    backend.update_scene(&mut built, &scene, &build).expect("an update");
    assert_eq!(check(&built), 0);
}

/// A scene from a file is bound as one that is built, and edited like it; what is wrong with a file is refused.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_loaded_scene_is_bound() {
    let backend = WgpuBackend::without_selftest(own_gpu());
    let host = Host::new(backend.gpu(), &source(false));
    let (mut scene, names) = objects::scene(Kind::Ordinary, 30, 41);
    objects::mask(&mut scene, 42);
    objects::add_shapes(&mut scene, &names, 43);
    let (build, options) = (BuildOptions::default(), SceneOptions::default());
    let kept = CpuBackend::new().build_scene(&scene, &build).expect("a scene");
    let bytes = write_file(kept.scene()).expect("a file");
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
    let file = SceneFile::parse(bytemuck::cast_slice(&words)).expect("a scene file");
    let loaded = backend.load_wgpu_scene(&file, &LoadOptions::default());
    let (mut described, mut loaded) = loaded.expect("a scene");
    assert_eq!(loaded.placed_by_cpu(), None);
    assert_eq!(loaded.scene().digest(), kept.scene().digest());
    assert_eq!(described.len(), scene.len());
    let rays = objects::rays(&scene, 300, 44);
    let check = |loaded: &WgpuScene, right: &dyn SceneAccelerator| {
        let hits = host.trace(&loaded.bindings().expect("bindings"), &rays, &options, false);
        let mut expected = vec![SceneHit::MISS; rays.len()];
        right.closest_hits(&rays, &mut expected, &options).expect("hits");
        assert_eq!(hits, expected);
        assert!(hits.iter().filter(|hit| hit.is_hit()).count() > 50);
    };
    check(&loaded, &*kept);
    // Nothing is built for what did not change.
    for scene in [&mut scene, &mut described] {
        scene.move_instance(names[3], translation([0.25; 3])).expect("an edit");
    }
    let report = backend.update_scene(&mut loaded, &described, &build).expect("an update");
    assert_eq!(report.geometries_built, 0);
    check(&loaded, &*CpuBackend::new().build_scene(&scene, &build).expect("a scene"));

    // The checks are those of `load_scene`.
    let tight = LoadOptions { max_memory: Some(1), ..LoadOptions::default() };
    let refused = |own: Result<(), SceneBuildError>, boxed: Result<(), SceneBuildError>| {
        assert_eq!(own.unwrap_err().to_string(), boxed.unwrap_err().to_string());
    };
    refused(
        backend.load_wgpu_scene(&file, &tight).map(drop),
        backend.load_scene(&file, &tight).map(drop),
    );
    // Into a scene that is there; an error leaves it.
    let digest = loaded.scene().digest();
    assert!(backend.load_scene_into(&mut loaded, &file, &tight).is_err());
    assert_eq!((loaded.scene().digest(), loaded.placed_by_cpu()), (digest, None));
    backend.load_scene_into(&mut loaded, &file, &LoadOptions::default()).expect("a scene");
    check(&loaded, &*kept);
}

/// A layout that the host states is that of the text.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_stated_layout_serves() {
    let backend = WgpuBackend::without_selftest(own_gpu());
    let entries = SceneBindings::bind_group_layout_entries(4, wgpu::ShaderStages::COMPUTE);
    let descriptor = wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries };
    let layout = backend.gpu().device().create_bind_group_layout(&descriptor);
    let text = scene_traversal(0, 4)
        + "@compute @workgroup_size(1) fn main() { _ = scene_any_hit(Ray(), default_scene_options()); }";
    backend.gpu().pipeline_with_layout("host", &text, &layout).expect("a pipeline");
    let built = backend.build_wgpu_scene(&Scene::new(), &BuildOptions::default());
    let scene = built.expect("a scene").bindings().expect("on the device");
    let _group = backend.gpu().device().create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &layout,
        entries: &scene.bind_group_entries(4),
    });
    assert_eq!(scene.buffers()[0].size(), scene.buffers()[6].size());
}

/// llvmpipe ends the loops of a ray that enters thousands of instances, and the shader is told.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_ray_whose_way_the_driver_ends_is_unfinished() {
    const ROW: u32 = 12_000;
    let backend = WgpuBackend::without_selftest(own_gpu());
    let mut scene = Scene::new();
    let corners = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];
    let geometry = scene.add_mesh(&Mesh::soup(&corners).expect("a mesh")).expect("a geometry");
    for i in 0..ROW {
        let transform = translation([0.0, 0.0, i as f32]);
        scene.add_instance(Instance::new(geometry, transform)).expect("an instance");
    }
    let built = backend.build_wgpu_scene(&scene, &BuildOptions::default()).expect("a scene");
    let bindings = built.bindings().expect("on the device");
    let host = Host::new(backend.gpu(), &source(false));
    let ray = Ray::new([0.25, 0.25, -1.0], [0.0, 0.0, 1.0]);
    // From behind, so all instances are entered and none is hit, but for a ray that ends early. A driver that runs rays in step ends them together.
    let rays = [ray, ray.with_limits(0.0, 10.0)];
    let through = SceneOptions { culling: Culling::Back, ..SceneOptions::default() };
    let hits = rays.map(|ray| host.trace(&bindings, &[ray], &through, false)[0]);
    assert!(hits.iter().all(|hit| !hit.is_hit() && hit.t == f32::INFINITY));
    assert_eq!(hits[1].triangle, u32::MAX);
    if backend.gpu().info().name.contains("llvmpipe") {
        assert_eq!(hits[0].triangle, UNFINISHED);
    } else {
        assert!([UNFINISHED, u32::MAX].contains(&hits[0].triangle));
    }
    let hits = host.trace(&bindings, &rays, &SceneOptions::default(), false);
    assert!(hits.iter().all(|hit| (hit.t, hit.instance) == (1.0, 0)));
}

/// Each fault in the text changes the answer to some ray.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_found() {
    let shapes_left = "trace_shapes(0u, next.instance);\n            in_shapes = false;";
    let faults = [
        ("masks", "(asked.x & scene_batch.mask) != 0u", "true"),
        ("both sides", "& 3u) != 3u", "& 3u) != 4u"),
        ("culling", "        options.culling,\n", "        CULL_NONE,\n"),
        ("ignored triangles", "        options.ignored_triangle,\n", "        0u,\n"),
        ("ignored instances", "        options.ignored_instance,\n", "        0u,\n"),
        ("what is left of the way", "top = next.top;", "top = next.top >> 1u;"),
        (
            "limits of boxes",
            "select(t_max_bits, best_bits, limit_key",
            "select(t_max_bits, best_bits - 0x00800000u, limit_key",
        ),
        ("the first that is found", "(found && any)", "found"),
        ("nothing to find", "scene_facts.top_nodes == 0u", "scene_facts.top_nodes != 0u"),
        ("the end of shapes", shapes_left, "trace_shapes(0u, next.instance);"),
        ("stacks", "select(0u, BOX_ENTRIES, in_shapes) + place", "place"),
        (
            "shapes that are asked",
            "if in_shapes {\n        return true;",
            "if in_shapes {\n        return false;",
        ),
        ("instances of shapes", "& SHAPES) != 0u", "& SHAPES) == 0u"),
        ("ties", "instance < best.instance ||", "instance > best.instance ||"),
        ("the ray", "bitcast<u32>(ray.t_min));", "0u);"),
        ("the host is not asked", "|| !host_accepts(ray, triangle, t, candidate.weights)", ""),
        ("names of triangles", "triangle - own.w,", "triangle,"),
        ("names of instances", "own.y >> 3u, entered)", "own.y >> 3u, entered + 1u)"),
        ("names of geometries", "own.y >> 3u, entered)", "own.y, entered)"),
        ("weights", "SceneHit(t, at.x, at.y,", "SceneHit(t, at.y, at.y,"),
        ("distances", "SceneHit(t, at.x, at.y,", "SceneHit(t + 1.0, at.x, at.y,"),
        (
            "shapes and the host",
            "                && accept_hit(SceneHit(t,",
            "                || accept_hit(SceneHit(t,",
        ),
        (
            "weights of shapes",
            "SceneHit(t, select(span.u.x, span.u.y, k == 1u)",
            "SceneHit(t, select(span.u.y, span.u.x, k == 1u)",
        ),
    ];
    let backend = WgpuBackend::without_selftest(own_gpu());
    let kinds = [(Kind::Ordinary, 0), (Kind::IllConditioned, 2), (Kind::Coincident, 3)];
    let cases = kinds.map(|(kind, with)| {
        let case = Case::new(kind, with, true, 50);
        let built = backend.build_wgpu_scene(&case.scene, &BuildOptions::default());
        let scene = built.expect("a scene").bindings().expect("on the device");
        (case, scene)
    });
    let is_found = |source: &str| {
        let host = Host::new(backend.gpu(), source);
        let wrong = |(case, scene): &(Case, SceneBindings)| {
            (0..case.asked.len()).any(|which| host.compare(scene, case, which).0 > 0)
        };
        cases.iter().any(wrong)
    };
    let right = source(true);
    assert!(!is_found(&right));
    let mut never = Vec::new();
    for (what, from, to) in faults {
        assert!(right.contains(from), "{what}: {from}");
        if !is_found(&right.replace(from, to)) {
            never.push(what);
        }
    }
    assert_eq!(never, [""; 0], "faults that no ray finds");
}
