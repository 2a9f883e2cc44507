//! Injected faults, and cases that are not faults.

use super::*;
use crate::config::BuildConfig;
use crate::tree::node::{Axis, KdNode};

const BOUNDS: Aabb = Aabb { lo: [0.0; 3], hi: [2.0; 3] };

fn check(nodes: &[KdNode], references: &[u32]) -> Result<(), Violation> {
    let config = BuildConfig { max_depth: 2, ..Default::default() };
    validate(&KdTreeView { nodes, references, bounds: BOUNDS, triangles: 2, config })
}

fn split(right: u32) -> KdNode {
    KdNode::interior(Axis::X, 1.0, right)
}

/// Each violation of the structure is found with an injected fault.
#[test]
fn every_fault_is_named() {
    let leaf = KdNode::leaf;
    assert_eq!(check(&[split(2), leaf(0, 1), leaf(1, 1)], &[0, 1]), Ok(()));
    assert_eq!(check(&[], &[]), Err(Violation::NoNodes));
    type Case<'a> = (&'a [KdNode], &'a [u32], fn(&Violation) -> bool);
    let cases: [Case<'_>; 9] = [
        (&[split(1), leaf(0, 0), leaf(0, 0)], &[], |v| {
            matches!(v, Violation::NotPreorder { node: 0, right: 1, expected: 2 })
        }),
        (&[leaf(0, 0), leaf(0, 0)], &[], |v| {
            matches!(v, Violation::Unreachable { nodes: 2, reached: 1 })
        }),
        (&[split(2), leaf(0, 0)], &[], |v| matches!(v, Violation::Truncated { .. })),
        (&[KdNode::interior(Axis::Y, 2.0, 2), leaf(0, 0), leaf(0, 0)], &[], |v| {
            matches!(v, Violation::PlaneOutside { node: 0, .. })
        }),
        (&[leaf(1, 1)], &[0, 1], |v| matches!(v, Violation::LeafRange { .. })),
        (&[leaf(0, 1)], &[0, 1], |v| matches!(v, Violation::ReferenceCount { .. })),
        (&[leaf(0, 3)], &[0, 1], |v| matches!(v, Violation::ReferenceCount { .. })),
        (&[leaf(0, 2)], &[0, 2], |v| matches!(v, Violation::NoSuchTriangle { triangle: 2, .. })),
        (&[leaf(0, 2)], &[1, 1], |v| matches!(v, Violation::Duplicate { triangle: 1, .. })),
    ];
    for (nodes, references, expected) in cases {
        let found = check(nodes, references).unwrap_err();
        assert!(expected(&found), "{found}");
    }
    let deep = [
        split(6),
        KdNode::interior(Axis::Y, 1.0, 5),
        KdNode::interior(Axis::Z, 1.0, 4),
        leaf(0, 0),
        leaf(0, 0),
        leaf(0, 0),
        leaf(0, 0),
    ];
    assert!(matches!(check(&deep, &[]), Err(Violation::TooDeep { depth: 3, most: 2, .. })));
}

/// A corner that only touches a cell, next to zero: edges cut there come out a rounding error of their
/// far end below it, which is no part of the triangle.
#[test]
fn rounding_of_cut_edges_is_no_part() {
    let tip = 3.335_710_8e-16;
    let triangles = [[
        [tip, 1.0, 1.112_696_6e-31],
        [0.074_657_835, 0.980_785_25, -0.180_239_96],
        [0.038_060_233, 0.980_785_25, -0.191_341_71],
    ]];
    let mesh = Mesh::soup(&triangles).unwrap();
    let bounds = Aabb { lo: [0.0, 0.0, -1.0], hi: [1.0; 3] };
    let check = |z: f32, x: f32| {
        let nodes = [
            KdNode::interior(Axis::Z, z, 2),
            KdNode::leaf(0, 1),
            KdNode::interior(Axis::X, x, 4),
            KdNode::leaf(1, 0),
            KdNode::leaf(1, 1),
        ];
        let config = BuildConfig::default();
        let references = &[0, 0];
        validate_mesh(
            &KdTreeView { nodes: &nodes, references, bounds, triangles: 1, config },
            &mesh,
        )
    };
    assert_eq!(check(5e-32, tip), Ok(()));
    // Farther off there is one.
    let lost = Err(Violation::Lost { node: 3, triangle: 0 });
    assert_eq!(check(-1e-12, 1e-12), lost);
}

#[test]
fn lost_and_stray_triangles_are_found() {
    let triangles = [
        [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 2.0]],
        [[1.5, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0]],
    ];
    let mesh = Mesh::soup(&triangles).unwrap();
    let check = |references: &[u32], left, right| {
        let nodes = [split(2), KdNode::leaf(0, left), KdNode::leaf(left, right)];
        validate_mesh(
            &KdTreeView {
                nodes: &nodes,
                references,
                bounds: BOUNDS,
                triangles: 2,
                config: BuildConfig::default(),
            },
            &mesh,
        )
    };
    assert_eq!(check(&[0, 0, 1], 1, 2), Ok(()));
    assert_eq!(check(&[0, 1], 0, 2), Err(Violation::Lost { node: 1, triangle: 0 }));
    assert_eq!(check(&[0, 1, 0, 1], 2, 2), Err(Violation::Outside { node: 1, triangle: 1 }));
}

/// A tree of two leaves over one triangle, split on an axis.
fn halves(
    triangle: [[f32; 3]; 3],
    (axis, split): (Axis, f32),
    named: [bool; 2],
) -> Result<(), Violation> {
    let soup = [triangle];
    let mesh = Mesh::soup(&soup).unwrap();
    let mut bounds = Aabb::of_points(&triangle);
    bounds.lo[axis.index()] = bounds.lo[axis.index()].min(split.next_down());
    bounds.hi[axis.index()] = bounds.hi[axis.index()].max(split.next_up());
    let counts = named.map(u32::from);
    let nodes = [
        KdNode::interior(axis, split, 2),
        KdNode::leaf(0, counts[0]),
        KdNode::leaf(counts[0], counts[1]),
    ];
    let references = &[0, 0][..(counts[0] + counts[1]) as usize];
    let config = BuildConfig::default();
    validate_mesh(&KdTreeView { nodes: &nodes, references, bounds, triangles: 1, config }, &mesh)
}

/// However small the missing part is relative to the coordinates.
#[test]
fn no_part_is_too_thin() {
    let lost = |node| Err(Violation::Lost { node, triangle: 0 });
    for scale in [1e-30, 1e-6, 1.0, 1e6, 1e30f32] {
        for split in [scale, -scale] {
            let (below, above) = (split.next_down(), split.next_up());
            let across = [[below, 0.0, 0.0], [above, scale, 0.0], [above, 0.0, 1.0]];
            for axis in [Axis::X, Axis::Y, Axis::Z] {
                let turned =
                    across.map(|[x, y, z]| [[x, y, z], [z, x, y], [y, z, x]][axis.index()]);
                let plane = (axis, split);
                assert_eq!(halves(turned, plane, [true; 2]), Ok(()));
                assert_eq!(halves(turned, plane, [false, true]), lost(1));
                assert_eq!(halves(turned, plane, [true, false]), lost(2));
                // A triangle that only touches the plane has no part there.
                let touching = turned.map(|mut corner| {
                    corner[axis.index()] = corner[axis.index()].max(split);
                    corner
                });
                assert_eq!(halves(touching, plane, [false, true]), Ok(()));
                assert_eq!(halves(touching, plane, [true, false]), lost(2));
            }
        }
    }
    // Half a unit of a triangle that is half a unit wide.
    let narrow = [[1e6, 0.0, 0.0], [1e6 + 0.5, 0.0, 0.0], [1e6, 1.0, 0.0]];
    assert_eq!(halves(narrow, (Axis::X, 1e6 + 0.0625), [true, false]), lost(2));
}

/// Triangles and segments in a split plane: one side must have them.
#[test]
fn one_side_of_a_plane_has_what_lies_in_it() {
    let flat = [[1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [1.0, 0.0, 2.0]];
    let askew = [[1.0, 0.0, 0.0], [1.0, 2.0, 2.0], [1.0, 1.0, 1.0]];
    let along = [[1.0, 0.0, 2.0], [1.0, 1.0, 2.0], [1.0, 2.0, 2.0]];
    for triangle in [flat, askew, along] {
        let check = |named| halves(triangle, (Axis::X, 1.0), named);
        for named in [[true, false], [false, true], [true, true]] {
            assert_eq!(check(named), Ok(()));
        }
        let lost = Violation::Lost { node: 1, triangle: 0 };
        assert_eq!(check([false, false]), Err(lost));
    }
}

/// A plane with more of the tree on its sides.
#[test]
fn one_side_has_all_that_lies_in_a_plane() {
    let soup = [[[1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [1.0, 0.0, 2.0]]];
    let mesh = Mesh::soup(&soup).unwrap();
    // The cell is cut at the triangle, both halves across it.
    let check = |named: [u32; 4]| {
        let ends = [0, 1, 2, 3].map(|i| named[..i].iter().sum::<u32>());
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| KdNode::leaf(ends[i], named[i]));
        let y = |right| KdNode::interior(Axis::Y, 1.0, right);
        let nodes = [split(4), y(3), a, b, y(6), c, d];
        let references = &[0; 4][..named.iter().sum::<u32>() as usize];
        let config = BuildConfig::default();
        validate_mesh(
            &KdTreeView { nodes: &nodes, references, bounds: BOUNDS, triangles: 1, config },
            &mesh,
        )
    };
    assert_eq!(check([1, 1, 0, 0]), Ok(()));
    assert_eq!(check([0, 0, 1, 1]), Ok(()));
    assert_eq!(check([0, 1, 1, 1]), Ok(()));
    assert_eq!(check([1, 0, 0, 0]), Err(Violation::Lost { node: 3, triangle: 0 }));
    assert_eq!(check([0, 0, 0, 1]), Err(Violation::Lost { node: 2, triangle: 0 }));
    // Nothing is lost here, but no builder does so, and to find out would take a look at every
    // pair of leaves.
    assert_eq!(check([1, 0, 0, 1]), Err(Violation::Lost { node: 3, triangle: 0 }));
}

/// The time depends on the number of references, as the number of checks for cancellation shows:
/// also where a triangle lies in a plane with strips on one side that have none of it, and others
/// across them on the other that all have it.
#[test]
fn work_is_bounded_by_references() {
    const LEVELS: u32 = 12;
    const STRIPS: u32 = 1 << LEVELS;
    let soup = [[[1.0, 0.0, 0.0], [1.0, 2.0, 2.0], [1.0, 0.0, 2.0]]; 3];
    let mesh = Mesh::soup(&soup).unwrap();
    let mut nodes = alloc::vec![KdNode::leaf(0, 0)];
    let mut first = 0;
    fn strips(
        nodes: &mut alloc::vec::Vec<KdNode>,
        axis: Axis,
        ends: [f32; 2],
        levels: u32,
        leaf: &mut impl FnMut() -> KdNode,
    ) {
        if levels == 0 {
            return nodes.push(leaf());
        }
        let (at, middle) = (nodes.len(), 0.5 * (ends[0] + ends[1]));
        nodes.push(KdNode::leaf(0, 0));
        strips(nodes, axis, [ends[0], middle], levels - 1, leaf);
        nodes[at] = KdNode::interior(axis, middle, nodes.len() as u32);
        strips(nodes, axis, [middle, ends[1]], levels - 1, leaf);
    }
    strips(&mut nodes, Axis::Y, [0.0, 2.0], LEVELS, &mut || KdNode::leaf(0, 0));
    nodes[0] = KdNode::interior(Axis::X, 1.0, nodes.len() as u32);
    strips(&mut nodes, Axis::Z, [0.0, 2.0], LEVELS, &mut || {
        first += 3;
        KdNode::leaf(first - 3, 3)
    });
    let references: alloc::vec::Vec<u32> = (0..3 * STRIPS).map(|i| i % 3).collect();
    let config = BuildConfig::default();
    let tree =
        KdTreeView { nodes: &nodes, references: &references, bounds: BOUNDS, triangles: 3, config };
    let mut calls = 0;
    let checked = validate_mesh_while(&tree, &mesh, |_| {
        calls += 1;
        true
    });
    assert_eq!(checked, Ok(true));
    // References once by leaves and once by triangles, in parts.
    assert!(calls <= 2 * references.len() as u32 / BETWEEN + 4, "{calls}");
    // It stops when it is told to.
    let mut left = 5;
    let stopped = validate_mesh_while(&tree, &mesh, |_| {
        left -= 1;
        left > 0
    });
    assert_eq!((stopped, left), (Ok(false), 0));
}

/// Leaves whose order would hide a triangle named twice.
#[test]
fn leaves_are_in_order() {
    let named = |list: &[u32]| {
        let (nodes, config) = ([KdNode::leaf(0, list.len() as u32)], BuildConfig::default());
        let tree =
            KdTreeView { nodes: &nodes, references: list, bounds: BOUNDS, triangles: 9, config };
        validate(&tree)
    };
    let unordered = |triangle, before| Err(Violation::Unordered { node: 0, triangle, before });
    assert_eq!(named(&[0, 1, 2, 8]), Ok(()));
    assert_eq!(named(&[2, 1]), unordered(1, 2));
    assert_eq!(named(&[1, 2, 1]), unordered(1, 2));
    assert_eq!(named(&[1, 1]), Err(Violation::Duplicate { node: 0, triangle: 1 }));
}

#[test]
fn bounds_are_finite() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for at in 0..6 {
            let mut bounds = BOUNDS;
            if at < 3 {
                bounds.lo[at] = bad;
            } else {
                bounds.hi[at - 3] = bad;
            }
            let (nodes, config) = ([KdNode::leaf(0, 0)], BuildConfig::default());
            let tree = KdTreeView { nodes: &nodes, references: &[], bounds, triangles: 0, config };
            assert_eq!(validate(&tree), Err(Violation::Bounds));
        }
    }
}

/// The watch hears of triangles by the thousand, and no check goes on once it says so. Triangles that no builder
/// keeps count like others.
#[test]
fn progress_is_told_by_the_thousand() {
    let kept = [[0.5, 0.5, 0.5], [1.5, 0.5, 0.5], [0.5, 1.5, 0.5]];
    for dropped in [[[0.5; 3]; 3], kept] {
        let soup: alloc::vec::Vec<_> =
            (0..5_000).map(|i| if i % 3 == 0 { kept } else { dropped }).collect();
        let references: alloc::vec::Vec<u32> =
            (0..5_000).filter(|i| i % 3 == 0 || dropped == kept).collect();
        let mesh = Mesh::soup(&soup).unwrap();
        let nodes = [KdNode::leaf(0, references.len() as u32)];
        let (triangles, config) = (5_000, BuildConfig::default());
        let tree = KdTreeView {
            nodes: &nodes,
            references: &references,
            bounds: BOUNDS,
            triangles,
            config,
        };
        let mut told = alloc::vec::Vec::new();
        let checked = validate_mesh_while(&tree, &mesh, |triangles| {
            told.push(triangles);
            true
        });
        assert_eq!(checked, Ok(true));
        let all: u32 = told.iter().sum();
        assert!(told.iter().all(|&more| more <= 1024), "{told:?}");
        assert!(all <= 5_000 && all + 1024 >= 5_000, "{told:?}");
        for calls in 1..=told.len() {
            let mut heard = 0;
            let stopped = validate_mesh_while(&tree, &mesh, |_| {
                heard += 1;
                heard < calls
            });
            assert_eq!((stopped, heard), (Ok(false), calls));
        }
    }
}
