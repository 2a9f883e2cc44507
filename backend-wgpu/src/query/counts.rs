//! How many surfaces rays cross, counted on the device where it is certain of every crossing. What it leaves, the triangles
//! that it lists and the host decide.

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;
use splitplane_core::error::QueryError;
use splitplane_core::query::all_hits::AllHitsOptions;
use splitplane_core::query::certify::MOST_COUNTED;
use splitplane_core::ray::{QueryOptions, Ray};
use splitplane_core::report::QueryReport;
use splitplane_float_state::Standard;

use super::accelerator::WgpuAccelerator;
use super::all_hits::Batch;
use super::asked::Asked;
use super::held::{Held, Share};
use super::lists::{FEW, Lists, slice_of};
use super::settle::{Asking, list};
use crate::device::wait::{Wait, blocking};

/// Host memory for a ray of a slice: it, and whether it is left.
const EACH: usize = size_of::<Ray>() + size_of::<usize>();

impl WgpuAccelerator {
    /// How many crossings rays have.
    pub(super) fn find_counts(
        &self,
        rays: &[Ray],
        counts: &mut [u32],
        options: &AllHitsOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        if rays.len() != counts.len() {
            return Err(QueryError::LengthMismatch { rays: rays.len(), results: counts.len() });
        }
        let asking = &Asking::new(options.watch, rays.len());
        let held = &Held::new(0, options.max_memory)?;
        let batch = Batch { accelerator: self, options, asking, held };
        let query = &options.query();
        let mut report = QueryReport::default();
        let mut share = held.share();
        asking.check()?;
        let slice = slice_of(held, EACH);
        for (rays, counts) in rays.chunks(slice).zip(counts.chunks_mut(slice)) {
            let left = self.counted(rays, query, asking, &mut share, |ray, [front, back]| {
                counts[ray] = front + back;
            })?;
            let rays_of = |range: Range<usize>| {
                let mut again = list(range.len())?;
                again.extend(left[range].iter().map(|&ray| rays[ray]));
                Ok(Cow::Owned(again))
            };
            let settle = |first: usize, rays: &[Ray], lists: &Lists<'_>| {
                let mut found: Vec<u32> = list(rays.len())?;
                found.resize(rays.len(), 0);
                let tasks = rays.par_chunks(FEW).zip(found.par_chunks_mut(FEW)).enumerate();
                tasks.try_for_each(|(task, (rays, found))| {
                    let _state = Standard::set();
                    let (all, _share) = batch.cross(rays, task * FEW, lists)?;
                    for (found, ends) in found.iter_mut().zip(all.starts.windows(2)) {
                        *found = (ends[1] - ends[0]) as u32;
                    }
                    asking.advance(rays.len());
                    asking.check()
                })?;
                for (&ray, found) in left[first..].iter().zip(found) {
                    counts[ray] = found;
                }
                Ok(())
            };
            let listed = self.list_in_runs(
                Wait::Blocking,
                (left.len(), rays_of),
                query,
                asking,
                held,
                settle,
            );
            let part = blocking(listed)?;
            report.append(part, 0)?;
        }
        asking.check()?;
        Ok(report)
    }

    /// Asks the device how many surfaces rays of a slice cross, from the front and from the back, and hands over what is
    /// certain. Returns the places of the other rays, for which `share` holds memory from now on.
    pub(super) fn counted(
        &self,
        rays: &[Ray],
        options: &QueryOptions<'_>,
        asking: &Asking<'_>,
        share: &mut Share<'_>,
        mut certain: impl FnMut(usize, [u32; 2]),
    ) -> Result<Vec<usize>, QueryError> {
        share.hold((rays.len() * EACH) as u64)?;
        let mut left = list(rays.len())?;
        if !self.can_be_certain() {
            left.extend(0..rays.len());
            return Ok(left);
        }
        let asked = Asked::Count { room: MOST_COUNTED as u32 };
        let tree = &self.device;
        let count = |range: Range<usize>, bytes: &[u8]| {
            let before = left.len();
            for (ray, word) in range.clone().zip(bytes.chunks_exact(4)) {
                match sides(u32::from_ne_bytes([word[0], word[1], word[2], word[3]])) {
                    Some(sides) => certain(ray, sides),
                    None => left.push(ray),
                }
            }
            asking.advance(range.len() - (left.len() - before));
            Ok(())
        };
        let (wait, watch) = (Wait::Blocking, asking.watch());
        let done =
            blocking(self.queries.trace_slices(wait, tree, rays, options, asked, watch, count));
        match done.map_err(QueryError::from) {
            Err(QueryError::Cancelled { .. }) => Err(asking.cancelled()),
            done => done.map(|()| left),
        }
    }
}

/// What a word of the device says: `None` for a mark, and for what no device should say.
fn sides(word: u32) -> Option<[u32; 2]> {
    let sides = [word & 0xffff, word >> 16];
    (sides[0] + sides[1] <= MOST_COUNTED as u32).then_some(sides)
}

#[cfg(test)]
mod tests {
    use splitplane_core::ray::Hit;

    use super::*;
    use crate::query::UNFINISHED;

    #[test]
    fn words_are_read_with_care() {
        assert_eq!(sides(0), Some([0, 0]));
        assert_eq!(sides(7 | 25 << 16), Some([7, 25]));
        for mark in [8 | 25 << 16, UNFINISHED, Hit::UNDECIDED, u32::MAX, u32::MAX - 3] {
            assert_eq!(sides(mark), None, "{mark:x}");
        }
    }
}
