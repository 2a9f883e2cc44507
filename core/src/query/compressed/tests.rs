//! Boxes hold what they are given, and hits are the tree's.

use super::*;
use crate::aabb::Aabb;
use crate::arithmetic::Strict;
use crate::build::reference;
use crate::config::{BuildConfig, Preset};
use crate::mesh::Mesh;
use crate::query::intersect::SceneScale;
use crate::query::lines::scene_scale;
use crate::query::traverse::{Cost, Query, trace};
use crate::random;
use crate::ray::{Hit, QueryOptions, Ray};
use crate::tree::node::{Axis, KdNode, NodeKind};
use crate::tree::{KdTree, KdTreeView};
use crate::triangle::Triangle;
use alloc::vec::Vec;

/// A number between -1 and 1.
fn signed(seed: u64, words: &[u64]) -> f32 {
    (2.0 * random::unit(seed, words) - 1.0) as f32
}

#[test]
fn a_quantised_box_is_a_quantum_wider_and_hardly_more() {
    for round in 0..3_000u64 {
        let count = 1 + (round % 8) as usize;
        // Sizes and places of many magnitudes, boxes without an extent among them.
        let size = 10f32.powi((random::hash(round, &[1]) % 24) as i32 - 12);
        let away = size * 10f32.powi((random::hash(round, &[2]) % 9) as i32 - 3);
        let boxes: Vec<Aabb> = (0..count as u64)
            .map(|child| {
                let corner = |end: u64| {
                    core::array::from_fn(|axis| {
                        let flat = random::hash(round, &[3, axis as u64]).is_multiple_of(7);
                        let end = if flat { 0 } else { end };
                        away + size * signed(round, &[4, child, axis as u64, end])
                    })
                };
                Aabb::of_points(&[corner(1), corner(2)])
            })
            .collect();
        let mut node = CompressedNode::default();
        node.set_boxes(&boxes);
        for (child, given) in boxes.iter().enumerate() {
            for (axis, [lo, hi]) in node.child_bounds(child).into_iter().enumerate() {
                let quantum = node.quantum(axis);
                let (below, above) =
                    (f64::from(given.lo[axis]) - lo, hi - f64::from(given.hi[axis]));
                assert!(below >= quantum && above >= quantum, "{round}: {below} {above} {quantum}");
                // Places of sides are rounded.
                let most = quantum * (2.0 + 1e-4);
                assert!(below <= most && above <= most, "{round}");
            }
        }
        // The quanta are no coarser than eight bits need.
        let all = boxes.iter().fold(Aabb::EMPTY, |all, one| all.union(one));
        for axis in 0..3 {
            let (extent, quantum) = (all.hi[axis] - all.lo[axis], node.quantum(axis) as f32);
            let finest = away.abs().max(size) * 1e-6;
            assert!(quantum <= (extent / 62.0).max(finest), "{round}: {quantum} of {extent}");
        }
    }
}

/// Triangles of many sizes in a cube, some in planes, some twice, and one large one.
fn soup(count: u64, seed: u64) -> Vec<Triangle> {
    let mut triangles: Vec<Triangle> = (0..count)
        .map(|number| {
            let number = if number % 11 == 0 { number / 2 } else { number };
            let size = 10f32.powi(-((random::hash(seed, &[number]) % 3) as i32));
            core::array::from_fn(|corner| {
                core::array::from_fn(|axis| {
                    let place = 5.0 * signed(seed, &[number, 1, axis as u64]);
                    let part = if number % 5 == axis as u64 { 0 } else { corner as u64 };
                    place + size * signed(seed, &[number, 2, part, axis as u64])
                })
            })
        })
        .collect();
    triangles.push([[-90.0, -5.0, -90.0], [90.0, -5.0, -90.0], [0.0, -5.0, 90.0]]);
    triangles
}

fn build(triangles: &[Triangle], config: BuildConfig) -> KdTree {
    let mesh = Mesh::soup(triangles).expect("a mesh");
    reference::build(&mesh, &config.into()).expect("a tree").0
}

fn rays(triangles: &[Triangle], count: u64) -> Vec<Ray> {
    (0..count)
        .map(|number| {
            let point = |what: u64, size: f32| -> [f32; 3] {
                core::array::from_fn(|axis| size * signed(number, &[what, axis as u64]))
            };
            let place = random::hash(number, &[7]) as usize % triangles.len();
            let corner = triangles[place][number as usize % 3];
            let from = point(8, 12.0);
            match number % 4 {
                // At a vertex, along an axis through one, anywhere, and from a vertex on.
                0 => Ray::new(from, [0, 1, 2].map(|k| corner[k] - from[k])),
                1 => {
                    let mut direction = [0.0; 3];
                    direction[number as usize / 4 % 3] = if number % 8 < 4 { 1.0 } else { -1.0 };
                    let origin = [0, 1, 2].map(|k| corner[k] - 9.0 * direction[k]);
                    Ray::new(origin, direction)
                }
                2 => Ray::new(from, point(9, 1.0)),
                _ => Ray::new(corner, point(9, 1.0)),
            }
        })
        .collect()
}

fn bits(hit: &Hit) -> [u32; 4] {
    [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()]
}

/// How many of the rays were left to the tree, and of how many hits differ.
fn compare(
    triangles: &[Triangle],
    config: BuildConfig,
    fault: fn(&mut CompressedNodes),
) -> [usize; 2] {
    let built = build(triangles, config);
    let tree = built.view();
    let scale = scene_scale(&tree, triangles);
    let made = [
        CompressedNodes::new(&tree, triangles, &scale),
        CompressedNodes::greedy(&tree, triangles, &scale),
    ];
    let [mut left, mut wrong] = [0, 0];
    for nodes in made {
        let mut nodes = nodes.expect("few references");
        fault(&mut nodes);
        let found = compare_nodes(&tree, triangles, &scale, &nodes);
        (left, wrong) = (left + found[0], wrong + found[1]);
    }
    [left, wrong]
}

fn compare_nodes(
    tree: &KdTreeView<'_>,
    triangles: &[Triangle],
    scale: &SceneScale,
    nodes: &CompressedNodes,
) -> [usize; 2] {
    let options = QueryOptions::default();
    let (mut left, mut wrong) = (0, 0);
    for ray in &rays(triangles, 4_000) {
        for query in [Query::Closest, Query::Any] {
            let expected = trace::<Strict>(tree, triangles, scale, ray, &options, query);
            let mut cost = Cost::default();
            let found = nodes.trace::<Strict, _>(triangles, scale, ray, &options, query, &mut cost);
            let Some(found) = found else {
                left += 1;
                continue;
            };
            let same = match query {
                Query::Any => found.is_hit() == expected.is_hit(),
                Query::Closest => bits(&found) == bits(&expected),
            };
            wrong += usize::from(!same);
        }
    }
    [left, wrong]
}

fn no_fault(_: &mut CompressedNodes) {}

#[test]
fn hits_are_those_of_the_tree() {
    let triangles = soup(700, 5);
    let shallow = BuildConfig { max_depth: 2, ..Preset::Fast.config() };
    let presets = [Preset::Fast, Preset::Narrow, Preset::Balanced].map(Preset::config);
    for config in presets.into_iter().chain([shallow]) {
        let [left, wrong] = compare(&triangles, config, no_fault);
        assert!(left < 80 && wrong == 0, "{left} {wrong}");
    }
    let one_leaf = BuildConfig { max_depth: 1, ..Preset::Fast.config() };
    assert_eq!(compare(&triangles[..20], one_leaf, no_fault)[1], 0);
}

/// The same test fails on boxes that are too small, children that are mistaken, and references that are missing.
#[test]
fn faults_show_in_hits() {
    let triangles = soup(700, 5);
    let faults: [fn(&mut CompressedNodes); 4] = [
        |nodes| nodes.nodes.iter_mut().for_each(|node| node.sides[0][0][0] = 0x6060_6060),
        |nodes| nodes.nodes.iter_mut().for_each(|node| node.sides[0][1][2] = 0x4040_4040),
        |nodes| {
            let most = CompressedNodes::MOST_REFERENCES;
            let halved =
                |node: &mut CompressedNode| node.first_reference -= node.first_reference % most / 2;
            nodes.nodes.iter_mut().for_each(halved);
        },
        |nodes| nodes.references.iter_mut().step_by(2).for_each(|triangle| *triangle = 0),
    ];
    for fault in faults {
        assert!(compare(&triangles, Preset::Narrow.config(), fault)[1] > 10);
    }
}

/// Every reference of the tree is in a leaf, and the boxes of children hold what is below.
#[test]
fn nothing_is_lost_on_the_way() {
    for count in [0, 1, 2, 40, 900] {
        let triangles = soup(count, 3);
        let triangles = &triangles[..count as usize];
        let built = build(triangles, Preset::Fast.config());
        let tree = built.view();
        let scale = scene_scale(&tree, triangles);
        let least = CompressedNodes::new(&tree, triangles, &scale).expect("few references");
        let greedy = CompressedNodes::greedy(&tree, triangles, &scale).expect("few references");
        assert!(greedy.references.len() == tree.references.len());
        nothing_is_lost(&tree, &least);
        nothing_is_lost(&tree, &greedy);
    }
}

/// A valid tree that our builders do not make: a plane with nothing on either side, beside what has triangles.
#[test]
fn parts_without_triangles_hide_no_others() {
    let triangles = soup(40, 3);
    let mut tree = build(&triangles, Preset::Fast.config());
    let bounds = tree.bounds;
    let moved = tree.nodes.iter().map(|node| match node.kind() {
        NodeKind::Interior { axis, split, right } => KdNode::interior(axis, split, right + 4),
        NodeKind::Leaf { first, count } => KdNode::leaf(first, count),
    });
    let empty = KdNode::leaf(0, 0);
    let [x, y] = [0, 1].map(Axis::from_index);
    let mut nodes = alloc::vec![
        KdNode::interior(x, bounds.lo[0], 4),
        KdNode::interior(y, bounds.lo[1], 3),
        empty,
        empty,
    ];
    nodes.extend(moved);
    tree.nodes = nodes;
    let view = tree.view();
    let scale = scene_scale(&view, &triangles[..]);
    let greedy = CompressedNodes::greedy(&view, &triangles[..], &scale).expect("few references");
    nothing_is_lost(&view, &greedy);
}

fn nothing_is_lost(tree: &KdTreeView<'_>, nodes: &CompressedNodes) {
    let mut named: Vec<u32> = nodes.references.clone();
    let mut expected: Vec<u32> = tree.references.to_vec();
    for list in [&mut named, &mut expected] {
        list.sort_unstable();
        list.dedup();
    }
    assert_eq!(named, expected);
    let mut reached = 1;
    for node in &nodes.nodes {
        for (child, what) in node.children().enumerate() {
            let outer = node.child_bounds(child);
            match what {
                CompressedChild::Leaf { first, count } => {
                    assert!(count <= LEAF_MOST);
                    assert!((first + count) as usize <= nodes.references.len());
                }
                CompressedChild::Node(index) => {
                    reached += 1;
                    let below = &nodes.nodes[index as usize];
                    for inner in 0..below.children().count() {
                        let bounds = below.child_bounds(inner);
                        for axis in 0..3 {
                            // The child's own quanta may reach further by three of them.
                            let slack = 3.0 * below.quantum(axis);
                            assert!(bounds[axis][0] >= outer[axis][0] - slack);
                            assert!(bounds[axis][1] <= outer[axis][1] + slack);
                        }
                    }
                }
            }
        }
    }
    assert_eq!(reached, nodes.nodes.len());
}

#[test]
fn records_have_the_size_that_devices_read() {
    assert_eq!(size_of::<CompressedNode>(), 80);
}
