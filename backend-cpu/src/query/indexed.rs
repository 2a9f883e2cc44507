//! The mesh of the compact layout: a copy of the caller's arrays with snapped coordinates, and the
//! gathering of triangles from it for the wide test.

use rayon::prelude::*;
use splitplane_core::arithmetic::snap;
use splitplane_core::mesh::Mesh;
use splitplane_core::triangle::Triangle;

use super::blocks::Block;
use super::layout::fit;
use super::simd::MOST_LANES;
use crate::lookout::{self, Lookout};

/// Vertices that are snapped between two looks at the watch.
const PIECE: usize = 1 << 13;
/// Where gathered triangles are put together to a block, with what vector loads read behind it.
#[repr(align(64))]
pub(crate) struct Room([f32; 11 * MOST_LANES]);

impl Room {
    /// An empty one.
    pub const EMPTY: Room = Room([0.0; 11 * MOST_LANES]);
}

/// A mesh with snapped coordinates. Vertices are those of the caller; a mesh with as many vertices as
/// twice its triangles, or without indices, takes less as three corners a triangle.
#[derive(Debug, Default)]
pub(crate) struct IndexedMesh {
    vertices: Vec<[f32; 3]>,
    /// Corners by vertex; empty where vertices are corners.
    indices: Vec<[u32; 3]>,
}

/// Vertices and indices.
type Arrays<'a> = (&'a [[f32; 3]], &'a [[u32; 3]]);

/// The caller's arrays, where they are what is copied.
fn shared<'a>(mesh: &Mesh<'a>) -> Option<Arrays<'a>> {
    let (positions, indices) = mesh.arrays();
    indices.filter(|indices| positions.len() < 2 * indices.len()).map(|i| (positions, i))
}

impl IndexedMesh {
    /// Bytes of the copy of a mesh.
    pub fn bytes_for(mesh: &Mesh<'_>) -> u64 {
        match shared(mesh) {
            Some((positions, indices)) => (size_of_val(positions) + size_of_val(indices)) as u64,
            None => (mesh.len() * size_of::<Triangle>()) as u64,
        }
    }

    /// Bytes of this one.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.vertices[..]) + size_of_val(&self.indices[..])) as u64
    }

    /// Becomes the copy of a mesh with these snapped corners; of no use when the lookout has ended it.
    pub fn fill(&mut self, mesh: &Mesh<'_>, triangles: &[Triangle], look: &Lookout<'_>) {
        let IndexedMesh { vertices, indices } = self;
        vertices.clear();
        indices.clear();
        let Some((positions, given)) = shared(mesh) else {
            // Nothing is left of another mesh, which may have been larger.
            vertices.shrink_to(3 * triangles.len());
            fit(vertices, 3 * triangles.len());
            lookout::extend(look, vertices, triangles.as_flattened());
            return;
        };
        vertices.shrink_to(positions.len());
        indices.shrink_to(given.len());
        fit(vertices, positions.len());
        fit(indices, given.len());
        lookout::extend(look, indices, given);
        lookout::resize(look, vertices, positions.len(), &[0.0; 3]);
        if look.is_over() {
            return;
        }
        let pieces = vertices.par_chunks_mut(PIECE).zip(positions.par_chunks(PIECE));
        pieces.for_each(|(vertices, positions)| {
            if look.worked(positions.len() as u64) {
                return;
            }
            for (vertex, position) in vertices.iter_mut().zip(positions) {
                *vertex = position.map(snap);
            }
        });
    }

    /// The corners of a triangle.
    #[inline(always)]
    pub fn corners(&self, triangle: u32) -> Triangle {
        let triangle = triangle as usize;
        if self.indices.is_empty() {
            core::array::from_fn(|corner| self.vertices[3 * triangle + corner])
        } else {
            self.indices[triangle].map(|vertex| self.vertices[vertex as usize])
        }
    }

    /// Puts at most [`MOST_LANES`] triangles together to a block.
    #[inline(always)]
    pub fn gather<'b>(&self, triangles: &[u32], room: &'b mut Room) -> Block<'b> {
        let words = &mut room.0;
        for (i, &triangle) in triangles.iter().enumerate().take(MOST_LANES) {
            let corners = self.corners(triangle);
            for (row, &x) in corners.as_flattened().iter().enumerate() {
                words[row * MOST_LANES + i] = x;
            }
            words[9 * MOST_LANES + i] = f32::from_bits(triangle);
        }
        Block { words: &room.0, stride: MOST_LANES, count: triangles.len() }
    }
}
