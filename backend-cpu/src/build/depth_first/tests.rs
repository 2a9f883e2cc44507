//! Depth-first builds against the schedule.

use splitplane_core::arithmetic::{Arithmetic, Hostile, Strict};
use splitplane_core::build::schedule;
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::kernel::Counter;
use splitplane_core::mesh::Mesh;
use splitplane_test_support::scenes;

use super::executor::{DepthFirstExecutor, DepthFirstScratch};
use crate::build::twin::buffers::Buffers;
use crate::build::twin::executor::{CpuExecutor, StageCounts};
use crate::simd::InstructionSet;

/// Nodes, references, levels and small roots of a build, and whether it was void.
fn built<A: Arithmetic>(
    mesh: &Mesh<'_>,
    config: BuildConfig,
    set: InstructionSet,
    depth_first: bool,
) -> (Vec<u8>, Vec<u8>, [u32; 2], bool) {
    let planes = config.preset().planes().unwrap();
    let mut twin: CpuExecutor<'_, A> =
        CpuExecutor::new(*mesh, config, set, Buffers::default(), None).unwrap();
    let (stages, void, buffers) = if depth_first {
        let mut executor = DepthFirstExecutor::new(twin, DepthFirstScratch::default());
        schedule::build(&mut executor, planes).unwrap();
        (executor.stage_counts(), executor.is_void(), executor.finish().0)
    } else {
        schedule::build(&mut twin, planes).unwrap();
        (twin.stage_counts(), false, twin.finish())
    };
    let StageCounts { levels, small_roots } = stages;
    let [nodes, references] =
        [Counter::Nodes, Counter::LeafReferences].map(|counter| buffers.counters[counter] as usize);
    let nodes = bytemuck::cast_slice(&buffers.nodes[..nodes]).to_vec();
    let references = bytemuck::cast_slice(&buffers.leaf_references[..references]).to_vec();
    (nodes, references, [levels, small_roots], void)
}

/// The tree of the levels, over every instruction set, for configurations of all kinds.
#[test]
fn tasks_build_what_the_levels_build() {
    let plain = BuildConfig::default();
    let scenes = [(5000, 0.2), (3000, 0.02), (1200, 1.0), (50, 1.0)];
    let scenes = scenes.map(|(count, size)| scenes::medley(count, size, count as u64).triangles());
    let mut same = scenes[1].clone();
    same.extend([scenes[1][7]; 1200]);
    for (scene, triangles) in scenes.iter().chain([&same]).enumerate() {
        let mesh = Mesh::soup(triangles).unwrap();
        for preset in [Preset::Fast, Preset::Balanced] {
            let plain = BuildConfig { builder: preset.config().builder, ..plain };
            let mut other_bins = BuildConfig { max_depth: 9, ..plain };
            if let Some(bins) = other_bins.bins_mut() {
                *bins = 7;
            }
            for config in [
                plain,
                BuildConfig { clip: false, ..plain },
                BuildConfig { block_width: 3, ..plain }.with_stages(|stages| {
                    stages.small_node_limit = 5;
                    stages.empty_cutoff = 10;
                }),
                other_bins,
                BuildConfig { max_depth: 3, ..plain },
            ] {
                let config = BuildConfig { references_per_triangle: 1 << 10, ..config };
                let config = config.with_stages(|stages| stages.nodes_per_triangle = 1 << 10);
                let portable = InstructionSet::Portable;
                let expected = built::<Strict>(&mesh, config, portable, false);
                for set in InstructionSet::available() {
                    let found = built::<Strict>(&mesh, config, set, true);
                    assert!(!found.3, "scene {scene}, {config:?}");
                    assert!(found == expected, "scene {scene}, {set:?}, {config:?}");
                }
            }
            let config = plain;
            let (nodes, references, ..) =
                built::<Strict>(&mesh, config, InstructionSet::Portable, false);
            let hostile = built::<Hostile>(&mesh, config, InstructionSet::Portable, true);
            assert!((hostile.0, hostile.1) == (nodes, references), "scene {scene}, hostile");
        }
    }
}

/// Where a cap binds, or might, the tasks' tree is void, and [`CpuBackend`](crate::CpuBackend) builds that of
/// the levels. With spare capacity it is not.
#[test]
fn caps_make_it_void() {
    let scene = scenes::medley(9000, 0.3, 5);
    let mesh = scene.mesh();
    let mut voids = 0;
    for preset in [Preset::Fast, Preset::Balanced] {
        for (references_per_triangle, nodes_per_triangle) in
            [(1, 4), (2, 4), (3, 4), (8, 4), (1 << 10, 1), (1 << 10, 1 << 10)]
        {
            let config =
                BuildConfig { references_per_triangle, ..preset.config() }.with_stages(|stages| {
                    stages.nodes_per_triangle = nodes_per_triangle;
                    stages.small_node_limit = 8;
                });
            let set = InstructionSet::detect();
            let (nodes, references, [levels, small_roots], _) =
                built::<Strict>(&mesh, config, set, false);
            let found = built::<Strict>(&mesh, config, set, true);
            voids += u32::from(found.3);
            assert!(found.3 || found.0 == nodes && found.1 == references);
            let options = config.into();
            let (tree, summary) = crate::CpuBackend::new().build_tree(&mesh, &options).unwrap();
            assert!(bytemuck::cast_slice::<_, u8>(&tree.nodes) == nodes);
            assert!(bytemuck::cast_slice::<_, u8>(&tree.references) == references);
            assert_eq!([summary.large_levels, summary.small_roots], [levels, small_roots]);
        }
    }
    // Twice the least references, twice the least nodes at least, and never all.
    assert!((4..12).contains(&voids), "{voids}");
}
