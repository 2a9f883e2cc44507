//! Text to triangles.

use super::error::ObjProblem;
use super::lines::Lines;
use crate::scene::{Material, Scene};
use splitplane_core::mesh::MAX_TRIANGLES;
use std::collections::HashMap;

/// Where a problem is, and what.
pub(super) type Located = (Option<u64>, ObjProblem);

/// The scene, its materials not yet coloured, and what follows every `mtllib`.
pub(super) fn read(text: &str, name: &str) -> Result<(Scene, Vec<String>), Located> {
    let mut reader = Reader::new(name);
    for (line, content) in Lines::new(text) {
        reader.line(line, &content).map_err(|problem| (Some(line), problem))?;
    }
    reader.finish()
}

#[derive(Default)]
struct Reader {
    scene: Scene,
    libraries: Vec<String>,
    material_by_name: HashMap<String, u32>,
    /// The material in use; `None` before the first `usemtl`.
    material: Option<u32>,
    /// Corners of the face being read, kept to spare allocations.
    corners: Vec<u32>,
    /// Vertices named before they were read: index counted from 1, and line. Only those above all
    /// before are kept, so the first one that stays out of range is in the list.
    ahead: Vec<(u64, u64)>,
    /// How many lines had an unknown keyword, and the first of them.
    unknown: (u64, Option<(u64, String)>),
}

impl Reader {
    fn new(name: &str) -> Reader {
        let scene = Scene { name: name.to_owned(), ..Scene::default() };
        Reader { scene, ..Reader::default() }
    }

    fn line(&mut self, line: u64, content: &str) -> Result<(), ObjProblem> {
        let (keyword, rest) = match content.split_once(|c: char| c.is_ascii_whitespace()) {
            Some((keyword, rest)) => (keyword, rest.trim_ascii()),
            None => (content, ""),
        };
        match keyword {
            "v" => self.vertex(rest)?,
            "f" | "fo" => self.face(line, rest)?,
            "usemtl" => self.use_material(rest),
            "mtllib" => self.libraries.push(rest.to_owned()),
            "p" | "l" => self.scene.notes.skipped_elements += 1,
            "curv" | "curv2" | "surf" => self.scene.notes.skipped_freeform += 1,
            // What says nothing about where triangles are.
            "" | "vn" | "vt" | "vp" | "g" | "o" | "s" | "mg" | "bevel" | "c_interp"
            | "d_interp" | "lod" | "usemap" | "maplib" | "shadow_obj" | "trace_obj" | "cstype"
            | "deg" | "bmat" | "step" | "parm" | "trim" | "hole" | "scrv" | "sp" | "end"
            | "con" | "ctech" | "stech" => {}
            _ => {
                self.unknown.0 += 1;
                self.unknown.1.get_or_insert_with(|| (line, shorten(keyword)));
            }
        }
        Ok(())
    }

    fn vertex(&mut self, rest: &str) -> Result<(), ObjProblem> {
        let mut position = [0.0f32; 3];
        let mut words = rest.split_ascii_whitespace();
        for (axis, coordinate) in position.iter_mut().enumerate() {
            let word = words.next().ok_or(ObjProblem::FewCoordinates(axis))?;
            *coordinate = word.parse().map_err(|_| ObjProblem::BadNumber(shorten(word)))?;
        }
        // A weight or a colour may follow.
        if let Some(word) = words.find(|word| word.parse::<f32>().is_err()) {
            return Err(ObjProblem::BadNumber(shorten(word)));
        }
        if self.scene.positions.len() >= u32::MAX as usize {
            return Err(ObjProblem::TooManyVertices);
        }
        if !position.iter().all(|x| x.is_finite()) {
            self.scene.notes.non_finite_vertices += 1;
        }
        self.scene.positions.push(position);
        Ok(())
    }

    fn face(&mut self, line: u64, rest: &str) -> Result<(), ObjProblem> {
        self.corners.clear();
        for word in rest.split_ascii_whitespace() {
            let corner = self.corner(line, word)?;
            self.corners.push(corner);
        }
        let [first, others @ ..] = &self.corners[..] else {
            self.scene.notes.skipped_elements += 1;
            return Ok(());
        };
        if others.len() < 2 {
            self.scene.notes.skipped_elements += 1;
            return Ok(());
        }
        if self.scene.indices.len() + others.len() - 1 > MAX_TRIANGLES {
            return Err(ObjProblem::TooManyTriangles);
        }
        let material = match self.material {
            Some(material) => material,
            None => {
                self.scene.materials.push(Material::clay());
                *self.material.insert(self.scene.materials.len() as u32 - 1)
            }
        };
        for pair in others.windows(2) {
            self.scene.indices.push([*first, pair[0], pair[1]]);
            self.scene.material_of.push(material);
        }
        Ok(())
    }

    /// The vertex that a corner names, counted from 0. It may come later in the file.
    fn corner(&mut self, line: u64, word: &str) -> Result<u32, ObjProblem> {
        let bad = || ObjProblem::BadCorner(shorten(word));
        let mut parts = word.split('/');
        let index: i64 = parts.next().and_then(|part| part.parse().ok()).ok_or_else(bad)?;
        let numeric =
            |part: &str| part.bytes().all(|b| b.is_ascii_digit() || b == b'-' || b == b'+');
        if parts.clone().count() > 2 || !parts.all(numeric) {
            return Err(bad());
        }
        let vertices = self.scene.positions.len() as u64;
        if index == 0 {
            return Err(ObjProblem::ZeroIndex);
        }
        if index < 0 {
            let place = vertices.checked_sub(index.unsigned_abs());
            let place = place.ok_or(ObjProblem::PastStart { index, vertices })?;
            return u32::try_from(place).map_err(|_| ObjProblem::TooManyVertices);
        }
        let index = index.unsigned_abs();
        if index > vertices && self.ahead.last().is_none_or(|(last, _)| index > *last) {
            self.ahead.push((index, line));
        }
        // Too great for 32 bits is past the end of any file that can be read: the end will tell.
        Ok(u32::try_from(index - 1).unwrap_or(u32::MAX))
    }

    fn use_material(&mut self, name: &str) {
        let next = self.scene.materials.len() as u32;
        let index = *self.material_by_name.entry(name.to_owned()).or_insert(next);
        if index == next {
            self.scene.materials.push(Material { name: name.to_owned(), ..Material::clay() });
        }
        self.material = Some(index);
    }

    fn finish(mut self) -> Result<(Scene, Vec<String>), Located> {
        let vertices = self.scene.positions.len() as u64;
        let past = self.ahead.iter().find(|(index, _)| *index > vertices);
        if let Some(&(index, line)) = past {
            return Err((Some(line), ObjProblem::PastEnd { index, vertices }));
        }
        if self.scene.indices.is_empty() {
            return Err((None, ObjProblem::NoTriangles));
        }
        if let (count, Some((line, keyword))) = self.unknown {
            self.scene.notes.warnings.push(format!(
                "{count} lines with unknown keywords skipped, the first is line {line}: `{keyword}`"
            ));
        }
        Ok((self.scene, self.libraries))
    }
}

/// Enough of a word for a message.
fn shorten(word: &str) -> String {
    let mut short: String = word.chars().take(24).flat_map(char::escape_debug).collect();
    if word.chars().nth(24).is_some() {
        short.push_str("...");
    }
    short
}
