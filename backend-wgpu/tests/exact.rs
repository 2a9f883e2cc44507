//! Accuracy `exact` on the device: decided rays have the oracle's hit, the others are redone or
//! flagged, and counted; twins of shader and core decide alike.

use crate::common::{self, bits, tested_queries as queries};
use splitplane_core::arithmetic::Strict;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::query::certify;
use splitplane_core::query::intersect::SceneScale;
use splitplane_core::query::traverse::Query;
use splitplane_core::query::traverse::exact;
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray, Undecided};
use splitplane_core::tree::KdTree;
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_cpu::CpuBackend;
use splitplane_shaders::{TriangleTest, traversal};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::oracle::{Oracle, OracleHit};
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{DeviceQueryError, Marked, UNFINISHED, WgpuAccelerator};

const EXACT: QueryOptions = QueryOptions {
    accuracy: Accuracy::Exact,
    culling: Culling::None,
    ignore: None,
    undecided: Undecided::Redo,
    watch: None,
};
const FLAG: QueryOptions = QueryOptions { undecided: Undecided::Flag, ..EXACT };
const STALE: Hit = Hit { t: -7.0, triangle: 0xdead, u: 7.0, v: 7.0 };

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
        Case { name: scene.name.clone(), tree, triangles, scale: *built.scene_scale(), device }
    }

    fn exact(&self, ray: &Ray, options: &QueryOptions<'_>) -> Hit {
        let hit = exact::closest_hit(&self.tree.view(), &self.triangles[..], ray, options);
        hit.unwrap_or(Hit::MISS)
    }

    fn twin(&self, ray: &Ray, options: &QueryOptions<'_>, query: Query) -> Hit {
        let (tree, triangles) = (self.tree.view(), &self.triangles[..]);
        certify::trace::<Strict>(&tree, triangles, &self.scale, ray, options, query)
    }

    /// What the device itself says.
    fn marked(&self, rays: &[Ray], options: &QueryOptions<'_>) -> (Vec<Hit>, Marked) {
        let mut hits = vec![STALE; rays.len()];
        let tree = self.device.device_tree();
        let marked = queries().closest_hits_marking(tree, rays, &mut hits, options).expect("hits");
        (hits, marked)
    }
}

/// Rays of every kind, with odd and invalid ones among them.
fn all_rays(scene: &Scene, each: usize, seed: u64) -> Vec<Ray> {
    let mesh = scene.mesh();
    let mut rays = Vec::new();
    for (i, kind) in Kind::ALL.into_iter().enumerate() {
        let good = aim::rays(&mesh, kind, each, seed + i as u64);
        rays.extend(aim::odd(&good[..each.div_ceil(2)], seed + 1));
        rays.extend(aim::invalid(&good[..each.div_ceil(4)], seed + 2));
        rays.extend(good);
    }
    rays
}

/// Redone: all hits are those of the oracle and, bit for bit, of the CPU. Flagged: all but those that
/// the report names are. Both reports count the same.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn awkward_scenes() {
    let (mut hits_in_all, mut decided) = (0, 0);
    for (i, scene) in scenes::awkward().iter().enumerate() {
        let case = Case::new(scene);
        let oracle = Oracle::new(&scene.mesh());
        let each = if scene.mesh().len() >= 3_000 { 4 } else { 24 };
        let rays = all_rays(scene, each, 100 * i as u64);
        let (mut redone, mut flagged) = (vec![STALE; rays.len()], vec![STALE; rays.len()]);
        let mut any = [vec![false; rays.len()], vec![true; rays.len()]];
        let report = case.device.closest_hits(&rays, &mut redone, &EXACT).expect("hits");
        let with_flags = case.device.closest_hits(&rays, &mut flagged, &FLAG).expect("hits");
        let any_report = case.device.any_hits(&rays, &mut any[0], &EXACT).expect("answers");
        let any_flags = case.device.any_hits(&rays, &mut any[1], &FLAG).expect("answers");
        let name = &case.name;
        assert!(report.flagged.is_empty() && any_report.flagged.is_empty());
        assert_eq!(report.undecided, with_flags.undecided, "{name}");
        assert_eq!(report.undecided, with_flags.flagged.len() as u64, "{name}");
        assert_eq!(any_report.undecided, any_flags.flagged.len() as u64, "{name}");
        for (i, ray) in rays.iter().enumerate() {
            let expected = case.exact(ray, &EXACT);
            assert_eq!(bits(&redone[i]), bits(&expected), "{name}: {ray:?}");
            let first = match oracle.closest(ray) {
                OracleHit::Miss => None,
                OracleHit::Hit { triangles, .. } => triangles.first().copied(),
            };
            assert_eq!(redone[i].some().map(|hit| hit.triangle), first, "{name}: {ray:?}");
            if with_flags.flagged.binary_search(&i).is_ok() {
                assert_eq!(flagged[i].triangle, Hit::UNDECIDED, "{name}: {ray:?}");
            } else {
                assert_eq!(bits(&flagged[i]), bits(&expected), "{name}: {ray:?}");
                decided += 1;
            }
            assert_eq!(any[0][i], expected.is_hit(), "{name}: {ray:?}");
            if any_flags.flagged.binary_search(&i).is_err() {
                assert_eq!(any[1][i], expected.is_hit(), "{name}: {ray:?}");
            }
            hits_in_all += usize::from(expected.is_hit());
        }
    }
    assert!(hits_in_all > 3_000 && decided > 3_000, "{hits_in_all} hits, {decided} decided");
}

/// Bit for bit, marks included; and what nobody aimed is decided.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn twins_decide_alike() {
    let culled = QueryOptions { culling: Culling::Back, ignore: Some(3), ..EXACT };
    for scene in [
        scenes::soup(2_000, 0.1, 5),
        scenes::sphere(30, [1.0, 2.0, 3.0], 2.0),
        scenes::grid_boxes(4),
        scenes::seams(true),
    ] {
        let case = Case::new(&scene);
        let rays = all_rays(&scene, 30, 9);
        for options in [EXACT, culled] {
            let (hits, marked) = case.marked(&rays, &options);
            assert!(marked.unfinished.is_empty());
            let mut undecided = Vec::new();
            for (i, (ray, hit)) in rays.iter().zip(&hits).enumerate() {
                let expected = case.twin(ray, &options, Query::Closest);
                assert_eq!(bits(hit), bits(&expected), "{}: {ray:?}", case.name);
                if expected.triangle == Hit::UNDECIDED {
                    undecided.push(i);
                }
            }
            assert_eq!(marked.undecided, undecided);
            let mut any = vec![false; rays.len()];
            let tree = case.device.device_tree();
            let marked = queries().any_hits_marking(tree, &rays, &mut any, &options).expect("any");
            for (i, ray) in rays.iter().enumerate() {
                let expected = case.twin(ray, &options, Query::Any);
                let open = marked.undecided.binary_search(&i).is_ok();
                assert_eq!(open, expected.triangle == Hit::UNDECIDED, "{}: {ray:?}", case.name);
                assert!(open || any[i] == expected.is_hit(), "{}: {ray:?}", case.name);
            }
        }
        let rays = aim::rays(&scene.mesh(), Kind::Random, 500, 1);
        assert_eq!(case.marked(&rays, &EXACT).1, Marked::default(), "{}", case.name);
    }
}

/// Hosts without a host copy are notified, too.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn undecided_rays_are_an_error_where_nothing_can_mark_them() {
    let case = Case::new(&scenes::one());
    // Next to the triangle, then so far off that the ray must be moved.
    let [a, b, c] = case.triangles[0];
    let at: [f32; 3] = std::array::from_fn(|k| 0.25 * a[k] + 0.25 * b[k] + 0.5 * c[k]);
    let ray = |z: f32| Ray::new([at[0], at[1], z], [0.0, 0.0, at[2] - z]);
    let rays = [ray(2.0), ray(1e6), ray(-2.0), ray(-1e6)];
    let mut hits = [STALE; 4];
    let tree = case.device.device_tree();
    let result = queries().closest_hits(tree, &rays, &mut hits, &EXACT);
    assert_eq!(result, Err(DeviceQueryError::Undecided { rays: 2, first: 1 }));
    let mut any = [false; 4];
    let result = queries().any_hits(tree, &rays, &mut any, &EXACT);
    assert_eq!(result, Err(DeviceQueryError::Undecided { rays: 2, first: 1 }));
    assert_eq!(queries().closest_hits(tree, &rays[..1], &mut hits[..1], &EXACT), Ok(()));
    assert_eq!(hits[0].triangle, 0);
}

/// A shader of a host's own with this text of the traversal: closest hits.
fn shader(text: &str) -> wgpu::ComputePipeline {
    let own = "
@group(0) @binding(0) var<storage, read> given: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> found: array<vec4<u32>>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&found) { return; }
    let ray = ray_of_words(given[2u * id.x], given[2u * id.x + 1u]);
    found[id.x] = hit_words(closest_hit(ray, default_options()));
}";
    common::gpu().pipeline("host", &(text.to_owned() + own)).expect("a pipeline")
}

/// The closest hits by such a shader.
fn traced_by(pipeline: &wgpu::ComputePipeline, case: &Case, rays: &[Ray]) -> Vec<Hit> {
    use wgpu::BufferUsages as Usage;
    let gpu = common::gpu();
    let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
    let given = gpu.buffer("rays", size_of_val(rays) as u64, usage).expect("a buffer");
    let hits = gpu.buffer("hits", 16 * rays.len() as u64, usage).expect("a buffer");
    gpu.queue().write_buffer(&given, 0, bytemuck::cast_slice(rays));
    let group = |index, entries: &[wgpu::BindGroupEntry<'_>]| {
        let layout = &pipeline.get_bind_group_layout(index);
        let descriptor = wgpu::BindGroupDescriptor { label: None, layout, entries };
        gpu.device().create_bind_group(&descriptor)
    };
    let buffers = [(0, &given), (1, &hits)].map(|(binding, buffer)| wgpu::BindGroupEntry {
        binding,
        resource: buffer.as_entire_binding(),
    });
    let groups = [group(0, &buffers), group(1, &case.device.device_tree().bind_group_entries(0))];
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &groups[0], &[]);
        pass.set_bind_group(1, &groups[1], &[]);
        pass.dispatch_workgroups(rays.len().div_ceil(64) as u32, 1, 1);
    }
    gpu.submit([encoder.finish()]).expect("commands");
    bytemuck::pod_collect_to_vec(&common::read(&hits))
}

/// The traversal as a library; and each fault in its text is seen: a decided ray is wrong.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_seen() {
    let text = traversal(1, 0, TriangleTest::Certain);
    let scenes = [
        scenes::seams(true),
        scenes::needle_star(),
        scenes::sphere(16, [1e3, -2e3, 5e2], 1.0),
        scenes::coplanar(1, 100),
    ];
    let cases: Vec<(Case, Vec<Ray>)> =
        scenes.iter().map(|scene| (Case::new(scene), all_rays(scene, 60, 31))).collect();
    // Decided rays that are wrong, and undecided ones.
    let judge = |text: &str| {
        let (mut wrong, mut undecided) = (0, 0);
        let pipeline = shader(text);
        for (case, rays) in &cases {
            for (ray, hit) in rays.iter().zip(traced_by(&pipeline, case, rays)) {
                assert_ne!(hit.triangle, UNFINISHED);
                if hit.triangle == Hit::UNDECIDED {
                    undecided += 1;
                } else {
                    wrong += u32::from(hit.triangle != case.exact(ray, &EXACT).triangle);
                }
            }
        }
        (wrong, undecided)
    };
    let (wrong, undecided) = judge(&text);
    assert_eq!(wrong, 0);
    assert!(undecided > 50, "{undecided}");
    for (from, to) in [
        ("const BLUR: f32 = 0x1p-21f", "const BLUR: f32 = 0x1p-30f"),
        ("search.doubt = least(search.doubt, verdict.least);", ""),
        ("triangle > search.triangle)", "triangle < search.triangle)"),
    ] {
        assert!(text.contains(from), "{from}");
        assert_ne!(judge(&text.replace(from, to)).0, 0, "{from}");
    }
}

/// Buffers of a host's own: nothing is redone, what is undecided is marked.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn device_buffers_are_marked() {
    use wgpu::BufferUsages as Usage;
    let scene = scenes::seams(true);
    let case = Case::new(&scene);
    let rays = all_rays(&scene, 40, 77);
    let gpu = common::gpu();
    let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
    let buffer = |bytes: usize| gpu.buffer("test", bytes as u64, usage).expect("a buffer");
    let (given, hits) = (buffer(size_of_val(&rays[..])), buffer(16 * rays.len()));
    let any = buffer(4 * rays.len());
    gpu.queue().write_buffer(&given, 0, bytemuck::cast_slice(&rays));
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    let (tree, count) = (case.device.device_tree(), rays.len() as u32);
    let queries = queries();
    queries
        .record_closest_hits(&mut encoder, tree, &given, &hits, count, &EXACT)
        .expect("commands");
    queries.record_any_hits(&mut encoder, tree, &given, &any, count, &EXACT).expect("commands");
    gpu.submit([encoder.finish()]).expect("commands");
    let hits: Vec<Hit> = bytemuck::pod_collect_to_vec(&common::read(&hits));
    let any: Vec<u32> = bytemuck::pod_collect_to_vec(&common::read(&any));
    let mut marks = 0;
    for (i, ray) in rays.iter().enumerate() {
        let expected = case.exact(ray, &EXACT);
        if hits[i].triangle == Hit::UNDECIDED {
            marks += 1;
            assert!(!expected.is_hit() || hits[i].t <= expected.t, "{ray:?}");
        } else {
            assert_eq!(hits[i].triangle, expected.triangle, "{ray:?}");
            if expected.is_hit() && ray.origin.iter().all(|x| x.abs() < 10.0) {
                let error = (hits[i].t - expected.t).abs();
                assert!(error <= 1.2e-7 * expected.t.abs(), "{ray:?}: {error}");
            }
        }
        let told = [u32::from(expected.is_hit()), 3];
        assert!(told.contains(&any[i]), "{ray:?}: {}", any[i]);
    }
    assert!(marks > 5, "{marks}");
}
