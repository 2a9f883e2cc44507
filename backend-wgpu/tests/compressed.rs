//! Rays through compressed nodes on the device against the core's reference traversal of the tree, bit for bit.

use crate::common::{bits, queries};
use splitplane_core::arithmetic::Strict;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::query::compressed::{BOX_ENTRIES, CompressedNodes};
use splitplane_core::query::intersect::SceneScale;
use splitplane_core::query::traverse::{Query, trace};
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::tree::KdTree;
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::WgpuAccelerator;

struct Case {
    name: String,
    tree: KdTree,
    triangles: Vec<Triangle>,
    scale: SceneScale,
    device: WgpuAccelerator,
}

impl Case {
    fn new(scene: &Scene, config: BuildConfig) -> Case {
        let mesh = scene.mesh();
        let built = CpuBackend::new()
            .build_accelerator(&mesh, &BuildOptions::from(config))
            .expect("a tree");
        let triangles: Vec<Triangle> =
            (0..mesh.len()).map(|i| prepare(&mesh.triangle(i)).corners).collect();
        let tree = built.tree().clone();
        let summary = *built.summary();
        let mut device =
            WgpuAccelerator::upload(queries(), tree.clone(), triangles.clone(), summary)
                .expect("an upload");
        let before = device.device_tree().bytes();
        device.compress().expect("compressed nodes");
        let scale = *built.scene_scale();
        assert_eq!(device.device_tree().is_compressed(), !scale.wide, "{}", scene.name);
        assert_eq!(device.device_tree().bytes() > before, !scale.wide, "{}", scene.name);
        Case { name: scene.name.clone(), tree, triangles, scale, device }
    }

    /// Holds closest and any hit of all rays against the reference; gives how many hit. No driver ends a ray early.
    fn check(&self, rays: &[Ray], options: &QueryOptions<'_>) -> usize {
        let [hits, unfinished] = self.compare(rays, options);
        assert_eq!(unfinished, 0, "{}", self.name);
        hits
    }

    /// The same, and how many rays the driver did not let finish, which the host then answers.
    fn compare(&self, rays: &[Ray], options: &QueryOptions<'_>) -> [usize; 2] {
        let stale = Hit { t: -7.0, triangle: 0xdead, u: 7.0, v: 7.0 };
        let (mut hits, mut occluded) = (vec![stale; rays.len()], vec![true; rays.len()]);
        let report = self.device.closest_hits(rays, &mut hits, options).expect("hits");
        self.device.any_hits(rays, &mut occluded, options).expect("answers");
        let (tree, name) = (self.tree.view(), &self.name);
        let mut count = 0;
        for (i, ray) in rays.iter().enumerate() {
            let corners = &self.triangles[..];
            let expected =
                trace::<Strict>(&tree, corners, &self.scale, ray, options, Query::Closest);
            assert_eq!(bits(&hits[i]), bits(&expected), "{name}: {ray:?} {options:?}");
            assert_eq!(occluded[i], expected.is_hit(), "{name}, any: {ray:?} {options:?}");
            count += usize::from(expected.is_hit());
        }
        [count, report.answered_by_cpu as usize]
    }
}

/// Rays of every kind, with odd, invalid and random ones among them, in planes of the tree and from corners on.
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
    let mut random = Random::new(seed + 4);
    let starts = if case.triangles.is_empty() { 0 } else { each };
    rays.extend((0..starts).map(|_| {
        let corners = case.triangles[random.below(case.triangles.len())];
        let direction = random.direction().map(|x| x as f32);
        Ray::new(random.pick(&corners), direction)
    }));
    rays
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn awkward_scenes() {
    let (mut hits, mut unfinished, mut all) = (0, 0, 0);
    for (i, scene) in scenes::awkward().iter().enumerate() {
        let preset = [Preset::Fast, Preset::Narrow, Preset::Best][i % 3];
        let case = Case::new(scene, preset.config());
        let each = if scene.mesh().len() >= 20_000 { 2 } else { 30 };
        let rays = all_rays(scene, &case, each, 1000 * i as u64);
        let [met, left] = case.compare(&rays, &QueryOptions::default());
        (hits, unfinished, all) = (hits + met, unfinished + left, all + rays.len());
    }
    // Thousands of triangles in one place take llvmpipe's 65,535 rounds.
    assert!(hits > 7_000 && 20 * unfinished < all, "{hits} {unfinished} {all}");
}

/// Triangles far larger than the rest, crowds in one place, and leaves of hundreds.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn large_triangles_crowds_and_long_leaves() {
    let soup = scenes::soup(900, 0.1, 17);
    let one_leaf = BuildConfig { max_depth: 1, ..Preset::Fast.config() };
    for (scene, config) in [
        (scenes::giants(), Preset::Narrow.config()),
        (soup.joined(&scenes::scaled(&scenes::one(), 1e5, "ground"), "grounded"), {
            Preset::Narrow.config()
        }),
        (scenes::identical(400), Preset::Fast.config()),
        (scenes::converging(400, 12, 5), Preset::Balanced.config()),
        (soup, one_leaf),
    ] {
        let case = Case::new(&scene, config);
        let rays = all_rays(&scene, &case, 60, 5);
        assert!(case.check(&rays, &QueryOptions::default()) > 30, "{}", case.name);
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn options_and_limits() {
    let soup = scenes::soup(500, 0.2, 91);
    for scene in [scenes::nested_spheres(), soup.joined(&soup.clone(), "soup, twice")] {
        let case = Case::new(&scene, Preset::Narrow.config());
        let mut rays = all_rays(&scene, &case, 30, 7);
        for culling in [Culling::None, Culling::Back, Culling::Front] {
            case.check(&rays, &QueryOptions { culling, ..Default::default() });
        }
        let ignore = Some(case.triangles.len() as u32 / 2);
        case.check(&rays, &QueryOptions { ignore, ..Default::default() });
        let view = case.tree.view();
        let options = QueryOptions::default();
        for ray in &mut rays {
            let (corners, query) = (&case.triangles[..], Query::Closest);
            let t = trace::<Strict>(&view, corners, &case.scale, ray, &options, query).t;
            if t.is_finite() {
                *ray = ray.with_limits(if t > 1.0 { t.next_up() } else { t }, f32::INFINITY);
            }
        }
        case.check(&rays, &options);
    }
}

/// A ray that meets more boxes than the stack has room for is traced through the tree: nested boxes around one point.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn stacks_that_are_too_deep() {
    let scene = scenes::converging(3_000, 20, 3);
    let case = Case::new(&scene, Preset::Narrow.config());
    let nodes = CompressedNodes::new(&case.tree.view(), &case.triangles[..], &case.scale)
        .expect("few references");
    let rays = all_rays(&scene, &case, 400, 11);
    let options = QueryOptions::default();
    let left = |ray: &&Ray| {
        let corners = &case.triangles[..];
        let hit =
            nodes.trace::<Strict, ()>(corners, &case.scale, ray, &options, Query::Closest, &mut ());
        hit.is_none()
    };
    // Those that start far off are among them.
    let near = |ray: &&Ray| {
        (0..3).all(|k| {
            case.scale.near.lo[k] <= ray.origin[k] && ray.origin[k] <= case.scale.near.hi[k]
        })
    };
    let deep = rays.iter().filter(near).filter(left).count();
    assert!(deep > 0, "{BOX_ENTRIES} entries are enough for all of {}", rays.len());
    assert!(case.check(&rays, &options) > 100);
}

/// Other accuracies go through the tree, as before.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn other_accuracies_use_the_tree() {
    let scene = scenes::nested_spheres();
    let mut case = Case::new(&scene, Preset::Fast.config());
    let rays = aim::rays(&scene.mesh(), Kind::Faces, 500, 11);
    let options = QueryOptions { accuracy: Accuracy::Fast, ..Default::default() };
    let mut hits = [vec![Hit::MISS; rays.len()], vec![Hit::MISS; rays.len()]];
    case.device.closest_hits(&rays, &mut hits[0], &options).expect("hits");
    let (tree, triangles) = (case.tree.clone(), case.triangles.clone());
    case.device = WgpuAccelerator::upload(queries(), tree, triangles, *case.device.summary())
        .expect("an upload");
    case.device.closest_hits(&rays, &mut hits[1], &options).expect("hits");
    assert_eq!(hits[0], hits[1]);
    assert!(hits[0].iter().filter(|hit| hit.is_hit()).count() > 400);
}
