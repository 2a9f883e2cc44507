//! Invariants of a finished tree, checked without trusting the builder.
//!
//! # No triangle is lost
//!
//! A ray that meets a triangle in a point visits every leaf whose closed cell has that point. So rays
//! find all of a triangle if and only if the closed cells of the leaves that name it cover it.
//! [`validate_mesh`] decides that exactly, by going down the tree with each triangle. On the axes where
//! all its corners have one coordinate the triangle is *flat*; its *part inside* a cell is what lies
//! strictly between the cell's sides on the other axes, and between them or in one of them on the flat
//! ones. Whoever goes down takes these steps:
//!
//! - The root's cell has all of the triangle, so there is a part inside it.
//! - At a plane across a flat axis it goes to the side that it is on. If it lies in the plane, one of
//!   both children must lose nothing of it.
//! - At any other plane it goes to each child that has a part of it inside, which is at least one.
//! - A leaf must name it.
//!
//! *No tree passes that loses something.* Let the check pass, and take a point of the triangle that lies
//! in no plane of the tree across an axis where the triangle is not flat. It is inside the root's cell.
//! If it is inside the cell of a node, it is inside that of a child where the check went, and where
//! both children have it, of the one that loses nothing. So it ends in a leaf that names the triangle.
//! Those planes have no more than a line of the triangle each (of a segment, a point): such points are
//! everywhere on it, and as closed cells hold the limits of their points, the leaves cover all of it.
//!
//! *All trees of our builders pass.* They keep, with each reference, bounds that hold all points that the
//! triangle has in the node's closed cell: cuts are at planes of the cell or rounded outward, or left
//! out. If the triangle has a part inside the left child's cell across an axis where it is not flat,
//! the reference's bounds begin below the plane, so it goes left, and what is clipped for that side has
//! that part within its bounds and is not empty; the same on the right. Where it is flat its bounds are flat, also
//! after clipping; planar references go to one side whole: left, or to the cheaper side in preset
//! `best`, or, where empty space is cut off, to the side that has all. Caps only end the cutting. So the
//! check asks for nothing that a builder may leave out: a leaf whose cell the triangle only touches may
//! name it or not, and references that are rounded into a cell are welcome. What it refuses and a ray
//! would forgive is a triangle in a plane that has some of its leaves on one side of it and the others on the other.
//!
//! Whether a triangle has a part inside a cell is decided without rounding, in `exact/cell.rs`. Each node that
//! the check comes to has a part of the triangle inside, so it has leaves that name the triangle or
//! one that ends the check: how long it takes is bounded by the references times the depth.

use crate::aabb::Aabb;
use crate::config::MAX_DEPTH;
use crate::exact::cell::Body;
use crate::mesh::Mesh;
use crate::node::NodeKind;
use crate::tree::KdTreeView;
use crate::triangle::prepare;
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
    /// Bounds that are infinite, or no numbers.
    #[error("the bounds of the tree are not finite")]
    Bounds,
    /// Leaves name their triangles in ascending order.
    #[error("leaf {node} refers to triangle {triangle} behind {before}, not in ascending order")]
    Unordered {
        /// The leaf.
        node: usize,
        /// The triangle.
        triangle: u32,
        /// The one before it.
        before: u32,
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
    /// A triangle with a part in a leaf's cell that no leaf with that part names.
    #[error("leaf {node} loses triangle {triangle}: it has a part of it and does not refer to it")]
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

/// Checks the structure of a tree: bounds, preorder, planes, depth, leaf ranges, references and their order.
///
/// # Errors
/// The first violation, in preorder.
pub fn validate(tree: &KdTreeView<'_>) -> Result<(), Violation> {
    if tree.nodes.is_empty() {
        return Err(Violation::NoNodes);
    }
    if !tree.bounds.lo.iter().chain(&tree.bounds.hi).all(|x| x.is_finite()) {
        return Err(Violation::Bounds);
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
                    // In order, equal ones are neighbours, and the check against a mesh need not
                    // look for a triangle from the start.
                    if let Some(&before) = i.checked_sub(1).and_then(|i| list.get(i))
                        && before >= triangle
                    {
                        return Err(if before == triangle {
                            Violation::Duplicate { node: index, triangle }
                        } else {
                            Violation::Unordered { node: index, triangle, before }
                        });
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
/// kept and whose bounds meet the leaf's cell, and that the cells of the leaves that name a kept
/// triangle cover it. The last is decided exactly, see [the module](self): whatever tree passes, no
/// ray loses a triangle in it. A triangle that lies in a split plane must be named, in the cell that the
/// plane cuts, on one side whole.
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
        let body = Body::new(&prepared.corners);
        if !tree.bounds.contains(&body.bounds) {
            return Err(Violation::OutOfBounds { triangle });
        }
        let mut cover = Cover { tree, triangle, body, leaves: 0 };
        if let Some(node) = cover.lost(0, tree.bounds) {
            return Err(Violation::Lost { node, triangle });
        }
        work += cover.leaves;
        if work >= BETWEEN {
            (going, work) = (going && go_on(0), 0);
        }
    }
    Ok(going)
}

/// Triangles between two questions whether to go on.
const BETWEEN: u32 = 1024;

/// A triangle on its way down a tree.
struct Cover<'a> {
    tree: &'a KdTreeView<'a>,
    triangle: u32,
    body: Body,
    /// Leaves it came to.
    leaves: u32,
}

impl Cover<'_> {
    /// A leaf that loses some of the triangle's part inside a node's cell; there must be such a part.
    fn lost(&mut self, mut node: usize, mut cell: Aabb) -> Option<usize> {
        let Aabb { lo, hi } = self.body.bounds;
        loop {
            let (axis, split, right) = match self.tree.nodes[node].kind() {
                NodeKind::Interior { axis, split, right } => (axis.index(), split, right as usize),
                NodeKind::Leaf { first, count } => {
                    self.leaves += 1;
                    let named = self.tree.leaf(first, count);
                    return named.binary_search(&self.triangle).is_err().then_some(node);
                }
            };
            let (mut left_cell, mut right_cell) = (cell, cell);
            left_cell.hi[axis] = split;
            right_cell.lo[axis] = split;
            let goes_right = if self.body.flat[axis] {
                if lo[axis] == split {
                    // In the plane: one side must have all of it.
                    let lost = self.lost(node + 1, left_cell)?;
                    return self.lost(right, right_cell).map(|_| lost);
                }
                lo[axis] > split
            } else if hi[axis] <= split {
                false
            } else if lo[axis] >= split || !self.body.has_part_inside(&left_cell) {
                // What is inside the node's cell is inside one of both, or has its parts in both.
                true
            } else if self.body.has_part_inside(&right_cell) {
                if let Some(lost) = self.lost(node + 1, left_cell) {
                    return Some(lost);
                }
                true
            } else {
                false
            };
            (node, cell) = if goes_right { (right, right_cell) } else { (node + 1, left_cell) };
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
        validate_mesh(
            &KdTreeView { nodes: &nodes, references, bounds, triangles: 1, config },
            &mesh,
        )
    }

    /// However small what is missing is beside the coordinates.
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
                    // What only touches the plane has no part there.
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

    /// Leaves whose order would hide a triangle named twice.
    #[test]
    fn leaves_are_in_order() {
        let named = |list: &[u32]| {
            let (nodes, config) = ([KdNode::leaf(0, list.len() as u32)], BuildConfig::default());
            let tree = KdTreeView {
                nodes: &nodes,
                references: list,
                bounds: BOUNDS,
                triangles: 9,
                config,
            };
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
                    bounds.lo[at] = bad
                } else {
                    bounds.hi[at - 3] = bad
                }
                let (nodes, config) = ([KdNode::leaf(0, 0)], BuildConfig::default());
                let tree =
                    KdTreeView { nodes: &nodes, references: &[], bounds, triangles: 0, config };
                assert_eq!(validate(&tree), Err(Violation::Bounds));
            }
        }
    }
}
