//! Figure 10: empty space cut off, and the rest split in the middle.

use super::map::Map;
use super::style::{BLUE, FAINT, GREEN, INK, ORANGE, TEXT, bold, letters};
use super::{Area, Drawn, Plot};
use crate::paper::cut::Cut;
use plotters::prelude::{DrawingBackend, Text};
use plotters::style::Color;
use plotters::style::text_anchor::{HPos, VPos};
use splitplane_core::aabb::Aabb;
use splitplane_core::build::split::SplitPlane;

/// Names of the axes.
pub(super) const NAMES: [&str; 3] = ["x", "y", "z"];

impl Plot for Cut {
    const SIZE: (u32, u32) = (1200, 700);

    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let titles = [
            "The node's triangles and their bounds",
            "Empty space cut off, the rest split at its median",
        ];
        for (panel, title) in titles.into_iter().enumerate() {
            let left = 40.0 + 580.0 * panel as f64;
            area.draw(&Text::new(title, (left as i32, 26), bold(20, INK, HPos::Left, VPos::Top)))?;
            let map = self.map([left, 70.0, left + 540.0, 620.0]);
            self.triangles(area, &map)?;
            match panel {
                0 => self.bounds(area, &map)?,
                _ => self.planes(area, &map)?,
            }
        }
        let [right, up] = self.axes.map(|axis| NAMES[axis]);
        let note = format!(
            "node {} at level {}, {} triangles; {right} to the right, {up} upwards",
            self.node,
            self.depth,
            self.polygons.len()
        );
        area.draw(&Text::new(note, (40, 662), letters(TEXT, INK, HPos::Left, VPos::Top)))?;
        Ok(())
    }
}

impl Cut {
    fn map(&self, pixels: [f64; 4]) -> Map {
        let [lower, upper] = self.corners(&self.cell);
        Map::new(lower, upper, pixels)
    }

    /// A box on the two axes.
    fn corners(&self, cell: &Aabb) -> [[f64; 2]; 2] {
        [cell.lo, cell.hi].map(|corner| self.axes.map(|axis| f64::from(corner[axis])))
    }

    fn triangles<B: DrawingBackend>(&self, area: &Area<B>, map: &Map) -> Drawn
    where
        B::ErrorType: 'static,
    {
        for polygon in &self.polygons {
            let flat: Vec<[f64; 2]> =
                polygon.iter().map(|corner| self.axes.map(|axis| corner[axis])).collect();
            map.polygon(area, &flat, GREEN.mix(0.12))?;
            let closed: Vec<[f64; 2]> = flat.iter().chain(flat.first()).copied().collect();
            map.line(area, &closed, GREEN.mix(0.55).stroke_width(1))?;
        }
        Ok(())
    }

    fn bounds<B: DrawingBackend>(&self, area: &Area<B>, map: &Map) -> Drawn
    where
        B::ErrorType: 'static,
    {
        map.rectangle(area, self.corners(&self.cell), INK.stroke_width(2))?;
        let [[x0, y0], [x1, y1]] = self.corners(&self.tight);
        for side in
            [[[x0, y0], [x1, y0]], [[x1, y0], [x1, y1]], [[x1, y1], [x0, y1]], [[x0, y1], [x0, y0]]]
        {
            map.dashes(area, side, ORANGE.stroke_width(2))?;
        }
        let [left, _, _, bottom] = map.edges();
        let at = |line: i32| (left, bottom + 9 + 19 * line);
        area.draw(&Text::new("cell", at(0), letters(15, INK, HPos::Left, VPos::Top)))?;
        let (x, y) = at(0);
        let style = letters(15, ORANGE, HPos::Left, VPos::Top);
        area.draw(&Text::new("bounds of the triangles in it", (x + 50, y), style))?;
        Ok(())
    }

    fn planes<B: DrawingBackend>(&self, area: &Area<B>, map: &Map) -> Drawn
    where
        B::ErrorType: 'static,
    {
        // What is cut off, in the order of the cuts: each from what the ones before left.
        let mut cell = self.cell;
        for (number, cut) in self.cuts.iter().enumerate() {
            let low = self.left.lo[cut.axis] >= cut.position;
            let (mut off, mut rest) = (cell, cell);
            if low {
                (off.hi[cut.axis], rest.lo[cut.axis]) = (cut.position, cut.position);
            } else {
                (off.lo[cut.axis], rest.hi[cut.axis]) = (cut.position, cut.position);
            }
            if self.axes.contains(&cut.axis) {
                map.rectangle(area, self.corners(&off), FAINT.mix(0.55).filled())?;
                self.plane(area, map, &cell, *cut, ORANGE)?;
                let [a, b] = self.corners(&off);
                let middle = map.pixel([0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]);
                let style = bold(20, ORANGE, HPos::Center, VPos::Center);
                area.draw(&Text::new((number + 1).to_string(), middle, style))?;
            }
            cell = rest;
        }
        map.rectangle(area, self.corners(&self.cell), INK.stroke_width(2))?;
        self.plane(area, map, &self.left, self.split, BLUE)?;
        let [left, _, _, bottom] = map.edges();
        let style = |colour| letters(15, colour, HPos::Left, VPos::Top);
        let mut cuts = "cut off, in this order".to_owned();
        for (number, cut) in self.cuts.iter().enumerate() {
            if !self.axes.contains(&cut.axis) {
                cuts += &format!("; {} is across {}", number + 1, NAMES[cut.axis]);
            }
        }
        area.draw(&Text::new(cuts, (left, bottom + 9), style(ORANGE)))?;
        area.draw(&Text::new("median split", (left, bottom + 28), style(BLUE)))?;
        Ok(())
    }

    /// A plane across a cell.
    fn plane<B: DrawingBackend>(
        &self,
        area: &Area<B>,
        map: &Map,
        cell: &Aabb,
        plane: SplitPlane,
        colour: plotters::style::RGBColor,
    ) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let [mut a, mut b] = self.corners(cell);
        let across = usize::from(self.axes[1] == plane.axis);
        (a[across], b[across]) = (plane.position.into(), plane.position.into());
        map.line(area, &[a, b], colour.stroke_width(3))?;
        Ok(())
    }
}
