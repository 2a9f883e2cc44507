//! The mesh of the compact layout: a copy of the caller's arrays with snapped coordinates, and the
//! gathering of triangles from it for the wide test.

use rayon::prelude::*;
use splitplane_core::arithmetic::snap;
use splitplane_core::error::BuildError;
use splitplane_core::mesh::Mesh;
use splitplane_core::triangle::Triangle;
use splitplane_float_state::Standard;

use super::gathered_block::GatheredBlock;
use crate::cancel::ProgressMeter;
use crate::memory::{Memory, bytes_of, extend, resize};
use crate::simd::MOST_LANES;

/// Vertices that are snapped between two calls of the watch.
const PIECE: usize = 1 << 13;
/// Space in which gathered triangles form a block, with the words that vector loads read after it.
#[repr(align(64))]
pub(crate) struct GatherBuffer([f32; 11 * MOST_LANES]);

impl GatherBuffer {
    /// An empty one.
    pub(crate) const EMPTY: GatherBuffer = GatherBuffer([0.0; 11 * MOST_LANES]);
}

/// A mesh with snapped coordinates. Vertices are those of the caller; a mesh with as many vertices
/// as twice its triangles, or without indices, takes less as three corners per triangle.
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

/// Vertices and indices of the copy of a mesh.
fn lengths(mesh: &Mesh<'_>) -> [usize; 2] {
    match shared(mesh) {
        Some((positions, indices)) => [positions.len(), indices.len()],
        None => [3 * mesh.len(), 0],
    }
}

impl IndexedMesh {
    /// Bytes of this one.
    pub(crate) fn bytes(&self) -> u64 {
        (size_of_val(&self.vertices[..]) + size_of_val(&self.indices[..])) as u64
    }

    /// Capacity in bytes.
    pub(crate) fn held(&self) -> u64 {
        bytes_of(&self.vertices) + bytes_of(&self.indices)
    }

    /// Capacity in bytes once it also holds the copy of a mesh.
    pub(crate) fn held_with(&self, mesh: &Mesh<'_>) -> u64 {
        let [vertices, indices] = lengths(mesh);
        let vertices = vertices.max(self.vertices.capacity()) * size_of::<[f32; 3]>();
        let indices = indices.max(self.indices.capacity()) * size_of::<[u32; 3]>();
        (vertices + indices) as u64
    }

    /// Makes space for the copy of a mesh, which has been accounted for.
    ///
    /// # Errors
    /// As for [`Memory::reserve`].
    pub(crate) fn make_room(&mut self, mesh: &Mesh<'_>, memory: &Memory) -> Result<(), BuildError> {
        let [vertices, indices] = lengths(mesh);
        memory.reserve(&mut self.vertices, vertices)?;
        memory.reserve(&mut self.indices, indices)
    }

    /// Becomes the copy of a mesh with these snapped corners, for which there is space. After
    /// cancellation it is incomplete and must not be used.
    pub(crate) fn fill(
        &mut self,
        mesh: &Mesh<'_>,
        triangles: &[Triangle],
        meter: &ProgressMeter<'_>,
    ) {
        let IndexedMesh { vertices, indices } = self;
        vertices.clear();
        indices.clear();
        let Some((positions, given)) = shared(mesh) else {
            extend(meter, vertices, triangles.as_flattened());
            return;
        };
        extend(meter, indices, given);
        resize(meter, vertices, positions.len(), &[0.0; 3]);
        if meter.is_cancelled() {
            return;
        }
        let pieces = vertices.par_chunks_mut(PIECE).zip(positions.par_chunks(PIECE));
        pieces.for_each(|(vertices, positions)| {
            let _state = Standard::set();
            if meter.record_work(positions.len() as u64) {
                return;
            }
            for (vertex, position) in vertices.iter_mut().zip(positions) {
                *vertex = position.map(snap);
            }
        });
    }

    /// The corners of a triangle.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn corners(&self, triangle: u32) -> Triangle {
        let triangle = triangle as usize;
        if self.indices.is_empty() {
            core::array::from_fn(|corner| self.vertices[3 * triangle + corner])
        } else {
            self.indices[triangle].map(|vertex| self.vertices[vertex as usize])
        }
    }

    /// Puts at most [`MOST_LANES`] triangles together to a block.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn gather<'b>(
        &self,
        triangles: &[u32],
        room: &'b mut GatherBuffer,
    ) -> GatheredBlock<'b> {
        let words = &mut room.0;
        for (i, &triangle) in triangles.iter().enumerate().take(MOST_LANES) {
            let corners = self.corners(triangle);
            for (row, &x) in corners.as_flattened().iter().enumerate() {
                words[row * MOST_LANES + i] = x;
            }
            words[9 * MOST_LANES + i] = f32::from_bits(triangle);
        }
        GatheredBlock { words: &room.0, stride: MOST_LANES, count: triangles.len(), large: false }
    }
}
