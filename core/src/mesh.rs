//! The triangles over which a tree is built, as the caller holds them.

use thiserror::Error;

/// Greatest number of triangles of one mesh: indices and addresses stay within the node format.
pub const MAX_TRIANGLES: usize = 1 << 28;

/// A borrowed triangle mesh: corners by index, or a soup in which every three positions are a
/// triangle. The arrays are never reordered; a triangle's index is its place in them.
///
/// Arrays of other types: a `#[repr(C)]` type of three `f32` that is `bytemuck::Pod` can be cast to `[[f32; 3]]` by
/// `bytemuck::cast_slice`. Positions that lie among other data of a vertex have to be copied. A flat slice of
/// indices becomes `&[[u32; 3]]` by `as_chunks::<3>()`. A build copies what it needs, so the arrays are borrowed
/// only while it runs.
#[derive(Clone, Copy, Debug)]
pub struct Mesh<'a> {
    positions: &'a [[f32; 3]],
    indices: Option<&'a [[u32; 3]]>,
}

/// Errors of arrays that are not a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A corner names a position that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are {vertices} vertices")]
    IndexOutOfRange {
        /// The first such triangle.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
    /// More triangles than a tree can address.
    #[error("{triangles} triangles are more than the {MAX_TRIANGLES} that one tree can hold")]
    TooManyTriangles {
        /// How many were given.
        triangles: usize,
    },
}

impl<'a> Mesh<'a> {
    /// A mesh of triangles that name their corners.
    ///
    /// # Errors
    /// An index that is out of range, or too many triangles.
    pub fn indexed(
        positions: &'a [[f32; 3]],
        indices: &'a [[u32; 3]],
    ) -> Result<Mesh<'a>, MeshError> {
        check_count(indices.len())?;
        let vertices = positions.len();
        // The greatest index decides; the culprit is looked for only when there is one.
        let greatest = indices.iter().fold(0, |m, t| t[0].max(t[1]).max(t[2]).max(m));
        if !indices.is_empty() && greatest as usize >= vertices {
            for (triangle, corners) in indices.iter().enumerate() {
                for &vertex in corners {
                    if vertex as usize >= vertices {
                        return Err(MeshError::IndexOutOfRange { triangle, vertex, vertices });
                    }
                }
            }
        }
        Ok(Mesh { positions, indices: Some(indices) })
    }

    /// A mesh of separate triangles.
    ///
    /// # Errors
    /// Too many triangles.
    pub fn soup(triangles: &'a [[[f32; 3]; 3]]) -> Result<Mesh<'a>, MeshError> {
        check_count(triangles.len())?;
        Ok(Mesh { positions: triangles.as_flattened(), indices: None })
    }

    /// The mesh of arrays that have been those of a mesh before.
    #[cfg(all(feature = "alloc", target_has_atomic = "ptr"))]
    pub(crate) const fn of_checked(
        positions: &'a [[f32; 3]],
        indices: Option<&'a [[u32; 3]]>,
    ) -> Mesh<'a> {
        Mesh { positions, indices }
    }

    /// How many triangles there are.
    pub fn len(&self) -> usize {
        match self.indices {
            Some(indices) => indices.len(),
            None => self.positions.len() / 3,
        }
    }

    /// True for a mesh without triangles.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The corners of one triangle, as given.
    ///
    /// # Panics
    /// If `triangle` is not below [`Mesh::len`].
    #[inline]
    pub fn triangle(&self, triangle: usize) -> [[f32; 3]; 3] {
        match self.indices {
            Some(indices) => indices[triangle].map(|vertex| self.positions[vertex as usize]),
            None => {
                let corners = &self.positions[3 * triangle..3 * triangle + 3];
                [corners[0], corners[1], corners[2]]
            }
        }
    }

    /// The positions, and the indices if the mesh has any.
    pub fn arrays(&self) -> (&'a [[f32; 3]], Option<&'a [[u32; 3]]>) {
        (self.positions, self.indices)
    }
}

fn check_count(triangles: usize) -> Result<(), MeshError> {
    if triangles > MAX_TRIANGLES {
        return Err(MeshError::TooManyTriangles { triangles });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_have_so_many_triangles_at_most() {
        assert_eq!(check_count(MAX_TRIANGLES), Ok(()));
        let triangles = MAX_TRIANGLES + 1;
        assert_eq!(check_count(triangles), Err(MeshError::TooManyTriangles { triangles }));
    }

    #[test]
    fn a_bad_index_is_named() {
        let positions = [[0.0; 3]; 3];
        let error = Mesh::indexed(&positions, &[[0, 1, 2], [0, 7, 1]]).unwrap_err();
        assert_eq!(error, MeshError::IndexOutOfRange { triangle: 1, vertex: 7, vertices: 3 });
        assert!(Mesh::indexed(&[], &[]).unwrap().is_empty());
        assert!(Mesh::indexed(&[], &[[0, 0, 0]]).is_err());
    }
}
