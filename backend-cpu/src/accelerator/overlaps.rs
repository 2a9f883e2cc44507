//! Overlaps of a batch.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use splitplane_core::error::QueryError;
use splitplane_core::query::closest_point::check_lengths;
use splitplane_core::query::overlap::{OverlapOptions, Overlaps, Region, Volume};
use splitplane_core::report::QueryReport;
use splitplane_core::watch::Stage;
use splitplane_float_state::Standard;

use super::CpuAccelerator;
use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};
use crate::near::cells::Walk;
use crate::near::overlap::Overlapping;
use crate::parallel::{Parallel, ParallelSlice};

/// Volumes of one task.
const TASK: usize = 64;

impl CpuAccelerator {
    /// The triangles that each volume meets.
    pub(super) fn find_overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &OverlapOptions<'_>,
    ) -> Result<Overlaps, QueryError> {
        let meter = &ProgressMeter::of(options.watch);
        meter.begin_stage(Stage::Rays, volumes.len() as u64);
        // What threads hold together counts against the limit.
        let held = AtomicU64::new(0);
        let parts = volumes.par_chunks(TASK).collect(|volumes| {
            let mut part = Overlaps::default();
            for volume in volumes {
                if meter.is_cancelled() {
                    break;
                }
                let left = options.max_memory.map(|limit| limit.saturating_sub(held.load(Relaxed)));
                let own = OverlapOptions { max_memory: left, ..*options };
                let found = self.overlapping(volume, false, &own, meter)?;
                let before = part.bytes();
                part.push(found, None)?;
                held.fetch_add(part.bytes() - before, Relaxed);
                meter.advance(1);
                meter.record_work(WORK_BETWEEN_CHECKS);
            }
            Ok::<_, QueryError>(part)
        });
        meter.finish_stage();
        meter.check_batch()?;
        let mut all = Overlaps::default();
        for part in parts {
            all.append(part?, options.max_memory)?;
        }
        Ok(all)
    }

    /// Whether each volume meets any triangle.
    pub(super) fn find_any_overlaps(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &OverlapOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let meter = &ProgressMeter::of(options.watch);
        check_lengths(volumes.len(), found.len())?;
        meter.begin_stage(Stage::Rays, volumes.len() as u64);
        volumes.par_chunks(TASK).zip(found.par_chunks_mut(TASK)).try_for_each(
            |(volumes, found)| {
                for (volume, found) in volumes.iter().zip(found) {
                    if meter.is_cancelled() {
                        break;
                    }
                    *found = !self.overlapping(volume, true, options, meter)?.is_empty();
                    meter.advance(1);
                    meter.record_work(WORK_BETWEEN_CHECKS);
                }
                Ok::<(), QueryError>(())
            },
        )?;
        meter.finish_stage();
        meter.check_batch().map(|()| QueryReport::default())
    }

    fn overlapping(
        &self,
        volume: &Volume<'_>,
        any: bool,
        options: &OverlapOptions<'_>,
        meter: &ProgressMeter<'_>,
    ) -> Result<Vec<u32>, QueryError> {
        let _state = Standard::set();
        let found = Vec::new();
        let Some(region) = Region::new(volume)? else { return Ok(found) };
        let mut visitor = Overlapping { region, any, options, meter, found };
        let walk = Walk { layout: &self.layout, visitor: &mut visitor };
        // SAFETY: `set` was detected on this processor, and the layout made for it.
        unsafe { self.set.run(walk) }?;
        Ok(visitor.found)
    }
}
