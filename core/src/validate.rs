//! Invariants of a finished tree, checked without trusting the builder.

use crate::aabb::Aabb;
use crate::config::MAX_DEPTH;
use crate::mesh::Mesh;
use crate::node::NodeKind;
use crate::tree::KdTreeView;
use crate::triangle::{Triangle, prepare};
use thiserror::Error;

/// The first thing found wrong with a tree.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum Violation {
    /// A tree has at least one node.
    #[error("the tree has no node")]
    NoNodes,
    /// In preorder, the right child stands directly behind the left subtree.
    #[error(
        "node {node} names {right} as its right child, but its left subtree ends before {expected}"
    )]
    NotPreorder {
        /// The interior node.
        node: usize,
        /// What it names.
        right: u32,
        /// What it should name.
        expected: usize,
    },
    /// Nodes behind the root's subtree.
    #[error("{nodes} nodes are stored, but only the first {reached} belong to the tree")]
    Unreachable {
        /// Nodes stored.
        nodes: usize,
        /// Nodes of the root's subtree.
        reached: usize,
    },
    /// A child beyond the end of the array.
    #[error("the subtree of node {node} runs past the end of the nodes")]
    Truncated {
        /// The interior node.
        node: usize,
    },
    /// A split plane that is not strictly inside its node's cell.
    #[error("node {node} splits at {split}, which is not strictly between {lo} and {hi}")]
    PlaneOutside {
        /// The interior node.
        node: usize,
        /// Its plane.
        split: f32,
        /// Lower side of the cell on that axis.
        lo: f32,
        /// Upper side.
        hi: f32,
    },
    /// A node below the greatest depth.
    #[error("node {node} lies {depth} levels deep, more than {most}")]
    TooDeep {
        /// The node.
        node: usize,
        /// Its depth.
        depth: u32,
        /// Greatest depth.
        most: u32,
    },
    /// Leaves name consecutive ranges of the references, in preorder, and all of them.
    #[error("leaf {node} starts at reference {first}, but the leaves before it end at {expected}")]
    LeafRange {
        /// The leaf.
        node: usize,
        /// Its first reference.
        first: u32,
        /// Where it should start.
        expected: usize,
    },
    /// More or fewer references than the leaves name.
    #[error("{references} references are stored, but the leaves name {named}")]
    ReferenceCount {
        /// References stored.
        references: usize,
        /// References named by leaves.
        named: usize,
    },
    /// A reference to a triangle that does not exist.
    #[error("leaf {node} refers to triangle {triangle} of {triangles}")]
    NoSuchTriangle {
        /// The leaf.
        node: usize,
        /// The triangle.
        triangle: u32,
        /// Triangles of the mesh.
        triangles: u32,
    },
    /// A leaf that names a triangle twice.
    #[error("leaf {node} refers to triangle {triangle} twice")]
    Duplicate {
        /// The leaf.
        node: usize,
        /// The triangle.
        triangle: u32,
    },
    /// The mesh has another number of triangles than the tree says.
    #[error("the tree is over {tree} triangles, the mesh has {mesh}")]
    WrongMesh {
        /// What the tree says.
        tree: u32,
        /// What the mesh has.
        mesh: usize,
    },
    /// A reference to a triangle that was dropped.
    #[error("leaf {node} refers to triangle {triangle}, which is dropped")]
    Dropped {
        /// The leaf.
        node: usize,
        /// The triangle.
        triangle: u32,
    },
    /// A reference to a triangle that does not meet the leaf's cell.
    #[error("leaf {node} refers to triangle {triangle}, whose bounds do not meet its cell")]
    Outside {
        /// The leaf.
        node: usize,
        /// The triangle.
        triangle: u32,
    },
    /// A triangle with points inside a leaf's cell that the leaf does not name.
    #[error("triangle {triangle} has points inside leaf {node}, which does not refer to it")]
    Lost {
        /// The leaf.
        node: usize,
        /// The triangle.
        triangle: u32,
    },
    /// A triangle outside the bounds of the tree.
    #[error("triangle {triangle} is not within the bounds of the tree")]
    OutOfBounds {
        /// The triangle.
        triangle: u32,
    },
}

/// Checks the structure of a tree: preorder, planes, depth, leaf ranges, references.
///
/// # Errors
/// The first violation, in preorder.
pub fn validate(tree: &KdTreeView<'_>) -> Result<(), Violation> {
    if tree.nodes.is_empty() {
        return Err(Violation::NoNodes);
    }
    // Interior nodes whose right child is still to come: (node, cell of the right child, depth).
    let mut open = [(0usize, Aabb::EMPTY, 0u32); MAX_DEPTH as usize + 1];
    let mut opened = 0;
    let mut named = 0usize;
    let (mut index, mut cell, mut depth) = (0usize, tree.bounds, 0u32);
    loop {
        let Some(node) = tree.nodes.get(index) else {
            return Err(Violation::Truncated { node: index.saturating_sub(1) });
        };
        let most = tree.config.max_depth.min(MAX_DEPTH);
        if depth > most {
            return Err(Violation::TooDeep { node: index, depth, most });
        }
        match node.kind() {
            NodeKind::Interior { axis, split, .. } => {
                let (lo, hi) = (cell.lo[axis.index()], cell.hi[axis.index()]);
                // Written so that a NaN is outside.
                if !(lo < split && split < hi) {
                    return Err(Violation::PlaneOutside { node: index, split, lo, hi });
                }
                let mut right = cell;
                right.lo[axis.index()] = split;
                if opened == open.len() {
                    return Err(Violation::TooDeep { node: index, depth: depth + 1, most });
                }
                open[opened] = (index, right, depth + 1);
                opened += 1;
                cell.hi[axis.index()] = split;
                depth += 1;
                index += 1;
            }
            NodeKind::Leaf { first, count } => {
                if first as usize != named {
                    return Err(Violation::LeafRange { node: index, first, expected: named });
                }
                named += count as usize;
                if named > tree.references.len() {
                    let references = tree.references.len();
                    return Err(Violation::ReferenceCount { references, named });
                }
                let list = tree.leaf(first, count);
                for (i, &triangle) in list.iter().enumerate() {
                    if triangle >= tree.triangles {
                        let triangles = tree.triangles;
                        return Err(Violation::NoSuchTriangle { node: index, triangle, triangles });
                    }
                    // Builders keep the order of the input, so equal ones are neighbours.
                    if i > 0 && list[i - 1] == triangle {
                        return Err(Violation::Duplicate { node: index, triangle });
                    }
                }
                index += 1;
                if opened == 0 {
                    break;
                }
                opened -= 1;
                let (parent, right_cell, right_depth) = open[opened];
                if let NodeKind::Interior { right, .. } = tree.nodes[parent].kind()
                    && right as usize != index
                {
                    return Err(Violation::NotPreorder { node: parent, right, expected: index });
                }
                (cell, depth) = (right_cell, right_depth);
            }
        }
    }
    if index != tree.nodes.len() {
        return Err(Violation::Unreachable { nodes: tree.nodes.len(), reached: index });
    }
    if named != tree.references.len() {
        return Err(Violation::ReferenceCount { references: tree.references.len(), named });
    }
    Ok(())
}

/// Checks a tree against its mesh: [`validate`], and that every reference is to a triangle that was
/// kept and whose bounds meet the leaf's cell, and that no leaf's cell holds points of a triangle
/// that the leaf does not name. The last is decided by clipping each triangle down the tree in
/// `f64`; parts thinner than rounding errors of the cell's and the triangle's coordinates do not count.
///
/// # Errors
/// The first violation.
pub fn validate_mesh(tree: &KdTreeView<'_>, mesh: &Mesh<'_>) -> Result<(), Violation> {
    validate_mesh_while(tree, mesh, |_| true).map(|_| ())
}

/// As [`validate_mesh`]; `go_on` is told every thousand triangles or so how many more were looked at, 0 for
/// work of that length on the tree. Once it says no, the answer is `false`: the tree was not checked to the end.
///
/// # Errors
/// As for [`validate_mesh`].
pub fn validate_mesh_while(
    tree: &KdTreeView<'_>,
    mesh: &Mesh<'_>,
    mut go_on: impl FnMut(u32) -> bool,
) -> Result<bool, Violation> {
    validate(tree)?;
    if mesh.len() != tree.triangles as usize {
        return Err(Violation::WrongMesh { tree: tree.triangles, mesh: mesh.len() });
    }
    let mut result = Ok(());
    let (mut going, mut work) = (true, 0);
    tree.walk(|node, kind, cell, _| {
        let NodeKind::Leaf { first, count } = kind else { return };
        work += count;
        if work >= BETWEEN {
            (going, work) = (going && go_on(0), 0);
        }
        if !going {
            return;
        }
        for &triangle in tree.leaf(first, count) {
            let prepared = prepare(&mesh.triangle(triangle as usize));
            if result.is_ok() && !prepared.kept {
                result = Err(Violation::Dropped { node, triangle });
            }
            let bounds = Aabb::of_points(&prepared.corners);
            if result.is_ok() && bounds.intersection(cell).is_empty() {
                result = Err(Violation::Outside { node, triangle });
            }
        }
    });
    result?;
    for triangle in 0..tree.triangles {
        if triangle % BETWEEN == 0 {
            let more = if triangle > 0 { BETWEEN } else { 0 };
            going = going && go_on(more);
        }
        if !going {
            return Ok(false);
        }
        let prepared = prepare(&mesh.triangle(triangle as usize));
        if !prepared.kept {
            continue;
        }
        if !tree.bounds.contains(&Aabb::of_points(&prepared.corners)) {
            return Err(Violation::OutOfBounds { triangle });
        }
        let polygon = Polygon::of(&prepared.corners);
        descend(tree, triangle, 0, &polygon)?;
    }
    Ok(going)
}

/// Triangles between two questions whether to go on.
const BETWEEN: u32 = 1024;

/// A convex polygon: a triangle clipped by planes. Each plane adds at most one corner, and a box
/// has six; rounding may let a few more through.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [[f64; 3]; 16],
    count: usize,
    /// The triangle's greatest coordinate on each axis: where a plane cuts an edge is rounded by less
    /// than 2^-52 of it, also where the result is next to zero.
    reach: [f64; 3],
}

impl Polygon {
    fn of(triangle: &Triangle) -> Polygon {
        let mut corners = [[0.0; 3]; 16];
        let mut reach = [0.0f64; 3];
        for (corner, input) in corners.iter_mut().zip(triangle) {
            *corner = input.map(f64::from);
            reach = [0, 1, 2].map(|k| reach[k].max(corner[k].abs()));
        }
        Polygon { corners, count: 3, reach }
    }

    /// The part on one side of a plane (`sign` 1: below it, -1: above), or `None` when it is empty
    /// or too thin to tell.
    fn clipped(&self, axis: usize, plane: f64, sign: f64) -> Option<Polygon> {
        let mut out = Polygon { corners: [[0.0; 3]; 16], count: 0, reach: self.reach };
        let mut deepest = 0.0f64;
        for i in 0..self.count {
            let (p, q) = (self.corners[i], self.corners[(i + 1) % self.count]);
            let (dp, dq) = ((plane - p[axis]) * sign, (plane - q[axis]) * sign);
            deepest = deepest.max(dp);
            if dp >= 0.0 {
                out.push(p);
            }
            if (dp > 0.0 && dq < 0.0) || (dp < 0.0 && dq > 0.0) {
                let r = dp / (dp - dq);
                // Between the ends: beside a great coordinate rounding may carry it past a small one.
                let mut cut = [0, 1, 2]
                    .map(|k| (p[k] + r * (q[k] - p[k])).clamp(p[k].min(q[k]), p[k].max(q[k])));
                cut[axis] = plane;
                out.push(cut);
            }
        }
        let tolerance = 1e-6 * plane.abs() + 1e-14 * self.reach[axis] + 1e-36;
        (deepest > tolerance && out.count > 0).then_some(out)
    }

    fn push(&mut self, corner: [f64; 3]) {
        if self.count < self.corners.len() {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }
}

fn descend(
    tree: &KdTreeView<'_>,
    triangle: u32,
    node: usize,
    polygon: &Polygon,
) -> Result<(), Violation> {
    match tree.nodes[node].kind() {
        NodeKind::Interior { axis, split, right } => {
            let (axis, plane) = (axis.index(), f64::from(split));
            if let Some(part) = polygon.clipped(axis, plane, 1.0) {
                descend(tree, triangle, node + 1, &part)?;
            }
            if let Some(part) = polygon.clipped(axis, plane, -1.0) {
                descend(tree, triangle, right as usize, &part)?;
            }
            Ok(())
        }
        NodeKind::Leaf { first, count } => {
            // Builders name them in ascending order; searching a large leaf for each of its triangles
            // from the start would take forever.
            let named = tree.leaf(first, count);
            if named.binary_search(&triangle).is_ok() || named.contains(&triangle) {
                Ok(())
            } else {
                Err(Violation::Lost { node, triangle })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::BuildConfig;
    use crate::node::{Axis, KdNode};

    const BOUNDS: Aabb = Aabb { lo: [0.0; 3], hi: [2.0; 3] };

    fn check(nodes: &[KdNode], references: &[u32]) -> Result<(), Violation> {
        let config = BuildConfig { max_depth: 2, ..Default::default() };
        validate(&KdTreeView { nodes, references, bounds: BOUNDS, triangles: 2, config })
    }

    fn split(right: u32) -> KdNode {
        KdNode::interior(Axis::X, 1.0, right)
    }

    /// Each violation of the structure is found on a planted fault.
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
            (&[leaf(0, 2)], &[0, 2], |v| {
                matches!(v, Violation::NoSuchTriangle { triangle: 2, .. })
            }),
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
}
