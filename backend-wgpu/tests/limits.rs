//! Builds and batches on a device end when their watch cancels them, and everything stays usable.

use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;

use crate::common;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, LoadOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::error::{BuildError, QueryError};
use splitplane_core::query::all_hits::AllHitsOptions;
use splitplane_core::query::inside::LocateOptions;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions};
use splitplane_core::watch::{Progress, Stage, Watch};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::scenes;
use splitplane_wgpu::WgpuBackend;

/// Ends the work at one of its calls.
struct Ends {
    at: usize,
    calls: AtomicUsize,
}

impl Ends {
    fn at(at: usize) -> Ends {
        Ends { at, calls: AtomicUsize::new(0) }
    }
}

impl Watch for Ends {
    fn progress(&self, _progress: &Progress) -> ControlFlow<()> {
        let call = self.calls.fetch_add(1, Relaxed) + 1;
        assert!(call <= self.at, "called after the end");
        if call == self.at { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// Keeps the reported number of finished rays.
struct DoneCounts(Mutex<Vec<u64>>);

impl Watch for DoneCounts {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        self.0.try_lock().unwrap().push(progress.done);
        ControlFlow::Continue(())
    }
}

/// Ends the work at its 1st, 2nd, 4th call and so on until it is done before that; gives how often it did.
fn ends_anywhere<T, E: std::fmt::Debug>(
    work: impl Fn(&dyn Watch) -> Result<T, E>,
    cancelled: impl Fn(&E) -> bool,
) -> usize {
    for doubled in 0.. {
        let watch = Ends::at(1 << doubled);
        let result = work(&watch);
        if watch.calls.load(Relaxed) < watch.at {
            assert!(result.is_ok());
            return doubled;
        }
        match result {
            Ok(_) => panic!("call {} ended nothing", watch.at),
            Err(error) => assert!(cancelled(&error), "{error:?}"),
        }
    }
    0
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn builds_end_at_any_call_and_the_next_one_is_whole() {
    let backend = WgpuBackend::without_selftest((*common::gpu()).clone());
    let (small, large) = (scenes::soup(300, 0.1, 3), scenes::soup(6_000, 0.05, 4));
    for config in [BuildConfig::default(), Preset::Balanced.config()] {
        let options = BuildOptions::from(config);
        for scene in [&large, &small, &large] {
            let mesh = scene.mesh();
            let expected = CpuBackend::new().build_tree(&mesh, &options).unwrap().0;
            let cancelled = |error: &BuildError| {
                let BuildError::Cancelled { progress } = error else { return false };
                matches!(progress.stage, Stage::Start | Stage::Device)
            };
            let build = |watch: &dyn Watch| {
                let built = backend
                    .build_accelerator(&mesh, &BuildOptions { watch: Some(watch), ..options })?;
                assert_eq!(*built.tree(), expected);
                Ok(built)
            };
            assert!(ends_anywhere(build, cancelled) >= 2);
            // The cancelled build follows this in the queue, in the same buffers.
            assert_eq!(*backend.build_accelerator(&mesh, &options).unwrap().tree(), expected);
            let load = |watch: &dyn Watch| {
                backend.load(
                    &mesh,
                    expected.clone(),
                    &LoadOptions { watch: Some(watch), ..options.for_loading() },
                )
            };
            assert!(ends_anywhere(load, cancelled) >= 2);
        }
    }
    // Given up without waiting, and dropped.
    let mesh = large.mesh();
    let options = BuildOptions::default();
    let expected = CpuBackend::new().build_tree(&mesh, &options).unwrap().0.digest();
    for _ in 0..5 {
        backend.submit_build(&mesh, &options).unwrap().cancel();
        drop(backend.submit_build(&mesh, &options).unwrap());
    }
    let built = backend.build_accelerator(&mesh, &options).unwrap();
    assert_eq!(built.tree().digest(), expected);
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn batches_end_at_any_call_and_the_next_one_is_whole() {
    let backend = WgpuBackend::without_selftest((*common::gpu()).clone());
    let scene = scenes::soup(500, 0.2, 5);
    let mesh = scene.mesh();
    let built = backend.build(&mesh, &BuildOptions::default()).unwrap();
    let on_cpu = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    let rays = aim::rays(&mesh, Kind::Random, 10_000, 6);
    let options = QueryOptions::default();
    let cancelled = |error: &QueryError| matches!(error, QueryError::Cancelled { done, total: 10_000 } if *done <= 10_000);
    let mut expected = vec![Hit::MISS; rays.len()];
    on_cpu.closest_hits(&rays, &mut expected, &options).unwrap();
    let closest = |watch: &dyn Watch| {
        let mut hits = vec![Hit::MISS; rays.len()];
        built.closest_hits(&rays, &mut hits, &QueryOptions { watch: Some(watch), ..options })?;
        assert!(hits == expected);
        Ok(())
    };
    assert!(ends_anywhere(closest, cancelled) >= 2);
    let any = |watch: &dyn Watch| {
        let mut hits = vec![false; rays.len()];
        built.any_hits(&rays, &mut hits, &QueryOptions { watch: Some(watch), ..options })?;
        assert!(hits.iter().zip(&expected).all(|(any, hit)| *any == hit.is_hit()));
        Ok(())
    };
    assert!(ends_anywhere(any, cancelled) >= 2);
    // The host makes answers exact in the end: the reported progress never falls, and is true.
    let exactly = QueryOptions { accuracy: Accuracy::Exact, ..options };
    on_cpu.closest_hits(&rays, &mut expected, &exactly).unwrap();
    let closest = |watch: &dyn Watch| {
        let mut hits = vec![Hit::MISS; rays.len()];
        built.closest_hits(&rays, &mut hits, &QueryOptions { watch: Some(watch), ..exactly })?;
        assert!(hits == expected);
        Ok(())
    };
    assert!(ends_anywhere(closest, cancelled) >= 2);
    let any = |watch: &dyn Watch| {
        let mut hits = vec![false; rays.len()];
        built.any_hits(&rays, &mut hits, &QueryOptions { watch: Some(watch), ..exactly })?;
        assert!(hits.iter().zip(&expected).all(|(any, hit)| *any == hit.is_hit()));
        Ok(())
    };
    assert!(ends_anywhere(any, cancelled) >= 2);
    let told = DoneCounts(Mutex::default());
    let mut hits = vec![Hit::MISS; rays.len()];
    built.closest_hits(&rays, &mut hits, &QueryOptions { watch: Some(&told), ..exactly }).unwrap();
    let told = told.0.into_inner().unwrap();
    assert_eq!((told[0], told[told.len() - 1]), (0, 10_000));
    assert!(told[..told.len() - 1].iter().all(|done| *done == 0), "one slice");
    // Without parity all hits come from the host's copy, and the report says so.
    let all = |watch: &dyn Watch| {
        built.all_hits(&rays, &AllHitsOptions { watch: Some(watch), ..Default::default() })
    };
    assert!(ends_anywhere(all, cancelled) >= 4);
    let options = AllHitsOptions::default();
    let all = built.all_hits(&rays, &options).unwrap();
    assert_eq!(all.report.answered_by_cpu, 10_000);
    let on_host = on_cpu.all_hits(&rays, &options).unwrap();
    assert!(all.crossings == on_host.crossings && all.starts == on_host.starts);
    let little = AllHitsOptions { max_memory: Some(90_000), ..options };
    let error = built.all_hits(&rays, &little).unwrap_err();
    assert!(matches!(error, QueryError::OutOfMemory { needed, limit: 90_000 } if needed > 90_000));
    let points: Vec<[f32; 3]> = rays[..64].iter().map(|ray| ray.origin).collect();
    let located = built.locate(&points, &LocateOptions::default()).unwrap();
    assert_eq!(located.report.answered_by_cpu, 64);
    assert_eq!(
        located.windings,
        on_cpu.locate(&points, &LocateOptions::default()).unwrap().windings
    );
}
