//! What all plots draw: frames with axes, markers, text that fits.

use super::axis::Axis;
use super::place::Placed;
use crate::paper::plot::style::{BLUE, FAINT, GREEN, GREY, INK, ORANGE, bold, letters};
use crate::paper::plot::{Area, Drawn};
use plotters::prelude::{
    Circle, DrawingBackend, PathElement, Polygon, RGBColor, Rectangle, ShapeStyle, Text, TextStyle,
};
use plotters::style::text_anchor::{HPos, VPos};
use plotters::style::{Color, FontTransform, WHITE};

/// Height of letters beside the axes and in the legend.
pub(super) const SMALL: u32 = 15;
/// Height of a line of the legend.
pub(super) const LINE: i32 = 20;

/// Colours of lines and presets, in this order: fast, balanced, best, narrow, then others.
pub(super) const COLOURS: [RGBColor; 8] = [
    BLUE,
    ORANGE,
    GREEN,
    RGBColor(140, 60, 160),
    RGBColor(190, 35, 65),
    RGBColor(0, 140, 150),
    INK,
    GREY,
];

/// Text cut to a width, with an ellipsis where something is left out.
pub(super) fn fitted<B: DrawingBackend>(
    area: &Area<B>,
    text: &str,
    style: &TextStyle<'_>,
    width: i32,
) -> String {
    let fits =
        |text: &str| area.estimate_text_size(text, style).is_ok_and(|(own, _)| own as i32 <= width);
    if fits(text) {
        return text.to_owned();
    }
    let mut short: Vec<char> = text.chars().collect();
    while short.pop().is_some() {
        let text: String = short.iter().collect::<String>().trim_end().to_owned() + "…";
        if fits(&text) {
            return text;
        }
    }
    String::new()
}

/// Text whose upper left corner is at a pixel.
pub(super) fn text<B: DrawingBackend>(
    area: &Area<B>,
    text: &str,
    at: (i32, i32),
    style: TextStyle<'_>,
    width: i32,
) -> Drawn
where
    B::ErrorType: 'static,
{
    let text = fitted(area, text, &style, width);
    area.draw(&Text::new(text, at, style))?;
    Ok(())
}

/// A title at the upper left.
pub(super) fn title<B: DrawingBackend>(area: &Area<B>, words: &str) -> Drawn
where
    B::ErrorType: 'static,
{
    let (width, _) = area.dim_in_pixel();
    text(area, words, (24, 16), bold(22, INK, HPos::Left, VPos::Top), width as i32 - 48)
}

/// A frame with both axes: lines at the ticks, their labels, and what the axes mean.
pub(super) fn frame<B: DrawingBackend>(
    area: &Area<B>,
    [left, top, right, bottom]: [i32; 4],
    (x, x_means): (&Axis, &str),
    (y, y_means): (&Axis, &str),
) -> Drawn
where
    B::ErrorType: 'static,
{
    let under = letters(SMALL, INK, HPos::Center, VPos::Top);
    for (pixel, label) in x.ticks(72) {
        area.draw(&PathElement::new([(pixel, top), (pixel, bottom)], FAINT.stroke_width(1)))?;
        area.draw(&Text::new(label, (pixel, bottom + 7), under.clone()))?;
    }
    for (pixel, label) in y.ticks(44) {
        area.draw(&PathElement::new([(left, pixel), (right, pixel)], FAINT.stroke_width(1)))?;
        let style = letters(SMALL, INK, HPos::Right, VPos::Center);
        area.draw(&Text::new(label, (left - 8, pixel), style))?;
    }
    area.draw(&Rectangle::new([(left, top), (right, bottom)], GREY.stroke_width(1)))?;
    area.draw(&Text::new(x_means.to_owned(), ((left + right) / 2, bottom + 30), under))?;
    // Text is anchored before it is turned: its top is to the left.
    let turned = letters(SMALL, INK, HPos::Center, VPos::Top).transform(FontTransform::Rotate270);
    area.draw(&Text::new(y_means.to_owned(), (left - 76, (top + bottom) / 2), turned))?;
    Ok(())
}

/// What a marker looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    /// Accuracy `watertight`.
    Circle,
    /// Accuracy `fast`.
    Triangle,
    /// Accuracy `exact`.
    Square,
}

impl Shape {
    /// The shape that stands for an accuracy.
    pub(super) fn of(accuracy: &str) -> Shape {
        match accuracy {
            "fast" => Shape::Triangle,
            "exact" => Shape::Square,
            _ => Shape::Circle,
        }
    }
}

/// A marker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Marker {
    pub(super) shape: Shape,
    pub(super) colour: RGBColor,
    /// A preset as it is; else one with a knob turned.
    pub(super) filled: bool,
    /// Of a GPU: with a ring around it.
    pub(super) ringed: bool,
}

/// Draws a marker.
pub(super) fn marker<B: DrawingBackend>(area: &Area<B>, at: (i32, i32), marker: Marker) -> Drawn
where
    B::ErrorType: 'static,
{
    let (x, y) = at;
    let style = |filled: bool| -> ShapeStyle {
        if filled { marker.colour.filled() } else { marker.colour.stroke_width(2) }
    };
    // White beneath, so that what is hollow hides the lines of the frame.
    match marker.shape {
        Shape::Circle => {
            for style in [WHITE.filled(), style(marker.filled)] {
                area.draw(&Circle::new(at, 5, style))?;
            }
        }
        Shape::Square => {
            for style in [WHITE.filled(), style(marker.filled)] {
                area.draw(&Rectangle::new([(x - 4, y - 4), (x + 5, y + 5)], style))?;
            }
        }
        Shape::Triangle => {
            let corners = [(x - 6, y + 5), (x + 6, y + 5), (x, y - 6)];
            let inner = if marker.filled { marker.colour } else { WHITE };
            area.draw(&Polygon::new(corners, inner.filled()))?;
            let closed = [corners[0], corners[1], corners[2], corners[0]];
            area.draw(&PathElement::new(closed, marker.colour.stroke_width(2)))?;
        }
    }
    if marker.ringed {
        area.draw(&Circle::new(at, 8, INK.stroke_width(1)))?;
    }
    Ok(())
}

/// Draws labels that have their places, with lines to their points.
pub(super) fn labels<B: DrawingBackend>(
    area: &Area<B>,
    points: &[(i32, i32)],
    placed: &[Placed],
    words: impl Fn(usize) -> String,
) -> Drawn
where
    B::ErrorType: 'static,
{
    for label in placed {
        if let Some(end) = label.line {
            area.draw(&PathElement::new([points[label.point], end], GREY.stroke_width(1)))?;
        }
    }
    for label in placed {
        let [left, top, right, bottom] = label.rect;
        let middle = ((left + right) / 2, (top + bottom) / 2);
        // A line to a label further off may pass beneath.
        area.draw(&Rectangle::new([(left, top), (right, bottom)], WHITE.mix(0.85).filled()))?;
        let style = bold(SMALL, INK, HPos::Center, VPos::Center);
        area.draw(&Text::new(words(label.point), middle, style))?;
    }
    Ok(())
}

/// The size that a label of this text needs.
pub(super) fn label_size<B: DrawingBackend>(area: &Area<B>, words: &str) -> (i32, i32) {
    let style = bold(SMALL, INK, HPos::Center, VPos::Center);
    let (width, height) =
        area.estimate_text_size(words, &style).unwrap_or((10 * words.len() as u32, SMALL));
    // Estimates of some fonts are short.
    (width as i32 + 4, (height as i32).max(SMALL as i32) + 2)
}
