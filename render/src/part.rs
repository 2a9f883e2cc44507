//! Shares of a picture, for machines that render it together.

use core::fmt;
use core::ops::Range;
use core::str::FromStr;
use thiserror::Error;

/// Most parts of a picture.
pub const MAX_PARTS: u32 = 1 << 16;

/// Which share of a picture is rendered: part `index` of `count`, as text `index/count`.
///
/// A part is a run of pixels that follow one another, row by row from the top left; parts differ by at most one pixel in length. A pixel does not depend on
/// the others, so all parts together are the picture, bit for bit. Where light is by photons, each part traces all photons of
/// the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Part {
    /// From 0.
    place: u32,
    count: u32,
}

/// A part that cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PartError {
    /// The text is not two numbers with a stroke between them.
    #[error("a part is INDEX/COUNT, such as 2/8")]
    Text,
    /// No parts, or too many.
    #[error("there are 1 to {MAX_PARTS} parts, not {count}")]
    Count {
        /// How many there would be.
        count: u32,
    },
    /// An index of none of the parts.
    #[error("parts are counted from 1 to {count}; there is no part {index}")]
    Index {
        /// The index.
        index: u32,
        /// How many parts there are.
        count: u32,
    },
}

impl Part {
    /// The whole picture: 1/1.
    pub const WHOLE: Part = Part { place: 0, count: 1 };

    /// Part `index` of `count`; the first has index 1.
    ///
    /// # Errors
    /// A count of 0 or more than [`MAX_PARTS`], or an index that is not from 1 to the count.
    pub const fn new(index: u32, count: u32) -> Result<Part, PartError> {
        if count == 0 || count > MAX_PARTS {
            return Err(PartError::Count { count });
        }
        if index == 0 || index > count {
            return Err(PartError::Index { index, count });
        }
        Ok(Part { place: index - 1, count })
    }

    /// Which part it is, from 1.
    pub const fn index(self) -> u32 {
        self.place + 1
    }

    /// How many parts there are.
    pub const fn count(self) -> u32 {
        self.count
    }

    /// Whether this is all there is.
    pub const fn is_whole(self) -> bool {
        self.count == 1
    }

    /// The share of this part in so many things that follow one another, such as pixels row by row from the top left; none where there
    /// are more parts than things and it is not this part's turn.
    pub const fn share(self, things: u32) -> Range<u32> {
        let (things, place, count) = (things as u64, self.place as u64, self.count as u64);
        (things * place / count) as u32..(things * (place + 1) / count) as u32
    }
}

impl Default for Part {
    fn default() -> Part {
        Part::WHOLE
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index(), self.count)
    }
}

impl FromStr for Part {
    type Err = PartError;

    fn from_str(text: &str) -> Result<Part, PartError> {
        let (index, count) = text.split_once('/').ok_or(PartError::Text)?;
        let number = |text: &str| text.parse().map_err(|_| PartError::Text);
        Part::new(number(index)?, number(count)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every pixel is in one part, and no part is more than one pixel longer than another.
    #[test]
    fn parts_are_even_shares() {
        for (width, height) in [(1, 1), (3, 1), (7, 5), (16_384, 4096)] {
            let all: u32 = width * height;
            for count in [1, 2, 3, 7, 36, MAX_PARTS] {
                let mut next = 0;
                for index in 1..=count {
                    let pixels = Part::new(index, count).unwrap().share(all);
                    assert_eq!(pixels.start, next);
                    let least = all / count;
                    assert!((least..=least + 1).contains(&(pixels.end - pixels.start)));
                    next = pixels.end;
                }
                assert_eq!(next, all);
            }
        }
    }

    #[test]
    fn parts_are_written_as_they_are_read() {
        for text in ["1/1", "2/8", "65536/65536"] {
            assert_eq!(text.parse::<Part>().unwrap().to_string(), text);
        }
        for text in ["", "1", "/", "1/", "a/2", "-1/2", "1/2/3", "1 / 2", "1/4294967296"] {
            assert_eq!(text.parse::<Part>(), Err(PartError::Text), "{text}");
        }
        assert_eq!("0/3".parse::<Part>(), Err(PartError::Index { index: 0, count: 3 }));
        assert_eq!("4/3".parse::<Part>(), Err(PartError::Index { index: 4, count: 3 }));
        for count in [0, MAX_PARTS + 1] {
            assert_eq!(Part::new(1, count), Err(PartError::Count { count }));
        }
    }
}
