//! The comparison of CPU and GPU that the program offers: what it finds equal, what it names, and what it
//! does not count.

use crate::device;
use splitplane::parity::{self, Comparison};
use splitplane::verify;
use splitplane_core::backend::BuildOptions;
use splitplane_core::config::Preset;
use splitplane_core::kernel::Kernel;
use splitplane_core::ray::QueryOptions;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{Effort, Gpu, WgpuBackend};

fn compare(backend: &WgpuBackend, scene: &Scene, rays: u64) -> Comparison {
    let (options, query) = (BuildOptions::default(), QueryOptions::default());
    let rays = verify::rays(&scene.mesh(), rays);
    let found = parity::compare(backend, &scene.mesh(), &options, &rays, &query, &|_| ());
    found.unwrap_or_else(|error| panic!("{}: {error}", scene.name))
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_sound_device_is_equal() {
    let backend = WgpuBackend::without_selftest(Gpu::clone(&device::gpu()));
    let found = compare(&backend, &scenes::soup(3000, 0.4, 9), 1000);
    assert!(found.is_bitwise(), "{found:?}");
    assert_eq!((found.rays, found.unequal, found.unfinished), (3000, 0, 0));
    assert!(found.dispatches > 20, "{found:?}");
    let Effort { submissions, readbacks, repeats, .. } = found.effort;
    assert_eq!((submissions, readbacks), (repeats + 1, repeats + 1));
    assert_eq!((found.difference, found.first_unequal), (None, None));
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_planted_fault_is_named() {
    let kernel = Kernel::EmitSmall;
    let source = splitplane_shaders::KERNELS[kernel as usize].source();
    let place = "leaf_references[address.y + index] = triangle;";
    let planted = source.replace(place, "leaf_references[address.y + index] = triangle ^ 1u;");
    assert!(planted != source, "the text to change is gone");
    let gpu = Gpu::clone(&device::gpu());
    let backend = WgpuBackend::with_replaced_kernel(gpu, kernel, planted);
    let found = compare(&backend, &scenes::soup(3000, 0.4, 9), 100);
    assert!(!found.is_bitwise());
    assert_ne!(found.digests[0], found.digests[1]);
    let difference = found.difference.expect("a difference");
    assert_eq!((&*difference.kernel, &*difference.buffer), ("EmitSmall", "LeafReferences"));
    assert_ne!(difference.first, difference.second);
    let words = difference.to_string();
    for part in ["EmitSmall", "LeafReferences", &difference.index.to_string()] {
        assert!(words.contains(part), "{words}");
    }
}

/// llvmpipe ends loops after 65,535 rounds, so that a leaf of more triangles is not traced to its end.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn unfinished_rays_are_counted_and_not_compared() {
    let backend = WgpuBackend::without_selftest(Gpu::clone(&device::gpu()));
    let found = compare(&backend, &scenes::identical(70_000), 4);
    assert!(found.is_bitwise(), "{found:?}");
    if device::is_llvmpipe() {
        assert!(found.unfinished > 0, "{found:?}");
    } else {
        assert_eq!(found.unfinished, 0);
    }
}

/// The preset `best` is built on the CPU alone: there is nothing to compare.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_preset_of_the_cpu_is_refused() {
    let backend = WgpuBackend::without_selftest(Gpu::clone(&device::gpu()));
    let scene = scenes::soup(300, 0.1, 18);
    let options = BuildOptions::from(Preset::Best.config());
    let query = QueryOptions::default();
    let compared = parity::compare(&backend, &scene.mesh(), &options, &[], &query, &|_| ());
    let error = compared.expect_err("nothing to compare").to_string();
    assert!(error.contains("best") && error.contains("CPU"), "{error}");
}
