//! The self-test of a device: that it finds what it must, and nothing on a sound device.

use crate::common;
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

/// A device that flushes more than what is below the least normal number, and a quotient, which is rounded in whole numbers,
/// that is zero where rounding leads to that number. Products that are zero there are let pass: some devices flush before
/// they round.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn flushing_too_much_is_seen() {
    let source = splitplane_shaders::find("arithmetic_check").unwrap().source();
    let found = |from: &str, to: &str| {
        let planted = source.replace(from, to);
        assert_ne!(planted, source);
        selftest::arithmetic_of(&common::gpu(), planted).unwrap()
    };
    // 2^126 times the product tells whether it is below one; factors are scaled up, so that nothing is lost.
    let early = "let up = scale(a, 63) * scale(b, 63);
    return select(guard(a * b), 0.0, abs(up) < 1.0);";
    assert_eq!(found("return guard(a * b);", early), None);
    let more = "let r = guard(a * b); return select(r, 0.0, abs(r) <= LEAST_NORMAL);";
    let difference = found("return guard(a * b);", more).unwrap();
    let place = "around the least normal number, product of ";
    assert!(difference.starts_with(place) && difference.contains("is 0e0"), "{difference}");
    let difference = found(" || up)", ")").unwrap();
    let place = "around the least normal number, quotient of ";
    assert!(difference.starts_with(place) && difference.contains("is 0e0"), "{difference}");
    let late = "let r = guard(a * b); return select(r, 0.0, abs(r) < LEAST_NORMAL);";
    assert_eq!(found("return guard(a * b);", late), None);
}
