//! A scene that is built: accelerators, placements, and the tree over them.

use alloc::boxed::Box;
use alloc::sync::Arc;
use alloc::vec::Vec;

use super::extents::Extents;
use super::nearness::Nearness;
use super::shapes::ShapeAccelerator;
use super::shared::{SharedGeometry, bytes_of};
use crate::aabb::Aabb;
use crate::backend::{Accelerator, BuildOptions};
use crate::error::BuildError;
use crate::mesh::Mesh;
use crate::query::intersect::{Limits, SceneScale};
use crate::scene::ShapeTree;
use crate::scene::shape::Shapes;
use crate::scene::{
    Defect, Edits, GeometryId, GeometryMesh, Instance, InstanceId, ObjectSpace, OpacityMask,
    Outline, Placement, SceneDigest, TopTree,
};
use crate::tree::digest::Digest;

/// Builds a geometry: what a backend does with one mesh. A build or an update asks for geometries in the order of their names; of those that share arrays
/// it asks for the first: see [`BuiltScene::unbuilt`].
pub type BuildGeometry<'a> =
    dyn FnMut(&Mesh<'_>, &BuildOptions<'_>) -> Result<Box<dyn Accelerator>, BuildError> + 'a;

/// A geometry that is built.
pub struct BuiltGeometry {
    pub(super) mesh: Arc<GeometryMesh>,
    pub(super) accelerator: Box<dyn Accelerator>,
    /// The tree over shapes; `None` for a mesh.
    shapes: Option<Arc<ShapeTree>>,
    pub(super) opacity: Option<Arc<OpacityMask>>,
    scale: SceneScale,
    digest: Digest,
    bounds: Aabb,
    /// Where its triangles are, for the boxes of its instances.
    outline: Option<Outline>,
    /// Which shared tree it has; 0: one of its own.
    share: usize,
    /// Whether another geometry of the update that built it counts that tree.
    counted: bool,
}

/// Bytes of trees that several of these geometries share, without the first time of each. None where there is no memory to compare them: then they
/// count as often as they are there.
pub(super) fn repeated_bytes<'a>(geometries: impl Iterator<Item = &'a BuiltGeometry>) -> u64 {
    if !KNOWN {
        return 0;
    }
    let mut shares: Vec<(usize, u64)> = Vec::new();
    for own in geometries.filter(|own| own.share != 0) {
        if shares.try_reserve(1).is_err() {
            return 0;
        }
        shares.push((own.share, bytes_of(&*own.accelerator)));
    }
    shares.sort_unstable();
    shares.windows(2).filter(|two| two[0].0 == two[1].0).map(|two| two[1].1).sum()
}

/// Whether trees that several scenes share bring what is known of their triangles. Else it is found again: in browsers nobody shares them.
const KNOWN: bool = !cfg!(target_arch = "wasm32");

impl BuiltGeometry {
    pub(super) fn new(
        mesh: Arc<GeometryMesh>,
        mut accelerator: Box<dyn Accelerator>,
    ) -> BuiltGeometry {
        let (mut known, mut share, mut counted) = (None, 0, false);
        if KNOWN && let Some(shared) = accelerator.downcast_mut::<SharedGeometry>() {
            (known, share) = (shared.extents_of(&mesh), shared.identity());
            counted = shared.is_counted();
        }
        let extents = known.unwrap_or_else(|| Extents::of(&mesh, accelerator.tree()));
        let Extents { scale, digest, bounds, outline } = extents;
        let (shapes, opacity) = (None, None);
        BuiltGeometry {
            mesh,
            accelerator,
            shapes,
            opacity,
            scale,
            digest,
            bounds,
            outline,
            share,
            counted,
        }
    }

    /// Builds a geometry of shapes. Their functions, where they are the user's, are called for this.
    pub(super) fn of_shapes(
        mesh: Arc<GeometryMesh>,
        max_memory: Option<u64>,
    ) -> Result<BuiltGeometry, BuildError> {
        let shapes = Arc::new(ShapeTree::build(&mesh, max_memory)?);
        let accelerator = Box::new(ShapeAccelerator::new(Arc::clone(&shapes))?);
        let scale = SceneScale::new(Aabb::EMPTY, &Limits::NONE);
        let (digest, bounds) = (shapes.digest(), shapes.bounds());
        let (shapes, opacity, outline) = (Some(shapes), None, None);
        let own = BuiltGeometry {
            mesh,
            accelerator,
            shapes,
            opacity,
            scale,
            digest,
            bounds,
            outline,
            share: 0,
            counted: false,
        };
        Ok(own)
    }

    /// What answers its rays, in its own space. That of a geometry of shapes has an empty kd-tree.
    pub fn accelerator(&self) -> &dyn Accelerator {
        &*self.accelerator
    }

    /// The tree over its shapes; `None` for a mesh.
    pub fn shapes(&self) -> Option<&ShapeTree> {
        self.shapes.as_deref()
    }

    /// Whether its shapes are the user's own.
    pub(super) fn has_own_shapes(&self) -> bool {
        self.shapes().is_some_and(|own| matches!(own.shapes(), Shapes::Own(_)))
    }

    /// Which parts of its triangles count for rays; `None`: all do.
    pub fn opacity(&self) -> Option<&OpacityMask> {
        self.opacity.as_deref()
    }

    /// What it was built over.
    pub fn mesh(&self) -> &Arc<GeometryMesh> {
        &self.mesh
    }

    /// The scale that the reference traversal of its mesh needs.
    pub(super) fn scale(&self) -> &SceneScale {
        &self.scale
    }

    /// The box of its triangles or shapes, in its own space.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Where its triangles are within that box; `None` for a geometry without triangles.
    pub fn outline(&self) -> Option<&Outline> {
        self.outline.as_ref()
    }

    /// Bytes of it that an update which builds it counts: none for a tree that it counts for another geometry.
    pub(super) fn uncounted_bytes(&self) -> u64 {
        if self.counted { 0 } else { self.bytes() }
    }

    /// Bytes of the tree and of what queries read.
    pub fn bytes(&self) -> u64 {
        let opacity = self.opacity.as_ref().map_or(0, |mask| size_of_val(mask.words()));
        bytes_of(&*self.accelerator) + opacity as u64
    }

    /// An instance of it, where it is.
    #[inline]
    pub(super) fn place(
        &self,
        instance: &Instance,
        (space, defect): (ObjectSpace, &Defect),
    ) -> Placement {
        match self.shapes {
            Some(_) => Placement::of_shapes(instance, space, &self.bounds),
            None => Placement::with_defect(instance, (space, defect), &self.bounds, self.outline()),
        }
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
    /// Whether a geometry has an opacity mask.
    pub(super) masked: bool,
    /// Bytes of trees that several geometries share, without the first time of each.
    pub(super) repeated: u64,
    /// Whether closest points are defined for all its shapes, once somebody asked.
    pub(super) nearness: Nearness,
}

impl BuiltScene {
    /// The tree over the instances.
    pub fn top_tree(&self) -> &TopTree {
        &self.top
    }

    /// Whether a geometry has an opacity mask, so that not all hits count.
    pub const fn has_opacity(&self) -> bool {
        self.masked
    }

    /// Whether a geometry is a set of shapes.
    pub fn has_shapes(&self) -> bool {
        self.geometries().any(|(_, own)| own.shapes().is_some())
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

    /// What of the scene a packed form does not have, so that only the host answers its rays; `None` for nothing.
    pub fn host_only(&self) -> Option<&'static str> {
        host_only(self.geometries().any(|(_, own)| own.has_own_shapes()))
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
            hash.geometry(name, geometry.digest, geometry.opacity());
        }
        for (name, placement) in self.placements() {
            hash.instance(name, &placement.instance, &placement.space.inverse);
        }
        hash.finish()
    }

    /// Bytes that are held: geometries, placements, and the tree over them. A tree that several geometries share counts once.
    pub fn bytes(&self) -> u64 {
        let geometries: u64 = self.geometries().map(|(_, geometry)| geometry.bytes()).sum();
        geometries.saturating_sub(self.repeated) + self.bytes_beside_geometries()
    }

    /// Bytes of placements and of the tree over them.
    pub fn bytes_beside_geometries(&self) -> u64 {
        let placements = self.placements.capacity() * size_of::<Option<Placement>>();
        self.top.bytes() + placements as u64
    }
}

/// Why only the host answers the rays of a scene like this.
pub(super) fn host_only(has_own_shapes: bool) -> Option<&'static str> {
    has_own_shapes.then_some("a geometry is made of shapes of the user's own")
}
