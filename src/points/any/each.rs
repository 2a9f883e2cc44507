//! Lists of points, shown one after the other.

#[cfg(feature = "wgpu")]
use core::ops::ControlFlow;
use splitplane_core::error::QueryError;
use splitplane_core::report::QueryReport;
#[cfg(feature = "wgpu")]
use splitplane_core::watch::{Progress, Watch};
use splitplane_cpu::KeptBytes;
#[cfg(feature = "wgpu")]
use splitplane_wgpu::WgpuPointTree;

use super::{AnyPointTree, NearestOptions, Neighbour};

/// Queries that a device is asked at once.
#[cfg(feature = "wgpu")]
const PART: usize = 1 << 16;

impl<const N: usize> AnyPointTree<N> {
    /// The points within [`NearestOptions::max_distance`] of each query: `keep` is shown one list after the other, in the order of the queries. Limits of memory are for what is
    /// found and for what `keep` stores, which is said by `kept`: see [`CpuPointTree::for_each_within`](splitplane_cpu::CpuPointTree::for_each_within). A device answers parts
    /// of the batch, which become smaller where the limit asks for it.
    ///
    /// # Errors
    /// What `keep` returns, more memory than allowed or than the system has, a watch that cancels the batch, or a device that fails.
    pub fn for_each_within<E: From<QueryError>>(
        &self,
        queries: &[[f32; N]],
        options: &NearestOptions<'_>,
        kept: KeptBytes,
        keep: impl FnMut(&[Neighbour]) -> Result<(), E>,
    ) -> Result<QueryReport, E> {
        match self {
            AnyPointTree::Cpu(tree) => {
                tree.for_each_within(queries, options, kept, keep).map(|()| QueryReport::default())
            }
            #[cfg(feature = "wgpu")]
            AnyPointTree::Wgpu(tree) => on_device(tree, queries, options, kept, keep),
        }
    }
}

#[cfg(feature = "wgpu")]
fn on_device<const N: usize, E: From<QueryError>>(
    tree: &WgpuPointTree<N>,
    queries: &[[f32; N]],
    options: &NearestOptions<'_>,
    kept: KeptBytes,
    mut keep: impl FnMut(&[Neighbour]) -> Result<(), E>,
) -> Result<QueryReport, E> {
    let mut report = QueryReport::default();
    let (mut done, mut part, mut held) = (0, PART, 0u64);
    while done < queries.len() {
        let few = &queries[done..queries.len().min(done + part)];
        let part_watch =
            options.watch.map(|watch| PartWatch { watch, first: done, total: queries.len() });
        let own = NearestOptions {
            max_memory: options.max_memory.map(|limit| limit.saturating_sub(held)),
            watch: part_watch.as_ref().map(|watch| -> &dyn Watch { watch }),
            ..*options
        };
        let lists = match tree.within_each(few, &own) {
            Err(QueryError::OutOfMemory { .. }) if few.len() > 1 => {
                part = few.len() / 2;
                continue;
            }
            Err(error) => {
                return Err(whole(error, held, options.max_memory, done, queries.len()).into());
            }
            Ok(lists) => lists,
        };
        for query in 0..few.len() {
            let list = lists.of(query);
            let more = kept.neighbour.saturating_mul(list.len() as u64).saturating_add(kept.list);
            held = held.saturating_add(more);
            if let Some(limit) = options.max_memory.filter(|&limit| held > limit) {
                return Err(QueryError::OutOfMemory { needed: held, limit }.into());
            }
            keep(list)?;
        }
        report.append(lists.report, 0)?;
        done += few.len();
        part = (2 * part).min(PART);
    }
    Ok(report)
}

/// The error of a part, as one of the whole batch.
#[cfg(feature = "wgpu")]
fn whole(
    error: QueryError,
    held: u64,
    limit: Option<u64>,
    first: usize,
    total: usize,
) -> QueryError {
    match (error, limit) {
        (QueryError::OutOfMemory { needed, .. }, Some(limit)) => {
            QueryError::OutOfMemory { needed: needed.saturating_add(held), limit }
        }
        (QueryError::Cancelled { done, .. }, _) => {
            QueryError::Cancelled { done: done + first as u64, total: total as u64 }
        }
        (error, _) => error,
    }
}

/// The watch of a part of a batch.
#[cfg(feature = "wgpu")]
struct PartWatch<'a> {
    watch: &'a dyn Watch,
    first: usize,
    total: usize,
}

#[cfg(feature = "wgpu")]
impl Watch for PartWatch<'_> {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        let (done, total) = (progress.done + self.first as u64, self.total as u64);
        self.watch.progress(&Progress { done, total, ..*progress })
    }
}
