//! What the corners of faces name: `v`, `v/vt`, `v//vn`, `v/vt/vn`.

use super::error::{Element, ObjProblem};
use crate::Scene;
use crate::budget::Budget;
use crate::from_file::quoted_word;

/// A corner of a face: places counted from 0, [`Scene::NONE`] where the file names nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub(super) position: u32,
    pub(super) texcoord: u32,
    pub(super) normal: u32,
}

/// One kind of element: how many of them were read, and which were named before they were.
#[derive(Debug)]
pub(super) struct Named {
    of: Element,
    pub(super) count: usize,
    /// Index counted from 1, and line. Only those above all before are kept, so the first one that
    /// stays out of range is in the list.
    ahead: Vec<(u64, u64)>,
}

impl Named {
    pub(super) fn new(of: Element) -> Named {
        Named { of, count: 0, ahead: Vec::new() }
    }

    /// Counts one more.
    pub(super) fn add(&mut self) -> Result<(), ObjProblem> {
        // The last value of 32 bits means none.
        if self.count >= Scene::NONE as usize {
            return Err(ObjProblem::TooMany(self.of));
        }
        self.count += 1;
        Ok(())
    }

    /// The place that an index of the file names, counted from 0. It may come later in the file.
    pub(super) fn place(
        &mut self,
        line: u64,
        index: i64,
        budget: &Budget,
    ) -> Result<u32, ObjProblem> {
        let (of, count) = (self.of, self.count as u64);
        if index == 0 {
            return Err(ObjProblem::ZeroIndex(of));
        }
        if index < 0 {
            let place = count.checked_sub(index.unsigned_abs());
            let place = place.ok_or(ObjProblem::PastStart { of, index, count })?;
            return u32::try_from(place).map_err(|_| ObjProblem::TooMany(of));
        }
        let index = index.unsigned_abs();
        if index > count && self.ahead.last().is_none_or(|(last, _)| index > *last) {
            budget.push(&mut self.ahead, (index, line))?;
        }
        // Too great for 32 bits is past the end of any file that can be read: the end will tell.
        Ok(u32::try_from(index - 1).unwrap_or(u32::MAX))
    }

    /// The first line that names one which the file does not have.
    pub(super) fn missing(&self) -> Option<(u64, ObjProblem)> {
        let count = self.count as u64;
        let &(index, line) = self.ahead.iter().find(|(index, _)| *index > count)?;
        Some((line, ObjProblem::PastEnd { of: self.of, index, count }))
    }
}

/// The three kinds.
#[derive(Debug)]
pub(super) struct Elements {
    pub(super) positions: Named,
    pub(super) texcoords: Named,
    pub(super) normals: Named,
}

impl Default for Elements {
    fn default() -> Elements {
        Elements {
            positions: Named::new(Element::Vertex),
            texcoords: Named::new(Element::TextureCoordinate),
            normals: Named::new(Element::Normal),
        }
    }
}

impl Elements {
    /// What a word of a face names.
    pub(super) fn corner(
        &mut self,
        line: u64,
        word: &str,
        budget: &Budget,
    ) -> Result<Corner, ObjProblem> {
        let bad = || ObjProblem::BadCorner(quoted_word(word));
        let number = |part: &str| part.parse::<i64>().map_err(|_| bad());
        let none = Scene::NONE;
        let Some((position, rest)) = word.split_once('/') else {
            let position = self.positions.place(line, number(word)?, budget)?;
            return Ok(Corner { position, texcoord: none, normal: none });
        };
        let (texcoord, normal) = rest.split_once('/').unwrap_or((rest, ""));
        let position = self.positions.place(line, number(position)?, budget)?;
        let optional = |part: &str, named: &mut Named| match part {
            "" => Ok(none),
            part => named.place(line, number(part)?, budget),
        };
        let texcoord = optional(texcoord, &mut self.texcoords)?;
        let normal = optional(normal, &mut self.normals)?;
        Ok(Corner { position, texcoord, normal })
    }

    /// The first line that names something which the file does not have.
    pub(super) fn missing(&self) -> Option<(u64, ObjProblem)> {
        let kinds = [&self.positions, &self.texcoords, &self.normals];
        kinds.into_iter().filter_map(Named::missing).min_by_key(|(line, _)| *line)
    }
}
