//! Impacts, which the host finds.

use rayon::prelude::*;
use splitplane_core::error::QueryError;
use splitplane_core::query::cast::{Cast, CastOptions, Impact, impact};
use splitplane_core::query::closest_point::check_lengths;
use splitplane_core::report::QueryReport;
use splitplane_float_state::Standard;

use super::accelerator::WgpuAccelerator;
use super::settle::Asking;

/// Casts of one task.
const FEW: usize = 64;

impl WgpuAccelerator {
    /// The first impact of each cast, by the core's search through the host copy.
    pub(super) fn find_impacts(
        &self,
        casts: &[Cast],
        impacts: &mut [Impact],
        options: &CastOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        check_lengths(casts.len(), impacts.len())?;
        let asking = &Asking::new(options.watch, casts.len());
        asking.check()?;
        let tree = &self.tree.view();
        casts.par_chunks(FEW).zip(impacts.par_chunks_mut(FEW)).try_for_each(
            |(casts, impacts)| {
                let _state = Standard::set();
                asking.check()?;
                for (cast, own) in casts.iter().zip(impacts) {
                    *own = impact(tree, &self.triangles[..], cast, options)?;
                }
                asking.advance(casts.len());
                Ok::<(), QueryError>(())
            },
        )?;
        asking.check()?;
        let mut report = QueryReport::default();
        report.answered_by_cpu = casts.len() as u64;
        Ok(report)
    }
}
