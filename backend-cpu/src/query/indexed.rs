//! The mesh of the compact layout: a copy of the caller's arrays with snapped coordinates, and the
//! gathering of triangles from it for the wide test.

use rayon::prelude::*;
use splitplane_core::arithmetic::snap;
use splitplane_core::mesh::Mesh;
use splitplane_core::triangle::Triangle;

use super::record::Record;
use crate::lookout::{self, Lookout};

/// Vertices that are snapped between two looks at the watch.
const PIECE: usize = 1 << 13;
/// Most triangles that are gathered at once: their corners, none of which are taken as shared, fill two
/// vectors of 16.
const MOST: usize = 10;
/// Words of [`Room`]: a block of [`MOST`] triangles, and what vector loads read behind it; a power of two.
const WORDS: usize = 128;

/// Where gathered triangles are put together to a block.
#[repr(align(64))]
pub(crate) struct Room([u32; WORDS]);

impl Room {
    /// An empty one.
    pub const EMPTY: Room = Room([0; WORDS]);
}

/// The places of the corners of a gathered block: first corners, second, third, none twice.
const PLACES: [u32; (3 * MOST).div_ceil(4)] = {
    let mut places = [0; (3 * MOST).div_ceil(4)];
    let mut i = 0;
    while i < places.len() {
        let first = 4 * i as u8;
        places[i] = u32::from_le_bytes([first, first + 1, first + 2, first + 3]);
        i += 1;
    }
    places
};

/// A mesh with snapped coordinates. Vertices are those of the caller; a mesh with as many vertices as
/// twice its triangles, or without indices, takes less as three corners a triangle.
#[derive(Debug, Default)]
pub(crate) struct IndexedMesh {
    vertices: Vec<[f32; 3]>,
    /// Corners by vertex; empty where vertices are corners.
    indices: Vec<[u32; 3]>,
}

/// The caller's arrays, where they are what is copied.
fn shared<'a>(mesh: &Mesh<'a>) -> Option<(&'a [[f32; 3]], &'a [[u32; 3]])> {
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
            lookout::extend(look, vertices, triangles.as_flattened());
            return;
        };
        vertices.shrink_to(positions.len());
        indices.shrink_to(given.len());
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

    /// Most triangles of a block for vectors of so many lanes.
    pub const fn most(lanes: usize) -> usize {
        if 2 * lanes / 3 < MOST { 2 * lanes / 3 } else { MOST }
    }

    /// Puts at most [`MOST`] triangles together to a block.
    #[inline(always)]
    pub fn gather<'b>(&self, triangles: &[u32], room: &'b mut Room) -> Record<'b> {
        let words = &mut room.0;
        let count = triangles.len();
        let before = 1 + (3 * count).div_ceil(4) + count;
        words[0] = count as u32 | (3 * count as u32) << 8 | (before as u32) << 16;
        // More of them than there are corners: what comes next is written over them.
        words[1..=PLACES.len()].copy_from_slice(&PLACES);
        for (i, &triangle) in triangles.iter().enumerate() {
            words[(before - count + i) % WORDS] = triangle;
        }
        for (i, &triangle) in triangles.iter().enumerate() {
            let corners = self.corners(triangle);
            for (k, corner) in corners.iter().enumerate() {
                for (axis, x) in corner.iter().enumerate() {
                    words[(before + (3 * axis + k) * count + i) % WORDS] = x.to_bits();
                }
            }
        }
        Record::at(&words[..], 0)
    }
}
