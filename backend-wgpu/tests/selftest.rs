//! The self-test of a device: that it finds what it must, and nothing on a sound device.

mod common;

use splitplane_core::backend::BuildOptions;
use splitplane_core::mesh::Mesh;
use splitplane_cpu::CpuBackend;
use splitplane_wgpu::{Gpu, Parity, WgpuBackend, selftest};

/// The digest that the self-test compares with is the CPU's.
#[test]
fn the_small_tree_is_the_cpus() {
    let triangles = selftest::triangles();
    let mesh = Mesh::soup(&triangles).unwrap();
    let (tree, summary) = CpuBackend::new().build_tree(&mesh, &BuildOptions::default()).unwrap();
    assert_eq!(tree.digest(), selftest::DIGEST);
    assert!(summary.large_levels > 5 && tree.nodes.len() > 200, "{summary:?}");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_sound_device_is_bitwise() {
    let backend = WgpuBackend::new(Gpu::clone(&common::gpu())).unwrap();
    assert_eq!(backend.parity(), Some(&Parity::Bitwise));
}
