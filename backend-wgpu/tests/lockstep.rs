//! CPU and GPU executors side by side: equal live buffers after every dispatch.

use splitplane_core::config::BuildConfig;
use splitplane_core::lockstep::Lockstep;
use splitplane_core::schedule;
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuExecutor, InstructionSet};
use splitplane_test_support::scenes;
use splitplane_wgpu::{Gpu, OpenOptions, WgpuBackend};

#[test]
fn awkward_scenes() {
    let gpu = Gpu::open(&OpenOptions { default_limits: true, ..Default::default() }).unwrap();
    let backend = WgpuBackend::new(gpu);
    let config = BuildConfig::default();
    for scene in scenes::awkward() {
        let mesh = scene.mesh();
        let cpu: CpuExecutor<'_> =
            CpuExecutor::new(mesh, config, InstructionSet::detect(), Buffers::default(), None)
                .unwrap();
        let result = backend
            .with_executor(&mesh, &config, |gpu| {
                let mut lockstep = Lockstep::new(cpu, gpu);
                schedule::build(&mut lockstep).map(|()| lockstep.dispatches())
            })
            .unwrap();
        match result {
            Ok(dispatches) => {
                println!("{}: {} triangles, {dispatches} dispatches", scene.name, mesh.len())
            }
            Err(error) => println!("{}: {} triangles: {error}", scene.name, mesh.len()),
        }
        let (tree, effort) = backend.build_tree(&mesh, &config.into()).unwrap();
        let (expected, _) =
            splitplane_cpu::CpuBackend::new().build_tree(&mesh, &config.into()).unwrap();
        assert_eq!(tree.digest(), expected.digest());
        println!("{effort:?}");
    }
}
