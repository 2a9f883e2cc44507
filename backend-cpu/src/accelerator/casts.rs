//! Impacts of a batch.

use rayon::prelude::*;
use splitplane_core::error::QueryError;
use splitplane_core::query::cast::{Cast, CastOptions, CastSearch, Impact};
use splitplane_core::query::closest_point::check_lengths;
use splitplane_core::report::QueryReport;
use splitplane_core::watch::Stage;
use splitplane_float_state::Standard;

use super::CpuAccelerator;
use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};
use crate::near::cast::Impacts;
use crate::near::cells::Walk;

/// Casts of one task.
const TASK: usize = 64;

impl CpuAccelerator {
    /// The first impact of each cast.
    pub(super) fn find_impacts(
        &self,
        casts: &[Cast],
        impacts: &mut [Impact],
        options: &CastOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let meter = &ProgressMeter::of(options.watch);
        check_lengths(casts.len(), impacts.len())?;
        meter.begin_stage(Stage::Rays, casts.len() as u64);
        let layout = &self.layout;
        casts.par_chunks(TASK).zip(impacts.par_chunks_mut(TASK)).try_for_each(
            |(casts, impacts)| {
                let _state = Standard::set();
                for (cast, impact) in casts.iter().zip(impacts) {
                    if meter.is_cancelled() {
                        break;
                    }
                    *impact = Impact::NONE;
                    if let Some(search) = CastSearch::new(cast, &layout.tree.bounds, options) {
                        let mut visitor = Impacts(search);
                        let walk = Walk { layout, visitor: &mut visitor };
                        // SAFETY: `set` was detected on this processor, and the layout made for it.
                        unsafe { self.set.run(walk) }?;
                        *impact = visitor.0.best();
                    }
                    meter.advance(1);
                    meter.record_work(WORK_BETWEEN_CHECKS);
                }
                Ok::<(), QueryError>(())
            },
        )?;
        meter.finish_stage();
        meter.check_batch().map(|()| QueryReport::default())
    }
}
