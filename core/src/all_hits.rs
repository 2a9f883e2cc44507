//! All hits of a ray, in order, each crossing of a surface once.

use alloc::collections::TryReserveError;
use alloc::vec::Vec;

use crate::backend::{QueryError, go_on_tracing};
use crate::exact::{ExactRay, Meeting, cross};
use crate::ray::{Culling, Hit, QueryOptions, Ray};
use crate::traverse::Triangles;
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
    /// Where the crossings of each ray begin, and behind the last one their number: one entry more
    /// than there are rays.
    pub starts: Vec<usize>,
    /// The crossings of all rays, one ray after the other, each ray's by (exact distance, triangle).
    pub crossings: Vec<Crossing>,
    /// Rays that the accelerator of a device answered on the CPU, from its copy of the tree: all of them,
    /// since no device finds all hits. 0 on the CPU, where nothing else was asked for.
    pub answered_by_cpu: u64,
}

impl Default for AllHits {
    fn default() -> AllHits {
        AllHits::none()
    }
}

impl AllHits {
    /// The answer to no rays.
    pub fn none() -> AllHits {
        AllHits { starts: alloc::vec![0], crossings: Vec::new(), answered_by_cpu: 0 }
    }

    /// The answer to no rays, with room for so many.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] where the system has no memory for that.
    pub fn with_room(rays: usize) -> Result<AllHits, QueryError> {
        let mut starts = Vec::new();
        let length = rays.saturating_add(1);
        let bytes = length.saturating_mul(size_of::<usize>()) as u64;
        starts.try_reserve_exact(length).map_err(|_| refused(bytes))?;
        starts.push(0);
        Ok(AllHits { starts, crossings: Vec::new(), answered_by_cpu: 0 })
    }

    /// The crossings of rays, one ray after the other: the reference. Without a limit of memory.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] where the system has no more memory.
    pub fn one_by_one(
        tree: &KdTreeView<'_>,
        triangles: &(impl Triangles + ?Sized),
        rays: &[Ray],
        options: &QueryOptions,
    ) -> Result<AllHits, QueryError> {
        let options = QueryOptions { max_memory: None, ..*options };
        AllHits::one_by_one_watched(tree, triangles, rays, &options, &())
    }

    /// The crossings of rays, one ray after the other, told to a watch.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] and [`QueryError::Cancelled`].
    pub fn one_by_one_watched(
        tree: &KdTreeView<'_>,
        triangles: &(impl Triangles + ?Sized),
        rays: &[Ray],
        options: &QueryOptions,
        watch: &dyn Watch,
    ) -> Result<AllHits, QueryError> {
        let total = rays.len() as u64;
        check_bytes((rays.len() * size_of::<usize>()) as u64, options)?;
        let mut all = AllHits::with_room(rays.len())?;
        let mut collector = Collector::default();
        for (number, ray) in rays.iter().enumerate() {
            if number % BETWEEN == 0 {
                go_on_tracing(watch, number as u64, total)?;
            }
            let held = all.bytes();
            let mut ended = Ok(());
            collect(tree, triangles, ray, options, &mut collector, |bytes| {
                ended = check_bytes(held + bytes, options)
                    .and_then(|()| go_on_tracing(watch, number as u64, total));
                ended.is_ok()
            });
            ended?;
            let grown = collector.growth(&all.crossings);
            check_bytes(held + collector.bytes() + grown, options)?;
            let all_held = |error: QueryError| error.beside(held, options.max_memory);
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

    /// Bytes that both lists hold, with their spare room.
    pub fn bytes(&self) -> u64 {
        let starts = self.starts.capacity() * size_of::<usize>();
        (starts + self.crossings.capacity() * size_of::<Crossing>()) as u64
    }

    /// Bytes that both lists will take besides what they hold when these answers are added.
    pub(crate) fn growth(&self, more: &AllHits) -> u64 {
        growth(&self.starts, more.rays()) + growth(&self.crossings, more.crossings.len())
    }

    /// Adds the answers to more rays behind those to the rays so far.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] where the system has no memory for both; nothing is added then.
    pub fn append(&mut self, more: AllHits) -> Result<(), QueryError> {
        let bytes = self.bytes() + more.bytes();
        self.starts.try_reserve(more.rays()).map_err(|_| refused(bytes))?;
        self.crossings.try_reserve(more.crossings.len()).map_err(|_| refused(bytes))?;
        let first = self.crossings.len();
        self.starts.extend(more.starts.iter().skip(1).map(|start| first + start));
        self.crossings.extend(more.crossings);
        self.answered_by_cpu += more.answered_by_cpu;
        Ok(())
    }
}

/// Rays between two looks at the watch.
const BETWEEN: usize = 64;

/// Refuses more bytes than the options allow.
///
/// # Errors
/// [`QueryError::OutOfMemory`].
#[inline]
pub fn check_bytes(needed: u64, options: &QueryOptions) -> Result<(), QueryError> {
    match options.max_memory {
        Some(limit) if needed > limit => Err(QueryError::OutOfMemory { needed, limit }),
        _ => Ok(()),
    }
}

/// The error where the system has less memory than the answers need: so many bytes are held or were asked for.
pub fn refused(bytes: u64) -> QueryError {
    QueryError::OutOfMemory { needed: bytes, limit: bytes }
}

/// The crossings of one ray between its limits, in order of (exact distance, triangle), added to `out`.
/// They are exact whatever accuracy the options name: see [`crate::exact`]. A ray through an edge or a
/// vertex crosses the surface there once, or not at all where the surface turns back.
///
/// `tree` must be valid (see [`crate::validate`]).
///
/// # Errors
/// [`QueryError::OutOfMemory`] where the system has no memory for them; nothing is added then.
pub fn all_hits(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &QueryOptions,
    out: &mut Vec<Crossing>,
) -> Result<(), QueryError> {
    let mut collector = Collector::default();
    collect(tree, triangles, ray, options, &mut collector, |_| true);
    collector.finish(out)
}

/// Collects what a ray crosses; `go_on` is asked as by [`Collector::test_while`].
fn collect(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &QueryOptions,
    collector: &mut Collector,
    mut go_on: impl FnMut(u64) -> bool,
) {
    crate::exact::visit(tree, triangles, ray, options, &mut (), |ray, corners, triangle| {
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
    /// Tests between two questions whether to go on.
    pub(crate) const TESTS: u32 = 512;

    /// Tests a triangle (snapped corners), which may come more than once. Every few hundred triangles, and before
    /// it takes more memory, asks whether to go on holding so many bytes. Gives the `t` beyond which no
    /// triangle is of interest: none at all after a no, or where the system has no more memory, until
    /// [`Collector::finish`].
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

    /// Bytes that `out` will take besides what it holds when this is added to it.
    pub fn growth(&self, out: &Vec<Crossing>) -> u64 {
        growth(out, self.found.len())
    }

    /// Adds what was found to `out`, each triangle once and in order, and is ready for another ray. After a no
    /// adds nothing.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] where the system has no memory for what was found, or had none for it on the
    /// way; adds nothing then. The bytes are those held here, and those that `out` would take.
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
        // In place: a stable sort would take memory that nobody counts.
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

/// Bytes that a list will take besides what it holds when so many items are added.
fn growth<T>(list: &Vec<T>, items: usize) -> u64 {
    let length = list.len() + items;
    if length <= list.capacity() {
        return 0;
    }
    // Until the old room is given back both are held.
    (length.max(2 * list.capacity()) * size_of::<T>()) as u64
}

/// Each triangle once, in the order of their indices.
fn each_once(found: &mut Vec<(Meeting, u32)>) {
    found.sort_unstable_by_key(|&(_, triangle)| triangle);
    found.dedup_by_key(|&mut (_, triangle)| triangle);
}

/// Makes room for one more: by leaving out what is there twice, or, where that leaves more than half, by
/// twice the room, if `go_on` agrees to so many bytes. False if it does not.
///
/// # Errors
/// The system has no memory for twice the room.
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
    // Until the old room is given back both are held.
    if !go_on(((room + more) * size_of::<T>()) as u64) {
        return Ok(false);
    }
    list.try_reserve_exact(more - list.len())?;
    Ok(true)
}
