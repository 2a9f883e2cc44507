//! PLY: ascii and binary of both byte orders, meshes and clouds of points.
//!
//! The element `vertex` gives positions (`x y z`) and normals (`nx ny nz`), `face` polygons (a list called `vertex_indices` or
//! `vertex_index`), `tristrips` strips of triangles, in any order, with any types and among any other properties. A face of more than
//! three corners is the fan around its first, as in OBJ files; vertices keep the order of the file. All else is skipped, and what a
//! picture would miss of it is noted.
//!
//! The reader is our own. The crates that there are take numbers such as `nan`, `.5` or `5.` in text for errors, lose one of two
//! properties of the same name, and with it the place of all that follow, and do not say where in a binary file they stopped. Here every
//! count is held against the bytes that are left before memory is made for it, and an error names a line or a byte.

mod body;
mod header;
mod reader;
mod write;

pub use write::{Encoding, points_to_bytes, to_bytes};

use crate::mesh_file::{self, MeshFileError, MeshFileProblem, in_file};
use crate::{Scene, SceneOptions};
use splitplane_float_state::Standard;
use std::path::Path;

/// Reads a file of a mesh.
///
/// # Errors
/// The file cannot be read, is no PLY file, or has no triangles.
pub fn read(path: &Path, options: &SceneOptions) -> Result<Scene, MeshFileError> {
    let _state = Standard::set();
    parse(&mesh_file::bytes_of(path, options)?, path)
}

/// Reads the bytes of a file of a mesh; `path` names it in errors, and its last part the scene.
///
/// # Errors
/// As for [`read`].
pub fn parse(bytes: &[u8], path: &Path) -> Result<Scene, MeshFileError> {
    let _state = Standard::set();
    let scene = reader::mesh(bytes, &mesh_file::name_of(path)).map_err(in_file(path))?;
    match scene.indices.is_empty() {
        true => Err(in_file(path)((None, MeshFileProblem::NoTriangles))),
        false => Ok(scene),
    }
}

/// The positions of all vertices of a file, in its order: the points of a cloud, or the vertices of a mesh. Points with a coordinate that
/// is NaN or infinite are among them.
///
/// # Errors
/// The file cannot be read, is no PLY file, or has no vertices.
pub fn read_points(path: &Path, options: &SceneOptions) -> Result<Vec<[f32; 3]>, MeshFileError> {
    let _state = Standard::set();
    parse_points(&mesh_file::bytes_of(path, options)?, path)
}

/// As [`read_points`], of the bytes of a file.
///
/// # Errors
/// As for [`read_points`].
pub fn parse_points(bytes: &[u8], path: &Path) -> Result<Vec<[f32; 3]>, MeshFileError> {
    let _state = Standard::set();
    let points = reader::points(bytes).map_err(in_file(path))?;
    match points.is_empty() {
        true => Err(in_file(path)((None, MeshFileProblem::NoPoints))),
        false => Ok(points),
    }
}

#[cfg(test)]
mod tests;
