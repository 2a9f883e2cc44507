//! A scene that is built: accelerators, placements, and the tree over them.

use alloc::boxed::Box;
use alloc::sync::Arc;
use alloc::vec::Vec;

use crate::aabb::Aabb;
use crate::backend::{Accelerator, BuildOptions};
use crate::error::BuildError;
use crate::mesh::Mesh;
use crate::query::intersect::{Limits, SceneScale};
use crate::query::traverse::Triangles;
use crate::scene::{
    Edits, GeometryId, GeometryMesh, InstanceId, Outline, Placement, SceneDigest, TopTree,
};
use crate::tree::digest::Digest;
use crate::triangle::{Prepared, prepare};

/// Builds a geometry: what a backend does with one mesh. A build or an update asks for geometries in the order of their names.
pub type BuildGeometry<'a> =
    dyn FnMut(&Mesh<'_>, &BuildOptions<'_>) -> Result<Box<dyn Accelerator>, BuildError> + 'a;

/// A geometry that is built.
pub struct BuiltGeometry {
    pub(super) mesh: Arc<GeometryMesh>,
    pub(super) accelerator: Box<dyn Accelerator>,
    pub(super) scale: SceneScale,
    pub(super) digest: Digest,
    /// Where its triangles are, for the boxes of its instances.
    pub(super) outline: Option<Outline>,
}

impl BuiltGeometry {
    pub(super) fn new(mesh: Arc<GeometryMesh>, accelerator: Box<dyn Accelerator>) -> BuiltGeometry {
        let mut limits = Limits::NONE;
        let arrays = mesh.mesh();
        for triangle in 0..arrays.len() {
            let Prepared { corners, kept, .. } = prepare(&arrays.triangle(triangle));
            if kept {
                limits = limits.union(Limits::of(&corners));
            }
        }
        let tree = accelerator.tree();
        let (scale, digest) = (SceneScale::new(tree.bounds, &limits), tree.digest());
        let outline = Outline::of(&tree.view());
        BuiltGeometry { mesh, accelerator, scale, digest, outline }
    }

    /// What answers its rays, in its own space.
    pub fn accelerator(&self) -> &dyn Accelerator {
        &*self.accelerator
    }

    /// The arrays it was built over.
    pub fn mesh(&self) -> &Arc<GeometryMesh> {
        &self.mesh
    }

    /// The box of its triangles, in its own space.
    pub fn bounds(&self) -> Aabb {
        self.accelerator.tree().bounds
    }

    /// Where its triangles are within that box; `None` for a geometry without triangles.
    pub fn outline(&self) -> Option<&Outline> {
        self.outline.as_ref()
    }

    /// Bytes of the tree and of what queries read.
    pub fn bytes(&self) -> u64 {
        let tree = self.accelerator.tree();
        let tree = size_of_val(&tree.nodes[..]) + size_of_val(&tree.references[..]);
        self.accelerator.query_bytes() + tree as u64
    }
}

/// Triangles of a mesh, some of which count as not there.
pub(super) struct Without<'a> {
    pub(super) mesh: &'a Mesh<'a>,
    /// In ascending order.
    pub(super) rejected: &'a [u32],
}

impl Triangles for Without<'_> {
    /// A triangle that is not there has no area, and is met nowhere.
    fn corners(&self, triangle: u32) -> crate::triangle::Triangle {
        if self.rejected.binary_search(&triangle).is_ok() {
            return [[0.0; 3]; 3];
        }
        self.mesh.corners(triangle)
    }
}

/// A scene that is built, as far as it is the same on all backends. Placements and geometries are found by their names.
#[derive(Default)]
pub struct BuiltScene {
    pub(super) geometries: Vec<Option<BuiltGeometry>>,
    pub(super) placements: Vec<Option<Placement>>,
    pub(super) top: TopTree,
    /// The description as it was.
    pub(super) edits: Option<Edits>,
}

impl BuiltScene {
    /// The tree over the instances.
    pub fn top_tree(&self) -> &TopTree {
        &self.top
    }

    /// A geometry; `None` where there is none of this name.
    pub fn geometry(&self, geometry: GeometryId) -> Option<&BuiltGeometry> {
        self.geometries.get(geometry.0 as usize)?.as_ref()
    }

    /// An instance where it is; `None` where there is none of this name.
    pub fn placement(&self, instance: InstanceId) -> Option<&Placement> {
        self.placements.get(instance.0 as usize)?.as_ref()
    }

    /// By the name of an instance, where it is; `None` where there is none of this name.
    #[inline]
    pub fn all_placements(&self) -> &[Option<Placement>] {
        &self.placements
    }

    /// All instances, in the order of their names.
    pub fn placements(&self) -> impl Iterator<Item = (InstanceId, &Placement)> {
        let named = self.placements.iter().enumerate();
        named.filter_map(|(name, at)| Some((InstanceId(name as u32), at.as_ref()?)))
    }

    /// All geometries, in the order of their names.
    pub fn geometries(&self) -> impl Iterator<Item = (GeometryId, &BuiltGeometry)> {
        let named = self.geometries.iter().enumerate();
        named.filter_map(|(name, at)| Some((GeometryId(name as u32), at.as_ref()?)))
    }

    /// Names the scene: its geometries' trees, and all instances with their transforms and inverses, masks, numbers and
    /// culling. The tree over the instances is not part of it, since no hit depends on that.
    pub fn digest(&self) -> Digest {
        let mut hash = SceneDigest::new();
        for (name, geometry) in self.geometries() {
            hash.geometry(name, geometry.digest);
        }
        for (name, placement) in self.placements() {
            hash.instance(name, &placement.instance, &placement.space.inverse);
        }
        hash.finish()
    }

    /// Bytes that are held: geometries, placements, and the tree over them.
    pub fn bytes(&self) -> u64 {
        let geometries: u64 = self.geometries().map(|(_, geometry)| geometry.bytes()).sum();
        geometries + self.bytes_beside_geometries()
    }

    /// Bytes of placements and of the tree over them.
    pub fn bytes_beside_geometries(&self) -> u64 {
        let placements = self.placements.capacity() * size_of::<Option<Placement>>();
        self.top.bytes() + placements as u64
    }
}
