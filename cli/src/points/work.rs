//! A cloud and its tree, asked in parts that fit the caches and a limit of memory.

use crate::failure::Failure;
use crate::progress;
use rayon::prelude::*;
use splitplane::QueryError;
use splitplane::points::{AnyPointTree, NearestOptions, Neighbour};

/// Bytes of answers that are held at a time.
const HELD: usize = 1 << 22;

pub(super) struct Work<'a> {
    pub(super) tree: AnyPointTree<3>,
    /// As in the file, those left out among them.
    pub(super) points: &'a [[f32; 3]],
    pub(super) limit: Option<u64>,
    pub(super) quiet: bool,
}

impl Work<'_> {
    /// What `of` makes of each query's k nearest points, of which there may be fewer, in the order of queries.
    pub(super) fn map<T: Send + Clone>(
        &self,
        what: &'static str,
        queries: &[[f32; 3]],
        (k, max_distance): (usize, f32),
        none: T,
        of: impl Fn(usize, &[Neighbour]) -> T + Sync,
    ) -> Result<Vec<T>, Failure> {
        let mut out = room(queries.len(), none, self.limit)?;
        let k = k.min(self.tree.tree().len());
        if k == 0 {
            return Ok(out);
        }
        let chunk = (HELD / (k * size_of::<Neighbour>())).clamp(1, 1 << 16);
        let mut found = room(chunk.min(queries.len()) * k, Neighbour::NONE, self.limit)?;
        let bar = progress::bar(self.quiet, what, queries.len() as u64);
        let options = NearestOptions {
            k,
            max_distance,
            max_memory: self.limit,
            watch: Some(&progress::Unseen),
            ..NearestOptions::default()
        };
        for (number, (queries, out)) in queries.chunks(chunk).zip(out.chunks_mut(chunk)).enumerate()
        {
            let found = &mut found[..queries.len() * k];
            self.tree.nearest(queries, found, &options)?;
            out.par_iter_mut().zip(found.par_chunks(k)).enumerate().for_each(
                |(place, (out, found))| {
                    let some = found.partition_point(Neighbour::is_some);
                    *out = of(number * chunk + place, &found[..some]);
                },
            );
            bar.inc(queries.len() as u64);
        }
        bar.finish_and_clear();
        Ok(out)
    }

    /// A point by its index.
    pub(super) fn point(&self, index: u32) -> [f64; 3] {
        self.points[index as usize].map(f64::from)
    }
}

/// Room for so many items within a limit.
pub(super) fn room<T: Clone>(count: usize, none: T, limit: Option<u64>) -> Result<Vec<T>, Failure> {
    let mut items = Vec::new();
    let needed = count as u64 * size_of::<T>() as u64;
    if let Some(limit) = limit.filter(|&limit| needed > limit) {
        return Err(QueryError::OutOfMemory { needed, limit }.into());
    }
    let refused = |_| QueryError::OutOfMemory { needed, limit: needed };
    items.try_reserve_exact(count).map_err(refused)?;
    items.resize(count, none);
    Ok(items)
}
