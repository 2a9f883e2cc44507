//! Formats of movies.

use std::fmt;

/// The format of a movie.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum MovieFormat {
    /// Animated PNG (PNG third edition, W3C 2025): 24 bits per pixel, lossless.
    Apng,
    /// GIF (GIF89a, with Netscape's extension that loops): every frame has a palette of its own with at
    /// most 256 colours. Frames with no more colours lose nothing.
    Gif,
}

impl fmt::Display for MovieFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl MovieFormat {
    /// Its name in messages.
    pub(super) const fn name(self) -> &'static str {
        match self {
            MovieFormat::Apng => "PNG",
            MovieFormat::Gif => "GIF",
        }
    }

    /// Least time of a frame in milliseconds. Browsers show GIF frames of less than 20 ms, and PNG frames
    /// of 10 ms and less, for 100 ms.
    pub const fn least_delay(self) -> u16 {
        match self {
            MovieFormat::Apng => 11,
            MovieFormat::Gif => 20,
        }
    }
}
