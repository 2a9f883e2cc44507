//! Figures 3, 4 and 8: trees of points, as diagrams and in the plane.

use super::cut::NAMES;
use super::map::Map;
use super::style::{BLUE, GREEN, INK, ORANGE, TEXT, TITLE, letters};
use super::{Area, Drawn, Plot};
use crate::paper::point_trees::{PointDiagram, PointPlane, SIDE};
use plotters::prelude::{Circle, DrawingBackend, PathElement, RGBColor, Rectangle, Text};
use plotters::style::text_anchor::{HPos, VPos};
use plotters::style::{Color, WHITE};

/// The colour of planes across an axis.
const ACROSS: [RGBColor; 3] = [BLUE, ORANGE, GREEN];

impl Plot for PointDiagram {
    const SIZE: (u32, u32) = (1200, 640);

    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let style = letters(TITLE, INK, HPos::Left, VPos::Top);
        area.draw(&Text::new(self.title.clone(), (40, 24), style))?;
        let deepest = self.parts.iter().map(|part| part.level).max().unwrap_or(0);
        let row = 440.0 / f64::from(deepest.max(1));
        // The way from the root halves what is left of the width.
        let at = |way: &[u8]| {
            let (mut middle, mut half) = (600.0f64, 280.0);
            for &turn in way {
                middle += if turn == 0 { -half } else { half };
                half *= 0.5;
            }
            (middle.round() as i32, (110.0 + row * way.len() as f64).round() as i32)
        };
        for part in &self.parts {
            if let Some((_, above)) = part.way.split_last() {
                let line = [at(above), at(&part.way)];
                area.draw(&PathElement::new(line, INK.mix(0.6).stroke_width(2)))?;
            }
        }
        for part in &self.parts {
            let (x, y) = at(&part.way);
            let Some((axis, plane)) = part.plane else {
                let corners = [(x - 34, y - 20), (x + 34, y + 20)];
                area.draw(&Rectangle::new(corners, WHITE.filled()))?;
                area.draw(&Rectangle::new(corners, INK.stroke_width(2)))?;
                let style = letters(15, INK, HPos::Center, VPos::Center);
                area.draw(&Text::new(format!("{} pts", part.points), (x, y), style))?;
                continue;
            };
            let words = format!("{} = {}", NAMES[axis.min(2)], short(plane));
            let half = if self.names.is_empty() { 19 } else { 28 };
            let corners = [(x - 54, y - half), (x + 54, y + half)];
            area.draw(&Rectangle::new(corners, ACROSS[axis.min(2)].filled()))?;
            let up = if self.names.is_empty() { 0 } else { 11 };
            let style = letters(18, WHITE, HPos::Center, VPos::Center);
            area.draw(&Text::new(words, (x, y - up), style))?;
            if let Some(name) = self.names.get(by_level(&part.way)) {
                let style = letters(16, WHITE, HPos::Center, VPos::Center);
                area.draw(&Text::new(name.clone(), (x, y + 12), style))?;
            }
        }
        let note = "coloured: the plane that divides a node, less to the left; white: blocks and their points";
        area.draw(&Text::new(note, (40, 602), letters(TEXT, INK, HPos::Left, VPos::Top)))?;
        Ok(())
    }
}

/// The number of a node, level by level from left to right.
fn by_level(way: &[u8]) -> usize {
    way.iter().fold(1, |number, &turn| 2 * number + usize::from(turn)) - 1
}

/// Two digits behind the point, but none that say nothing.
fn short(x: f64) -> String {
    let text = format!("{x:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

impl Plot for PointPlane {
    const SIZE: (u32, u32) = (820, 900);

    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let map = Map::new([0.0; 2], [SIDE; 2], [50.0, 70.0, 770.0, 790.0]);
        let title = "The tree of Figure 3 in the plane";
        area.draw(&Text::new(title, (50, 24), letters(TITLE, INK, HPos::Left, VPos::Top)))?;
        map.rectangle(area, [[0.0; 2], [SIDE; 2]], INK.stroke_width(2))?;
        for part in &self.parts {
            let (lower, upper) = (part.lower, part.upper);
            let Some((axis, plane)) = part.plane else { continue };
            let mut ends = [[lower[0], lower[1]], [upper[0], upper[1]]];
            ends[0][axis.min(1)] = plane;
            ends[1][axis.min(1)] = plane;
            // The higher, the thicker.
            let width = 7 - 2 * part.level.min(3);
            map.line(area, &ends, ACROSS[axis.min(1)].stroke_width(width))?;
        }
        for &[x, y] in &self.points {
            let place = map.pixel([f64::from(x), f64::from(y)]);
            area.draw(&Circle::new(place, 4, INK.filled()))?;
        }
        let notes = [
            "x to the right, y upwards; blue: planes across x, orange: across y;",
            "the thickest divides the root",
        ];
        for (line, note) in (0..).zip(notes) {
            let style = letters(TEXT, INK, HPos::Left, VPos::Top);
            area.draw(&Text::new(note, (50, 820 + 26 * line), style))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_numbered_by_level_and_numbers_are_short() {
        assert_eq!([&[][..], &[0], &[1], &[0, 0], &[1, 1]].map(by_level), [0, 1, 2, 3, 6]);
        assert_eq!([4.0, 0.5, 2.34567, 10.0].map(short), ["4", "0.5", "2.35", "10"]);
    }
}
