//! The GPU held to the reference builder of the core: equal live buffers after every dispatch.

use crate::common;
use splitplane_core::build::lockstep::{Difference, Inspect, Lockstep, LockstepError};
use splitplane_core::build::reference::kernels::is_of_middle_stage;
use splitplane_core::build::reference::{Budget, ReferenceExecutor};
use splitplane_core::build::schedule;
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::error::BuildError;
use splitplane_core::kernel::{Kernel, TreeBuilder};
use splitplane_core::mesh::Mesh;
use splitplane_test_support::configs::with_builder_of;
use splitplane_test_support::scenes;
use splitplane_test_support::wrong_kernel::{FAULTS, WrongKernel};
use splitplane_wgpu::{Gpu, WgpuBackend, WgpuExecutor};

/// Runs an executor in step with the device's, both with the middle stage or without it; the number of dispatches that were
/// compared.
fn in_step(
    backend: &WgpuBackend,
    mesh: &Mesh<'_>,
    config: &BuildConfig,
    middle: bool,
    first: impl Inspect<TreeBuilder, Error = BuildError>,
) -> Result<u32, Difference> {
    let run = |gpu: WgpuExecutor<'_>| {
        let mut lockstep = Lockstep::new(first, gpu);
        schedule::build(&mut lockstep, config.preset().planes().expect("a schedule"))
            .map(|()| lockstep.dispatches())
    };
    let ran = match middle {
        true => backend.with_middle_executor(mesh, config, run),
        false => backend.with_executor(mesh, config, run),
    };
    match ran.expect("a device that holds the scene") {
        Ok(dispatches) => Ok(dispatches),
        Err(LockstepError::Differs(difference)) => Err(difference),
        Err(other) => panic!("{config:?}: {other}"),
    }
}

fn reference_of<'a>(mesh: &Mesh<'a>, config: &BuildConfig) -> ReferenceExecutor<'a> {
    ReferenceExecutor::in_arithmetic(*mesh, *config, Budget::default())
        .expect("a valid configuration")
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_gpu_leaves_what_the_reference_leaves() {
    let backend = WgpuBackend::without_selftest(Gpu::clone(&common::gpu()));
    let capped =
        BuildConfig { block_width: 1, references_per_triangle: 1, ..BuildConfig::default() }
            .with_stages(|stages| {
                stages.small_node_limit = 2;
                stages.nodes_per_triangle = 1;
            });
    let shallow = BuildConfig { max_depth: 5, ..BuildConfig::default() }
        .with_stages(|stages| stages.empty_cutoff = 1);
    let whole = BuildConfig { clip: false, ..Preset::Balanced.config() }.with_bins(7);
    let default = BuildConfig::default();
    let runs = [
        (scenes::none(), default),
        (scenes::one(), default),
        (scenes::bad_vertices(), default),
        (scenes::zeros_and_subnormals(), default),
        (scenes::coplanar(1, 500), default),
        (scenes::identical(1_500), default),
        (scenes::fan(2_500), shallow),
        (scenes::soup(3_000, 0.3, 44), whole),
        (scenes::soup(8_000, 0.1, 3), capped),
    ];
    for (scene, config) in runs {
        for preset in [Preset::Fast, Preset::Balanced] {
            let (mesh, config) = (scene.mesh(), with_builder_of(preset, config));
            for middle in [false, true] {
                let reference = reference_of(&mesh, &config);
                let reference = if middle { reference.with_middle_stage() } else { reference };
                match in_step(&backend, &mesh, &config, middle, reference) {
                    // Three kernels begin a build and five end it.
                    Ok(dispatches) => assert!(dispatches >= 8, "{}", scene.name),
                    Err(difference) => panic!("{}: {difference}", scene.name),
                }
            }
        }
    }
}

/// A fault in the reference's kernels is found against the device, too.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_named() {
    let backend = WgpuBackend::without_selftest(Gpu::clone(&common::gpu()));
    let scene = scenes::zeros_and_subnormals().joined(&scenes::soup(1_000, 0.4, 9), "faults");
    // Triangles small enough for the middle stage to finish.
    let small = scenes::soup(12_000, 0.03, 9);
    for &(kernel, what, fault) in FAULTS {
        let middle = is_of_middle_stage(kernel);
        let mesh = if middle { small.mesh() } else { scene.mesh() };
        let preset = match kernel {
            Kernel::NodeBounds | Kernel::BinReferences | Kernel::SplitBinned => Preset::Balanced,
            _ => Preset::Fast,
        };
        let config = preset.config();
        let reference = reference_of(&mesh, &config);
        let reference = if middle { reference.with_middle_stage() } else { reference };
        let wrong = WrongKernel::new(reference, kernel, fault);
        let difference = in_step(&backend, &mesh, &config, middle, wrong).expect_err(what);
        assert_eq!(difference.kernel, format!("{kernel:?}"), "{what}: {difference}");
    }
}
