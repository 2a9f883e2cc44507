//! The survey's trees of points, whose axes take turns by level: its Figures 3 and 4 in the plane, 8 and 9 in space. Each is a
//! [`PointTree`] that was built.
//!
//! The survey keeps a point in every node. Our trees keep points in blocks of 16 and divide between two of them, so a cloud stands for each
//! figure: of the survey's seven points of Figure 8, each is the first one beyond a plane, which makes its coordinate the plane.

use super::cells::{apart, paint};
use super::space::{Label, Panel, Solid, Space};
use splitplane_core::aabb::Aabb;
use splitplane_core::points::build::{PointBuildError, PointOptions, build};
use splitplane_core::points::parts::{Part, walk_parts};
use splitplane_core::points::tree::{Axes, BLOCK, PointTree};
use splitplane_core::random::unit;

/// The side of the square and the cube.
pub const SIDE: f64 = 10.0;

/// The points of the survey's Figure 8: root, its children, their children.
pub const SEVEN: [[f32; 3]; 7] = [
    [4.0, 6.0, 2.0],
    [3.0, 2.0, 5.0],
    [6.0, 8.0, 8.0],
    [2.0, 1.0, 5.0],
    [3.0, 5.0, 3.0],
    [6.0, 4.0, 9.0],
    [8.0, 9.0, 3.0],
];

/// The cells that seven nodes with these points make, axes taking turns: 16 points are to be in each.
const CELLS: [[[f32; 3]; 2]; 8] = [
    [[0.0, 0.0, 0.0], [4.0, 2.0, 5.0]],
    [[0.0, 0.0, 5.0], [4.0, 2.0, 10.0]],
    [[0.0, 2.0, 0.0], [4.0, 10.0, 3.0]],
    [[0.0, 2.0, 3.0], [4.0, 10.0, 10.0]],
    [[4.0, 0.0, 0.0], [10.0, 8.0, 9.0]],
    [[4.0, 0.0, 9.0], [10.0, 8.0, 10.0]],
    [[4.0, 8.0, 0.0], [10.0, 10.0, 3.0]],
    [[4.0, 8.0, 3.0], [10.0, 10.0, 10.0]],
];

/// 128 points of a square, scattered.
pub fn in_the_plane() -> Vec<[f32; 2]> {
    (0..8 * BLOCK as u64)
        .map(|point| [0, 1].map(|axis| (SIDE * unit(3, &[point, axis])) as f32))
        .collect()
}

/// The survey's seven points first, and others between them, 16 to a cell.
pub fn in_space() -> Vec<[f32; 3]> {
    let mut points = SEVEN.to_vec();
    for (cell, [lower, upper]) in (0..).zip(CELLS) {
        let own = SEVEN
            .iter()
            .filter(|point| (0..3).all(|axis| (lower[axis]..upper[axis]).contains(&point[axis])));
        for point in own.count()..BLOCK {
            points.push([0, 1, 2].map(|axis| {
                // Off the planes, so that each is the survey's point's.
                let part = 0.05 + 0.9 * unit(8, &[cell, point as u64, axis as u64]);
                lower[axis] + (upper[axis] - lower[axis]) * part as f32
            }));
        }
    }
    points
}

/// The tree of a cloud by the survey's rule.
///
/// # Errors
/// No memory.
pub fn by_cycle<const N: usize>(points: &[[f32; N]]) -> Result<PointTree<N>, PointBuildError> {
    build(points, &PointOptions { axes: Axes::Cycle, ..PointOptions::default() })
}

/// A node or a block as figures show it.
#[derive(Clone, Debug, PartialEq)]
pub struct TreePart {
    /// Levels below the root.
    pub level: u32,
    /// The way from the root: 0 for the left child, 1 for the right.
    pub way: Vec<u8>,
    /// Its axis and plane; `None` for a block.
    pub plane: Option<(usize, f64)>,
    /// How many points are in it.
    pub points: usize,
    /// Its cell in the square or cube; of the square, z is 0.
    pub lower: [f64; 3],
    /// The other corner.
    pub upper: [f64; 3],
}

/// All nodes and blocks of a tree in a cube of this side, in preorder.
pub fn parts<const N: usize>(tree: &PointTree<N>, side: f64) -> Vec<TreePart> {
    let mut parts = Vec::new();
    let own = |x: f32| tree.unit().of_units(x).clamp(0.0, side);
    walk_parts(tree, |part: &Part<N>| {
        let corner = |corner: &[f32; N]| {
            std::array::from_fn(|axis| corner.get(axis).map_or(0.0, |&x| own(x)))
        };
        parts.push(TreePart {
            level: part.level,
            way: (0..part.level).map(|level| (part.way >> level & 1) as u8).collect(),
            plane: part.node.map(|node| (node.axis as usize, tree.unit().of_units(node.plane))),
            points: part.places.len(),
            lower: corner(&part.lower),
            upper: corner(&part.upper),
        });
        true
    });
    parts
}

/// Figures 3 and 8: a tree as a diagram.
#[derive(Clone, Debug, PartialEq)]
pub struct PointDiagram {
    /// What it shows.
    pub title: String,
    /// Its nodes and blocks, in preorder.
    pub parts: Vec<TreePart>,
    /// Words under the plane of a node, one for each in the order of levels, left to right; may be none.
    pub names: Vec<String>,
}

/// Figure 4: the same tree in the plane.
#[derive(Clone, Debug, PartialEq)]
pub struct PointPlane {
    /// The points.
    pub points: Vec<[f32; 2]>,
    /// Nodes and blocks of their tree, in preorder.
    pub parts: Vec<TreePart>,
}

/// The tree of Figures 3 and 4.
///
/// # Errors
/// No memory.
pub fn figures_3_and_4() -> Result<(PointDiagram, PointPlane), PointBuildError> {
    let points = in_the_plane();
    let parts = parts(&by_cycle(&points)?, SIDE);
    let title = format!("A tree of {} points of the plane, its axes taking turns", points.len());
    let diagram = PointDiagram { title, parts: parts.clone(), names: Vec::new() };
    Ok((diagram, PointPlane { points, parts }))
}

/// The tree of Figures 8 and 9.
///
/// # Errors
/// No memory.
pub fn figures_8_and_9() -> Result<(PointDiagram, Space), PointBuildError> {
    let points = in_space();
    let tree = by_cycle(&points)?;
    let parts = parts(&tree, SIDE);
    let names = SEVEN.iter().map(|[x, y, z]| format!("({x}, {y}, {z})")).collect();
    let panels = [2, 3].map(|level| panel(&parts, level)).to_vec();
    let title = format!("A tree of {} points of space, its axes taking turns", points.len());
    let note = "red, blue: left child of the root and its children; yellow, green: right child; on the right each is \
                divided once more, across z";
    Ok((PointDiagram { title, parts, names }, Space { panels, note: note.into() }))
}

/// The cells of a level, drawn apart.
fn panel(parts: &[TreePart], level: u32) -> Panel {
    let cube = Aabb { lo: [0.0; 3], hi: [SIDE as f32; 3] };
    let mut panel = Panel {
        title: format!("Level {level} of the tree of Figure 8 in its cube"),
        solids: Vec::new(),
        paths: Vec::new(),
        labels: Vec::new(),
    };
    for part in parts.iter().filter(|part| part.level == level) {
        let cell = Aabb { lo: part.lower.map(|x| x as f32), hi: part.upper.map(|x| x as f32) };
        let bounds = apart(&cell, &cube);
        panel.solids.push(Solid { bounds, paint: paint(&part.way), opacity: 0.85 });
        let [lo, hi] = [bounds.lo, bounds.hi];
        let at = [0.5 * (lo[0] + hi[0]), 0.5 * (lo[1] + hi[1]), hi[2]];
        // Of the eight cells those below are hidden.
        let words = if level == 2 { format!("{} points", part.points) } else { String::new() };
        panel.labels.push(Label { at, words });
    }
    panel
}

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane_core::points::parts::dump;

    /// Each node's plane goes through the survey's point that the node is named after, across the axis of its level.
    #[test]
    fn the_tree_of_figure_8_is_the_surveys() {
        let tree = by_cycle(&in_space()).unwrap();
        let mut nodes: Vec<(u32, usize, f64)> = parts(&tree, SIDE)
            .iter()
            .filter_map(|part| part.plane.map(|(axis, plane)| (part.level, axis, plane)))
            .collect();
        // Preorder by levels: stable.
        nodes.sort_by_key(|node| node.0);
        let levels = [0, 1, 1, 2, 2, 2, 2];
        let expected: Vec<(u32, usize, f64)> = SEVEN
            .iter()
            .zip(levels)
            .map(|(point, level)| (level as u32, level, f64::from(point[level])))
            .collect();
        assert_eq!(nodes, expected);
        // The widest extent gives another tree: the check above can fail.
        let other = build(&in_space(), &PointOptions::default()).unwrap();
        assert_ne!(other.nodes(), tree.nodes());
    }

    #[test]
    fn cells_are_those_that_were_meant_and_hold_their_points() {
        let tree = by_cycle(&in_space()).unwrap();
        let leaves: Vec<TreePart> =
            parts(&tree, SIDE).into_iter().filter(|part| part.plane.is_none()).collect();
        let cells: Vec<[[f64; 3]; 2]> =
            leaves.iter().map(|leaf| [leaf.lower, leaf.upper]).collect();
        assert_eq!(cells, CELLS.map(|cell| cell.map(|corner| corner.map(f64::from))));
        assert!(leaves.iter().all(|leaf| leaf.points == BLOCK));
        let ways: Vec<Vec<u8>> = leaves.iter().map(|leaf| leaf.way.clone()).collect();
        let expected: Vec<Vec<u8>> =
            (0..8).map(|way: u8| [2, 1, 0].map(|bit| way >> bit & 1).to_vec()).collect();
        assert_eq!(ways, expected);
        let points = in_the_plane();
        let flat = by_cycle(&points).unwrap();
        walk_parts(&flat, |part| {
            for point in &flat.points()[part.places.clone()] {
                for axis in 0..2 {
                    assert!((part.lower[axis]..=part.upper[axis]).contains(&point[axis]));
                }
            }
            true
        });
    }

    #[test]
    fn snapshot() {
        let text = [
            dump(&by_cycle(&in_the_plane()).unwrap(), usize::MAX),
            dump(&by_cycle(&in_space()).unwrap(), usize::MAX),
        ];
        insta::assert_snapshot!("point-trees", text.join("\n"));
    }
}
