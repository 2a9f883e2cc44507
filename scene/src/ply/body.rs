//! The numbers behind the header, one after the other, in text or bytes.

use super::header::{Element, Form, Property, Type};
use crate::from_file::{quoted, quoted_word};
use crate::mesh_file::{Located, MeshFileProblem, Place};

/// Where numbers come from.
pub(super) struct Body<'a> {
    bytes: &'a [u8],
    form: Form,
    at: usize,
    /// The line, in text.
    line: u64,
}

impl<'a> Body<'a> {
    /// The numbers from a place on; in text it is the line after this one.
    pub(super) fn new(bytes: &'a [u8], form: Form, at: usize, lines: u64) -> Body<'a> {
        Body { bytes, form, at, line: lines + 1 }
    }

    /// Where the next number is.
    pub(super) fn place(&self) -> Option<Place> {
        Some(match self.form {
            Form::Text => Place::Line(self.line),
            _ => Place::Byte(self.at as u64),
        })
    }

    fn left(&self) -> u64 {
        (self.bytes.len() - self.at) as u64
    }

    /// Refuses a count of elements that cannot be in the bytes that are left.
    pub(super) fn check(&self, element: &Element) -> Result<(), Located> {
        let least = element.least(self.form);
        // The last number of a text may end with it.
        let most = (self.left() + 1).checked_div(least);
        let Some(most) = most.filter(|most| element.count > *most) else { return Ok(()) };
        let (what, count) = (format!("elements `{}`", quoted(&element.name)), element.count);
        Err((Some(Place::Line(element.line)), MeshFileProblem::Count { what, count, most }))
    }

    /// The length of a list whose numbers are all there.
    pub(super) fn list(&mut self, count: Type, property: &Property) -> Result<u64, Located> {
        let place = self.place();
        let found = self.number(count, property)?;
        if found < 0.0 || found.fract() != 0.0 {
            let sentence = format!("a list of {found} numbers cannot be");
            return Err((place, MeshFileProblem::Wrong(sentence)));
        }
        let size = if self.form == Form::Text { 2 } else { property.of.size() };
        let most = (self.left() + 1) / size;
        let found = found as u64;
        if found > most {
            let what = format!("numbers in a list `{}`", quoted(&property.name));
            return Err((place, MeshFileProblem::Count { what, count: found, most }));
        }
        Ok(found)
    }

    /// The next number, as its type holds it.
    pub(super) fn number(&mut self, of: Type, property: &Property) -> Result<f64, Located> {
        match self.form {
            Form::Text => self.text(of, property),
            Form::LittleEndian => self.binary(of, property, false),
            Form::BigEndian => self.binary(of, property, true),
        }
    }

    /// Skips numbers that nobody wants. They are looked at in text.
    pub(super) fn skip(&mut self, count: u64, property: &Property) -> Result<(), Located> {
        if self.form == Form::Text {
            return (0..count).try_for_each(|_| self.number(property.of, property).map(drop));
        }
        let bytes = count.checked_mul(property.of.size()).filter(|bytes| *bytes <= self.left());
        let Some(bytes) = bytes else { return Err(self.cut_short(property)) };
        self.at += bytes as usize;
        Ok(())
    }

    /// Ends an element: in text nothing more may stand in its line.
    pub(super) fn end(&mut self, element: &Element) -> Result<(), Located> {
        if self.form != Form::Text || element.properties.is_empty() {
            return Ok(());
        }
        while let Some(byte) = self.bytes.get(self.at) {
            match byte {
                b'\n' | b'\r' => return Ok(()),
                byte if byte.is_ascii_whitespace() => self.at += 1,
                _ => {
                    let name = quoted(&element.name);
                    let sentence =
                        format!("the line has more numbers than an element `{name}` consists of");
                    return Err((self.place(), MeshFileProblem::Wrong(sentence)));
                }
            }
        }
        Ok(())
    }

    fn cut_short(&self, property: &Property) -> Located {
        let what = format!("a property `{}`", quoted(&property.name));
        (self.place(), MeshFileProblem::CutShort(what))
    }

    fn text(&mut self, of: Type, property: &Property) -> Result<f64, Located> {
        while let Some(byte) = self.bytes.get(self.at).filter(|byte| byte.is_ascii_whitespace()) {
            let next = self.bytes.get(self.at + 1);
            // A carriage return alone ends a line too.
            self.line += u64::from(*byte == b'\n' || (*byte == b'\r' && next != Some(&b'\n')));
            self.at += 1;
        }
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        if length == 0 {
            return Err(self.cut_short(property));
        }
        let parsed = std::str::from_utf8(&rest[..length]).ok().and_then(|word| match of {
            Type::F32 => word.parse::<f32>().ok().map(f64::from),
            Type::F64 => word.parse::<f64>().ok(),
            // Some programs write whole numbers with a point.
            _ => word.parse::<i64>().map(|whole| whole as f64).or_else(|_| word.parse()).ok(),
        });
        let Some(value) = parsed else {
            let word = quoted_word(&String::from_utf8_lossy(&rest[..length.min(64)]));
            return Err((
                self.place(),
                MeshFileProblem::Wrong(format!("`{word}` is not a number")),
            ));
        };
        self.at += length;
        Ok(value)
    }

    fn binary(&mut self, of: Type, property: &Property, big: bool) -> Result<f64, Located> {
        let size = of.size() as usize;
        let Some(own) = self.bytes.get(self.at..self.at + size) else {
            return Err(self.cut_short(property));
        };
        self.at += size;
        let mut little = [0; 8];
        little[..size].copy_from_slice(own);
        if big {
            little[..size].reverse();
        }
        let bits = u64::from_le_bytes(little);
        Ok(match of {
            Type::I8 => f64::from(bits as i8),
            Type::U8 => f64::from(bits as u8),
            Type::I16 => f64::from(bits as i16),
            Type::U16 => f64::from(bits as u16),
            Type::I32 => f64::from(bits as i32),
            Type::U32 => f64::from(bits as u32),
            Type::F32 => f64::from(f32::from_bits(bits as u32)),
            Type::F64 => f64::from_bits(bits),
        })
    }
}
