//! Builds with a limit on workgroups: what `WgpuBackend::limit_workgroups` promises.

use crate::common;
use splitplane_core::backend::BuildOptions;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::scenes;
use splitplane_wgpu::{Gpu, WgpuBackend};
use std::num::NonZeroU32;

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn fewer_workgroups_build_the_same_tree() {
    let backend = WgpuBackend::without_selftest(Gpu::clone(&common::gpu()));
    let options = BuildOptions::default();
    let scene = scenes::soup(1200, 0.3, 8);
    let mesh = scene.mesh();
    let (expected, _) = CpuBackend::new().build_tree(&mesh, &options).expect("a tree");
    let build = || {
        let built = backend.build_on_device(&mesh, &options).expect("a build");
        let tree = built.tree.read(backend.gpu()).expect("a tree in host memory");
        assert_eq!(tree.digest(), expected.digest());
        backend.recycle(built.tree);
        built.effort.most_workgroups
    };
    let all = build();
    assert!(all > 3, "{all}");
    for most in [1, 3, all, u32::MAX] {
        backend.limit_workgroups(NonZeroU32::new(most));
        assert_eq!(build(), most.min(all));
    }
    backend.limit_workgroups(None);
    assert_eq!(build(), all);
}
