//! A geometry's tree that several scenes have, or several states of one.

use alloc::boxed::Box;
use alloc::sync::Arc;
use core::any::Any;

use super::extents::Extents;
use crate::backend::Accelerator;
use crate::error::QueryError;
use crate::query::all_hits::{AllHits, AllHitsOptions};
use crate::query::cast::{Cast, CastOptions, Impact};
use crate::query::closest_point::{ClosestPoint, ClosestPointOptions};
use crate::query::inside::{LocateOptions, Located};
use crate::query::overlap::{OverlapOptions, Overlaps, Volume};
use crate::ray::{Hit, QueryOptions, Ray, Rays};
use crate::report::{BuildSummary, QueryReport};
use crate::scene::GeometryMesh;
use crate::tree::KdTree;

/// A geometry's tree, which several scenes share. A clone is the same tree.
///
/// It knows already what a scene wants to know of all triangles. So a scene that gets it from its [`BuildGeometry`](super::BuildGeometry) for
/// the same arrays looks at none of them.
#[derive(Clone)]
pub struct SharedGeometry {
    whole: Arc<Whole>,
    /// Another geometry of the same update has it too, and counts it.
    counted: bool,
}

struct Whole {
    tree: Box<dyn Accelerator>,
    mesh: Arc<GeometryMesh>,
    extents: Extents,
}

impl SharedGeometry {
    /// Looks once at all triangles of the mesh that the tree was built over.
    pub fn new(mesh: Arc<GeometryMesh>, tree: Box<dyn Accelerator>) -> SharedGeometry {
        let extents = Extents::of(&mesh, tree.tree());
        SharedGeometry { whole: Arc::new(Whole { tree, mesh, extents }), counted: false }
    }

    /// The tree, where nobody else has it; else `None`, and who has it keeps it.
    pub fn into_tree(self) -> Option<Box<dyn Accelerator>> {
        Arc::into_inner(self.whole).map(|own| own.tree)
    }

    /// The arrays that it was built over.
    pub fn mesh(&self) -> &Arc<GeometryMesh> {
        &self.whole.mesh
    }

    /// What is known of the triangles of these arrays; `None` where it was built over others.
    pub(super) fn extents_of(&self, mesh: &Arc<GeometryMesh>) -> Option<Extents> {
        Arc::ptr_eq(mesh, &self.whole.mesh).then_some(self.whole.extents)
    }

    /// The same tree for another geometry of an update, for which its bytes count already.
    pub(super) fn again(&self) -> SharedGeometry {
        SharedGeometry { whole: Arc::clone(&self.whole), counted: true }
    }

    /// Whether another geometry of the same update counts its bytes.
    pub(super) fn is_counted(&self) -> bool {
        self.counted
    }

    /// What tells it from other trees as long as it is there; never 0.
    pub(super) fn identity(&self) -> usize {
        Arc::as_ptr(&self.whole).addr()
    }

    /// Bytes of the tree and of what queries read.
    pub fn bytes(&self) -> u64 {
        bytes_of(&*self.whole.tree)
    }
}

/// Bytes of a tree and of what queries read: what a geometry counts towards the limit of an update. For backends that build geometries before.
#[doc(hidden)]
pub fn bytes_of(accelerator: &dyn Accelerator) -> u64 {
    let tree = accelerator.tree();
    let tree = size_of_val(&tree.nodes[..]) + size_of_val(&tree.references[..]);
    accelerator.query_bytes() + tree as u64
}

impl Accelerator for SharedGeometry {
    fn tree(&self) -> &KdTree {
        self.whole.tree.tree()
    }

    fn summary(&self) -> &BuildSummary {
        self.whole.tree.summary()
    }

    fn query_bytes(&self) -> u64 {
        self.whole.tree.query_bytes()
    }

    fn held_bytes(&self) -> u64 {
        self.whole.tree.held_bytes()
    }

    /// The shared tree's: a backend finds its own in it.
    fn as_any(&self) -> Option<&dyn Any> {
        self.whole.tree.as_any()
    }

    /// Itself: nobody changes a tree that others have too.
    fn as_any_mut(&mut self) -> Option<&mut dyn Any> {
        Some(self)
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        self.whole.tree.closest_hit(ray, options)
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        self.whole.tree.any_hit(ray, options)
    }

    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.whole.tree.closest_hits(rays, hits, options)
    }

    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.whole.tree.any_hits(rays, occluded, options)
    }

    fn closest_hits_of(
        &self,
        rays: Rays<'_>,
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.whole.tree.closest_hits_of(rays, hits, options)
    }

    fn any_hits_of(
        &self,
        rays: Rays<'_>,
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.whole.tree.any_hits_of(rays, occluded, options)
    }

    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError> {
        self.whole.tree.all_hits(rays, options)
    }

    fn count_hits(
        &self,
        rays: &[Ray],
        counts: &mut [u32],
        options: &AllHitsOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.whole.tree.count_hits(rays, counts, options)
    }

    fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        self.whole.tree.locate(points, options)
    }

    fn impacts(
        &self,
        casts: &[Cast],
        impacts: &mut [Impact],
        options: &CastOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.whole.tree.impacts(casts, impacts, options)
    }

    fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [ClosestPoint],
        options: &ClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.whole.tree.closest_points(points, closest, options)
    }

    fn overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &OverlapOptions<'_>,
    ) -> Result<Overlaps, QueryError> {
        self.whole.tree.overlaps(volumes, options)
    }

    fn overlaps_any(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &OverlapOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.whole.tree.overlaps_any(volumes, found, options)
    }
}
