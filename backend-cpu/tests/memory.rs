//! A limit on memory is held to the byte, and what counts against it is what is really allocated.

use crate::counting::{Refuse, alone, held, peak_of, pool};
use rayon::prelude::*;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, QueryLayout};
use splitplane_core::config::Preset;
use splitplane_core::error::{BuildError, QueryError};
use splitplane_core::points::build::PointOptions;
use splitplane_core::points::nearest::NearestOptions;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_cpu::{CpuAccelerator, CpuBackend, CpuPointTree, InstructionSet, KeptBytes};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_test_support::watch::goes_on;

/// Bytes of a large request: pools and locks ask for less.
const LARGE: usize = 1 << 13;

/// A mesh that shares corners, one that does not, one that is a single leaf, and one with large triangles.
fn scenes() -> [Scene; 4] {
    let [sphere, soup] = [scenes::sphere(120, [0.0; 3], 1.0), scenes::soup(9_000, 0.05, 3)];
    [sphere, soup, scenes::identical(100_000), scenes::giants()]
}

fn options(preset: Preset, layout: QueryLayout) -> BuildOptions<'static> {
    BuildOptions { layout, ..preset.config().into() }
}

/// Everything that is built, with what it took.
fn each(mut check: impl FnMut(&str, &Scene, InstructionSet, BuildOptions)) {
    for scene in scenes() {
        for set in InstructionSet::available() {
            for layout in [QueryLayout::Fast, QueryLayout::Compact] {
                let preset =
                    if layout == QueryLayout::Fast { Preset::Fast } else { Preset::Balanced };
                let what = format!("{}, {}, {layout:?}", scene.name, set.name());
                check(&what, &scene, set, options(preset, layout));
            }
        }
    }
}

/// With one thread: what several hold depends on who does what.
fn each_on_one_thread(check: impl FnMut(&str, &Scene, InstructionSet, BuildOptions) + Send) {
    let pool = pool(1);
    pool.install(|| each(check));
}

#[test]
fn limits_are_held_to_the_byte() {
    let _alone = alone();
    each_on_one_thread(|what, scene, set, options| {
        let mesh = scene.mesh();
        // A new backend each time: memory that is kept counts.
        let build = |max_memory| {
            let options = BuildOptions { max_memory, ..options };
            CpuBackend::with_instruction_set(set).build(&mesh, &options)
        };
        let free = build(None).expect("no limit");
        let peak = free.summary().peak_bytes;
        let enough = build(Some(peak)).expect("just enough");
        assert!(enough.summary().peak_bytes == peak && enough.tree() == free.tree(), "{what}");
        for limit in [peak - 1, peak - peak / 50] {
            let error = build(Some(limit)).err().expect("not enough");
            assert_eq!(error, BuildError::OutOfMemory { needed: peak, limit }, "{what}");
        }
        // Wherever it is met.
        for limit in (0..32).map(|part| peak * part / 32) {
            let error = build(Some(limit)).err().expect("not enough");
            let BuildError::OutOfMemory { needed, limit: said } = error else {
                panic!("{what}: {error}");
            };
            assert!(said == limit && limit < needed && needed <= peak, "{what}: {needed}, {limit}");
        }

        // The same for rebuilds, which keep what they had when there is not enough. The least limit is that
        // of a backend that keeps nothing.
        let new = || CpuBackend::with_instruction_set(set);
        let backend = new();
        let mut kept = backend.build_accelerator(&mesh, &options).expect("no limit");
        new().rebuild_accelerator(&mut kept, &mesh, &options).expect("no limit");
        let least = kept.summary().peak_bytes;
        for (limit, enough) in [(least, true), (least - 1, false), (least, true)] {
            let options = BuildOptions { max_memory: Some(limit), ..options };
            match backend.rebuild_accelerator(&mut kept, &mesh, &options) {
                Ok(()) => assert!(enough, "{what}"),
                Err(error) => {
                    assert!(!enough, "{what}: {error}");
                    assert_eq!(error, BuildError::OutOfMemory { needed: least, limit }, "{what}");
                }
            }
            assert!(kept.tree() == free.tree() && kept.summary().peak_bytes <= least, "{what}");
        }
    });
}

#[test]
fn a_limit_does_not_depend_on_earlier_builds() {
    let _alone = alone();
    let large = scenes::soup(60_000, 0.05, 3);
    each_on_one_thread(|what, scene, set, options| {
        if set != InstructionSet::detect() {
            return;
        }
        let mesh = scene.mesh();
        let built = CpuBackend::with_instruction_set(set).build(&mesh, &options).expect("no limit");
        let peak = built.summary().peak_bytes;
        for first in [(Preset::Fast, QueryLayout::Fast), (Preset::Best, QueryLayout::Compact)] {
            let backend = CpuBackend::with_instruction_set(set);
            let first = self::options(first.0, first.1);
            drop(backend.build(&large.mesh(), &first).expect("no limit"));
            // Just enough, and too little.
            for (limit, enough) in [(peak, true), (peak - 1, false), (peak, true)] {
                let options = BuildOptions { max_memory: Some(limit), ..options };
                match backend.build(&mesh, &options) {
                    Ok(again) => {
                        assert!(enough && again.tree() == built.tree(), "{what}");
                        assert!(again.summary().peak_bytes <= peak, "{what}");
                    }
                    Err(error) => {
                        let expected = BuildError::OutOfMemory { needed: peak, limit };
                        assert!(!enough && error == expected, "{what}: {error}");
                    }
                }
            }
        }
    });
}

/// The system may have less memory than a limit allows. Then too a rebuild ends in an error, and the
/// accelerator is what it was.
#[test]
fn where_there_is_no_memory_nothing_is_lost() {
    let _alone = alone();
    let (before, after) = (scenes::sphere(8, [0.0; 3], 1.0), scenes::sphere(60, [0.0; 3], 1.0));
    let (before, after) = (before.mesh(), after.mesh());
    let pool = pool(1);
    let layouts = [QueryLayout::Fast, QueryLayout::Compact];
    for (from, to) in layouts.into_iter().flat_map(|from| layouts.map(|to| (from, to))) {
        let [first, second] = [from, to].map(|layout| options(Preset::Fast, layout));
        let rays: Vec<Ray> = (0..40).map(|i| ray(i as f32 / 20.0 - 1.0)).collect();
        let backend = CpuBackend::new();
        let mut refused = 0;
        let built = loop {
            // A new one, since what was granted is kept.
            let mut built = CpuBackend::new().build_accelerator(&before, &first).expect("no limit");
            let (tree, hits) = (built.tree().clone(), hits_of(&built, &rays));
            assert!(hits.iter().any(Hit::is_hit));
            // The builder's memory is there, so that it is the layout's that is refused.
            pool.install(|| backend.build_tree(&after, &second)).expect("no limit");
            let refuse = Refuse { number: refused, once: false, least: LARGE };
            let rebuild = || backend.rebuild_accelerator(&mut built, &after, &second);
            let rebuilt = pool.install(|| refuse.during(rebuild));
            let Err(error) = rebuilt else { break built };
            let BuildError::OutOfMemory { needed, limit } = error else { panic!("{error}") };
            assert_eq!(needed, limit, "there was no limit");
            assert!(error.to_string().contains("no more memory"), "{error}");
            assert!(built.layout() == from && *built.tree() == tree, "{refused}");
            assert!(hits_of(&built, &rays) == hits, "{refused}");
            refused += 1;
        };
        // The plan, the tree's nodes and references, wide nodes, and blocks or a mesh.
        assert!(refused >= if to == QueryLayout::Fast { 7 } else { 6 }, "{refused}");
        let new = CpuBackend::new().build_accelerator(&after, &second).expect("no limit");
        assert!(built.tree() == new.tree() && hits_of(&built, &rays) == hits_of(&new, &rays));
    }
}

/// Whichever large request of the builder is refused, an error says so. (`refusals.rs` refuses all others too.)
#[test]
fn where_there_is_no_memory_no_tree_is_built() {
    let _alone = alone();
    let scene = scenes::sphere(100, [0.0; 3], 1.0);
    let mesh = scene.mesh();
    let pool = pool(1);
    for preset in [Preset::Fast, Preset::Balanced, Preset::Best] {
        let options = options(preset, QueryLayout::Fast);
        let build = || pool.install(|| CpuBackend::new().build_tree(&mesh, &options));
        let expected = build().expect("no limit");
        let mut refused = 0;
        let built = loop {
            // What a thread needs, whatever the mesh, is less.
            let refuse = Refuse { number: refused, once: false, least: 1 << 16 };
            let built = refuse.during(build);
            let Err(error) = built else { break built };
            let BuildError::OutOfMemory { needed, limit } = error else { panic!("{error}") };
            assert_eq!(needed, limit, "there was no limit");
            refused += 1;
        };
        assert!(built.is_ok_and(|(tree, _)| tree == expected.0), "{preset:?}");
        assert!(refused > 5, "{preset:?}: {refused}");
    }
}

fn ray(x: f32) -> Ray {
    Ray::new([x, 0.1, -3.0], [0.0, 0.01, 1.0])
}

fn hits_of(built: &CpuAccelerator, rays: &[Ray]) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    built.closest_hits(rays, &mut hits, &QueryOptions::default()).expect("equal lengths");
    hits
}

/// An accelerator counts with its whole capacity, however little of it is in use.
#[test]
fn a_smaller_tree_counts_with_its_room() {
    let _alone = alone();
    let (large, small) = (scenes::sphere(120, [0.0; 3], 1.0), scenes::sphere(8, [0.0; 3], 1.0));
    for layout in [QueryLayout::Fast, QueryLayout::Compact] {
        let options = options(Preset::Fast, layout);
        let before = held();
        let large = CpuBackend::new().build_accelerator(&large.mesh(), &options);
        let mut built = large.expect("no limit");
        let room = held() - before;
        CpuBackend::new()
            .rebuild_accelerator(&mut built, &small.mesh(), &options)
            .expect("no limit");
        assert!(held() - before >= room - room / 50, "rebuilds keep what they have");
        let watched = |built: &mut CpuAccelerator, limit| {
            let options = BuildOptions { max_memory: limit, watch: Some(&goes_on), ..options };
            CpuBackend::new().rebuild_accelerator(built, &small.mesh(), &options)
        };
        let refused = watched(&mut built, Some(room as u64)).expect_err("not both");
        assert!(matches!(refused, BuildError::OutOfMemory { .. }), "{refused}");
        watched(&mut built, None).expect("no limit");
        let counted = built.summary().peak_bytes as i64;
        assert!(counted > room && counted < room + room / 4, "{counted} and {room}");
    }
}

#[test]
fn what_counts_is_what_is_allocated() {
    let _alone = alone();
    each(|what, scene, set, options| {
        let mesh = scene.mesh();
        let pool = pool(2);
        let (built, taken) = pool.install(|| {
            peak_of(|| CpuBackend::with_instruction_set(set).build_accelerator(&mesh, &options))
        });
        let counted = built.expect("no limit").summary().peak_bytes as i64;
        assert!(taken <= counted + counted / 20 + 100_000, "{what}: {taken} taken, {counted} told");
        assert!(counted <= taken + taken / 4, "{what}: {taken} taken, {counted} told");
    });
}

/// A build gives back what only the builder needs before the layout is made, and the backend holds no more of it
/// afterwards; rebuilds keep it.
#[test]
fn a_build_takes_less_than_three_times_what_it_returns() {
    let _alone = alone();
    let pool = pool(1);
    let scenes = [
        scenes::sphere(200, [0.0; 3], 1.0),
        scenes::soup(60_000, 0.05, 3),
        scenes::sizes(60_000, 10, 9),
    ];
    for (scene, preset) in scenes
        .iter()
        .flat_map(|scene| [Preset::Fast, Preset::Balanced, Preset::Best].map(|p| (scene, p)))
    {
        let mesh = scene.mesh();
        let options = options(preset, QueryLayout::Fast);
        let what = format!("{}, {preset:?}", scene.name);
        pool.install(|| {
            let backend = CpuBackend::new();
            let (built, taken) = peak_of(|| backend.build_accelerator(&mesh, &options));
            let mut built = built.expect("no limit");
            let tree = built.tree();
            let tree = size_of_val(&tree.nodes[..]) + size_of_val(&tree.references[..]);
            let finished = (built.query_bytes() + tree as u64) as f64;
            let (taken, told) = (taken as f64, built.summary().peak_bytes as f64);
            println!("{what}: {:.2} taken, {:.2} told", taken / finished, told / finished);
            assert!(taken.max(told) < 3.0 * finished, "{what}: {taken} and {told} of {finished}");
            let before = held();
            backend.rebuild_accelerator(&mut built, &mesh, &options).expect("no limit");
            let kept = (held() - before) as f64;
            assert!(kept > 0.3 * finished, "{what}: a rebuild keeps only {kept} of {finished}");
            let before = held();
            drop(backend.build_accelerator(&mesh, &options).expect("no limit"));
            let given = (before - held()) as f64;
            assert!(given > 0.3 * finished, "{what}: a build gives back only {given}");
        });
    }
}

/// Every query's list under the limit by itself: the mistake that the shared count is there to prevent.
fn each_by_itself(
    tree: &CpuPointTree<3>,
    queries: &[[f32; 3]],
    options: &NearestOptions<'_>,
) -> Result<usize, QueryError> {
    let lists: Result<Vec<_>, _> =
        queries.par_iter().map(|&query| tree.within(query, options)).collect();
    lists.map(|lists| lists.iter().map(Vec::len).sum())
}

#[test]
fn lists_within_a_radius_share_one_limit() {
    let _alone = alone();
    let mut random = Random::new(3);
    let points: Vec<[f32; 3]> = (0..3000).map(|_| random.point(1.0)).collect();
    let tree = CpuPointTree::build(&points, &PointOptions::default()).unwrap();
    let (queries, limit) = (vec![[0.0; 3]; 1000], 2_000_000);
    let options =
        NearestOptions { max_distance: 9.0, max_memory: Some(limit), ..NearestOptions::default() };
    // Keys and records are counted; a growing list of keys has room for as many again.
    let most = 2 * limit as i64 + 200_000;
    for threads in [1, 3] {
        let pool = pool(threads);
        let mut own = Vec::new();
        let kept = KeptBytes { list: 8, neighbour: 4 };
        let (done, peak) = peak_of(|| {
            pool.install(|| {
                tree.for_each_within(&queries, &options, kept, |found| -> Result<(), QueryError> {
                    own.extend(found.iter().map(|found| found.point));
                    Ok(())
                })
            })
        });
        assert!(matches!(done, Err(QueryError::OutOfMemory { limit: 2_000_000, .. })), "{done:?}");
        assert!(own.len() / 3000 > 150, "lists of 12,008 bytes under a limit of 2,000,000");
        assert!(peak < most + 4 * own.capacity() as i64 - 4 * own.len() as i64, "{peak}");
        // The check finds the mistake.
        let (done, peak) = peak_of(|| pool.install(|| each_by_itself(&tree, &queries, &options)));
        assert_eq!(done.unwrap(), 3_000_000);
        assert!(peak > 10 * most, "{peak}");
    }
}
