//! The survey's worked example (its Tables 1 and 2 and Equation 4), as far as it is known here.

use super::table::{Cell, Table};
use serde::Serialize;
use splitplane_core::sah::{equation_2, equation_4, half_area};

/// A half area of Table 1 whose terms are known, which are those with a misprint.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The row, as it is named there.
    pub name: &'static str,
    /// Extents of the part.
    pub extents: [f64; 3],
    /// The terms, as they are printed.
    pub typed: &'static str,
    /// What these terms come to.
    pub typed_value: f64,
    /// The printed half area.
    pub printed: f64,
    /// The half area.
    pub computed: f64,
    /// What is wrong.
    pub misprint: &'static str,
}

/// The worked example.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Worked {
    /// Table 1: half areas.
    pub table_1: Vec<Row>,
    /// Table 2: what the misprinted area adds to the cost, printed and computed.
    pub empty_part: [f64; 2],
    /// Equation 4, as printed.
    pub equation_4_printed: f64,
    /// Equation 4 of a cut with the same cost.
    pub equation_4: f64,
}

/// The whole of the cut that stands in for the survey's: a cube.
const CUBE: [f64; 3] = [10.0; 3];
/// Either half of it.
const HALF: [f64; 3] = [5.0, 10.0, 10.0];

impl Worked {
    /// Computes the example with the equations of [`splitplane_core::sah`].
    pub fn compute() -> Worked {
        let row = |name, extents, typed, typed_value, printed, misprint| Row {
            name,
            extents,
            typed,
            typed_value,
            printed,
            computed: half_area(extents),
            misprint,
        };
        let table_1 = vec![
            row(
                "(2, 1, 5)",
                [4.0, 2.0, 10.0],
                "(4 + 2) 10 + 4 x 2",
                (4.0 + 2.0) * 10.0 + 4.0 * 2.0,
                88.0,
                "the sum: 68, not 88",
            ),
            row(
                "(6, 8, 8)",
                [6.0, 10.0, 10.0],
                "(6 + 10) 10 + 4 x 10",
                (6.0 + 10.0) * 10.0 + 4.0 * 10.0,
                220.0,
                "a term: 6 x 10, not 4 x 10; 220 is right",
            ),
        ];
        let whole = half_area(CUBE);
        let half = half_area(HALF);
        let none = |area| 0.0 * equation_2(area, whole);
        Worked {
            empty_part: [none(table_1[0].printed), none(table_1[0].computed)],
            equation_4_printed: 4.67,
            equation_4: equation_4([whole, half, half], 2.0, 5.0),
            table_1,
        }
    }

    /// Table 1.
    pub fn table_1(&self) -> Table {
        let mut table = Table::new(&[
            "row",
            "extents",
            "printed terms",
            "printed terms come to",
            "printed",
            "computed",
            "misprint",
        ]);
        for row in &self.table_1 {
            let [x, y, z] = row.extents;
            table.push(vec![
                row.name.into(),
                format!("{x} x {y} x {z}").into(),
                row.typed.into(),
                Cell::Number(row.typed_value, 0),
                Cell::Number(row.printed, 0),
                Cell::Number(row.computed, 0),
                row.misprint.into(),
            ]);
        }
        table
    }

    /// Table 2 and Equation 4: costs.
    pub fn table_2(&self) -> Table {
        let mut table = Table::new(&["cost", "printed", "computed"]);
        table.push(vec![
            "part (2, 1, 5), without triangles: 0 x area / whole".into(),
            Cell::Number(self.empty_part[0], 2),
            Cell::Number(self.empty_part[1], 2),
        ]);
        table.push(vec![
            "Equation 4".into(),
            Cell::Number(self.equation_4_printed, 2),
            Cell::Number(self.equation_4, 2),
        ]);
        table
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_misprints_are_those_and_no_others() {
        let worked = Worked::compute();
        // Surfaces of boxes, face by face, halved.
        let faces = |[x, y, z]: [f64; 3]| (2.0 * x * y + 2.0 * y * z + 2.0 * x * z) / 2.0;
        for row in &worked.table_1 {
            assert_eq!(row.computed, faces(row.extents), "{}", row.name);
            let right = [row.typed_value == row.computed, row.printed == row.computed];
            assert_eq!(right, if row.name == "(2, 1, 5)" { [true, false] } else { [false, true] });
        }
        assert_eq!(worked.empty_part, [0.0; 2]);
        assert_eq!(
            format!("{:.2}", worked.equation_4),
            format!("{:.2}", worked.equation_4_printed)
        );
        assert_eq!((worked.table_1().rows().len(), worked.table_2().rows().len()), (2, 2));
    }
}
