//! What a scene knows of a mesh's triangles, from one look at all of them.

use crate::aabb::Aabb;
use crate::query::intersect::{Limits, SceneScale};
use crate::scene::{GeometryMesh, Outline, OutlineCells};
use crate::tree::KdTree;
use crate::tree::digest::Digest;
use crate::triangle::{Prepared, prepare};

/// Scale, name and places of a mesh and the tree over it.
#[derive(Clone, Copy)]
pub(super) struct Extents {
    pub(super) scale: SceneScale,
    pub(super) digest: Digest,
    pub(super) bounds: Aabb,
    pub(super) outline: Option<Outline>,
}

impl Extents {
    #[inline]
    pub(super) fn of(mesh: &GeometryMesh, tree: &KdTree) -> Extents {
        let (mut limits, mut cells) = (Limits::NONE, OutlineCells::of(&tree.view()));
        let arrays = mesh.mesh();
        for triangle in 0..arrays.len() {
            let Prepared { corners, kept, .. } = prepare(&arrays.triangle(triangle));
            if kept {
                limits = limits.union(Limits::of(&corners));
                cells.add(&Aabb::of_points(&corners));
            }
        }
        let (scale, digest) = (SceneScale::new(tree.bounds, &limits), tree.digest());
        Extents { scale, digest, bounds: tree.bounds, outline: cells.outline() }
    }
}
