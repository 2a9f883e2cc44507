//! The survey's worked example: the tree of its Figure 8, its Tables 1 and 2, and Equation 4.

use super::table::{Cell, Table};
use serde::Serialize;
use splitplane_core::aabb::Aabb;
use splitplane_core::config::BuildConfig;
use splitplane_core::sah::{equation_1, equation_2, equation_6, half_area_of, split_cost};
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::cost::{equation_3, equation_5, equation_5_printed};
use splitplane_core::tree::node::{Axis, KdNode, NodeKind};

/// A node of Figure 8, as printed and as computed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The node's three keys, by which it is named there.
    pub name: &'static str,
    /// Its cell.
    pub extents: [f64; 3],
    /// Table 1: the terms of the half area, as they are printed.
    pub printed_terms: &'static str,
    /// What these terms come to.
    pub printed_terms_value: f64,
    /// The half area, as printed.
    pub printed_area: f64,
    /// The half area.
    pub area: f64,
    /// k, the number of children.
    pub children: u32,
    /// Table 2: Equation 2 with the area as printed.
    pub printed_cost: f64,
    /// Equation 2.
    pub cost: f64,
    /// What is wrong in print; empty where nothing is.
    pub misprint: &'static str,
}

/// The worked example.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Worked {
    /// All seven nodes, in the order of Table 1.
    pub rows: Vec<Row>,
    /// Equation 4, as printed.
    pub equation_4_printed: f64,
    /// Equation 4: [`equation_3`] of the tree.
    pub equation_4: f64,
    /// Equations 1, 5 and 6, as printed and as they are used.
    pub forms: Vec<Form>,
}

/// An equation in one of its forms, applied to the example.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Form {
    /// The equation's number in the survey.
    pub equation: u32,
    /// Which form.
    pub form: &'static str,
    /// What it is applied to.
    pub of: String,
    /// What comes out.
    pub value: f64,
}

/// Triangles in every leaf where a form counts them: the survey's example has none.
const IN_A_LEAF: u32 = 10;

/// What is printed of a node.
struct Printed {
    name: &'static str,
    /// Its index in the tree, in preorder.
    node: usize,
    terms: &'static str,
    terms_value: f64,
    area: f64,
    misprint: &'static str,
}

/// Table 1, in its order.
const PRINTED: [Printed; 7] = [
    Printed {
        name: "(4, 6, 2)",
        node: 0,
        terms: "(10 + 10) 10 + 10 x 10",
        terms_value: (10.0 + 10.0) * 10.0 + 10.0 * 10.0,
        area: 300.0,
        misprint: "",
    },
    Printed {
        name: "(3, 2, 5)",
        node: 1,
        terms: "(4 + 10) 10 + 4 x 10",
        terms_value: (4.0 + 10.0) * 10.0 + 4.0 * 10.0,
        area: 180.0,
        misprint: "",
    },
    Printed {
        name: "(6, 8, 8)",
        node: 4,
        terms: "(6 + 10) 10 + 4 x 10",
        terms_value: (6.0 + 10.0) * 10.0 + 4.0 * 10.0,
        area: 220.0,
        misprint: "a term: 6 x 10, not 4 x 10; 220 is right",
    },
    Printed {
        name: "(2, 1, 5)",
        node: 2,
        terms: "(4 + 2) 10 + 4 x 2",
        terms_value: (4.0 + 2.0) * 10.0 + 4.0 * 2.0,
        area: 88.0,
        misprint: "the sum: 68, not 88",
    },
    Printed {
        name: "(3, 5, 3)",
        node: 3,
        terms: "(4 + 8) 10 + 4 x 8",
        terms_value: (4.0 + 8.0) * 10.0 + 4.0 * 8.0,
        area: 152.0,
        misprint: "",
    },
    Printed {
        name: "(6, 4, 9)",
        node: 5,
        terms: "(6 + 8) 10 + 6 x 8",
        terms_value: (6.0 + 8.0) * 10.0 + 6.0 * 8.0,
        area: 188.0,
        misprint: "",
    },
    Printed {
        name: "(8, 9, 3)",
        node: 6,
        terms: "(6 + 2) 10 + 6 x 2",
        terms_value: (6.0 + 2.0) * 10.0 + 6.0 * 2.0,
        area: 92.0,
        misprint: "",
    },
];

/// Figure 8: the root splits x at 4; its left child splits y at 2, its right child y at 8. The
/// third level, which would split z, are leaves.
const NODES: [KdNode; 7] = [
    KdNode::interior(Axis::X, 4.0, 4),
    KdNode::interior(Axis::Y, 2.0, 3),
    KdNode::leaf(0, 0),
    KdNode::leaf(0, 0),
    KdNode::interior(Axis::Y, 8.0, 6),
    KdNode::leaf(0, 0),
    KdNode::leaf(0, 0),
];

/// The tree of the survey's Figure 8 in its bounds, a cube of side 10. Its leaves are empty: the survey's example
/// has points in its nodes, and counts no triangles.
pub fn figure_8() -> KdTreeView<'static> {
    KdTreeView {
        nodes: &NODES,
        references: &[],
        bounds: Aabb { lo: [0.0; 3], hi: [10.0; 3] },
        triangles: 0,
        config: BuildConfig::default(),
    }
}

/// The names of its leaves, in preorder.
pub fn leaf_names() -> [&'static str; 4] {
    let mut leaves: Vec<(usize, &'static str)> = PRINTED
        .iter()
        .filter(|printed| matches!(NODES[printed.node].kind(), NodeKind::Leaf { .. }))
        .map(|printed| (printed.node, printed.name))
        .collect();
    leaves.sort_unstable();
    std::array::from_fn(|place| leaves.get(place).map_or("", |leaf| leaf.1))
}

impl Worked {
    /// Computes the example with the equations of [`splitplane_core::sah`].
    pub fn compute() -> Worked {
        let tree = figure_8();
        let mut nodes = [(Aabb::EMPTY, 0); NODES.len()];
        tree.walk(|index, kind, cell, _| {
            let children = if matches!(kind, NodeKind::Interior { .. }) { 2 } else { 0 };
            nodes[index] = (*cell, children);
        });
        let root = half_area_of(&tree.bounds);
        let row = |printed: &Printed| {
            let (cell, children) = nodes[printed.node];
            let area = half_area_of(&cell);
            Row {
                name: printed.name,
                extents: [0, 1, 2].map(|axis| f64::from(cell.hi[axis]) - f64::from(cell.lo[axis])),
                printed_terms: printed.terms,
                printed_terms_value: printed.terms_value,
                printed_area: printed.area,
                area,
                children,
                printed_cost: equation_2(children, printed.area, root),
                cost: equation_2(children, area, root),
                misprint: printed.misprint,
            }
        };
        Worked {
            rows: PRINTED.iter().map(row).collect(),
            equation_4_printed: 4.67,
            equation_4: equation_3(&tree),
            forms: forms(&tree),
        }
    }

    /// Equations 1, 5 and 6 in all their forms.
    pub fn table_of_forms(&self) -> Table {
        let mut table = Table::new(&["equation", "form", "applied to", "comes to"]);
        for form in &self.forms {
            table.push(vec![
                form.equation.into(),
                form.form.into(),
                form.of.as_str().into(),
                Cell::Number(form.value, 4),
            ]);
        }
        table
    }

    /// Table 1: half areas.
    pub fn table_1(&self) -> Table {
        let mut table = Table::new(&[
            "node",
            "cell",
            "printed terms",
            "printed terms come to",
            "printed",
            "computed",
            "misprint",
        ]);
        for row in &self.rows {
            let [x, y, z] = row.extents;
            table.push(vec![
                row.name.into(),
                format!("{x} x {y} x {z}").into(),
                row.printed_terms.into(),
                Cell::Number(row.printed_terms_value, 0),
                Cell::Number(row.printed_area, 0),
                Cell::Number(row.area, 0),
                row.misprint.into(),
            ]);
        }
        table
    }

    /// Table 2 and Equation 4: costs.
    pub fn table_2(&self) -> Table {
        let mut table = Table::new(&["node", "k", "as printed", "printed", "computed"]);
        for row in &self.rows {
            table.push(vec![
                row.name.into(),
                row.children.into(),
                format!("{} ({} / 300)", row.children, row.printed_area).into(),
                Cell::Number(row.printed_cost, 4),
                Cell::Number(row.cost, 4),
            ]);
        }
        table.push(vec![
            "all, Equation 4".into(),
            Cell::Missing,
            "2 (1 + 18/30 + 22/30)".into(),
            Cell::Number(self.equation_4_printed, 2),
            Cell::Number(self.equation_4, 2),
        ]);
        table
    }
}

/// Equations 1, 5 and 6 of the tree of Figure 8, at the knobs of preset `fast`.
fn forms(tree: &KdTreeView<'_>) -> Vec<Form> {
    let config = tree.config;
    let [traversal, intersection] =
        [config.traversal_cost, config.intersection_cost].map(f64::from);
    let root = half_area_of(&tree.bounds);
    let (mut interior, mut leaves, mut sides) = (0.0, 0.0, [root; 3]);
    tree.walk(|index, kind, cell, _| {
        let area = half_area_of(cell);
        match kind {
            NodeKind::Interior { .. } => interior += area,
            NodeKind::Leaf { .. } => leaves += area * f64::from(IN_A_LEAF),
        }
        match index {
            1 => sides[1] = area,
            4 => sides[2] = area,
            _ => {}
        }
    });
    let below = 2 * IN_A_LEAF;
    let blocks = f64::from(below.div_ceil(config.block_width));
    let costs = format!("K_T {traversal}, K_I {intersection}");
    let split =
        format!("the root's split, {below} triangles on either side, {costs}, in units of K_I");
    let ratio = traversal / intersection;
    let cell =
        [0, 1, 2].map(|axis| f64::from(tree.bounds.hi[axis]) - f64::from(tree.bounds.lo[axis]));
    let whole = split_cost(&config, sides.map(|area| area as u32), below, below);
    let form = |equation, form, of: &str, value| Form { equation, form, of: of.into(), value };
    vec![
        form(1, "as printed", "the root's cell", equation_1(cell)),
        form(1, "half, as Tables 1 and 2 and all costs take it", "the root's cell", root),
        form(
            5,
            "as printed: areas over the parent's, K_I once a leaf",
            &format!("the tree, {costs}"),
            equation_5_printed(traversal, intersection, tree),
        ),
        form(
            5,
            "corrected: areas over the root's, K_I for each triangle",
            &format!("the tree with {IN_A_LEAF} triangles in each leaf, {costs}"),
            equation_5(traversal, intersection, root, interior, leaves),
        ),
        form(
            6,
            "as printed: C_ts and triangles (W = 1)",
            &split,
            equation_6(ratio, sides, below.into(), below.into()),
        ),
        form(6, "blocks of W = 16 triangles", &split, equation_6(ratio, sides, blocks, blocks)),
        form(
            6,
            "blocks of W = 16, the builders' integers over K_I and the area",
            &split,
            f64::from(whole) / (intersection * root),
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_misprints_are_those_and_no_others() {
        let worked = Worked::compute();
        // Surfaces of boxes, face by face, halved.
        let faces = |[x, y, z]: [f64; 3]| (2.0 * x * y + 2.0 * y * z + 2.0 * x * z) / 2.0;
        for row in &worked.rows {
            assert_eq!(row.area, faces(row.extents), "{}", row.name);
            let right = [row.printed_terms_value == row.area, row.printed_area == row.area];
            let expected = match row.name {
                "(2, 1, 5)" => [true, false],
                "(6, 8, 8)" => [false, true],
                _ => [true, true],
            };
            assert_eq!((right, row.misprint.is_empty()), (expected, expected == [true; 2]));
        }
        let sum: f64 = worked.rows.iter().map(|row| row.printed_cost).sum();
        assert!((sum - worked.equation_4).abs() < 1e-12, "no misprint reaches the sum");
        assert_eq!(format!("{:.2}", worked.equation_4), "4.67");
    }

    /// By hand, with K_T 1, K_I 4, half areas 300, 180 and 220 of the upper nodes and 68, 152, 188, 92 of the leaves.
    #[test]
    fn forms_of_equations_by_hand() {
        let values: Vec<f64> = Worked::compute().forms.iter().map(|form| form.value).collect();
        let leaves = 68.0 + 152.0 + 188.0 + 92.0;
        let printed =
            1.0 + (180.0 + 220.0) / 300.0 + 4.0 * ((68.0 + 152.0) / 180.0 + (188.0 + 92.0) / 220.0);
        let corrected = (700.0 + 4.0 * 10.0 * leaves) / 300.0;
        let (triangles, blocks) = (0.25 + 20.0 * 400.0 / 300.0, 0.25 + 2.0 * 400.0 / 300.0);
        let expected = [600.0, 300.0, printed, corrected, triangles, blocks, blocks];
        assert_eq!(values.len(), expected.len());
        for (value, expected) in values.into_iter().zip(expected) {
            assert!((value - expected).abs() < 1e-12, "{value} {expected}");
        }
    }

    /// All that the report says of the example.
    #[test]
    fn snapshot() {
        let worked = Worked::compute();
        insta::assert_snapshot!(
            "figure-8",
            format!(
                "{}\n{}\n{}\n{}",
                splitplane_core::tree::dump::dump(&figure_8(), usize::MAX),
                worked.table_1().markdown(),
                worked.table_2().markdown(),
                worked.table_of_forms().markdown()
            )
        );
    }
}
