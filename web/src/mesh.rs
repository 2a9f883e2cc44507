//! Meshes as arrays, and trees as files.

use splitplane::Mesh;
use splitplane::core::tree::{KdTree, file};

use crate::failure::Failure;
use crate::words::Words;

/// The mesh of arrays.
pub(crate) fn mesh<'a>(
    positions: &'a Words,
    indices: &'a Words,
    is_indexed: bool,
) -> Result<Mesh<'a>, Failure> {
    let points = positions.points("positions")?;
    if is_indexed {
        return Ok(Mesh::indexed(points, indices.rows("indices")?)?);
    }
    let (triangles, rest) = points.as_chunks::<3>();
    match rest.is_empty() {
        true => Ok(Mesh::soup(triangles)?),
        false => Err(Failure::length("positions without indices", 3 * points.len(), 9)),
    }
}

/// The bytes of a tree file.
pub(crate) fn file_of(tree: &KdTree, mesh: &Mesh<'_>) -> Result<Vec<u8>, Failure> {
    let tree = tree.view();
    if mesh.len() != tree.triangles as usize {
        let text = format!(
            "the tree has {} triangles, and the mesh {}: it is another mesh",
            tree.triangles,
            mesh.len()
        );
        return Err(Failure::new("wrong-mesh", text));
    }
    Ok(file::write(&tree, mesh)?)
}
