//! A tree as boxes (the survey's Figure 4): what a plane through a scene meets of triangles and cells.

use super::clip::section;
use super::cut::across_and_up;
use splitplane::scene::Scene;
use splitplane_core::aabb::Aabb;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::NodeKind;

/// A cell that the plane meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Its box.
    pub cell: Aabb,
    /// Its level.
    pub depth: u32,
    /// Triangles of a leaf; `None` for a node whose children are left out.
    pub triangles: Option<u32>,
}

/// What a plane meets.
#[derive(Clone, Debug, PartialEq)]
pub struct Slice {
    /// The axis across the plane, and where on it the plane is.
    pub axis: usize,
    /// See `axis`.
    pub position: f32,
    /// The axes within the plane: to the right, upwards.
    pub axes: [usize; 2],
    /// The bounds of the scene.
    pub bounds: Aabb,
    /// Cells of leaves, and of nodes at the deepest level that is drawn.
    pub cells: Vec<Cell>,
    /// That level.
    pub level: u32,
    /// Where the plane meets triangles.
    pub segments: Vec<[[f64; 2]; 2]>,
}

/// Most cells of a drawing; beyond it lines run together.
const MOST_CELLS: usize = 700;

/// The slice across the axis on which most triangles are met, in the middle of the scene's vertices.
pub fn take(tree: &KdTreeView<'_>, scene: &Scene) -> Slice {
    let mut best = (0, 0.0, Vec::new());
    for axis in 0..3 {
        let position = middle(scene, &tree.bounds, axis);
        let [right, up] = plane_axes(axis);
        let segments: Vec<[[f64; 2]; 2]> = scene
            .triangles()
            .filter_map(|corners| section(corners, axis, f64::from(position)))
            .map(|ends| ends.map(|end| [end[right], end[up]]))
            .collect();
        if segments.len() > best.2.len() {
            best = (axis, position, segments);
        }
    }
    let (axis, position, segments) = best;
    let mut level = 4;
    let mut cells = met(tree, axis, position, level);
    loop {
        let deeper = met(tree, axis, position, level + 1);
        if deeper.len() > MOST_CELLS || deeper == cells {
            break;
        }
        (cells, level) = (deeper, level + 1);
    }
    let axes = plane_axes(axis);
    Slice { axis, position, axes, bounds: tree.bounds, cells, level, segments }
}

fn plane_axes(axis: usize) -> [usize; 2] {
    across_and_up((axis + 1) % 3, (axis + 2) % 3)
}

/// The median coordinate of triangles' first corners, kept inside the bounds.
fn middle(scene: &Scene, bounds: &Aabb, axis: usize) -> f32 {
    let mut all: Vec<f32> = scene
        .triangles()
        .map(|corners| corners[0][axis])
        .filter(|coordinate| coordinate.is_finite())
        .collect();
    all.sort_by(f32::total_cmp);
    let median = all.get(all.len() / 2).copied().unwrap_or(bounds.lo[axis]);
    // A little off, so that no plane of triangles lies in it.
    let extent = bounds.hi[axis] - bounds.lo[axis];
    (median + 0.003 * extent).clamp(bounds.lo[axis], bounds.hi[axis])
}

/// Leaves above a level and nodes of the level that the plane meets.
fn met(tree: &KdTreeView<'_>, axis: usize, position: f32, level: u32) -> Vec<Cell> {
    let mut cells = Vec::new();
    tree.walk(|_, kind, cell, depth| {
        let meets = cell.lo[axis] <= position && position < cell.hi[axis];
        let triangles = match kind {
            NodeKind::Leaf { count, .. } => Some(count),
            NodeKind::Interior { .. } => None,
        };
        if meets && (depth == level || (depth < level && triangles.is_some())) {
            cells.push(Cell { cell: *cell, depth, triangles });
        }
    });
    cells
}
