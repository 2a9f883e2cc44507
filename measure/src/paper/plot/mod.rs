//! Figures as SVG and PNG. Text in a PNG is of a font that comes with the program, so that no system need
//! have one; an SVG asks its viewer for a sans-serif.

mod areas;
mod crown;
mod cut;
mod map;
mod motion;
mod points;
mod scaling;
mod slice;
mod space;
pub(crate) mod style;

pub use scaling::ScalingPlot;

use image::RgbImage;
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, IntoDrawingArea};
use plotters::prelude::{BitMapBackend, DrawingBackend, SVGBackend};
use plotters::style::{FontStyle, WHITE, register_font};
use splitplane::picture::{PictureError, encode_png};
use std::error::Error;
use std::sync::Once;

/// Where a figure is drawn, in pixels.
pub(crate) type Area<B> = DrawingArea<B, Shift>;
/// What drawing may end in: the backend's words.
pub(crate) type Drawn = Result<(), Box<dyn Error + Send + Sync>>;

/// A figure that can be drawn.
pub trait Plot {
    /// Width and height in pixels.
    const SIZE: (u32, u32);

    /// Draws it on an empty, white area of that size.
    ///
    /// # Errors
    /// What it is drawn on refuses.
    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Drawn
    where
        B::ErrorType: 'static;
}

/// A figure as the text of an SVG file.
///
/// # Errors
/// [`PictureError::Encode`].
pub fn svg<P: Plot>(plot: &P) -> Result<String, PictureError> {
    let mut text = String::new();
    on(plot, SVGBackend::with_string(&mut text, P::SIZE)).map_err(failed("SVG"))?;
    Ok(text)
}

/// A figure as the bytes of a PNG file.
///
/// # Errors
/// [`PictureError::Encode`].
pub fn png<P: Plot>(plot: &P) -> Result<Vec<u8>, PictureError> {
    let mut image = RgbImage::new(P::SIZE.0, P::SIZE.1);
    on(plot, BitMapBackend::with_buffer(&mut image, P::SIZE)).map_err(failed("PNG"))?;
    encode_png(&image)
}

fn on<P: Plot, B: DrawingBackend>(plot: &P, backend: B) -> Drawn
where
    B::ErrorType: 'static,
{
    static FONT: Once = Once::new();
    FONT.call_once(|| {
        for (style, bytes) in
            [(FontStyle::Normal, dejavu::sans::regular()), (FontStyle::Bold, dejavu::sans::bold())]
        {
            // A font that cannot be read shows in the first text that is drawn.
            let _ = register_font(style::FONT, style, bytes);
        }
    });
    let area = backend.into_drawing_area();
    area.fill(&WHITE)?;
    plot.draw(&area)?;
    area.present()?;
    Ok(())
}

fn failed(format: &'static str) -> impl Fn(Box<dyn Error + Send + Sync>) -> PictureError {
    move |error| PictureError::Encode { format, reason: error.to_string() }
}
