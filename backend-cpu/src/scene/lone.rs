//! A scene of one instance: its rays go into its space, and the mesh's own batch answers them, in packets and in turn as it does for a mesh by itself.
//! An instance in place is in the world's space: its rays stay as they are.
//!
//! That is what all instances give, one after the other, where there is one. No tree over instances is asked, and a ray that misses the box costs what it costs the mesh.

use std::sync::{Mutex, PoisonError};

use splitplane_core::backend::scene::{
    Asked, BuiltGeometry, BuiltScene, SceneAnswer, limit_within,
};
use splitplane_core::error::{QueryError, refused};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, Hit, Ray};
use splitplane_core::scene::{
    IDENTITY, InstanceId, Placement, SceneHit, SceneOptions, SceneReport, TOP_INSTANCE, TOP_NONE,
    TopNode, TopRay,
};
use splitplane_core::watch::Stage;

use super::batch::{BLOCK, WATCHED_BLOCK};
use super::parts::all_count;
use super::seen::WorldRay;
use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};
use crate::parallel::{Parallel, ParallelSlice};

/// Whether such scenes have a way of their own. A page would have to load it: there they do not.
pub(super) const LONE_SERVED: bool = !cfg!(target_family = "wasm");

/// The only instance of a scene, of a mesh.
#[derive(Clone, Copy)]
pub(super) struct Lone<'a> {
    built: &'a BuiltGeometry,
    name: InstanceId,
    placement: &'a Placement,
    options: &'a SceneOptions<'a>,
}

/// Rays of a block as the mesh sees them, and its answers, kept from block to block.
#[derive(Default)]
struct Seen {
    rays: Vec<Ray>,
    hits: Vec<Hit>,
    any: Vec<bool>,
}

impl<'a> Lone<'a> {
    /// `None` where a scene is another, and where hits may depend on which instances a ray enters or not all of them count.
    pub(super) fn of(scene: &'a BuiltScene, options: &'a SceneOptions<'a>) -> Option<Lone<'a>> {
        let name = only_one(scene.top_tree().nodes())?;
        let placement = scene.placement(name)?;
        if options.accuracy == Accuracy::Fast || !all_count(scene, options) {
            return None;
        }
        let built = scene.geometry(placement.instance.geometry)?;
        built.shapes().is_none().then_some(Lone { built, name, placement, options })
    }

    /// Answers rays, on all threads.
    ///
    /// # Errors
    /// The watch ends it, or no memory.
    pub(super) fn answer<T: SceneAnswer>(
        &self,
        rays: &[Ray],
        answers: &mut [T],
    ) -> Result<SceneReport, QueryError> {
        let meter = &ProgressMeter::of(self.options.watch);
        meter.begin_stage(Stage::Rays, rays.len() as u64);
        let size = if meter.is_watched() { WATCHED_BLOCK } else { BLOCK };
        let blocks = rays.par_chunks(size).zip(answers.par_chunks_mut(size));
        // Buffers of blocks that are done, one a running thread, for the next blocks.
        let kept: Mutex<Vec<Seen>> = Mutex::new(Vec::new());
        let kept = || kept.lock().unwrap_or_else(PoisonError::into_inner);
        let of_block = |(rays, answers): (&[Ray], &mut [T])| {
            meter.check_batch()?;
            let mut seen = kept().pop().unwrap_or_default();
            let report = self.answer_block(&mut seen, rays, answers)?;
            kept().push(seen);
            meter.advance(rays.len() as u64);
            meter.record_work(WORK_BETWEEN_CHECKS);
            Ok(report)
        };
        let report = blocks.try_reduce(SceneReport::default(), of_block, SceneReport::add)?;
        meter.finish_stage();
        meter.check_batch().map(|()| report)
    }

    fn answer_block<T: SceneAnswer>(
        &self,
        seen: &mut Seen,
        rays: &[Ray],
        answers: &mut [T],
    ) -> Result<SceneReport, QueryError> {
        let (placement, name, mut report) = (self.placement, self.name, SceneReport::default());
        let Some(asked) = Asked::of(name, placement, self.options) else {
            answers.fill(T::NONE);
            return Ok(report);
        };
        let query = &self.options.of_geometry(asked.culling, asked.ignore, None);
        let Seen { rays: own, hits, any } = seen;
        let (rays, entered) = if placement.space.inverse == IDENTITY {
            (rays, rays.iter().filter(|ray| TopRay::new(ray).is_some()).count() as u64)
        } else {
            look(placement, rays, own)?
        };
        (report.entered, report.batches) = (entered, 1);
        let (mesh, count) = (self.built.accelerator(), rays.len());
        let found = match T::QUERY {
            Query::Any => {
                let any = at_least(any, count, false)?;
                let found = mesh.any_hits(rays, any, query)?;
                for (answer, any) in answers.iter_mut().zip(any) {
                    *answer = T::NONE;
                    if *any {
                        answer.take(SceneHit::MISS);
                    }
                }
                found
            }
            Query::Closest => {
                let hits = at_least(hits, count, Hit::MISS)?;
                let found = mesh.closest_hits(rays, hits, query)?;
                let geometry = placement.instance.geometry;
                for (answer, hit) in answers.iter_mut().zip(hits) {
                    *answer = T::NONE;
                    answer.take(SceneHit::of(hit, geometry, name));
                }
                found
            }
        };
        report.geometries.append(found, 0)?;
        Ok(report)
    }
}

/// The only instance that there is in a tree over instances. Names before and behind may be free, as they are where instances went or were baked.
fn only_one(nodes: &[TopNode]) -> Option<InstanceId> {
    let [root] = nodes else { return None };
    let mut children = root.children.iter().filter(|child| **child != TOP_NONE);
    let (child, None) = (children.next()?, children.next()) else { return None };
    (child & TOP_INSTANCE != 0).then_some(InstanceId(child & !TOP_INSTANCE))
}

/// As many elements, some of them from before.
fn at_least<T: Copy>(list: &mut Vec<T>, count: usize, new: T) -> Result<&mut [T], QueryError> {
    let more = count.saturating_sub(list.len());
    list.try_reserve(more).map_err(|_| refused((more * size_of::<T>()) as u64))?;
    list.resize(list.len() + more, new);
    Ok(&mut list[..count])
}

/// Rays as the instance sees them, and how many there are that can hit anything.
fn look<'a>(
    placement: &Placement,
    rays: &[Ray],
    seen: &'a mut Vec<Ray>,
) -> Result<(&'a [Ray], u64), QueryError> {
    /// No `t` is between its limits.
    const NONE: Ray = Ray { origin: [0.0; 3], t_min: 1.0, direction: [0.0, 0.0, 1.0], t_max: 0.0 };
    seen.clear();
    seen.try_reserve(rays.len()).map_err(|_| refused(size_of_val(rays) as u64))?;
    let mut entered = 0;
    for ray in rays {
        let own = if TopRay::new(ray).is_some() {
            entered += 1;
            let limits = [ray.t_min, limit_within(ray, &SceneHit::MISS)];
            WorldRay::new(ray).seen_by(placement, limits).ray()
        } else {
            NONE
        };
        seen.push(own);
    }
    Ok((seen, entered))
}
