//! Rays that keep their stacks in the memory of the workgroup, as adapters of some vendors are given them: the same answers,
//! bit for bit.

use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

use crate::common::{self, along_x, poison, trusted};
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::kernel::QueryKernel;
use splitplane_core::query::all_hits::AllHitsOptions;
use splitplane_core::query::inside::LocateOptions;
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::scene::{SceneHit, SceneOptions};
use splitplane_core::triangle::prepare;
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_shaders::{QUERIES, RENDER, RENDER_COMPRESSED, join, with_workgroup_stacks};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::objects;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{Gpu, Queries, RayStack, WgpuAccelerator, WgpuBackend};

fn gpu() -> Gpu {
    Gpu::clone(&common::gpu()).with_ray_stack(RayStack::Workgroup)
}

fn queries() -> Arc<Queries> {
    static QUERIES: OnceLock<Arc<Queries>> = OnceLock::new();
    QUERIES.get_or_init(|| trusted(Arc::new(gpu()))).clone()
}

/// A tree on the CPU and on the device.
struct Case {
    name: String,
    cpu: CpuAccelerator,
    device: WgpuAccelerator,
}

impl Case {
    fn new(scene: &Scene, queries: Arc<Queries>) -> Case {
        let mesh = scene.mesh();
        let cpu =
            CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).expect("a tree");
        let triangles = (0..mesh.len()).map(|i| prepare(&mesh.triangle(i)).corners).collect();
        let device =
            WgpuAccelerator::upload(queries, cpu.tree().clone(), triangles, *cpu.summary())
                .expect("an upload");
        Case { name: scene.name.clone(), cpu, device }
    }

    /// Whether all words of both are the same.
    fn agrees(&self, rays: &[Ray], options: &QueryOptions<'_>) -> bool {
        let ask = |one: &dyn Accelerator| {
            let mut hits = vec![Hit::MISS; rays.len()];
            let mut any = vec![false; rays.len()];
            let report = one.closest_hits(rays, &mut hits, options).expect("hits");
            one.any_hits(rays, &mut any, options).expect("answers");
            (bytemuck::cast_slice::<_, [u32; 4]>(&hits).to_vec(), any, report.flagged)
        };
        ask(&self.cpu) == ask(&self.device)
    }

    fn check(&self, rays: &[Ray]) {
        for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
            for culling in [Culling::None, Culling::Back] {
                let options = QueryOptions { accuracy, culling, ..QueryOptions::default() };
                assert!(self.agrees(rays, &options), "{}: {accuracy:?} {culling:?}", self.name);
            }
        }
    }
}

/// Rays of every kind, and some that lie in planes of the tree.
fn rays(scene: &Scene, case: &Case, each: usize, seed: u64) -> Vec<Ray> {
    let mesh = scene.mesh();
    let mut rays: Vec<Ray> = Kind::ALL
        .into_iter()
        .flat_map(|kind| {
            let good = aim::rays(&mesh, kind, each, seed);
            let odd = aim::odd(&good, seed + 1);
            good.into_iter().chain(odd)
        })
        .collect();
    let (view, mut aim) = (case.cpu.tree().view(), aim::Aim::new(&mesh, seed + 2));
    rays.extend((0..each).map(|_| aim.in_split_plane(&view)));
    rays
}

fn small_scenes() -> Vec<Scene> {
    let small = |scene: &Scene| scene.mesh().len() < 3_000;
    scenes::awkward().into_iter().filter(small).collect()
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn hits_are_the_cpus() {
    for (i, scene) in small_scenes().iter().enumerate() {
        let mut case = Case::new(scene, queries());
        let rays = rays(scene, &case, 12, 100 * i as u64);
        case.check(&rays);
        case.device.compress().expect("compressed nodes");
        case.check(&rays);
    }
    // More rays than a workgroup has, each of which goes deep.
    let mut case = Case::new(&scenes::octaves(), queries());
    case.check(&along_x(2000));
    case.device.compress().expect("compressed nodes");
    case.check(&along_x(2000));
}

/// What rounds as it likes has nothing to be equal to, so it is compared with the other stack.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn fast_hits_are_those_of_the_other_stack() {
    let scene = scenes::sphere(30, [1.0, 2.0, 3.0], 2.0);
    let here = Case::new(&scene, queries());
    let there = Case::new(&scene, Arc::new(Queries::new(common::gpu())));
    let rays = aim::rays(&scene.mesh(), Kind::Random, 5000, 3);
    let options = QueryOptions { accuracy: Accuracy::Fast, ..QueryOptions::default() };
    let mut hits = [(); 2].map(|()| vec![Hit::MISS; rays.len()]);
    for (case, hits) in [&here, &there].into_iter().zip(&mut hits) {
        case.device.closest_hits(&rays, hits, &options).expect("hits");
    }
    assert!(hits[0].iter().filter(|hit| hit.is_hit()).count() > 300);
    // Compilers may fuse differently; which triangles are met does not depend on that but at their edges.
    let same = hits[0].iter().zip(&hits[1]).filter(|(a, b)| a.triangle == b.triangle);
    assert!(same.count() + 5 > rays.len());
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn all_hits_and_windings_are_the_cpus() {
    for (i, scene) in small_scenes().iter().enumerate().step_by(2) {
        let case = Case::new(scene, queries());
        let rays = rays(scene, &case, 6, 100 * i as u64);
        let options = AllHitsOptions::default();
        let both: [&dyn Accelerator; 2] = [&case.cpu, &case.device];
        let [expected, found] = both.map(|one| one.all_hits(&rays, &options).expect("all hits"));
        assert_eq!(found.starts, expected.starts, "{}", case.name);
        assert_eq!(found.crossings, expected.crossings, "{}", case.name);
        let points: Vec<[f32; 3]> = rays.iter().map(|ray| ray.origin).collect();
        let points: Vec<[f32; 3]> =
            points.into_iter().filter(|point| point.iter().all(|x| x.is_finite())).collect();
        let both: [&dyn Accelerator; 2] = [&case.cpu, &case.device];
        let [expected, found] =
            both.map(|one| one.locate(&points, &LocateOptions::default()).expect("locations"));
        assert_eq!(found.windings, expected.windings, "{}", case.name);
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn hits_in_scenes_are_the_cpus() {
    let device = WgpuBackend::new(gpu()).expect("a backend");
    let (cpu, build) = (CpuBackend::new(), BuildOptions::default());
    for kind in [objects::Kind::Ordinary, objects::Kind::IllConditioned] {
        let (scene, _) = objects::scene(kind, 40, 71);
        let rays = objects::rays(&scene, 1500, 72);
        let ask = |one: &dyn SceneAccelerator| {
            let mut hits = vec![SceneHit::MISS; rays.len()];
            let mut any = vec![false; rays.len()];
            let options = SceneOptions::default();
            one.closest_hits(&rays, &mut hits, &options).expect("hits");
            one.any_hits(&rays, &mut any, &options).expect("hits");
            (bytemuck::cast_slice::<_, [u32; 6]>(&hits).to_vec(), any)
        };
        let expected = ask(&*cpu.build_scene(&scene, &build).expect("a scene"));
        assert!(expected.1.iter().filter(|any| **any).count() > 100);
        assert_eq!(ask(&*device.build_scene(&scene, &build).expect("a scene")), expected);
    }
}

/// The text of a query with its stack in the memory of the workgroup.
fn text(name: &str) -> String {
    let shader = splitplane_shaders::find(name).expect("a kernel");
    join(&with_workgroup_stacks(Cow::Borrowed(shader.parts)))
}

/// Which kernels have such a stack, and that the device gets it. Those that trace again what was deferred need a stack for any
/// tree, which no workgroup has memory for.
#[test]
fn lean_kernels_have_their_stack_in_the_memory_of_the_workgroup() {
    let changed = |name: &&str| {
        poison::poisoned(&text(name), poison::WORDS[0]).is_some()
            && splitplane_shaders::find(name).expect("a kernel").source() != text(name)
    };
    let tables = QUERIES.iter().chain(RENDER).chain(RENDER_COMPRESSED);
    let names: Vec<&str> = tables.map(|shader| shader.name).filter(changed).collect();
    let expected = [
        "closest_hit",
        "closest_hit_fast",
        "closest_hit_exact",
        "any_hit",
        "any_hit_fast",
        "any_hit_exact",
        "list_triangles",
        "count_crossings",
        "closest_hit_compressed",
        "any_hit_compressed",
        "trace_instances",
        "trace_instances_masked",
        "closest_hits",
        "shadow_hits",
        "shadow_hits_through_glass",
        "closest_hits_compressed",
        "shadow_hits_compressed",
        "shadow_hits_through_glass_compressed",
    ];
    assert_eq!(names, expected);
}

/// The memory of a workgroup is not cleared, and each fault in the stack changes hits.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_seen() {
    let queries = trusted(Arc::new(gpu()));
    let scene = scenes::octaves();
    let case = Case::new(&scene, queries.clone());
    let mut all = along_x(500);
    all.extend(rays(&scene, &case, 20, 5));
    let options = QueryOptions::default();
    let agrees_with = |kernel: QueryKernel, text: String| {
        queries.replace_kernel(kernel, Some(text));
        let agrees = case.agrees(&all, &options);
        queries.replace_kernel(kernel, None);
        agrees
    };
    for word in poison::WORDS {
        let poisoned = poison::poisoned(&text("closest_hit"), word).expect("memory");
        assert!(agrees_with(QueryKernel::ClosestHit, poisoned));
    }
    for (what, right, wrong) in [
        ("one stack for all", "    stack_lane = lane;", "    stack_lane = 0u;"),
        ("entries overlap", "STACK_STEP: u32 = 64u", "STACK_STEP: u32 = 4u"),
        (
            "where it leaves is lost",
            "stack_leaves[place] = entry.leave;",
            "stack_leaves[place] = 0.0;",
        ),
        (
            "another node",
            "stack_nodes[place] = entry.node;",
            "stack_nodes[place] = entry.node & ~7u;",
        ),
        ("deep stacks are not deferred", "entry < STACK_STEP + SHORT_SIZE", "true"),
    ] {
        let own = text("closest_hit");
        assert!(own.contains(right), "{what}");
        assert!(!agrees_with(QueryKernel::ClosestHit, own.replace(right, wrong)), "{what}");
    }
}
