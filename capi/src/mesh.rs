//! Meshes as C has them.

use library::core::mesh::MAX_TRIANGLES;
use library::{Mesh as LibraryMesh, MeshError};

use crate::buffer::{Given, read};
use crate::status::{Failure, Status};

/// The triangles of a mesh, in your arrays. They are read while a call runs that is given them, and not changed.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Mesh {
    /// x, y and z of the first corner.
    pub positions: *const f32,
    /// Bytes from one position to the next: 12 where nothing is between them.
    pub position_stride: usize,
    /// How many positions.
    pub position_count: usize,
    /// The three corners of the first triangle; NULL where every three positions are a triangle.
    pub indices: *const u32,
    /// Bytes from one triangle to the next: 12 where nothing is between them. 0 without indices.
    pub index_stride: usize,
    /// How many triangles; without indices a third of the positions.
    pub triangle_count: usize,
}

/// The arrays of a mesh, side by side.
#[derive(Default)]
pub(crate) struct Copies {
    positions: Vec<[f32; 3]>,
    indices: Vec<[u32; 3]>,
}

impl Copies {
    /// The mesh of a call, without copies where nothing lies between its items.
    ///
    /// # Safety
    /// What the record says is memory that nobody writes while the result lives.
    pub(crate) unsafe fn mesh<'a>(
        &'a mut self,
        mesh: *const Mesh,
    ) -> Result<LibraryMesh<'a>, Failure> {
        // SAFETY: as the caller says.
        let own = unsafe { read(mesh, "mesh")? };
        let (positions, triangles) = (own.position_count, own.triangle_count);
        if triangles > MAX_TRIANGLES {
            return Err(MeshError::TooManyTriangles { triangles }.into());
        }
        if positions > 1 << 32 {
            let text = format!("{positions} positions are more than indices can name");
            return Err(Failure::new(Status::Count, text));
        }
        let (stride, first) = (own.position_stride, own.positions.cast());
        // SAFETY: as the caller says.
        let corners = unsafe { Given::<[f32; 3]>::new(first, stride, positions, "positions")? };
        if own.indices.is_null() {
            if own.index_stride != 0 && triangles > 0 {
                return Err(Failure::new(Status::NullPointer, "indices is NULL, and has a stride"));
            }
            if positions != 3 * triangles {
                let text = format!(
                    "{triangles} triangles without indices do not have {positions} positions"
                );
                return Err(Failure::new(Status::Count, text));
            }
            let corners = corners.beside(&mut self.positions)?;
            return Ok(LibraryMesh::soup(corners.as_chunks::<3>().0)?);
        }
        let (stride, first) = (own.index_stride, own.indices.cast());
        // SAFETY: as the caller says.
        let faces = unsafe { Given::<[u32; 3]>::new(first, stride, triangles, "indices")? };
        let corners = corners.beside(&mut self.positions)?;
        Ok(LibraryMesh::indexed(corners, faces.beside(&mut self.indices)?)?)
    }
}
