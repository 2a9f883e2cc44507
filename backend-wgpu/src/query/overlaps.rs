//! Overlaps, which the host finds.

use rayon::prelude::*;
use splitplane_core::error::QueryError;
use splitplane_core::query::closest_point::check_lengths;
use splitplane_core::query::overlap::{OverlapOptions, Overlaps, Volume, overlapping};
use splitplane_core::report::QueryReport;

use super::accelerator::WgpuAccelerator;
use super::settle::Asking;

/// Volumes of one task.
const FEW: usize = 64;

impl WgpuAccelerator {
    /// The triangles that each volume meets, by the core's search through the host copy.
    pub(super) fn find_overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &OverlapOptions<'_>,
    ) -> Result<Overlaps, QueryError> {
        let asking = &Asking::new(options.watch, volumes.len());
        asking.check()?;
        let tree = &self.tree.view();
        let parts = volumes.par_chunks(FEW).map(|volumes| {
            let mut part = Overlaps::default();
            for volume in volumes {
                asking.check()?;
                let found = overlapping(tree, &self.triangles[..], volume, false, options)?;
                part.push(found, options.max_memory)?;
                asking.advance(1);
            }
            Ok(part)
        });
        let parts: Vec<Result<Overlaps, QueryError>> = parts.collect();
        let mut all = Overlaps::default();
        for part in parts {
            all.append(part?, options.max_memory)?;
        }
        asking.check()?;
        all.report.answered_by_cpu = volumes.len() as u64;
        Ok(all)
    }

    /// Whether each volume meets any triangle.
    pub(super) fn find_any_overlaps(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &OverlapOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        check_lengths(volumes.len(), found.len())?;
        let asking = &Asking::new(options.watch, volumes.len());
        asking.check()?;
        let tree = &self.tree.view();
        volumes.par_chunks(FEW).zip(found.par_chunks_mut(FEW)).try_for_each(
            |(volumes, found)| {
                for (volume, found) in volumes.iter().zip(found) {
                    asking.check()?;
                    let one = overlapping(tree, &self.triangles[..], volume, true, options)?;
                    *found = !one.is_empty();
                    asking.advance(1);
                }
                Ok::<(), QueryError>(())
            },
        )?;
        asking.check()?;
        let mut report = QueryReport::default();
        report.answered_by_cpu = volumes.len() as u64;
        Ok(report)
    }
}
