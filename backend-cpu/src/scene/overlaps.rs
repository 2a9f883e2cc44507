//! Overlaps with a scene on all threads: a volume at a time, answers in the order of the volumes.

use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

use rayon::prelude::*;
use splitplane_core::backend::scene::{SceneOverlapOptions, SceneOverlaps};
use splitplane_core::error::QueryError;
use splitplane_core::query::closest_point::check_lengths;
use splitplane_core::query::overlap::Volume;
use splitplane_core::watch::Stage;

use super::CpuScene;
use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};

/// Volumes of one task.
const TASK: usize = 8;

impl CpuScene {
    /// The triangles that each volume meets.
    pub(super) fn find_overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<SceneOverlaps, QueryError> {
        let meter = &ProgressMeter::of(options.watch);
        meter.begin_stage(Stage::Rays, volumes.len() as u64);
        // What threads hold together counts against the limit.
        let held = AtomicU64::new(0);
        let parts = volumes.par_chunks(TASK).map(|volumes| {
            let mut part = SceneOverlaps::default();
            for volume in volumes.chunks(1) {
                if meter.is_cancelled() {
                    break;
                }
                let left = options.max_memory.map(|limit| limit.saturating_sub(held.load(Relaxed)));
                let own = SceneOverlapOptions { max_memory: left, watch: None, ..*options };
                let found = self.built.overlaps(volume, &own)?;
                let before = part.bytes();
                part.append(found, None)?;
                held.fetch_add(part.bytes() - before, Relaxed);
                meter.advance(1);
                meter.record_work(WORK_BETWEEN_CHECKS);
            }
            Ok(part)
        });
        let parts: Vec<Result<SceneOverlaps, QueryError>> = parts.collect();
        meter.finish_stage();
        meter.check_batch()?;
        let mut all = SceneOverlaps::default();
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
        options: &SceneOverlapOptions<'_>,
    ) -> Result<(), QueryError> {
        check_lengths(volumes.len(), found.len())?;
        let meter = &ProgressMeter::of(options.watch);
        meter.begin_stage(Stage::Rays, volumes.len() as u64);
        volumes.par_chunks(TASK).zip(found.par_chunks_mut(TASK)).try_for_each(
            |(volumes, found)| {
                for (volume, found) in volumes.iter().zip(found) {
                    if meter.is_cancelled() {
                        break;
                    }
                    *found = self.built.overlaps_any(volume, options)?;
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
