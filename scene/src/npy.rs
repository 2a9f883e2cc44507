//! Heads of .npy files, the format of NumPy: versions 1 to 3, little-endian f32 and f64 in C order.

use crate::from_file::quoted_word;
use std::io::{self, Read};
use thiserror::Error;

/// How a file begins.
pub const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// Most bytes of a head's dictionary that are read; NumPy reads ten thousand.
const MOST_HEADER: u32 = 1 << 20;
/// Most sides of a shape that are kept: more than any array has that is read here.
const MOST_SIDES: usize = 4;

/// What is wrong with an .npy file.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NpyError {
    /// It starts otherwise.
    #[error("it does not start as an .npy file does")]
    Magic,
    /// A version that is not known.
    #[error("its version {0} is not known; versions 1 to 3 are")]
    Version(u8),
    /// A head that is cut off, or no dictionary of the three entries.
    #[error("its header is damaged")]
    Header,
    /// Numbers of another type.
    #[error("its numbers are of type `{0}`; they must be '<f4' or '<f8'")]
    Type(String),
    /// Columns first.
    #[error("it is in Fortran order; save it in C order, as numpy.ascontiguousarray does")]
    Fortran,
    /// Another shape.
    #[error("its shape is {found}; it must be {expected}")]
    Shape {
        /// As the file has it.
        found: String,
        /// What is asked for.
        expected: &'static str,
    },
    /// No memory.
    #[error("there is not memory enough for its numbers")]
    Memory,
    /// More or fewer bytes than the head says.
    #[error("its header promises {promised} bytes of numbers, but {found} follow")]
    Length {
        /// Bytes of so many numbers.
        promised: u64,
        /// Bytes behind the head.
        found: u64,
    },
}

/// What an array is like.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// Bytes of a number: 4 or 8.
    pub width: u64,
    /// The sides, the first four at most.
    pub sides: Vec<u64>,
    /// The shape as the file has it.
    shape: String,
    /// Bytes before the first number.
    pub bytes: u64,
}

impl Header {
    /// Reads the head of a file; the numbers follow it.
    ///
    /// # Errors
    /// What does not begin as an .npy file, or has numbers of another type or order; the system's, where it refuses to read.
    pub fn read(mut source: impl Read) -> io::Result<Result<Header, NpyError>> {
        let mut start = [0; 8];
        let found = read_all(&mut source, &mut start)?;
        if !start[..found].starts_with(MAGIC) {
            return Ok(Err(NpyError::Magic));
        }
        if found < start.len() {
            return Ok(Err(NpyError::Header));
        }
        let (mut length, width) = match start[6] {
            1 => ([0; 4], 2),
            2 | 3 => ([0; 4], 4),
            other => return Ok(Err(NpyError::Version(other))),
        };
        if read_all(&mut source, &mut length[..width])? < width {
            return Ok(Err(NpyError::Header));
        }
        let length = u32::from_le_bytes(length);
        if length > MOST_HEADER {
            return Ok(Err(NpyError::Header));
        }
        let mut text = Vec::new();
        source.take(u64::from(length)).read_to_end(&mut text)?;
        if text.len() < length as usize {
            return Ok(Err(NpyError::Header));
        }
        let bytes = (start.len() + width + text.len()) as u64;
        let header = std::str::from_utf8(&text).map_err(|_| NpyError::Header);
        Ok(header.and_then(|text| Header::parse(text, bytes)))
    }

    fn parse(header: &str, bytes: u64) -> Result<Header, NpyError> {
        let kind = value(header, "descr")?;
        let kind = kind.strip_prefix(['\'', '"']).and_then(|rest| rest.split(['\'', '"']).next());
        // A list of named fields does not start with a quote.
        let kind = kind.unwrap_or("several fields");
        let width = match kind {
            "<f4" => 4,
            "<f8" => 8,
            other => return Err(NpyError::Type(quoted_word(other))),
        };
        match value(header, "fortran_order")? {
            order if order.starts_with("False") => {}
            order if order.starts_with("True") => return Err(NpyError::Fortran),
            _ => return Err(NpyError::Header),
        }
        let shape = value(header, "shape")?;
        let end = shape.find(')').ok_or(NpyError::Header)?;
        let shape = shape.get(..=end).ok_or(NpyError::Header)?;
        let sides: Vec<u64> = shape
            .trim_matches(['(', ')'])
            .split(',')
            .map(str::trim)
            .filter(|side| !side.is_empty())
            .take(MOST_SIDES)
            .map(str::parse)
            .collect::<Result<_, _>>()
            .map_err(|_| NpyError::Header)?;
        Ok(Header { width, sides, shape: crate::from_file::quoted(shape), bytes })
    }

    /// The error of a shape that is not `expected`.
    pub fn wrong_shape(&self, expected: &'static str) -> NpyError {
        NpyError::Shape { found: self.shape.clone(), expected }
    }

    /// Whether so many bytes behind the head are its numbers.
    ///
    /// # Errors
    /// They are not, or no file has so many.
    pub fn check_length(&self, found: u64) -> Result<(), NpyError> {
        let product =
            self.sides.iter().try_fold(self.width, |bytes, side| bytes.checked_mul(*side));
        let promised = product.ok_or(NpyError::Header)?;
        if promised == found { Ok(()) } else { Err(NpyError::Length { promised, found }) }
    }
}

/// Fills as much of the bytes as there is.
fn read_all(source: &mut impl Read, bytes: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < bytes.len() {
        match source.read(&mut bytes[filled..]) {
            Ok(0) => break,
            Ok(more) => filled += more,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(filled)
}

/// What follows a key of the header's dictionary.
fn value<'a>(header: &'a str, key: &str) -> Result<&'a str, NpyError> {
    let quoted = [format!("'{key}'"), format!("\"{key}\"")];
    let after = quoted.iter().find_map(|key| Some(&header[header.find(key)? + key.len()..]));
    let after = after.and_then(|rest| rest.trim_start().strip_prefix(':'));
    after.map(str::trim_start).ok_or(NpyError::Header)
}
