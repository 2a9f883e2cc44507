//! Where points lie in a scene.

use alloc::vec::Vec;

use super::built::BuiltScene;
use super::within::Within;
use crate::aabb::Aabb;
use crate::cancel::go_on_tracing;
use crate::error::QueryError;
use crate::query::inside::{LocateOptions, Located, check_points, no_windings};
use crate::ray::Ray;
use crate::report::QueryReport;
use crate::scene::{InstanceId, TopRay, TopStack, WIDEST_STACK};
use crate::watch::Watch;

impl BuiltScene {
    /// How often the surfaces of all instances wind around each point: the sum over the instances, each exact for the point
    /// as the object sees it. An instance counts where that point is within the box of its geometry, and the point within that of the
    /// instance ([`Placement::world_box`](crate::scene::Placement)); a reflection counts as its
    /// mesh would in the world, with the opposite sign; a sum beyond `i32` stays at its end. A point on a surface of any instance has none.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`], [`QueryError::Cancelled`], or a device that fails.
    pub fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        let LocateOptions { max_memory, watch } = *options;
        let total = points.len() as u64;
        let held = check_points(points.len(), max_memory)?;
        let windings = no_windings(points.len())?;
        let mut located = Located { windings, report: QueryReport::default() };
        let room = max_memory.map(|limit| limit - held);
        for (done, (&point, winding)) in points.iter().zip(&mut located.windings).enumerate() {
            let done = done as u64;
            go_on_tracing(watch, done, total)?;
            let within = watch.map(|watch| Within { watch, done, total });
            let watch: Option<&dyn Watch> = match &within {
                Some(watch) => Some(watch),
                None => None,
            };
            let own = LocateOptions { max_memory: room, watch };
            let wound = self.winding(point, &own, &mut located.report);
            *winding = wound.map_err(|error| match error {
                QueryError::Cancelled { .. } => QueryError::Cancelled { done, total },
                error => error.beside(held, max_memory),
            })?;
        }
        go_on_tracing(watch, total, total)?;
        Ok(located)
    }

    /// The sum of windings around one point; `None` on a surface.
    fn winding(
        &self,
        point: [f32; 3],
        options: &LocateOptions<'_>,
        report: &mut QueryReport,
    ) -> Result<Option<i32>, QueryError> {
        let mut stack = [TopStack::default(); WIDEST_STACK];
        // A ray that ends where it begins enters what holds the point.
        let ray = Ray::new(point, [1.0, 0.0, 0.0]).with_limits(0.0, 0.0);
        let Some(top_ray) = TopRay::new(&ray) else { return Ok(Some(0)) };
        let (mut top, mut sum) = (self.top.begin(&mut stack), 0);
        while let Some(name) = self.top.next(&top_ray, 0.0, &mut stack, &mut top) {
            let Some(placement) = self.placement(InstanceId(name)) else { continue };
            let Some(built) = self.geometry(placement.instance.geometry) else { continue };
            let seen = placement.space.point(point);
            // Of both boxes, since which instances are found at all must not matter.
            let is_within = |bounds: &Aabb, point: [f32; 3]| {
                (0..3).all(|axis| bounds.lo[axis] <= point[axis] && point[axis] <= bounds.hi[axis])
            };
            let in_world = placement.world_box.is_some_and(|own| is_within(&own.bounds, point));
            if !in_world || !is_within(&placement.bounds, seen) {
                continue;
            }
            let own = built.accelerator().locate(&[seen], options)?;
            report.append(own.report, 0)?;
            let own: Vec<Option<i32>> = own.windings;
            let Some(Some(winding)) = own.first().copied() else { return Ok(None) };
            let winding = if placement.space.mirrored { -winding } else { winding };
            sum = i32::saturating_add(sum, winding);
        }
        Ok(Some(sum))
    }
}
