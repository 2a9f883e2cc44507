//! The built tree, ready for rays.

mod all_hits;
mod casts;
mod closest_points;
mod overlaps;
mod task_bytes;
mod windings;

use core::any::Any;
use core::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::collections::TryReserveError;
use std::time::Duration;

use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Accelerator, QueryLayout};
use splitplane_core::error::{BuildError, QueryError, refused};
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions};
use splitplane_core::query::cast::{Cast, CastOptions, Impact};
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions};
use splitplane_core::query::inside::{LocateOptions, Located};
use splitplane_core::query::intersect::{Limits, SceneScale};
use splitplane_core::query::overlap::{OverlapOptions, Overlaps, Volume};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray, Rays};
use splitplane_core::report::{BuildSummary, QueryReport};
use splitplane_core::tree::{KdTree, KdTreeView};
use splitplane_core::triangle::Triangle;
use splitplane_core::watch::Stage;

use crate::cancel::{ProgressMeter, UNWATCHED, WORK_BETWEEN_CHECKS};
use crate::clock::Stopwatch;
use crate::layout::limits;
use crate::layout::scratch::{LayoutScratch, LayoutSource};
use crate::layout::tree_layout::TreeLayout;
use crate::memory::Memory;
use crate::parallel::{Parallel, ParallelSlice};
use crate::simd::InstructionSet;
use crate::span;
use crate::trace::batch::{Answers, RayBatch};
use crate::trace::single::Single;
use crate::trace::stream::Stream;

/// Rays of one task: what one thread takes at a time.
const TASK: usize = 4096;
/// No more rays than this are traced one by one where that is the quicker way: to make lanes ready for many takes as long as some 8 to 16 rays do.
const ALONE: usize = 12;
/// Initial number of rays between two calls of the watch.
const FIRST: usize = 16;
/// With a watch, a part that takes longer is followed by one of half as many rays, one that takes
/// half of it by one of twice as many. Without a clock all parts stay as short as the first.
const TOO_LONG: Duration = Duration::from_millis(2);

/// A tree over a mesh on the CPU.
#[derive(Debug)]
pub struct CpuAccelerator {
    summary: BuildSummary,
    scene: SceneScale,
    layout: TreeLayout,
    set: InstructionSet,
}

impl CpuAccelerator {
    /// Capacity of tree and layout in bytes, for a limit that this and another one must keep
    /// together.
    pub(crate) fn bytes(&self) -> u64 {
        self.layout.held()
    }

    /// Makes the query layout of a valid tree; `set` must be one that the processor has. After
    /// cancellation it is incomplete and must not be used. `memory` accounts for the layout, and for what the scratch grows by.
    ///
    /// # Errors
    /// As for [`TreeLayout::new`].
    pub(crate) fn new(
        tree: KdTree,
        mut summary: BuildSummary,
        source: LayoutSource<'_>,
        set: InstructionSet,
        meter: &ProgressMeter<'_>,
        (memory, scratch): (&mut Memory, &mut LayoutScratch),
    ) -> Result<CpuAccelerator, BuildError> {
        let scene = scene_scale(tree.bounds, set, source.triangles, meter);
        let layout = TreeLayout::new(tree, source, set, meter, memory, scratch)?;
        summary.peak_bytes = memory.peak;
        Ok(CpuAccelerator { summary, scene, layout, set })
    }

    /// Becomes the accelerator of another valid tree, in the same memory. After an error it is what it was.
    ///
    /// # Errors
    /// As for [`TreeLayout::replace`].
    pub(crate) fn replace(
        &mut self,
        tree: &KdTreeView<'_>,
        mut summary: BuildSummary,
        source: LayoutSource<'_>,
        (memory, scratch): (&mut Memory, &mut LayoutScratch),
    ) -> Result<(), BuildError> {
        self.layout.replace(tree, source, memory, scratch)?;
        self.scene = scene_scale(tree.bounds, self.set, source.triangles, &UNWATCHED);
        summary.peak_bytes = memory.peak;
        self.summary = summary;
        Ok(())
    }

    /// The layout that was asked for.
    pub fn layout(&self) -> QueryLayout {
        self.layout.layout()
    }

    /// What rays are traced through.
    pub(crate) fn parts(&self) -> (&TreeLayout, &SceneScale) {
        (&self.layout, &self.scene)
    }

    /// The instruction set of queries.
    pub fn instruction_set(&self) -> InstructionSet {
        self.set
    }

    /// The scale that the reference traversal needs for the same answers.
    pub fn scene_scale(&self) -> &SceneScale {
        &self.scene
    }

    /// The hits of a batch with one ray after the other, for comparing with the batch path.
    ///
    /// # Errors
    /// `rays` and `hits` of different length.
    pub fn closest_hits_singly(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        check(rays.len(), hits.len())?;
        rays.par_chunks(TASK).zip(hits.par_chunks_mut(TASK)).for_each(|(rays, hits)| {
            for (ray, hit) in rays.iter().zip(hits) {
                *hit = self.trace(ray, options, Query::Closest);
            }
        });
        Ok(QueryReport::default())
    }

    /// Whether rays hit anything, one ray after the other.
    ///
    /// # Errors
    /// `rays` and `occluded` of different length.
    pub fn any_hits_singly(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        check(rays.len(), occluded.len())?;
        rays.par_chunks(TASK).zip(occluded.par_chunks_mut(TASK)).for_each(|(rays, occluded)| {
            for (ray, occluded) in rays.iter().zip(occluded) {
                *occluded = self.trace(ray, options, Query::Any).is_hit();
            }
        });
        Ok(QueryReport::default())
    }

    fn trace(&self, ray: &Ray, options: &QueryOptions<'_>, query: Query) -> Hit {
        let (layout, scene) = (&self.layout, &self.scene);
        // SAFETY: `set` was detected on this processor, and the layout made for it.
        unsafe { self.set.run(Single { layout, scene, ray, options, query }) }
    }

    /// Answers a batch.
    fn answer<T: Answer>(
        &self,
        rays: Rays<'_>,
        answers: &mut [T],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let meter = &ProgressMeter::of(options.watch);
        check(rays.len(), answers.len())?;
        meter.begin_stage(Stage::Rays, rays.len() as u64);
        let (layout, scene) = (&self.layout, &self.scene);
        // The case that single rays have a way of their own for.
        let usual =
            options.accuracy == Accuracy::Watertight && layout.layout() == QueryLayout::Fast;
        // How slow rays are shows only as they are traced.
        let count = AtomicUsize::new(if meter.is_watched() { FIRST } else { TASK });
        let answer_task = |(task, answers): (usize, &mut [T])| {
            let rays = rays.part(task * TASK..task * TASK + answers.len());
            let mut next = 0;
            while next < rays.len() && !meter.is_cancelled() {
                let few = count.load(Relaxed);
                let some = next..rays.len().min(next + few);
                let stopwatch = meter.is_watched().then(Stopwatch::start);
                let rays = rays.part(some.clone());
                let batch = RayBatch { layout, scene, rays, options, query: T::QUERY };
                let mut answers = T::answers(&mut answers[some.clone()]);
                if usual && some.len() <= ALONE {
                    for index in 0..some.len() {
                        answers.set(index, self.trace(&rays.ray(index), options, T::QUERY));
                    }
                } else {
                    // SAFETY: as for one ray.
                    unsafe { self.set.run(Stream { batch, answers }) }?;
                }
                match stopwatch.and_then(|stopwatch| stopwatch.elapsed()) {
                    Some(took) if took > TOO_LONG => count.store((few / 2).max(1), Relaxed),
                    Some(took) if took < TOO_LONG / 2 => {
                        count.store((few * 2).min(TASK), Relaxed);
                    }
                    _ => {}
                }
                meter.advance(some.len() as u64);
                meter.record_work(WORK_BETWEEN_CHECKS);
                next = some.end;
            }
            Ok::<(), TryReserveError>(())
        };
        // One task is done where it is asked for: to wake another thread takes as long as many rays.
        let done = if answers.len() <= TASK {
            answer_task((0, answers))
        } else {
            answers.par_chunks_mut(TASK).enumerate().try_for_each(answer_task)
        };
        // An estimate for the stacks of a thread.
        done.map_err(|_| refused((2 * layout.wide.stack() * size_of::<u32>()) as u64))?;
        meter.finish_stage();
        meter.check_batch().map(|()| QueryReport::default())
    }
}

/// What a query answers for each ray of a batch.
trait Answer: Send + Sized {
    /// The query that it answers.
    const QUERY: Query;

    /// The answers as [`Answers`], to be written.
    fn answers(answers: &mut [Self]) -> Answers<'_>;
}

impl Answer for Hit {
    const QUERY: Query = Query::Closest;

    fn answers(answers: &mut [Hit]) -> Answers<'_> {
        Answers::Hits(answers)
    }
}

impl Answer for bool {
    const QUERY: Query = Query::Any;

    fn answers(answers: &mut [bool]) -> Answers<'_> {
        Answers::Any(answers)
    }
}

/// What queries need to know of all triangles. Dropped triangles are ignored.
fn scene_scale(
    bounds: Aabb,
    set: InstructionSet,
    triangles: &[Triangle],
    meter: &ProgressMeter<'_>,
) -> SceneScale {
    let _loop = span::pieces_of(1);
    let of_chunk = |chunk: &[Triangle]| {
        let _piece = span::piece();
        if meter.record_work(chunk.len() as u64) { Limits::NONE } else { limits::of(set, chunk) }
    };
    let join = |all: &mut Limits, some| *all = all.union(some);
    SceneScale::new(bounds, &triangles.par_chunks(4096).reduce(Limits::NONE, of_chunk, join))
}

fn check(rays: usize, results: usize) -> Result<(), QueryError> {
    if rays == results { Ok(()) } else { Err(QueryError::LengthMismatch { rays, results }) }
}

impl Accelerator for CpuAccelerator {
    fn tree(&self) -> &KdTree {
        &self.layout.tree
    }

    fn summary(&self) -> &BuildSummary {
        &self.summary
    }

    fn query_bytes(&self) -> u64 {
        self.layout.bytes()
    }

    fn held_bytes(&self) -> u64 {
        self.layout.held()
    }

    /// Calls the watch about every two milliseconds, from one thread at a time, and never within a
    /// ray.
    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.answer(Rays::Records(rays), hits, options)
    }

    /// Calls the watch about every two milliseconds, from one thread at a time, and never within a
    /// ray.
    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.answer(Rays::Records(rays), occluded, options)
    }

    fn closest_hits_of(
        &self,
        rays: Rays<'_>,
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.answer(rays, hits, options)
    }

    fn any_hits_of(
        &self,
        rays: Rays<'_>,
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.answer(rays, occluded, options)
    }

    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError> {
        self.find_all_hits(rays, options)
    }

    fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        self.find_windings(points, options)
    }

    fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [ClosestPoint],
        options: &ClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.find_closest_points(points, closest, options)
    }

    fn impacts(
        &self,
        casts: &[Cast],
        impacts: &mut [Impact],
        options: &CastOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.find_impacts(casts, impacts, options)
    }

    fn overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &OverlapOptions<'_>,
    ) -> Result<Overlaps, QueryError> {
        self.find_overlaps(volumes, options)
    }

    fn overlaps_any(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &OverlapOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.find_any_overlaps(volumes, found, options)
    }

    fn as_any_mut(&mut self) -> Option<&mut dyn Any> {
        Some(self)
    }

    fn as_any(&self) -> Option<&dyn Any> {
        Some(self)
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        self.trace(ray, options, Query::Closest).some()
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        self.trace(ray, options, Query::Any).is_hit()
    }
}
