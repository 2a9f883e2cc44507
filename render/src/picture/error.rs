//! Errors of pictures.

use super::{MovieFormat, Size};
use std::io;
use thiserror::Error;

/// Errors of pictures and movies.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PictureError {
    /// An array that does not have one value per pixel.
    #[error(
        "{what} has {found} values, but a picture of {width}x{height} pixels needs {expected}",
        width = .size.width(), height = .size.height(), expected = .size.pixels()
    )]
    Length {
        /// The array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The requested size.
        size: Size,
    },
    /// One output variable twice in a file.
    #[error("the channel `{0}` is asked for twice; a file can have it once")]
    Repeated(&'static str),
    /// A picture without pixels, or with more than its format can count.
    #[error(
        "a picture of {width}x{height} pixels does not fit the format {format}, whose sides are from 1 \
         to {most}"
    )]
    Dimensions {
        /// The format.
        format: &'static str,
        /// Pixels from left to right.
        width: u32,
        /// Pixels from top to bottom.
        height: u32,
        /// The longest side.
        most: u32,
    },
    /// A frame of another size than its movie.
    #[error(
        "frame {frame} has {found_width}x{found_height} pixels, but the movie has {width}x{height}",
        found_width = .found.0, found_height = .found.1, width = .expected.0, height = .expected.1
    )]
    FrameSize {
        /// The frame, counted from 0.
        frame: u32,
        /// Its width and height.
        found: (u32, u32),
        /// Those of the movie.
        expected: (u32, u32),
    },
    /// A movie with more or fewer frames than it was begun with.
    #[error("the movie was begun with {expected} frames, but is given {found}")]
    FrameCount {
        /// Frames given.
        found: u32,
        /// Frames that the movie was begun with.
        expected: u32,
    },
    /// A frame that would be shown for too short a time.
    #[error(
        "a frame of a movie of format {format} cannot last {found} ms; players keep what lasts {least} ms and more"
    )]
    Delay {
        /// The format.
        format: MovieFormat,
        /// Milliseconds requested.
        found: u16,
        /// Least number of milliseconds.
        least: u16,
    },
    /// Writing the movie failed.
    #[error("the {format} could not be written: {source}")]
    Write {
        /// The format.
        format: &'static str,
        /// Why.
        source: io::Error,
    },
    /// The encoder refuses.
    #[error("the {format} could not be encoded: {reason}")]
    Encode {
        /// The format.
        format: &'static str,
        /// Why, in the encoder's words.
        reason: String,
    },
}

impl PictureError {
    /// Whether an array has one value per pixel.
    pub(super) fn check_length(
        what: &'static str,
        found: usize,
        size: Size,
    ) -> Result<(), PictureError> {
        if found == size.pixels() as usize {
            Ok(())
        } else {
            Err(PictureError::Length { what, found, size })
        }
    }

    /// Whether a format can have a picture of some width and height.
    pub(super) fn check_dimensions(
        format: &'static str,
        (width, height): (u32, u32),
        most: u32,
    ) -> Result<(), PictureError> {
        if (1..=most).contains(&width) && (1..=most).contains(&height) {
            Ok(())
        } else {
            Err(PictureError::Dimensions { format, width, height, most })
        }
    }

    pub(super) fn png(error: png::EncodingError) -> PictureError {
        match error {
            png::EncodingError::IoError(source) => PictureError::Write { format: "PNG", source },
            other => PictureError::Encode { format: "PNG", reason: other.to_string() },
        }
    }

    pub(super) fn gif(error: gif::EncodingError) -> PictureError {
        match error {
            gif::EncodingError::Io(source) => PictureError::Write { format: "GIF", source },
            other => PictureError::Encode { format: "GIF", reason: other.to_string() },
        }
    }

    pub(super) fn exr(error: ::exr::error::Error) -> PictureError {
        match error {
            ::exr::error::Error::Io(source) => PictureError::Write { format: "EXR", source },
            other => PictureError::Encode { format: "EXR", reason: other.to_string() },
        }
    }
}
