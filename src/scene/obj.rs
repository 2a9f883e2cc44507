//! Wavefront OBJ: `v`, `f`, `usemtl`, `mtllib`; groups, normals and texture coordinates are read
//! over.
//!
//! The reader is our own, because what a user gets back are indices: vertices keep the order of the
//! file, unused ones included, and triangle `i` is the `i`-th one of the file, a face of more
//! corners being the fan around its first. The `tobj` crate, which reads the `.mtl` files, renumbers
//! vertices by first use, and may panic on a negative index before the first vertex.

mod error;
mod lines;
mod materials;
mod reader;

pub use error::{ObjError, ObjProblem};

use super::Scene;
use std::fs;
use std::path::Path;

/// Reads an OBJ file and the .mtl files it names. A missing or broken .mtl file is a warning in
/// [`Scene::notes`], and its surfaces are clay.
///
/// # Errors
/// The file cannot be read, or is not OBJ; the error names the file, and the line where there is
/// one.
pub fn read(path: &Path) -> Result<Scene, ObjError> {
    let fail = |problem| ObjError { file: path.to_owned(), line: None, problem };
    let about = fs::metadata(path).map_err(|error| fail(ObjProblem::unreadable(&error)))?;
    if about.is_dir() {
        return Err(fail(ObjProblem::Folder));
    }
    if !about.is_file() {
        // A pipe or a device may never end.
        return Err(fail(ObjProblem::NotAFile));
    }
    let bytes = fs::read(path).map_err(|error| fail(ObjProblem::unreadable(&error)))?;
    let text = String::from_utf8(bytes).map_err(|error| {
        let before = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = 1 + before.iter().filter(|byte| **byte == b'\n').count() as u64;
        ObjError { file: path.to_owned(), line: Some(line), problem: ObjProblem::NotUtf8 }
    })?;
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    let located = |(line, problem)| ObjError { file: path.to_owned(), line, problem };
    let (mut scene, libraries) = reader::read(&text, &name).map_err(located)?;
    materials::paint(&mut scene, &libraries, path.parent().unwrap_or(Path::new("")));
    Ok(scene)
}

/// Reads OBJ text. Files it names are not opened: its materials have names, and are clay.
///
/// # Errors
/// The text is not OBJ; `name` stands for the file in the error.
pub fn parse(text: &str, name: &str) -> Result<Scene, ObjError> {
    let located = |(line, problem)| ObjError { file: name.into(), line, problem };
    Ok(reader::read(text, name).map_err(located)?.0)
}
