//! Limits and ends: a watch may end builds, loads and batches at any of its calls, and nothing is lost or
//! left over; limits of memory end in errors and change nothing else; counts bind in the same place
//! everywhere.

use crate::counting::{alone, bytes_held, peak};
use splitplane::core::backend::locate_along;
use splitplane::core::query::inside::DIRECTION;
use splitplane::{
    Accelerator, Accuracy, AllHits, AllHitsOptions, Backend, BuildConfig, BuildError, BuildOptions,
    CpuBackend, Hit, LoadOptions, LocateOptions, Preset, Progress, QueryError, QueryOptions, Ray,
    Stage, Watch,
};
use splitplane_test_support::aim;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_test_support::watch::goes_on;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Mutex, PoisonError};

/// What the queues of a thread pool may add on the way.
const SLACK: usize = 24 << 10;

/// Ends the work, or panics, at one of its calls.
struct Ends {
    at: usize,
    panics: bool,
    calls: AtomicUsize,
    /// The progress that it received.
    told: Mutex<Vec<Progress>>,
}

impl Ends {
    fn at(at: usize) -> Ends {
        Ends { at, panics: false, calls: AtomicUsize::new(0), told: Mutex::default() }
    }

    fn never() -> Ends {
        Ends::at(usize::MAX)
    }

    fn calls(&self) -> usize {
        self.calls.load(Relaxed)
    }

    fn last(&self) -> Progress {
        *self.told.lock().unwrap().last().unwrap()
    }
}

impl Watch for Ends {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        // Nobody else may be asking.
        self.told.try_lock().expect("one call at a time").push(*progress);
        let call = self.calls.fetch_add(1, Relaxed) + 1;
        assert!(call <= self.at, "called again after the end: {progress:?}");
        if call < self.at {
            return ControlFlow::Continue(());
        }
        if self.panics {
            // Without the message of a panic.
            resume_unwind(Box::new("the watch panics"));
        }
        ControlFlow::Break(())
    }
}

/// Why work ended, if the watch ended it.
trait Ended: Sized {
    fn cancelled(&self) -> Option<(u64, u64)>;
}

impl Ended for BuildError {
    fn cancelled(&self) -> Option<(u64, u64)> {
        match self {
            BuildError::Cancelled { progress } => Some((progress.done, progress.total)),
            _ => None,
        }
    }
}

impl Ended for QueryError {
    fn cancelled(&self) -> Option<(u64, u64)> {
        match self {
            QueryError::Cancelled { done, total } => Some((*done, *total)),
            _ => None,
        }
    }
}

/// Lets a watch end some work at its 1st, 2nd, 4th, 8th... call until it is done before that: each time the
/// error says where, and as much memory is held as before. Then the same with panics. Returns the number of
/// calls of the whole work.
fn ends_anywhere<T, E: Ended + std::fmt::Debug>(
    what: &str,
    work: impl Fn(&dyn Watch) -> Result<T, E>,
) -> usize {
    // Thread pools make what they keep.
    let whole = Ends::never();
    drop(work(&whole).unwrap());
    let calls = whole.calls();
    drop(whole);
    drop(work(&Ends::at(1)));
    for panics in [false, true] {
        let held = bytes_held();
        let mut at = 1;
        let mut ended = 0;
        loop {
            let watch = Ends { panics, ..Ends::at(at) };
            let result = catch_unwind(AssertUnwindSafe(|| work(&watch)));
            if watch.calls() < at {
                assert!(matches!(result, Ok(Ok(_))), "{what}: {at}");
                break;
            }
            match result {
                Err(_) => assert!(panics),
                Ok(Ok(_)) => panic!("{what}: call {at} of {calls} ended nothing"),
                Ok(Err(error)) => {
                    let Progress { done, total, .. } = watch.last();
                    assert_eq!(error.cancelled(), Some((done, total)), "{what}: {error:?}");
                }
            }
            ended += 1;
            drop(watch);
            let after = bytes_held();
            assert!(after <= held + SLACK, "{what}: {} bytes left by call {at}", after - held);
            at *= 2;
        }
        // Few threads more or less change the number of calls a little.
        assert!(ended >= 2 && 1 << ended >= calls / 2, "{what}: {ended} ends, {calls} calls");
    }
    calls
}

fn in_pool(threads: usize, work: impl FnOnce() + Send) {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work);
}

/// Enough for chunks, several levels and tasks of every builder.
fn scene() -> Scene {
    scenes::soup(12_000, 0.05, 7)
}

fn other_scene() -> Scene {
    scenes::sphere(40, [1.0, 2.0, 3.0], 4.0)
}

/// What names the trees of [`scene`] for ever.
const DIGESTS: [(Preset, &str); 3] = [
    (Preset::Fast, "3454926d56f58e48"),
    (Preset::Balanced, "96c3ef97908781a6"),
    (Preset::Best, "00d9ff48afedd8a6"),
];

fn options(preset: Preset) -> BuildOptions<'static> {
    BuildOptions::from(preset.config())
}

#[test]
fn builds_end_at_any_call() {
    let _alone = alone();
    let (scene, other) = (scene(), other_scene());
    let (mesh, other) = (scene.mesh(), other.mesh());
    for (preset, digest) in DIGESTS {
        let options = options(preset);
        for threads in [1, 2, 4] {
            in_pool(threads, || {
                let what = format!("{preset:?}, {threads} threads");
                let backend = CpuBackend::new();
                let calls = ends_anywhere(&format!("build, {what}"), |watch| {
                    CpuBackend::new().build(&mesh, &BuildOptions { watch: Some(watch), ..options })
                });
                assert!(calls > 80, "{what}: {calls} calls");
                let calls = ends_anywhere(&format!("tree, {what}"), |watch| {
                    CpuBackend::new()
                        .build_tree(&mesh, &BuildOptions { watch: Some(watch), ..options })
                });
                assert!(calls > 40, "{what}: {calls} calls");
                // The same backend, ended again and again.
                for at in [1, 3, 10, 40] {
                    let watch = Ends::at(at);
                    let error = backend
                        .build(&mesh, &BuildOptions { watch: Some(&watch), ..options })
                        .err();
                    let cancelled = BuildError::Cancelled { progress: watch.last() };
                    assert_eq!(error, Some(cancelled));
                }
                let built = backend
                    .build(&mesh, &BuildOptions { watch: Some(&Ends::never()), ..options })
                    .unwrap();
                assert_eq!(built.tree().digest().to_string(), digest, "{what}");
                let built = backend.build(&mesh, &options).unwrap();
                assert_eq!(built.tree().digest().to_string(), digest, "{what}");

                // Rebuilt over another mesh: until that is done it is what it was.
                let rays = aim::rays(&mesh, aim::Kind::ALL[0], 500, 3);
                let mut kept = backend.build_accelerator(&other, &options).unwrap();
                let before = kept.tree().digest();
                let answers = closest(&kept, &rays);
                let kept = Mutex::new(&mut kept);
                ends_anywhere(&format!("rebuild, {what}"), |watch| {
                    let kept = &mut **kept.lock().unwrap_or_else(PoisonError::into_inner);
                    assert_eq!(kept.tree().digest(), before, "{what}");
                    let rebuilt = CpuBackend::new().rebuild_accelerator(
                        kept,
                        &mesh,
                        &BuildOptions { watch: Some(watch), ..options },
                    );
                    if rebuilt.is_ok() {
                        assert_eq!(kept.tree().digest().to_string(), digest);
                        // Back again, for the next.
                        CpuBackend::new().rebuild_accelerator(kept, &other, &options).unwrap();
                    }
                    rebuilt
                });
                let kept = kept.into_inner().unwrap_or_else(PoisonError::into_inner);
                assert_eq!(closest(kept, &rays), answers, "{what}");
                backend
                    .rebuild_accelerator(
                        kept,
                        &mesh,
                        &BuildOptions { watch: Some(&Ends::never()), ..options },
                    )
                    .unwrap();
                assert_eq!(kept.tree().digest().to_string(), digest, "{what}");
                assert_eq!(closest(kept, &rays), closest(built.as_ref(), &rays));

                let tree = built.tree();
                ends_anywhere(&format!("load, {what}"), |watch| {
                    CpuBackend::new().load(
                        &mesh,
                        tree.clone(),
                        &LoadOptions { watch: Some(watch), ..options.for_loading() },
                    )
                });
            });
        }
    }
}

fn closest(accelerator: &dyn Accelerator, rays: &[Ray]) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    accelerator.closest_hits(rays, &mut hits, &QueryOptions::default()).unwrap();
    hits
}

#[test]
fn batches_end_at_any_call() {
    let _alone = alone();
    let scene = scene();
    let mesh = scene.mesh();
    let rays = aim::rays(&mesh, aim::Kind::ALL[0], 40_000, 5);
    let few = &rays[..4_000];
    let options = QueryOptions::default();
    let (mut first, mut found) = (Vec::new(), AllHits::none());
    for threads in [1, 2, 4] {
        in_pool(threads, || {
            let built = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
            // Every thread makes what it keeps for its rays.
            rayon::broadcast(|_| drop(closest(&*built, few)));
            ends_anywhere(&format!("closest hits, {threads} threads"), |watch| {
                let mut hits = vec![Hit::MISS; rays.len()];
                built.closest_hits(
                    &rays,
                    &mut hits,
                    &QueryOptions { watch: Some(watch), ..options },
                )
            });
            ends_anywhere(&format!("any hits, {threads} threads"), |watch| {
                let mut hits = vec![false; rays.len()];
                built.any_hits(&rays, &mut hits, &QueryOptions { watch: Some(watch), ..options })
            });
            let calls = ends_anywhere(&format!("all hits, {threads} threads"), |watch| {
                built.all_hits(few, &AllHitsOptions { watch: Some(watch), ..Default::default() })
            });
            assert!(calls > 10, "{calls}");
            let mut hits = vec![Hit::MISS; rays.len()];
            let watch = Ends::never();
            built
                .closest_hits(&rays, &mut hits, &QueryOptions { watch: Some(&watch), ..options })
                .unwrap();
            stages_in_order(&watch, &[(Stage::Rays, Some(40_000))]);
            assert_eq!(hits, closest(built.as_ref(), &rays));
            let mut any = vec![false; rays.len()];
            built.any_hits(&rays, &mut any, &options).unwrap();
            assert!(any.iter().zip(&hits).all(|(any, hit)| *any == hit.is_hit()));
            let watch = Ends::never();
            let all = built
                .all_hits(few, &AllHitsOptions { watch: Some(&watch), ..Default::default() })
                .unwrap();
            stages_in_order(&watch, &[(Stage::Rays, Some(4_000))]);
            assert_eq!(all, built.all_hits(few, &AllHitsOptions::default()).unwrap());
            if threads == 1 {
                (first, found) = (hits, all);
            } else {
                assert!(first == hits && found == all);
            }
        });
    }
    let mut none = [Hit::MISS; 1];
    let built = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    let error = built.closest_hits(&rays, &mut none, &options).unwrap_err();
    assert_eq!(error, QueryError::LengthMismatch { rays: 40_000, results: 1 });
}

/// A watch receives these stages, with these totals; in each, `done` never falls, and equals the
/// total at the end.
fn stages_in_order(watch: &Ends, expected: &[(Stage, Option<u64>)]) {
    let told = watch.told.lock().unwrap();
    let mut stages: Vec<Vec<Progress>> = Vec::new();
    for progress in told.iter() {
        match stages.last_mut() {
            Some(stage) if stage[0].stage == progress.stage => stage.push(*progress),
            _ => stages.push(vec![*progress]),
        }
    }
    let names: Vec<Stage> = stages.iter().map(|stage| stage[0].stage).collect();
    assert_eq!(names, expected.iter().map(|(stage, _)| *stage).collect::<Vec<_>>());
    for (stage, (_, total)) in stages.iter().zip(expected) {
        let (first, last) = (stage[0], stage[stage.len() - 1]);
        assert!(stage.iter().all(|progress| progress.total == first.total), "{first:?}");
        assert_eq!(first.done, 0, "{first:?}");
        if let Some(total) = total {
            assert_eq!(first.total, *total, "{first:?}");
        }
        if first.total > 0 {
            assert_eq!(last.done, last.total, "{last:?}");
        }
        assert!(stage.windows(2).all(|pair| pair[0].done <= pair[1].done), "{first:?}");
    }
}

#[test]
fn progress_is_told_in_order_with_true_totals() {
    let _alone = alone();
    let scene = scene();
    let mesh = scene.mesh();
    for (preset, _) in DIGESTS {
        for threads in [1, 4] {
            in_pool(threads, || {
                let watch = Ends::never();
                let built = CpuBackend::new()
                    .build(&mesh, &BuildOptions { watch: Some(&watch), ..options(preset) })
                    .unwrap();
                let tree = built.tree();
                let layout = (tree.nodes.len() + tree.references.len()) as u64;
                let start = (Stage::Start, Some(24_000));
                let layout = (Stage::Layout, Some(layout));
                if preset == Preset::Best {
                    let nodes = Some(tree.nodes.len() as u64);
                    let offline = (Stage::Offline, None);
                    stages_in_order(&watch, &[start, offline, (Stage::Output, nodes), layout]);
                } else {
                    let large = (Stage::LargeNodes, Some(0));
                    // How many subtrees there are, and how many references they begin with, is the backend's choice.
                    let (small, output) = ((Stage::SmallNodes, None), (Stage::Output, None));
                    stages_in_order(&watch, &[start, large, small, output, layout]);
                    let told = watch.told.lock().unwrap();
                    for stage in [Stage::SmallNodes, Stage::Output] {
                        let total = told.iter().find(|p| p.stage == stage).unwrap().total;
                        assert!(0 < total && total < 200_000, "{stage:?}: {total}");
                    }
                    let levels = told.iter().filter(|p| p.stage == Stage::LargeNodes);
                    let levels = levels.map(|p| p.done).max().unwrap();
                    // The last levels are built together with the small nodes.
                    let most = u64::from(built.summary().large_levels);
                    assert!(0 < levels && levels <= most, "{levels} of {most}");
                }
                let watch = Ends::never();
                CpuBackend::new()
                    .load(
                        &mesh,
                        tree.clone(),
                        &LoadOptions { watch: Some(&watch), ..options(preset).for_loading() },
                    )
                    .unwrap();
                stages_in_order(&watch, &[start, layout]);
            });
        }
    }
    // Where there is nothing to do.
    let none = scenes::none();
    for (preset, _) in DIGESTS {
        let watch = Ends::never();
        CpuBackend::new()
            .build(&none.mesh(), &BuildOptions { watch: Some(&watch), ..options(preset) })
            .unwrap();
        assert!(watch.calls() >= 3);
    }
}

/// Many coincident triangles: one large node, which only sweeps over all of them decide.
#[test]
fn a_single_large_node_is_left_in_the_middle() {
    let _alone = alone();
    let scene = scenes::identical(100_000);
    let mesh = scene.mesh();
    for (preset, _) in DIGESTS {
        in_pool(2, || {
            ends_anywhere(&format!("identical, {preset:?}"), |watch| {
                CpuBackend::new()
                    .build(&mesh, &BuildOptions { watch: Some(watch), ..options(preset) })
            });
        });
    }
    // A ray through all of them.
    let built = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    let [a, b, c] = mesh.triangle(0);
    let target = [0, 1, 2].map(|i| (f64::from(a[i]) + f64::from(b[i]) + f64::from(c[i])) / 3.0);
    let ray = aim::aimed([9.0, 8.0, 7.0], target);
    let calls = ends_anywhere("a ray through all", |watch| {
        built.all_hits(&[ray], &AllHitsOptions { watch: Some(watch), ..Default::default() })
    });
    assert!(calls > 10, "{calls}");
}

#[test]
fn memory_ends_in_errors_and_changes_nothing() {
    let _alone = alone();
    let (scene, other) = (scene(), other_scene());
    let (mesh, other) = (scene.mesh(), other.mesh());
    for (preset, digest) in DIGESTS {
        let backend = CpuBackend::new();
        let free = backend.build(&mesh, &options(preset)).unwrap();
        let peak = free.summary().peak_bytes;
        let mut kept = backend.build_accelerator(&other, &options(preset)).unwrap();
        let before = kept.tree().digest();
        let (mut built, mut refused) = (0, 0);
        for part in 0..=24u64 {
            let limit = peak * part / 16;
            let options = BuildOptions { max_memory: Some(limit), ..options(preset) };
            let refuse = |error: BuildError| match error {
                BuildError::OutOfMemory { needed, limit: told } => {
                    assert!(told == limit && needed > limit, "{needed} of {told}");
                }
                error => panic!("{error}"),
            };
            match CpuBackend::new().build(&mesh, &options) {
                Ok(accelerator) => {
                    assert_eq!(accelerator.tree().digest().to_string(), digest);
                    assert!(accelerator.summary().peak_bytes <= limit);
                    built += 1;
                }
                Err(error) => {
                    refuse(error);
                    refused += 1;
                }
            }
            let watched = BuildOptions { watch: Some(&goes_on), ..options };
            match backend.rebuild_accelerator(&mut kept, &mesh, &watched) {
                Ok(()) => {
                    assert_eq!(kept.tree().digest().to_string(), digest);
                    assert!(kept.summary().peak_bytes <= limit);
                    backend
                        .rebuild_accelerator(&mut kept, &other, &BuildOptions::from(options.config))
                        .unwrap();
                }
                Err(error) => refuse(error),
            }
            assert_eq!(kept.tree().digest(), before);
            match backend.load(&mesh, free.tree().clone(), &options.for_loading()) {
                Ok(loaded) => {
                    assert_eq!(loaded.tree().digest().to_string(), digest);
                    assert!(loaded.summary().peak_bytes <= limit);
                }
                Err(error) => refuse(error),
            }
        }
        assert!(built > 3 && refused > 10, "{built} {refused}");
    }
}

#[test]
fn all_hits_stay_within_their_limit() {
    let _alone = alone();
    let scene = scenes::soup(3_000, 0.3, 9);
    let mesh = scene.mesh();
    let rays = aim::rays(&mesh, aim::Kind::ALL[0], 2_000, 6);
    let built = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    let free = built.all_hits(&rays, &AllHitsOptions::default()).unwrap();
    let bytes = free.bytes();
    let mut refused = 0;
    for part in 0..=24 {
        let limit = bytes * part / 8;
        let options = AllHitsOptions { max_memory: Some(limit), ..Default::default() };
        let before = bytes_held();
        match built.all_hits(&rays, &options) {
            Ok(all) => assert_eq!(all, free),
            Err(QueryError::OutOfMemory { needed, limit: told }) => {
                assert!(told == limit && needed > limit);
                refused += 1;
            }
            Err(error) => panic!("{error}"),
        }
        assert!(bytes_held() <= before + SLACK);
    }
    // Twice the bytes, since everything is copied together, and the memory of parts under way.
    assert!((8..=21).contains(&refused), "{refused}");

    // One ray that crosses a hundred thousand triangles is stopped before it has found them all.
    let scene = scenes::identical(100_000);
    let mesh = scene.mesh();
    let built = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    let [a, b, c] = mesh.triangle(0);
    let target = [0, 1, 2].map(|i| (f64::from(a[i]) + f64::from(b[i]) + f64::from(c[i])) / 3.0);
    let ray = aim::aimed([9.0, 8.0, 7.0], target);
    assert_eq!(built.all_hits(&[ray], &AllHitsOptions::default()).unwrap().of(0).len(), 100_000);
    let options = AllHitsOptions { max_memory: Some(1 << 20), ..Default::default() };
    let error = built.all_hits(&[ray], &options).unwrap_err();
    let QueryError::OutOfMemory { needed, .. } = error else { panic!("{error}") };
    assert!(needed < 2 << 20, "{needed}");
}

/// The caps of the configuration are counts: where they bind, trees differ from free ones, and are the same
/// on any number of threads, watched or not.
#[test]
fn caps_bind_in_the_same_place_on_any_number_of_threads() {
    let _alone = alone();
    // Large triangles, so that references multiply.
    let scene = scenes::soup(6_000, 0.5, 11);
    let mesh = scene.mesh();
    for (preset, _) in DIGESTS {
        let free = BuildConfig { max_depth: 40, ..preset.config() };
        // The cap on nodes is one of the large-node stage.
        let mut pairs = vec![
            (free, BuildConfig { max_depth: 9, ..free }),
            (free, BuildConfig { references_per_triangle: 1, ..free }),
        ];
        if preset != Preset::Best {
            let fine = BuildConfig { references_per_triangle: 100, ..free }
                .with_stages(|stages| stages.small_node_limit = 1);
            pairs.push((fine, fine.with_stages(|stages| stages.nodes_per_triangle = 1)));
        }
        for (free, config) in pairs {
            let options = BuildOptions::from(config);
            let mut digests = Vec::new();
            let mut nodes = 0;
            for threads in [1, 2, 4] {
                in_pool(threads, || {
                    let backend = CpuBackend::new();
                    let tree = backend.build_tree(&mesh, &options).unwrap().0;
                    nodes = tree.nodes.len();
                    digests.push(tree.digest());
                    let watched = backend.build_tree(
                        &mesh,
                        &BuildOptions { watch: Some(&Ends::never()), ..options },
                    );
                    digests.push(watched.unwrap().0.digest());
                });
            }
            assert!(digests.iter().all(|other| *other == digests[0]), "{config:?}");
            let free = CpuBackend::new().build_tree(&mesh, &BuildOptions::from(free)).unwrap().0;
            assert!(nodes < free.nodes.len(), "{config:?} does not bind");
        }
    }
}

/// Rays through all of some identical triangles, from points apart from them.
fn through(scene: &Scene, direction: [f32; 3], count: usize) -> Vec<Ray> {
    let [a, b, c] = scene.mesh().triangle(0);
    let along = |i: usize, far: f32| (a[i] + b[i] + c[i]) / 3.0 - far * direction[i];
    let far = |ray: usize| 3.0 + ray as f32 / 256.0;
    (0..count).map(|ray| Ray::new([0, 1, 2].map(|i| along(i, far(ray))), direction)).collect()
}

#[test]
fn points_are_located_within_little_memory_and_left_in_the_middle() {
    let _alone = alone();
    let scene = scenes::identical(20_000);
    let built = CpuBackend::new().build(&scene.mesh(), &BuildOptions::default()).unwrap();
    let rays = through(&scene, DIRECTION, 512);
    let points: Vec<[f32; 3]> = rays.iter().map(|ray| ray.origin).collect();
    let free = LocateOptions::default();
    let limited = |limit| LocateOptions { max_memory: Some(limit), ..free };
    for threads in [1, 4] {
        in_pool(threads, || {
            // The pool makes what it keeps.
            drop(built.locate(&points[..300], &free));
            let (bytes, located) = peak(|| built.locate(&points, &free).unwrap());
            assert!(located.windings.iter().all(|winding| winding.unwrap().abs() == 20_000));
            // Four bytes a crossing of a ray on its way, in room that doubles, and again while some
            // of it is there twice.
            assert!(bytes <= 4096 + threads * 3 * (128 << 10) + SLACK, "{bytes}");
            let (bytes, refused) = peak(|| built.locate(&points, &limited(40_000)));
            assert!(matches!(refused, Err(QueryError::OutOfMemory { limit: 40_000, .. })));
            assert!(bytes <= 40_000 + SLACK, "{bytes}");
        });
    }
    assert!(matches!(
        built.locate(&points, &limited(4095)),
        Err(QueryError::OutOfMemory { needed: 4096, limit: 4095 })
    ));
    // In the middle of a point, by the CPU backend and by any accelerator's hits.
    let one = &points[..1];
    let calls = ends_anywhere("a point", |watch| {
        built.locate(one, &LocateOptions { watch: Some(watch), ..free })
    });
    assert!(calls > 5, "{calls}");
    let calls = ends_anywhere("a point along a ray", |watch| {
        locate_along(&*built, one, DIRECTION, &LocateOptions { watch: Some(watch), ..free })
    });
    assert!(calls > 5, "{calls}");
    let watch = Ends::never();
    let located = locate_along(
        &*built,
        &points[..9],
        DIRECTION,
        &LocateOptions { watch: Some(&watch), ..free },
    )
    .unwrap();
    assert_eq!(located.windings, built.locate(&points[..9], &free).unwrap().windings);
    stages_in_order(&watch, &[(Stage::Rays, Some(9))]);
    let error = locate_along(&*built, one, DIRECTION, &limited(9_000)).unwrap_err();
    assert!(matches!(error, QueryError::OutOfMemory { needed, limit: 9_000 } if needed > 9_000));
}

#[test]
fn all_threads_together_stay_within_the_limit_of_all_hits() {
    let _alone = alone();
    let scene = scenes::identical(50_000);
    let built = CpuBackend::new().build(&scene.mesh(), &BuildOptions::default()).unwrap();
    let rays = through(&scene, [0.25, 0.5, 1.0], 1024);
    let limit = 12 << 20;
    let options = AllHitsOptions { max_memory: Some(limit), ..AllHitsOptions::default() };
    in_pool(4, || {
        drop(built.all_hits(&rays, &options));
        let (bytes, refused) = peak(|| built.all_hits(&rays, &options));
        assert!(matches!(refused, Err(QueryError::OutOfMemory { .. })));
        assert!(bytes <= limit as usize + SLACK, "{bytes}");
    });
}

/// However slow rays are, the watch is asked after few of them.
#[test]
fn a_batch_of_few_rays_is_left_in_the_middle() {
    let _alone = alone();
    let scene = scenes::identical(2_000);
    let built = CpuBackend::new().build(&scene.mesh(), &BuildOptions::default()).unwrap();
    let rays = through(&scene, [0.25, 0.5, 1.0], 4096);
    for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
        let options = QueryOptions { accuracy, ..QueryOptions::default() };
        in_pool(1, || {
            let watch = Ends::never();
            let mut hits = vec![Hit::MISS; rays.len()];
            built
                .closest_hits(&rays, &mut hits, &QueryOptions { watch: Some(&watch), ..options })
                .unwrap();
            stages_in_order(&watch, &[(Stage::Rays, Some(4096))]);
            // 16 rays, 32, 64 and so on, or fewer.
            assert!(watch.calls() >= 11, "{}", watch.calls());
            assert_eq!(watch.told.lock().unwrap()[1].done, 16);
            let mut expected = vec![Hit::MISS; rays.len()];
            built.closest_hits(&rays, &mut expected, &options).unwrap();
            assert!(hits == expected && hits.iter().all(Hit::is_hit));
        });
    }
}
