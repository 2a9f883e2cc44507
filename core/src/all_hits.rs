//! All hits of a ray, in order, each crossing of a surface once.

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

    /// The crossings of rays, one ray after the other: the reference. Without a limit of memory.
    pub fn one_by_one(
        tree: &KdTreeView<'_>,
        triangles: &(impl Triangles + ?Sized),
        rays: &[Ray],
        options: &QueryOptions,
    ) -> AllHits {
        let options = QueryOptions { max_memory: None, ..*options };
        // Without a limit and a watch nothing ends it.
        AllHits::one_by_one_watched(tree, triangles, rays, &options, &()).unwrap_or_default()
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
        let mut all = AllHits::none();
        let mut collector = Collector::default();
        for (number, ray) in rays.iter().enumerate() {
            if number % BETWEEN == 0 {
                go_on_tracing(watch, number as u64, total)?;
            }
            let held = all.bytes();
            let mut ended = Ok(());
            collect(tree, triangles, ray, options, &mut collector, |collector| {
                ended = collector
                    .check_memory(held, options)
                    .and_then(|()| go_on_tracing(watch, number as u64, total));
                ended.is_ok()
            });
            ended?;
            collector.finish(&mut all.crossings);
            all.starts.push(all.crossings.len());
            check_bytes(all.bytes(), options)?;
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

    /// Bytes of both lists.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.starts[..]) + size_of_val(&self.crossings[..])) as u64
    }

    /// Adds the answers to more rays behind those to the rays so far.
    pub fn append(&mut self, more: AllHits) {
        let first = self.crossings.len();
        self.starts.extend(more.starts.iter().skip(1).map(|start| first + start));
        self.crossings.extend(more.crossings);
        self.answered_by_cpu += more.answered_by_cpu;
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

/// The crossings of one ray between its limits, in order of (exact distance, triangle), added to `out`.
/// They are exact whatever accuracy the options name: see [`crate::exact`]. A ray through an edge or a
/// vertex crosses the surface there once, or not at all where the surface turns back.
///
/// `tree` must be valid (see [`crate::validate`]).
pub fn all_hits(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &QueryOptions,
    out: &mut Vec<Crossing>,
) {
    let mut collector = Collector::default();
    collect(tree, triangles, ray, options, &mut collector, |_| true);
    collector.finish(out);
}

/// Collects what a ray crosses; `go_on` is asked every few hundred triangles.
fn collect(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &QueryOptions,
    collector: &mut Collector,
    mut go_on: impl FnMut(&mut Collector) -> bool,
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
}

impl Collector {
    /// Tests between two questions whether to go on.
    const TESTS: u32 = 512;

    /// Tests a triangle (snapped corners), which may come more than once.
    #[inline]
    pub fn test(&mut self, ray: &ExactRay, corners: &Triangle, triangle: u32, culling: Culling) {
        if let Some(met) = cross(ray, corners, culling)
            && met.is_within_limits()
        {
            self.found.push((met, triangle));
        }
    }

    /// As [`Collector::test`], asking every few hundred triangles whether to go on. Gives the `t` beyond which
    /// no triangle is of interest: none at all after a no, until [`Collector::finish`].
    #[inline]
    pub fn test_while(
        &mut self,
        ray: &ExactRay,
        corners: &Triangle,
        triangle: u32,
        culling: Culling,
        go_on: &mut impl FnMut(&mut Collector) -> bool,
    ) -> f64 {
        if self.ended {
            return f64::NEG_INFINITY;
        }
        self.test(ray, corners, triangle, culling);
        self.tests += 1;
        if self.tests.is_multiple_of(Self::TESTS) && !go_on(self) {
            self.ended = true;
            return f64::NEG_INFINITY;
        }
        f64::INFINITY
    }

    /// Whether what was found fits besides `held` bytes.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`].
    pub fn check_memory(&mut self, held: u64, options: &QueryOptions) -> Result<(), QueryError> {
        let bytes = |found: &[(Meeting, u32)]| held + size_of_val(found) as u64;
        if options.max_memory.is_some_and(|limit| bytes(&self.found) > limit) {
            self.compact();
        }
        check_bytes(bytes(&self.found), options)
    }

    /// Each triangle once, in the order of their indices.
    fn compact(&mut self) {
        self.found.sort_unstable_by_key(|&(_, triangle)| triangle);
        self.found.dedup_by_key(|&mut (_, triangle)| triangle);
    }

    /// Adds what was found to `out`, each triangle once and in order, and is ready for another ray.
    pub fn finish(&mut self, out: &mut Vec<Crossing>) {
        self.compact();
        // Stable: equal distances stay in order of their triangles.
        self.found.sort_by(|(a, _), (b, _)| a.compare_t(b));
        let crossing = |(met, triangle): (Meeting, u32)| Crossing {
            hit: met.hit(triangle),
            front: met.is_front(),
        };
        out.extend(self.found.drain(..).map(crossing));
        self.ended = false;
    }
}
