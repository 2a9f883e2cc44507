//! All hits of rays, over all instances.

use alloc::vec::Vec;

use super::block::{Asked, seen_by};
use super::built::BuiltScene;
use super::within::Within;
use crate::cancel::go_on_tracing;
use crate::error::{QueryError, check_bytes, refused};
use crate::query::all_hits::AllHitsOptions;
use crate::ray::Ray;
use crate::report::QueryReport;
use crate::scene::{InstanceId, SceneHit, SceneOptions, TopRay, TopStack, WIDEST_STACK};
use crate::watch::Watch;

/// A place where a ray crosses a surface of an instance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneCrossing {
    /// Where, and in which triangle of which instance.
    pub hit: SceneHit,
    /// Whether the ray comes from the front, as seen in the world: a reflection exchanges the sides.
    pub front: bool,
}

/// The crossings of a batch of rays with all instances.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneAllHits {
    /// Where the crossings of each ray begin, followed by the number of all crossings.
    pub starts: Vec<usize>,
    /// The crossings of all rays, ray by ray, each ray's ordered by (t, instance, triangle). Within an instance they are those
    /// of [`all_hits`](crate::query::all_hits), exact for the ray as the object sees it.
    pub crossings: Vec<SceneCrossing>,
    /// How geometries answered; each ray counts once in each instance.
    pub report: QueryReport,
}

impl SceneAllHits {
    /// The answers to the parts of a batch, in order, as one.
    ///
    /// # Errors
    /// No memory for it.
    pub fn joined(parts: Vec<SceneAllHits>) -> Result<SceneAllHits, QueryError> {
        let (mut rays, mut count) = (0, 0);
        for part in &parts {
            (rays, count) = (rays + part.starts.len() - 1, count + part.crossings.len());
        }
        let (mut starts, mut crossings) = (Vec::new(), Vec::new());
        let bytes = (rays + 1) * size_of::<usize>() + count * size_of::<SceneCrossing>();
        starts.try_reserve_exact(rays + 1).map_err(|_| refused(bytes as u64))?;
        crossings.try_reserve_exact(count).map_err(|_| refused(bytes as u64))?;
        starts.push(0);
        let mut report = QueryReport::default();
        for part in parts {
            let (first, rays) = (crossings.len(), starts.len() - 1);
            starts.extend(part.starts.iter().skip(1).map(|start| first + start));
            crossings.extend(part.crossings);
            report.append(part.report, rays)?;
        }
        Ok(SceneAllHits { starts, crossings, report })
    }

    /// The crossings of a ray of the batch, the nearest first.
    pub fn of(&self, ray: usize) -> &[SceneCrossing] {
        &self.crossings[self.starts[ray]..self.starts[ray + 1]]
    }
}

/// Settings of a query for all crossings.
#[derive(Clone, Copy, Debug, Default)]
pub struct SceneAllHitsOptions<'a> {
    /// Mask, culling, an ignored triangle, a filter and a watch, as for other queries. The accuracy is exact.
    pub query: SceneOptions<'a>,
    /// Most bytes that the answer and its parts may take; `None` for no limit.
    pub max_memory: Option<u64>,
}

impl BuiltScene {
    /// All crossings of rays. One ray at a time: it holds the crossings of one ray with one instance besides the answer.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`], [`QueryError::Cancelled`], or a device that fails.
    pub fn all_hits(
        &self,
        rays: &[Ray],
        options: &SceneAllHitsOptions<'_>,
    ) -> Result<SceneAllHits, QueryError> {
        let SceneAllHitsOptions { query, max_memory } = *options;
        let total = rays.len() as u64;
        let mut all = SceneAllHits {
            starts: Vec::new(),
            crossings: Vec::new(),
            report: QueryReport::default(),
        };
        let starts = (rays.len().saturating_add(1)).saturating_mul(size_of::<usize>()) as u64;
        check_bytes(starts, max_memory)?;
        all.starts.try_reserve_exact(rays.len() + 1).map_err(|_| refused(starts))?;
        all.starts.push(0);
        for (done, ray) in rays.iter().enumerate() {
            let done = done as u64;
            go_on_tracing(query.watch, done, total)?;
            let first = all.crossings.len();
            self.crossings_of(ray, options, (done, total, starts), &mut all).map_err(|error| {
                match error {
                    QueryError::Cancelled { .. } => QueryError::Cancelled { done, total },
                    error => error,
                }
            })?;
            all.crossings[first..].sort_unstable_by(|a, b| {
                // A tangent of a sphere enters and leaves it at one place.
                let key = |c: &SceneCrossing| (c.hit.instance, c.hit.triangle, !c.front);
                a.hit.t.total_cmp(&b.hit.t).then(key(a).cmp(&key(b)))
            });
            all.starts.push(all.crossings.len());
        }
        go_on_tracing(query.watch, total, total)?;
        Ok(all)
    }

    /// How many crossings [`BuiltScene::all_hits`] has of every ray, without them. It holds the crossings of one ray at a time, which is what the options' limit is for. After an error
    /// `counts` holds the answers to some of the rays, and nothing says which: do not use it.
    ///
    /// # Errors
    /// `rays` and `counts` of different length, and as for [`BuiltScene::all_hits`].
    pub fn count_hits(
        &self,
        rays: &[Ray],
        counts: &mut [u64],
        options: &SceneAllHitsOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        if rays.len() != counts.len() {
            return Err(QueryError::LengthMismatch { rays: rays.len(), results: counts.len() });
        }
        let total = rays.len() as u64;
        let mut all = SceneAllHits {
            starts: Vec::new(),
            crossings: Vec::new(),
            report: QueryReport::default(),
        };
        for (done, (ray, count)) in (0u64..).zip(rays.iter().zip(counts)) {
            go_on_tracing(options.query.watch, done, total)?;
            all.crossings.clear();
            self.crossings_of(ray, options, (done, total, 0), &mut all).map_err(
                |error| match error {
                    QueryError::Cancelled { .. } => QueryError::Cancelled { done, total },
                    error => error,
                },
            )?;
            *count = all.crossings.len() as u64;
        }
        go_on_tracing(options.query.watch, total, total)?;
        Ok(all.report)
    }

    /// Adds the crossings of one ray, instance by instance.
    fn crossings_of(
        &self,
        ray: &Ray,
        options: &SceneAllHitsOptions<'_>,
        (done, total, starts): (u64, u64, u64),
        all: &mut SceneAllHits,
    ) -> Result<(), QueryError> {
        let SceneAllHitsOptions { query, max_memory } = *options;
        let within = query.watch.map(|watch| Within { watch, done, total });
        let watch: Option<&dyn Watch> = match &within {
            Some(watch) => Some(watch),
            None => None,
        };
        let mut stack = [TopStack::default(); WIDEST_STACK];
        let Some(top_ray) = TopRay::new(ray) else { return Ok(()) };
        let mut top = self.top.begin(&mut stack);
        while let Some(name) = self.top.next(&top_ray, ray.t_max, &mut stack, &mut top) {
            let instance = InstanceId(name);
            let Some(placement) = self.placement(instance) else { continue };
            let Some(asked) = Asked::of(instance, placement, &query) else { continue };
            let geometry = placement.instance.geometry;
            let Some(built) = self.geometry(geometry) else { continue };
            let bytes = |all: &SceneAllHits, more: usize| {
                let crossings = all.crossings.capacity().max(all.crossings.len() + more);
                starts + (crossings * size_of::<SceneCrossing>()) as u64
            };
            let held = bytes(all, 0);
            check_bytes(held, max_memory)?;
            let own = AllHitsOptions {
                culling: asked.culling,
                ignore: asked.ignore,
                max_memory: max_memory.map(|limit| limit - held),
                watch,
            };
            let seen = seen_by(placement, ray, &SceneHit::MISS);
            let met = built.accelerator().all_hits(&[seen], &own);
            let met = met.map_err(|error| error.beside(held, max_memory))?;
            let needed = bytes(all, met.crossings.len());
            check_bytes(needed + met.bytes(), max_memory)?;
            let crossings = &mut all.crossings;
            if max_memory.is_some() {
                // Amortised growth could take twice what was checked.
                crossings.try_reserve_exact(met.crossings.len())
            } else {
                crossings.try_reserve(met.crossings.len())
            }
            .map_err(|_| refused(needed))?;
            let kept = built.kept(geometry, instance, &query);
            for crossing in met.crossings {
                if kept.is_none_or(|kept| kept.keeps(&crossing.hit)) {
                    let hit = SceneHit::of(&crossing.hit, geometry, instance);
                    let front = crossing.front != placement.space.mirrored;
                    all.crossings.push(SceneCrossing { hit, front });
                }
            }
            all.report.append(met.report, 0)?;
        }
        Ok(())
    }
}
