//! Closest points of a batch.

use splitplane_core::error::{QueryError, refused};
use splitplane_core::query::closest_point::{
    ClosestPoint, ClosestPointOptions, check_accuracy, check_lengths,
};
use splitplane_core::report::QueryReport;
use splitplane_core::watch::Stage;

use super::CpuAccelerator;
use crate::cancel::ProgressMeter;
use crate::near::closest_point::ClosestPoints;
use crate::near::in_order::{Division, answer_in_order};

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
        check_accuracy(options.accuracy)?;
        meter.begin_stage(Stage::Rays, points.len() as u64);
        let parts = Division { task: TASK, few: if meter.is_watched() { FEW } else { TASK } };
        let layout = &self.layout;
        answer_in_order(points, (closest, ClosestPoint::NONE), parts, meter, |points, closest| {
            let task = ClosestPoints { layout, points, closest, options };
            // SAFETY: `set` was detected on this processor, and the layout made for it.
            let done = unsafe { self.set.run(task) };
            done.map_err(|_| refused((layout.wide.stack() * size_of::<u64>()) as u64))
        })?;
        meter.finish_stage();
        meter.check_batch().map(|()| QueryReport::default())
    }
}
