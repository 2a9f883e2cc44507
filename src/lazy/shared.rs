//! A tree of several states of a scene.

use splitplane_core::backend::Accelerator;
use splitplane_core::error::QueryError;
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions};
use splitplane_core::query::cast::{Cast, CastOptions, Impact};
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions};
use splitplane_core::query::inside::{LocateOptions, Located};
use splitplane_core::query::overlap::{OverlapOptions, Overlaps, Volume};
use splitplane_core::ray::{Hit, QueryOptions, Ray, Rays};
use splitplane_core::report::{BuildSummary, QueryReport};
use splitplane_core::tree::KdTree;
use std::any::Any;
use std::sync::Arc;

/// A geometry's accelerator, which several states have.
pub(super) struct Shared(pub(super) Arc<dyn Accelerator>);

impl Accelerator for Shared {
    fn tree(&self) -> &KdTree {
        self.0.tree()
    }

    fn summary(&self) -> &BuildSummary {
        self.0.summary()
    }

    fn query_bytes(&self) -> u64 {
        self.0.query_bytes()
    }

    fn as_any(&self) -> Option<&dyn Any> {
        self.0.as_any()
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        self.0.closest_hit(ray, options)
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        self.0.any_hit(ray, options)
    }

    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.0.closest_hits(rays, hits, options)
    }

    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.0.any_hits(rays, occluded, options)
    }

    fn closest_hits_of(
        &self,
        rays: Rays<'_>,
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.0.closest_hits_of(rays, hits, options)
    }

    fn any_hits_of(
        &self,
        rays: Rays<'_>,
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.0.any_hits_of(rays, occluded, options)
    }

    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError> {
        self.0.all_hits(rays, options)
    }

    fn count_hits(
        &self,
        rays: &[Ray],
        counts: &mut [u32],
        options: &AllHitsOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.0.count_hits(rays, counts, options)
    }

    fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        self.0.locate(points, options)
    }

    fn impacts(
        &self,
        casts: &[Cast],
        impacts: &mut [Impact],
        options: &CastOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.0.impacts(casts, impacts, options)
    }

    fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [ClosestPoint],
        options: &ClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.0.closest_points(points, closest, options)
    }

    fn overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &OverlapOptions<'_>,
    ) -> Result<Overlaps, QueryError> {
        self.0.overlaps(volumes, options)
    }

    fn overlaps_any(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &OverlapOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.0.overlaps_any(volumes, found, options)
    }
}
