//! What is said about a tree, its file, and whether it is sound.

use serde::Serialize;
use splitplane::{Aabb, Accelerator, KdTree, Mesh, NodeKind};
use std::path::Path;

/// Counts and cost of a tree.
#[derive(Debug, Serialize)]
pub(super) struct TreeStats {
    pub(super) nodes: usize,
    pub(super) leaves: usize,
    pub(super) empty_leaves: usize,
    pub(super) references: usize,
    pub(super) max_depth: u32,
    pub(super) sah_cost: f64,
}

/// Counts nodes and evaluates the surface area heuristic of the whole tree:
/// `(K_T * areas of interior nodes + K_I * sum of ceil(n / W) * areas of leaves) / root area`.
pub(super) fn tree_stats(accelerator: &dyn Accelerator) -> TreeStats {
    let tree = accelerator.tree().view();
    let config = tree.config;
    let (mut leaves, mut empty_leaves, mut max_depth) = (0, 0, 0);
    let (mut interior, mut tests) = (0.0, 0.0);
    tree.walk(|_, node, cell, depth| {
        max_depth = max_depth.max(depth);
        match node {
            NodeKind::Interior { .. } => interior += half_area(cell),
            NodeKind::Leaf { count, .. } => {
                leaves += 1;
                empty_leaves += usize::from(count == 0);
                tests += f64::from(count.div_ceil(config.block_width)) * half_area(cell);
            }
        }
    });
    let cost =
        f64::from(config.traversal_cost) * interior + f64::from(config.intersection_cost) * tests;
    let root = half_area(&tree.bounds);
    TreeStats {
        nodes: tree.nodes.len(),
        leaves,
        empty_leaves,
        references: tree.references.len(),
        max_depth,
        sah_cost: if root > 0.0 { cost / root } else { 0.0 },
    }
}

fn half_area(cell: &Aabb) -> f64 {
    if cell.is_empty() {
        return 0.0;
    }
    let [x, y, z] = [0, 1, 2].map(|axis| f64::from(cell.hi[axis]) - f64::from(cell.lo[axis]));
    x * y + y * z + z * x
}

/// Writes the tree to a file: `SPLTREE1`, then as little-endian 32-bit words the configuration, the
/// number of triangles, the bounds, the numbers of nodes and references, the nodes, the references,
/// and at the end the digest in 64 bits.
pub(super) fn save_tree(path: &Path, tree: &KdTree) -> Result<(), super::failure::Failure> {
    let mut words: Vec<u32> = tree.config.words().to_vec();
    words.push(tree.triangles);
    words.extend(tree.bounds.lo.map(f32::to_bits));
    words.extend(tree.bounds.hi.map(f32::to_bits));
    words.extend([tree.nodes.len() as u32, tree.references.len() as u32]);
    words.extend(tree.nodes.iter().flat_map(|node| node.words()));
    words.extend(&tree.references);
    let mut bytes = b"SPLTREE1".to_vec();
    bytes.extend(words.into_iter().flat_map(u32::to_le_bytes));
    bytes.extend(tree.digest().0.to_le_bytes());
    super::output::file(path, &bytes)
}

/// Checks that the tree is sound: nodes in preorder and each reached once, planes inside their
/// cells, leaves that take up all references in order, and no triangle lost.
pub(super) fn check_tree(accelerator: &dyn Accelerator, mesh: &Mesh<'_>) -> Result<(), String> {
    let tree = accelerator.tree().view();
    let mut problem = None;
    let (mut next_node, mut next_reference) = (0, 0u64);
    tree.walk(|index, node, cell, depth| {
        let fault = match node {
            _ if index != next_node => Some("is out of preorder".to_owned()),
            _ if depth > tree.config.max_depth => Some("is too deep".to_owned()),
            NodeKind::Interior { axis, split, .. } => {
                let [lo, hi] = [cell.lo, cell.hi].map(|corner| corner[axis.index()]);
                let inside = lo < split && split < hi;
                (!inside).then(|| format!("splits {lo}..{hi} at {split}"))
            }
            NodeKind::Leaf { first, count } => {
                let follows = u64::from(first) == next_reference || count == 0;
                next_reference += u64::from(count);
                (!follows).then(|| "leaves out references".to_owned())
            }
        };
        next_node += 1;
        if let Some(fault) = fault {
            problem.get_or_insert(format!("node {index} {fault}"));
        }
    });
    if let Some(problem) = problem {
        return Err(problem);
    }
    if next_node != tree.nodes.len() || next_reference != tree.references.len() as u64 {
        return Err("some nodes or references belong to no leaf".to_owned());
    }
    let mut named = vec![false; mesh.len()];
    for &triangle in tree.references {
        match named.get_mut(triangle as usize) {
            Some(named) => *named = true,
            None => return Err(format!("a leaf names triangle {triangle}, which does not exist")),
        }
    }
    let missing = named.iter().filter(|named| !**named).count();
    match missing == accelerator.summary().dropped as usize {
        true => Ok(()),
        false => Err(format!("{missing} triangles are in no leaf")),
    }
}
