//! The asynchronous calls: the same bits as those that block, while the thread is free for other work; ended by being dropped, by a
//! watch, by the loss of the device or by its time-out, they leave the backend as it was.

use std::ops::ControlFlow;
use std::pin::{Pin, pin};
use std::sync::atomic::{AtomicU32, Ordering};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

use crate::common::{self, PATIENCE, options};
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::error::{BuildError, DeviceError, QueryError};
use splitplane_core::query::all_hits::AllHitsOptions;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::scene::{Instance, Scene as Objects, SceneBuildError, SceneHit, SceneOptions};
use splitplane_core::watch::Progress;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{DeviceQueryError, Gpu, GpuError, WgpuAccelerator, WgpuBackend};

fn backend() -> WgpuBackend {
    pollster::block_on(WgpuBackend::new_async(Gpu::clone(&common::gpu()))).expect("a backend")
}

fn scene() -> Scene {
    scenes::soup(3_000, 0.1, 77)
}

fn rays(scene: &Scene) -> Vec<Ray> {
    aim::rays(&scene.mesh(), Kind::Edges, 6_000, 5)
}

/// The hits of a tree, with the calls that block.
fn blocking_hits(tree: &WgpuAccelerator, rays: &[Ray], options: &QueryOptions<'_>) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    tree.closest_hits(rays, &mut hits, options).expect("hits");
    hits
}

fn bits(hits: &[Hit]) -> &[u8] {
    bytemuck::cast_slice(hits)
}

/// Polls a future once, as an executor would.
fn poll<F: Future>(future: Pin<&mut F>) -> Poll<F::Output> {
    future.poll(&mut Context::from_waker(Waker::noop()))
}

/// Both outcomes, of futures that are polled in turn; and how often neither had anything to do.
fn both<A: Future, B: Future>(a: A, b: B) -> (A::Output, B::Output, u32) {
    let (mut a, mut b) = (pin!(a), pin!(b));
    let (mut of_a, mut of_b, mut idle) = (None, None, 0);
    let both = std::future::poll_fn(|context| {
        if of_a.is_none()
            && let Poll::Ready(out) = a.as_mut().poll(context)
        {
            of_a = Some(out);
        }
        if of_b.is_none()
            && let Poll::Ready(out) = b.as_mut().poll(context)
        {
            of_b = Some(out);
        }
        match (of_a.take(), of_b.take()) {
            (Some(a), Some(b)) => Poll::Ready((a, b)),
            (a, b) => {
                (of_a, of_b) = (a, b);
                idle += 1;
                Poll::Pending
            }
        }
    });
    let (a, b) = pollster::block_on(both);
    (a, b, idle)
}

fn can_be_sent<T: Send>(future: T) -> T {
    future
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn trees_and_hits_are_those_of_the_calls_that_block() {
    let gpu = pollster::block_on(can_be_sent(Gpu::open_async(&options()))).expect("a device");
    let asynchronous =
        pollster::block_on(can_be_sent(WgpuBackend::new_async(gpu))).expect("a backend");
    let plain = WgpuBackend::new(Gpu::clone(&common::gpu())).expect("a backend");
    assert_eq!(asynchronous.parity(), plain.parity());
    let scene = scene();
    let (mesh, rays) = (scene.mesh(), rays(&scene));
    let build = BuildOptions::default();
    let work = can_be_sent(asynchronous.build_accelerator_async(&mesh, &build));
    let tree = pollster::block_on(work).expect("a tree");
    let expected = plain.build_accelerator(&mesh, &build).expect("a tree");
    assert_eq!(tree.tree(), expected.tree());
    assert_eq!(tree.triangles(), expected.triangles());
    let on_the_cpu = CpuBackend::new().build_accelerator(&mesh, &build).expect("a tree");
    assert_eq!(tree.tree().digest(), on_the_cpu.tree().digest());
    for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
        let options = QueryOptions { accuracy, ..QueryOptions::default() };
        let mut hits = vec![Hit::MISS; rays.len()];
        let work = can_be_sent(tree.closest_hits_async(&rays, &mut hits, &options));
        pollster::block_on(work).expect("hits");
        assert_eq!(bits(&hits), bits(&blocking_hits(&expected, &rays, &options)), "{accuracy:?}");
        let (mut any, mut blocking) = (vec![false; rays.len()], vec![false; rays.len()]);
        let work = can_be_sent(tree.any_hits_async(&rays, &mut any, &options));
        pollster::block_on(work).expect("hits");
        expected.any_hits(&rays, &mut blocking, &options).expect("hits");
        assert_eq!(any, blocking, "{accuracy:?}");
        let mut cpu = vec![Hit::MISS; rays.len()];
        on_the_cpu.closest_hits(&rays, &mut cpu, &options).expect("hits");
        assert_eq!(bits(&hits), bits(&cpu), "{accuracy:?}");
    }
    // On the device alone.
    let work = can_be_sent(asynchronous.build_on_device_async(&mesh, &build));
    let built = pollster::block_on(work).expect("a tree");
    let work = can_be_sent(built.tree.read_async(asynchronous.gpu()));
    assert_eq!(&pollster::block_on(work).expect("a tree"), expected.tree());
    let (queries, options) = (asynchronous.queries(), QueryOptions::default());
    let (mut hits, mut any) = (vec![Hit::MISS; rays.len()], vec![false; rays.len()]);
    let work = can_be_sent(queries.closest_hits_async(&built.tree, &rays, &mut hits, &options));
    pollster::block_on(work).expect("hits");
    let work = can_be_sent(queries.any_hits_async(&built.tree, &rays, &mut any, &options));
    pollster::block_on(work).expect("hits");
    assert_eq!(bits(&hits), bits(&blocking_hits(&expected, &rays, &options)));
    assert!(hits.iter().zip(any).all(|(hit, any)| hit.is_hit() == any));
    let short = queries.closest_hits_async(&built.tree, &rays[1..], &mut hits, &options);
    let error = pollster::block_on(short).unwrap_err();
    assert!(matches!(error, DeviceQueryError::LengthMismatch { .. }), "{error}");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn one_thread_has_two_of_them_under_way() {
    let (backend, scene) = (backend(), scene());
    let (mesh, rays, build) = (scene.mesh(), rays(&scene), BuildOptions::default());
    let tree = backend.build_accelerator(&mesh, &build).expect("a tree");
    let options = QueryOptions::default();
    let expected = blocking_hits(&tree, &rays, &options);
    let mut hits = vec![Hit::MISS; rays.len()];
    let (built, asked, idle) = both(
        backend.build_accelerator_async(&mesh, &build),
        tree.closest_hits_async(&rays, &mut hits, &options),
    );
    assert_eq!(built.expect("a tree").tree(), tree.tree());
    asked.expect("hits");
    assert_eq!(bits(&hits), bits(&expected));
    assert!(idle > 0, "the thread was never free");
    // Of one kind, over other rays.
    let (front, back) = rays.split_at(2_000);
    let (mut first, mut second) = (vec![Hit::MISS; front.len()], vec![Hit::MISS; back.len()]);
    let (one, other, _) = both(
        tree.closest_hits_async(front, &mut first, &options),
        tree.closest_hits_async(back, &mut second, &options),
    );
    one.and(other).expect("hits");
    first.extend(second);
    assert_eq!(bits(&first), bits(&expected));
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn what_is_dropped_is_cancelled_and_the_backend_goes_on() {
    let (backend, scene) = (backend(), scene());
    let (mesh, rays, build) = (scene.mesh(), rays(&scene), BuildOptions::default());
    let tree = backend.build_accelerator(&mesh, &build).expect("a tree");
    let options = QueryOptions::default();
    let expected = blocking_hits(&tree, &rays, &options);
    let mut dropped = 0;
    for polls in 1..4 {
        let mut work = Box::pin(backend.build_accelerator_async(&mesh, &build));
        dropped += u32::from((0..polls).all(|_| poll(work.as_mut()).is_pending()));
        drop(work);
        let mut hits = vec![Hit::MISS; rays.len()];
        let mut work = Box::pin(tree.closest_hits_async(&rays, &mut hits, &options));
        dropped += u32::from((0..polls).all(|_| poll(work.as_mut()).is_pending()));
        drop(work);
        let again = backend.build_accelerator(&mesh, &build).expect("a tree");
        assert_eq!(again.tree(), tree.tree(), "after {polls} polls");
        assert_eq!(bits(&blocking_hits(&again, &rays, &options)), bits(&expected));
    }
    assert!(dropped >= 4, "they were done before they were dropped");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_watch_cancels_them() {
    let (backend, scene) = (backend(), scene());
    let (mesh, rays) = (scene.mesh(), rays(&scene));
    let calls = AtomicU32::new(0);
    let third = |_: &Progress| match calls.fetch_add(1, Ordering::Relaxed) {
        0..2 => ControlFlow::Continue(()),
        _ => ControlFlow::Break(()),
    };
    let watched = BuildOptions { watch: Some(&third), ..Default::default() };
    let built = pollster::block_on(backend.build_accelerator_async(&mesh, &watched));
    assert!(matches!(built, Err(BuildError::Cancelled { .. })), "{built:?}");
    let tree = backend.build_accelerator(&mesh, &BuildOptions::default()).expect("a tree");
    let mut hits = vec![Hit::MISS; rays.len()];
    for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
        calls.store(0, Ordering::Relaxed);
        let options = QueryOptions { watch: Some(&third), accuracy, ..Default::default() };
        let asked = pollster::block_on(tree.closest_hits_async(&rays, &mut hits, &options));
        let total = rays.len() as u64;
        assert!(
            matches!(asked, Err(QueryError::Cancelled { total: of, .. }) if of == total),
            "{asked:?}"
        );
    }
    // Unwatched it goes on as before.
    let options = QueryOptions::default();
    pollster::block_on(tree.closest_hits_async(&rays, &mut hits, &options)).expect("hits");
    assert_eq!(bits(&hits), bits(&blocking_hits(&tree, &rays, &options)));
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_lost_device_ends_them_soon() {
    let start = Instant::now();
    let gpu = pollster::block_on(Gpu::open_async(&options())).expect("a device");
    let backend = WgpuBackend::without_selftest(gpu.clone());
    let scene = scene();
    let (mesh, rays, build) = (scene.mesh(), rays(&scene), BuildOptions::default());
    let tree = backend.build_accelerator(&mesh, &build).expect("a tree");
    let mut hits = vec![Hit::MISS; rays.len()];
    let options = QueryOptions::default();
    let mut under_way = Box::pin(tree.closest_hits_async(&rays, &mut hits, &options));
    let first = poll(under_way.as_mut());
    gpu.device().destroy();
    let is_lost =
        |error: &QueryError| matches!(error, QueryError::Device(DeviceError::Lost { .. }));
    if first.is_pending() {
        // What was submitted before may come to its end.
        if let Err(error) = pollster::block_on(under_way.as_mut()) {
            assert!(is_lost(&error), "{error}");
        }
    }
    drop(under_way);
    let asked = pollster::block_on(tree.closest_hits_async(&rays, &mut hits, &options));
    assert!(is_lost(asked.as_ref().expect_err("a lost device")), "{asked:?}");
    let built = pollster::block_on(backend.build_accelerator_async(&mesh, &build));
    assert!(matches!(built, Err(BuildError::Device(DeviceError::Lost { .. }))), "{built:?}");
    let tested = pollster::block_on(WgpuBackend::new_async(gpu));
    assert!(matches!(tested, Err(GpuError::Lost { .. })), "{tested:?}");
    assert!(start.elapsed() < PATIENCE);
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_device_that_takes_too_long_is_an_error() {
    let gpu = Gpu::clone(&common::gpu()).with_timeout(Duration::ZERO);
    let (backend, scene) = (WgpuBackend::without_selftest(gpu), scene());
    let build = BuildOptions::default();
    let built = pollster::block_on(backend.build_accelerator_async(&scene.mesh(), &build));
    let error = built.expect_err("no time at all");
    assert_eq!(error, BuildError::Device(DeviceError::TimedOut { seconds: 0 }));
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn all_hits_and_scenes_are_those_of_the_cpu() {
    let backend = backend();
    let scene = scene();
    let (mesh, rays) = (scene.mesh(), rays(&scene));
    let build = BuildOptions::default();
    let work = can_be_sent(backend.build_accelerator_async(&mesh, &build));
    let tree = pollster::block_on(work).expect("a tree");
    let cpu = CpuBackend::new().build_accelerator(&mesh, &build).expect("a tree");
    let options = AllHitsOptions::default();
    let found = pollster::block_on(can_be_sent(tree.all_hits_async(&rays, &options)));
    let (found, expected) = (found.expect("hits"), cpu.all_hits(&rays, &options).expect("hits"));
    assert!(expected.crossings.len() > 1000);
    assert_eq!((&found.starts, &found.crossings), (&expected.starts, &expected.crossings));
    let ends: &dyn splitplane_core::watch::Watch = &|_: &Progress| ControlFlow::Break(());
    let watched = AllHitsOptions { watch: Some(ends), ..options };
    let ended = tree.all_hits_async(&rays, &watched);
    assert!(matches!(pollster::block_on(ended), Err(QueryError::Cancelled { .. })));

    let mut objects = Objects::new();
    let one = objects.add_mesh(&mesh).expect("a geometry");
    let turned = [[0.0, 1.0, 0.0, 0.5], [-1.0, 0.0, 0.0, 0.25], [0.0, 0.0, 1.0, 0.0]];
    objects.add_instance(Instance::in_place(one)).expect("an instance");
    let moves = objects.add_instance(Instance::new(one, turned)).expect("an instance");
    let work = can_be_sent(backend.build_scene_async(&objects, &build));
    let mut built = pollster::block_on(work).expect("a scene");
    for round in 0..3 {
        let expected = CpuBackend::new().build_scene(&objects, &build).expect("a scene");
        assert_eq!(built.scene().digest(), expected.scene().digest());
        let options = SceneOptions::default();
        assert_eq!(built.needs_cpu(&options), None);
        let mut hits = [SceneHit::MISS; 2].map(|hit| vec![hit; rays.len()]);
        let mut any = [false; 2].map(|hit| vec![hit; rays.len()]);
        let work = can_be_sent(built.closest_hits_async(&rays, &mut hits[0], &options));
        pollster::block_on(work).expect("hits");
        expected.closest_hits(&rays, &mut hits[1], &options).expect("hits");
        let words = |hits: &[SceneHit]| bytemuck::cast_slice::<_, u8>(hits).to_vec();
        assert_eq!(words(&hits[0]), words(&hits[1]), "{round}");
        assert!(hits[0].iter().filter(|hit| hit.is_hit()).count() > 1000);
        let work = can_be_sent(built.any_hits_async(&rays, &mut any[0], &options));
        pollster::block_on(work).expect("hits");
        expected.any_hits(&rays, &mut any[1], &options).expect("hits");
        assert_eq!(any[0], any[1], "{round}");
        // What the device leaves to the CPU would block.
        let exact = SceneOptions { accuracy: Accuracy::Exact, ..options };
        let refused = pollster::block_on(built.any_hits_async(&rays, &mut any[0], &exact));
        assert!(refused.unwrap_err().to_string().contains("without blocking"));
        let more = scenes::soup(500, 0.2, 5);
        match round {
            // An instance moves, then a geometry comes.
            0 => {
                let further = turned.map(|[x, y, z, w]| [x, y, z, w + 0.125]);
                objects.move_instance(moves, further).expect("an instance");
            }
            _ => {
                let other = objects.add_mesh(&more.mesh()).expect("a geometry");
                objects.add_instance(Instance::in_place(other)).expect("an instance");
            }
        }
        let work = can_be_sent(backend.update_scene_async(&mut built, &objects, &build));
        let report = pollster::block_on(work).expect("a scene");
        assert_eq!(report.geometries_built, u32::from(round > 0));
    }
    // Limits and watches hold as elsewhere, and leave the scene as it was.
    let other = objects.add_mesh(&scenes::soup(600, 0.2, 6).mesh()).expect("a geometry");
    objects.add_instance(Instance::in_place(other)).expect("an instance");
    let before = built.scene().digest();
    let small = BuildOptions { max_memory: Some(1000), ..build };
    let refused = pollster::block_on(backend.update_scene_async(&mut built, &objects, &small));
    assert!(matches!(refused, Err(SceneBuildError::Geometry { .. })), "{refused:?}");
    let watched = BuildOptions { watch: Some(ends), ..build };
    let ended = pollster::block_on(backend.update_scene_async(&mut built, &objects, &watched));
    assert!(matches!(ended, Err(SceneBuildError::Cancelled { .. })), "{ended:?}");
    assert_eq!(built.scene().digest(), before);
}
