//! Which hits count: a query's filter, and a geometry's opacity mask.

use super::built::BuiltGeometry;
use crate::query::traverse::{Query, trace_kept};
use crate::ray::{Hit, QueryOptions, Ray};
use crate::scene::{Filter, GeometryId, InstanceId, OpacityMask, SceneHit, SceneOptions};

/// Which hits with an instance count: those in a part of a triangle that is opaque, and that the filter keeps.
#[derive(Clone, Copy)]
pub struct Kept<'a> {
    pub(super) filter: Option<&'a dyn Filter>,
    pub(super) opacity: Option<&'a OpacityMask>,
    pub(super) geometry: GeometryId,
    pub(super) instance: InstanceId,
}

impl Kept<'_> {
    /// Whether a hit counts.
    #[inline]
    pub fn keeps(&self, hit: &Hit) -> bool {
        let Hit { triangle, u, v, .. } = *hit;
        self.opacity.is_none_or(|mask| mask.is_opaque(triangle, u, v))
            && self
                .filter
                .is_none_or(|filter| filter.keeps(&SceneHit::of(hit, self.geometry, self.instance)))
    }

    /// The hit of a ray (as the object sees it) that is the answer, given the first one. If that does not count, the reference traversal
    /// looks through the host's copy of the tree for those that do: a rejected hit costs one test. Counts the hits that are rejected.
    pub fn next(
        &self,
        built: &BuiltGeometry,
        ray: &Ray,
        first: Hit,
        (options, query): (&QueryOptions<'_>, Query),
        rejected: &mut u64,
    ) -> Hit {
        let mut keep = |hit: &Hit| {
            let keeps = self.keeps(hit);
            *rejected += u64::from(!keeps);
            keeps
        };
        if !first.is_hit() || keep(&first) {
            return first;
        }
        if let Some(shapes) = built.shapes() {
            return shapes.trace(ray, options, query, keep);
        }
        let (tree, mesh) = (built.accelerator.tree().view(), built.mesh.mesh());
        trace_kept(&tree, &mesh, built.scale(), ray, options, query, keep)
    }
}

impl BuiltGeometry {
    /// Which hits with an instance count; `None` where all do.
    pub fn kept<'a>(
        &'a self,
        geometry: GeometryId,
        instance: InstanceId,
        options: &SceneOptions<'a>,
    ) -> Option<Kept<'a>> {
        let (filter, opacity) = (options.filter, self.opacity.as_deref());
        let all = filter.is_none() && opacity.is_none();
        (!all).then_some(Kept { filter, opacity, geometry, instance })
    }
}
