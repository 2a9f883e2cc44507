//! Whichever request for memory the system refuses, the work ends in an error that says so, and
//! what was there before serves as before.
//!
//! On one thread each request is refused in turn, whatever its size: no request of a build, a load,
//! all hits or points is exempt but those aligned to 128 bytes: these are what the thread pool's
//! queues leave behind when they grow, which depends on what else the machine does, and nothing of
//! ours is aligned so. On several threads those of less than [`SHARED`] bytes are granted: they are
//! the thread pool's own, which has no way to say that it got none. Each of its queues takes 1 KiB
//! of jobs at first, what is handed to it from outside 1.5 KiB for 63 jobs, and what threads leave
//! to each other 2 KiB; all of that depends on the number of threads and of tasks within tasks, not
//! on the size of what is worked on.
//!
//! What a thread keeps for the rays it has under way is made by its first batch. Later batches are
//! shown to ask for nothing.

use std::fmt::Debug;
use std::sync::{Mutex, PoisonError};

use crate::counting::{Refuse, alone, pool};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, QueryLayout, locate_along};
use splitplane_core::config::Preset;
use splitplane_core::error::{BuildError, QueryError};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions};
use splitplane_core::query::inside;
use splitplane_core::query::inside::{DIRECTION, LocateOptions};
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::tree::file::TreeFile;
use splitplane_core::tree::{KdTree, file};
use splitplane_core::watch::Watch;
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_test_support::aim;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_test_support::watch::goes_on;

/// Bytes that a thread pool asks for at most at a time.
const SHARED: usize = 4 << 10;

const PRESETS: [Preset; 3] = [Preset::Fast, Preset::Balanced, Preset::Best];
const LAYOUTS: [QueryLayout; 2] = [QueryLayout::Fast, QueryLayout::Compact];
const ACCURACIES: [Accuracy; 3] = [Accuracy::Watertight, Accuracy::Fast, Accuracy::Exact];

/// Errors of work for which there is no memory.
trait Error: Debug {
    /// Whether that is what it says.
    fn is_refusal(&self) -> bool;
}

impl Error for BuildError {
    fn is_refusal(&self) -> bool {
        let same = matches!(self, BuildError::OutOfMemory { needed, limit } if needed == limit);
        same && self.to_string().contains("the system has no more memory for the build")
    }
}

impl Error for QueryError {
    fn is_refusal(&self) -> bool {
        let same = matches!(self, QueryError::OutOfMemory { needed, limit } if needed == limit);
        same && self.to_string().contains("the system has no more memory for the answers")
    }
}

/// Does some work with its first request refused, its second and so on, alone or with all that
/// follow, until there are no more: each time it ends in an error, or gives the usual result. Then
/// it checks that everything is unchanged. Returns how many requests there are.
fn refusals<T, E: Error>(
    what: &str,
    threads: usize,
    least: usize,
    work: impl Fn(&Refuse) -> Result<T, E> + Sync,
    is_right: impl Fn(&T) -> bool + Sync,
    is_unchanged: impl Fn() -> bool + Sync,
) -> i64 {
    let pool = pool(threads);
    pool.install(|| {
        let (mut most, mut last, mut errors) = (0, 0, 0);
        for once in [true, false] {
            for number in 0.. {
                let refuse = Refuse { number, once, least };
                let out = work(&refuse);
                let was_refused = Refuse::was_refused();
                match &out {
                    // Where it did without, or tried again.
                    Ok(out) => assert!(is_right(out), "{what}: {refuse:?}"),
                    Err(error) => {
                        assert!(was_refused && error.is_refusal(), "{what}: {refuse:?}: {error:?}");
                        errors += 1;
                    }
                }
                drop(out);
                assert!(is_unchanged(), "{what}: {refuse:?}");
                (most, last) = (most.max(number), number);
                if !was_refused {
                    break;
                }
            }
        }
        // How many requests there are depends on what a backend keeps from the work before, which
        // refusals change.
        assert!(
            errors >= last,
            "{what}: {errors} errors of {last} requests refused with all that follow"
        );
        most
    })
}

const LIMITS: LocateOptions<'_> = LocateOptions { max_memory: None, watch: None };

fn options(preset: Preset, layout: QueryLayout) -> BuildOptions<'static> {
    BuildOptions { layout, ..BuildOptions::from(preset.config()) }
}

fn hits(built: &dyn Accelerator, rays: &[Ray]) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    built.closest_hits(rays, &mut hits, &QueryOptions::default()).expect("equal lengths");
    hits
}

fn some_rays(mesh: &Mesh<'_>) -> Vec<Ray> {
    aim::rays(mesh, aim::Kind::ALL[0], 200, 3)
}

/// What a scene's tree and its hits are.
struct Expected {
    tree: KdTree,
    rays: Vec<Ray>,
    hits: Vec<Hit>,
}

impl Expected {
    fn of(scene: &Scene, options: &BuildOptions<'_>) -> Expected {
        let built = CpuBackend::new().build(&scene.mesh(), options).expect("memory");
        let rays = some_rays(&scene.mesh());
        let hits = hits(&*built, &rays);
        Expected { tree: built.tree().clone(), rays, hits }
    }

    fn is(&self, built: &dyn Accelerator) -> bool {
        *built.tree() == self.tree && hits(built, &self.rays) == self.hits
    }
}

/// A few tasks of the builder, and a node of many triangles that nothing separates.
fn small() -> Scene {
    scenes::soup(1_500, 0.1, 5).joined(&scenes::identical(300), "small")
}

/// Every request of a build, on one thread.
#[test]
fn builds_say_so() {
    let _alone = alone();
    let other = scenes::sphere(8, [0.0; 3], 1.0);
    // For preset best: nodes that are divided among tasks, and one that is a leaf above them all.
    let [soup, same] = [scenes::soup(9_000, 0.02, 3), scenes::identical(9_000)];
    let scenes = [small(), soup, same, scenes::none(), scenes::giants()];
    for scene in &scenes {
        let mesh = scene.mesh();
        for (preset, layout) in PRESETS.into_iter().flat_map(|p| LAYOUTS.map(|layout| (p, layout)))
        {
            // With one cap on references that binds, so that the schedule itself builds the tree.
            for references_per_triangle in [1, 8] {
                let mut options = options(preset, layout);
                options.config.references_per_triangle = references_per_triangle;
                let few = mesh.len() < 2_000;
                if !few && (layout == QueryLayout::Compact || preset != Preset::Best)
                    || preset == Preset::Best && references_per_triangle == 1
                {
                    continue;
                }
                let what = format!("{}, {preset:?}, {layout:?}", scene.name);
                let expected = Expected::of(scene, &options);
                let requests = refusals(
                    &what,
                    1,
                    1,
                    |refuse| {
                        let backend = CpuBackend::new();
                        let built = refuse.during(|| backend.build(&mesh, &options));
                        if few && built.is_err() {
                            // The backend serves as before.
                            let again = backend.build(&mesh, &options).expect("memory");
                            assert!(expected.is(&*again), "{what}: {refuse:?}");
                        }
                        built
                    },
                    |built| expected.is(&**built),
                    || true,
                );
                assert!(requests > if mesh.is_empty() { 5 } else { 30 }, "{what}: {requests}");
                // A backend that has built before, which frees the memory that it kept and tries
                // again.
                if few && layout == QueryLayout::Fast {
                    let backend = Mutex::new(CpuBackend::new());
                    refusals(
                        &what,
                        1,
                        1,
                        |refuse| {
                            let backend = backend.lock().unwrap_or_else(PoisonError::into_inner);
                            drop(backend.build(&other.mesh(), &options).expect("memory"));
                            refuse.during(|| backend.build_tree(&mesh, &options))
                        },
                        |(tree, _)| *tree == expected.tree,
                        || true,
                    );
                }
            }
        }
    }
}

/// A mesh of forty thousand triangles, on one thread and on two.
#[test]
fn large_builds_say_so() {
    let _alone = alone();
    let scene = scenes::soup(40_000, 0.01, 5);
    let mesh = scene.mesh();
    for preset in PRESETS {
        let layout = if preset == Preset::Balanced { LAYOUTS[1] } else { LAYOUTS[0] };
        let options = options(preset, layout);
        let expected = Expected::of(&scene, &options);
        for threads in [1, 2] {
            let what = format!("{preset:?}, {layout:?}, {threads} threads");
            let requests = refusals(
                &what,
                threads,
                // Of 16 KiB at least, or it takes minutes: what asks for less asks for more as
                // well.
                4 * SHARED,
                |refuse| {
                    let backend = CpuBackend::new();
                    refuse.during(|| backend.build(&mesh, &options))
                },
                |built| expected.is(&**built),
                || true,
            );
            assert!(requests > 30, "{what}: {requests}");
        }
    }
}

#[test]
fn rebuilds_say_so_and_change_nothing() {
    let _alone = alone();
    let (before, after) = (scenes::sphere(12, [0.0; 3], 1.0), small());
    for preset in PRESETS {
        for (from, to) in LAYOUTS.into_iter().flat_map(|from| LAYOUTS.map(|to| (from, to))) {
            let [first, second] = [from, to].map(|layout| options(preset, layout));
            let (old, new) = (Expected::of(&before, &first), Expected::of(&after, &second));
            // Where it is watched the layout is made in new memory.
            for is_watched in if from == to { &[false, true][..] } else { &[false] } {
                let what = format!("{preset:?}, {from:?} to {to:?}, watched: {is_watched}");
                let backend = CpuBackend::new();
                let kept: Mutex<CpuAccelerator> =
                    Mutex::new(backend.build_accelerator(&before.mesh(), &first).expect("memory"));
                let lock = || kept.lock().unwrap_or_else(PoisonError::into_inner);
                let requests = refusals(
                    &what,
                    1,
                    1,
                    |refuse| {
                        let mut kept = lock();
                        let backend = CpuBackend::new();
                        let mesh = after.mesh();
                        let watch: Option<&dyn Watch> =
                            if *is_watched { Some(&goes_on) } else { None };
                        let second = BuildOptions { watch, ..second };
                        refuse.during(|| backend.rebuild_accelerator(&mut kept, &mesh, &second))?;
                        assert!(new.is(&*kept), "{what}: {refuse:?}");
                        *kept = backend.build_accelerator(&before.mesh(), &first).expect("memory");
                        Ok::<_, BuildError>(())
                    },
                    |()| true,
                    || lock().layout() == from && old.is(&*lock()),
                );
                assert!(requests > 30, "{what}: {requests}");
            }
        }
    }
}

/// A tree from memory, and one from a file.
#[test]
fn loads_say_so() {
    let _alone = alone();
    let (few, many) = (small(), scenes::soup(40_000, 0.01, 5));
    for (scene, threads, least) in [(&few, 1, 1), (&many, 1, 1), (&many, 2, SHARED)] {
        let mesh = scene.mesh();
        for layout in LAYOUTS {
            let options = options(Preset::Fast, layout);
            let expected = Expected::of(scene, &options);
            let bytes = file::write(&expected.tree.view(), &mesh).expect("memory");
            let mut words = vec![0u32; bytes.len() / 4];
            bytemuck::cast_slice_mut(&mut words).copy_from_slice(&bytes);
            let what = format!("{}, {layout:?}, {threads} threads", scene.name);
            let requests = refusals(
                &what,
                threads,
                least,
                |refuse| {
                    let (backend, tree) = (CpuBackend::new(), expected.tree.clone());
                    refuse.during(|| backend.load(&mesh, tree, &options.for_loading()))
                },
                |loaded| expected.is(&**loaded),
                || true,
            );
            // Branches, wide nodes, triangles, and blocks or a copy of the mesh.
            assert!(requests > 3, "{what}: {requests}");
            let of_file = refusals(
                &what,
                threads,
                least,
                |refuse| {
                    let backend = CpuBackend::new();
                    refuse.during(|| {
                        let file = TreeFile::parse(bytemuck::cast_slice(&words)).expect("a tree");
                        backend.load(&mesh, file.tree.to_tree()?, &options.for_loading())
                    })
                },
                |loaded| expected.is(&**loaded),
                || true,
            );
            assert_eq!(of_file, requests + 2, "nodes and references: {what}");
        }
    }
}

/// Rays through all of some identical triangles and beside them, from points apart from them.
fn through(scene: &Scene, direction: [f32; 3], count: usize) -> Vec<Ray> {
    let [a, b, c] = scene.mesh().triangle(0);
    let along = |i: usize, far: f32| (a[i] + b[i] + c[i]) / 3.0 - far * direction[i];
    let far = |ray: usize| 3.0 + ray as f32 / 256.0;
    (0..count).map(|ray| Ray::new([0, 1, 2].map(|i| along(i, far(ray))), direction)).collect()
}

/// All hits: of the CPU's accelerator, of the reference, and put together from slices as
/// accelerators do that know nothing better.
#[test]
fn all_hits_say_so() {
    let _alone = alone();
    let options = AllHitsOptions::default();
    let scenes = [small(), scenes::identical(2_000)];
    for (scene, layout) in scenes.iter().flat_map(|scene| LAYOUTS.map(|layout| (scene, layout))) {
        let built = CpuBackend::new()
            .build_accelerator(&scene.mesh(), &self::options(Preset::Fast, layout));
        let built = built.expect("memory");
        let (tree, triangles) = (built.tree().view(), scene.triangles());
        let mut rays = aim::rays(&scene.mesh(), aim::Kind::ALL[0], 300, 6);
        rays.extend(through(scene, [0.25, 0.5, 1.0], 20));
        let expected = built.all_hits(&rays, &options).expect("memory");
        let is_right = |all: &AllHits| *all == expected;
        let is_unchanged = || built.all_hits(&rays[..9], &options).is_ok_and(|all| all.rays() == 9);
        for (threads, least) in [(1, 1), (2, SHARED)] {
            let what = format!("{}, {layout:?}, {threads} threads", scene.name);
            let work = |refuse: &Refuse| refuse.during(|| built.all_hits(&rays, &options));
            let requests = refusals(&what, threads, least, work, is_right, is_unchanged);
            let fewest = if threads == 1 { 20 } else { 1 };
            assert!(requests > fewest, "{what}: {requests}");
        }
        let work = |refuse: &Refuse| {
            refuse.during(|| AllHits::one_by_one(&tree, &triangles[..], &rays, &options))
        };
        let requests = refusals("one by one", 1, 1, work, is_right, is_unchanged);
        assert!(requests > 3, "{requests}");
        let (head, tail) = rays.split_at(100);
        let [head, tail] = [head, tail].map(|rays| built.all_hits(rays, &options).expect("memory"));
        let work = |refuse: &Refuse| {
            let (mut all, more) = (head.clone(), tail.clone());
            let added = refuse.during(|| all.append(more));
            assert!(added.is_ok() || all == head);
            added.map(|()| all)
        };
        assert_eq!(refusals("two parts", 1, 1, work, is_right, is_unchanged), 2);
    }
}

/// Points: as the CPU's accelerator finds them, as the reference does, and as all accelerators may.
#[test]
fn points_say_so() {
    let _alone = alone();
    let scenes = [scenes::sphere(20, [0.0; 3], 1.0), scenes::identical(2_000)];
    for (scene, layout) in scenes.iter().flat_map(|scene| LAYOUTS.map(|layout| (scene, layout))) {
        let built =
            CpuBackend::new().build_accelerator(&scene.mesh(), &options(Preset::Fast, layout));
        let built = built.expect("memory");
        let (tree, triangles) = (built.tree().view(), scene.triangles());
        let mut points: Vec<[f32; 3]> =
            (0..200).map(|i| [i as f32 / 80.0 - 1.2, 0.1, 0.2 - i as f32 / 300.0]).collect();
        points.extend(through(scene, DIRECTION, 4).iter().map(|ray| ray.origin));
        let expected = built.locate(&points, &LIMITS).expect("memory");
        let is_right = |located: &inside::Located| *located == expected;
        let is_unchanged = || built.locate(&points[..5], &LIMITS).is_ok();
        for (threads, least) in [(1, 1), (2, SHARED)] {
            let what = format!("{}, {layout:?}, {threads} threads", scene.name);
            let work = |refuse: &Refuse| refuse.during(|| built.locate(&points, &LIMITS));
            let requests = refusals(&what, threads, least, work, is_right, is_unchanged);
            assert!(threads == 2 || requests > 3, "{what}: {requests}");
        }
        let work = |refuse: &Refuse| {
            refuse.during(|| inside::one_by_one(&tree, &triangles[..], &points, &LIMITS))
        };
        assert!(refusals("one by one", 1, 1, work, is_right, is_unchanged) > 1);
        let few = &points[points.len() - 8..];
        let expected = built.locate(few, &LIMITS).expect("memory");
        // Its batches of any hits are not the first of their thread.
        let work = |refuse: &Refuse| {
            locate_along(&built, few, DIRECTION, &LIMITS).expect("memory");
            refuse.during(|| locate_along(&built, few, DIRECTION, &LIMITS))
        };
        let is_right = |located: &inside::Located| *located == expected;
        assert!(refusals("along a ray", 1, 1, work, is_right, is_unchanged) > 8);
    }
}

/// The first batch of a thread, which allocates the memory that the thread keeps, and one ray per
/// call, which needs none.
#[test]
fn first_batches_say_so() {
    let _alone = alone();
    let scene = small();
    let mesh = scene.mesh();
    let rays = aim::rays(&mesh, aim::Kind::ALL[0], 300, 6);
    for (layout, accuracy) in LAYOUTS.into_iter().flat_map(|l| ACCURACIES.map(|a| (l, a))) {
        let built = CpuBackend::new().build_accelerator(&mesh, &options(Preset::Fast, layout));
        let built = built.expect("memory");
        let options = QueryOptions { accuracy, ..QueryOptions::default() };
        let mut expected = vec![Hit::MISS; rays.len()];
        built.closest_hits(&rays, &mut expected, &options).expect("memory");
        let singly = |rays: &[Ray], hits: &mut [Hit]| {
            for (ray, hit) in rays.iter().zip(hits) {
                *hit = built.closest_hit(ray, &options).unwrap_or(Hit::MISS);
            }
        };
        for once in [true, false] {
            for number in 0.. {
                let refuse = Refuse { number, once, least: 1 };
                let what = format!("{layout:?}, {accuracy:?}, {refuse:?}");
                let (mut hits, mut any) = (vec![Hit::MISS; rays.len()], vec![false; rays.len()]);
                let new = pool(1);
                let closest = new
                    .install(|| refuse.during(|| built.closest_hits(&rays, &mut hits, &options)));
                let was_refused = Refuse::was_refused();
                let any_hit =
                    pool(1).install(|| refuse.during(|| built.any_hits(&rays, &mut any, &options)));
                assert_eq!(was_refused, Refuse::was_refused(), "{what}");
                let mut alone = vec![Hit::MISS; rays.len()];
                pool(1).install(|| refuse.during(|| singly(&rays, &mut alone)));
                assert!(alone == expected, "{what}");
                for error in [closest.err(), any_hit.err()] {
                    assert_eq!(error.is_some(), was_refused, "{what}");
                    assert!(error.is_none_or(|error| error.is_refusal()), "{what}");
                }
                // The thread serves as before.
                new.install(|| built.closest_hits(&rays, &mut hits, &options)).expect("memory");
                assert!(hits == expected, "{what}");
                if !was_refused {
                    assert_eq!(number, 7, "what a thread keeps: {what}");
                    break;
                }
            }
        }
    }
}

/// A thread that has traced rays through trees as deep asks for no memory any more.
#[test]
fn batches_ask_for_nothing_more() {
    let _alone = alone();
    let scene = small();
    let mesh = scene.mesh();
    let rays = aim::rays(&mesh, aim::Kind::ALL[0], 9_000, 6);
    let pool = pool(1);
    for (layout, accuracy) in
        LAYOUTS.into_iter().flat_map(|l| ACCURACIES.map(|accuracy| (l, accuracy)))
    {
        let built = CpuBackend::new().build_accelerator(&mesh, &options(Preset::Fast, layout));
        let built = built.expect("memory");
        let options = QueryOptions { accuracy, ..QueryOptions::default() };
        let trace = |hits: &mut [Hit], any: &mut [bool]| {
            built.closest_hits(&rays, hits, &options).expect("equal lengths");
            built.any_hits(&rays, any, &options).expect("equal lengths");
        };
        pool.install(|| {
            let (mut hits, mut any) = (vec![Hit::MISS; rays.len()], vec![false; rays.len()]);
            trace(&mut hits, &mut any);
            let expected = (hits.clone(), any.clone());
            hits.fill(Hit::MISS);
            any.fill(false);
            let refuse = Refuse { number: 0, once: false, least: 1 };
            refuse.during(|| trace(&mut hits, &mut any));
            assert!(!Refuse::was_refused(), "{layout:?}, {accuracy:?}");
            assert!((hits, any) == expected, "{layout:?}, {accuracy:?}");
        });
    }
}
