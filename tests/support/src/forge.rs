//! Trees altered so that their form stays that of a tree: what a forger would write to a file, with
//! digest and checksum to match.

use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::snap;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Ray;
use splitplane_core::tree::node::{Axis, KdNode, NodeKind};
use splitplane_core::tree::{KdTree, KdTreeView};

use crate::aim::{Aim, aimed};
use std::collections::BTreeSet;

/// One way to alter a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Forgery {
    /// A leaf names one triangle less.
    RemovesReference,
    /// A triangle named by one leaf is named by another in its place.
    MovesReference,
    /// A leaf names one triangle more.
    AddsReference,
    /// A triangle is taken out of a whole subtree.
    ForgetsTriangle,
    /// A plane is moved, by the least step or to a corner of a triangle.
    ShiftsPlane,
    /// A plane is turned to another axis.
    TurnsPlane,
    /// Two children change places.
    SwapsChildren,
    /// Two leaves change places.
    SwapsLeaves,
    /// A subtree becomes a leaf with the references of one of its leaves, or with all.
    Cuts,
    /// A leaf becomes two, at a corner of a triangle; each names all of its triangles but some.
    Splits,
    /// A side of the bounds is moved inward.
    ShrinksBounds,
    /// A side of the bounds is moved outward.
    WidensBounds,
    /// Two references of a leaf change places, or one stands there twice.
    Disorders,
}

impl Forgery {
    /// All of them.
    pub const ALL: [Forgery; 13] = [
        Forgery::RemovesReference,
        Forgery::MovesReference,
        Forgery::AddsReference,
        Forgery::ForgetsTriangle,
        Forgery::ShiftsPlane,
        Forgery::TurnsPlane,
        Forgery::SwapsChildren,
        Forgery::SwapsLeaves,
        Forgery::Cuts,
        Forgery::Splits,
        Forgery::ShrinksBounds,
        Forgery::WidensBounds,
        Forgery::Disorders,
    ];
}

/// A tree taken apart: nodes own what is below them.
enum Part {
    Leaf(Vec<u32>),
    Split(usize, f32, Box<[Part; 2]>),
}

impl Part {
    fn of(tree: &KdTreeView<'_>, node: usize) -> Part {
        match tree.nodes[node].kind() {
            NodeKind::Interior { axis, split, right } => {
                let children = [Part::of(tree, node + 1), Part::of(tree, right as usize)];
                Part::Split(axis.index(), split, Box::new(children))
            }
            NodeKind::Leaf { first, count } => Part::Leaf(tree.leaf(first, count).to_vec()),
        }
    }

    fn emit(&self, nodes: &mut Vec<KdNode>, references: &mut Vec<u32>) {
        match self {
            Part::Leaf(list) => {
                nodes.push(KdNode::leaf(references.len() as u32, list.len() as u32));
                references.extend(list);
            }
            Part::Split(axis, split, children) => {
                let at = nodes.len();
                nodes.push(KdNode::leaf(0, 0));
                children[0].emit(nodes, references);
                let right = nodes.len() as u32;
                nodes[at] = KdNode::interior([Axis::X, Axis::Y, Axis::Z][*axis], *split, right);
                children[1].emit(nodes, references);
            }
        }
    }

    fn leaves(&mut self) -> Vec<&mut Vec<u32>> {
        match self {
            Part::Leaf(list) => vec![list],
            Part::Split(_, _, children) => children.iter_mut().flat_map(Part::leaves).collect(),
        }
    }

    /// How many splits there are in it, or how many leaves.
    fn count(&self, splits: bool) -> usize {
        match self {
            Part::Leaf(_) => usize::from(!splits),
            Part::Split(_, _, children) => {
                usize::from(splits)
                    + children.iter().map(|child| child.count(splits)).sum::<usize>()
            }
        }
    }

    /// One of them, by its number in preorder.
    fn nth(&mut self, splits: bool, number: &mut usize) -> Option<&mut Part> {
        if matches!(self, Part::Split(..)) == splits {
            if *number == 0 {
                return Some(self);
            }
            *number -= 1;
        }
        match self {
            Part::Leaf(_) => None,
            Part::Split(_, _, children) => {
                children.iter_mut().find_map(|child| child.nth(splits, number))
            }
        }
    }
}

fn insert(list: &mut Vec<u32>, triangle: u32) {
    if let Err(at) = list.binary_search(&triangle) {
        list.insert(at, triangle);
    }
}

/// Alters a tree; `below` chooses a number below another, which is not 0. False where the tree has nothing
/// that could be altered so.
pub fn forge(
    tree: &mut KdTree,
    mesh: &Mesh<'_>,
    forgery: Forgery,
    below: &mut dyn FnMut(usize) -> usize,
) -> bool {
    let mut root = Part::of(&tree.view(), 0);
    let done = alter(&mut root, &mut tree.bounds, mesh, forgery, below);
    (tree.nodes, tree.references) = (Vec::new(), Vec::new());
    root.emit(&mut tree.nodes, &mut tree.references);
    done.is_some()
}

fn alter(
    root: &mut Part,
    bounds: &mut Aabb,
    mesh: &Mesh<'_>,
    forgery: Forgery,
    below: &mut dyn FnMut(usize) -> usize,
) -> Option<()> {
    let (splits, leaves) = (root.count(true), root.count(false));
    let mut any = |n: usize| (n > 0).then(|| below(n));
    match forgery {
        Forgery::RemovesReference | Forgery::MovesReference | Forgery::Disorders => {
            let mut lists = root.leaves();
            let full: Vec<usize> = (0..leaves).filter(|&i| !lists[i].is_empty()).collect();
            let from = full[any(full.len())?];
            let at = any(lists[from].len())?;
            match forgery {
                Forgery::Disorders => {
                    let (other, triangle) = (any(lists[from].len())?, lists[from][at]);
                    if at == other {
                        lists[from].push(triangle);
                    } else {
                        lists[from].swap(at, other);
                    }
                }
                Forgery::MovesReference => {
                    let triangle = lists[from].remove(at);
                    insert(lists[any(leaves)?], triangle);
                }
                _ => drop(lists[from].remove(at)),
            }
        }
        Forgery::AddsReference => {
            let (leaf, triangle) = (any(leaves)?, any(mesh.len())? as u32);
            insert(root.leaves()[leaf], triangle);
        }
        Forgery::ForgetsTriangle => {
            let (mut number, triangle) = (any(splits)?, any(mesh.len())? as u32);
            for list in root.nth(true, &mut number)?.leaves() {
                list.retain(|&named| named != triangle);
            }
        }
        Forgery::ShiftsPlane | Forgery::TurnsPlane | Forgery::SwapsChildren | Forgery::Cuts => {
            let mut number = any(splits)?;
            let part = root.nth(true, &mut number)?;
            let mut lists: Vec<Vec<u32>> = part.leaves().into_iter().map(|l| l.clone()).collect();
            let Part::Split(axis, split, children) = part else { return None };
            match forgery {
                Forgery::SwapsChildren => children.swap(0, 1),
                Forgery::Cuts => {
                    let mut kept = lists.swap_remove(any(lists.len())?);
                    if any(2)? == 1 {
                        lists.iter().flatten().for_each(|&triangle| insert(&mut kept, triangle));
                    }
                    *part = Part::Leaf(kept);
                }
                _ => {
                    if forgery == Forgery::TurnsPlane {
                        *axis = any(3)?;
                    }
                    *split = match any(3)? {
                        0 => split.next_up(),
                        1 => split.next_down(),
                        _ => snap(mesh.triangle(any(mesh.len())?)[any(3)?][*axis]),
                    };
                }
            }
        }
        Forgery::SwapsLeaves => {
            let (one, other) = (any(leaves)?, any(leaves)?);
            let mut lists = root.leaves();
            let list = std::mem::take(lists[one]);
            let list = std::mem::replace(lists[other], list);
            *lists[one] = list;
        }
        Forgery::Splits => {
            let mut number = any(leaves)?;
            let part = root.nth(false, &mut number)?;
            let Part::Leaf(list) = part else { return None };
            let axis = any(3)?;
            let position = snap(mesh.triangle(list[any(list.len())?] as usize)[any(3)?][axis]);
            let mut some = |side: bool| {
                let mut keep = |&triangle: &u32| {
                    let corners = mesh.triangle(triangle as usize);
                    let reaches = corners.iter().any(|corner| {
                        if side { corner[axis] > position } else { corner[axis] < position }
                    });
                    reaches || any(2) == Some(1)
                };
                list.iter().copied().filter(|triangle| keep(triangle)).collect()
            };
            let children = [Part::Leaf(some(false)), Part::Leaf(some(true))];
            *part = Part::Split(axis, position, Box::new(children));
        }
        Forgery::ShrinksBounds | Forgery::WidensBounds => {
            let (axis, high) = (any(3)?, any(2)? == 1);
            let side = if high { &mut bounds.hi[axis] } else { &mut bounds.lo[axis] };
            let up = high == (forgery == Forgery::WidensBounds);
            let far = match any(2)? {
                0 => 0.0,
                _ => 0.25 * side.abs(),
            };
            *side = if up { side.next_up() + far } else { side.next_down() - far };
        }
    }
    Some(())
}

/// Rays at what each leaf's cell has of triangles that the leaf does not name, and in split planes: where
/// a tree that loses something answers wrongly. Leaves that stand in `honest`, too, are left out.
pub fn rays(
    tree: &KdTreeView<'_>,
    honest: Option<&KdTreeView<'_>>,
    mesh: &Mesh<'_>,
    seed: u64,
) -> Vec<Ray> {
    let mut aim = Aim::new(mesh, seed);
    let (mut rays, mut known) = (Vec::new(), BTreeSet::new());
    let key = |cell: &Aabb, named: &[u32]| {
        ([cell.lo, cell.hi].map(|corner| corner.map(f32::to_bits)), named.to_vec())
    };
    if let Some(honest) = honest {
        honest.walk(|_, kind, cell, _| {
            if let NodeKind::Leaf { first, count } = kind {
                known.insert(key(cell, honest.leaf(first, count)));
            }
        });
    }
    tree.walk(|_, kind, cell, _| {
        let NodeKind::Leaf { first, count } = kind else { return };
        let named = tree.leaf(first, count);
        if known.contains(&key(cell, named)) {
            return;
        }
        for triangle in (0..mesh.len() as u32).filter(|triangle| !named.contains(triangle)) {
            let corners = mesh.triangle(triangle as usize).map(|corner| corner.map(snap));
            let Some(middle) = middle_within(&corners, cell) else { continue };
            rays.push(aimed(aim.origin(), middle));
            // Along an axis, too: in planes of the tree, and of triangles.
            let axis = rays.len() % 3;
            let mut origin = middle.map(|x| x as f32);
            let mut direction = [0.0; 3];
            direction[axis] = if rays.len() % 2 == 0 { 1.0 } else { -1.0 };
            origin[axis] -= direction[axis];
            rays.push(Ray::new(origin, direction));
        }
    });
    rays.extend((0..20).map(|_| aim.in_split_plane(tree)));
    rays
}

/// A point in the middle of what a triangle has in a box, about.
fn middle_within(corners: &[[f32; 3]; 3], cell: &Aabb) -> Option<[f64; 3]> {
    let mut polygon: Vec<[f64; 3]> = corners.map(|corner| corner.map(f64::from)).to_vec();
    for axis in 0..3 {
        for (plane, sign) in [(cell.lo[axis], 1.0), (cell.hi[axis], -1.0)] {
            let depth = |p: &[f64; 3]| (p[axis] - f64::from(plane)) * sign;
            let mut cut = Vec::new();
            for (i, p) in polygon.iter().enumerate() {
                let q = &polygon[(i + 1) % polygon.len()];
                if depth(p) >= 0.0 {
                    cut.push(*p);
                }
                if depth(p) * depth(q) < 0.0 {
                    let ratio = depth(p) / (depth(p) - depth(q));
                    cut.push([0, 1, 2].map(|k| p[k] + ratio * (q[k] - p[k])));
                }
            }
            polygon = cut;
        }
    }
    let count = polygon.len() as f64;
    (!polygon.is_empty())
        .then(|| [0, 1, 2].map(|k| polygon.iter().map(|p| p[k]).sum::<f64>() / count))
}
