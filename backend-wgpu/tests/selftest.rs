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

/// A compiler that sees through the barrier is found even where it makes nothing of it.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_folded_barrier_is_seen() {
    let source = splitplane_shaders::find("arithmetic_check").unwrap().source();
    let found = |source: &str| selftest::arithmetic_of(&common::gpu(), source.to_owned()).unwrap();
    assert_eq!(found(&source), None);
    let folded = source.replace("return guard(a - b);", "return a - b;");
    assert_ne!(folded, source);
    let difference = found(&folded).unwrap();
    assert!(difference.starts_with("with a zero of one, difference of "), "{difference}");
    let wrong = source.replace("2u * rest > divisor", "rest > divisor");
    assert_ne!(wrong, source);
    assert!(found(&wrong).unwrap().starts_with("quotient of "));
}
