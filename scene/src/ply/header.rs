//! The header: what elements there are, and of what numbers they consist.

use crate::from_file::{quoted, quoted_word};
use crate::mesh_file::{Located, MeshFileProblem, Place};

/// Most bytes of a header, and most elements and properties. Real ones have a few hundred bytes.
const MOST_BYTES: usize = 1 << 20;
const MOST_NAMES: usize = 1 << 12;

/// How numbers are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    Text,
    LittleEndian,
    BigEndian,
}

/// Of what type a number is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Type {
    fn named(word: &str) -> Option<Type> {
        Some(match word {
            "char" | "int8" => Type::I8,
            "uchar" | "uint8" => Type::U8,
            "short" | "int16" => Type::I16,
            "ushort" | "uint16" => Type::U16,
            "int" | "int32" => Type::I32,
            "uint" | "uint32" => Type::U32,
            "float" | "float32" => Type::F32,
            "double" | "float64" => Type::F64,
            _ => return None,
        })
    }

    /// Bytes of a number in binary files.
    pub(super) const fn size(self) -> u64 {
        match self {
            Type::I8 | Type::U8 => 1,
            Type::I16 | Type::U16 => 2,
            Type::I32 | Type::U32 | Type::F32 => 4,
            Type::F64 => 8,
        }
    }

    pub(super) const fn is_whole(self) -> bool {
        !matches!(self, Type::F32 | Type::F64)
    }
}

/// A number of an element, or a list of numbers.
#[derive(Clone, Debug)]
pub(super) struct Property {
    pub(super) name: String,
    /// The type of the list's count; `None` for a single number.
    pub(super) count: Option<Type>,
    pub(super) of: Type,
}

/// A kind of element.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    /// The line that announces it.
    pub(super) line: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// The least bytes that an element takes.
    pub(super) fn least(&self, form: Form) -> u64 {
        let least = |property: &Property| match form {
            // A digit and what parts it from the next.
            Form::Text => 2,
            _ => property.count.unwrap_or(property.of).size(),
        };
        self.properties.iter().map(least).sum()
    }
}

#[derive(Debug)]
pub(super) struct Header {
    pub(super) form: Form,
    pub(super) elements: Vec<Element>,
    /// Where the numbers begin.
    pub(super) end: usize,
    /// Lines of the header.
    pub(super) lines: u64,
}

impl Header {
    pub(super) fn read(bytes: &[u8]) -> Result<Header, Located> {
        let at = |line: u64, problem| (Some(Place::Line(line)), problem);
        let wrong = |line, sentence: String| at(line, MeshFileProblem::Wrong(sentence));
        let mut lines = Lines::new(bytes);
        let is_ply = lines.next().is_some_and(|line| line.trim_ascii() == b"ply");
        if !is_ply {
            return Err(wrong(1, "a PLY file begins with the line `ply`".into()));
        }
        let mut form = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut names = 0;
        loop {
            let Some(line) = lines.next() else {
                let what = "the header: there is no line `end_header`".to_owned();
                return Err(at(lines.number, MeshFileProblem::CutShort(what)));
            };
            let number = lines.number;
            if lines.at > MOST_BYTES {
                let problem = MeshFileProblem::TooMany {
                    what: "bytes in its header",
                    most: MOST_BYTES as u64,
                };
                return Err(at(number, problem));
            }
            let text = String::from_utf8_lossy(line);
            let words: Vec<&str> = text.split_ascii_whitespace().take(6).collect();
            match words[..] {
                [] | ["comment" | "obj_info", ..] => {}
                ["end_header"] => break,
                ["format", name, "1.0"] => {
                    form = Some(match name {
                        "ascii" => Form::Text,
                        "binary_little_endian" => Form::LittleEndian,
                        "binary_big_endian" => Form::BigEndian,
                        _ => {
                            let name = quoted_word(name);
                            let sentence = format!(
                                "`{name}` is no format; ascii, binary_little_endian and binary_big_endian are"
                            );
                            return Err(wrong(number, sentence));
                        }
                    });
                }
                ["format", ..] => {
                    let sentence = "a format is `format NAME 1.0`; other versions are not read";
                    return Err(wrong(number, sentence.into()));
                }
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| {
                        let word = quoted_word(count);
                        wrong(number, format!("`{word}` is not a count of elements"))
                    })?;
                    if elements.iter().any(|element| element.name == name) {
                        let name = quoted(name);
                        return Err(wrong(number, format!("another element is called `{name}`")));
                    }
                    let (name, line, properties) = (name.to_owned(), number, Vec::new());
                    elements.push(Element { name, count, line, properties });
                    names += 1;
                }
                ["property", ref rest @ ..] => {
                    let Some(element) = elements.last_mut() else {
                        let sentence = "a property stands before the first element";
                        return Err(wrong(number, sentence.into()));
                    };
                    let property = property(rest).map_err(|sentence| wrong(number, sentence))?;
                    element.properties.push(property);
                    names += 1;
                }
                [word, ..] => {
                    let word = quoted_word(word);
                    return Err(wrong(number, format!("`{word}` is no word of a PLY header")));
                }
            }
            if names > MOST_NAMES {
                let what = "elements and properties";
                return Err(at(number, MeshFileProblem::TooMany { what, most: MOST_NAMES as u64 }));
            }
        }
        let Some(form) = form else {
            return Err(wrong(lines.number, "the header has no line `format`".into()));
        };
        Ok(Header { form, elements, end: lines.at, lines: lines.number })
    }
}

fn property(words: &[&str]) -> Result<Property, String> {
    let kind = |word: &str| {
        Type::named(word).ok_or_else(|| format!("`{}` is no type of numbers", quoted_word(word)))
    };
    match *words {
        ["list", count, of, name] => {
            let count = kind(count)?;
            if !count.is_whole() {
                return Err("the count of a list is a whole number".to_owned());
            }
            Ok(Property { name: name.to_owned(), count: Some(count), of: kind(of)? })
        }
        [of, name] => Ok(Property { name: name.to_owned(), count: None, of: kind(of)? }),
        _ => Err("a property is `TYPE NAME` or `list TYPE TYPE NAME`".to_owned()),
    }
}

/// Lines that end in a line feed, with or without a carriage return before it, or in carriage returns alone.
struct Lines<'a> {
    bytes: &'a [u8],
    ending: u8,
    at: usize,
    number: u64,
}

impl<'a> Lines<'a> {
    fn new(bytes: &'a [u8]) -> Lines<'a> {
        let first = bytes.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
        let alone = first.is_some_and(|at| bytes[at] == b'\r' && bytes.get(at + 1) != Some(&b'\n'));
        Lines { bytes, ending: if alone { b'\r' } else { b'\n' }, at: 0, number: 0 }
    }

    /// The next line, if it ends.
    fn next(&mut self) -> Option<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        // No line of a header is longer than all of it may be.
        let within = &rest[..rest.len().min(MOST_BYTES)];
        let length = within.iter().position(|byte| *byte == self.ending)?;
        self.at += length + 1;
        self.number += 1;
        Some(&rest[..length])
    }
}
