//! Lists that one storage binding does not hold, on devices with small limits: the same steps, trees and hits.

use crate::common;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::build::lockstep::{Difference, Lockstep, LockstepError};
use splitplane_core::build::schedule;
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::error::{BuildError, DeviceError};
use splitplane_core::kernel::Kernel;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuBackend, CpuExecutor, InstructionSet};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{Gpu, WgpuBackend, WgpuExecutor};

/// A device whose storage bindings hold no more than this many bytes.
fn gpu(binding: u64) -> Gpu {
    let [(device, queue), _] = common::host_devices(&wgpu::Limits {
        max_storage_buffer_binding_size: binding,
        ..wgpu::Limits::default()
    });
    Gpu::borrow(device, queue)
}

/// Small triangles, 36 bytes each, more than [`BINDING`] holds.
fn scene() -> Scene {
    scenes::soup(12_000, 0.01, 41)
}

const BINDING: u64 = 420_000;

/// Runs both executors in step; the number of dispatches that were compared.
fn in_step(
    backend: &WgpuBackend,
    mesh: &Mesh<'_>,
    config: &BuildConfig,
) -> Result<u32, Difference> {
    let set = InstructionSet::detect();
    let cpu: CpuExecutor<'_> =
        CpuExecutor::new(*mesh, *config, set, Buffers::default(), None).expect("memory");
    let run = |gpu: WgpuExecutor<'_>| {
        let mut lockstep = Lockstep::new(cpu, gpu);
        schedule::build(&mut lockstep, config.preset().planes().expect("a schedule"))
            .map(|()| lockstep.dispatches())
    };
    match backend.with_executor(mesh, config, run).expect("a device that holds the scene") {
        Ok(dispatches) => Ok(dispatches),
        Err(LockstepError::Differs(difference)) => Err(difference),
        Err(other) => panic!("{config:?}: {other}"),
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn every_step_is_the_cpus() {
    let backend = WgpuBackend::without_selftest(gpu(BINDING));
    let default = BuildConfig::default();
    for (scene, configs) in [
        (scene(), vec![default, Preset::Balanced.config(), BuildConfig { clip: false, ..default }]),
        // Nodes that nothing separates, and leaves too large to split, some of which lie in both halves.
        (scenes::identical(12_000), vec![BuildConfig { max_depth: 2, ..default }]),
    ] {
        for config in configs {
            if let Err(difference) = in_step(&backend, &scene.mesh(), &config) {
                panic!("{}: {difference}", scene.name);
            }
        }
    }
}

/// A part of a kernel's text by halves, and what a planted fault makes of it.
const PLANTED: [(Kernel, &str, &str); 8] = [
    // References that another dispatch stores.
    (Kernel::ScatterReferences, "place >= first_stored() &&", "place > first_stored() &&"),
    (Kernel::ScatterReferences, "place - first_stored()]", "place]"),
    (Kernel::ScatterReferences, "references[place - select(", "references[place - 0u * select("),
    // Chunks that no dispatch takes.
    (Kernel::ScatterReferences, "first + count > first_stored()", "first > first_stored()"),
    // A root whose references go on in the second half, and roots of it.
    (Kernel::BuildSmall, "root.first + lane - first_seen()", "root.first + lane"),
    (Kernel::BuildSmall, "root.first >= first_seen()", "root.first > first_seen() + 9u"),
    (Kernel::EmitSmall, "root.first < end_seen()", "root.first + 64u < end_seen()"),
    // A leaf too large to split that lies in both halves.
    (Kernel::EmitSmall, "max(root.first, first_seen()) + lane", "root.first + lane"),
];

/// Faults in what is done for halves alone are seen.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_planted_fault_is_seen() {
    let backend = WgpuBackend::without_selftest(gpu(BINDING));
    let default = BuildConfig::default();
    let scenes =
        [(scene(), default), (scenes::identical(12_000), BuildConfig { max_depth: 2, ..default })];
    for (kernel, from, to) in PLANTED {
        let shader = &splitplane_shaders::KERNELS[kernel as usize];
        let source = splitplane_shaders::join(&splitplane_shaders::parts_by_halves(shader));
        assert!(source.contains(from), "{from}");
        let planted = source.replacen(from, to, 1);
        backend.replace_kernel(kernel, Some(planted));
        let seen = |(scene, config): &(Scene, BuildConfig)| {
            in_step(&backend, &scene.mesh(), config).is_err()
        };
        assert!(scenes.iter().any(seen), "{kernel:?}: {to}");
        backend.replace_kernel(kernel, None);
    }
}

#[track_caller]
fn same_tree(backend: &WgpuBackend, scene: &Scene, config: BuildConfig) -> u32 {
    let options = BuildOptions::from(config);
    let (expected, _) = CpuBackend::new().build_tree(&scene.mesh(), &options).expect("a tree");
    let built = backend.build_on_device(&scene.mesh(), &options).expect("a build");
    let tree = built.tree.read(backend.gpu()).expect("a tree in host memory");
    assert!(tree == expected, "{}: another tree", scene.name);
    let binding = backend.gpu().limits().max_storage_buffer_binding_size;
    let in_one = 36 * u64::from(expected.triangles) <= binding;
    assert_eq!(built.tree.check_one_binding(backend.gpu()).is_ok(), in_one, "{}", scene.name);
    backend.recycle(built.tree);
    built.effort.repeats
}

/// Long and short scenes by turns, and the buffers of one used by the next.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn long_and_short_scenes_share_buffers() {
    let backend = WgpuBackend::without_selftest(gpu(BINDING));
    let (long, short) = (scene(), scenes::soup(700, 0.1, 43));
    for config in [BuildConfig::default(), Preset::Balanced.config()] {
        for scene in [&short, &long, &short, &long, &long] {
            same_tree(&backend, scene, config);
        }
    }
}

/// Triangles that one binding holds, with more references than it holds: that turns out in the middle.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn lists_outgrow_one_binding() {
    let backend = WgpuBackend::without_selftest(gpu(160_000));
    let scene = scenes::soup(3_000, 0.08, 44);
    assert!(same_tree(&backend, &scene, BuildConfig::default()) > 0);
    // The next build knows.
    assert_eq!(same_tree(&backend, &scene, BuildConfig::default()), 0);
}

/// What two bindings do not hold is refused by name, and nothing is lost.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn what_two_bindings_do_not_hold_is_refused() {
    let backend = WgpuBackend::without_selftest(gpu(BINDING));
    let scene = scenes::soup(24_000, 0.001, 45);
    let refused = backend.build_on_device(&scene.mesh(), &BuildOptions::default());
    match refused.map(|built| built.summary) {
        Err(BuildError::Device(DeviceError::Limit { what, limit, needed, allowed })) => {
            assert!(what.contains("Triangles"), "{what}");
            assert_eq!(limit, "max_storage_buffer_binding_size");
            assert_eq!(needed, 24_000 * 36);
            assert!(BINDING < allowed && allowed < 2 * BINDING);
        }
        other => panic!("{other:?}"),
    }
    same_tree(&backend, &self::scene(), BuildConfig::default());
}

/// Rays through triangles in two bindings, those that the lean kernel defers among them.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn hits_are_the_cpus() {
    let backend = WgpuBackend::without_selftest(gpu(BINDING));
    let scene = scene();
    let mesh = scene.mesh();
    let on_cpu = CpuBackend::new().build(&mesh, &BuildOptions::default()).expect("a tree");
    let built = backend.build(&mesh, &BuildOptions::default()).expect("a tree");
    let kinds = [Kind::Faces, Kind::Edges, Kind::Random];
    let rays: Vec<Ray> = (0..).zip(kinds).flat_map(|(i, k)| aim::rays(&mesh, k, 700, i)).collect();
    for accuracy in [Accuracy::Watertight, Accuracy::Fast] {
        let options = QueryOptions { accuracy, ..QueryOptions::default() };
        let mut hits = [(); 2].map(|()| vec![Hit::MISS; rays.len()]);
        let mut any = [(); 2].map(|()| vec![false; rays.len()]);
        for (place, accelerator) in [&on_cpu, &built].into_iter().enumerate() {
            accelerator.closest_hits(&rays, &mut hits[place], &options).expect("hits");
            accelerator.any_hits(&rays, &mut any[place], &options).expect("hits");
        }
        if accuracy == Accuracy::Watertight {
            assert!(hits[0] == hits[1] && any[0] == any[1]);
        }
        // What is met on an edge, rounding decides: with accuracy `fast` each device as it may.
        let edges = if accuracy == Accuracy::Fast { 700..1400 } else { 0..0 };
        let sure = || (0..rays.len()).filter(|i| !edges.contains(i));
        let same = sure().filter(|&i| hits[0][i].triangle == hits[1][i].triangle).count();
        assert!(100 * same >= 99 * sure().count(), "{same} of {}", sure().count());
        // Both halves are hit.
        let middle = mesh.len() as u32 / 2;
        for second in [false, true] {
            let is_there = |hit: &&Hit| hit.is_hit() && (hit.triangle >= middle) == second;
            assert!(hits[1].iter().filter(is_there).count() > 100);
        }
    }
}

/// A shader of a host has one binding for the triangles; whether it holds them can be asked.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn one_binding_can_be_asked_for() {
    let backend = WgpuBackend::without_selftest(gpu(BINDING));
    for (scene, holds) in [(scene(), false), (scenes::soup(700, 0.1, 43), true)] {
        let built =
            backend.build_on_device(&scene.mesh(), &BuildOptions::default()).expect("a build");
        assert_eq!(built.tree.check_one_binding(backend.gpu()).is_ok(), holds);
    }
}
