//! Empty space cut off and the rest split in the middle (the survey's Figure 10), found in a tree that
//! was built.

use super::clip::{Corner, clip};
use splitplane::scene::Scene;
use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Strict;
use splitplane_core::build::split::{SplitPlane, empty_cutoff, spatial_median};
use splitplane_core::config::MAX_SMALL;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::NodeKind;

/// A node of the large-node stage with what was decided about it.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut {
    /// Its index in the tree.
    pub node: usize,
    /// Its level.
    pub depth: u32,
    /// Its cell before anything is cut off.
    pub cell: Aabb,
    /// The bounds of the parts of its triangles inside the cell.
    pub tight: Aabb,
    /// The planes that cut empty space off, in their order.
    pub cuts: Vec<SplitPlane>,
    /// The cell that is left.
    pub left: Aabb,
    /// The spatial median that splits it.
    pub split: SplitPlane,
    /// The parts of triangles inside the cell.
    pub polygons: Vec<Vec<Corner>>,
    /// The two axes on which most of it shows, the split's axis among them.
    pub axes: [usize; 2],
}

/// A node of the tree, for looking up.
#[derive(Clone, Copy)]
struct Node {
    kind: NodeKind,
    cell: Aabb,
    depth: u32,
}

/// Most triangles that a drawing shows apart.
const MOST: usize = 4000;

/// The node of a tree by preset `fast` that shows most: most cuts on two axes, then fewest triangles.
/// `None` where no large node was cut and then split at its median.
pub fn find(tree: &KdTreeView<'_>, scene: &Scene) -> Option<Cut> {
    let mut nodes: Vec<Option<Node>> = vec![None; tree.nodes.len()];
    tree.walk(|index, kind, cell, depth| nodes[index] = Some(Node { kind, cell: *cell, depth }));
    let mut best: Option<(usize, usize, Chain)> = None;
    for index in 0..nodes.len() {
        let Some(chain) = Chain::from(tree, &nodes, index) else { continue };
        let references = references(tree, &nodes, index);
        if references.len() <= MAX_SMALL as usize || references.len() > MOST {
            continue;
        }
        let shown = chain.cuts.iter().filter(|cut| chain.axes.contains(&cut.axis)).count();
        let better = best.as_ref().is_none_or(|(most, count, _)| {
            shown > *most || (shown == *most && references.len() < *count)
        });
        if better {
            best = Some((shown, references.len(), chain));
        }
    }
    let (_, _, chain) = best?;
    let node = nodes[chain.node]?;
    let polygons: Vec<Vec<Corner>> = references(tree, &nodes, chain.node)
        .into_iter()
        .filter_map(|triangle| scene.corners(triangle))
        .map(|corners| clip(corners, &node.cell))
        .filter(|polygon| polygon.len() > 2)
        .collect();
    let mut tight = Aabb::EMPTY;
    for corner in polygons.iter().flatten() {
        tight = tight.union(&Aabb::of_points(&[corner.map(|x| x as f32)]));
    }
    Some(Cut {
        node: chain.node,
        depth: node.depth,
        cell: node.cell,
        tight,
        cuts: chain.cuts,
        left: chain.left,
        split: chain.split,
        polygons,
        axes: chain.axes,
    })
}

/// The triangles under a node, each once.
fn references(tree: &KdTreeView<'_>, nodes: &[Option<Node>], index: usize) -> Vec<u32> {
    let mut out = Vec::new();
    let mut stack = vec![index];
    while let Some(index) = stack.pop() {
        match nodes.get(index).copied().flatten().map(|node| node.kind) {
            Some(NodeKind::Interior { right, .. }) => stack.extend([right as usize, index + 1]),
            Some(NodeKind::Leaf { first, count }) => out.extend(tree.leaf(first, count)),
            None => {}
        }
        // Whoever has more is not drawn.
        if out.len() > 16 * MOST {
            break;
        }
    }
    out.sort_unstable();
    out.dedup();
    out
}

/// Nodes below one another that cut empty space off, and the one that then splits.
struct Chain {
    node: usize,
    cuts: Vec<SplitPlane>,
    left: Aabb,
    split: SplitPlane,
    axes: [usize; 2],
}

impl Chain {
    /// The chain that begins with a node; `None` where the node cuts nothing off, or what follows is
    /// not what the large-node stage decides.
    fn from(tree: &KdTreeView<'_>, nodes: &[Option<Node>], node: usize) -> Option<Chain> {
        let empty = |index: usize| {
            let node = nodes.get(index).copied().flatten();
            matches!(node, Some(Node { kind: NodeKind::Leaf { count: 0, .. }, .. }))
        };
        let (mut cuts, mut index) = (Vec::new(), node);
        let (left, split) = loop {
            let Node { kind, cell, .. } = nodes.get(index).copied().flatten()?;
            let NodeKind::Interior { axis, split, right } = kind else { return None };
            let plane = SplitPlane { axis: axis.index(), position: split };
            let (low, high) = (empty(index + 1), empty(right as usize));
            if !low && !high {
                break (cell, plane);
            }
            // As the stage decides: the plane is a tight bound beyond C_e of the cell.
            let mut tight = cell;
            let side = 2 * plane.axis + usize::from(high);
            if low {
                tight.lo[plane.axis] = split;
            } else {
                tight.hi[plane.axis] = split;
            }
            if empty_cutoff::<Strict>(&tree.config, &cell, &tight, side) != Some(plane) {
                return None;
            }
            cuts.push(plane);
            index = if low { right as usize } else { index + 1 };
        };
        if cuts.is_empty() || spatial_median::<Strict>(&left) != Some(split) {
            return None;
        }
        let shown = |axis: usize| cuts.iter().filter(|cut| cut.axis == axis).count();
        // The longer of two equally good axes shows more.
        let other = (0..3).filter(|axis| *axis != split.axis).max_by(|&a, &b| {
            let extent = |axis| left.half_extent(axis);
            shown(a).cmp(&shown(b)).then(extent(a).total_cmp(&extent(b)))
        })?;
        Some(Chain { node, left, split, axes: across_and_up(split.axis, other), cuts })
    }
}

/// Two axes in the order they are drawn: y upwards where it is one of them.
pub(super) fn across_and_up(a: usize, b: usize) -> [usize; 2] {
    match (a, b) {
        (1, other) | (other, 1) => [other, 1],
        (a, b) => [a.min(b), a.max(b)],
    }
}
