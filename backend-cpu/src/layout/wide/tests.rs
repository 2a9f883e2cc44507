use splitplane_core::backend::{Accelerator, BuildOptions, QueryLayout};
use splitplane_core::config::Preset;
use splitplane_core::tree::node::NodeKind;
use splitplane_test_support::scenes;

use super::*;
use crate::CpuBackend;
use crate::cancel::UNWATCHED;
use crate::layout::scratch::{LayoutScratch, LayoutSource};
use crate::layout::tree_layout::TreeLayout;
use crate::memory::Memory;
use crate::simd::InstructionSet;

/// Goes through all nodes below one: they are in their order, boxes hold what is below them, and
/// unused places are empty. Returns the number of levels, and the leaves.
fn walk(
    blocks: &TreeLayout,
    node: usize,
    next: &mut usize,
    leaves: &mut Vec<u32>,
) -> (usize, Aabb) {
    let n = blocks.wide.lanes;
    assert_eq!(node, *next, "nodes follow their parents");
    *next += 1;
    let words: &[u32] = bytemuck::cast_slice(blocks.wide.lines());
    let words = &words[node * 8 * n..][..8 * n];
    let mut used = 0;
    let (mut levels, mut all) = (0, Aabb::EMPTY);
    for place in 0..n {
        let side = |side: usize| [0, 1, 2].map(|k| f32::from_bits(words[(side + k) * n + place]));
        let bounds = Aabb { lo: side(0), hi: side(3) };
        if bounds.lo[0] > bounds.hi[0] {
            assert!(bounds.lo == [f32::INFINITY; 3] && bounds.hi == [f32::NEG_INFINITY; 3]);
            continue;
        }
        assert_eq!(place, used, "children stand in front");
        used += 1;
        all = all.union(&bounds);
        let child = words[6 * n + place];
        if wide_node::is_leaf(child) {
            leaves.push(wide_node::leaf_number(child));
            continue;
        }
        let (below, inner) = walk(blocks, child as usize, next, leaves);
        levels = levels.max(below);
        assert!(bounds.contains(&inner), "{bounds:?} {inner:?}");
    }
    let orders: &[u8] = bytemuck::cast_slice(&words[7 * n..]);
    for order in orders.chunks_exact(n) {
        let mut places = order.to_vec();
        places[..used].sort_unstable();
        assert!(places.iter().enumerate().all(|(i, &place)| i == place as usize));
    }
    (levels + 1, all)
}

#[test]
fn nodes_name_every_leaf_once() {
    let sizes = [(1, 0), (30, 0), (3, 5_000), (20_000, 700)];
    let sizes = sizes.map(|(count, same)| scenes::sizes(count, same, 5));
    let scenes = sizes.into_iter().chain([scenes::giants()]);
    // Leaves of trees by `best` are divided among blocks.
    let cases = scenes.flat_map(|scene| [Preset::Fast, Preset::Best].map(|p| (scene.clone(), p)));
    for (scene, preset) in cases {
        let (mesh, triangles) = (scene.mesh(), scene.triangles());
        let options = BuildOptions::from(preset.config());
        let built = CpuBackend::new().build_accelerator(&mesh, &options).unwrap();
        for set in InstructionSet::available() {
            for layout in [QueryLayout::Fast, QueryLayout::Compact] {
                let source = LayoutSource { mesh: &mesh, triangles: &triangles, layout };
                let (mut memory, mut scratch) = (Memory::default(), LayoutScratch::default());
                let tree = built.tree().clone();
                let with = (&mut memory, &mut scratch);
                let blocks =
                    TreeLayout::new(tree, source, set, &UNWATCHED, with.0, with.1).unwrap();
                let (mut next, mut leaves) = (0, Vec::new());
                let (levels, _) = walk(&blocks, 0, &mut next, &mut leaves);
                let lines = blocks.wide.lines().len();
                assert_eq!(next * blocks.wide.node_lines(), lines, "no node is left out");
                assert_eq!(levels, blocks.wide.depth);
                leaves.sort_unstable();
                // Leaves that name nothing but large triangles have vanished.
                let tree = built.tree();
                let large = blocks.large.triangles();
                let full = (0..).zip(&tree.nodes).filter(|(_, node)| match node.kind() {
                    NodeKind::Leaf { first, count } => {
                        let references = tree.view().leaf(first, count);
                        references.iter().any(|triangle| !large.contains(triangle))
                    }
                    NodeKind::Interior { .. } => false,
                });
                let full = full.map(|(number, _)| number);
                let mut expected: Vec<u32> = if layout == QueryLayout::Compact {
                    full.chain((!large.is_empty()).then_some(tree.nodes.len() as u32)).collect()
                } else {
                    let [unit, count] = blocks.large.blocks;
                    let large = WalkNode::leaf(unit, count);
                    let all = full.map(|node| blocks.nodes[node as usize]).chain([large]);
                    all.flat_map(|leaf| {
                        let units = leaf.blocks(&blocks.words).map(|at| at.units());
                        let end = |from: &mut u32, units: u32| {
                            let begin = *from;
                            *from += units;
                            Some(begin)
                        };
                        units.scan(leaf.node().first(), end).collect::<Vec<u32>>()
                    })
                    .collect()
                };
                expected.sort_unstable();
                assert_eq!(leaves, expected, "{} {layout:?}", triangles.len());
                assert_eq!(large.len(), if scene.name == "giants" { 64 } else { 0 });
            }
        }
    }
}
