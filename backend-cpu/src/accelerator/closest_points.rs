//! Closest points of a batch.

use rayon::prelude::*;
use splitplane_core::error::{QueryError, refused};
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions, check_lengths};
use splitplane_core::report::QueryReport;
use splitplane_core::watch::Stage;

use super::CpuAccelerator;
use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};
use crate::near::closest_point::ClosestPoints;

/// Points of one task.
const TASK: usize = 1024;
/// Points between two checks of the watch: most take some microseconds.
const FEW: usize = 32;

impl CpuAccelerator {
    /// The closest point of the mesh to each point.
    pub(super) fn find_closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [ClosestPoint],
        options: &ClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let meter = &ProgressMeter::of(options.watch);
        check_lengths(points.len(), closest.len())?;
        meter.begin_stage(Stage::Rays, points.len() as u64);
        let few = if meter.is_watched() { FEW } else { TASK };
        let layout = &self.layout;
        points.par_chunks(TASK).zip(closest.par_chunks_mut(TASK)).try_for_each(
            |(points, closest)| {
                for (points, closest) in points.chunks(few).zip(closest.chunks_mut(few)) {
                    if meter.is_cancelled() {
                        break;
                    }
                    let task = ClosestPoints { layout, points, closest, options };
                    // SAFETY: `set` was detected on this processor, and the layout made for it.
                    let done = unsafe { self.set.run(task) };
                    done.map_err(|_| refused((layout.wide.stack() * size_of::<u64>()) as u64))?;
                    meter.advance(points.len() as u64);
                    meter.record_work(WORK_BETWEEN_CHECKS);
                }
                Ok::<(), QueryError>(())
            },
        )?;
        meter.finish_stage();
        meter.check_batch().map(|()| QueryReport::default())
    }
}
