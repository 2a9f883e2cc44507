//! STL: triangles as text or as bytes.
//!
//! Corners with equal bits become one vertex, and no others: a vertex is numbered where the file names it first, and triangle `i` is the
//! `i`-th one of the file. Welding by a distance would move corners and could make triangles vanish; not welding at all would take three
//! times the memory for the same hits, since the ray tests look at positions, not at numbers. So `0` and `-0`, which are equal but not by
//! their bits, stay two vertices; that costs twelve bytes and changes nothing else.
//!
//! A file is binary where its length is what its count of triangles says, whatever its first word is: many binary files begin with
//! `solid` all the same. One with bytes behind its last triangle is binary too if its count has a zero byte, which no text has. Normals of facets are not read; triangles have those of their corners' order.
//!
//! The reader is our own: the crate `stl_io` takes every file that begins with `solid` for text, and does not say where it stopped.

use crate::from_file::quoted_word;
use crate::mesh_file::{self, Located, MeshFileError, MeshFileProblem, Place, in_file, room};
use crate::{Group, Material, Scene, SceneOptions};
use splitplane_core::mesh::MAX_TRIANGLES;
use splitplane_float_state::Standard;
use std::collections::HashMap;
use std::path::Path;

/// Bytes of the header and the count, and of a triangle.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

/// Reads a file.
///
/// # Errors
/// The file cannot be read, is no STL file, or has no triangles.
pub fn read(path: &Path, options: &SceneOptions) -> Result<Scene, MeshFileError> {
    let _state = Standard::set();
    parse(&mesh_file::bytes_of(path, options)?, path)
}

/// Reads the bytes of a file; `path` names it in errors, and its last part the scene.
///
/// # Errors
/// As for [`read`].
pub fn parse(bytes: &[u8], path: &Path) -> Result<Scene, MeshFileError> {
    let _state = Standard::set();
    let mut weld = Weld::default();
    weld.scene.name = mesh_file::name_of(path);
    let done = match (announced(bytes), bytes.trim_ascii_start()) {
        (Some(count), _) if is_binary(bytes, count) => binary(bytes, &mut weld),
        (_, text) if starts_with_word(text, "solid") => self::text(bytes, &mut weld),
        (Some(_), _) => binary(bytes, &mut weld),
        (None, _) => {
            let sentence = "it neither begins with the word `solid` nor has the 84 bytes that a binary STL file begins with";
            Err((None, MeshFileProblem::Wrong(sentence.into())))
        }
    };
    let finished = done.and_then(|()| weld.finish().map_err(|problem| (None, problem)));
    finished.map_err(in_file(path))
}

/// The count of triangles that a binary file has.
fn announced(bytes: &[u8]) -> Option<u32> {
    bytes.get(HEADER - 4..)?.first_chunk().map(|count| u32::from_le_bytes(*count))
}

fn length_for(count: u32) -> u64 {
    HEADER as u64 + u64::from(count) * TRIANGLE as u64
}

/// Whether the file is binary whatever its first word is.
fn is_binary(bytes: &[u8], count: u32) -> bool {
    let (needed, length) = (length_for(count), bytes.len() as u64);
    needed == length || needed < length && count.to_le_bytes().contains(&0)
}

fn starts_with_word(text: &[u8], word: &str) -> bool {
    let start = text.get(..word.len()).is_some_and(|own| own.eq_ignore_ascii_case(word.as_bytes()));
    start && text.get(word.len()).is_none_or(u8::is_ascii_whitespace)
}

fn binary(bytes: &[u8], weld: &mut Weld) -> Result<(), Located> {
    let count = u64::from(announced(bytes).unwrap_or(0));
    let (triangles, _) = bytes.get(HEADER..).unwrap_or_default().as_chunks::<TRIANGLE>();
    let most = triangles.len() as u64;
    if count > most {
        let problem = MeshFileProblem::Count { what: "triangles".into(), count, most };
        return Err((Some(Place::Byte(HEADER as u64 - 4)), problem));
    }
    weld.room(count as usize).map_err(|problem| (None, problem))?;
    let mut attributes = 0u64;
    for triangle in &triangles[..count as usize] {
        let number = |at: usize| f32::from_le_bytes(std::array::from_fn(|k| triangle[at + k]));
        let corner = |at: usize| [number(at), number(at + 4), number(at + 8)];
        weld.add([corner(12), corner(24), corner(36)]).map_err(|problem| (None, problem))?;
        attributes += u64::from(triangle[48..] != [0, 0]);
    }
    let warnings = &mut weld.scene.notes.warnings;
    if attributes > 0 {
        warnings.push(format!(
            "the attributes of {attributes} triangles, perhaps colours, are left out"
        ));
    }
    let rest = bytes.len() as u64 - HEADER as u64 - count * TRIANGLE as u64;
    if rest > 0 {
        warnings.push(format!("{rest} bytes behind the last triangle are skipped"));
    }
    Ok(())
}

/// Words with their lines.
struct Words<'a> {
    rest: &'a [u8],
    line: u64,
}

impl<'a> Words<'a> {
    /// The next word; none at the end.
    fn next(&mut self) -> Option<&'a [u8]> {
        let start = self.rest.iter().position(|byte| !byte.is_ascii_whitespace());
        let start = start.unwrap_or(self.rest.len());
        self.pass(start);
        let length = self.rest.iter().position(u8::is_ascii_whitespace).unwrap_or(self.rest.len());
        let word = &self.rest[..length];
        self.rest = &self.rest[length..];
        (length > 0).then_some(word)
    }

    /// What is left of the line.
    fn rest_of_line(&mut self) -> &'a [u8] {
        let ends = |byte: &u8| matches!(byte, b'\n' | b'\r');
        let length = self.rest.iter().position(ends).unwrap_or(self.rest.len());
        let line = &self.rest[..length];
        self.rest = &self.rest[length..];
        line.trim_ascii()
    }

    fn pass(&mut self, bytes: usize) {
        let next = |at: usize| self.rest.get(at + 1);
        let ends = |at: &usize| match self.rest[*at] {
            b'\n' => true,
            // A carriage return alone ends a line too.
            b'\r' => next(*at) != Some(&b'\n'),
            _ => false,
        };
        self.line += (0..bytes).filter(ends).count() as u64;
        self.rest = &self.rest[bytes..];
    }

    fn here(&self, problem: MeshFileProblem) -> Located {
        (Some(Place::Line(self.line)), problem)
    }

    /// A word that must be this one.
    fn demand(&mut self, wanted: &str, within: &str) -> Result<(), Located> {
        match self.next() {
            Some(word) if word.eq_ignore_ascii_case(wanted.as_bytes()) => Ok(()),
            Some(word) => {
                let word = quoted_word(&String::from_utf8_lossy(&word[..word.len().min(64)]));
                let sentence = format!("`{wanted}` should stand here, not `{word}`");
                Err(self.here(MeshFileProblem::Wrong(sentence)))
            }
            None => Err(self.here(MeshFileProblem::CutShort(within.to_owned()))),
        }
    }

    fn point(&mut self) -> Result<[f32; 3], Located> {
        let mut point = [0.0; 3];
        for part in &mut point {
            let Some(word) = self.next() else {
                return Err(self.here(MeshFileProblem::CutShort("a vertex".into())));
            };
            let parsed = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
            *part = parsed.ok_or_else(|| {
                let word = quoted_word(&String::from_utf8_lossy(&word[..word.len().min(64)]));
                self.here(MeshFileProblem::Wrong(format!("`{word}` is not a number")))
            })?;
        }
        Ok(point)
    }
}

fn text(bytes: &[u8], weld: &mut Weld) -> Result<(), Located> {
    let mut words = Words { rest: bytes, line: 1 };
    let mut is_open = false;
    while let Some(word) = words.next() {
        let is = |wanted: &str| word.eq_ignore_ascii_case(wanted.as_bytes());
        if is("solid") {
            let name = String::from_utf8_lossy(words.rest_of_line()).into_owned();
            weld.object(name).map_err(|problem| words.here(problem))?;
            is_open = true;
        } else if is("endsolid") {
            words.rest_of_line();
            is_open = false;
        } else if is("facet") && is_open {
            words.demand("normal", "a facet")?;
            // Nobody asks for it, and some programs write words there.
            let normal = (0..3).all(|_| words.next().is_some());
            if !normal {
                return Err(words.here(MeshFileProblem::CutShort("a facet".into())));
            }
            words.demand("outer", "a facet")?;
            words.demand("loop", "a facet")?;
            let mut corners = [[0.0; 3]; 3];
            for corner in &mut corners {
                words.demand("vertex", "a facet")?;
                *corner = words.point()?;
            }
            words.demand("endloop", "a facet")?;
            words.demand("endfacet", "a facet")?;
            weld.room(1).and_then(|()| weld.add(corners)).map_err(|problem| words.here(problem))?;
        } else {
            let word = quoted_word(&String::from_utf8_lossy(&word[..word.len().min(64)]));
            let wanted = if is_open { "`facet` or `endsolid`" } else { "`solid`" };
            let sentence = format!("{wanted} should stand here, not `{word}`");
            return Err(words.here(MeshFileProblem::Wrong(sentence)));
        }
    }
    if is_open {
        let note = "the file does not end in `endsolid`; it may be cut short";
        weld.scene.notes.warnings.push(note.to_owned());
    }
    Ok(())
}

/// A scene whose vertices are made one by their bits.
#[derive(Default)]
struct Weld {
    scene: Scene,
    numbers: HashMap<[u32; 3], u32>,
}

impl Weld {
    /// Makes space for triangles; for vertices it is made as they come.
    fn room(&mut self, triangles: usize) -> Result<(), MeshFileProblem> {
        let there = self.scene.indices.len();
        if there + triangles > MAX_TRIANGLES {
            let most = MAX_TRIANGLES as u64;
            return Err(MeshFileProblem::TooMany { what: "triangles", most });
        }
        room(&mut self.scene.indices, triangles)
    }

    fn add(&mut self, corners: [[f32; 3]; 3]) -> Result<(), MeshFileProblem> {
        room(&mut self.scene.positions, 3)?;
        self.numbers.try_reserve(3).map_err(|_| MeshFileProblem::Memory)?;
        let Scene { positions, indices, notes, .. } = &mut self.scene;
        indices.push(corners.map(|corner| {
            *self.numbers.entry(corner.map(f32::to_bits)).or_insert_with(|| {
                notes.non_finite_vertices += u64::from(!corner.iter().all(|x| x.is_finite()));
                positions.push(corner);
                positions.len() as u32 - 1
            })
        }));
        Ok(())
    }

    /// Begins a solid: an object of the scene.
    fn object(&mut self, name: String) -> Result<(), MeshFileProblem> {
        let first_triangle = self.scene.indices.len() as u32;
        let groups = &mut self.scene.groups;
        // One that no triangle is in was not begun.
        groups.pop_if(|last| last.first_triangle == first_triangle);
        room(groups, 1)?;
        groups.push(Group { is_object: true, name, first_triangle });
        Ok(())
    }

    fn finish(self) -> Result<Scene, MeshFileProblem> {
        let mut scene = self.scene;
        if scene.indices.is_empty() {
            return Err(MeshFileProblem::NoTriangles);
        }
        room(&mut scene.material_of, scene.indices.len())?;
        scene.material_of.resize(scene.indices.len(), 0);
        scene.materials = vec![Material::clay()];
        Ok(scene)
    }
}

#[cfg(test)]
mod tests;
