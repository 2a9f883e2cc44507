//! The triangles that rays may meet, as a device lists them.
//!
//! A device finds them for a slice of rays at a time. The rays that meet more triangles than there is room for are
//! asked again with more room, in *runs* of the slice that take a bounded memory.

use std::borrow::Cow;
use std::ops::Range;

use splitplane_core::error::QueryError;
use splitplane_core::exact::ExactRay;
use splitplane_core::query::traverse::exact;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::report::QueryReport;
use splitplane_core::triangle::Triangle;

use super::accelerator::WgpuAccelerator;
use super::asked::Asked;
use super::held::Held;
use super::layout::UNFINISHED;
use super::settle::{Asking, HostScene, list};
use crate::device::wait::Wait;

/// Words of a list at first, its length included. Seven triangles suffice for most rays, and longer lists would be read
/// back for all.
const ROOM: usize = 8;
/// Most rays of a slice, and the fewest where memory is short.
const SLICE: usize = 1 << 16;
const LEAST_SLICE: usize = 64;
/// Most words of the lists of a run, and the fewest where memory is short. A ray with a longer list is left to the host.
const MOST_WORDS: usize = 1 << 20;
const LEAST_WORDS: usize = 1 << 8;
/// Rays of a task of the host.
pub(super) const FEW: usize = 64;
/// Lists of a slice and of a run take no more than this part of the memory that a query may take.
const PART: u64 = 16;

/// What a device found of a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Listed<'a> {
    /// All triangles that the ray may meet and perhaps others, some of them several times.
    Found(&'a [u32]),
    /// The driver did not follow the ray to its end.
    Unfinished,
    /// The device can tell nothing of the ray.
    Undecided,
    /// There are more than a list may have.
    TooLong,
}

/// The lists of a run of rays.
#[derive(Debug)]
pub(super) struct Lists<'a> {
    /// [`ROOM`] words for each ray; none where the device was not asked.
    words: &'a [u32],
    /// Rays that take more room, in ascending order.
    long: &'a [usize],
    /// Their words, as many for each.
    longer: &'a [u32],
    /// How many triangles the mesh has.
    triangles: usize,
}

impl<'a> Lists<'a> {
    /// The list of a ray of the run.
    pub(super) fn of(&self, ray: usize) -> Listed<'a> {
        let Some(words) = self.words.get(ray * ROOM..(ray + 1) * ROOM) else {
            return Listed::Undecided;
        };
        if Self::length(words) < ROOM {
            return self.read(words);
        }
        match (words[0], self.long.binary_search(&ray)) {
            (UNFINISHED | Hit::UNDECIDED, _) => self.read(words),
            (_, Ok(place)) => {
                let room = self.longer.len() / self.long.len();
                self.read(&self.longer[place * room..(place + 1) * room])
            }
            (_, Err(_)) => Listed::TooLong,
        }
    }

    /// How many triangles a list should have, or a mark.
    fn length(words: &[u32]) -> usize {
        words[0] as usize
    }

    /// A list, if it is complete.
    fn read(&self, words: &'a [u32]) -> Listed<'a> {
        match words[0] {
            UNFINISHED => Listed::Unfinished,
            Hit::UNDECIDED => Listed::Undecided,
            length => match words.get(1..=length as usize) {
                Some(found) if found.iter().all(|&t| (t as usize) < self.triangles) => {
                    Listed::Found(found)
                }
                // No device should say this. Then the host decides.
                Some(_) => Listed::Undecided,
                None => Listed::TooLong,
            },
        }
    }

    /// What the device left to the host.
    fn report(&self, rays: usize) -> QueryReport {
        let mut report = QueryReport::default();
        for ray in 0..rays {
            match self.of(ray) {
                Listed::Found(_) => continue,
                Listed::Unfinished => report.unfinished += 1,
                Listed::Undecided => report.undecided += 1,
                Listed::TooLong => {}
            }
            report.answered_by_cpu += 1;
        }
        report
    }
}

/// Where the next run ends, which begins at `first`: the lists of its rays with more than there is room for, which are
/// added to `long`, get as much room as the longest of them takes, `most` words in all. Returns that room too.
fn next_run(words: &[u32], first: usize, most: usize, long: &mut Vec<usize>) -> (usize, usize) {
    let rays = words.len() / ROOM;
    let mut room = 0;
    for ray in first..rays {
        let length = Lists::length(&words[ray * ROOM..]);
        // Marks are longer than all lists.
        if length < ROOM || length >= most {
            continue;
        }
        let more = room.max(length + 1);
        if more * (long.len() + 1) > most {
            return (ray, room);
        }
        room = more;
        long.push(ray - first);
    }
    (rays, room)
}

/// How many things of this many bytes fit the part of the memory that lists of a slice may take.
fn part(held: &Held, bytes: usize, least: usize, most: usize) -> usize {
    let part = held.max_memory().map_or(u64::MAX, |most| most / PART);
    usize::try_from(part).unwrap_or(usize::MAX).div_ceil(bytes).clamp(least, most)
}

/// Rays of a slice with this many bytes for each.
pub(super) fn slice_of(held: &Held, bytes: usize) -> usize {
    part(held, bytes, LEAST_SLICE, SLICE)
}

impl HostScene<'_> {
    /// Hands the triangles that a ray may meet to a test, as often as they are listed: those that a device found, or all
    /// on the way of the ray where it told nothing.
    pub(super) fn visit(
        &self,
        listed: Listed<'_>,
        ray: &Ray,
        options: &QueryOptions<'_>,
        mut test: impl FnMut(&ExactRay, &Triangle, u32) -> f64,
    ) {
        let Listed::Found(found) = listed else {
            exact::visit(&self.tree, self.triangles, ray, options, &mut (), test);
            return;
        };
        let Some(ray) = ExactRay::new(ray) else { return };
        for &triangle in found {
            if test(&ray, &self.triangles[triangle as usize], triangle) == f64::NEG_INFINITY {
                break;
            }
        }
    }
}

impl WgpuAccelerator {
    /// Lists the triangles that rays of a batch may meet, and calls `settle` with runs of rays in order: where the run
    /// begins in the batch, its rays, and their lists. The batch is its number of rays, and what gives a part of them. Returns a report on what was left to the
    /// host.
    ///
    /// # Errors
    /// What `settle` returns, a watch that cancels, memory that lists may not take, or a device that fails.
    pub(super) async fn list_in_runs<'r>(
        &self,
        wait: Wait,
        (count, rays_of): (usize, impl Fn(Range<usize>) -> Result<Cow<'r, [Ray]>, QueryError>),
        options: &QueryOptions<'_>,
        asking: &Asking<'_>,
        held: &Held,
        mut settle: impl FnMut(usize, &[Ray], &Lists<'_>) -> Result<(), QueryError>,
    ) -> Result<QueryReport, QueryError> {
        let slice = slice_of(held, 4 * ROOM);
        let most =
            part(held, 4, LEAST_WORDS, MOST_WORDS.min(self.queries.buffer_limit() as usize / 4));
        let asks = self.can_be_certain();
        let mut report = QueryReport::default();
        let mut lists = held.share();
        let mut first = 0;
        asking.check()?;
        while first < count {
            let rays = &rays_of(first..count.min(first + slice))?[..];
            let mut words = Vec::new();
            let each = size_of::<Ray>() + if asks { 4 * ROOM } else { 0 };
            let slice_bytes = (rays.len() * each) as u64;
            lists.hold(slice_bytes)?;
            if asks {
                words = self.listed(wait, rays, ROOM, options, asking).await?;
            }
            let mut at = 0;
            while at < rays.len() {
                let mut long = Vec::new();
                let (end, room) = match asks {
                    true => next_run(&words, at, most, &mut long),
                    false => (rays.len(), 0),
                };
                let mut again = list(long.len())?;
                again.extend(long.iter().map(|&ray| rays[at + ray]));
                let bytes = long.len() * (size_of::<usize>() + size_of::<Ray>() + 4 * room);
                lists.hold(slice_bytes + bytes as u64)?;
                let longer = self.listed(wait, &again, room, options, asking).await?;
                let run = Lists {
                    words: words.get(at * ROOM..end * ROOM).unwrap_or_default(),
                    long: &long,
                    longer: &longer,
                    triangles: self.triangles.len(),
                };
                report.append(run.report(end - at), first + at)?;
                settle(first + at, &rays[at..end], &run)?;
                at = end;
            }
            first += rays.len();
        }
        Ok(report)
    }

    /// Whether the device can be certain of anything that a ray meets.
    pub(super) fn can_be_certain(&self) -> bool {
        let in_range = !self.device.scene_scale().wide || self.device.bounds().is_empty();
        self.queries.is_certain() && in_range
    }

    /// What the device lists for rays, with this many words for each.
    async fn listed(
        &self,
        wait: Wait,
        rays: &[Ray],
        room: usize,
        options: &QueryOptions<'_>,
        asking: &Asking<'_>,
    ) -> Result<Vec<u32>, QueryError> {
        let mut words: Vec<u32> = list(rays.len() * room)?;
        let (tree, asked) = (&self.device, Asked::List { room: room as u32 });
        let keep = |_, bytes: &[u8]| {
            words.extend(
                bytes
                    .chunks_exact(4)
                    .map(|word| u32::from_ne_bytes([word[0], word[1], word[2], word[3]])),
            );
            Ok(())
        };
        let watch = asking.watch();
        let done = self.queries.trace_slices(wait, tree, rays, options, asked, watch, keep).await;
        match done.map_err(QueryError::from) {
            Err(QueryError::Cancelled { .. }) => Err(asking.cancelled()),
            done => done.map(|()| words),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first words of rays that have found this many triangles, each with its number as index.
    fn words(lengths: &[u32]) -> Vec<u32> {
        let words = |&length: &u32| [length, 0, 1, 2, 3, 4, 5, 6];
        lengths.iter().flat_map(words).collect()
    }

    #[test]
    fn runs_have_room_for_their_longest_list() {
        let words = words(&[3, 8, 7, UNFINISHED, 11, 100, 40, Hit::UNDECIDED, 0, 9]);
        let run = |first, most| {
            let mut long = Vec::new();
            let (end, room) = next_run(&words, first, most, &mut long);
            assert!(room * long.len() <= most);
            (end, room, long)
        };
        assert_eq!(run(0, 1 << 20), (10, 101, vec![1, 4, 5, 6, 9]));
        assert_eq!(run(0, 123), (5, 12, vec![1, 4]));
        assert_eq!(run(5, 123), (6, 101, vec![0]));
        assert_eq!(run(6, 123), (10, 41, vec![0, 3]));
        // 100 triangles and their number do not fit.
        assert_eq!(run(5, 100), (10, 41, vec![1, 4]));
        assert_eq!(run(0, 8), (10, 0, vec![]));
        assert_eq!(run(8, 8), (10, 0, vec![]));
    }

    #[test]
    fn what_a_device_says_is_read_with_care() {
        let (long, longer) = ([1, 4], [9, 0, 1, 2, 3, 4, 5, 6, 6, 5, 8, 0, 1, 2, 3, 4, 5, 6, 6, 7]);
        let mut words = words(&[2, 9, 0, 30, 8, UNFINISHED, Hit::UNDECIDED, 7, u32::MAX - 3, 2]);
        words[9 * ROOM + 2] = 7;
        let lists = Lists { words: &words, long: &long, longer: &longer, triangles: 7 };
        assert_eq!(lists.of(0), Listed::Found(&[0, 1]));
        assert_eq!(lists.of(1), Listed::Found(&[0, 1, 2, 3, 4, 5, 6, 6, 5]));
        assert_eq!(lists.of(2), Listed::Found(&[]));
        assert_eq!(lists.of(3), Listed::TooLong);
        assert_eq!(lists.of(4), Listed::Found(&[0, 1, 2, 3, 4, 5, 6, 6]));
        assert_eq!(lists.of(5), Listed::Unfinished);
        assert_eq!(lists.of(6), Listed::Undecided);
        assert_eq!(lists.of(7), Listed::Found(&[0, 1, 2, 3, 4, 5, 6]));
        assert_eq!(lists.of(8), Listed::TooLong);
        // There is no triangle 7.
        assert_eq!(lists.of(9), Listed::Undecided);
        assert_eq!(lists.of(10), Listed::Undecided);
        let report = lists.report(11);
        assert_eq!((report.unfinished, report.undecided, report.answered_by_cpu), (1, 3, 6));
        // A list that has become longer the second time.
        let longer = [10, 0, 1, 2, 3, 4, 5, 6, 6, 5];
        let lists = Lists { words: &words, long: &[1], longer: &longer, triangles: 7 };
        assert_eq!(lists.of(1), Listed::TooLong);
    }
}
