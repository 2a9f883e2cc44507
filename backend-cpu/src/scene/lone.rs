//! A scene of one instance: its rays go into its space, and the mesh's own batch answers them, in packets and in turn as it does for a mesh by itself.
//!
//! That is what all instances give, one after the other, where there is one. No tree over instances is asked, and a ray that misses the box costs what it costs the mesh.

use rayon::prelude::*;
use splitplane_core::backend::scene::{
    Asked, BuiltGeometry, BuiltScene, SceneAnswer, limit_within,
};
use splitplane_core::error::{QueryError, refused};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::report::QueryReport;
use splitplane_core::scene::{InstanceId, Placement, SceneHit, SceneOptions, SceneReport, TopRay};
use splitplane_core::watch::Stage;

use super::batch::{BLOCK, WATCHED_BLOCK};
use super::parts::all_count;
use super::seen::WorldRay;
use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};

/// Whether such scenes have a way of their own. A page would have to load it: there they do not.
pub(super) const LONE_SERVED: bool = !cfg!(target_family = "wasm");

/// The only instance of a scene, of a mesh.
#[derive(Clone, Copy)]
pub(super) struct Lone<'a> {
    built: &'a BuiltGeometry,
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
        let [Some(placement)] = scene.all_placements() else { return None };
        if options.accuracy == Accuracy::Fast || !all_count(scene, options) {
            return None;
        }
        let built = scene.geometry(placement.instance.geometry)?;
        built.shapes().is_none().then_some(Lone { built, placement, options })
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
        let reports = blocks.map_init(Seen::default, |seen, (rays, answers)| {
            meter.check_batch()?;
            let report = self.answer_block(seen, rays, answers)?;
            meter.advance(rays.len() as u64);
            meter.record_work(WORK_BETWEEN_CHECKS);
            Ok::<SceneReport, QueryError>(report)
        });
        let report = reports.try_reduce(SceneReport::default, |mut one, other| {
            one.add(other)?;
            Ok(one)
        })?;
        meter.finish_stage();
        meter.check_batch().map(|()| report)
    }

    fn answer_block<T: SceneAnswer>(
        &self,
        seen: &mut Seen,
        rays: &[Ray],
        answers: &mut [T],
    ) -> Result<SceneReport, QueryError> {
        let (placement, name, mut report) = (self.placement, InstanceId(0), SceneReport::default());
        answers.fill(T::NONE);
        let Some(asked) = Asked::of(name, placement, self.options) else { return Ok(report) };
        let query = &self.options.of_geometry(asked.culling, asked.ignore, None);
        report.entered = seen.look(placement, rays)?;
        report.batches = 1;
        let found = self.answers_of(seen, query, T::QUERY)?;
        report.geometries.append(found, 0)?;
        if T::QUERY == Query::Any {
            for (answer, _) in answers.iter_mut().zip(&seen.any).filter(|(_, any)| **any) {
                answer.take(SceneHit::MISS);
            }
            return Ok(report);
        }
        let geometry = placement.instance.geometry;
        for (answer, hit) in answers.iter_mut().zip(&seen.hits).filter(|(_, hit)| hit.is_hit()) {
            answer.take(SceneHit::of(hit, geometry, name));
        }
        Ok(report)
    }

    /// The mesh's answers.
    fn answers_of(
        &self,
        Seen { rays, hits, any }: &mut Seen,
        query: &QueryOptions<'_>,
        asked: Query,
    ) -> Result<QueryReport, QueryError> {
        let (mesh, count) = (self.built.accelerator(), rays.len());
        match asked {
            Query::Any => {
                any.clear();
                any.try_reserve(count).map_err(|_| refused(count as u64))?;
                any.resize(count, false);
                mesh.any_hits(rays, any, query)
            }
            Query::Closest => {
                hits.clear();
                let bytes = (count * size_of::<Hit>()) as u64;
                hits.try_reserve(count).map_err(|_| refused(bytes))?;
                hits.resize(count, Hit::MISS);
                mesh.closest_hits(rays, hits, query)
            }
        }
    }
}

impl Seen {
    /// Looks at rays as the instance does. Returns how many there are that can hit anything.
    fn look(&mut self, placement: &Placement, rays: &[Ray]) -> Result<u64, QueryError> {
        /// No `t` is between its limits.
        const NONE: Ray =
            Ray { origin: [0.0; 3], t_min: 1.0, direction: [0.0, 0.0, 1.0], t_max: 0.0 };
        self.rays.clear();
        let bytes = size_of_val(rays) as u64;
        self.rays.try_reserve(rays.len()).map_err(|_| refused(bytes))?;
        let mut entered = 0;
        for ray in rays {
            let seen = if TopRay::new(ray).is_some() {
                entered += 1;
                let limits = [ray.t_min, limit_within(ray, &SceneHit::MISS)];
                WorldRay::new(ray).seen_by(placement, limits).ray()
            } else {
                NONE
            };
            self.rays.push(seen);
        }
        Ok(entered)
    }
}
