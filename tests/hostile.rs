//! The awkward scenes under the hostile arithmetic: the same trees, and the same hits for rays at
//! edges, vertices and faces.

use splitplane_core::arithmetic::{Hostile, Strict};
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::build::schedule;
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::kernel::Buffer;
use splitplane_core::query::traverse::{Query, trace};
use splitplane_core::ray::QueryOptions;
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuAccelerator, CpuBackend, CpuExecutor, InstructionSet};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::scenes::{self, Scene};

/// Builds in the arithmetic of Rust and in the hostile one, which must give the same tree. Returns
/// the former.
fn build(scene: &Scene, config: BuildConfig) -> CpuAccelerator {
    let mesh = scene.mesh();
    let strict =
        CpuBackend::new().build_accelerator(&mesh, &BuildOptions::from(config)).expect("a tree");
    let set = InstructionSet::detect();
    let mut executor: CpuExecutor<'_, Hostile> =
        CpuExecutor::new(mesh, config, set, Buffers::default(), None).expect("no limit");
    schedule::build(&mut executor, config.preset().planes().expect("a schedule")).expect("a tree");
    let tree = strict.tree();
    let name = &scene.name;
    let same = |buffer, bytes: &[u8]| executor.live(buffer) == Some(bytes);
    assert!(same(Buffer::Nodes, bytemuck::cast_slice(&tree.nodes)), "{name}: nodes, {config:?}");
    assert!(
        same(Buffer::LeafReferences, bytemuck::cast_slice(&tree.references)),
        "{name}: references, {config:?}"
    );
    strict
}

/// What finds planes by bins decides by guarded operations alone, however many bins there are and
/// whatever the scale.
#[test]
fn balanced_trees_keep_their_digest() {
    let balanced = Preset::Balanced.config();
    let configs = [
        balanced,
        BuildConfig { clip: false, ..balanced },
        balanced.with_bins(2),
        BuildConfig { block_width: 1, ..balanced }
            .with_stages(|stages| stages.small_node_limit = 5)
            .with_bins(7),
        balanced.with_stages(|stages| stages.empty_cutoff = 1).with_bins(64),
    ];
    for scene in scenes::awkward() {
        for config in configs {
            build(&scene, config);
        }
    }
    // At the ends of the range: bins of almost nothing, and of more than half of all there is.
    for scale in [2e-38, 1e-37, 1e-36, 1e-33, 1e37, 1.5e38] {
        let scene = scenes::soup(700, 0.2, 7);
        let positions = scene.positions.iter().map(|p| p.map(|x| (2.0 * x - 1.0) * scale));
        let scene = Scene { positions: positions.collect(), ..scene };
        for config in configs {
            build(&scene, balanced.with_bins(config.bins()));
            build(&scene, config.with_bins(3));
        }
    }
}

#[test]
fn awkward_scenes_keep_digest_and_hits() {
    let config = BuildConfig::default();
    let (mut compared, mut hits) = (0, 0);
    for scene in scenes::awkward() {
        let mesh = scene.mesh();
        let name = &scene.name;
        let strict = build(&scene, config);
        let tree = strict.tree();
        // Twenty thousand triangles in one leaf make each ray expensive.
        let each = if mesh.len() >= 20_000 { 5 } else { 60 };
        if strict.summary().dropped == strict.summary().triangles {
            continue;
        }
        let (view, scale) = (tree.view(), strict.scene_scale());
        let options = QueryOptions::default();
        for kind in Kind::ALL {
            for ray in aim::rays(&mesh, kind, each, 5) {
                let expected = trace::<Strict>(&view, &mesh, scale, &ray, &options, Query::Closest);
                let found = trace::<Hostile>(&view, &mesh, scale, &ray, &options, Query::Closest);
                let bits = |hit: splitplane_core::ray::Hit| {
                    [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()]
                };
                assert_eq!(bits(found), bits(expected), "{name}, {kind:?}: {ray:?}");
                compared += 1;
                hits += usize::from(expected.is_hit());
            }
        }
    }
    assert!(compared > 5000 && hits > 2000, "{compared} {hits}");
}
