//! Hits of the device against the core's reference traversal, bit for bit.

use crate::common::{self, along_x, bits, by_sources, hostile, poison, queries};
use splitplane_core::arithmetic::Strict;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::MAX_DEPTH;
use splitplane_core::error::QueryError;
use splitplane_core::query::intersect;
use splitplane_core::query::intersect::{Limits, SceneScale};
use splitplane_core::query::traverse::{Query, trace, trace_kept};
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::tree::KdTree;
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_cpu::CpuBackend;
use splitplane_shaders::{TriangleTest, traversal};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{DeviceQueryError, UNFINISHED, WgpuAccelerator};

/// A tree in host and in device memory.
struct Case {
    name: String,
    tree: KdTree,
    triangles: Vec<Triangle>,
    scale: SceneScale,
    device: WgpuAccelerator,
}

impl Case {
    fn new(scene: &Scene) -> Case {
        let mesh = scene.mesh();
        let built =
            CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).expect("a tree");
        let triangles: Vec<Triangle> =
            (0..mesh.len()).map(|i| prepare(&mesh.triangle(i)).corners).collect();
        let tree = built.tree().clone();
        let summary = *built.summary();
        let device = WgpuAccelerator::upload(queries(), tree.clone(), triangles.clone(), summary)
            .expect("an upload");
        assert_eq!(device.device_tree().scene_scale(), built.scene_scale(), "{}", scene.name);
        Case { name: scene.name.clone(), tree, triangles, scale: *built.scene_scale(), device }
    }

    fn reference(&self, ray: &Ray, options: &QueryOptions<'_>, query: Query) -> Hit {
        let view = self.tree.view();
        trace::<Strict>(&view, &self.triangles[..], &self.scale, ray, options, query)
    }

    /// The closest of the hits that are kept.
    fn filtered(&self, ray: &Ray, keep: impl FnMut(&Hit) -> bool) -> Hit {
        let (view, options) = (self.tree.view(), QueryOptions::default());
        let (triangles, query) = (&self.triangles[..], Query::Closest);
        trace_kept(&view, triangles, &self.scale, ray, &options, query, keep)
    }

    /// Holds closest and any hit of all rays against the reference; gives how many hit.
    fn check(&self, rays: &[Ray], options: &QueryOptions<'_>, what: &str) -> usize {
        let stale = Hit { t: -7.0, triangle: 0xdead, u: 7.0, v: 7.0 };
        let mut hits = vec![stale; rays.len()];
        let mut occluded = [vec![false; rays.len()], vec![true; rays.len()]];
        self.device.closest_hits(rays, &mut hits, options).expect("hits");
        for occluded in &mut occluded {
            self.device.any_hits(rays, occluded, options).expect("answers");
        }
        let mut count = 0;
        for (i, ray) in rays.iter().enumerate() {
            let expected = self.reference(ray, options, Query::Closest);
            let name = &self.name;
            assert_eq!(
                bits(&hits[i]),
                bits(&expected),
                "{name}, {what}: {ray:?} {options:?}, found {:?}, expected {expected:?}",
                hits[i]
            );
            for occluded in &occluded {
                assert_eq!(
                    occluded[i],
                    expected.is_hit(),
                    "{name}, {what}, any: {ray:?} {options:?}"
                );
            }
            count += usize::from(expected.is_hit());
        }
        count
    }
}

/// Rays of every kind, with odd, invalid and random ones among them.
fn all_rays(scene: &Scene, case: &Case, each: usize, seed: u64) -> Vec<Ray> {
    let mesh = scene.mesh();
    let mut rays = Vec::new();
    for (i, kind) in Kind::ALL.into_iter().enumerate() {
        let seed = seed + 10 * i as u64;
        let good = aim::rays(&mesh, kind, each, seed);
        rays.extend(aim::odd(&good, seed + 1));
        rays.extend(aim::invalid(&good[..each.div_ceil(4)], seed + 2));
        rays.extend(good);
    }
    let view = case.tree.view();
    let mut aim = aim::Aim::new(&mesh, seed + 3);
    rays.extend((0..each).map(|_| aim.in_split_plane(&view)));
    rays.extend(on_corners(case, each, seed + 4));
    rays
}

/// Rays that start on a corner, with limits next to zero.
fn on_corners(case: &Case, count: usize, seed: u64) -> Vec<Ray> {
    let mut random = Random::new(seed);
    let count = if case.triangles.is_empty() { 0 } else { count };
    let limits =
        [(0.0, f32::INFINITY), (-0.0, -0.0), (-1e-40, 1e-40), (1e-40, 1.0), (-1.0, -1e-40)];
    (0..count)
        .map(|_| {
            let corners = case.triangles[random.below(case.triangles.len())];
            let (t_min, t_max) = random.pick(&limits);
            let direction = random.direction().map(|x| x as f32);
            Ray::new(random.pick(&corners), direction).with_limits(t_min, t_max)
        })
        .collect()
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn awkward_scenes() {
    let mut hits = 0;
    for (i, scene) in scenes::awkward().iter().enumerate() {
        let case = Case::new(scene);
        let each = if scene.mesh().len() >= 20_000 { 2 } else { 40 };
        let rays = all_rays(scene, &case, each, 1000 * i as u64);
        hits += case.check(&rays, &QueryOptions::default(), "all kinds");
    }
    assert!(hits > 10_000, "{hits}");
}

/// Scenes in which options and limits are tried.
fn mixed_scenes() -> Vec<Scene> {
    let soup = scenes::soup(500, 0.2, 91);
    vec![
        scenes::nested_spheres(),
        scenes::grid_boxes(4),
        scenes::seams(true),
        scenes::identical(40),
        soup.joined(&soup.clone(), "soup, twice"),
        scenes::scaled(&soup, 1e30, "soup at 1e30"),
        scenes::scaled(&soup, 1e-30, "soup at 1e-30"),
        scenes::sphere(24, [1e7, -3e6, 2e6], 50.0),
    ]
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn culling_and_ignoring() {
    for scene in mixed_scenes() {
        let case = Case::new(&scene);
        let rays = all_rays(&scene, &case, 25, 7);
        let mut hits = Vec::new();
        for culling in [Culling::None, Culling::Back, Culling::Front] {
            let options = QueryOptions { culling, ..Default::default() };
            hits.push(case.check(&rays, &options, "culling"));
        }
        assert!(hits[1] < hits[0] && hits[2] < hits[0], "{}: {hits:?}", case.name);
        for ignored in 0..3 {
            let ignore = Some(ignored * case.triangles.len() as u32 / 3);
            case.check(&rays, &QueryOptions { ignore, ..Default::default() }, "ignoring");
        }
        case.check(&rays, &QueryOptions { ignore: Some(u32::MAX), ..Default::default() }, "none");
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn limits_are_closed() {
    for scene in mixed_scenes() {
        let case = Case::new(&scene);
        let options = QueryOptions::default();
        let mut limited = Vec::new();
        for ray in all_rays(&scene, &case, 40, 8) {
            let hit = case.reference(&ray, &options, Query::Closest);
            if hit.is_hit() {
                let t = hit.t;
                for (least, greatest) in [
                    (t, t),
                    (t.next_up(), f32::INFINITY),
                    (f32::NEG_INFINITY, t.next_down()),
                    (f32::NEG_INFINITY, t),
                    (t, f32::MAX),
                    (-0.0, 0.0),
                    (-1e-40, 1e-40),
                ] {
                    limited.push(ray.with_limits(least, greatest));
                }
            }
        }
        assert!(limited.len() > 300, "{}: {}", case.name, limited.len());
        assert!(case.check(&limited, &options, "limits") * 4 > limited.len());
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn rays_of_random_bits() {
    let mut random = Random::new(9);
    let mut point = || [(); 3].map(|()| f32::from_bits(random.bits()));
    let rays: Vec<Ray> = (0..2_000)
        .map(|_| {
            let limits = point();
            Ray::new(point(), point()).with_limits(limits[0], limits[1])
        })
        .collect();
    for scene in mixed_scenes() {
        Case::new(&scene).check(&rays, &QueryOptions::default(), "random bits");
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn more_rays_than_a_slice() {
    let scene = scenes::sphere(24, [0.0; 3], 1.0);
    let case = Case::new(&scene);
    let mesh = scene.mesh();
    for count in [0, 1, 63, 64, 65, 20_001] {
        let rays = aim::rays(&mesh, Kind::Faces, count, 10);
        assert_eq!(case.check(&rays, &QueryOptions::default(), "count") > count / 2, count > 0);
    }
}

/// The fast test need not give the same bits; away from edges it gives the same triangles.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn fast_accuracy() {
    let options = QueryOptions { accuracy: Accuracy::Fast, ..Default::default() };
    for scene in [scenes::nested_spheres(), scenes::soup(500, 0.2, 91)] {
        let case = Case::new(&scene);
        let rays = aim::rays(&scene.mesh(), Kind::Faces, 2000, 11);
        let mut hits = vec![Hit::MISS; rays.len()];
        case.device.closest_hits(&rays, &mut hits, &options).expect("hits");
        let mut occluded = vec![false; rays.len()];
        case.device.any_hits(&rays, &mut occluded, &options).expect("answers");
        let same = rays.iter().zip(&hits).filter(|(ray, hit)| {
            let expected = case.reference(ray, &options, Query::Closest);
            let close = |a: f32, b: f32| (a - b).abs() <= 1e-4;
            hit.triangle == expected.triangle
                && (!hit.is_hit() || (close(hit.t, expected.t) && close(hit.u, expected.u)))
        });
        assert!(same.count() * 1000 >= rays.len() * 995, "{}", case.name);
        let agree = hits.iter().zip(&occluded).filter(|(hit, any)| hit.is_hit() == **any).count();
        assert!(agree * 1000 >= rays.len() * 999, "{}: {agree}", case.name);
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn limits_of_the_triangles_and_the_tree_read_back() {
    let mut scenes = scenes::awkward();
    scenes.push(scenes::all_bad());
    for scene in scenes {
        // Building the case compares the scale; this compares each limit.
        let case = Case::new(&scene);
        let mesh = scene.mesh();
        let expected = (0..mesh.len())
            .map(|i| prepare(&mesh.triangle(i)))
            .filter(|triangle| triangle.kept)
            .fold(Limits::NONE, |limits, t| limits.union(Limits::of(&t.corners)));
        let tree = case.device.device_tree();
        let found = queries().triangle_limits(tree.triangles(), tree.triangle_count());
        assert_eq!(found.expect("limits"), expected, "{}", scene.name);
        let read = tree.read(&common::gpu()).expect("a tree");
        assert_eq!(read, case.tree, "{}", scene.name);
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn lengths_must_be_equal() {
    let case = Case::new(&scenes::one());
    let ray = Ray::new([0.0; 3], [1.0; 3]);
    let options = QueryOptions::default();
    let expected = Err(QueryError::LengthMismatch { rays: 2, results: 1 });
    assert_eq!(case.device.closest_hits(&[ray; 2], &mut [Hit::MISS], &options), expected);
    assert_eq!(case.device.any_hits(&[ray; 2], &mut [false], &options), expected);
}

/// A storage buffer that can be written and read.
fn storage(bytes: usize) -> wgpu::Buffer {
    use wgpu::BufferUsages as Usage;
    let usage = Usage::STORAGE | Usage::COPY_DST | Usage::COPY_SRC;
    common::gpu().buffer("test", bytes as u64, usage).expect("a buffer")
}

/// Rays and hits that stay on the device give the same hits.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn recorded_queries() {
    let scene = scenes::soup(300, 0.3, 12);
    let case = Case::new(&scene);
    let gpu = common::gpu();
    let rays = all_rays(&scene, &case, 100, 13);
    let count = rays.len() as u32;
    let options = QueryOptions { culling: Culling::Back, ..Default::default() };
    let given = storage(size_of_val(&rays[..]));
    gpu.queue().write_buffer(&given, 0, bytemuck::cast_slice(&rays));
    // Room for more, which must stay as it is.
    let (hits, occluded) = (storage(16 * (rays.len() + 1)), storage(4 * (rays.len() + 1)));
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    let (queries, tree) = (queries(), case.device.device_tree());
    queries.record_closest_hits(&mut encoder, tree, &given, &hits, count, &options).expect("hits");
    queries.record_any_hits(&mut encoder, tree, &given, &occluded, count, &options).expect("any");
    gpu.submit([encoder.finish()]).expect("commands");
    let found: Vec<Hit> = bytemuck::pod_collect_to_vec(&common::read(&hits));
    let any: Vec<u32> = bytemuck::pod_collect_to_vec(&common::read(&occluded));
    for (i, ray) in rays.iter().enumerate() {
        let expected = case.reference(ray, &options, Query::Closest);
        assert_eq!(bits(&found[i]), bits(&expected), "{ray:?}");
        assert_eq!(any[i], u32::from(expected.is_hit()), "{ray:?}");
    }
    assert_eq!(bits(&found[rays.len()]), [0; 4], "written beyond the end");
    assert_eq!(any[rays.len()], 0, "written beyond the end");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn buffers_that_do_not_suit() {
    let case = Case::new(&scenes::one());
    let (queries, tree) = (queries(), case.device.device_tree());
    let options = QueryOptions::default();
    let mut encoder = common::gpu().device().create_command_encoder(&Default::default());
    let short = queries.record_closest_hits(
        &mut encoder,
        tree,
        &storage(32 * 10),
        &storage(16 * 9),
        10,
        &options,
    );
    assert_eq!(
        short,
        Err(DeviceQueryError::BufferTooSmall { what: "results", bytes: 144, needed: 160 })
    );
    let usage = wgpu::BufferUsages::COPY_DST;
    let unusable = common::gpu().buffer("test", 320, usage).expect("a buffer");
    let any = queries.record_any_hits(&mut encoder, tree, &unusable, &storage(40), 10, &options);
    assert_eq!(any, Err(DeviceQueryError::BufferUsage { what: "rays" }));
}

/// Where a driver ends traversals early, the batch says so, and the accelerator finishes on the CPU.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn traversals_that_the_driver_ends() {
    let scene = scenes::identical(70_000);
    let case = Case::new(&scene);
    let rays = aim::rays(&scene.mesh(), Kind::Faces, 4, 14);
    let options = QueryOptions::default();
    case.check(&rays, &options, "long leaves");
    let mut hits = vec![Hit::MISS; rays.len()];
    let tree = case.device.device_tree();
    let found = queries().closest_hits(tree, &rays, &mut hits, &options);
    if common::is_llvmpipe() {
        assert_eq!(found, Err(DeviceQueryError::Unfinished { rays: 4, first: 0 }));
    } else {
        assert_eq!(found, Ok(()));
    }
}

/// Closest hits by any sources of the kernels, the lean one and that for the rays it defers, through the device tree
/// of a case; and how many were deferred.
fn hits_by_sources(sources: &[String; 2], case: &Case, rays: &[Ray]) -> (Vec<Hit>, u32) {
    let tree = case.device.device_tree();
    let (hits, deferred) = by_sources::answers(sources, tree, rays, size_of::<Hit>(), 0);
    (bytemuck::pod_collect_to_vec(&hits), deferred)
}

/// The traversal as a library, bound elsewhere than in the kernels, in a shader of a host's own.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_shader_of_a_hosts_own() {
    let own = "
@group(0) @binding(0) var<storage, read> given: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> found: array<vec4<u32>>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&found) { return; }
    let ray = ray_of_words(given[2u * id.x], given[2u * id.x + 1u]);
    let hit = closest_hit(ray, default_options());
    found[id.x] = hit_words(hit);
    if any_hit(ray, QueryOptions(CULL_NONE, NO_TRIANGLE)) != is_hit(hit) { found[id.x].x = 7u; }
}";
    let scene = scenes::seams(true);
    let case = Case::new(&scene);
    let rays = all_rays(&scene, &case, 50, 17);
    let gpu = common::gpu();
    for test in [TriangleTest::Watertight, TriangleTest::MoellerTrumbore] {
        let source = traversal(1, 3, test) + own;
        let pipeline = gpu.pipeline("host", &source).expect("a pipeline");
        let (given, hits) = (storage(size_of_val(&rays[..])), storage(16 * rays.len()));
        gpu.queue().write_buffer(&given, 0, bytemuck::cast_slice(&rays));
        let group = |index, entries: &[wgpu::BindGroupEntry<'_>]| {
            let layout = &pipeline.get_bind_group_layout(index);
            let descriptor = wgpu::BindGroupDescriptor { label: None, layout, entries };
            gpu.device().create_bind_group(&descriptor)
        };
        let buffers = [(0, &given), (1, &hits)].map(|(binding, buffer)| wgpu::BindGroupEntry {
            binding,
            resource: buffer.as_entire_binding(),
        });
        let groups =
            [group(0, &buffers), group(1, &case.device.device_tree().bind_group_entries(3))];
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &groups[0], &[]);
            pass.set_bind_group(1, &groups[1], &[]);
            pass.dispatch_workgroups(rays.len().div_ceil(64) as u32, 1, 1);
        }
        gpu.submit([encoder.finish()]).expect("commands");
        let found: Vec<Hit> = bytemuck::pod_collect_to_vec(&common::read(&hits));
        if test == TriangleTest::Watertight {
            for (ray, hit) in rays.iter().zip(&found) {
                let expected = case.reference(ray, &Default::default(), Query::Closest);
                assert_eq!(bits(hit), bits(&expected), "{ray:?}");
            }
        } else {
            assert!(found.iter().filter(|hit| hit.is_hit()).count() * 3 > rays.len());
        }
    }
}

/// A host that decides which hits count, by triangle and by place in it, has the CPU's hits with such a filter.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_host_that_filters_hits() {
    let own = "
@group(0) @binding(0) var<storage, read> given: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> found: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> least_u: array<f32>;
fn accept_hit(hit: Hit) -> bool {
    return hit.triangle % 3u != 0u && hit.u >= least_u[0];
}
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&found) { return; }
    let ray = ray_of_words(given[2u * id.x], given[2u * id.x + 1u]);
    let hit = closest_hit(ray, default_options());
    found[id.x] = hit_words(hit);
    if any_hit(ray, default_options()) != is_hit(hit) { found[id.x].x = 7u; }
}";
    let gpu = common::gpu();
    let source = splitplane_shaders::filtered_traversal(1, 3, TriangleTest::Watertight);
    let source = source.expect("a text") + own;
    let pipeline = gpu.pipeline("host", &source).expect("a pipeline");
    for scene in [scenes::seams(true), scenes::soup(400, 0.3, 18), scenes::coplanar(1, 200)] {
        let case = Case::new(&scene);
        let rays = all_rays(&scene, &case, 50, 17);
        for least_u in [0.0f32, 0.4] {
            let (given, hits) = (storage(size_of_val(&rays[..])), storage(16 * rays.len()));
            let least = storage(4);
            gpu.queue().write_buffer(&given, 0, bytemuck::cast_slice(&rays));
            gpu.queue().write_buffer(&least, 0, bytemuck::bytes_of(&least_u));
            let group = |index, entries: &[wgpu::BindGroupEntry<'_>]| {
                let layout = &pipeline.get_bind_group_layout(index);
                let descriptor = wgpu::BindGroupDescriptor { label: None, layout, entries };
                gpu.device().create_bind_group(&descriptor)
            };
            let buffers = [(0, &given), (1, &hits), (2, &least)].map(|(binding, buffer)| {
                wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }
            });
            let groups =
                [group(0, &buffers), group(1, &case.device.device_tree().bind_group_entries(3))];
            let mut encoder = gpu.device().create_command_encoder(&Default::default());
            {
                let mut pass = encoder.begin_compute_pass(&Default::default());
                pass.set_pipeline(&pipeline);
                pass.set_bind_group(0, &groups[0], &[]);
                pass.set_bind_group(1, &groups[1], &[]);
                pass.dispatch_workgroups(rays.len().div_ceil(64) as u32, 1, 1);
            }
            gpu.submit([encoder.finish()]).expect("commands");
            let found: Vec<Hit> = bytemuck::pod_collect_to_vec(&common::read(&hits));
            let mut filtered = 0;
            for (ray, hit) in rays.iter().zip(&found) {
                let keep = |hit: &Hit| !hit.triangle.is_multiple_of(3) && hit.u >= least_u;
                let expected = case.filtered(ray, keep);
                assert_eq!(bits(hit), bits(&expected), "{}: {ray:?}", scene.name);
                let all = case.reference(ray, &Default::default(), Query::Closest);
                filtered += u32::from(bits(&all) != bits(&expected));
            }
            // A function that were not asked would be noticed.
            assert!(filtered > 10, "{}: {filtered}", scene.name);
        }
    }
}

/// The constants of the WGSL are those of the core.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn constants_are_the_cores() {
    let constants: [(&str, f32); 14] = [
        ("PLANE_SLACK", intersect::PLANE_SLACK),
        ("STOP_SLACK", intersect::STOP_SLACK),
        ("EDGE_LEAST", intersect::EDGE_LEAST),
        ("ROBUST", intersect::ROBUST),
        ("SLIVER", intersect::SLIVER),
        ("WIDTH_LEAST", intersect::WIDTH_LEAST),
        ("DISTANCE_LEAST", intersect::DISTANCE_LEAST),
        ("T_LEAST", intersect::T_LEAST),
        ("SLOPE_LEAST", intersect::SLOPE_LEAST),
        ("DIRECTION_LEAST", intersect::DIRECTION_LEAST),
        ("COORDINATE_MOST", intersect::COORDINATE_MOST),
        ("ORIGIN_LEAST", intersect::ORIGIN_LEAST),
        ("GREATEST", f32::MAX),
        ("GREATEST_BY_FAR", f32::MAX / 100.0),
    ];
    let mut source = traversal(1, 0, TriangleTest::Watertight)
        + "
@group(0) @binding(0) var<storage, read> input: array<u32>;
@group(0) @binding(1) var<storage, read_write> output: array<u32>;
@group(0) @binding(2) var<uniform> zeros: vec4<u32>;
@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) index: u32) {
    if index != input[0] + zeros.x { return; }
    output[0] = STACK_ENTRIES;
";
    for (place, (name, _)) in constants.iter().enumerate() {
        source += &format!("    output[{}] = bitcast<u32>({name});\n", place + 1);
    }
    let words = common::run_words(&(source + "}"), &[0], constants.len() + 1, 1);
    assert_eq!(words[0], MAX_DEPTH + 1);
    for ((name, value), word) in constants.into_iter().zip(&words[1..]) {
        assert_eq!(*word, value.to_bits(), "{name}");
    }
}

/// What `side_met` of the WGSL says of three edge functions: 1, -1, 0, or 2 where it leaves the side open.
fn sides_met(source: &str, edges: &[[f32; 3]]) -> Vec<i32> {
    let source = source.to_owned()
        + "
@group(0) @binding(0) var<storage, read> input: array<u32>;
@group(0) @binding(1) var<storage, read_write> output: array<i32>;
@group(0) @binding(2) var<uniform> zeros: vec4<u32>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&output) { return; }
    let at = 3u * id.x + zeros.x;
    output[id.x] = side_met(bitcast<vec3<f32>>(vec3<u32>(input[at], input[at + 1u], input[at + 2u])));
}
";
    let words = common::run_words(&source, bytemuck::cast_slice(edges), edges.len(), edges.len());
    words.into_iter().map(|word| word as i32).collect()
}

/// A side is told as the core tells it, by each edge function as it counts, for every pattern of signs, zeros and numbers about the least
/// that counts. Coordinates of scenes that are not wide are below 2^39, and those of wide ones are scaled, so that no edge function is
/// infinite or no number.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn sides_are_told_by_every_pattern_of_signs() {
    let least = intersect::EDGE_LEAST;
    let sizes = [0.0, f32::MIN_POSITIVE, least.next_down(), least, least.next_up(), 1.0, 1e24];
    let values: Vec<f32> = sizes.into_iter().flat_map(|size| [size, -size]).collect();
    let mut edges = Vec::new();
    for &x in &values {
        for &y in &values {
            edges.extend(values.iter().map(|&z| [x, y, z]));
        }
    }
    let expected: Vec<i32> = edges
        .iter()
        .map(|edges| {
            let counted = edges.map(|x: f32| if x.abs() < least { 0.0 } else { x });
            let below = counted.iter().any(|&x| x < 0.0);
            let above = counted.iter().any(|&x| x > 0.0);
            let zero = counted.contains(&0.0);
            match (below, above) {
                (true, true) => 0,
                _ if zero => 2,
                _ => i32::from(above) - i32::from(below),
            }
        })
        .collect();
    for side in [-1, 0, 1, 2] {
        assert!(expected.contains(&side), "no pattern gives {side}");
    }
    let source = traversal(1, 0, TriangleTest::Watertight);
    assert_eq!(sides_met(&source, &edges), expected);
    for (right, wrong) in [
        ("lowest <= -EDGE_LEAST && highest", "lowest < -EDGE_LEAST && highest"),
        ("&& highest >= EDGE_LEAST", "&& highest > EDGE_LEAST"),
        ("let front = lowest >= EDGE_LEAST;", "let front = lowest > EDGE_LEAST;"),
        ("let front = lowest >= EDGE_LEAST;", "let front = highest >= EDGE_LEAST;"),
        ("front || highest <= -EDGE_LEAST", "front || highest < -EDGE_LEAST"),
        ("front || highest <= -EDGE_LEAST", "front || highest <= 0.0"),
        ("return select(-1, 1, front);", "return select(1, -1, front);"),
        ("min(min(edges.x, edges.y), edges.z)", "min(edges.x, edges.y)"),
        ("max(max(edges.x, edges.y), edges.z)", "max(edges.y, edges.z)"),
    ] {
        assert_eq!(source.matches(right).count(), 1, "{right}");
        assert_ne!(sides_met(&source.replacen(right, wrong, 1), &edges), expected, "{wrong}");
    }
}

/// Rays towards vertices, from as many extents of the scene away.
fn away(scene: &Scene, extents: f32) -> Vec<Ray> {
    let first = scene.positions[0];
    let farthest =
        |k: usize| scene.positions.iter().map(|p| (p[k] - first[k]).abs()).fold(0.0, f32::max);
    let extent = farthest(0).max(farthest(1)).max(farthest(2));
    let towards = [0.6, -0.48, 0.64];
    let vertices = scene.positions.iter().step_by(scene.positions.len() / 40 + 1);
    vertices
        .map(|p| Ray::new([0, 1, 2].map(|k| p[k] - extents * extent * towards[k]), towards))
        .collect()
}

/// A lean traversal answers most rays; the others, which its short stack does not serve, are traced again.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn deep_stacks_are_deferred() {
    let case = Case::new(&scenes::octaves());
    let rays = along_x(2000);
    let sources = ["closest_hit", "closest_hit_retry"]
        .map(|name| splitplane_shaders::find(name).expect("a kernel").source());
    let (found, deferred) = hits_by_sources(&sources, &case, &rays);
    let options = QueryOptions::default();
    for (ray, hit) in rays.iter().zip(&found) {
        let expected = case.reference(ray, &options, Query::Closest);
        assert_eq!(bits(hit), bits(&expected), "{ray:?}");
    }
    assert!((10..1500).contains(&deferred), "{deferred} deferred");
    case.check(&rays, &options, "deep stacks");
}

/// Hits are the same on drivers that do what WGSL allows and this machine's do not.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn drivers_that_round_as_they_like() {
    let sources = ["closest_hit", "closest_hit_retry"]
        .map(|name| splitplane_shaders::find(name).expect("a kernel").source());
    let options = QueryOptions::default();
    let scenes = [
        scenes::soup(400, 0.3, 18),
        scenes::needle_star(),
        scenes::seams(true),
        scenes::ratio(),
        scenes::coplanar(1, 200),
        scenes::grid_boxes(4),
        scenes::octaves(),
        scenes::scaled(&scenes::soup(200, 0.4, 15), 1e30, "soup at 1e30"),
        scenes::scaled(&scenes::soup(200, 0.4, 15), 1e-30, "soup at 1e-30"),
    ];
    let cases = scenes.map(|scene| {
        let case = Case::new(&scene);
        let mut rays = all_rays(&scene, &case, 20, 19);
        rays.extend(away(&scene, 50.0));
        let expected: Vec<Hit> =
            rays.iter().map(|ray| case.reference(ray, &options, Query::Closest)).collect();
        (case, rays, expected)
    });
    for driver in hostile::ALLOWED {
        let compiled = sources.clone().map(|source| driver.compiled(&source));
        for (case, rays, expected) in &cases {
            let (found, _) = hits_by_sources(&compiled, case, rays);
            // llvmpipe ends loops after 65,535 rounds, and unrolls fewer of those of longer texts.
            let unfinished = found.iter().filter(|hit| hit.triangle == UNFINISHED).count();
            let most = if common::is_llvmpipe() { rays.len() / 5 } else { 0 };
            assert!(unfinished <= most, "{}, {}: {unfinished}", driver.name, case.name);
            let pairs = rays.iter().zip(&found).zip(expected);
            for ((ray, hit), expected) in pairs.filter(|((_, hit), _)| hit.triangle != UNFINISHED) {
                let place = format!("{}, {}: {ray:?}", driver.name, case.name);
                assert_eq!(bits(hit), bits(expected), "{place}, {hit:?} and {expected:?}");
            }
        }
    }
}

/// The same of any hits.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn any_hits_on_drivers_that_round_as_they_like() {
    let sources = ["any_hit", "any_hit_retry"]
        .map(|name| splitplane_shaders::find(name).expect("a kernel").source());
    let options = QueryOptions::default();
    let scenes = [scenes::soup(400, 0.3, 18), scenes::needle_star(), scenes::seams(true)];
    let cases = scenes.map(|scene| {
        let case = Case::new(&scene);
        let mut rays = all_rays(&scene, &case, 20, 19);
        rays.extend(away(&scene, 50.0));
        let expected: Vec<u32> = rays
            .iter()
            .map(|ray| u32::from(case.reference(ray, &options, Query::Any).is_hit()))
            .collect();
        assert!(expected.contains(&0) && expected.contains(&1), "{}", case.name);
        (case, rays, expected)
    });
    // What is left unfinished is the host's to answer.
    let wrong = |sources: &[String; 2], (case, rays, expected): &(Case, Vec<Ray>, Vec<u32>)| {
        let (words, _) = by_sources::answers(sources, case.device.device_tree(), rays, 4, 0);
        let found: Vec<u32> = bytemuck::pod_collect_to_vec(&words);
        let unfinished = found.iter().filter(|&&word| word == 2).count();
        let most = if common::is_llvmpipe() { rays.len() / 5 } else { 0 };
        assert!(unfinished <= most, "{}: {unfinished}", case.name);
        found
            .iter()
            .zip(expected)
            .filter(|(found, expected)| **found != 2 && found != expected)
            .count()
    };
    for driver in hostile::ALLOWED {
        let compiled = sources.clone().map(|source| driver.compiled(&source));
        for case in &cases {
            assert_eq!(wrong(&compiled, case), 0, "{}, {}", driver.name, case.0.name);
        }
    }
    let fused = sources.map(|source| hostile::fused(&hostile::folded(&source)));
    let seen: usize = cases.iter().map(|case| wrong(&fused, case)).sum();
    assert!(seen > 0, "a barrier that is folded away changes no answer");
}

/// A compiler that knows the barrier's word folds it away and fuses what it kept apart: other hits. With the barrier there is
/// nothing to fuse.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_barrier_that_is_folded_away_is_seen() {
    let sources = ["closest_hit", "closest_hit_retry"]
        .map(|name| splitplane_shaders::find(name).expect("a kernel").source());
    let scene = scenes::soup(400, 0.3, 18);
    let case = Case::new(&scene);
    let rays = all_rays(&scene, &case, 20, 19);
    let options = QueryOptions::default();
    let wrong = |sources: &[String; 2]| {
        let (found, _) = hits_by_sources(sources, &case, &rays);
        let expected = rays.iter().map(|ray| case.reference(ray, &options, Query::Closest));
        found.iter().zip(expected).filter(|(hit, expected)| bits(hit) != bits(expected)).count()
    };
    assert_eq!(sources.clone().map(|source| hostile::fused(&source)), sources);
    assert_eq!(wrong(&sources), 0);
    let fused = sources.clone().map(|source| hostile::fused(&hostile::folded(&source)));
    assert!(fused[0].contains("fma(-("), "nothing is fused");
    let seen = wrong(&fused);
    assert!(seen > 0, "{seen} of {} hits differ", rays.len());
}

/// Rays need no memory of their workgroup, which would take the cache from the tree, and which is not cleared.
#[test]
fn rays_have_no_memory_of_workgroups() {
    let of_rays = splitplane_shaders::QUERIES.iter().filter(|it| it.name != "triangle_limits");
    let with_memory =
        of_rays.filter(|shader| poison::poisoned(&shader.source(), poison::WORDS[0]).is_some());
    assert_eq!(with_memory.map(|shader| shader.name).collect::<Vec<_>>(), [""; 0]);
}

/// Each fault in the text of the kernel changes hits; the text as it is changes none.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_seen() {
    let twice = scenes::soup(200, 0.4, 15);
    let scenes = [
        twice.joined(&twice.clone(), "soup, twice"),
        scenes::needle_star(),
        scenes::seams(true),
        scenes::ratio(),
        scenes::scaled(&twice, 1e30, "soup at 1e30"),
        scenes::scaled(&twice, 1e11, "soup at 1e11"),
        scenes::scaled(&twice, 1e-30, "soup at 1e-30"),
        scenes::coplanar(1, 200),
        scenes::collinear(),
        scenes::grid_boxes(4),
        scenes::octaves(),
    ];
    let options = QueryOptions::default();
    let cases: Vec<(Case, Vec<Ray>, Vec<Hit>)> = scenes
        .iter()
        .map(|scene| {
            let case = Case::new(scene);
            let mut rays = all_rays(scene, &case, 20, 16);
            let first: Vec<Hit> =
                rays.iter().map(|ray| case.reference(ray, &options, Query::Closest)).collect();
            let closed = rays.iter().zip(&first).filter(|(_, hit)| hit.is_hit());
            let closed: Vec<Ray> =
                closed.map(|(ray, hit)| ray.with_limits(ray.t_min, hit.t)).collect();
            // And those that begin just behind what they hit.
            let behind = rays.iter().zip(&first).filter(|(_, hit)| hit.is_hit());
            let behind: Vec<Ray> =
                behind.map(|(ray, hit)| ray.with_limits(hit.t.next_up(), ray.t_max)).collect();
            rays.extend(closed);
            rays.extend(behind);
            rays.extend(away(scene, 50.0));
            rays.extend(along_x(200));
            let expected =
                rays.iter().map(|ray| case.reference(ray, &options, Query::Closest)).collect();
            (case, rays, expected)
        })
        .collect();
    // The first scene that shows a difference suffices: compiling takes longer than tracing.
    let differs = |sources: &[String; 2]| {
        cases.iter().any(|(case, rays, expected)| {
            let (found, _) = hits_by_sources(sources, case, rays);
            found.iter().zip(expected).any(|(a, b)| bits(a) != bits(b))
        })
    };
    let sources = ["closest_hit", "closest_hit_retry"]
        .map(|name| splitplane_shaders::find(name).expect("a kernel").source());
    assert!(!differs(&sources), "without a fault");
    let mut unseen = Vec::new();
    for (name, right, wrong) in [
        ("edges swapped", "edge_function(seen.c, seen.b)", "edge_function(seen.b, seen.c)"),
        ("higher index wins", "triangle < search.triangle", "triangle > search.triangle"),
        ("open interval", "key <= ray.greatest_key", "key < ray.greatest_key"),
        ("t is only interpolated", "if interpolates {", "if true {"),
        ("t is never interpolated", "if interpolates {", "if false {"),
        (
            "disorder is bounded by nothing",
            "free_mul(0x1.004p+0f, free_mul_add(1.0, width, deepest))",
            "0.0",
        ),
        (
            "a corner in another order",
            "triangles[x + 3u], triangles[y + 3u]",
            "triangles[y + 3u], triangles[x + 3u]",
        ),
        ("nothing is robust", "if is_robust(edges, area) && diff", "if false && diff"),
        ("all is robust", "if is_robust(edges, area) && diff", "if true && diff"),
        ("zeros are inside", "return SIDE_OPEN;", "return select(-1, 1, highest >= EDGE_LEAST);"),
        (
            "another than the best is skipped",
            "skips_best() && triangle == search.triangle",
            "skips_best() && triangle != search.triangle",
        ),
        ("thin images have weights", "THIN: f32 = 0x1p-21f", "THIN: f32 = 0x1p-80f"),
        ("far origins stay", "if plane.moves {", "if false {"),
        ("no wide test", "wide = wide_sheared(ray, triangle);", "wide.seen = sheared(ray, index);"),
        ("no slack of planes", "free_mul_add(abs(t), PLANE_SLACK, slack)", "0.0"),
        ("stops too early", "STOP_SLACK: f32 = 0x1p-13f", "STOP_SLACK: f32 = -0x1p-3f"),
        ("nodes below a cell", "interval.y < enter", "interval.y < leave"),
        ("weights swapped", "weights_over(vec3<f32>(edges.y", "weights_over(vec3<f32>(edges.x"),
        ("deferred rays are lost", "defer_ray(index, left_aside(hit));", ""),
        ("zeros are outside", "return SIDE_OPEN;", "return 0;"),
        (
            "no closer look where interpolation does not serve",
            "return open_between(lower, upper);",
            "return no_candidate();",
        ),
        ("closer looks are not deferred", "if !set_aside(triangle) {", "if false {"),
        ("far origins are not deferred", "|| !is_near(given)", ""),
        ("wide scenes are not deferred", "scene.wide != 0u || !is_near", "!is_near"),
        ("deep stacks are not deferred", "entry < STACK_STEP + SHORT_ENTRIES", "true"),
        ("what is set aside is lost", "return aside.x != 0u;", "return false;"),
        ("the second that is set aside is lost", "aside.y = name;", ""),
        ("the best is not taken along", "best_aside = best + 1u;", "best_aside = 0u;"),
        (
            "what is open is taken for far",
            "if candidate.weights.x > before.stop {",
            "if candidate.weights.x > -GREATEST {",
        ),
        (
            "what lies outside the limits ends the walk",
            "if within_limits(ray, outer_t(ray, candidate.weights.x)) && within_limits(ray, farthest) {",
            "if true {",
        ),
        (
            "walks end before what is open",
            "stop_after(ray, candidate.t, farthest)",
            "stop_after(ray, -1e9, -1e9)",
        ),
        (
            "walks of deferred rays do not begin",
            "select(NO_NODE, root, all(to_take_up == vec3<u32>()))",
            "NO_NODE",
        ),
        (
            "other rays are retried",
            "return deferred_rays[1u + 4u * place];",
            "return deferred_rays[1u + 4u * (place / 2u)];",
        ),
        ("an invocation takes one entry of the list", "place += apart", "place += 0x10000000u"),
        ("-0 below +0", "if bits == 0x80000000u {", "if false {"),
    ] {
        let faulty = sources.clone().map(|source| source.replacen(right, wrong, 1));
        assert_ne!(faulty, sources, "{name}: the text is not there");
        if !differs(&faulty) {
            unseen.push(name);
        }
    }
    assert!(unseen.is_empty(), "faults that no ray shows: {unseen:?}");
}
