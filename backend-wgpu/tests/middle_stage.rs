//! The middle stage of a build where it cannot be: void by each of its rules, left out for want of room. The tree is the CPU's all the
//! same, the build says what became of the stage, and the next one knows.

use std::time::{Duration, Instant};

use crate::common::{self, PATIENCE, untested_backend as backend};
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::error::BuildError;
use splitplane_core::kernel::{Buffer, Kernel};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{DeviceBuild, Effort, Gpu, MiddleStage, PendingBuild, WgpuBackend};

/// Scenes and configurations for which the stage is void: by its own rules, and since a cap might bind.
fn void_cases() -> Vec<(&'static str, Scene, BuildConfig)> {
    let default = BuildConfig::default();
    let of_few_references = BuildConfig { clip: false, references_per_triangle: 1, ..default };
    vec![
        ("more than it takes in a node that nothing separates", scenes::identical(4_500), default),
        ("more references than the cap", scenes::soup(12_000, 0.05, 9), of_few_references),
    ]
}

/// A mesh whose builds the stage finishes.
fn finished_case() -> Scene {
    scenes::soup(7_000, 0.03, 9)
}

/// What differs between a build and the CPU's, if anything does.
fn compared(
    backend: &WgpuBackend,
    built: &DeviceBuild,
    scene: &Scene,
    config: BuildConfig,
) -> Result<(), String> {
    let options = BuildOptions::from(config);
    let (expected, summary) =
        CpuBackend::new().build_tree(&scene.mesh(), &options).expect("a tree");
    let tree = built.tree.read(backend.gpu()).map_err(|error| error.to_string())?;
    if tree != expected {
        return Err(format!("another tree: {:?}", tree.digest()));
    }
    let levels = [built.summary.large_levels, summary.large_levels];
    let roots = [built.summary.small_roots, summary.small_roots];
    if levels[0] != levels[1] || roots[0] != roots[1] {
        return Err(format!("{levels:?} levels, {roots:?} small roots"));
    }
    Ok(())
}

/// Polls, and never waits.
fn polled(mut pending: PendingBuild) -> Result<DeviceBuild, BuildError> {
    let start = Instant::now();
    loop {
        if let Some(built) = pending.poll()? {
            return Ok(built);
        }
        assert!(start.elapsed() < PATIENCE, "a build hangs");
        std::thread::sleep(Duration::from_micros(200));
    }
}

#[track_caller]
fn assert_effort(effort: Effort, stage: MiddleStage, what: &str) {
    assert_eq!(effort.middle_stage, stage, "{what}: {effort:?}");
    // Lists may be outgrown besides.
    let repeated = stage == MiddleStage::Void;
    assert_eq!(effort.repeats > 0, repeated, "{what}: {effort:?}");
    // One submission and one readback for each attempt.
    let attempts = 1 + effort.repeats;
    assert_eq!((effort.submissions, effort.readbacks), (attempts, attempts), "{what}: {effort:?}");
}

/// A rule makes a build void, which is then repeated without the stage; the next one is not tried with it, and one of other triangles is.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_void_stage_is_repeated_without_it() {
    let backend = backend();
    let finished = finished_case();
    // Leaves room for the lists of the others.
    let options = BuildOptions::default();
    backend.build_on_device(&finished.mesh(), &options).expect("a build");
    for (what, scene, config) in void_cases() {
        let options = BuildOptions::from(config);
        let mesh = scene.mesh();
        let first = polled(backend.submit_build(&mesh, &options).expect(what)).expect(what);
        assert_effort(first.effort, MiddleStage::Void, what);
        compared(&backend, &first, &scene, config).expect(what);
        let next = backend.build_on_device(&mesh, &options).expect(what);
        assert_effort(next.effort, MiddleStage::KnownVoid, what);
        compared(&backend, &next, &scene, config).expect(what);
    }
    // What was found out is of that mesh and that configuration, and a build that is cancelled before it is known to be void leaves
    // nothing to the next one.
    let (_, scene, config) = void_cases().swap_remove(0);
    backend.submit_build(&scene.mesh(), &config.into()).expect("submitted").cancel();
    let built = backend.build_on_device(&finished.mesh(), &options).expect("a build");
    assert_effort(built.effort, MiddleStage::Finished, "another mesh");
    compared(&backend, &built, &finished, BuildConfig::default()).expect("the CPU's tree");
    // With the tree in host memory as well.
    let built = backend.build_accelerator(&scene.mesh(), &config.into()).expect("a tree");
    let (expected, _) =
        CpuBackend::new().build_tree(&scene.mesh(), &config.into()).expect("a tree");
    assert_eq!(built.tree().digest(), expected.digest());
}

/// A stage that a device makes void though it need not be costs a repeat, and no more. One that a device does not notice to be void is
/// seen here.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_seen() {
    let planted = |kernel: Kernel, from: &str, to: &str| {
        let source = splitplane_shaders::KERNELS[kernel as usize].source();
        assert!(source.contains(from), "{kernel:?}: the text to change is gone");
        let source = source.replace(from, to);
        WgpuBackend::with_replaced_kernel(Gpu::clone(&common::gpu()), kernel, source)
    };
    let finished = finished_case();
    let config = BuildConfig::default();
    let built_by = |backend: &WgpuBackend, scene: &Scene| {
        let built = backend.build_on_device(&scene.mesh(), &config.into());
        built.map(|built| (built.effort, compared(backend, &built, scene, config)))
    };
    let needless = "root.count > 500u";
    let backend = planted(Kernel::BuildMiddle, "root.count > parameters.hand_over_limit", needless);
    let (effort, same) = built_by(&backend, &finished).expect("a build");
    assert_effort(effort, MiddleStage::Void, needless);
    same.expect(needless);
    let (_, scene, _) = void_cases().swap_remove(0);
    let backend = planted(Kernel::ScanMiddle, "if state != 0u ||", "if");
    let unnoticed = built_by(&backend, &scene);
    assert!(!matches!(unnoticed, Ok((_, Ok(())))), "a void stage that is not noticed was not seen");
}

/// Where one binding does not hold the pool, where memory is short, and where planes are found by bins, builds say so.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_stage_that_is_left_out_is_named() {
    let scene = finished_case();
    let mesh = scene.mesh();
    let config = BuildConfig::default();
    // The pool takes 2.8 MB, at the least 1.9, and the triangles 0.25.
    let bound_by = |binding| {
        let [(device, queue), _] = common::host_devices(&wgpu::Limits {
            max_storage_buffer_binding_size: binding,
            ..wgpu::Limits::default()
        });
        WgpuBackend::without_selftest(Gpu::borrow(device, queue))
    };
    let shorter = bound_by(2_000_000);
    let built = shorter.build_on_device(&mesh, &config.into()).expect("a build");
    compared(&shorter, &built, &scene, config).expect("the CPU's tree");
    assert_eq!((built.effort.middle_stage, built.effort.repeats), (MiddleStage::Finished, 0));
    let binding = 1_500_000;
    let short = bound_by(binding);
    for _ in 0..2 {
        let built = short.build_on_device(&mesh, &config.into()).expect("a build");
        compared(&short, &built, &scene, config).expect("the CPU's tree");
        let MiddleStage::TooLong { list, needed, allowed } = built.effort.middle_stage else {
            panic!("{:?}", built.effort);
        };
        assert_eq!((list, allowed), (Buffer::MiddleReferences, binding));
        assert!(needed > allowed && built.effort.repeats == 0, "{:?}", built.effort);
    }

    let backend = backend();
    let whole = backend.build_on_device(&mesh, &config.into()).expect("a build");
    assert_eq!(whole.effort.middle_stage, MiddleStage::Finished);
    // Less and less, until there is too little for the stage, and enough without it.
    let least = (30..100).rev().step_by(5).find_map(|percent| {
        let limit = whole.summary.peak_bytes / 100 * percent;
        let options = BuildOptions { max_memory: Some(limit), ..BuildOptions::from(config) };
        let built = backend.build_on_device(&mesh, &options).expect("a build in less memory");
        compared(&backend, &built, &scene, config).expect("the CPU's tree");
        assert!(built.summary.peak_bytes <= limit);
        match built.effort.middle_stage {
            MiddleStage::OutOfMemory { needed, limit: named } => Some((needed, named, limit)),
            stage => {
                assert_eq!(stage, MiddleStage::Finished);
                None
            }
        }
    });
    let (needed, named, limit) = least.expect("memory that is too short for the stage alone");
    assert!(named == limit && needed > limit, "{needed} {named} {limit}");
    // Enough memory again: nothing was learnt from there having been too little.
    let again = backend.build_on_device(&mesh, &config.into()).expect("a build");
    assert_eq!(again.effort.middle_stage, MiddleStage::Finished);

    let binned = Preset::Balanced.config();
    let built = backend.build_on_device(&mesh, &binned.into()).expect("a build");
    assert_eq!(built.effort.middle_stage, MiddleStage::NotOfConfig);
}
