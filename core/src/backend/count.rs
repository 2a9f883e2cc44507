//! How many hits rays have, by an accelerator's all hits: what backends without a count of their own do.

use crate::error::QueryError;
use crate::query::all_hits::AllHitsOptions;
use crate::ray::Ray;
use crate::report::QueryReport;

use super::Accelerator;
use super::part::{OfPart, of_whole, watch};

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
    let total = rays.len();
    let mut report = QueryReport::default();
    for (part, (rays, counts)) in rays.chunks(PART).zip(counts.chunks_mut(PART)).enumerate() {
        let first = part * PART;
        let of_part = options.watch.map(|watch| OfPart::new(watch, first, total));
        let options = AllHitsOptions { watch: watch(&of_part), ..*options };
        let all = accelerator.all_hits(rays, &options);
        let all = all.map_err(|error| of_whole(error, first, total))?;
        for (count, ends) in counts.iter_mut().zip(all.starts.windows(2)) {
            // A mesh has fewer triangles than this holds.
            *count = (ends[1] - ends[0]) as u32;
        }
        report.append(all.report, first)?;
    }
    Ok(report)
}
