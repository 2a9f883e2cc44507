//! Movies: animated PNG and GIF.

use super::screen::{PNG_MOST, describe};
use super::{MovieFormat, PictureError};
use image::RgbImage;
use std::io::Write;
use std::num::NonZeroU32;

/// A movie that is written frame by frame, and loops for ever. It holds one frame at a time.
///
/// After an error, what has been written is not a file that can be used.
///
/// ```
/// use splitplane_render::picture::{Movie, MovieFormat, RgbImage};
/// use std::num::NonZeroU32;
///
/// # fn main() -> Result<(), splitplane_render::picture::PictureError> {
/// let mut bytes = Vec::new();
/// let frames = NonZeroU32::new(2).expect("2 is not 0");
/// let mut movie = Movie::new(&mut bytes, MovieFormat::Apng, (4, 3), frames, 40)?;
/// movie.push(&RgbImage::new(4, 3))?;
/// movie.push(&RgbImage::new(4, 3))?;
/// movie.finish()?;
/// # Ok(())
/// # }
/// ```
pub struct Movie<W: Write> {
    encoder: Encoder<W>,
    dimensions: (u32, u32),
    delay: u16,
    frames: u32,
    pushed: u32,
}

enum Encoder<W: Write> {
    Apng(Box<png::Writer<W>>),
    Gif(Box<gif::Encoder<W>>),
}

/// How thoroughly colours of a GIF frame are chosen, from 1 (best) to 30 (fastest): what the crate `gif`
/// calls a good compromise.
const PALETTE_SPEED: i32 = 10;

impl<W: Write> Movie<W> {
    /// Begins a movie: width and height of every frame, how many frames there will be (the header of an
    /// animated PNG says it), and for how many milliseconds each is shown. GIF counts hundredths of a
    /// second; frames alternate between the two nearest so that the movie keeps its time.
    ///
    /// # Errors
    /// [`PictureError::Dimensions`], [`PictureError::Delay`] (see [`MovieFormat::least_delay`]), and
    /// [`PictureError::Write`].
    pub fn new(
        out: W,
        format: MovieFormat,
        dimensions: (u32, u32),
        frames: NonZeroU32,
        delay: u16,
    ) -> Result<Movie<W>, PictureError> {
        PictureError::check_dimensions(format.name(), dimensions, longest_side(format))?;
        let least = format.least_delay();
        if delay < least {
            return Err(PictureError::Delay { format, found: delay, least });
        }
        let encoder = match format {
            MovieFormat::Apng => begin_apng(out, dimensions, frames, delay),
            MovieFormat::Gif => begin_gif(out, dimensions),
        }?;
        Ok(Movie { encoder, dimensions, delay, frames: frames.get(), pushed: 0 })
    }

    /// Writes the next frame.
    ///
    /// # Errors
    /// [`PictureError::FrameSize`]: not the size of the movie. [`PictureError::FrameCount`]: more frames
    /// than it was begun with. [`PictureError::Write`].
    pub fn push(&mut self, frame: &RgbImage) -> Result<(), PictureError> {
        if frame.dimensions() != self.dimensions {
            return Err(PictureError::FrameSize {
                frame: self.pushed,
                found: frame.dimensions(),
                expected: self.dimensions,
            });
        }
        if self.pushed == self.frames {
            let found = self.pushed.saturating_add(1);
            return Err(PictureError::FrameCount { found, expected: self.frames });
        }
        match &mut self.encoder {
            Encoder::Apng(writer) => {
                writer.write_image_data(frame.as_raw()).map_err(PictureError::png)?;
            }
            Encoder::Gif(encoder) => {
                // `new` checked that the sides fit.
                let (width, height) = (frame.width() as u16, frame.height() as u16);
                let mut frame =
                    gif::Frame::from_rgb_speed(width, height, frame.as_raw(), PALETTE_SPEED);
                frame.delay = hundredths(self.pushed, self.delay);
                encoder.write_frame(&frame).map_err(PictureError::gif)?;
            }
        }
        self.pushed += 1;
        Ok(())
    }

    /// Ends the file and flushes what it is written to.
    ///
    /// # Errors
    /// [`PictureError::FrameCount`]: fewer frames than the movie was begun with.
    /// [`PictureError::Write`].
    pub fn finish(self) -> Result<(), PictureError> {
        if self.pushed != self.frames {
            return Err(PictureError::FrameCount { found: self.pushed, expected: self.frames });
        }
        match self.encoder {
            Encoder::Apng(writer) => writer.finish().map_err(PictureError::png),
            Encoder::Gif(encoder) => {
                let mut out = encoder.into_inner().map_err(PictureError::gif)?;
                out.flush().map_err(|source| PictureError::Write { format: "GIF", source })
            }
        }
    }
}

/// The longest side that a format can count.
const fn longest_side(format: MovieFormat) -> u32 {
    match format {
        MovieFormat::Apng => PNG_MOST,
        MovieFormat::Gif => u16::MAX as u32,
    }
}

fn begin_apng<W: Write>(
    out: W,
    (width, height): (u32, u32),
    frames: NonZeroU32,
    delay: u16,
) -> Result<Encoder<W>, PictureError> {
    let mut encoder = png::Encoder::new(out, width, height);
    describe(&mut encoder);
    // 0 plays are endlessly many.
    encoder.set_animated(frames.get(), 0).map_err(PictureError::png)?;
    encoder.set_frame_delay(delay, 1000).map_err(PictureError::png)?;
    Ok(Encoder::Apng(Box::new(encoder.write_header().map_err(PictureError::png)?)))
}

fn begin_gif<W: Write>(out: W, (width, height): (u32, u32)) -> Result<Encoder<W>, PictureError> {
    // `new` checked that the sides fit.
    let encoder = gif::Encoder::new(out, width as u16, height as u16, &[]);
    let mut encoder = encoder.map_err(PictureError::gif)?;
    encoder.set_repeat(gif::Repeat::Infinite).map_err(PictureError::gif)?;
    Ok(Encoder::Gif(Box::new(encoder)))
}

/// Hundredths of a second that a frame is shown for, such that the next one starts when it should, to the
/// nearest hundredth.
fn hundredths(frame: u32, delay: u16) -> u16 {
    let start = |frame: u64| (frame * u64::from(delay) + 5) / 10;
    (start(u64::from(frame) + 1) - start(u64::from(frame))) as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::AnimationDecoder;
    use std::io;

    const SIZE: (u32, u32) = (31, 17);

    fn frame(seed: u32, colours: u32) -> RgbImage {
        RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
            let bits = ((x + y * SIZE.0 + seed) % colours).wrapping_mul(0x9e37_79b9);
            let [red, green, blue, _] = bits.to_le_bytes();
            image::Rgb([red, green, blue])
        })
    }

    fn count(frames: u32) -> NonZeroU32 {
        NonZeroU32::new(frames).unwrap()
    }

    fn movie(format: MovieFormat, frames: &[RgbImage], delay: u16) -> Vec<u8> {
        let mut bytes = Vec::new();
        let frame_count = count(frames.len() as u32);
        let mut movie = Movie::new(&mut bytes, format, SIZE, frame_count, delay).unwrap();
        for frame in frames {
            movie.push(frame).unwrap();
        }
        movie.finish().unwrap();
        bytes
    }

    #[test]
    fn an_animated_png_gives_every_frame_back() {
        for number in [1, 2, 5] {
            let frames: Vec<RgbImage> = (0..number).map(|i| frame(i, 600)).collect();
            let bytes = movie(MovieFormat::Apng, &frames, 33);
            let reader = png::Decoder::new(io::Cursor::new(&bytes)).read_info().unwrap();
            let control = reader.info().animation_control.unwrap();
            assert_eq!((control.num_frames, control.num_plays), (number, 0));
            let decoder = image::codecs::png::PngDecoder::new(io::Cursor::new(&bytes)).unwrap();
            let read = decoder.apng().unwrap().into_frames().collect_frames().unwrap();
            assert_eq!(read.len(), frames.len());
            for (read, frame) in read.into_iter().zip(&frames) {
                assert_eq!(read.delay().numer_denom_ms(), (33, 1));
                assert_eq!(&image::DynamicImage::ImageRgba8(read.into_buffer()).into_rgb8(), frame);
            }
            // Programs that do not support animation show the first frame.
            let still = image::load_from_memory_with_format(&bytes, image::ImageFormat::Png);
            assert_eq!(still.unwrap().into_rgb8(), frames[0]);
        }
    }

    #[test]
    fn a_gif_of_few_colours_gives_every_frame_back() {
        let frames: Vec<RgbImage> = (0..4).map(|i| frame(i, 200)).collect();
        let bytes = movie(MovieFormat::Gif, &frames, 40);
        let decoder = image::codecs::gif::GifDecoder::new(io::Cursor::new(&bytes)).unwrap();
        let read = decoder.into_frames().collect_frames().unwrap();
        assert_eq!(read.len(), frames.len());
        for (read, frame) in read.into_iter().zip(&frames) {
            assert_eq!(read.delay().numer_denom_ms(), (40, 1));
            assert_eq!(&image::DynamicImage::ImageRgba8(read.into_buffer()).into_rgb8(), frame);
        }
    }

    #[test]
    fn a_gif_of_many_colours_is_near_its_frames_and_loops() {
        // 4096 colours: a smooth picture, as frames are.
        let frame = RgbImage::from_fn(64, 64, |x, y| image::Rgb([4 * x as u8, 4 * y as u8, 90]));
        let mut bytes = Vec::new();
        let mut movie = Movie::new(&mut bytes, MovieFormat::Gif, (64, 64), count(1), 100).unwrap();
        movie.push(&frame).unwrap();
        movie.finish().unwrap();
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(io::Cursor::new(&bytes)).unwrap();
        let read = decoder.read_next_frame().unwrap().unwrap().buffer.to_vec();
        assert_eq!(decoder.repeat(), gif::Repeat::Infinite);
        let off = read.chunks(4).zip(frame.pixels()).map(|(read, pixel)| {
            (0..3).map(|i| f64::from(read[i].abs_diff(pixel.0[i]))).sum::<f64>()
        });
        // An even grid of 16 by 16 colours would be off by 8 on average; a palette learnt from a
        // tenth of so few pixels is worse.
        let mean = off.sum::<f64>() / (64.0 * 64.0);
        assert!(mean < 24.0, "{mean}");
    }

    #[test]
    fn gif_frames_keep_the_time_of_the_movie() {
        assert_eq!([0, 1, 2, 3, 4, 5].map(|frame| hundredths(frame, 33)), [3, 4, 3, 3, 4, 3]);
        let total: u64 = (0..1000).map(|frame| u64::from(hundredths(frame, 33))).sum();
        assert_eq!(total, 3300);
        assert!((6553..=6554).contains(&hundredths(u32::MAX, u16::MAX)));
    }

    #[test]
    fn frames_of_another_size_are_errors_and_leave_the_movie_whole() {
        for format in [MovieFormat::Apng, MovieFormat::Gif] {
            let mut bytes = Vec::new();
            let mut movie = Movie::new(&mut bytes, format, SIZE, count(2), 40).unwrap();
            movie.push(&frame(0, 9)).unwrap();
            let error = movie.push(&RgbImage::new(17, 31)).unwrap_err();
            assert_eq!(error.to_string(), "frame 1 has 17x31 pixels, but the movie has 31x17");
            movie.push(&frame(1, 9)).unwrap();
            movie.finish().unwrap();
            assert_eq!(bytes, self::movie(format, &[frame(0, 9), frame(1, 9)], 40));
        }
    }

    #[test]
    fn too_many_and_too_few_frames_are_errors() {
        for format in [MovieFormat::Apng, MovieFormat::Gif] {
            let mut movie = Movie::new(io::sink(), format, SIZE, count(1), 40).unwrap();
            movie.push(&frame(0, 9)).unwrap();
            let error = movie.push(&frame(0, 9)).unwrap_err();
            assert!(matches!(error, PictureError::FrameCount { found: 2, expected: 1 }), "{error}");
            let movie = Movie::new(io::sink(), format, SIZE, count(3), 40).unwrap();
            let error = movie.finish().unwrap_err();
            assert!(matches!(error, PictureError::FrameCount { found: 0, expected: 3 }), "{error}");
        }
    }

    fn refused(format: MovieFormat, dimensions: (u32, u32), delay: u16) -> PictureError {
        match Movie::new(io::sink(), format, dimensions, count(1), delay) {
            Ok(_) => panic!("{format} {dimensions:?} {delay} must be refused"),
            Err(error) => error,
        }
    }

    #[test]
    fn what_a_format_cannot_have_is_refused_at_once() {
        for format in [MovieFormat::Apng, MovieFormat::Gif] {
            let empty = refused(format, (0, 5), 40);
            assert!(matches!(empty, PictureError::Dimensions { width: 0, .. }), "{empty}");
            let short = refused(format, SIZE, format.least_delay() - 1);
            assert!(matches!(short, PictureError::Delay { .. }), "{short}");
        }
        let wide = refused(MovieFormat::Gif, (65_536, 1), 40);
        assert!(matches!(wide, PictureError::Dimensions { most: 65_535, .. }), "{wide}");
    }

    /// Accepts some bytes, then has no space left.
    struct Full {
        room: usize,
    }

    impl Write for Full {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if self.room == 0 {
                return Err(io::ErrorKind::StorageFull.into());
            }
            let taken = bytes.len().min(self.room);
            self.room -= taken;
            Ok(taken)
        }

        fn flush(&mut self) -> io::Result<()> {
            if self.room == 0 { Err(io::ErrorKind::StorageFull.into()) } else { Ok(()) }
        }
    }

    #[test]
    fn a_full_disk_is_a_write_error_wherever_it_strikes() {
        for format in [MovieFormat::Apng, MovieFormat::Gif] {
            let whole = movie(format, &[frame(0, 9), frame(1, 9)], 40).len();
            for room in 0..=whole {
                let all = || {
                    let mut movie = Movie::new(Full { room }, format, SIZE, count(2), 40)?;
                    movie.push(&frame(0, 9))?;
                    movie.push(&frame(1, 9))?;
                    movie.finish()
                };
                match all() {
                    Err(PictureError::Write { source, .. }) => {
                        assert_eq!(source.kind(), io::ErrorKind::StorageFull);
                    }
                    other => panic!("{format} with room for {room} of {whole}: {other:?}"),
                }
            }
        }
    }
}
