//! From coordinates of a scene to pixels, both axes to the same scale.

use super::Area;
use plotters::drawing::DrawingAreaErrorKind;
use plotters::prelude::{DrawingBackend, PathElement, Polygon, Rectangle, ShapeStyle};

/// Part of a plane of a scene, and where it is drawn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Map {
    /// Pixels a unit.
    scale: f64,
    /// The lower left corner in the scene, and its pixel.
    lower: [f64; 2],
    at: [f64; 2],
    /// The size in pixels.
    size: [f64; 2],
}

type Done<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

impl Map {
    /// Shows all of a rectangle of the scene, as large as it can be, in the middle of a rectangle of
    /// pixels given by its left, top, right and bottom.
    pub(super) fn new(
        lower: [f64; 2],
        upper: [f64; 2],
        [left, top, right, bottom]: [f64; 4],
    ) -> Map {
        let extent = [upper[0] - lower[0], upper[1] - lower[1]].map(|e| e.max(1e-30));
        let (wide, high) = (right - left, bottom - top);
        let scale = (wide / extent[0]).min(high / extent[1]);
        let size = extent.map(|e| e * scale);
        let at = [left + 0.5 * (wide - size[0]), bottom - 0.5 * (high - size[1])];
        Map { scale, lower, at, size }
    }

    /// The pixel of a point.
    pub(super) fn pixel(&self, [x, y]: [f64; 2]) -> (i32, i32) {
        let right = self.at[0] + (x - self.lower[0]) * self.scale;
        let up = self.at[1] - (y - self.lower[1]) * self.scale;
        (right.round() as i32, up.round() as i32)
    }

    /// Left, top, right and bottom of what is drawn.
    pub(super) fn edges(&self) -> [i32; 4] {
        let [left, bottom] = self.at;
        [left, bottom - self.size[1], left + self.size[0], bottom].map(|x| x.round() as i32)
    }

    /// A rectangle.
    pub(super) fn rectangle<B: DrawingBackend>(
        &self,
        area: &Area<B>,
        [a, b]: [[f64; 2]; 2],
        style: impl Into<ShapeStyle>,
    ) -> Done<B> {
        area.draw(&Rectangle::new([self.pixel(a), self.pixel(b)], style))
    }

    /// A line through points.
    pub(super) fn line<B: DrawingBackend>(
        &self,
        area: &Area<B>,
        points: &[[f64; 2]],
        style: impl Into<ShapeStyle>,
    ) -> Done<B> {
        let pixels: Vec<(i32, i32)> = points.iter().map(|point| self.pixel(*point)).collect();
        area.draw(&PathElement::new(pixels, style))
    }

    /// A line of dashes between two points.
    pub(super) fn dashes<B: DrawingBackend>(
        &self,
        area: &Area<B>,
        [a, b]: [[f64; 2]; 2],
        style: impl Into<ShapeStyle>,
    ) -> Done<B> {
        dashes(area, self.pixel(a), self.pixel(b), style)
    }

    /// A filled polygon.
    pub(super) fn polygon<B: DrawingBackend>(
        &self,
        area: &Area<B>,
        points: &[[f64; 2]],
        style: impl Into<ShapeStyle>,
    ) -> Done<B> {
        let pixels: Vec<(i32, i32)> = points.iter().map(|point| self.pixel(*point)).collect();
        area.draw(&Polygon::new(pixels, style))
    }
}

/// A line of dashes between two pixels.
pub(super) fn dashes<B: DrawingBackend>(
    area: &Area<B>,
    a: (i32, i32),
    b: (i32, i32),
    style: impl Into<ShapeStyle>,
) -> Done<B> {
    const DASH: f64 = 8.0;
    const GAP: f64 = 6.0;
    let style = style.into();
    let (dx, dy) = (f64::from(b.0 - a.0), f64::from(b.1 - a.1));
    let length = dx.hypot(dy);
    let at = |along: f64| {
        let part = if length > 0.0 { along.min(length) / length } else { 0.0 };
        (a.0 + (dx * part).round() as i32, a.1 + (dy * part).round() as i32)
    };
    let mut along = 0.0;
    while along <= length {
        area.draw(&PathElement::new([at(along), at(along + DASH)], style))?;
        along += DASH + GAP;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_stays_one_and_up_is_up() {
        let map = Map::new([0.0, 0.0], [2.0, 2.0], [10.0, 20.0, 310.0, 120.0]);
        assert_eq!(map.edges(), [110, 20, 210, 120]);
        assert_eq!((map.pixel([0.0, 0.0]), map.pixel([2.0, 2.0])), ((110, 120), (210, 20)));
    }
}
