//! Scenes on all threads: blocks of rays, each answered by one thread with memory that it keeps.

use std::cell::RefCell;
use std::ops::ControlFlow;

use splitplane_core::backend::BuildOptions;
use splitplane_core::backend::scene::{
    Block, BlockScratch, BuildGeometry, BuiltScene, SceneAccelerator, SceneAllHits,
    SceneAllHitsOptions, SceneAnswer, SceneClosestPoint, SceneClosestPointOptions,
    SceneOverlapOptions, SceneOverlaps, UpdateReport,
};
use splitplane_core::error::{QueryError, refused};
use splitplane_core::query::closest_point::check_lengths;
use splitplane_core::query::inside::{LocateOptions, Located};
use splitplane_core::query::overlap::Volume;
use splitplane_core::ray::{Accuracy, Ray};
use splitplane_core::report::QueryReport;
use splitplane_core::scene::{Scene, SceneBuildError, SceneHit, SceneOptions, SceneReport};
use splitplane_core::watch::{Progress, Stage, Watch};
use splitplane_float_state::Standard;

use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};
use crate::near::in_order::{Division, answer_in_order};
use crate::parallel::{Parallel, ParallelSlice};
use crate::simd::InstructionSet;

mod batch;
mod choose;
mod counting;
mod found;
mod in_turn;
mod lone;
mod overlaps;
mod parts;
mod seen;
mod single;
mod stream;
mod together;
mod top_walk;
mod turn_ray;
mod way;

use batch::{BLOCK, SceneBatch, WATCHED_BLOCK};
use lone::{LONE_SERVED, Lone};
use parts::{Geometries, Kind};
use single::{Followed, SceneSingle};
use top_walk::VectorWalker;

/// Fewer rays in a geometry are traced one at a time.
const SINGLY_BELOW: usize = 3;

/// A scene on the CPU.
pub struct CpuScene {
    built: BuiltScene,
    set: InstructionSet,
    /// What all geometries have in common; `None` where rays cannot be followed through them.
    kind: Option<Kind>,
}

thread_local! {
    static SCRATCH: RefCell<Option<Box<BlockScratch>>> = const { RefCell::new(None) };
}

impl CpuScene {
    /// Builds a scene; `set` must be one that the processor has.
    ///
    /// # Errors
    /// As for [`BuiltScene::build`].
    pub(crate) fn build(
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
        set: InstructionSet,
    ) -> Result<CpuScene, SceneBuildError> {
        let _state = Standard::set();
        let built = BuiltScene::build(scene, options, build)?;
        let kind = Kind::of(&built, set);
        Ok(CpuScene { built, set, kind })
    }

    /// The answer to one ray.
    fn answer_one<T: SceneAnswer>(&self, ray: &Ray, options: &SceneOptions<'_>) -> T {
        let _state = Standard::set();
        let single = SceneSingle { scene: &self.built, ray, options, set: self.set };
        // SAFETY: the set is one of this processor's.
        if let Followed::Answer(answer) = unsafe { single.follow() } {
            return answer;
        }
        self.built.answer_one(ray, options)
    }

    /// Follows rays from instance to instance.
    fn follow<T: SceneAnswer>(
        &self,
        geometries: &Geometries<'_>,
        rays: &[Ray],
        answers: &mut [T],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        let meter = &ProgressMeter::of(options.watch);
        meter.begin_stage(Stage::Rays, rays.len() as u64);
        let size = if meter.is_watched() { WATCHED_BLOCK } else { BLOCK };
        let blocks = rays.par_chunks(size).zip(answers.par_chunks_mut(size));
        let of_block = |(rays, answers): (&[Ray], &mut [T])| {
            meter.check_batch()?;
            let scene = &self.built;
            let batch = SceneBatch { scene, geometries, rays, answers, options };
            // SAFETY: the set is one of this processor's; geometries were made for it.
            let followed = unsafe { self.set.run(batch) };
            let work = followed.map_err(|_| refused((16 * geometries.stack * 8) as u64))?;
            meter.advance(rays.len() as u64);
            meter.record_work(WORK_BETWEEN_CHECKS);
            Ok::<_, QueryError>([work.entered, work.rejected])
        };
        let [entered, rejected] = blocks.try_reduce([0; 2], of_block, |all, some| {
            *all = [all[0] + some[0], all[1] + some[1]];
            Ok(())
        })?;
        meter.finish_stage();
        meter.check_batch()?;
        let mut report = SceneReport::default();
        (report.entered, report.rejected) = (entered, rejected);
        Ok(report)
    }

    fn answer<T: SceneAnswer>(
        &self,
        rays: &[Ray],
        answers: &mut [T],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        let _state = Standard::set();
        check_lengths(rays.len(), answers.len())?;
        if LONE_SERVED && let Some(lone) = Lone::of(&self.built, options) {
            return lone.answer(rays, answers);
        }
        if options.accuracy != Accuracy::Exact
            && let Some(kind) = self.kind
        {
            let geometries = &Geometries::of(&self.built, self.set, kind, rays.len())?;
            return self.follow(geometries, rays, answers, options);
        }
        let meter = &ProgressMeter::of(options.watch);
        meter.begin_stage(Stage::Rays, rays.len() as u64);
        let size = if meter.is_watched() { WATCHED_BLOCK } else { BLOCK };
        let blocks = rays.par_chunks(size).zip(answers.par_chunks_mut(size));
        let of_block = |(rays, answers): (&[Ray], &mut [T])| {
            // Taken out, since a geometry's batch may run another block on this thread; `None` while the thread is being
            // destroyed.
            let kept = SCRATCH.try_with(RefCell::take).ok().flatten();
            let mut scratch = kept.unwrap_or_default();
            let block = Block {
                scene: &self.built,
                rays,
                options,
                watch: None,
                singly_below: SINGLY_BELOW,
            };
            let mut walker = VectorWalker { set: self.set, accuracy: options.accuracy };
            let part = block.answer(&mut walker, &mut scratch, answers, &mut || {
                meter.record_work(WORK_BETWEEN_CHECKS);
                meter.check_batch()
            });
            let _ = SCRATCH.try_with(|kept| kept.replace(Some(scratch)));
            let report = part?;
            meter.advance(rays.len() as u64);
            meter.record_work(WORK_BETWEEN_CHECKS);
            Ok(report)
        };
        let report = blocks.try_reduce(SceneReport::default(), of_block, SceneReport::add)?;
        meter.finish_stage();
        meter.check_batch().map(|()| report)
    }
}

impl SceneAccelerator for CpuScene {
    fn scene(&self) -> &BuiltScene {
        &self.built
    }

    fn update_by(
        &mut self,
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
    ) -> Result<UpdateReport, SceneBuildError> {
        let _state = Standard::set();
        let report = self.built.update(scene, options, build)?;
        if report.geometries_built > 0 || report.geometries_dropped > 0 {
            self.kind = Kind::of(&self.built, self.set);
        }
        Ok(report)
    }

    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [SceneHit],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        self.answer(rays, hits, options)
    }

    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        self.answer(rays, occluded, options)
    }

    fn closest_hit(&self, ray: &Ray, options: &SceneOptions<'_>) -> Option<SceneHit> {
        self.answer_one::<SceneHit>(ray, options).some()
    }

    fn any_hit(&self, ray: &Ray, options: &SceneOptions<'_>) -> bool {
        self.answer_one(ray, options)
    }

    /// Without a limit on all threads: with one, what several threads hold would depend on how many there are.
    fn all_hits(
        &self,
        rays: &[Ray],
        options: &SceneAllHitsOptions<'_>,
    ) -> Result<SceneAllHits, QueryError> {
        if options.max_memory.is_some() {
            let _state = Standard::set();
            return self.built.all_hits(rays, options);
        }
        let meter = &ProgressMeter::of(options.query.watch);
        let parts = rays.par_chunks(few(meter));
        let parts = self.in_parts(parts, rays.len(), meter, |rays, watch| {
            let query = SceneOptions { watch, ..options.query };
            self.built.all_hits(rays, &SceneAllHitsOptions { query, max_memory: None })
        })?;
        SceneAllHits::joined(parts)
    }

    /// A thread holds the crossings of one ray.
    fn count_hits(
        &self,
        rays: &[Ray],
        counts: &mut [u64],
        options: &SceneAllHitsOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        check_lengths(rays.len(), counts.len())?;
        let meter = &ProgressMeter::of(options.query.watch);
        let few = few(meter);
        let parts = rays.par_chunks(few).zip(counts.par_chunks_mut(few));
        let parts = self.in_parts(parts, rays.len(), meter, |(rays, counts), watch| {
            let query = SceneOptions { watch, ..options.query };
            self.built.count_hits(rays, counts, &SceneAllHitsOptions { query, ..*options })
        })?;
        let mut report = QueryReport::default();
        for (number, part) in parts.into_iter().enumerate() {
            report.append(part, number * few)?;
        }
        Ok(report)
    }

    /// Without a limit on all threads.
    fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        if options.max_memory.is_some() {
            let _state = Standard::set();
            return self.built.locate(points, options);
        }
        let meter = &ProgressMeter::of(options.watch);
        let parts = points.par_chunks(few(meter));
        let parts = self.in_parts(parts, points.len(), meter, |points, watch| {
            self.built.locate(points, &LocateOptions { watch, max_memory: None })
        })?;
        let mut all = Located::default();
        let bytes = refused(4 * points.len() as u64);
        all.windings.try_reserve_exact(points.len()).map_err(|_| bytes)?;
        for part in parts {
            let first = all.windings.len();
            all.windings.extend(part.windings);
            all.report.append(part.report, first)?;
        }
        Ok(all)
    }

    fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [SceneClosestPoint],
        options: &SceneClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        check_lengths(points.len(), closest.len())?;
        let meter = &ProgressMeter::of(options.watch);
        meter.begin_stage(Stage::Rays, points.len() as u64);
        let own = SceneClosestPointOptions { watch: None, ..*options };
        let parts = Division { task: FEW, few: if meter.is_watched() { 16 } else { FEW } };
        let none = SceneClosestPoint::NONE;
        answer_in_order(points, (closest, none), parts, meter, |points, closest| {
            self.built.closest_points(points, closest, &own).map(drop)
        })?;
        meter.finish_stage();
        meter.check_batch().map(|()| QueryReport::default())
    }

    fn overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<SceneOverlaps, QueryError> {
        self.find_overlaps(volumes, options)
    }

    fn overlaps_any(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<(), QueryError> {
        self.find_any_overlaps(volumes, found, options)
    }
}

/// Rays or points of one task of the queries that take long.
const FEW: usize = 256;
/// The same with a watch.
const WATCHED_FEW: usize = 64;

fn few(meter: &ProgressMeter<'_>) -> usize {
    if meter.is_watched() { WATCHED_FEW } else { FEW }
}

/// What a part of a batch tells of itself is work of the whole.
struct PartWatch<'a, 'w>(&'a ProgressMeter<'w>);

impl Watch for PartWatch<'_, '_> {
    fn progress(&self, _: &Progress) -> ControlFlow<()> {
        match self.0.record_work(WORK_OF_RAY) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }
}

/// What a ray or a point counts in one instance, so that the watch is called after some of them.
const WORK_OF_RAY: u64 = WORK_BETWEEN_CHECKS / 16;

impl CpuScene {
    /// The answers to the parts of a batch of `asked`, in order.
    fn in_parts<P: Parallel, R: Send>(
        &self,
        parts: P,
        asked: usize,
        meter: &ProgressMeter<'_>,
        ask: impl Fn(P::Part, Option<&dyn Watch>) -> Result<R, QueryError> + Sync,
    ) -> Result<Vec<R>, QueryError> {
        meter.begin_stage(Stage::Rays, asked as u64);
        let few = few(meter);
        let parts = parts.enumerate().try_collect(|(index, part)| {
            meter.check_batch()?;
            let watch = PartWatch(meter);
            let watch: Option<&dyn Watch> = if meter.is_watched() { Some(&watch) } else { None };
            let answer = ask(part, watch).map_err(|error| match error {
                // Of the whole, not of the part.
                QueryError::Cancelled { .. } => meter.check_batch().err().unwrap_or(error),
                error => error,
            })?;
            meter.advance(few.min(asked - index * few) as u64);
            Ok::<R, QueryError>(answer)
        })?;
        meter.finish_stage();
        meter.check_batch().map(|()| parts)
    }
}
