//! Colours and letters that all figures share.

use plotters::prelude::{IntoTextStyle, RGBColor, TextStyle};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontStyle, IntoFont};

/// The font, by a name that viewers of SVG know as well.
pub(crate) const FONT: &str = "sans-serif";
/// Letters and axes.
pub(crate) const INK: RGBColor = RGBColor(51, 51, 56);
/// What is in the background.
pub(crate) const FAINT: RGBColor = RGBColor(214, 216, 220);
/// What is said in passing.
pub(crate) const GREY: RGBColor = RGBColor(120, 124, 132);
/// The first series, and split planes.
pub(crate) const BLUE: RGBColor = RGBColor(31, 95, 168);
/// The second series, and cut planes.
pub(crate) const ORANGE: RGBColor = RGBColor(214, 104, 20);
/// Triangles.
pub(crate) const GREEN: RGBColor = RGBColor(52, 128, 86);

/// Heights of letters in pixels: titles, text.
pub(crate) const TITLE: u32 = 26;
pub(crate) const TEXT: u32 = 17;

/// Letters of some height and colour, their anchor at the left, right or middle of the text's top,
/// middle or bottom.
pub(crate) fn letters(size: u32, colour: RGBColor, h: HPos, v: VPos) -> TextStyle<'static> {
    let pos = Pos::new(h, v);
    (FONT, size).into_font().color(&colour.to_rgba()).pos(pos).into_text_style(&(1, 1))
}

/// As [`letters`], bold.
pub(crate) fn bold(size: u32, colour: RGBColor, h: HPos, v: VPos) -> TextStyle<'static> {
    let pos = Pos::new(h, v);
    let font = (FONT, size).into_font().style(FontStyle::Bold);
    font.color(&colour.to_rgba()).pos(pos).into_text_style(&(1, 1))
}
