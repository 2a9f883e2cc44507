//! What is near in a scene of many objects: the host finds it, on all threads, in the order of the questions.

use rayon::prelude::*;
use splitplane_core::backend::scene::{
    BuiltScene, SceneClosestPoint, SceneClosestPointOptions, SceneOverlapOptions, SceneOverlaps,
};
use splitplane_core::error::QueryError;
use splitplane_core::query::closest_point::check_lengths;
use splitplane_core::query::overlap::Volume;
use splitplane_core::report::QueryReport;
use splitplane_float_state::Standard;

use crate::query::settle::Asking;

/// Points of one task.
const POINTS: usize = 64;
/// Volumes of one task.
const VOLUMES: usize = 8;

/// The closest point of a scene to each point.
pub(super) fn closest_points(
    scene: &BuiltScene,
    points: &[[f32; 3]],
    closest: &mut [SceneClosestPoint],
    options: &SceneClosestPointOptions<'_>,
) -> Result<QueryReport, QueryError> {
    check_lengths(points.len(), closest.len())?;
    let asking = &Asking::new(options.watch, points.len());
    asking.check()?;
    points.par_chunks(POINTS).zip(closest.par_chunks_mut(POINTS)).try_for_each(
        |(points, closest)| {
            let _state = Standard::set();
            asking.check()?;
            for (&point, closest) in points.iter().zip(closest) {
                *closest = scene.closest_point(point, options)?;
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

/// The triangles that each volume meets. With a limit of memory on the calling thread, so that whether it suffices depends on no thread. The CPU backend's
/// `scene/overlaps.rs` is the same by another meter.
pub(super) fn overlaps(
    scene: &BuiltScene,
    volumes: &[Volume<'_>],
    options: &SceneOverlapOptions<'_>,
) -> Result<SceneOverlaps, QueryError> {
    if options.max_memory.is_some() {
        return scene.overlaps(volumes, options);
    }
    let asking = &Asking::new(options.watch, volumes.len());
    asking.check()?;
    let own = &SceneOverlapOptions { watch: asking.watch(), ..*options };
    let parts = volumes.par_chunks(VOLUMES).map(|volumes| {
        let _state = Standard::set();
        let mut part = SceneOverlaps::default();
        for volume in volumes.chunks(1) {
            asking.check()?;
            let found = scene.overlaps(volume, own).map_err(|error| asking.of_whole(error))?;
            part.append(found, None)?;
            asking.advance(1);
        }
        Ok(part)
    });
    let parts = parts.collect::<Result<Vec<SceneOverlaps>, QueryError>>()?;
    let mut all = SceneOverlaps::default();
    for part in parts {
        all.append(part, None)?;
    }
    asking.check()?;
    Ok(all)
}

/// Whether each volume meets any triangle.
pub(super) fn overlaps_any(
    scene: &BuiltScene,
    volumes: &[Volume<'_>],
    found: &mut [bool],
    options: &SceneOverlapOptions<'_>,
) -> Result<(), QueryError> {
    check_lengths(volumes.len(), found.len())?;
    let asking = &Asking::new(options.watch, volumes.len());
    asking.check()?;
    let own = &SceneOverlapOptions { watch: asking.watch(), ..*options };
    volumes.par_chunks(VOLUMES).zip(found.par_chunks_mut(VOLUMES)).try_for_each(
        |(volumes, found)| {
            let _state = Standard::set();
            for (volume, found) in volumes.iter().zip(found) {
                asking.check()?;
                let met = scene.overlaps_any(volume, own);
                *found = met.map_err(|error| asking.of_whole(error))?;
                asking.advance(1);
            }
            Ok::<(), QueryError>(())
        },
    )?;
    asking.check()
}
