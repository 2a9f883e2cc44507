//! How many hits rays have, by an accelerator's all hits: what backends without a count of their own do.

use core::ops::ControlFlow;

use crate::error::QueryError;
use crate::query::all_hits::AllHitsOptions;
use crate::ray::Ray;
use crate::report::QueryReport;
use crate::watch::{Progress, Watch};

use super::Accelerator;

/// Rays whose crossings are held at a time.
const PART: usize = 1 << 12;

/// See [`Accelerator::count_hits`].
pub(super) fn count_by_all_hits(
    accelerator: &(impl Accelerator + ?Sized),
    rays: &[Ray],
    counts: &mut [u32],
    options: &AllHitsOptions<'_>,
) -> Result<QueryReport, QueryError> {
    if rays.len() != counts.len() {
        return Err(QueryError::LengthMismatch { rays: rays.len(), results: counts.len() });
    }
    let total = rays.len() as u64;
    let mut report = QueryReport::default();
    for (part, (rays, counts)) in rays.chunks(PART).zip(counts.chunks_mut(PART)).enumerate() {
        let first = (part * PART) as u64;
        let of_part = options.watch.map(|watch| OfPart { watch, first, total });
        let watch: Option<&dyn Watch> = match &of_part {
            Some(watch) => Some(watch),
            None => None,
        };
        let all = accelerator.all_hits(rays, &AllHitsOptions { watch, ..*options });
        let all = all.map_err(|error| match error {
            QueryError::Cancelled { done, .. } => {
                QueryError::Cancelled { done: first + done, total }
            }
            error => error,
        })?;
        for (count, ends) in counts.iter_mut().zip(all.starts.windows(2)) {
            // A mesh has fewer triangles than this holds.
            *count = (ends[1] - ends[0]) as u32;
        }
        report.append(all.report, part * PART)?;
    }
    Ok(report)
}

/// Turns progress in a part of the rays into progress in all.
struct OfPart<'a> {
    watch: &'a dyn Watch,
    first: u64,
    total: u64,
}

impl Watch for OfPart<'_> {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        let done = self.first + progress.done;
        self.watch.progress(&Progress { done, total: self.total, ..*progress })
    }
}
