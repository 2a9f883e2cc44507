//! Hits, held against the exact oracle, on every backend.
//!
//! Each check is a function of a backend. It runs on the real backends, on the exact one (to see
//! that it passes where nothing is wrong) and on backends with a planted fault (to see that it
//! fails). `SPLITPLANE_LONG=1` casts 50 times as many rays: the long test.

use crate::common::{bits, long};
use proptest::prelude::*;
use proptest::test_runner::{RngSeed, TestRunner};
use rayon::prelude::*;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, LoadOptions};
use splitplane_core::config::BuildConfig;
use splitplane_core::error::{BuildError, QueryError};
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::exact::ExactBackend;
use splitplane_test_support::faulty::{Fault, FaultyBackend, LeakyBackend};
use splitplane_test_support::judge::{Judge, Verdict};
use splitplane_test_support::oracle::Oracle;
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};

/// How many rays a check casts.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Effort {
    /// For the exact and the faulty backends, which are slow.
    Small,
    Full,
}

impl Effort {
    fn rays(self, small: usize, full: usize) -> usize {
        match self {
            Effort::Small => small,
            Effort::Full if long() => full * 50,
            Effort::Full => full,
        }
    }
}

fn build(backend: &dyn Backend, scene: &Scene) -> Box<dyn Accelerator> {
    backend
        .build(&scene.mesh(), &BuildOptions::default())
        .unwrap_or_else(|error| panic!("{}: {error}", scene.name))
}

fn closest(accelerator: &dyn Accelerator, rays: &[Ray], options: &QueryOptions<'_>) -> Vec<Hit> {
    // Results of an earlier batch: a backend that leaves one standing is found out.
    let stale = Hit { t: -7.0, triangle: 0xdead, u: 7.0, v: 7.0 };
    let mut hits = vec![stale; rays.len()];
    accelerator.closest_hits(rays, &mut hits, options).expect("equal lengths");
    hits
}

fn any(accelerator: &dyn Accelerator, rays: &[Ray], options: &QueryOptions<'_>) -> Vec<bool> {
    let mut first = vec![false; rays.len()];
    let mut second = vec![true; rays.len()];
    accelerator.any_hits(rays, &mut first, options).expect("equal lengths");
    accelerator.any_hits(rays, &mut second, options).expect("equal lengths");
    assert_eq!(first, second, "an answer of any hit was not written");
    first
}

fn all_bits(hits: &[Hit]) -> Vec<[u32; 4]> {
    hits.iter().map(bits).collect()
}

/// Verdicts of a batch.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    rays: usize,
    hits: usize,
    same_distance: usize,
    rounding: usize,
}

impl Counts {
    fn add(&mut self, other: Counts) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.same_distance += other.same_distance;
        self.rounding += other.rounding;
    }
}

/// Judges every ray, and checks that any hit agrees with closest hit.
fn judge(
    scene: &Scene,
    oracle: &Oracle,
    accelerator: &dyn Accelerator,
    rays: &[Ray],
    options: &QueryOptions<'_>,
    what: &str,
) -> Counts {
    let mesh = scene.mesh();
    let judge = Judge::new(&mesh, oracle);
    let hits = closest(accelerator, rays, options);
    let occluded = any(accelerator, rays, options);
    for ((ray, hit), occluded) in rays.iter().zip(&hits).zip(&occluded) {
        assert_eq!(
            hit.is_hit(),
            *occluded,
            "{}, {what}: any hit disagrees with closest hit {hit:?} of {ray:?}",
            scene.name
        );
        if !hit.is_hit() {
            assert_eq!(bits(hit), bits(&Hit::MISS), "{}: a miss is not Hit::MISS", scene.name);
        }
    }
    let verdicts: Vec<_> = rays
        .par_iter()
        .zip(&hits)
        .map(|(ray, hit)| judge.closest(ray, options, hit.some()))
        .collect();
    let wrong: Vec<&String> = verdicts.iter().filter_map(|v| v.as_ref().err()).collect();
    assert!(
        wrong.is_empty(),
        "{}, {what}: {} of {} rays are wrong; the first: {}",
        scene.name,
        wrong.len(),
        rays.len(),
        wrong[0]
    );
    let count = |which| verdicts.iter().filter(|v| **v == Ok(which)).count();
    Counts {
        rays: rays.len(),
        hits: hits.iter().filter(|hit| hit.is_hit()).count(),
        same_distance: count(Verdict::SameDistance),
        rounding: count(Verdict::Rounding),
    }
}

/// (a) and (f): closest and any hit equal the oracle on every awkward scene.
fn agrees_with_the_oracle(backend: &dyn Backend, effort: Effort) {
    let mut ordinary = Counts::default();
    for scene in scenes::awkward() {
        let mesh = scene.mesh();
        let oracle = Oracle::new(&mesh);
        let accelerator = build(backend, &scene);
        let options = QueryOptions::default();
        // Where every ray meets 20,000 triangles at once, or every test takes the slow way, a few
        // rays already try the same thing again and again.
        let share = match scene.name.as_str() {
            "identical triangles" | "fan" => 25,
            "spike" => 5,
            _ => 1,
        };
        let count = effort.rays(25, 500) / share;
        for (i, kind) in Kind::ALL.into_iter().enumerate() {
            let rays = aim::rays(&mesh, kind, count, 100 + i as u64);
            let counts =
                judge(&scene, &oracle, &*accelerator, &rays, &options, &format!("{kind:?}"));
            let unaimed = matches!(kind, Kind::Random | Kind::Faces);
            if unaimed && (scene.name.contains("soup,") || scene.name.contains("random")) {
                ordinary.add(counts);
            }
            let odd = aim::odd(&rays, 200 + i as u64);
            judge(&scene, &oracle, &*accelerator, &odd, &options, &format!("odd {kind:?}"));
        }
        let tree = accelerator.tree().view();
        let mut aim = aim::Aim::new(&mesh, 300);
        let rays: Vec<Ray> = (0..count).map(|_| aim.in_split_plane(&tree)).collect();
        judge(&scene, &oracle, &*accelerator, &rays, &options, "in split planes");
    }
    // Excuses must stay rare where nothing provokes them, or the judge would excuse anything.
    let excused = ordinary.rounding + ordinary.same_distance;
    assert!(ordinary.hits * 4 > ordinary.rays, "{ordinary:?}");
    assert!(excused * 500 <= ordinary.rays, "too much is put down to rounding: {ordinary:?}");
}

/// The same on real scenes, where they are present.
fn agrees_on_real_scenes(backend: &dyn Backend, effort: Effort) {
    let names: &[&str] = match effort {
        Effort::Small => &["horse"],
        Effort::Full if long() => {
            &["horse", "bunny", "kitchen", "robots", "stadium", "dragon", "sponza", "bathroom"]
        }
        Effort::Full => &["bunny", "kitchen", "stadium", "sponza"],
    };
    for scene in names.iter().filter_map(|name| scenes::real(name)) {
        let mesh = scene.mesh();
        let oracle = Oracle::new(&mesh);
        let accelerator = build(backend, &scene);
        for (i, kind) in Kind::ALL.into_iter().enumerate() {
            let rays = aim::rays(&mesh, kind, effort.rays(20, 1000), 400 + i as u64);
            let options = QueryOptions::default();
            judge(&scene, &oracle, &*accelerator, &rays, &options, &format!("{kind:?}"));
        }
    }
}

/// (b): no ray from inside a closed surface gets out.
fn closed_surfaces_are_watertight(backend: &dyn Backend, effort: Effort) {
    let rings = if effort == Effort::Full { scenes::LARGE_SPHERE } else { 20 };
    let far = [148_376.0, 1234.0, -223_423.0];
    let spheres = [
        (scenes::sphere(rings, [0.0; 3], 2.0), [0.0; 3], 1.0),
        (scenes::sphere(rings, [1e3; 3], 2.0), [1e3; 3], 1.0),
        (scenes::sphere(rings, far, 2.0), far, 1.0),
        // The same place with a sphere whose triangles are large against the spacing of floats.
        (scenes::sphere(rings, far, 2e4), far, 1e4),
        (scenes::nested_spheres(), [0.25, -0.5, 0.125], 1.0),
        (scenes::seams(false), [0.0; 3], 0.5),
        (scenes::seams(true), [3.3, -1.7, 0.9], 0.5),
    ];
    for (scene, centre, radius) in spheres {
        let mesh = scene.mesh();
        let accelerator = build(backend, &scene);
        for kind in [Kind::Random, Kind::Edges, Kind::Vertices] {
            let count = effort.rays(1_000, 20_000);
            let rays = aim::from_inside(&mesh, centre, radius, kind, count, 500);
            assert_none_lost(&scene, &*accelerator, &rays, &format!("{kind:?} about {centre:?}"));
        }
    }
}

fn assert_none_lost(scene: &Scene, accelerator: &dyn Accelerator, rays: &[Ray], what: &str) {
    let options = QueryOptions::default();
    let hits = closest(accelerator, rays, &options);
    let lost = hits.iter().filter(|hit| !hit.is_hit()).count();
    let first = hits.iter().position(|hit| !hit.is_hit()).map(|i| rays[i]);
    assert_eq!(lost, 0, "{}, {what}: {lost} of {} rays lost: {first:?}", scene.name, rays.len());
    let open = any(accelerator, rays, &options).iter().filter(|hit| !**hit).count();
    assert_eq!(open, 0, "{}, {what}: any hit loses {open} rays", scene.name);
}

/// (b): rays aimed at the T-junctions themselves, where only a collinear sliver closes the seam.
fn seams_are_watertight(backend: &dyn Backend, effort: Effort) {
    for (oblique, centre) in [(false, [0.0f64; 3]), (true, [3.3, -1.7, 0.9])] {
        let scene = scenes::seams(oblique);
        let accelerator = build(backend, &scene);
        let mut random = Random::new(600);
        let rays: Vec<Ray> = (0..effort.rays(2_000, 100_000))
            .map(|_| {
                let [a, b] = random.pick(&scenes::seam_edges(oblique));
                let s = random.unit();
                let target = [0, 1, 2].map(|i| f64::from(a[i]) * (1.0 - s) + f64::from(b[i]) * s);
                let d = random.direction();
                let origin = [0, 1, 2].map(|i| (centre[i] + 0.5 * d[i]) as f32);
                aim::aimed(origin, target)
            })
            .collect();
        assert_none_lost(&scene, &*accelerator, &rays, "aimed at seams");
    }
}

/// (c): of triangles at the same distance the lowest index wins.
fn the_lower_index_wins(backend: &dyn Backend, effort: Effort) {
    let twice = |scene: Scene| scene.joined(&scene.clone(), &format!("{}, twice", scene.name));
    for scene in [
        twice(scenes::soup(400, 0.2, 81)),
        twice(scenes::sphere(16, [3.0, 2.0, 1.0], 1.0)),
        twice(scenes::grid_boxes(3)),
        twice(scenes::coplanar(1, 100)),
        scenes::identical(300),
    ] {
        let mesh = scene.mesh();
        let accelerator = build(backend, &scene);
        let first_half = if scene.name.contains("twice") { mesh.len() as u32 / 2 } else { 1 };
        let mut hits_seen = 0;
        for kind in Kind::ALL {
            let rays = aim::rays(&mesh, kind, effort.rays(60, 1_000), 700);
            for (ray, hit) in rays.iter().zip(closest(&*accelerator, &rays, &Default::default())) {
                if hit.is_hit() {
                    hits_seen += 1;
                    assert!(
                        hit.triangle < first_half,
                        "{}: {ray:?} hits {}, not its twin",
                        scene.name,
                        hit.triangle
                    );
                }
            }
        }
        assert!(hits_seen > 20, "{}: only {hits_seen} hits", scene.name);
    }
}

/// Scenes for the checks that compare a backend with itself.
fn mixed_scenes() -> Vec<Scene> {
    vec![
        scenes::soup(500, 0.2, 91),
        scenes::nested_spheres(),
        scenes::grid_boxes(4),
        scenes::seams(true),
        scenes::needles(200),
        scenes::ratio(),
        scenes::scaled(&scenes::soup(100, 0.3, 92), 1e-30, "soup at 1e-30"),
        scenes::scaled(&scenes::soup(100, 0.3, 93), 1e30, "soup at 1e30"),
    ]
}

fn mixed_rays(scene: &Scene, each: usize, seed: u64) -> Vec<Ray> {
    Kind::ALL.iter().flat_map(|&kind| aim::rays(&scene.mesh(), kind, each, seed)).collect()
}

/// (d): both ends of the interval belong to it, and nothing beyond does.
fn the_interval_is_closed(backend: &dyn Backend, effort: Effort) {
    for scene in mixed_scenes() {
        let accelerator = build(backend, &scene);
        let options = QueryOptions::default();
        let rays: Vec<Ray> = mixed_rays(&scene, effort.rays(20, 300), 1)
            .iter()
            .map(|ray| ray.with_limits(f32::NEG_INFINITY, f32::INFINITY))
            .collect();
        let hits = closest(&*accelerator, &rays, &options);
        let found: Vec<(Ray, Hit)> =
            rays.into_iter().zip(hits).filter(|(_, hit)| hit.is_hit()).collect();
        assert!(found.len() > 20, "{}: only {} hits", scene.name, found.len());
        let ask = |limits: &dyn Fn(f32) -> (f32, f32)| {
            let rays: Vec<Ray> = found
                .iter()
                .map(|(ray, hit)| {
                    let (low, high) = limits(hit.t);
                    ray.with_limits(low, high)
                })
                .collect();
            let any = any(&*accelerator, &rays, &options);
            (closest(&*accelerator, &rays, &options), any)
        };
        let limits: [&dyn Fn(f32) -> (f32, f32); 3] =
            [&|t| (t, t), &|t| (t, f32::INFINITY), &|t| (f32::NEG_INFINITY, t)];
        for (which, limits) in limits.iter().enumerate() {
            let (hits, any) = ask(limits);
            for ((ray, hit), (again, any)) in found.iter().zip(hits.iter().zip(any)) {
                let name = &scene.name;
                assert_eq!(bits(again), bits(hit), "{name}: limits {which} at the hit of {ray:?}");
                assert!(any, "{name}: any hit with limits {which} at {hit:?} of {ray:?}");
            }
        }
        let (before, any) = ask(&|t| (f32::NEG_INFINITY, t.next_down()));
        for ((ray, hit), (again, any)) in found.iter().zip(before.iter().zip(any)) {
            assert!(
                !again.is_hit() && !any,
                "{}: {again:?} before the closest hit {hit:?} of {ray:?}",
                scene.name
            );
        }
        let (after, _) = ask(&|t| (t.next_up(), f32::INFINITY));
        for ((ray, hit), again) in found.iter().zip(after) {
            assert!(again.t > hit.t, "{}: {again:?} after {hit:?} of {ray:?}", scene.name);
        }
    }
}

/// (e): culling and ignoring, judged by the oracle; together with duplicates.
fn culling_and_ignoring(backend: &dyn Backend, effort: Effort) {
    for scene in [
        scenes::soup(300, 0.3, 95),
        scenes::nested_spheres(),
        scenes::grid_boxes(3),
        scenes::identical(100),
        scenes::coplanar_oblique(100),
    ] {
        let mesh = scene.mesh();
        let oracle = Oracle::new(&mesh);
        let accelerator = build(backend, &scene);
        let rays = mixed_rays(&scene, effort.rays(15, 200), 2);
        let mut differ = 0;
        let plain = closest(&*accelerator, &rays, &QueryOptions::default());
        for culling in [Culling::Back, Culling::Front] {
            let options = QueryOptions { culling, ..Default::default() };
            judge(&scene, &oracle, &*accelerator, &rays, &options, "culling");
            let culled = closest(&*accelerator, &rays, &options);
            differ += culled.iter().zip(&plain).filter(|(a, b)| bits(a) != bits(b)).count();
        }
        assert!(differ > 10, "{}: culling changed only {differ} answers", scene.name);
        for hit in plain.iter().filter(|hit| hit.is_hit()).take(20) {
            for culling in [Culling::None, Culling::Back] {
                let ignore = Some(hit.triangle);
                let options = QueryOptions { culling, ignore, ..Default::default() };
                judge(&scene, &oracle, &*accelerator, &rays[..64], &options, "ignoring");
            }
        }
        for (ray, hit) in rays.iter().zip(&plain).filter(|(_, hit)| hit.is_hit()).take(500) {
            let options = QueryOptions { ignore: Some(hit.triangle), ..Default::default() };
            let next = accelerator.closest_hit(ray, &options);
            assert!(
                next.is_none_or(|next| hit.precedes(&next)),
                "{}: without {hit:?} comes {next:?}, for {ray:?}",
                scene.name
            );
            assert_eq!(next.is_some(), accelerator.any_hit(ray, &options), "{}", scene.name);
        }
    }
}

/// (g): the answer to a ray does not depend on its batch, its place, or the threads.
fn batches_equal_single_rays(backend: &dyn Backend, effort: Effort) {
    let all_options = [
        QueryOptions::default(),
        QueryOptions { accuracy: Accuracy::Fast, ..Default::default() },
        QueryOptions { culling: Culling::Back, ignore: Some(3), ..Default::default() },
    ];
    for (scene, options) in
        mixed_scenes().iter().flat_map(|scene| all_options.map(|options| (scene, options)))
    {
        let accelerator = build(backend, scene);
        let mut random = Random::new(3);
        let mut rays = mixed_rays(scene, effort.rays(20, 300), 3);
        rays.extend(aim::invalid(&rays[..40], 4));
        rays.extend(aim::odd(&rays[..200.min(rays.len())], 5));
        random.shuffle(&mut rays);
        let single: Vec<Hit> = rays
            .iter()
            .map(|ray| accelerator.closest_hit(ray, &options).unwrap_or(Hit::MISS))
            .collect();
        let single_any: Vec<bool> =
            rays.iter().map(|ray| accelerator.any_hit(ray, &options)).collect();
        for size in [0, 1, 2, 15, 16, 17, 1000, rays.len()] {
            let size = size.min(rays.len());
            let start = random.below(rays.len() - size + 1);
            let part = start..start + size;
            let hits = closest(&*accelerator, &rays[part.clone()], &options);
            for ((ray, hit), single) in rays[part.clone()].iter().zip(&hits).zip(&single[start..]) {
                assert_eq!(
                    bits(hit),
                    bits(single),
                    "{}: {hit:?} in a batch of {size}, alone {single:?}, for {ray:?}, {options:?}",
                    scene.name
                );
            }
            let occluded = any(&*accelerator, &rays[part.clone()], &options);
            assert_eq!(occluded, single_any[part], "{}: any hit, batch of {size}", scene.name);
        }
        let mut order: Vec<usize> = (0..rays.len()).collect();
        random.shuffle(&mut order);
        let shuffled: Vec<Ray> = order.iter().map(|&i| rays[i]).collect();
        for threads in [1, 2, 3, 8] {
            let pool =
                rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let hits = pool.install(|| closest(&*accelerator, &shuffled, &options));
            for (&i, hit) in order.iter().zip(&hits) {
                assert_eq!(
                    bits(hit),
                    bits(&single[i]),
                    "{}: in another place on {threads} threads: {:?}, {options:?}",
                    scene.name,
                    rays[i]
                );
            }
        }
    }
}

/// Results of another length than the rays are refused.
fn lengths_must_be_equal(backend: &dyn Backend, _: Effort) {
    let accelerator = build(backend, &scenes::one());
    let rays = [Ray::new([0.0; 3], [1.0; 3]); 3];
    let error = QueryError::LengthMismatch { rays: 3, results: 2 };
    let options = QueryOptions::default();
    assert_eq!(accelerator.closest_hits(&rays, &mut [Hit::MISS; 2], &options), Err(error.clone()));
    assert_eq!(accelerator.any_hits(&rays, &mut [false; 2], &options), Err(error));
}

/// (h): rays that hit nothing by definition.
fn invalid_rays_miss(backend: &dyn Backend, effort: Effort) {
    for scene in [scenes::soup(300, 0.5, 97), scenes::nested_spheres(), scenes::none()] {
        let accelerator = build(backend, &scene);
        let good = mixed_rays(&scene, effort.rays(20, 200), 6);
        let rays = aim::invalid(&good, 7);
        let options = QueryOptions::default();
        for (ray, hit) in rays.iter().zip(closest(&*accelerator, &rays, &options)) {
            assert_eq!(bits(&hit), bits(&Hit::MISS), "{}: {ray:?}", scene.name);
            assert_eq!(accelerator.closest_hit(ray, &options), None, "{}: {ray:?}", scene.name);
        }
        assert!(any(&*accelerator, &rays, &options).iter().all(|hit| !hit), "{}", scene.name);
        let backwards: Vec<Ray> = good.iter().map(|ray| ray.with_limits(1.0, 0.5)).collect();
        for (ray, hit) in backwards.iter().zip(closest(&*accelerator, &backwards, &options)) {
            assert!(!hit.is_hit(), "{}: t_min > t_max, {ray:?}", scene.name);
        }
    }
}

/// (j): scaling by a power of two scales the distances and changes nothing else. The tracer's
/// absolute thresholds (edge values below 2^-98, extents below 2^-40, coordinates above 2^38) are out
/// of reach for these factors; beyond them other code runs, and the oracle judges.
fn scaling_by_powers_of_two(backend: &dyn Backend, effort: Effort) {
    for scene in [
        scenes::soup(400, 0.2, 98),
        scenes::nested_spheres(),
        scenes::seams(true),
        scenes::grid_boxes(3),
    ] {
        let rays = mixed_rays(&scene, effort.rays(15, 200), 8);
        let options = QueryOptions::default();
        let base = closest(&*build(backend, &scene), &rays, &options);
        for exponent in [-60, -40, -17, -10, -1, 3, 24, 30, 40, 60] {
            let factor = f32::powi(2.0, exponent);
            let larger = scenes::scaled(&scene, factor, &scene.name);
            let accelerator = build(backend, &larger);
            let scaled: Vec<Ray> = rays
                .iter()
                .map(|ray| Ray { origin: ray.origin.map(|x| x * factor), ..*ray })
                .collect();
            if !(-20..=30).contains(&exponent) {
                let mesh = larger.mesh();
                let what = format!("times 2^{exponent}");
                judge(&larger, &Oracle::new(&mesh), &*accelerator, &scaled, &options, &what);
                continue;
            }
            for (i, hit) in closest(&*accelerator, &scaled, &options).iter().enumerate() {
                let expected = Hit { t: base[i].t * factor, ..base[i] };
                assert_eq!(
                    bits(hit),
                    bits(&expected),
                    "{} times 2^{exponent}: {hit:?}, not {expected:?}, for {:?}",
                    scene.name,
                    rays[i]
                );
            }
        }
    }
}

/// The hits do not depend on the shape of the tree.
fn hits_do_not_depend_on_the_configuration(backend: &dyn Backend, effort: Effort) {
    let default = BuildConfig::default();
    let configs = [
        BuildConfig { max_depth: 1, ..default },
        BuildConfig { max_depth: 12, ..default }.with_stages(|stages| stages.small_node_limit = 8),
        BuildConfig { traversal_cost: 3, intersection_cost: 2, block_width: 1, ..default },
        BuildConfig { traversal_cost: 1, intersection_cost: 10, block_width: 1, ..default },
        default.with_stages(|stages| {
            stages.small_node_limit = 1;
            stages.empty_cutoff = 16;
        }),
        BuildConfig { references_per_triangle: 1, ..default }
            .with_stages(|stages| stages.nodes_per_triangle = 1),
    ];
    for scene in mixed_scenes() {
        let rays = mixed_rays(&scene, effort.rays(20, 400), 9);
        let options = QueryOptions::default();
        let base = closest(&*build(backend, &scene), &rays, &options);
        for config in configs {
            let accelerator = backend.build(&scene.mesh(), &config.into()).expect("a tree");
            for (i, hit) in closest(&*accelerator, &rays, &options).iter().enumerate() {
                assert_eq!(
                    bits(hit),
                    bits(&base[i]),
                    "{} with {config:?}: {hit:?}, not {:?}, for {:?}",
                    scene.name,
                    base[i],
                    rays[i]
                );
            }
        }
    }
}

/// A tree loaded over its mesh answers as the build that made it.
fn loaded_trees_answer_alike(backend: &dyn Backend, effort: Effort) {
    for scene in mixed_scenes() {
        let mesh = scene.mesh();
        let built = build(backend, &scene);
        let loaded = backend
            .load(&mesh, built.tree().clone(), &LoadOptions::default())
            .unwrap_or_else(|error| panic!("{}: {error}", scene.name));
        let rays = mixed_rays(&scene, effort.rays(10, 100), 10);
        let options = QueryOptions::default();
        assert_eq!(
            all_bits(&closest(&*loaded, &rays, &options)),
            all_bits(&closest(&*built, &rays, &options)),
            "{}",
            scene.name
        );
        assert_eq!(loaded.tree().digest(), built.tree().digest(), "{}", scene.name);
    }
    let tree = build(backend, &scenes::soup(100, 0.2, 1)).tree().clone();
    let other = scenes::soup(90, 0.2, 1);
    let refused = backend.load(&other.mesh(), tree, &LoadOptions::default());
    assert!(matches!(refused, Err(BuildError::WrongMesh { .. })), "a tree of another mesh loads");
}

/// A coordinate that provokes ties, cancellation, underflow and overflow.
fn nasty_coordinate() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => proptest::sample::select(vec![0.0, 1.0, -1.0, 0.5, 2.0]),
        3 => (-8i8..=8).prop_map(|x| f32::from(x) * 0.25),
        1 => proptest::sample::select(vec![
            9.536_743e-7, -9.536_743e-7, 1e-30, -1e-30, 1e30, -1e30, -0.0, 1e-40, 0.1, 16_777_216.0,
        ]),
    ]
}

fn nasty_point() -> impl Strategy<Value = [f32; 3]> {
    proptest::array::uniform3(nasty_coordinate())
}

/// (i): small scenes and rays from a nasty set, shrunk to the smallest that fails.
fn nasty_soups_agree_with_the_oracle(backend: &dyn Backend, effort: Effort) {
    let triangles = proptest::collection::vec(proptest::array::uniform3(nasty_point()), 0..12);
    // Closed surfaces, where no miss between neighbours is excused.
    let solids = proptest::collection::vec(proptest::array::uniform4(nasty_point()), 1..4);
    let soup = (triangles, solids).prop_map(|(mut soup, solids)| {
        for [a, b, c, d] in solids {
            soup.extend([[a, b, c], [a, c, d], [a, d, b], [b, d, c]]);
        }
        soup
    });
    // An origin, a triangle to aim at, and where: corners, middles of edges, or the middle.
    let rays = proptest::collection::vec(
        (nasty_point(), proptest::arbitrary::any::<proptest::sample::Index>(), 0usize..7),
        1..8,
    );
    let config = proptest::test_runner::Config {
        cases: effort.rays(200, 4_000) as u32,
        rng_seed: RngSeed::Fixed(11),
        failure_persistence: None,
        ..Default::default()
    };
    let outcome = TestRunner::new(config).run(&(soup, rays), |(soup, rays)| {
        let scene = Scene {
            name: "nasty soup".into(),
            positions: soup.as_flattened().to_vec(),
            indices: None,
        };
        let mesh = scene.mesh();
        let oracle = Oracle::new(&mesh);
        let judge = Judge::new(&mesh, &oracle);
        let accelerator = build(backend, &scene);
        for (origin, triangle, place) in rays {
            let [a, b, c] = soup[triangle.index(soup.len())].map(|p| p.map(f64::from));
            let mean = |points: &[[f64; 3]]| {
                [0, 1, 2].map(|i| points.iter().map(|p| p[i]).sum::<f64>() / points.len() as f64)
            };
            let target = match place {
                0 => a,
                1 => b,
                2 => c,
                3 => mean(&[a, b]),
                4 => mean(&[b, c]),
                5 => mean(&[c, a]),
                _ => mean(&[a, b, c]),
            };
            let ray = aim::aimed(origin, target);
            let options = QueryOptions::default();
            let hit = accelerator.closest_hit(&ray, &options);
            if let Err(reason) = judge.closest(&ray, &options, hit) {
                return Err(TestCaseError::fail(reason));
            }
            prop_assert_eq!(accelerator.any_hit(&ray, &options), hit.is_some());
        }
        Ok(())
    });
    if let Err(error) = outcome {
        panic!("{error}");
    }
}

/// (i): arrays of random bits never panic, whatever they hold.
fn random_bits_never_panic(backend: &dyn Backend, effort: Effort) {
    let mut random = Random::new(12);
    for _ in 0..effort.rays(20, 300) {
        let count = random.below(200);
        let point = |random: &mut Random| [(); 3].map(|()| f32::from_bits(random.bits()));
        let scene = Scene {
            name: "random bits".into(),
            positions: (0..3 * count).map(|_| point(&mut random)).collect(),
            indices: None,
        };
        let accelerator = build(backend, &scene);
        let rays: Vec<Ray> = (0..100)
            .map(|_| {
                let limits = point(&mut random);
                Ray::new(point(&mut random), point(&mut random)).with_limits(limits[0], limits[1])
            })
            .collect();
        let accuracy = random.pick(&[Accuracy::Watertight, Accuracy::Fast]);
        let options = QueryOptions { accuracy, ..Default::default() };
        let hits = closest(&*accelerator, &rays, &options);
        for (ray, hit) in rays.iter().zip(hits).filter(|(_, hit)| hit.is_hit()) {
            assert!((hit.triangle as usize) < count, "{ray:?} gives {hit:?}");
            assert!(hit.t >= ray.t_min && hit.t <= ray.t_max, "{ray:?} gives {hit:?}");
        }
    }
}

macro_rules! on_every_backend {
    ($($check:ident),* $(,)?) => {
        mod cpu {
            use super::*;
            $(#[test] fn $check() { super::$check(&CpuBackend::new(), Effort::Full); })*
        }
        mod exact {
            use super::*;
            $(#[test] fn $check() { super::$check(&ExactBackend, Effort::Small); })*
        }
    };
}

on_every_backend! {
    agrees_with_the_oracle,
    agrees_on_real_scenes,
    closed_surfaces_are_watertight,
    seams_are_watertight,
    the_lower_index_wins,
    the_interval_is_closed,
    culling_and_ignoring,
    batches_equal_single_rays,
    lengths_must_be_equal,
    invalid_rays_miss,
    scaling_by_powers_of_two,
    hits_do_not_depend_on_the_configuration,
    loaded_trees_answer_alike,
    nasty_soups_agree_with_the_oracle,
    random_bits_never_panic,
}

/// Every check fails on a backend with the fault it is there for.
mod planted {
    use super::*;

    type Check = fn(&dyn Backend, Effort);

    fn must_fail(fault: Fault, check: Check) {
        let backend = FaultyBackend::new(ExactBackend, fault);
        let run = std::panic::AssertUnwindSafe(|| check(&backend, Effort::Small));
        assert!(std::panic::catch_unwind(run).is_err(), "{fault:?} goes unnoticed");
    }

    /// The textbook test leaks at edges, and every check that looks there sees it.
    #[test]
    fn moeller_and_trumbore() {
        let checks: [(&str, Check); 3] = [
            ("watertight", closed_surfaces_are_watertight),
            ("seams", seams_are_watertight),
            ("oracle", agrees_with_the_oracle),
        ];
        for (name, check) in checks {
            let run = || check(&LeakyBackend, Effort::Small);
            assert!(std::panic::catch_unwind(run).is_err(), "{name} does not see the leaks");
        }
    }

    macro_rules! faults {
        ($($name:ident: $fault:ident in $($check:ident),+;)*) => {
            $(#[test] fn $name() { $(must_fail(Fault::$fault, $check);)+ })*
        };
    }

    faults! {
        leak: Leak in agrees_with_the_oracle, closed_surfaces_are_watertight, seams_are_watertight,
            nasty_soups_agree_with_the_oracle;
        higher_index: HigherIndexWins in the_lower_index_wins;
        open_interval: OpenInterval in the_interval_is_closed;
        no_culling: NoCulling in culling_and_ignoring;
        no_ignore: NoIgnore in culling_and_ignoring;
        distance: WrongDistance in agrees_with_the_oracle;
        second_hit: SecondHit in agrees_with_the_oracle;
        phantom: Phantom in agrees_with_the_oracle;
        weights: WrongWeights in agrees_with_the_oracle;
        last_of_a_batch: ForgetsLast in batches_equal_single_rays;
        any_hit: AnyHitDisagrees in agrees_with_the_oracle;
        nan_limits: AcceptsNan in invalid_rays_miss;
    }
}
