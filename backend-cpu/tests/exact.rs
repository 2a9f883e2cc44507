//! Accuracy `exact` on the CPU, held against the exact oracle, which shares no code with it: the
//! triangle, the distance to the last bit, the weights within their error. Every path of every
//! instruction set gives the same bits as the reference in the core. (That computes in `f64` and whole
//! numbers, so the hostile arithmetic of other tests has nothing to disturb in it.)
//!
//! `SPLITPLANE_LONG=1` casts ten times as many rays.

use crate::common::long;
use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::BuildConfig;
use splitplane_core::query::intersect::longest_extent;
use splitplane_core::query::traverse::Query;
use splitplane_core::query::traverse::exact;
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_cpu::{CpuAccelerator, CpuBackend, InstructionSet};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::oracle::{Nearest, Oracle};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};

const EXACT: QueryOptions = options(Culling::None, None);

const fn options(culling: Culling, ignore: Option<u32>) -> QueryOptions<'static> {
    QueryOptions {
        accuracy: Accuracy::Exact,
        culling,
        ignore,
        undecided: splitplane_core::ray::Undecided::Redo,
        watch: None,
    }
}

fn many(rays: usize) -> usize {
    if long() { 10 * rays } else { rays }
}

fn build(scene: &Scene, set: InstructionSet) -> CpuAccelerator {
    let mesh = scene.mesh();
    CpuBackend::with_instruction_set(set)
        .build_accelerator(&mesh, &BuildOptions::default())
        .expect("a tree")
}

fn closest(tree: &dyn Accelerator, rays: &[Ray], options: &QueryOptions<'_>) -> Vec<Hit> {
    let stale = Hit { t: -7.0, triangle: 0xdead, u: 7.0, v: 7.0 };
    let mut hits = vec![stale; rays.len()];
    tree.closest_hits(rays, &mut hits, options).expect("equal lengths");
    hits
}

fn bits(hit: &Hit) -> [u32; 4] {
    [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()]
}

/// How a hit differs from what the oracle says, in words.
fn fault(oracle: &Oracle, ray: &Ray, options: &QueryOptions<'_>, hit: &Hit) -> Option<String> {
    let Some(Nearest { t, triangle }) = oracle.nearest(ray, options) else {
        return (bits(hit) != bits(&Hit::MISS)).then(|| "should be a miss".into());
    };
    if (hit.triangle, hit.t.to_bits()) != (triangle, t.to_bits()) {
        return Some(format!("should be triangle {triangle} at {t:e}"));
    }
    let weights = oracle.weights_of(ray, triangle).expect("a triangle that is met");
    // Half a unit in the last place of 1 each; and the second is held to what the first leaves.
    let error = 1.5 / f64::from(1u32 << 24);
    let found = [f64::from(hit.u), f64::from(hit.v)];
    let wrong = (0..2).any(|i| (found[i] - weights[i]).abs() > error)
        || found.iter().any(|x| !(0.0..=1.0).contains(x))
        || hit.u + hit.v > 1.0;
    wrong.then(|| format!("weights should be {weights:?}"))
}

/// The faults among the hits of a batch.
fn faults(oracle: &Oracle, rays: &[Ray], options: &QueryOptions<'_>, hits: &[Hit]) -> Vec<String> {
    rays.par_iter()
        .zip(hits)
        .filter_map(|(ray, hit)| {
            let fault = fault(oracle, ray, options, hit)?;
            Some(format!("{fault}\n  answer {hit:?}\n  {ray:?}\n  {options:?}"))
        })
        .collect()
}

/// Rays of one kind, and others made from them: odd ones, and such as begin or end where something
/// is hit, or one float beside.
fn rays(scene: &Scene, oracle: &Oracle, kind: Kind, count: usize, seed: u64) -> Vec<Ray> {
    let mesh = scene.mesh();
    let mut rays = aim::rays(&mesh, kind, count, seed);
    let limited: Vec<Ray> = rays
        .iter()
        .enumerate()
        .filter_map(|(i, ray)| {
            let Nearest { t, .. } = oracle.nearest(ray, &EXACT)?;
            Some(match i % 6 {
                0 => ray.with_limits(t, f32::INFINITY),
                1 => ray.with_limits(t.next_up(), f32::INFINITY),
                2 => ray.with_limits(t.next_down(), t.next_up()),
                3 => ray.with_limits(-f32::INFINITY, t),
                4 => ray.with_limits(0.0, t.next_down()),
                _ => ray.with_limits(t, t),
            })
        })
        .collect();
    rays.extend(limited);
    rays.extend(aim::odd(&rays, seed + 1));
    rays
}

/// Where every ray meets thousands of triangles at once, a few rays try the same thing over and over.
fn share(scene: &Scene) -> usize {
    match scene.name.as_str() {
        "identical triangles" | "fan" => 40,
        "spike" => 5,
        _ => 1,
    }
}

#[test]
fn hits_are_those_of_real_arithmetic() {
    let (mut hit, mut all) = (0, 0);
    for scene in scenes::awkward() {
        let oracle = Oracle::new(&scene.mesh());
        let tree = build(&scene, InstructionSet::detect());
        for (i, kind) in Kind::ALL.into_iter().enumerate() {
            let rays = rays(&scene, &oracle, kind, many(100) / share(&scene), i as u64);
            let first = closest(&tree, &rays, &EXACT);
            let ignore = first.iter().find(|hit| hit.is_hit()).map(|hit| hit.triangle);
            for options in [EXACT, options(Culling::Back, ignore), options(Culling::Front, ignore)]
            {
                let hits = closest(&tree, &rays, &options);
                let wrong = faults(&oracle, &rays, &options, &hits);
                assert!(
                    wrong.is_empty(),
                    "{}, {kind:?}: {} of {} are wrong, the first: {}",
                    scene.name,
                    wrong.len(),
                    rays.len(),
                    wrong[0]
                );
                hit += hits.iter().filter(|hit| hit.is_hit()).count();
                all += hits.len();
            }
        }
    }
    println!("{hit} hits of {all} rays, all as real arithmetic has them");
    assert!(hit * 4 > all, "{hit} {all}");
}

/// Rays from far off through corners on the sides of the scene's bounds, and nearly along these sides, without rounding. Their
/// origins are moved near the scene on the way in; what that rounds away must not take them past the bounds, nor into them behind a hit.
fn along_the_bounds(scene: &Scene, count: usize, random: &mut Random) -> Vec<Ray> {
    let mesh = scene.mesh();
    let bounds = Aabb::of_points(&scene.positions);
    let mut rays = Vec::new();
    while rays.len() < count {
        let corner = mesh.triangle(random.below(mesh.len()))[random.below(3)];
        let side = (0..3).find(|&k| corner[k] == bounds.lo[k] || corner[k] == bounds.hi[k]);
        let largest = corner.iter().fold(0.0f32, |most, x| most.max(x.abs()));
        // A unit in the last place of the largest coordinate, and up to 2^22 of them.
        let unit = largest.log2().floor().exp2() * f32::EPSILON;
        let steps = ((8 + random.below(15)) as f32).exp2();
        let direction: [f32; 3] = core::array::from_fn(|k| {
            let slope = if side == Some(k) { 0.2 * random.signed() } else { 1.0 };
            unit * (slope * steps * random.signed()).round()
        });
        let origin: [f32; 3] = core::array::from_fn(|k| corner[k] - direction[k]);
        let exact =
            |k: usize| f64::from(corner[k]) - f64::from(origin[k]) == f64::from(direction[k]);
        if side.is_some() && (0..3).all(exact) {
            let scale = random.pick(&[-100.0f32, 0.0, 90.0]).exp2();
            rays.push(Ray::new(origin, direction.map(|x| x * scale)));
        }
    }
    rays
}

#[test]
fn far_rays_along_the_bounds_hit_what_they_hit_in_real_arithmetic() {
    let mut random = Random::new(8);
    for scene in [
        scenes::sphere(20, [1e7, -1e7, 1e7], 1000.0),
        scenes::sphere(24, [1e3, -1e3, 1e3], 1.0),
        scenes::sphere(16, [-3e5, 7e5, 1e5], 100.0),
    ] {
        let oracle = Oracle::new(&scene.mesh());
        let rays = along_the_bounds(&scene, many(4_000), &mut random);
        for set in InstructionSet::available() {
            let hits = closest(&build(&scene, set), &rays, &EXACT);
            let wrong = faults(&oracle, &rays, &EXACT, &hits);
            assert!(wrong.is_empty(), "{set:?}: {} wrong, the first: {}", wrong.len(), wrong[0]);
            assert!(hits.iter().filter(|hit| hit.is_hit()).count() * 4 > rays.len());
        }
    }
}

/// The same on real scenes, where they are present.
#[test]
fn hits_on_real_scenes_are_those_of_real_arithmetic() {
    let (mut all, mut scenes_seen) = (0, 0);
    for scene in ["bunny", "horse", "kitchen", "stadium"].into_iter().filter_map(scenes::real) {
        let oracle = Oracle::new(&scene.mesh());
        let tree = build(&scene, InstructionSet::detect());
        scenes_seen += 1;
        for (i, kind) in Kind::ALL.into_iter().enumerate() {
            let rays = rays(&scene, &oracle, kind, many(300), 40 + i as u64);
            let hits = closest(&tree, &rays, &EXACT);
            let wrong = faults(&oracle, &rays, &EXACT, &hits);
            assert!(wrong.is_empty(), "{}, {kind:?}: {}", scene.name, wrong[0]);
            all += rays.len();
        }
    }
    println!("{all} rays in {scenes_seen} scenes");
}

/// What the checks above must not let pass.
#[test]
fn what_is_wrong_is_found() {
    let scene = scenes::sphere(20, [100.0, 50.0, -70.0], 1.0);
    let oracle = Oracle::new(&scene.mesh());
    let tree = build(&scene, InstructionSet::detect());
    let rays = rays(&scene, &oracle, Kind::ExactVertices, 300, 7);
    let hits = closest(&tree, &rays, &EXACT);
    assert!(faults(&oracle, &rays, &EXACT, &hits).is_empty());
    let wrong = |change: &dyn Fn(&Hit) -> Hit| {
        let hits: Vec<Hit> = hits.iter().map(change).collect();
        faults(&oracle, &rays, &EXACT, &hits).len()
    };
    assert!(wrong(&|hit| Hit { t: hit.t.next_up(), ..*hit }) > 100);
    assert!(wrong(&|hit| Hit { triangle: hit.triangle.saturating_add(1), ..*hit }) > 100);
    assert!(wrong(&|hit| Hit { u: (hit.u - 2e-7).abs(), ..*hit }) > 50);
    assert!(wrong(&|_| Hit::MISS) > 100);
    let rounded = closest(&tree, &rays, &QueryOptions::default());
    assert!(faults(&oracle, &rays, &EXACT, &rounded).len() > 20);
}

/// Rays side by side, which are traced as packets, and some of all kinds.
fn crowds(scene: &Scene, seed: u64) -> Vec<Ray> {
    let mesh = scene.mesh();
    let mut random = Random::new(seed);
    let mut rays = Vec::new();
    for ray in aim::rays(&mesh, Kind::Vertices, 24, seed) {
        let largest = ray.direction.iter().fold(0.0f32, |most, x| most.max(x.abs()));
        for i in 0..32 {
            let spread = 1e-3 * largest * i as f32;
            let direction = ray.direction.map(|x| x + spread * random.unit() as f32);
            rays.push(Ray { direction, ..ray });
        }
        // Back from where the first of them ends.
        let end = [0, 1, 2].map(|k| ray.origin[k] + ray.direction[k]);
        for other in &rays.clone()[rays.len() - 32..] {
            let direction = [0, 1, 2].map(|k| other.origin[k] - end[k] + other.direction[k] * 0.01);
            rays.push(Ray::new(end, direction).with_limits(1e-3, 1.0));
        }
    }
    // From one place to the edges of one triangle, 16 at a time; from near and from far.
    for ray in aim::rays(&mesh, Kind::Faces, 48, seed + 1) {
        let corners = mesh.triangle(random.below(mesh.len()));
        for i in 0..16 {
            let (a, b, s) = (corners[i % 3], corners[(i + 1) % 3], random.unit());
            let target = [0, 1, 2].map(|k| {
                let (a, b) = (f64::from(a[k]), f64::from(b[k]));
                a + s * (b - a)
            });
            rays.push(aim::aimed(ray.origin, target));
        }
    }
    for kind in Kind::ALL {
        let some = aim::rays(&mesh, kind, 40, seed);
        rays.extend(aim::odd(&some, seed));
        rays.extend(aim::invalid(&some[..8], seed));
        rays.extend(some);
    }
    rays.extend(from_afar(scene, &mut random));
    rays
}

/// Rays from up to the end of the floats, whose direction is, except for one component, of the
/// scene's size: the precision that preparation loses decides what it hits.
fn from_afar(scene: &Scene, random: &mut Random) -> Vec<Ray> {
    let mesh = scene.mesh();
    (0..600)
        .map(|i| {
            let corners = mesh.triangle(random.below(mesh.len()));
            let weights = random.barycentric();
            let size = longest_extent(&Aabb::of_points(&corners));
            let axis = random.below(3);
            let main = ((i % 124) as f32).exp2() * size * (1.0 + random.unit() as f32);
            let main = if main.is_finite() { main } else { 1.7e38 };
            let (mut origin, mut direction) = ([0.0; 3], [0.0; 3]);
            for k in 0..3 {
                let target: f32 = (0..3).map(|c| corners[c][k] * weights[c] as f32).sum();
                direction[k] = if k == axis { main } else { size * random.signed() };
                origin[k] = target - direction[k];
            }
            Ray::new(origin, direction)
        })
        .collect()
}

#[test]
fn every_path_gives_the_bits_of_the_reference() {
    let mut hit = 0;
    let pools = [1, 3].map(|threads| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool")
    });
    for (seed, scene) in [
        scenes::one(),
        scenes::soup(3_000, 0.1, 51),
        scenes::scaled(&scenes::soup(300, 0.3, 52), 1e-9, "tiny soup"),
        scenes::scaled(&scenes::soup(300, 0.3, 53), 1e10, "huge soup"),
        scenes::scaled(&scenes::soup(300, 0.3, 54), 1e-36, "soup out of range"),
        scenes::sphere(24, [1e3, -1e3, 1e3], 1.0),
        scenes::seams(true),
        scenes::needle_star(),
        scenes::identical(300),
        scenes::nested_spheres(),
    ]
    .into_iter()
    .enumerate()
    {
        let mesh = scene.mesh();
        let rays = crowds(&scene, seed as u64);
        for (culling, ignore, width) in
            [(Culling::None, None, 16), (Culling::Back, Some(3), 1), (Culling::Front, None, 4)]
        {
            let options = options(culling, ignore);
            let config = BuildConfig { block_width: width, ..BuildConfig::default() };
            let mut expected = Vec::new();
            for set in InstructionSet::available() {
                let tree = CpuBackend::with_instruction_set(set)
                    .build_accelerator(&mesh, &BuildOptions::from(config))
                    .expect("a tree");
                if expected.is_empty() {
                    expected = rays
                        .iter()
                        .map(|ray| {
                            let (view, query) = (tree.tree().view(), Query::Closest);
                            exact::trace(&view, &mesh, ray, &options, query, &mut ())
                        })
                        .collect();
                    hit += expected.iter().filter(|hit| hit.is_hit()).count();
                }
                let what = format!("{}, {set:?}, {options:?}", scene.name);
                let same = |found: &[Hit], path: &str| {
                    for ((found, expected), ray) in found.iter().zip(&expected).zip(&rays) {
                        assert_eq!(bits(found), bits(expected), "{what}, {path}: {ray:?}");
                    }
                };
                for pool in &pools {
                    pool.install(|| {
                        same(&closest(&tree, &rays, &options), "batch");
                        // Batches of other sizes fill lanes and packets otherwise.
                        for size in [33, 100] {
                            let parts: Vec<Hit> = rays
                                .chunks(size)
                                .flat_map(|rays| closest(&tree, rays, &options))
                                .collect();
                            same(&parts, "parts");
                        }
                    });
                }
                let mut found = vec![Hit::MISS; rays.len()];
                tree.closest_hits_singly(&rays, &mut found, &options).expect("equal lengths");
                same(&found, "singly");
                let any: Vec<bool> = expected.iter().map(Hit::is_hit).collect();
                let mut occluded = vec![false; rays.len()];
                tree.any_hits(&rays, &mut occluded, &options).expect("equal lengths");
                assert_eq!(occluded, any, "{what}, any");
                let mut occluded: Vec<bool> = any.iter().map(|any| !any).collect();
                tree.any_hits_singly(&rays, &mut occluded, &options).expect("equal lengths");
                assert_eq!(occluded, any, "{what}, any, singly");
                for ((ray, expected), any) in rays.iter().zip(&expected).zip(&any).step_by(7) {
                    let one = tree.closest_hit(ray, &options).unwrap_or(Hit::MISS);
                    assert_eq!(bits(&one), bits(expected), "{what}, one ray: {ray:?}");
                    assert_eq!(tree.any_hit(ray, &options), *any, "{what}, one ray: {ray:?}");
                }
            }
        }
    }
    assert!(hit > 10_000, "{hit}");
}
