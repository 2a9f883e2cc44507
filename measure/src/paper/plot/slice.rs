//! Figure 4: a tree as boxes, on a slice through its scene.

use super::cut::NAMES;
use super::map::Map;
use super::style::{BLUE, GREEN, INK, TEXT, TITLE, letters};
use super::{Area, Drawn, Plot};
use crate::paper::slice::Slice;
use plotters::prelude::{DrawingBackend, Text};
use plotters::style::Color;
use plotters::style::text_anchor::{HPos, VPos};

impl Plot for Slice {
    const SIZE: (u32, u32) = (1200, 860);

    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let [lower, upper] = [self.bounds.lo, self.bounds.hi]
            .map(|corner| self.axes.map(|axis| f64::from(corner[axis])));
        let map = Map::new(lower, upper, [40.0, 70.0, 1160.0, 790.0]);
        let title = format!(
            "Cells of the tree where {} = {:.4}, to level {}",
            NAMES[self.axis], self.position, self.level
        );
        area.draw(&Text::new(title, (40, 24), letters(TITLE, INK, HPos::Left, VPos::Top)))?;
        for cell in &self.cells {
            let corners = [cell.cell.lo, cell.cell.hi]
                .map(|corner| self.axes.map(|axis| f64::from(corner[axis])));
            // The more triangles, the darker; empty leaves stay white.
            let shade = match cell.triangles {
                Some(0) => 0.0,
                Some(count) => 0.08 + 0.05 * f64::from(count).log2(),
                None => 0.45,
            };
            if shade > 0.0 {
                map.rectangle(area, corners, BLUE.mix(shade.min(0.45)).filled())?;
            }
            map.rectangle(area, corners, BLUE.mix(0.8).stroke_width(1))?;
        }
        for segment in &self.segments {
            map.line(area, segment, GREEN.stroke_width(2))?;
        }
        let [right, up] = self.axes.map(|axis| NAMES[axis]);
        let (empty, full) = self.cells.iter().fold((0, 0), |(empty, full), cell| {
            if cell.triangles == Some(0) { (empty + 1, full) } else { (empty, full + 1) }
        });
        let note = format!(
            "{} cells, {empty} of them empty (white), {full} with triangles (blue); {} triangles are \
             met (green); {right} to the right, {up} upwards",
            self.cells.len(),
            self.segments.len()
        );
        area.draw(&Text::new(note, (40, 818), letters(TEXT, INK, HPos::Left, VPos::Top)))?;
        Ok(())
    }
}
