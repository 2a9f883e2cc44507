//! Where points lie, found by the hits of an accelerator: what backends without a search of their own do.

use core::ops::ControlFlow;

use crate::cancel::go_on_tracing;
use crate::error::QueryError;
use crate::query::all_hits::AllHitsOptions;
use crate::query::inside::{LocateOptions, Located, boundary_rays, check_points, no_windings};
use crate::ray::{Accuracy, QueryOptions, Ray};
use crate::report::QueryReport;
use crate::watch::{Progress, Watch};

use super::Accelerator;

/// Locates points using only an accelerator's hits: rays in this direction (finite, not zero),
/// which makes no difference where the surface is closed. A point with a coordinate that is not
/// finite is outside. Processes one point at a time, so it holds the crossings of one ray at a
/// time. `watch` receives the number of points that are done.
///
/// # Errors
/// As for [`Accelerator::all_hits`].
pub fn locate_along(
    accelerator: &(impl Accelerator + ?Sized),
    points: &[[f32; 3]],
    direction: [f32; 3],
    options: &LocateOptions<'_>,
) -> Result<Located, QueryError> {
    let LocateOptions { max_memory, watch } = *options;
    let total = points.len() as u64;
    let held = check_points(points.len(), max_memory)?;
    let mut located =
        Located { windings: no_windings(points.len())?, report: QueryReport::default() };
    let room = max_memory.map(|limit| limit - held);
    for (done, (&point, winding)) in points.iter().zip(&mut located.windings).enumerate() {
        let done = done as u64;
        let point_watch = watch.map(|watch| OfPoint { watch, done, total });
        let watch: Option<&dyn Watch> = match &point_watch {
            Some(watch) => Some(watch),
            None => None,
        };
        let place = |error| match error {
            QueryError::Cancelled { .. } => QueryError::Cancelled { done, total },
            error => error,
        };
        let exactly = QueryOptions { accuracy: Accuracy::Exact, watch, ..QueryOptions::default() };
        let all = AllHitsOptions { max_memory: room, watch, ..AllHitsOptions::default() };
        let rays = boundary_rays(point);
        let mut on = [false; 3];
        let answered = accelerator.any_hits(&rays, &mut on, &exactly).map_err(place)?;
        let mut by_cpu = answered.answered_by_cpu > 0;
        if on.contains(&true) {
            *winding = None;
            located.report.answered_by_cpu += u64::from(by_cpu);
            continue;
        }
        let met = accelerator
            .all_hits(&[Ray::new(point, direction)], &all)
            .map_err(|error| place(error).beside(held, max_memory))?;
        by_cpu |= met.report.answered_by_cpu > 0;
        located.report.answered_by_cpu += u64::from(by_cpu);
        // A ray from within leaves through backs.
        let sign = |front: bool| if front { -1 } else { 1 };
        *winding = Some(met.crossings.iter().map(|met| sign(met.front)).sum());
    }
    go_on_tracing(watch, total, total)?;
    Ok(located)
}

/// Turns progress in rays of one point into progress in points.
struct OfPoint<'a> {
    watch: &'a dyn Watch,
    done: u64,
    total: u64,
}

impl Watch for OfPoint<'_> {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        self.watch.progress(&Progress { done: self.done, total: self.total, ..*progress })
    }
}
