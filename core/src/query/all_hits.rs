//! All hits of a ray, in order, each crossing of a surface once.

use alloc::collections::TryReserveError;
use alloc::vec::Vec;

use crate::cancel::go_on_tracing;
use crate::error::{QueryError, check_bytes, refused};
use crate::exact::{ExactRay, Meeting, cross};
use crate::query::traverse::{Triangles, exact};
use crate::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use crate::report::QueryReport;
use crate::tree::KdTreeView;
use crate::triangle::Triangle;
use crate::watch::Watch;

/// A place where a ray crosses a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Where, and in which triangle.
    pub hit: Hit,
    /// Whether the ray comes from the front: the side from which the corners run counter-clockwise.
    pub front: bool,
}

/// The crossings of a batch of rays.
#[derive(Clone, Debug, PartialEq)]
pub struct AllHits {
    /// Where the crossings of each ray begin, followed by the number of all crossings: one entry
    /// more than there are rays.
    pub starts: Vec<usize>,
    /// The crossings of all rays, ray by ray, each ray's ordered by (exact distance, triangle).
    pub crossings: Vec<Crossing>,
    /// Which backend answered. A device finds the triangles that a ray may cross, and the CPU decides which of them it does,
    /// and where. Rays of which the device could tell nothing are counted as answered by the CPU.
    pub report: QueryReport,
}

/// Settings of a query for the crossings of rays.
#[derive(Clone, Copy, Debug, Default)]
pub struct AllHitsOptions<'a> {
    /// Which side to ignore.
    pub culling: Culling,
    /// One triangle to ignore, by its index in the caller's mesh. All rays of the call ignore it: in a batch of
    /// rays that leave surfaces, set [`Ray::t_min`] of each instead.
    pub ignore: Option<u32>,
    /// Most bytes that the answer and its parts may take; `None` for no limit.
    pub max_memory: Option<u64>,
    /// Receives the number of rays that are done, and may cancel the batch; `None` for no watch.
    pub watch: Option<&'a dyn Watch>,
}

impl<'a> AllHitsOptions<'a> {
    /// The part of the settings that a traversal needs.
    pub fn query(&self) -> QueryOptions<'a> {
        let AllHitsOptions { culling, ignore, watch, .. } = *self;
        QueryOptions {
            accuracy: Accuracy::Exact,
            culling,
            ignore,
            watch,
            ..QueryOptions::default()
        }
    }
}

impl Default for AllHits {
    fn default() -> AllHits {
        AllHits::none()
    }
}

impl AllHits {
    /// The answer to no rays.
    pub fn none() -> AllHits {
        AllHits { starts: alloc::vec![0], crossings: Vec::new(), report: QueryReport::default() }
    }

    /// The answer to no rays, with capacity for this many.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] where the system has no memory for that.
    pub fn with_room(rays: usize) -> Result<AllHits, QueryError> {
        let mut starts = Vec::new();
        let length = rays.saturating_add(1);
        let bytes = length.saturating_mul(size_of::<usize>()) as u64;
        starts.try_reserve_exact(length).map_err(|_| refused(bytes))?;
        starts.push(0);
        Ok(AllHits { starts, crossings: Vec::new(), report: QueryReport::default() })
    }

    /// The crossings of rays, one ray at a time: the reference.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] and [`QueryError::Cancelled`].
    pub fn one_by_one(
        tree: &KdTreeView<'_>,
        triangles: &(impl Triangles + ?Sized),
        rays: &[Ray],
        options: &AllHitsOptions<'_>,
    ) -> Result<AllHits, QueryError> {
        let AllHitsOptions { max_memory, watch, .. } = *options;
        let total = rays.len() as u64;
        check_bytes((rays.len() * size_of::<usize>()) as u64, max_memory)?;
        let mut all = AllHits::with_room(rays.len())?;
        let mut collector = Collector::default();
        for (number, ray) in rays.iter().enumerate() {
            if number % BETWEEN == 0 {
                go_on_tracing(watch, number as u64, total)?;
            }
            let held = all.bytes();
            let mut ended = Ok(());
            collect(tree, triangles, ray, options, &mut collector, |bytes| {
                ended = check_bytes(held + bytes, max_memory)
                    .and_then(|()| go_on_tracing(watch, number as u64, total));
                ended.is_ok()
            });
            ended?;
            let grown = collector.growth(&all.crossings);
            check_bytes(held + collector.bytes() + grown, max_memory)?;
            let all_held = |error: QueryError| error.beside(held, max_memory);
            collector.finish(&mut all.crossings).map_err(all_held)?;
            all.starts.push(all.crossings.len());
        }
        go_on_tracing(watch, total, total)?;
        Ok(all)
    }

    /// The crossings of a ray of the batch, the nearest first.
    pub fn of(&self, ray: usize) -> &[Crossing] {
        &self.crossings[self.starts[ray]..self.starts[ray + 1]]
    }

    /// How many rays there are.
    pub fn rays(&self) -> usize {
        self.starts.len() - 1
    }

    /// Bytes that both lists hold, spare capacity included.
    pub fn bytes(&self) -> u64 {
        let starts = self.starts.capacity() * size_of::<usize>();
        (starts + self.crossings.capacity() * size_of::<Crossing>()) as u64
    }

    /// Appends the answers to more rays.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] where the system has no memory for both; nothing is added then.
    pub fn append(&mut self, more: AllHits) -> Result<(), QueryError> {
        let (bytes, rays) = (self.bytes() + more.bytes(), self.rays());
        self.starts.try_reserve(more.starts.len()).map_err(|_| refused(bytes))?;
        self.crossings.try_reserve(more.crossings.len()).map_err(|_| refused(bytes))?;
        self.report.append(more.report, rays)?;
        let first = self.crossings.len();
        self.starts.extend(more.starts.iter().skip(1).map(|start| first + start));
        self.crossings.extend(more.crossings);
        Ok(())
    }
}

/// Rays between two calls of the watch.
const BETWEEN: usize = 64;

/// The crossings of one ray between its limits, in order of (exact distance, triangle), added to `out`.
/// They are exact: see [`exact`](crate::exact). A ray through an edge or a
/// vertex crosses the surface there once, or not at all where the surface turns back.
///
/// `tree` must be valid (see [`tree::validate`](crate::tree::validate)).
///
/// # Errors
/// [`QueryError::OutOfMemory`] where the system has no memory for them; nothing is added then.
pub fn all_hits(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &AllHitsOptions<'_>,
    out: &mut Vec<Crossing>,
) -> Result<(), QueryError> {
    let mut collector = Collector::default();
    collect(tree, triangles, ray, options, &mut collector, |_| true);
    collector.finish(out)
}

/// Collects what a ray crosses; `go_on` is called as by [`Collector::test_while`].
fn collect(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &AllHitsOptions<'_>,
    collector: &mut Collector,
    mut go_on: impl FnMut(u64) -> bool,
) {
    exact::visit(tree, triangles, ray, &options.query(), &mut (), |ray, corners, triangle| {
        collector.test_while(ray, corners, triangle, options.culling, &mut go_on)
    });
}

/// Collects the crossings of one ray from the triangles of the leaves it passes.
#[derive(Clone, Debug, Default)]
pub struct Collector {
    found: Vec<(Meeting, u32)>,
    tests: u32,
    ended: bool,
    /// Whether the system refused memory.
    refused: bool,
}

impl Collector {
    /// Tests between two checks for cancellation.
    pub(crate) const TESTS: u32 = 512;

    /// Tests a triangle ([snapped corners](crate::triangle::prepare)), which may come more than once. Every few hundred
    /// triangles, and before it takes more memory, checks whether to continue with this many bytes
    /// held. Returns the `t` beyond which no triangle is of interest: none at all after a
    /// cancellation, or where the system has no more memory, until [`Collector::finish`].
    #[inline]
    pub fn test_while(
        &mut self,
        ray: &ExactRay,
        corners: &Triangle,
        triangle: u32,
        culling: Culling,
        go_on: &mut impl FnMut(u64) -> bool,
    ) -> f64 {
        if self.ended {
            return f64::NEG_INFINITY;
        }
        if let Some(met) = cross(ray, corners, culling)
            && met.is_within_limits()
        {
            match make_room(&mut self.found, each_once, go_on) {
                Ok(true) => self.found.push((met, triangle)),
                Ok(false) => self.ended = true,
                Err(_) => (self.ended, self.refused) = (true, true),
            }
        }
        self.tests = self.tests.wrapping_add(1);
        if !self.ended && self.tests.is_multiple_of(Self::TESTS) {
            self.ended = !go_on(self.bytes());
        }
        if self.ended { f64::NEG_INFINITY } else { f64::INFINITY }
    }

    /// Bytes that it holds.
    pub fn bytes(&self) -> u64 {
        (self.found.capacity() * size_of::<(Meeting, u32)>()) as u64
    }

    /// Further bytes that `out` needs when this is added to it.
    pub fn growth(&self, out: &Vec<Crossing>) -> u64 {
        growth(out, self.found.len())
    }

    /// Adds what was found to `out`, each triangle once and in order, and is ready for another ray.
    /// Adds nothing after a cancellation.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] where the system has no memory for what was found, or ran out of
    /// it during the tests; adds nothing then. The bytes are those held here, and those that `out`
    /// would take.
    pub fn finish(&mut self, out: &mut Vec<Crossing>) -> Result<(), QueryError> {
        let (ended, was_refused) = (self.ended, self.refused);
        (self.ended, self.refused) = (false, false);
        if ended {
            self.found.clear();
            return if was_refused { Err(refused(self.bytes())) } else { Ok(()) };
        }
        each_once(&mut self.found);
        if out.try_reserve(self.found.len()).is_err() {
            let bytes = self.bytes() + self.growth(out);
            self.found.clear();
            return Err(refused(bytes));
        }
        // In place: a stable sort would take memory that is not counted.
        self.found
            .sort_unstable_by(|(a, first), (b, second)| a.compare_t(b).then(first.cmp(second)));
        let crossing = |(met, triangle): (Meeting, u32)| Crossing {
            hit: met.hit(triangle),
            front: met.is_front(),
        };
        out.extend(self.found.drain(..).map(crossing));
        Ok(())
    }
}

/// Further bytes that a list needs when this many items are added.
fn growth<T>(list: &Vec<T>, items: usize) -> u64 {
    let length = list.len() + items;
    if length <= list.capacity() {
        return 0;
    }
    // Until the old memory is freed both are held.
    (length.max(2 * list.capacity()) * size_of::<T>()) as u64
}

/// Each triangle once, in the order of their indices.
fn each_once(found: &mut Vec<(Meeting, u32)>) {
    found.sort_unstable_by_key(|&(_, triangle)| triangle);
    found.dedup_by_key(|&mut (_, triangle)| triangle);
}

/// Makes space for one more: by removing duplicates, or, if more than half remains, by doubling the
/// capacity, if `go_on` accepts that many bytes. Returns false if it does not.
///
/// # Errors
/// The system has no memory for twice the capacity.
pub(crate) fn make_room<T>(
    list: &mut Vec<T>,
    each_once: impl FnOnce(&mut Vec<T>),
    go_on: &mut impl FnMut(u64) -> bool,
) -> Result<bool, TryReserveError> {
    let room = list.capacity();
    if list.len() < room {
        return Ok(true);
    }
    each_once(list);
    if list.len() < room.div_ceil(2) {
        return Ok(true);
    }
    let more = (2 * room).max(32);
    // Until the old memory is freed both are held.
    if !go_on(((room + more) * size_of::<T>()) as u64) {
        return Ok(false);
    }
    list.try_reserve_exact(more - list.len())?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_grows_by_what_it_needs_and_at_least_doubles() {
        let mut list: Vec<u32> = Vec::with_capacity(8);
        let room = list.capacity();
        list.resize(room, 0);
        assert_eq!(growth(&list, 0), 0);
        assert_eq!(growth(&list, 1), 4 * 2 * room as u64);
        assert_eq!(growth(&list, 5 * room), 4 * 6 * room as u64);
        list.pop();
        assert_eq!(growth(&list, 1), 0);
        assert_eq!(growth(&list, 2), 4 * 2 * room as u64);
    }
}
