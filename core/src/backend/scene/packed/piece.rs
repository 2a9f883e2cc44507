//! What one geometry has of the arrays that geometries share: what is sent to a device when it changes.

use super::PackedScene;
use super::places::PackedPlaces;
use super::sizes::SHARED;
use crate::tree::node::KdNode;
use crate::triangle::Triangle;

/// A geometry as it is at its place in the shared arrays: see [`BuiltScene::packed_piece`](super::super::BuiltScene::packed_piece).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PackedPiece {
    pub(super) firsts: [usize; SHARED],
    /// Only what is shared.
    pub(super) arrays: PackedScene,
}

impl PackedPiece {
    /// Of each shared array (nodes, references, triangles, blocks of shapes) the byte at which the piece begins, and its bytes.
    pub fn parts(&self) -> [(u64, &[u8]); SHARED] {
        let [node, reference, triangle, block] = self.firsts.map(|first| first as u64);
        let PackedScene { nodes, references, triangles, shapes, .. } = &self.arrays;
        [
            (node * size_of::<KdNode>() as u64, bytemuck::cast_slice(nodes)),
            (reference * 4, bytemuck::cast_slice(references)),
            (triangle * size_of::<Triangle>() as u64, bytemuck::cast_slice(triangles)),
            (block * size_of::<super::ShapeBlock>() as u64, bytemuck::cast_slice(shapes)),
        ]
    }
}

impl PackedScene {
    /// Makes the shared arrays as long as places demand. What is new holds zeros; no ray reads it before a piece is put there.
    pub fn fit(&mut self, places: &PackedPlaces) {
        let [nodes, references, triangles, shapes] = places.ends().shared();
        self.nodes.resize(nodes, bytemuck::Zeroable::zeroed());
        self.references.resize(references, 0);
        self.triangles.resize(triangles, Triangle::default());
        self.shapes.resize(shapes, [0; 64]);
    }

    /// Puts a geometry to its place, over what is there.
    ///
    /// # Panics
    /// When the arrays are too short: see [`PackedScene::fit`].
    pub fn put(&mut self, piece: &PackedPiece) {
        let [node, reference, triangle, block] = piece.firsts;
        let PackedScene { nodes, references, triangles, shapes, .. } = &piece.arrays;
        self.nodes[node..][..nodes.len()].copy_from_slice(nodes);
        self.references[reference..][..references.len()].copy_from_slice(references);
        self.triangles[triangle..][..triangles.len()].copy_from_slice(triangles);
        self.shapes[block..][..shapes.len()].copy_from_slice(shapes);
    }
}
