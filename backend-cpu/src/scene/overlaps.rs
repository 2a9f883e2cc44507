//! Overlaps with a scene on all threads: a volume at a time, answers in the order of the volumes.

use splitplane_core::backend::scene::{SceneOverlapOptions, SceneOverlaps};
use splitplane_core::error::QueryError;
use splitplane_core::query::closest_point::check_lengths;
use splitplane_core::query::overlap::Volume;
use splitplane_core::watch::{Stage, Watch};
use splitplane_float_state::Standard;

use super::{CpuScene, PartWatch};
use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};
use crate::parallel::{Parallel, ParallelSlice};

/// Volumes of one task.
const TASK: usize = 8;

impl CpuScene {
    /// The triangles that each volume meets. With a limit of memory on the calling thread, so that whether it suffices depends on no thread.
    pub(super) fn find_overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<SceneOverlaps, QueryError> {
        let _state = Standard::set();
        if options.max_memory.is_some() {
            return self.built.overlaps(volumes, options);
        }
        let meter = &ProgressMeter::of(options.watch);
        meter.begin_stage(Stage::Rays, volumes.len() as u64);
        let watch = PartWatch(meter);
        let watch: Option<&dyn Watch> = if meter.is_watched() { Some(&watch) } else { None };
        let own = &SceneOverlapOptions { watch, ..*options };
        let parts = volumes.par_chunks(TASK).try_collect(|volumes| {
            let mut part = SceneOverlaps::default();
            for volume in volumes.chunks(1) {
                if meter.is_cancelled() {
                    break;
                }
                part.append(self.built.overlaps(volume, own)?, None)?;
                meter.advance(1);
                meter.record_work(WORK_BETWEEN_CHECKS);
            }
            Ok::<_, QueryError>(part)
        });
        // Before an error of a part that was cancelled.
        meter.check_batch()?;
        let parts = parts?;
        meter.finish_stage();
        meter.check_batch()?;
        let mut all = SceneOverlaps::default();
        for part in parts {
            all.append(part, None)?;
        }
        Ok(all)
    }

    /// Whether each volume meets any triangle.
    pub(super) fn find_any_overlaps(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<(), QueryError> {
        check_lengths(volumes.len(), found.len())?;
        let meter = &ProgressMeter::of(options.watch);
        meter.begin_stage(Stage::Rays, volumes.len() as u64);
        let watch = PartWatch(meter);
        let watch: Option<&dyn Watch> = if meter.is_watched() { Some(&watch) } else { None };
        let own = &SceneOverlapOptions { watch, ..*options };
        volumes.par_chunks(TASK).zip(found.par_chunks_mut(TASK)).try_for_each(
            |(volumes, found)| {
                for (volume, found) in volumes.iter().zip(found) {
                    if meter.is_cancelled() {
                        break;
                    }
                    *found = self.built.overlaps_any(volume, own).map_err(|error| match error {
                        // Of the whole, not of the part.
                        QueryError::Cancelled { .. } => meter.check_batch().err().unwrap_or(error),
                        error => error,
                    })?;
                    meter.advance(1);
                    meter.record_work(WORK_BETWEEN_CHECKS);
                }
                Ok::<(), QueryError>(())
            },
        )?;
        meter.finish_stage();
        meter.check_batch()
    }
}
