//! Figure 8: the top of a tree as a diagram.

use super::cut::NAMES;
use super::style::{BLUE, GREEN, GREY, INK, TEXT, TITLE, letters};
use super::{Area, Drawn, Plot};
use crate::paper::crown::{Crown, Node};
use plotters::prelude::{Circle, DrawingBackend, PathElement, Rectangle, Text};
use plotters::style::text_anchor::{HPos, VPos};
use plotters::style::{Color, WHITE};

impl Plot for Crown {
    const SIZE: (u32, u32) = (1400, 760);

    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static,
    {
        let deepest = self.nodes.iter().map(|node| node.depth).max().unwrap_or(0);
        let title = format!("The tree to level {deepest}");
        area.draw(&Text::new(title, (40, 24), letters(TITLE, INK, HPos::Left, VPos::Top)))?;
        let step = 1320.0 / self.places.max(1) as f64;
        let row = 560.0 / f64::from(self.levels.max(1));
        let at = |node: &Node| {
            let x = 40.0 + (node.place + 0.5) * step;
            (x.round() as i32, (100.0 + row * f64::from(node.depth)).round() as i32)
        };
        for node in &self.nodes {
            if let Some(parent) = node.parent.and_then(|parent| self.nodes.get(parent)) {
                area.draw(&PathElement::new([at(parent), at(node)], GREY.stroke_width(2)))?;
            }
        }
        for node in &self.nodes {
            let (x, y) = at(node);
            match node.axis {
                Some(axis) => {
                    area.draw(&Circle::new((x, y), 15, BLUE.filled()))?;
                    let style = letters(19, WHITE_LETTERS, HPos::Center, VPos::Center);
                    area.draw(&Text::new(NAMES[axis.index()], (x, y), style))?;
                }
                None => {
                    let corners = [(x - 10, y - 10), (x + 10, y + 10)];
                    let fill = if node.references == 0 { WHITE.filled() } else { GREEN.filled() };
                    area.draw(&Rectangle::new(corners, fill))?;
                    area.draw(&Rectangle::new(corners, GREEN.stroke_width(2)))?;
                }
            }
            let words = short(node.references);
            if node.axis.is_some() && node.depth < self.levels {
                // Beside the node, away from its parent: no line passes there.
                let parent = node.parent.and_then(|parent| self.nodes.get(parent));
                let is_left = parent.is_some_and(|parent| node.place < parent.place);
                let (place, side) =
                    if is_left { (x - 20, HPos::Right) } else { (x + 20, HPos::Left) };
                area.draw(&Text::new(words, (place, y), letters(14, INK, side, VPos::Center)))?;
            } else {
                // The lowest stand too close for words side by side: the odd ones go a line lower.
                let lower =
                    if node.depth == self.levels && node.place as usize % 2 == 1 { 17 } else { 0 };
                let style = letters(14, INK, HPos::Center, VPos::Top);
                area.draw(&Text::new(words, (x, y + 18 + lower), style))?;
            }
        }
        let note = "circles: the axis of the plane that splits; squares: leaves, white without \
                    triangles; numbers: references in the leaves below";
        area.draw(&Text::new(note, (40, 722), letters(TEXT, INK, HPos::Left, VPos::Top)))?;
        Ok(())
    }
}

const WHITE_LETTERS: plotters::style::RGBColor = WHITE;

/// `950`, `12.3k`, `1.2M`.
fn short(count: usize) -> String {
    match count {
        0..=999 => count.to_string(),
        1000..=999_999 => format!("{:.1}k", count as f64 / 1e3),
        _ => format!("{:.1}M", count as f64 / 1e6),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_short() {
        assert_eq!(
            [0, 999, 1000, 12_345, 1_200_000].map(short),
            ["0", "999", "1.0k", "12.3k", "1.2M"]
        );
    }
}
