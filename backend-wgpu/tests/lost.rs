//! A device that goes away, or takes too long, in the middle of the backend's work: always an error
//! that says so, soon, and never a wrong answer.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use crate::common::{self, PATIENCE, own_gpu};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::error::{BuildError, DeviceError, QueryError};
use splitplane_core::kernel::Kernel;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::report::QueryReport;
use splitplane_core::tree::KdTree;
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{DeviceQueryError, Gpu, GpuError, Parity, Queries, WgpuBackend};

/// A device that a test may destroy: an own one, and one of a host, whose loss nobody reports.
fn devices() -> [Gpu; 2] {
    let [(device, queue), _] = common::host_devices(&wgpu::Limits::default());
    [own_gpu(), Gpu::borrow(device, queue)]
}

fn backends() -> [WgpuBackend; 2] {
    devices().map(|gpu| WgpuBackend::new(gpu).expect("a backend"))
}

/// Runs `work` in a thread of its own; fails instead of hanging.
fn within<T: Send + 'static>(what: &str, work: impl FnOnce() -> T + Send + 'static) -> T {
    let thread = thread::spawn(work);
    let start = Instant::now();
    while !thread.is_finished() {
        assert!(start.elapsed() < PATIENCE, "{what} hangs");
        thread::sleep(Duration::from_millis(1));
    }
    match thread.join() {
        Ok(out) => out,
        Err(panic) => std::panic::resume_unwind(panic),
    }
}

#[track_caller]
fn assert_build_lost<T>(result: Result<T, BuildError>, what: &str) {
    match result {
        Err(BuildError::Device(DeviceError::Lost { .. })) => {}
        Err(other) => panic!("{what}: {other:?}"),
        Ok(_) => panic!("{what}: a build on a lost device"),
    }
}

/// A query on a lost device.
#[track_caller]
fn assert_query_lost(result: &Result<QueryReport, QueryError>, what: &str) {
    assert!(
        matches!(result, Err(QueryError::Device(DeviceError::Lost { .. }))),
        "{what}: {result:?}"
    );
}

fn scene() -> Scene {
    scenes::soup(4_000, 0.1, 51)
}

fn on_the_cpu(scene: &Scene) -> CpuAccelerator {
    CpuBackend::new().build_accelerator(&scene.mesh(), &BuildOptions::default()).expect("a tree")
}

fn rays(scene: &Scene, count: usize) -> Vec<Ray> {
    let some = aim::rays(&scene.mesh(), Kind::Faces, count.min(5_000), 52);
    some.iter().copied().cycle().take(count).collect()
}

/// Hits that the CPU finds.
fn reference(scene: &Scene, rays: &[Ray]) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    on_the_cpu(scene).closest_hits(rays, &mut hits, &QueryOptions::default()).expect("hits");
    hits
}

#[track_caller]
fn assert_same(found: &[Hit], expected: &[Hit], what: &str) {
    let [found, expected]: [&[u8]; 2] = [found, expected].map(bytemuck::cast_slice);
    assert!(found == expected, "{what}: other hits than the CPU's");
}

/// Single rays are answered from the host's copy, whatever became of the device.
#[track_caller]
fn assert_single_rays(accelerator: &dyn Accelerator, rays: &[Ray], expected: &[Hit]) {
    let options = QueryOptions::default();
    for (ray, hit) in rays.iter().zip(expected).take(200) {
        assert_eq!(accelerator.closest_hit(ray, &options), hit.some());
        assert_eq!(accelerator.any_hit(ray, &options), hit.is_hit());
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn before_anything_is_asked_of_it() {
    for gpu in devices() {
        gpu.device().destroy();
        let opened = within("opening", move || WgpuBackend::new(gpu));
        assert!(matches!(opened, Err(GpuError::Lost { .. })), "{opened:?}");
    }
    // Kernels compiled or not, buffers pooled or not.
    let unused = backends().map(|backend| (backend, false));
    let used = backends().map(|backend| (backend, true));
    for (backend, used) in unused.into_iter().chain(used) {
        let scene = scene();
        if used {
            backend.build_on_device(&scene.mesh(), &BuildOptions::default()).expect("a tree");
        }
        backend.gpu().device().destroy();
        within("building", move || {
            let (mesh, options) = (scene.mesh(), BuildOptions::default());
            assert_build_lost(Backend::build(&backend, &mesh, &options), "build");
            assert_build_lost(backend.build_on_device(&mesh, &options), "build_on_device");
            assert_build_lost(backend.submit_build(&mesh, &options), "submit_build");
            assert_build_lost(backend.build_profiled(&mesh, &options), "build_profiled");
            let tree = on_the_cpu(&scene).tree().clone();
            assert_build_lost(backend.load(&mesh, tree, &options.for_loading()), "load");
            let empty = scenes::none();
            assert_build_lost(Backend::build(&backend, &empty.mesh(), &options), "nothing");
            // Only the device is asked.
            assert_eq!(backend.describe().name, "wgpu");
        });
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn between_submitting_a_build_and_asking_for_it() {
    for backend in backends() {
        let scene = scenes::soup(30_000, 0.02, 53);
        let options = BuildOptions::default();
        let mut polled = backend.submit_build(&scene.mesh(), &options).expect("submitted");
        let mut waited = backend.submit_build(&scene.mesh(), &options).expect("submitted");
        let dropped = backend.submit_build(&scene.mesh(), &options).expect("submitted");
        backend.gpu().device().destroy();
        drop(dropped);
        within("polling and waiting", move || {
            // At once, and again.
            assert_build_lost(polled.poll(), "poll");
            assert_build_lost(polled.poll(), "poll again");
            assert_build_lost(waited.wait(), "wait");
        });
    }
}

/// The build may be done before the loss; then its tree is right as far as it is in host memory.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn while_a_build_is_waited_for() {
    let scene = Arc::new(scenes::soup(20_000, 0.02, 54));
    let expected: KdTree = on_the_cpu(&scene).tree().clone();
    for (turn, backend) in backends().into_iter().chain(backends()).enumerate() {
        let device = backend.gpu().device().clone();
        let built = {
            let scene = Arc::clone(&scene);
            let build = thread::spawn(move || {
                let built = Backend::build(&backend, &scene.mesh(), &BuildOptions::default());
                (backend, built)
            });
            thread::sleep(Duration::from_millis(60 * turn as u64));
            device.destroy();
            within("building", move || build.join().expect("no panic"))
        };
        match built {
            (_, Ok(built)) => {
                assert!(*built.tree() == expected, "a wrong tree instead of an error");
                let mut hits = [Hit::MISS];
                let ray = Ray::new([0.5; 3], [1.0, 0.0, 0.0]);
                let query = built.closest_hits(&[ray], &mut hits, &QueryOptions::default());
                assert_query_lost(&query, "a batch after the loss");
            }
            (backend, Err(error)) => {
                assert_build_lost::<()>(Err(error), "while building");
                assert_build_lost(
                    Backend::build(&backend, &scene.mesh(), &BuildOptions::default()),
                    "afterwards",
                );
            }
        }
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn between_batches() {
    let scene = scene();
    let rays = rays(&scene, 3_000);
    let expected = reference(&scene, &rays);
    for backend in backends() {
        let built = Backend::build(&backend, &scene.mesh(), &BuildOptions::default()).unwrap();
        let options = QueryOptions::default();
        let mut hits = vec![Hit::MISS; rays.len()];
        built.closest_hits(&rays, &mut hits, &options).expect("hits");
        assert_same(&hits, &expected, "before the loss");
        backend.gpu().device().destroy();
        let (rays, expected) = (rays.clone(), expected.clone());
        within("asking a lost device", move || {
            for _ in 0..2 {
                let mut hits = vec![Hit::MISS; rays.len()];
                assert_query_lost(&built.closest_hits(&rays, &mut hits, &options), "closest hits");
                let mut occluded = vec![false; rays.len()];
                assert_query_lost(&built.any_hits(&rays, &mut occluded, &options), "any hits");
                assert_single_rays(&*built, &rays, &expected);
            }
            assert_build_lost(
                Backend::build(&backend, &scenes::one().mesh(), &BuildOptions::default()),
                "a build after the loss",
            );
        });
    }
}

/// A batch of many slices, and a loss somewhere within.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn in_the_middle_of_a_batch() {
    let scene = scene();
    let rays = Arc::new(rays(&scene, 300_000));
    let expected = Arc::new(reference(&scene, &rays));
    let mut losses = 0;
    // From a loss at once to one that a fast device no longer notices.
    for (turn, backend) in backends().into_iter().chain(backends()).enumerate() {
        let built = backend.build_accelerator(&scene.mesh(), &BuildOptions::default()).unwrap();
        let device = backend.gpu().device().clone();
        let query = {
            let (rays, expected) = (Arc::clone(&rays), Arc::clone(&expected));
            thread::spawn(move || {
                let mut hits = vec![Hit::MISS; rays.len()];
                let query = built.closest_hits(&rays, &mut hits, &QueryOptions::default());
                if query.is_ok() {
                    assert_same(&hits, &expected, "a batch that was faster than the loss");
                }
                assert_single_rays(&built, &rays, &expected);
                // Now it is known in any case.
                let again = built.closest_hits(&rays, &mut hits, &QueryOptions::default());
                (query, again)
            })
        };
        thread::sleep(Duration::from_millis(3 + 40 * (turn as u64 / 2)));
        device.destroy();
        let (query, again) = within("a batch", move || query.join().expect("no panic"));
        if query.is_err() {
            assert_query_lost(&query, "the batch");
            losses += 1;
        }
        assert_query_lost(&again, "the batch after it");
    }
    // The first loss comes at once; no device traces this many rays before it.
    assert!(losses > 0);
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn while_threads_build_and_ask() {
    let scene = Arc::new(scenes::soup(2_000, 0.1, 55));
    let rays = Arc::new(rays(&scene, 1_000));
    let expected = Arc::new(reference(&scene, &rays));
    for backend in backends() {
        let backend = Arc::new(backend);
        let device = backend.gpu().device().clone();
        let threads: Vec<_> = (0..3)
            .map(|_| {
                let (backend, scene) = (Arc::clone(&backend), Arc::clone(&scene));
                let (rays, expected) = (Arc::clone(&rays), Arc::clone(&expected));
                thread::spawn(move || {
                    // Until the device is gone.
                    loop {
                        let built = match Backend::build(
                            &*backend,
                            &scene.mesh(),
                            &BuildOptions::default(),
                        ) {
                            Ok(built) => built,
                            lost => return assert_build_lost(lost, "a build"),
                        };
                        let mut hits = vec![Hit::MISS; rays.len()];
                        let query = built.closest_hits(&rays, &mut hits, &QueryOptions::default());
                        if query.is_err() {
                            assert_query_lost(&query, "a batch");
                            return assert_single_rays(&*built, &rays, &expected);
                        }
                        assert_same(&hits, &expected, "before the loss");
                    }
                })
            })
            .collect();
        thread::sleep(Duration::from_millis(300));
        device.destroy();
        for thread in threads {
            within("a thread", move || thread.join().expect("no panic"));
        }
    }
}

/// A backend that does not wait: what it was asked for fails, is not used again by mistake, and
/// nothing is lost but the answer.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_device_that_takes_too_long() {
    let kernel = Kernel::EmitTop;
    let source = splitplane_shaders::KERNELS[kernel as usize].source();
    let (large, small) = (scenes::soup(20_000, 0.01, 56), scene());
    let options = BuildOptions::default();
    let rays = rays(&small, 6_000);
    let expected = reference(&small, &rays);
    for gpu in devices() {
        let hasty = Gpu::clone(&gpu).with_timeout(Duration::ZERO);
        // Opening it takes a self-test, which is over too soon to be done.
        match WgpuBackend::new(hasty.clone()) {
            Err(GpuError::TimedOut { seconds: 0 }) => {}
            Ok(_) => println!("note: a self-test in no time"),
            Err(other) => panic!("{other}"),
        }
        let backend = WgpuBackend::with_replaced_kernel(hasty, kernel, source.clone());
        let patient = Arc::new(gpu.clone());
        let mut timed_out = 0;
        for round in 0..2 {
            match backend.build_on_device(&large.mesh(), &options) {
                Err(BuildError::Device(DeviceError::TimedOut { seconds: 0 })) => timed_out += 1,
                Err(other) => panic!("{other:?}"),
                Ok(built) => {
                    let tree = built.tree.read(&patient).expect("a tree");
                    assert!(tree == *on_the_cpu(&large).tree());
                }
            }
            // The build that timed out may be under way still. Polling needs no patience.
            let mut pending = backend.submit_build(&small.mesh(), &options).expect("submitted");
            let start = Instant::now();
            let built = loop {
                match pending.poll() {
                    Ok(Some(built)) => break built,
                    Ok(None) => assert!(start.elapsed() < PATIENCE, "the build hangs"),
                    Err(error) => panic!("{error}"),
                }
                thread::sleep(Duration::from_micros(200));
            };
            let tree = built.tree.read(&patient).expect("a tree");
            assert!(tree == *on_the_cpu(&small).tree(), "round {round}");
            // Rays too: the batch that timed out is under way when the next one comes.
            let mut hits = vec![Hit::MISS; rays.len()];
            let query = QueryOptions::default();
            match backend.queries().closest_hits(&built.tree, &rays, &mut hits, &query) {
                Err(DeviceQueryError::Gpu(GpuError::TimedOut { seconds: 0 })) => timed_out += 1,
                Err(other) => panic!("{other}"),
                Ok(()) => assert_same(&hits, &expected, "in no time"),
            }
            let queries = Queries::new(Arc::clone(&patient));
            let mut hits = vec![Hit::MISS; rays.len()];
            queries.closest_hits(&built.tree, &rays, &mut hits, &query).expect("hits");
            assert_same(&hits, &expected, "with patience");
        }
        assert!(timed_out > 0, "nothing took any time");
        // The device is sound, and so is a backend with patience.
        let backend = WgpuBackend::new(gpu).expect("a backend");
        assert!(backend.parity().is_some_and(Parity::is_bitwise));
        let built = backend.build_on_device(&large.mesh(), &options).expect("a tree");
        assert!(built.tree.read(&patient).expect("a tree") == *on_the_cpu(&large).tree());
    }
}
