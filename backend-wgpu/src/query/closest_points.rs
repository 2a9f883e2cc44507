//! Closest points, which the host finds.

use rayon::prelude::*;
use splitplane_core::error::QueryError;
use splitplane_core::query::closest_point::{
    ClosestPoint, ClosestPointOptions, check_lengths, closest_point,
};
use splitplane_core::report::QueryReport;

use super::accelerator::WgpuAccelerator;
use super::settle::Asking;

/// Points between two calls of the watch.
const FEW: usize = 64;

impl WgpuAccelerator {
    /// The closest point of the mesh to each point, by the core's search through the host copy.
    pub(super) fn find_closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [ClosestPoint],
        options: &ClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        check_lengths(points.len(), closest.len())?;
        let asking = &Asking::new(options.watch, points.len());
        asking.check()?;
        let tree = &self.tree.view();
        points.par_chunks(FEW).zip(closest.par_chunks_mut(FEW)).try_for_each(
            |(points, closest)| {
                asking.check()?;
                for (&point, closest) in points.iter().zip(closest) {
                    *closest = closest_point(tree, &self.triangles[..], point, options)?;
                }
                asking.advance(points.len());
                Ok::<(), QueryError>(())
            },
        )?;
        asking.check()?;
        let mut report = QueryReport::default();
        report.answered_by_cpu = points.len() as u64;
        Ok(report)
    }
}
