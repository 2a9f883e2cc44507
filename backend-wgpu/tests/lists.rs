//! All hits, their numbers and points in a mesh on the device: the CPU's answers, bit for bit, in every scene; what is left to
//! the CPU is counted; the kernels list and count what the core's twin does, and faults in their text are seen.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

use crate::common::{self, by_sources, hostile, tested_queries as queries};
use splitplane_core::arithmetic::Strict;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::error::QueryError;
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions};
use splitplane_core::query::certify::{self, Counted, MOST_COUNTED};
use splitplane_core::query::inside::{DIRECTION, LocateOptions};
use splitplane_core::ray::{Culling, Hit, QueryOptions, Ray};
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_core::watch::{Progress, Watch};
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{Queries, WgpuAccelerator};

/// A tree on the CPU and on the device.
struct Case {
    name: String,
    cpu: CpuAccelerator,
    triangles: Vec<Triangle>,
    device: WgpuAccelerator,
}

impl Case {
    fn new(scene: &Scene) -> Case {
        Case::with(scene, queries())
    }

    fn with(scene: &Scene, queries: Arc<Queries>) -> Case {
        let mesh = scene.mesh();
        let cpu =
            CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).expect("a tree");
        let triangles: Vec<Triangle> =
            (0..mesh.len()).map(|i| prepare(&mesh.triangle(i)).corners).collect();
        let (tree, summary) = (cpu.tree().clone(), *cpu.summary());
        let device =
            WgpuAccelerator::upload(queries, tree, triangles.clone(), summary).expect("an upload");
        Case { name: scene.name.clone(), cpu, triangles, device }
    }

    /// The core's list of a ray; `None` where it can tell nothing.
    fn listed(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<BTreeSet<u32>> {
        let mut found = BTreeSet::new();
        let (tree, scale) = (self.cpu.tree().view(), self.cpu.scene_scale());
        let triangles = &self.triangles[..];
        certify::list::<Strict>(&tree, triangles, scale, ray, options, |t| {
            found.insert(t);
        })
        .then_some(found)
    }

    /// The core's count of a ray, as a device writes it.
    fn counted(&self, ray: &Ray, options: &QueryOptions<'_>) -> u32 {
        let (tree, scale) = (self.cpu.tree().view(), self.cpu.scene_scale());
        match certify::count::<Strict>(&tree, &self.triangles[..], scale, ray, options) {
            Counted::Crossed([front, back]) => front | back << 16,
            Counted::Undecided => Hit::UNDECIDED,
        }
    }

    /// Asks both for all hits and compares all words. Returns the crossings, and how many rays were the CPU's.
    fn check(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> (usize, u64) {
        let expected = self.cpu.all_hits(rays, options).expect("all hits on the CPU");
        let found = self.device.all_hits(rays, options).expect("all hits");
        assert_eq!(found.starts, expected.starts, "{}", self.name);
        for (i, ray) in rays.iter().enumerate() {
            assert_eq!(bits(&found, i), bits(&expected, i), "{}: {ray:?}", self.name);
        }
        let report = &found.report;
        assert!(report.answered_by_cpu >= report.undecided + report.unfinished);
        assert!(report.flagged.is_empty());
        let mut counts = vec![7; rays.len()];
        let counted = self.device.count_hits(rays, &mut counts, options).expect("counts");
        for ((ray, ends), count) in rays.iter().zip(expected.starts.windows(2)).zip(counts) {
            assert_eq!(ends[1] - ends[0], count as usize, "{}: {ray:?}", self.name);
        }
        assert!(counted.answered_by_cpu >= counted.undecided + counted.unfinished);
        assert!(counted.answered_by_cpu <= report.answered_by_cpu);
        (found.crossings.len(), report.answered_by_cpu)
    }

    /// The same for points.
    fn check_points(&self, points: &[[f32; 3]]) -> u64 {
        let options = LocateOptions::default();
        let expected = self.cpu.locate(points, &options).expect("locations on the CPU");
        let found = self.device.locate(points, &options).expect("locations");
        for ((point, found), expected) in points.iter().zip(&found.windings).zip(&expected.windings)
        {
            assert_eq!(found, expected, "{}: {point:?}", self.name);
        }
        found.report.answered_by_cpu
    }
}

/// Bits, so that -0 differs from 0.
fn bits(all: &AllHits, ray: usize) -> Vec<([u32; 4], bool)> {
    let words = |hit: &Hit| [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()];
    all.of(ray).iter().map(|met| (words(&met.hit), met.front)).collect()
}

/// Rays of every kind, odd and invalid ones among them, and rays in the planes of triangles and along their edges.
fn all_rays(scene: &Scene, each: usize, seed: u64) -> Vec<Ray> {
    let mesh = scene.mesh();
    let mut rays = Vec::new();
    for (i, kind) in Kind::ALL.into_iter().enumerate() {
        let good = aim::rays(&mesh, kind, each, seed + i as u64);
        rays.extend(aim::odd(&good[..each.div_ceil(2)], seed + 1));
        rays.extend(aim::invalid(&good[..each.div_ceil(4)], seed + 2));
        rays.extend(good);
    }
    let mut random = Random::new(seed);
    for _ in 0..if mesh.is_empty() { 0 } else { each } {
        let [a, b, c] = mesh.triangle(random.below(mesh.len()));
        let edge: [f32; 3] = std::array::from_fn(|k| b[k] - a[k]);
        let across: [f32; 3] = std::array::from_fn(|k| c[k] - 0.5 * (a[k] + b[k]));
        let before = std::array::from_fn(|k| a[k] - edge[k]);
        let whole = |ray: Ray| ray.with_limits(f32::NEG_INFINITY, f32::INFINITY);
        rays.extend([Ray::new(before, edge), whole(Ray::new(a, across)), Ray::new(c, edge)]);
    }
    rays
}

/// Points at random, at corners, on edges, on faces, and next to them.
fn points(scene: &Scene, count: usize, seed: u64) -> Vec<[f32; 3]> {
    let mesh = scene.mesh();
    let mut random = Random::new(seed);
    let mut points = vec![[f32::NAN, 0.0, 0.0], [0.0, f32::INFINITY, 0.0], [1e-42; 3]];
    for _ in 0..if mesh.is_empty() { 0 } else { count } {
        let corners = mesh.triangle(random.below(mesh.len()));
        let inner = random.barycentric();
        for weights in [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.5, 0.25, 0.25], inner] {
            let point: [f32; 3] = std::array::from_fn(|axis| {
                (0..3).map(|i| weights[i] * f64::from(corners[i][axis])).sum::<f64>() as f32
            });
            let axis = random.below(3);
            let mut beside = point;
            beside[axis] = [point[axis].next_up(), point[axis].next_down()][random.below(2)];
            let far = point.map(|x| x * 1.25 + 0.125);
            points.extend([point, beside, far]);
        }
    }
    points
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn all_hits_are_the_cpus() {
    let (mut crossings, mut by_cpu, mut asked) = (0, 0, 0);
    for (i, scene) in scenes::awkward().iter().enumerate() {
        let case = Case::new(scene);
        let each = if scene.mesh().len() >= 3_000 { 8 } else { 24 };
        let rays = all_rays(scene, each, 100 * i as u64);
        let culling = [Culling::None, Culling::Back, Culling::Front][i % 3];
        let ignore = (i % 2 == 0).then_some(i as u32 % 4);
        for options in [
            AllHitsOptions::default(),
            AllHitsOptions { culling, ignore, ..AllHitsOptions::default() },
        ] {
            let (found, left) = case.check(&rays, &options);
            let query = options.query();
            let told = rays.iter().filter(|ray| case.listed(ray, &query).is_some()).count();
            // Besides what a driver does not let finish.
            let none = rays.len() - told;
            assert!(left >= none as u64, "{}: {left} of {none}", case.name);
            (crossings, by_cpu, asked) = (crossings + found, by_cpu + left, asked + rays.len());
        }
    }
    assert!(crossings > 5_000, "{crossings}");
    assert!(by_cpu * 2 < asked as u64, "{by_cpu} of {asked}");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn nothing_that_nobody_aimed_is_left_to_the_cpu() {
    for scene in [scenes::soup(2_000, 0.3, 5), scenes::sphere(30, [1.0, 2.0, 3.0], 2.0)] {
        let case = Case::new(&scene);
        let rays = aim::rays(&scene.mesh(), Kind::Random, 20_000, 1);
        // In several slices.
        let options = AllHitsOptions { max_memory: Some(4 << 20), ..AllHitsOptions::default() };
        let (crossings, by_cpu) = case.check(&rays, &options);
        assert!(crossings > 2_000, "{crossings}");
        assert_eq!(by_cpu, 0, "{}", case.name);
        // Nearly all that is listed is crossed, but for triangles that reach from behind the origin to before it.
        let length = |ray| case.listed(ray, &QueryOptions::default()).expect("a list").len();
        let listed: usize = rays.iter().map(length).sum();
        assert!(listed >= crossings && listed * 10 <= crossings * 11, "{listed}, {crossings}");
        let points: Vec<[f32; 3]> = rays.iter().map(|ray| ray.origin).collect();
        assert_eq!(case.check_points(&points), 0, "{}", case.name);
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn windings_are_the_cpus() {
    for (i, scene) in scenes::awkward().iter().enumerate() {
        let case = Case::new(scene);
        let points = points(scene, 12, i as u64);
        let by_cpu = case.check_points(&points);
        let options = QueryOptions::default();
        let untold =
            |point: &&[f32; 3]| case.listed(&Ray::new(**point, DIRECTION), &options).is_none();
        assert!(by_cpu >= points.iter().filter(untold).count() as u64, "{}", case.name);
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn no_rays_one_ray_and_no_triangles() {
    let scene = scenes::soup(50, 0.5, 1);
    let case = Case::new(&scene);
    let ray = aim::rays(&scene.mesh(), Kind::Faces, 1, 2);
    assert_eq!(case.check(&[], &AllHitsOptions::default()), (0, 0));
    assert_eq!(case.check(&ray, &AllHitsOptions::default()).1, 0);
    assert_eq!((case.check_points(&[]), case.check_points(&[[0.5; 3]])), (0, 0));
    let nothing = Scene { name: "nothing".into(), positions: vec![], indices: None };
    let case = Case::new(&nothing);
    assert_eq!(case.check(&[ray[0]; 65], &AllHitsOptions::default()), (0, 0));
    assert_eq!(case.check_points(&[[0.5; 3], [0.0; 3]]), 0);
}

/// Triangles of which a ray meets more than fit the first list, exactly as many, and one less; between others that meet few.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn long_lists() {
    for count in [6, 7, 8, 500] {
        let scene = scenes::identical(count);
        let case = Case::new(&scene);
        let mut rays = aim::rays(&scene.mesh(), Kind::Faces, 150, 3);
        let beside = rays[0].origin.map(|x| x + 3.0);
        for ray in rays.iter_mut().step_by(3) {
            ray.origin = beside;
        }
        let (crossings, by_cpu) = case.check(&rays, &AllHitsOptions::default());
        assert_eq!((crossings, by_cpu), (100 * count, 0));
    }
    // Lists of many lengths.
    let soup = scenes::soup(3_000, 1.0, 9);
    let case = Case::new(&soup);
    let rays = aim::rays(&soup.mesh(), Kind::Random, 3_000, 4);
    let (crossings, by_cpu) = case.check(&rays, &AllHitsOptions::default());
    assert!(crossings > 10 * rays.len() && by_cpu == 0, "{crossings}, {by_cpu} by the CPU");
    // In several runs, and in several slices.
    for max_memory in [4 << 20, 2 << 20] {
        let options = AllHitsOptions { max_memory: Some(max_memory), ..AllHitsOptions::default() };
        assert_eq!(case.check(&rays[..1_500], &options).1, 0);
    }
}

/// More triangles on the way than memory may hold are the CPU's. It needs none where it finds that none is crossed.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn lists_that_memory_does_not_hold() {
    let scene = scenes::identical(1_000);
    let case = Case::new(&scene);
    let [a, b, c] = scene.mesh().triangle(0);
    let inner: [f32; 3] = std::array::from_fn(|k| 0.25 * (a[k] + b[k]) + 0.5 * c[k]);
    // In their plane.
    let ray = Ray::new(a, std::array::from_fn(|k| inner[k] - a[k]));
    let little = AllHitsOptions { max_memory: Some(16 << 10), ..AllHitsOptions::default() };
    assert_eq!(case.check(&[ray; 3], &AllHitsOptions::default()), (0, 0));
    assert_eq!(case.check(&[ray; 3], &little), (0, 3));
    // Crossed, they are too many for both.
    let across = aim::rays(&scene.mesh(), Kind::Faces, 3, 1);
    let both: [&dyn Accelerator; 2] = [&case.cpu, &case.device];
    for accelerator in both {
        let error = accelerator.all_hits(&across, &little).expect_err("too many");
        let over = |needed| needed > 16 << 10;
        assert!(
            matches!(error, QueryError::OutOfMemory { needed, limit: 16_384 } if over(needed)),
            "{error}"
        );
    }
    let none = AllHitsOptions { max_memory: Some(7), ..AllHitsOptions::default() };
    assert!(case.device.all_hits(&[ray], &none).is_err());
    let none = LocateOptions { max_memory: Some(7), ..LocateOptions::default() };
    assert!(case.device.locate(&[a], &none).is_err());
}

/// Under any limit the answer is right, or the error says what is needed.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn any_limit_of_memory_is_kept() {
    let scene = scenes::soup(600, 1.0, 4);
    let case = Case::new(&scene);
    let rays = aim::rays(&scene.mesh(), Kind::Random, 200, 5);
    let expected = case.cpu.all_hits(&rays, &AllHitsOptions::default()).expect("all hits");
    let (mut kept, mut refused) = (0, 0);
    let mut limit = 1u64;
    while limit < 1 << 24 {
        let options = AllHitsOptions { max_memory: Some(limit), ..AllHitsOptions::default() };
        match case.device.all_hits(&rays, &options) {
            Ok(all) => {
                assert!(all.crossings == expected.crossings && all.starts == expected.starts);
                assert!(all.bytes() <= limit, "{} of {limit}", all.bytes());
                kept += 1;
            }
            Err(QueryError::OutOfMemory { needed, limit: told }) => {
                assert!(told == limit && needed > limit, "{needed} of {limit}");
                assert_eq!(kept, 0, "what little memory holds, more does too");
                refused += 1;
            }
            Err(error) => panic!("{error}"),
        }
        limit += 1 + limit / 4;
    }
    assert!(kept > 10 && refused > 10, "{kept} kept, {refused} refused");
}

/// Ends the work at a call of this number.
struct EndsAt(u64, AtomicU64);

impl Watch for EndsAt {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        assert!(progress.done <= progress.total);
        let call = self.1.fetch_add(1, Relaxed);
        assert!(call <= self.0, "called after the end");
        if call == self.0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn watches_end_them_anywhere() {
    let scene = scenes::soup(600, 1.0, 4);
    let case = Case::new(&scene);
    let rays = aim::rays(&scene.mesh(), Kind::Random, 3_000, 5);
    let points: Vec<[f32; 3]> = rays.iter().map(|ray| ray.origin).collect();
    let mut calls = [0, 0];
    for points_too in [false, true] {
        loop {
            let watch = EndsAt(calls[usize::from(points_too)], AtomicU64::new(0));
            let ended = if points_too {
                let options = LocateOptions { watch: Some(&watch), ..LocateOptions::default() };
                case.device.locate(&points, &options).map(drop)
            } else {
                let options = AllHitsOptions { watch: Some(&watch), ..AllHitsOptions::default() };
                case.device.all_hits(&rays, &options).map(drop)
            };
            match ended {
                Ok(()) => break,
                Err(QueryError::Cancelled { done, total: 3_000 }) => assert!(done <= 3_000),
                Err(error) => panic!("{error}"),
            }
            // Not at every call: the device is watched while it works.
            calls[usize::from(points_too)] = calls[usize::from(points_too)] * 5 / 4 + 1;
        }
    }
    assert!(calls.iter().all(|calls| *calls > 10), "{calls:?}");
}

/// Rays that a driver does not follow to their end, rays that take the deep stack, and rays from far away.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn long_deep_and_far_rays() {
    let scene = scenes::identical(70_000);
    let case = Case::new(&scene);
    let rays = aim::rays(&scene.mesh(), Kind::Faces, 3, 14);
    let found = case.device.all_hits(&rays, &AllHitsOptions::default()).expect("all hits");
    assert_eq!(found.crossings.len(), 3 * 70_000);
    let (_, by_cpu) = case.check(&rays, &AllHitsOptions::default());
    if common::is_llvmpipe() {
        assert_eq!((found.report.unfinished, by_cpu), (3, 3));
    } else {
        assert_eq!(by_cpu, 0);
    }
    let octaves = scenes::octaves();
    let case = Case::new(&octaves);
    let slope = |i: u32| (i as f32 * 0.618_034).fract() * 0.5 - 0.25;
    let start = |i: u32| [0.5 * (1 << (i % 20)) as f32, 0.0, 0.0];
    let along = |i: u32| Ray::new(start(i), [1.0, slope(i), slope(7 * i + 3)]);
    let deep: Vec<Ray> = (0..1_000).map(along).collect();
    let (crossings, by_cpu) = case.check(&deep, &AllHitsOptions::default());
    assert!(crossings > 100 && by_cpu == 0, "{crossings}, {by_cpu} by the CPU");
    let far: Vec<Ray> = deep.iter().map(|ray| Ray { origin: [-1e12, 3.0, 4.0], ..*ray }).collect();
    assert_eq!(case.check(&far, &AllHitsOptions::default()).1, 1_000);
}

/// A device that no self-test has found to round as the CPU does is asked nothing.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_device_without_parity_leaves_all_to_the_cpu() {
    let scene = scenes::soup(300, 0.5, 1);
    let case = Case::with(&scene, Arc::new(Queries::new(common::gpu())));
    let rays = aim::rays(&scene.mesh(), Kind::Random, 200, 2);
    assert_eq!(case.check(&rays, &AllHitsOptions::default()).1, 200);
    assert_eq!(case.check_points(&rays.iter().map(|ray| ray.origin).collect::<Vec<_>>()), 200);
    // Scenes whose exponents leave the range of the bounds.
    let case = Case::new(&scenes::scaled(&scene, 1e30, "soup at 1e30"));
    let rays = aim::rays(&scenes::scaled(&scene, 1e30, "the same").mesh(), Kind::Random, 200, 2);
    assert_eq!(case.check(&rays, &AllHitsOptions::default()).1, 200);
}

/// Words of a list in the tests of the kernels.
const ROOM: usize = 12;

/// The lists by any sources of the kernels, through the device tree of a case.
fn lists_by_sources(sources: &[String; 2], case: &Case, rays: &[Ray]) -> Vec<u32> {
    let tree = case.device.device_tree();
    let (lists, _) = by_sources::answers(sources, tree, rays, 4 * ROOM, ROOM as u32);
    bytemuck::pod_collect_to_vec(&lists)
}

/// Whether lists are those of the core: the same triangles, as far as there is room, none twice in a row, and marks.
fn are_the_cores(lists: &[u32], expected: &[Option<BTreeSet<u32>>]) -> bool {
    lists.chunks_exact(ROOM).zip(expected).all(|(words, expected)| {
        let Some(expected) = expected else { return words[0] == Hit::UNDECIDED };
        let length = words[0] as usize;
        let written = &words[1..ROOM.min(length.saturating_add(1))];
        let found: BTreeSet<u32> = written.iter().copied().collect();
        let twice = written.windows(2).any(|pair| pair[0] == pair[1]);
        let complete = if length < ROOM {
            found == *expected
        } else {
            length >= expected.len() && found.is_subset(expected)
        };
        complete && !twice
    })
}

fn sources() -> [String; 2] {
    ["list_triangles", "list_triangles_retry"].map(source_of)
}

fn counting_sources() -> [String; 2] {
    ["count_crossings", "count_crossings_retry"].map(source_of)
}

fn source_of(kernel: &str) -> String {
    splitplane_shaders::find(kernel).expect("a kernel").source()
}

/// A case, rays, and what the core lists of each.
struct KernelCase {
    case: Case,
    rays: Vec<Ray>,
    expected: Vec<Option<BTreeSet<u32>>>,
    counts: Vec<u32>,
}

impl KernelCase {
    /// Whether kernels of these sources list what the core does.
    fn holds(&self, sources: &[String; 2]) -> bool {
        are_the_cores(&lists_by_sources(sources, &self.case, &self.rays), &self.expected)
    }

    /// Whether kernels of these sources count what the core does.
    fn counts_hold(&self, sources: &[String; 2]) -> bool {
        let tree = self.case.device.device_tree();
        let (counts, _) = by_sources::answers(sources, tree, &self.rays, 4, MOST_COUNTED as u32);
        bytemuck::pod_collect_to_vec::<u8, u32>(&counts) == self.counts
    }
}

fn kernel_cases() -> Vec<KernelCase> {
    let scenes = [
        scenes::soup(400, 0.3, 18),
        scenes::needle_star(),
        scenes::seams(true),
        scenes::sphere(16, [1e3, -2e3, 5e2], 1.0),
        scenes::coplanar(1, 100),
        scenes::grid_boxes(4),
        scenes::octaves(),
    ];
    let slope = |i: u32| (i as f32 * 0.618_034).fract() * 0.5 - 0.25;
    scenes
        .iter()
        .map(|scene| {
            let case = Case::new(scene);
            let mut rays = all_rays(scene, 30, 31);
            // Past many octaves, for which the short stack does not suffice.
            let along = |i| Ray::new([0.5, 0.0, 0.0], [1.0, slope(i), slope(7 * i + 3)]);
            rays.extend((0..300).map(along));
            let options = QueryOptions::default();
            let expected = rays.iter().map(|ray| case.listed(ray, &options)).collect();
            let counts = rays.iter().map(|ray| case.counted(ray, &options)).collect();
            KernelCase { case, rays, expected, counts }
        })
        .collect()
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn kernels_list_what_the_core_does() {
    let sources = sources();
    for case in kernel_cases() {
        assert!(case.holds(&sources), "{}", case.case.name);
    }
}

/// The same of counts, of which some are certain and some are not.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn kernels_count_what_the_core_does() {
    let sources = counting_sources();
    let (mut certain, mut left) = (0, 0);
    for case in kernel_cases() {
        assert!(case.counts_hold(&sources), "{}", case.case.name);
        let undecided = case.counts.iter().filter(|&&count| count == Hit::UNDECIDED).count();
        (certain, left) = (certain + case.counts.len() - undecided, left + undecided);
    }
    assert!(certain > 1_000 && left > 100, "{certain} certain, {left} left");
}

/// Lists and counts are the same on drivers that do what WGSL allows and this machine's do not. One that folds the barrier away and fuses what
/// it kept apart is seen.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn lists_and_counts_on_drivers_that_round_as_they_like() {
    // A soup, needles and seams: compiling and tracing all would take minutes.
    let cases: Vec<KernelCase> = kernel_cases().into_iter().take(3).collect();
    for driver in hostile::ALLOWED {
        let [lists, counts] =
            [sources(), counting_sources()].map(|pair| pair.map(|source| driver.compiled(&source)));
        for case in &cases {
            assert!(case.holds(&lists), "lists, {}, {}", driver.name, case.case.name);
            assert!(case.counts_hold(&counts), "counts, {}, {}", driver.name, case.case.name);
        }
    }
    let fused = counting_sources().map(|source| hostile::fused(&hostile::folded(&source)));
    assert!(cases.iter().any(|case| !case.counts_hold(&fused)), "nothing is seen");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_in_counts_are_seen() {
    let (sources, cases) = (counting_sources(), kernel_cases());
    let mut unseen = Vec::new();
    for (from, to) in [
        ("if signs.positive && signs.negative {", "if signs.positive || signs.negative {"),
        ("signs.open || any(signs.known", "any(signs.known"),
        ("any(signs.known == vec3<f32>(0.0))", "false"),
        ("|| verdict.met.error == 0.0", ""),
        ("CROSSES_FROM_BACK, CROSSES_FROM_FRONT", "CROSSES_FROM_FRONT, CROSSES_FROM_BACK"),
        ("listed[count_start + at] == triangle", "false"),
        ("listed[count_start + at] == triangle", "true"),
        ("count_start = index * batch.room;", "count_start = index;"),
        ("count_sides.y << 16u", "count_sides.y << 15u"),
        ("return is_as_given(ray, prepared);", "return true;"),
        ("hit.triangle == NO_TRIANGLE);", "true);"),
        ("search.undecided = true;", ""),
        ("defer_ray(index, vec3<u32>());", ""),
        ("deferred_rays[1u + 4u * place];", "deferred_rays[1u + 4u * (place / 2u)];"),
    ] {
        let faulty = sources.clone().map(|source| source.replacen(from, to, 1));
        assert_ne!(faulty, sources, "{from}: the text is not there");
        if cases.iter().all(|case| case.counts_hold(&faulty)) {
            unseen.push((from, to));
        }
    }
    assert!(unseen.is_empty(), "faults that no ray shows: {unseen:?}");
}

/// More crossings of a ray than the device counts, exactly as many, and one less; under limits of memory, and with a watch.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn more_crossings_than_are_counted() {
    for count in [MOST_COUNTED - 1, MOST_COUNTED, MOST_COUNTED + 1, 300] {
        let case = Case::new(&scenes::identical(count));
        let rays = aim::rays(&scenes::identical(count).mesh(), Kind::Faces, 100, 3);
        assert_eq!(case.check(&rays, &AllHitsOptions::default()), (100 * count, 0));
        let mut counts = vec![0; 99];
        let options = AllHitsOptions::default();
        assert!(matches!(
            case.device.count_hits(&rays, &mut counts, &options),
            Err(QueryError::LengthMismatch { rays: 100, results: 99 })
        ));
    }
    let scene = scenes::soup(600, 1.0, 4);
    let case = Case::new(&scene);
    let rays = aim::rays(&scene.mesh(), Kind::Random, 2_000, 5);
    let mut counts = vec![0; rays.len()];
    let little = AllHitsOptions { max_memory: Some(64), ..AllHitsOptions::default() };
    let refused = case.device.count_hits(&rays, &mut counts, &little);
    assert!(matches!(refused, Err(QueryError::OutOfMemory { limit: 64, .. })));
    let (mut call, mut cancelled) = (0, 0);
    loop {
        let watch = EndsAt(call, AtomicU64::new(0));
        let options = AllHitsOptions { watch: Some(&watch), ..AllHitsOptions::default() };
        match case.device.count_hits(&rays, &mut counts, &options) {
            Ok(_) => break,
            Err(QueryError::Cancelled { done, total: 2_000 }) => assert!(done <= 2_000),
            Err(error) => panic!("{error}"),
        }
        (call, cancelled) = (call * 5 / 4 + 1, cancelled + 1);
    }
    assert!(cancelled > 3, "{cancelled}");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_seen() {
    let (sources, cases) = (sources(), kernel_cases());
    let mut unseen = Vec::new();
    for (from, to) in [
        ("const BLUR: f32 = 0x1p-21f", "const BLUR: f32 = 0x1p-30f"),
        ("if (positive && negative) || culled", "if positive || culled"),
        ("if nearest > least(farthest, ray.t_max)", "if nearest < least(farthest, ray.t_max)"),
        ("greatest < ray.t_min", "greatest <= ray.t_min"),
        ("list_length < batch.room", "list_length <= batch.room"),
        ("list_start = index * batch.room;", "list_start = index;"),
        ("list_length = 0u;\n", "list_length = 1u;\n"),
        ("any(search.recent == vec4<u32>(triangle))", "any(search.recent != vec4<u32>(triangle))"),
        ("any(search.recent == vec4<u32>(triangle))", "false"),
        ("return is_as_given(ray, prepared);", "return true;"),
        ("hit.triangle == NO_TRIANGLE);", "true);"),
        ("defer_ray(index, vec3<u32>());", ""),
        ("deferred_rays[1u + 4u * place];", "deferred_rays[1u + 4u * (place / 2u)];"),
        ("entry < STACK_STEP + SHORT_ENTRIES", "true"),
        ("interval.y < enter", "interval.y < leave"),
    ] {
        let faulty = sources.clone().map(|source| source.replacen(from, to, 1));
        assert_ne!(faulty, sources, "{from}: the text is not there");
        if cases.iter().all(|case| case.holds(&faulty)) {
            unseen.push((from, to));
        }
    }
    assert!(unseen.is_empty(), "faults that no ray shows: {unseen:?}");
}
