//! Hits that a filter keeps: what comes after a rejected one.

use alloc::vec::Vec;

use super::built::{BuiltGeometry, Without};
use crate::cancel::go_on_tracing;
use crate::error::{QueryError, refused};
use crate::query::traverse::closest_hit;
use crate::ray::{QueryOptions, Ray};
use crate::scene::{Filter, GeometryId, InstanceId, SceneHit};

/// The triangles that a filter rejected for one ray in one instance, in ascending order.
#[derive(Debug, Default)]
pub(super) struct Rejected {
    triangles: Vec<u32>,
}

impl Rejected {
    /// The first hit of a ray (as the object sees it) that the filter keeps, given the first one, which it rejects: by the
    /// reference traversal over a mesh without the rejected triangles, each of which a ray meets once. Each rejected hit takes a
    /// traversal; the options' watch is called before it.
    pub(super) fn next_kept(
        &mut self,
        built: &BuiltGeometry,
        ray: &Ray,
        first: &SceneHit,
        options: &QueryOptions<'_>,
        filter: &dyn Filter,
    ) -> Result<SceneHit, QueryError> {
        let Rejected { triangles } = self;
        let (geometry, instance) = (GeometryId(first.geometry), InstanceId(first.instance));
        triangles.clear();
        let (tree, mut found) = (built.accelerator.tree().view(), *first);
        let mesh = built.mesh.mesh();
        while found.is_hit() && !filter.keeps(&found) {
            let bytes = ((triangles.len() + 1) * size_of::<u32>()) as u64;
            triangles.try_reserve(1).map_err(|_| refused(bytes))?;
            let place = triangles.partition_point(|&rejected| rejected < found.triangle);
            triangles.insert(place, found.triangle);
            go_on_tracing(options.watch, 0, 1)?;
            let without = Without { mesh: &mesh, rejected: triangles };
            // Equal distances may round to either side of it, and what is closer to 0 than 2^-126 is 0.
            let from = if found.t == 0.0 { -f32::MIN_POSITIVE } else { found.t.next_down() };
            let rest = ray.with_limits(from.max(ray.t_min), ray.t_max);
            let next = closest_hit(&tree, &without, &built.scale, &rest, options);
            found = next.map_or(SceneHit::MISS, |hit| SceneHit::of(&hit, geometry, instance));
        }
        Ok(found)
    }
}
