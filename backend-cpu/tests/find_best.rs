//! Best-first search, held against all leaves of a tree and all triangles of a mesh.

use core::ops::ControlFlow;
use std::cmp::Ordering;

use crate::common::tree_of;
use splitplane_core::aabb::Aabb;
use splitplane_core::config::Preset;
use splitplane_core::query::best_first::LeafCell;
use splitplane_core::tree::KdTree;
use splitplane_core::tree::node::NodeKind;
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};

const NONE: f64 = f64::INFINITY;

fn trees() -> impl Iterator<Item = (Scene, KdTree)> {
    let both = |scene: Scene| {
        [Preset::Fast, Preset::Best].map(|preset| (scene.clone(), tree_of(&scene, preset)))
    };
    scenes::awkward().into_iter().flat_map(both)
}

/// The triangles that a tree names: snapped corners, `None` for those that are dropped.
fn kept(scene: &Scene) -> Vec<Option<Triangle>> {
    let prepared = scene.triangles().into_iter().map(|triangle| prepare(&triangle));
    prepared.map(|triangle| triangle.kept.then_some(triangle.corners)).collect()
}

/// Leaves with their bounds as far as they are known from themselves and all above them, by recursion.
fn leaves(
    tree: &KdTree,
    node: u32,
    cell: Aabb,
    above: f64,
    bound: &dyn Fn(&Aabb) -> f64,
    out: &mut Vec<(f64, u32)>,
) {
    // `max` ignores a NaN.
    let least = above.max(bound(&cell));
    match tree.nodes[node as usize].kind() {
        NodeKind::Leaf { .. } => out.push((least, node)),
        NodeKind::Interior { axis, split, right } => {
            let (mut lower, mut upper) = (cell, cell);
            (lower.hi[axis.index()], upper.lo[axis.index()]) = (split, split);
            leaves(tree, node + 1, lower, least, bound, out);
            leaves(tree, right, upper, least, bound, out);
        }
    }
}

/// Searches with costs that are looked up by leaf, and says which leaves were visited.
fn check_order(
    tree: &KdTree,
    within: f64,
    bound: &dyn Fn(&Aabb) -> f64,
    cost: impl Fn(u32) -> f64,
) {
    let (mut visited, mut expected, mut all) = (Vec::new(), Vec::new(), Vec::new());
    let found = tree.find_best(within, bound, |leaf| {
        visited.push((leaf.bound, leaf.node));
        ControlFlow::Continue(cost(leaf.node))
    });
    leaves(tree, 0, tree.bounds, f64::NEG_INFINITY, bound, &mut all);
    all.sort_by(|a, b| a.partial_cmp(b).expect("no NaN"));
    let mut best = within;
    for (least, node) in all {
        if !(least <= best && least < NONE) {
            break;
        }
        expected.push((least, node));
        best = best.min(cost(node));
    }
    assert_eq!(visited, expected);
    assert_eq!(found.expect("memory"), best);
}

/// The square of the distance of a box, or a little less.
fn to_box(cell: &Aabb, point: [f64; 3]) -> f64 {
    let away = |k: usize| {
        (f64::from(cell.lo[k]) - point[k]).max(point[k] - f64::from(cell.hi[k])).max(0.0)
    };
    [0, 1, 2].map(|k| away(k) * away(k)).iter().sum::<f64>() * (1.0 - 1e-12)
}

/// The square of the distance of the nearest corner.
fn to_corner(triangle: &Triangle, point: [f64; 3]) -> f64 {
    let squared =
        |corner: &[f32; 3]| (0..3).map(|k| (f64::from(corner[k]) - point[k]).powi(2)).sum::<f64>();
    triangle.iter().map(squared).fold(NONE, f64::min)
}

fn points(tree: &KdTree, random: &mut Random, count: usize) -> Vec<[f64; 3]> {
    let Aabb { lo, hi } = tree.bounds;
    let corners: Vec<f32> = tree
        .nodes
        .iter()
        .filter_map(|node| match node.kind() {
            NodeKind::Interior { split, .. } => Some(split),
            NodeKind::Leaf { .. } => None,
        })
        .collect();
    let coordinate = |k: usize, random: &mut Random| {
        let (lo, hi) = (f64::from(lo[k]), f64::from(hi[k]));
        let plane = corners.get(random.below(corners.len().max(1))).map_or(lo, |&x| f64::from(x));
        let anywhere = random.between(lo - 0.5 * (hi - lo), hi + 0.5 * (hi - lo));
        random.pick(&[lo, hi, plane, anywhere, anywhere])
    };
    (0..count).map(|_| [0, 1, 2].map(|k| coordinate(k, random))).collect()
}

#[test]
fn leaves_come_by_bound_and_then_by_index() {
    let mut random = Random::new(1);
    for (_, tree) in trees().filter(|(_, tree)| !tree.bounds.is_empty()) {
        for point in points(&tree, &mut random, 4) {
            let salt = random.bits();
            let cost = |node: u32| f64::from((node ^ salt).wrapping_mul(0x9e37_79b9) >> 8);
            let extent = tree.bounds.diagonal().powi(2) / f64::from(1 << 24);
            let distance = |cell: &Aabb| to_box(cell, point);
            check_order(&tree, NONE, &distance, |_| NONE);
            check_order(&tree, NONE, &distance, |node| cost(node) * extent);
            check_order(&tree, tree.bounds.diagonal().powi(2) / 50.0, &distance, |_| f64::NAN);
            // Ties all over, and bounds that fall on the way down, or are none.
            check_order(&tree, NONE, &|_| 1.0, |_| 1.0);
            check_order(&tree, NONE, &|_| f64::NAN, |node| cost(node) - 1e7);
            let odd = |cell: &Aabb| match (cell.lo[0].to_bits() ^ cell.hi[1].to_bits()) % 5 {
                0 => f64::NAN,
                1 => NONE,
                k => f64::from(k),
            };
            check_order(&tree, NONE, &odd, |_| NONE);
        }
    }
}

/// The triangle whose corner is nearest, among equal ones that of lowest index; and the same among those of a
/// class, and within a distance.
#[test]
fn the_nearest_corner_is_found() {
    let mut random = Random::new(2);
    let (mut found, mut fewer) = (0, 0);
    for (scene, tree) in trees() {
        let triangles = kept(&scene);
        for point in points(&tree, &mut random, 8) {
            let classes: [fn(u32) -> bool; 2] = [|_| true, |triangle| triangle % 3 == 1];
            for (class, within) in
                classes.into_iter().zip([NONE, tree.bounds.diagonal().powi(2) / 16.0])
            {
                let cost = |triangle: usize| {
                    let corners = triangles[triangle].as_ref().filter(|_| class(triangle as u32));
                    corners.map_or(NONE, |corners| to_corner(corners, point))
                };
                let all = (0..triangles.len()).map(|triangle| (cost(triangle), triangle as u32));
                let by =
                    |a: &(f64, u32), b: &(f64, u32)| a.partial_cmp(b).unwrap_or(Ordering::Equal);
                let expected = all.filter(|best| best.0 <= within && best.0 < NONE).min_by(by);
                let (mut best, mut visits) = (None, 0);
                let least = tree.find_best(
                    within,
                    |cell| to_box(cell, point),
                    |leaf| {
                        visits += 1;
                        for &triangle in leaf.triangles {
                            let next = (cost(triangle as usize), triangle);
                            let limit = best.unwrap_or((within, u32::MAX));
                            if next.0 < NONE && by(&next, &limit).is_lt() {
                                best = Some(next);
                            }
                        }
                        ControlFlow::Continue(best.map_or(NONE, |best| best.0))
                    },
                );
                assert_eq!(best, expected, "{} {point:?}", scene.name);
                assert_eq!(least.expect("memory"), best.map_or(within, |best| best.0));
                found += u32::from(best.is_some());
                fewer += u32::from(visits < tree.nodes.len() / 8);
            }
        }
    }
    assert!(found > 300 && fewer > 300, "{found} {fewer}");
}

/// The lowest and the highest triangle along each axis, by bounds without any slack; many tie.
#[test]
fn the_extreme_triangles_are_found() {
    for (scene, tree) in trees() {
        let triangles = kept(&scene);
        for (axis, sign) in (0..3).flat_map(|axis| [(axis, 1.0f64), (axis, -1.0)]) {
            let height = |p: &[f32; 3]| sign * f64::from(p[axis]);
            let cost = |corners: &Triangle| corners.iter().map(height).fold(NONE, f64::min);
            let all = triangles.iter().enumerate();
            let all = all.filter_map(|(i, corners)| Some((cost(corners.as_ref()?), i as u32)));
            let expected = all.min_by(|a, b| a.partial_cmp(b).expect("no NaN"));
            let mut best: Option<(f64, u32)> = None;
            let bound = |cell: &Aabb| height(&cell.lo).min(height(&cell.hi));
            let least = tree.find_best(NONE, bound, |leaf| {
                for &triangle in leaf.triangles {
                    let next =
                        (cost(triangles[triangle as usize].as_ref().expect("kept")), triangle);
                    best = Some(best.map_or(next, |best| if next < best { next } else { best }));
                }
                ControlFlow::Continue(best.map_or(NONE, |best| best.0))
            });
            assert_eq!(best, expected, "{} {axis} {sign}", scene.name);
            assert_eq!(least.expect("memory"), best.map_or(NONE, |best| best.0));
        }
    }
}

fn never(leaf: LeafCell<'_>) -> ControlFlow<(), f64> {
    panic!("{leaf:?} is visited")
}

#[test]
fn a_break_ends_the_search() {
    let tree = tree_of(&scenes::sphere(16, [0.0; 3], 1.0), Preset::Balanced);
    for stop in [1, 2, 7] {
        let mut visits = 0;
        let found = tree.find_best(
            NONE,
            |_| 0.0,
            |_| {
                visits += 1;
                if visits == stop { ControlFlow::Break(()) } else { ControlFlow::Continue(3.0) }
            },
        );
        assert_eq!((visits, found), (stop, Ok(if stop == 1 { NONE } else { 3.0 })));
    }
    // Neither leaves that are of no interest, nor those of a tree without triangles.
    assert_eq!(tree.find_best(NONE, |_| NONE, never), Ok(NONE));
    assert_eq!(tree.find_best(-1.0, |_| 0.0, never), Ok(-1.0));
    assert_eq!(tree_of(&scenes::none(), Preset::Fast).find_best(2.0, |_| 0.0, never), Ok(2.0));
}
