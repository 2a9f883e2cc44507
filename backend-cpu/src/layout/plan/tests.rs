use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::triangle::Triangle;
use splitplane_test_support::scenes;

use super::*;
use crate::CpuBackend;
use crate::simd::InstructionSet;

/// The definition, by recursion over the branches: what a subtree costs with 1, 2, 3 places, and how
/// many nodes it is then.
fn least(planner: &Planner, branches: &[Branch], at: u32) -> [(f32, u32); 3] {
    let branch = &branches[at as usize];
    let [left, right] = branch.children;
    let area = planner.area(&branch.bounds);
    if branch.axis().is_none() {
        let blocks = branch.children[1];
        return [1, 2, 3]
            .map(|places| if places < blocks { (area, run_nodes(blocks, 4)) } else { (0.0, 0) });
    }
    let (left, right) = (least(planner, branches, left), least(planner, branches, right));
    let share = |places: usize| {
        let mut best = (f32::INFINITY, 0);
        for k in 1..places {
            let (one, other) = (left[k - 1], right[places - k - 1]);
            if one.0 + other.0 < best.0 {
                best = (one.0 + other.0, one.1 + other.1);
            }
        }
        best
    };
    let inside = share(4);
    let alone = (area + inside.0, 1 + inside.1);
    [1, 2, 3].map(|places| if share(places).0 < alone.0 { share(places) } else { alone })
}

/// Few places keep the recursion short. (Scenes so small or large that areas would vanish or overflow are
/// planned like others.)
#[test]
fn plans_cost_least() {
    let mut inner = 0;
    for (count, size) in [(1, 1.0), (6, 1.0), (40, 1.0), (60, 1e-30), (60, 1e30)] {
        let scene = scenes::scaled(&scenes::soup(count, 0.05, 11), size, "soup");
        let (mesh, triangles) = (scene.mesh(), scene.triangles());
        let config = BuildConfig { block_width: 2, ..Preset::Fast.config() };
        let built =
            CpuBackend::new().build_accelerator(&mesh, &BuildOptions::from(config)).unwrap();
        let tree = built.tree().view();
        for set in InstructionSet::available() {
            let planner = Planner::new(4, &tree.bounds);
            let nothing = Branch::leaf(Aabb::EMPTY, 0, 0);
            let mut branches = vec![nothing; tree.nodes.len()];
            for (node, branch) in tree.nodes.iter().zip(&mut branches) {
                if let NodeKind::Leaf { first, count } = node.kind() {
                    let references = tree.leaf(first, count);
                    let corners = references.iter().map(|&t| triangles[t as usize]);
                    let bounds = corners.map(|corners: Triangle| Aabb::of_points(&corners));
                    let bounds = bounds.fold(Aabb::EMPTY, |all, one| all.union(&one));
                    *branch = Branch::leaf(bounds, 0, count.div_ceil(3));
                }
            }
            let costs = planner.subtree(set, 0, tree.nodes, &mut branches);
            let root = costs.branch().expect("triangles");
            let expected = least(&planner, &branches, root);
            for (place, (area, nodes)) in expected.into_iter().enumerate() {
                assert!(area.is_finite());
                assert_eq!(costs.areas[ONE + place], area, "{count} {size} {place}");
                assert_eq!(costs.nodes[ONE + place], nodes, "{count} {size} {place}");
            }
            inner += costs.whole().max(1);
        }
    }
    assert!(inner > 40, "{inner}");
}
