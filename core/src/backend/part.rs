//! Batches that are asked for in parts.

use alloc::vec::Vec;
use core::ops::ControlFlow;

use crate::error::{QueryError, refused};
use crate::ray::{QueryOptions, Ray, Rays};
use crate::report::QueryReport;
use crate::watch::{Progress, Watch};

/// Rows that are records at a time: 8 MiB.
pub(super) const RECORDS: usize = 1 << 18;

/// Answers rays by what takes records.
pub(super) fn in_records<T>(
    rays: Rays<'_>,
    answers: &mut [T],
    options: &QueryOptions<'_>,
    ask: impl Fn(&[Ray], &mut [T], &QueryOptions<'_>) -> Result<QueryReport, QueryError>,
) -> Result<QueryReport, QueryError> {
    let total = rays.len();
    if let Rays::Records(rays) = rays {
        return ask(rays, answers, options);
    }
    if total != answers.len() {
        return Err(QueryError::LengthMismatch { rays: total, results: answers.len() });
    }
    if total == 0 {
        return ask(&[], answers, options);
    }
    let (mut records, count) = (Vec::new(), total.min(RECORDS));
    let no_memory = |_| refused((count * size_of::<Ray>()) as u64);
    records.try_reserve_exact(count).map_err(no_memory)?;
    let mut report = QueryReport::default();
    for (part, answers) in answers.chunks_mut(RECORDS).enumerate() {
        let first = part * RECORDS;
        records.clear();
        records.extend((first..first + answers.len()).map(|place| rays.ray(place)));
        let of_part = options.watch.map(|watch| OfPart::new(watch, first, total));
        let options = QueryOptions { watch: watch(&of_part), ..*options };
        let answered = ask(&records, answers, &options);
        report.append(answered.map_err(|error| of_whole(error, first, total))?, first)?;
    }
    Ok(report)
}

/// Turns progress in a part of the rays into progress in all.
pub(super) struct OfPart<'a> {
    watch: &'a dyn Watch,
    first: u64,
    total: u64,
}

impl<'a> OfPart<'a> {
    /// The watch of a part before which there are `first` rays.
    pub(super) fn new(watch: &'a dyn Watch, first: usize, total: usize) -> OfPart<'a> {
        OfPart { watch, first: first as u64, total: total as u64 }
    }
}

impl Watch for OfPart<'_> {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        let done = self.first + progress.done;
        self.watch.progress(&Progress { done, total: self.total, ..*progress })
    }
}

/// A part's watch, as options have it.
pub(super) fn watch<'a>(part: &'a Option<OfPart<'_>>) -> Option<&'a dyn Watch> {
    match part {
        Some(watch) => Some(watch),
        None => None,
    }
}

/// Where a part was cancelled, counted in all rays.
pub(super) fn of_whole(error: QueryError, first: usize, total: usize) -> QueryError {
    match error {
        QueryError::Cancelled { done, .. } => {
            QueryError::Cancelled { done: first as u64 + done, total: total as u64 }
        }
        error => error,
    }
}
