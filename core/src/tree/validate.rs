//! Invariants of a finished tree, checked without trusting the builder.
//!
//! # No triangle is lost
//!
//! A ray that meets a triangle in a point visits every leaf whose closed cell has that point. So
//! rays find all of a triangle if and only if the closed cells of the leaves that name it cover it.
//! [`validate_mesh`] decides that exactly, by going down the tree with each triangle. On the axes
//! where all its corners have one coordinate the triangle is *flat*; its *part inside* a cell is
//! what lies strictly between the cell's sides on the other axes, and between them or in one of
//! them on the flat ones. The descent takes these steps:
//!
//! - The root's cell has all of the triangle, so there is a part inside it.
//! - At a plane across a flat axis it goes to the side that it is on. If it lies in the plane, one of
//!   both children must lose nothing of it.
//! - At any other plane it goes to each child that has a part of it inside, which is at least one.
//! - A leaf must name it.
//!
//! *A tree that loses something does not pass.* Let the check pass, and take a point of the
//! triangle that lies in no plane of the tree across an axis where the triangle is not flat. It is
//! inside the root's cell. If it is inside the cell of a node, it is inside that of a child where
//! the check went, and where both children have it, of the one that loses nothing. So it ends in a
//! leaf that names the triangle. Those planes have no more than a line of the triangle each (of a
//! segment, a point): such points are everywhere on it, and as closed cells hold the limits of
//! their points, the leaves cover all of it.
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
use crate::tree::KdTreeView;
use crate::tree::node::NodeKind;
use crate::triangle::prepare;
use thiserror::Error;

/// The first thing found wrong with a tree.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Violation {
    /// A tree has at least one node.
    #[error("the tree has no node")]
    NoNodes,
    /// In preorder, the right child directly follows the left subtree.
    #[error(
        "node {node} names {right} as its right child, but its left subtree ends before {expected}"
    )]
    NotPreorder {
        /// The interior node.
        node: usize,
        /// The right child that it names.
        right: u32,
        /// The right child that it should name.
        expected: usize,
    },
    /// Nodes after the root's subtree.
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
    /// Bounds that are infinite or NaN.
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

/// As [`validate_mesh`]; `go_on` is called about every thousand triangles with the number checked
/// since the last call, and with 0 for work of that length on the tree. Once it returns false, the
/// answer is `false`: the tree was not checked to the end.
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

/// Triangles between two checks for cancellation.
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
                // A part inside the node's cell is inside one of the two, or divided between both.
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

#[cfg(all(test, feature = "alloc"))]
mod tests;
