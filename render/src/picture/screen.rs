//! Pictures for screens: 8-bit sRGB.

use super::{PictureError, Size};
use image::RgbImage;

/// Longest side that PNG can count.
pub(super) const PNG_MOST: u32 = i32::MAX as u32;

/// The picture of a frame's pixels: red in the low byte of a word, then green, then blue. The high
/// byte is left out; a picture is opaque.
///
/// # Errors
/// [`PictureError::Length`]: not one word a pixel.
pub fn screen(size: Size, pixels: &[u32]) -> Result<RgbImage, PictureError> {
    PictureError::check_length("the array of pixels", pixels.len(), size)?;
    Ok(paint(size, pixels, |&word| {
        let [red, green, blue, _] = word.to_le_bytes();
        [red, green, blue]
    }))
}

/// A picture of one colour per value. `values` has one value per pixel.
pub(super) fn paint<T>(size: Size, values: &[T], colour: impl Fn(&T) -> [u8; 3]) -> RgbImage {
    let mut image = RgbImage::new(size.width(), size.height());
    for (pixel, value) in image.pixels_mut().zip(values) {
        pixel.0 = colour(value);
    }
    image
}

/// The bytes of a PNG file: 24 bits per pixel, marked as sRGB.
///
/// # Errors
/// [`PictureError::Dimensions`]: a picture without pixels. [`PictureError::Encode`]: the encoder
/// refuses.
pub fn encode_png(image: &RgbImage) -> Result<Vec<u8>, PictureError> {
    PictureError::check_dimensions("PNG", image.dimensions(), PNG_MOST)?;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, image.width(), image.height());
    describe(&mut encoder);
    let mut writer = encoder.write_header().map_err(PictureError::png)?;
    writer.write_image_data(image.as_raw()).map_err(PictureError::png)?;
    writer.finish().map_err(PictureError::png)?;
    Ok(bytes)
}

/// Tells an encoder what the bytes of an [`RgbImage`] mean.
pub(super) fn describe<W: std::io::Write>(encoder: &mut png::Encoder<'_, W>) {
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn red_is_the_low_byte_and_rows_run_down() {
        let size = Size::new(2, 2).unwrap();
        let image = screen(size, &[0xff00_00ff, 0xff00_ff00, 0xffff_0000, 0x0003_0201]).unwrap();
        assert_eq!(image.get_pixel(0, 0).0, [255, 0, 0]);
        assert_eq!(image.get_pixel(1, 0).0, [0, 255, 0]);
        assert_eq!(image.get_pixel(0, 1).0, [0, 0, 255]);
        assert_eq!(image.get_pixel(1, 1).0, [1, 2, 3]);
    }

    #[test]
    fn a_wrong_number_of_pixels_is_an_error() {
        let error = screen(Size::new(2, 3).unwrap(), &[0; 5]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the array of pixels has 5 values, but a picture of 2x3 pixels needs 6"
        );
    }

    #[test]
    fn png_files_give_the_picture_back() {
        for (width, height) in [(1, 1), (1, 7), (33, 20)] {
            let words: Vec<u32> =
                (0..width * height).map(|i: u32| i.wrapping_mul(0x0103_0711)).collect();
            let image = screen(Size::new(width, height).unwrap(), &words).unwrap();
            let bytes = encode_png(&image).unwrap();
            let read = image::load_from_memory_with_format(&bytes, image::ImageFormat::Png);
            assert_eq!(read.unwrap().into_rgb8(), image);
            let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
            assert_eq!(reader.info().srgb, Some(png::SrgbRenderingIntent::Perceptual));
            assert!(reader.next_row().is_ok());
        }
    }

    #[test]
    fn a_picture_without_pixels_is_no_file() {
        let error = encode_png(&RgbImage::new(0, 4)).unwrap_err();
        assert!(
            matches!(error, PictureError::Dimensions { format: "PNG", width: 0, .. }),
            "{error}"
        );
    }
}
