//! The awkward scenes under the hostile arithmetic: the same trees, and the same hits for rays at
//! edges, vertices and faces.

use splitplane_core::arithmetic::{Hostile, Strict};
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::{BuildConfig, Planes};
use splitplane_core::kernel::Buffer;
use splitplane_core::ray::QueryOptions;
use splitplane_core::schedule;
use splitplane_core::traverse::{Query, trace};
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuBackend, CpuExecutor, InstructionSet};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::scenes;

#[test]
fn awkward_scenes_keep_digest_and_hits() {
    let config = BuildConfig::default();
    let (mut compared, mut hits) = (0, 0);
    for scene in scenes::awkward() {
        let mesh = scene.mesh();
        let strict = CpuBackend::new()
            .build_accelerator(&mesh, &BuildOptions::from(config))
            .expect("a tree");
        let set = InstructionSet::detect();
        let mut executor: CpuExecutor<'_, Hostile> =
            CpuExecutor::new(mesh, config, set, Buffers::default(), None).expect("no limit");
        schedule::build(&mut executor, Planes::Median).expect("a tree");
        let tree = strict.tree();
        let name = &scene.name;
        let same = |buffer, bytes: &[u8]| executor.live(buffer) == Some(bytes);
        assert!(same(Buffer::Nodes, bytemuck::cast_slice(&tree.nodes)), "{name}: nodes");
        assert!(
            same(Buffer::LeafReferences, bytemuck::cast_slice(&tree.references)),
            "{name}: references"
        );
        // Twenty thousand triangles in one leaf make each ray dear.
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
