//! Wavefront OBJ: `v`, `vn`, `vt`, `f`, `usemtl`, `mtllib`; where groups (`g`) and objects (`o`) begin is noted.
//!
//! The reader is our own, because what a user gets back are indices: vertices keep the order of the
//! file, unused ones included, and triangle `i` is the `i`-th one of the file, a face of more
//! corners being the fan around its first. Positions, normals and texture coordinates keep indices
//! of their own, as the file has them: nothing is merged, split or renumbered.
//!
//! What a surface looks like comes from .mtl files, by the rule at [`MaterialRule`].

mod corner;
mod error;
mod library;
mod lines;
mod mtl;
mod named_file;
mod reader;
mod rule;
mod said;
#[cfg(feature = "textures")]
pub(crate) mod textures;

pub use error::{Element, ObjError, ObjProblem};

#[cfg(doc)]
use super::MaterialRule;
use super::{Scene, SceneOptions};
use crate::budget::Budget;
use crate::from_file::{self, ReadError};
use splitplane_float_state::Standard;
use std::path::Path;

/// Reads an OBJ file and the .mtl files it names. A missing or broken .mtl file is a warning in
/// [`Scene::notes`], and its surfaces are clay; so is a texture that cannot be read, and its surface
/// keeps its colour.
///
/// # Errors
/// The file cannot be read, or is not OBJ; the error names the file, and the line where there is
/// one.
pub fn read(path: &Path) -> Result<Scene, ObjError> {
    read_with(path, &SceneOptions::default())
}

/// As [`read`], with a say in what materials and textures become.
///
/// # Errors
/// As [`read`].
pub fn read_with(path: &Path, options: &SceneOptions) -> Result<Scene, ObjError> {
    let _state = Standard::set();
    read_within(path, options, &Budget::unlimited())
}

/// As [`read_with`], where the text, while it is there, and what is made of it count for a budget. What .mtl files and textures take has limits of its own.
///
/// # Errors
/// As [`read`]. Where the budget does not suffice, it knows that it refused.
pub(crate) fn read_within(
    path: &Path,
    options: &SceneOptions,
    budget: &Budget,
) -> Result<Scene, ObjError> {
    let mut bytes = Vec::new();
    let (mut scene, libraries) = geometry(path, &mut bytes, Scene::default(), options, budget)?;
    budget.give(bytes.capacity() as u64);
    let folder = path.parent().unwrap_or(Path::new(""));
    let paint_bytes = library::bytes_to_paint(&scene, &libraries, folder);
    budget.take(paint_bytes).map_err(|full| {
        let (file, line, problem) = (path.to_owned(), None, full.into());
        ObjError { file, line, problem }
    })?;
    // Textures may be large; the text is not needed any more.
    drop(bytes);
    paint(&mut scene, &libraries, path, options);
    budget.give(paint_bytes);
    Ok(scene)
}

/// Reads OBJ text. Files it names are not opened: its materials have names, and are clay.
///
/// # Errors
/// The text is not OBJ; `name` names the file in the error.
pub fn parse(text: &str, name: &str) -> Result<Scene, ObjError> {
    let _state = Standard::set();
    let located = |(line, problem)| ObjError { file: name.into(), line, problem };
    let budget = Budget::unlimited();
    Ok(reader::read(text, name, Scene::default(), &budget).map_err(located)?.0)
}

/// Sets the materials of a scene read from `path` as their libraries say.
pub(super) fn paint(scene: &mut Scene, libraries: &[String], path: &Path, options: &SceneOptions) {
    library::paint(scene, libraries, path.parent().unwrap_or(Path::new("")), options);
}

/// What an OBJ file says by itself: the scene, its materials not yet coloured, and what follows
/// every `mtllib`. `bytes` and `memory` are used again; both count for the budget.
pub(super) fn geometry(
    path: &Path,
    bytes: &mut Vec<u8>,
    memory: Scene,
    options: &SceneOptions,
    budget: &Budget,
) -> Result<(Scene, Vec<String>), ObjError> {
    let fail = |problem| ObjError { file: path.to_owned(), line: None, problem };
    let limit = options.file_limit.unwrap_or_else(from_file::usual_limit);
    from_file::read_within(path, limit, bytes, budget).map_err(|error| {
        fail(match error {
            // A pipe or a device may never end.
            ReadError::NotAFile if path.is_dir() => ObjProblem::Folder,
            ReadError::NotAFile => ObjProblem::NotAFile,
            ReadError::TooLong { limit } => ObjProblem::TooLong { limit },
            ReadError::Memory => ObjProblem::Memory,
            ReadError::System(error) => ObjProblem::unreadable(&error),
        })
    })?;
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let before = &bytes[..error.valid_up_to()];
        let line = 1 + before.iter().filter(|byte| **byte == b'\n').count() as u64;
        ObjError { file: path.to_owned(), line: Some(line), problem: ObjProblem::NotUtf8 }
    })?;
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    let located = |(line, problem)| ObjError { file: path.to_owned(), line, problem };
    reader::read(text, &name, memory, budget).map_err(located)
}
