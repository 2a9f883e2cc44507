//! Cells of a tree as coloured boxes in space (the survey's Figure 9).

use super::space::{Label, Paint, Panel, Solid, Space};
use super::worked;
use splitplane_core::aabb::Aabb;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::NodeKind;

/// By the way from the root: the first child is the left one, below the plane.
const PAINTS: [[Paint; 2]; 2] = [[Paint::Red, Paint::Blue], [Paint::Yellow, Paint::Green]];
/// How far boxes are moved apart, as a part of their distance from the middle.
const APART: f32 = 0.3;
/// Most boxes of a scene.
const MOST: usize = 120;

/// A cell, and the way to it from the root: 0 for the left child, 1 for the right.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// The cell.
    pub cell: Aabb,
    /// The way.
    pub way: Vec<u8>,
    /// Whether leaves under it have triangles.
    pub occupied: bool,
}

/// Leaves above a level and nodes on it, in preorder. So each comes after all that it may hide from a viewer who stands where
/// all coordinates are great.
pub fn to_level(tree: &KdTreeView<'_>, level: usize) -> Vec<Cell> {
    let mut out: Vec<Cell> = Vec::new();
    let mut way: Vec<u8> = Vec::new();
    tree.walk(|_, kind, cell, depth| {
        let depth = depth as usize;
        // Preorder: a node that is no deeper than the one before it is the right child of one of its ancestors.
        if depth <= way.len() && depth > 0 {
            way.truncate(depth);
            way[depth - 1] = 1;
        } else if depth > way.len() {
            way.push(0);
        }
        let full = matches!(kind, NodeKind::Leaf { count, .. } if count > 0);
        if depth > level {
            if let Some(last) = out.last_mut() {
                last.occupied |= full;
            }
            return;
        }
        if depth == level || matches!(kind, NodeKind::Leaf { .. }) {
            out.push(Cell { cell: *cell, way: way.clone(), occupied: full });
        }
    });
    out
}

pub(super) fn paint(way: &[u8]) -> Paint {
    let turn = |level: usize| usize::from(way.get(level).copied().unwrap_or(0));
    PAINTS[turn(0)][turn(1)]
}

/// A box moved away from the middle of all.
pub(super) fn apart(cell: &Aabb, bounds: &Aabb) -> Aabb {
    let shift: [f32; 3] = std::array::from_fn(|axis| {
        let middle = |bounds: &Aabb| 0.5 * bounds.lo[axis] + 0.5 * bounds.hi[axis];
        APART * (middle(cell) - middle(bounds))
    });
    Aabb {
        lo: std::array::from_fn(|axis| cell.lo[axis] + shift[axis]),
        hi: std::array::from_fn(|axis| cell.hi[axis] + shift[axis]),
    }
}

/// The cells of the survey's Figure 8.
fn worked_panel() -> Panel {
    let tree = worked::figure_8();
    let names = worked::leaf_names();
    let mut panel = Panel {
        title: "The tree of Figure 8 in its cube, drawn apart".into(),
        solids: Vec::new(),
        paths: Vec::new(),
        labels: Vec::new(),
    };
    for (cell, name) in to_level(&tree, 2).iter().zip(names) {
        let bounds = apart(&cell.cell, &tree.bounds);
        panel.solids.push(Solid { bounds, paint: paint(&cell.way), opacity: 0.85 });
        // In the middle of the face that looks along z: none of these is hidden.
        let [lo, hi] = [bounds.lo, bounds.hi];
        let at = [0.5 * (lo[0] + hi[0]), 0.5 * (lo[1] + hi[1]), hi[2]];
        panel.labels.push(Label { at, words: name.to_owned() });
    }
    panel
}

/// The cells of a scene's tree, and the level down to which they are shown.
fn scene_panel(tree: &KdTreeView<'_>, name: &str) -> (Panel, usize) {
    let mut level = 2;
    let mut cells = to_level(tree, level);
    loop {
        let deeper = to_level(tree, level + 1);
        if deeper.len() > MOST || deeper == cells {
            break;
        }
        (cells, level) = (deeper, level + 1);
    }
    let solid = |cell: &Cell| Solid {
        bounds: apart(&cell.cell, &tree.bounds),
        paint: paint(&cell.way),
        opacity: if cell.occupied { 0.75 } else { 0.0 },
    };
    let solids = cells.iter().map(solid).collect();
    let title = format!("The tree of {name}, to level {level}");
    (Panel { title, solids, paths: Vec::new(), labels: Vec::new() }, level)
}

/// Figure 9: the worked example, and the tree of a scene.
pub fn figure_9(tree: &KdTreeView<'_>, name: &str) -> (Space, usize) {
    let (scene, level) = scene_panel(tree, name);
    let note = "red, blue: left child of the root and its children; yellow, green: right child; frames \
                without faces: cells without triangles";
    (Space { panels: vec![worked_panel(), scene], note: note.into() }, level)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The four leaves of Figure 8, by hand.
    #[test]
    fn the_worked_example_has_four_cells() {
        let tree = worked::figure_8();
        let cells = to_level(&tree, 2);
        let found: Vec<(Vec<u8>, [f32; 3], [f32; 3])> =
            cells.iter().map(|cell| (cell.way.clone(), cell.cell.lo, cell.cell.hi)).collect();
        assert_eq!(
            found,
            [
                (vec![0, 0], [0.0, 0.0, 0.0], [4.0, 2.0, 10.0]),
                (vec![0, 1], [0.0, 2.0, 0.0], [4.0, 10.0, 10.0]),
                (vec![1, 0], [4.0, 0.0, 0.0], [10.0, 8.0, 10.0]),
                (vec![1, 1], [4.0, 8.0, 0.0], [10.0, 10.0, 10.0]),
            ]
        );
        assert!(cells.iter().all(|cell| !cell.occupied), "the example has no triangles");
        assert_eq!(to_level(&tree, 0).len(), 1);
        assert_eq!(to_level(&tree, 1).len(), 2);
        assert_eq!(to_level(&tree, 9), cells);
    }

    /// No cell of a built tree is drawn before one that it may hide.
    #[test]
    fn cells_come_from_the_back_to_the_front() {
        use splitplane_core::backend::BuildOptions;
        let scene = splitplane::scene::Scene::open("builtin:city:3000").unwrap();
        let (tree, _) = splitplane_cpu::CpuBackend::new()
            .build_tree(&scene.mesh().unwrap(), &BuildOptions::default())
            .unwrap();
        let cells = to_level(&tree.view(), 7);
        assert!(cells.len() > 40);
        for (i, back) in cells.iter().enumerate() {
            for front in &cells[..i] {
                // The earlier one lies in front where it begins on an axis at which the later one ends.
                let hides = (0..3).all(|axis| front.cell.hi[axis] > back.cell.lo[axis])
                    && (0..3).any(|axis| front.cell.lo[axis] >= back.cell.hi[axis]);
                assert!(!hides, "{front:?} {back:?}");
            }
        }
        let occupied = cells.iter().filter(|cell| cell.occupied).count();
        assert!(occupied > 10 && occupied < cells.len(), "{occupied}");
    }
}
