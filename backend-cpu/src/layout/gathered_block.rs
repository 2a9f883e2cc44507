//! A block of triangles with all corners written out, made when a ray comes to a leaf of the compact layout.

use splitplane_core::triangle::Triangle;

/// A block with all corners written out: nine rows of coordinates (corner after corner) and one of
/// triangle indices.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GatheredBlock<'a> {
    /// The block's rows, and what follows them: a wide load of any row stays inside.
    pub words: &'a [f32],
    /// Length of a row.
    pub stride: usize,
    /// Triangles, 1 to 16.
    pub count: usize,
    /// Whether they are [large](super::large), in a block of their own.
    pub large: bool,
}

impl GatheredBlock<'_> {
    /// The corners of a triangle.
    #[inline]
    pub(crate) fn corners(&self, index: usize) -> Triangle {
        let mut corners = [[0.0; 3]; 3];
        for (row, x) in corners.as_flattened_mut().iter_mut().enumerate() {
            *x = self.words[row * self.stride + index];
        }
        corners
    }

    /// The index of a triangle in the mesh.
    #[inline]
    pub(crate) fn triangle(&self, index: usize) -> u32 {
        self.words[9 * self.stride + index].to_bits()
    }
}
