//! Waves: a block of rays, answered by one batch after the other of the geometries that they enter.

use alloc::vec::Vec;

use super::built::BuiltScene;
use crate::error::{QueryError, refused};
use crate::query::traverse::Query;
use crate::ray::{Hit, Ray};
use crate::scene::{
    InstanceId, Placement, SceneHit, SceneOptions, SceneReport, TopRay, TopStack, TopWalk,
    TopWalker,
};
use crate::watch::Watch;

/// What a query of a scene answers for each ray.
pub trait SceneAnswer: Copy + Send + Sync {
    /// The kind of query.
    const QUERY: Query;
    /// The answer to a ray that meets nothing.
    const NONE: Self;

    /// The best hit so far; a miss for any hit.
    fn best(&self) -> SceneHit;

    /// Takes a hit that precedes the best one. Returns whether the ray is done.
    fn take(&mut self, hit: SceneHit) -> bool;
}

impl SceneAnswer for SceneHit {
    const QUERY: Query = Query::Closest;
    const NONE: SceneHit = SceneHit::MISS;

    #[inline]
    fn best(&self) -> SceneHit {
        *self
    }

    #[inline]
    fn take(&mut self, hit: SceneHit) -> bool {
        *self = hit;
        false
    }
}

impl SceneAnswer for bool {
    const QUERY: Query = Query::Any;
    const NONE: bool = false;

    #[inline]
    fn best(&self) -> SceneHit {
        SceneHit::MISS
    }

    #[inline]
    fn take(&mut self, _: SceneHit) -> bool {
        *self = true;
        true
    }
}

/// A ray that enters an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    /// Geometry, culling and whether a triangle is ignored, then the instance: rays of one batch are in one piece, and in it
    /// those of one instance.
    group: u64,
    ray: u32,
}

/// Bits of an entry's group that are not the instance's.
const INSTANCE_BITS: u32 = 29;

impl Entry {
    fn new(instance: InstanceId, placement: &Placement, asked: &Asked, ray: u32) -> Entry {
        let Asked { culling, ignore } = *asked;
        let geometry = u64::from(placement.instance.geometry.0);
        let group = geometry << 3 | (culling as u64) << 1 | u64::from(ignore.is_some());
        Entry { group: group << INSTANCE_BITS | u64::from(instance.0), ray }
    }

    fn batch(&self) -> u64 {
        self.group >> INSTANCE_BITS
    }

    fn instance(&self) -> InstanceId {
        InstanceId(self.group as u32 & ((1 << INSTANCE_BITS) - 1))
    }
}

/// How an instance's geometry is asked.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// The side of triangles to ignore, as the object sees them.
    pub culling: crate::ray::Culling,
    /// A triangle to ignore.
    pub ignore: Option<u32>,
}

impl Asked {
    /// How an instance is asked by a query; `None` where it does not answer.
    #[inline]
    pub fn of(
        instance: InstanceId,
        placement: &Placement,
        options: &SceneOptions<'_>,
    ) -> Option<Asked> {
        if !placement.answers(options.mask) {
            return None;
        }
        let culling = placement.culling(options.culling)?;
        let own = options.ignore.filter(|ignored| ignored.instance == instance);
        Some(Asked { culling, ignore: own.map(|ignored| ignored.triangle) })
    }
}

/// The ray as an instance sees it, up to the best hit so far. An exact distance that rounds to the best `t` may lie a little
/// beyond it, so the limit is the float after it; and one below the least normal float may have become 0.
#[inline(always)]
pub fn seen_by(placement: &Placement, ray: &Ray, best: &SceneHit) -> Ray {
    placement.space.ray(&ray.with_limits(ray.t_min, limit_within(ray, best)))
}

/// The upper limit of [`seen_by`].
#[inline(always)]
pub fn limit_within(ray: &Ray, best: &SceneHit) -> f32 {
    let best = if best.t >= 0.0 { best.t.max(f32::MIN_POSITIVE) } else { best.t };
    ray.t_max.min(best.next_up())
}

/// Memory of a block, kept between blocks.
#[derive(Debug, Default)]
pub struct BlockScratch {
    /// By ray: where it goes, its stack, and the stack's entries.
    top_rays: Vec<Option<TopRay>>,
    stacks: Vec<TopStack>,
    tops: Vec<usize>,
    /// Rays that are not done.
    active: Vec<u32>,
    entries: Vec<Entry>,
    /// A batch, and its answers.
    rays: Vec<Ray>,
    hits: Vec<Hit>,
    any: Vec<bool>,
}

/// Some rays of a batch.
pub struct Block<'a> {
    /// The scene.
    pub scene: &'a BuiltScene,
    /// The rays.
    pub rays: &'a [Ray],
    /// Settings; the watch in them is not called.
    pub options: &'a SceneOptions<'a>,
    /// The watch of geometries' batches.
    pub watch: Option<&'a dyn Watch>,
    /// Batches of fewer rays than this are answered one ray at a time.
    pub singly_below: usize,
}

/// Makes a list of exactly this length; what it held is lost.
fn remake<T: Clone>(list: &mut Vec<T>, length: usize, filler: T) -> Result<(), QueryError> {
    list.clear();
    let bytes = length.saturating_mul(size_of::<T>()) as u64;
    list.try_reserve(length).map_err(|_| refused(bytes))?;
    list.resize(length, filler);
    Ok(())
}

impl Block<'_> {
    /// Answers the rays. Before each batch of a geometry `go_on` decides whether to continue.
    ///
    /// # Errors
    /// What `go_on` or a geometry's batch returns, or no memory.
    pub fn answer<T: SceneAnswer>(
        &self,
        walker: &mut impl TopWalker,
        scratch: &mut BlockScratch,
        answers: &mut [T],
        go_on: &mut impl FnMut() -> Result<(), QueryError>,
    ) -> Result<SceneReport, QueryError> {
        let mut report = SceneReport::default();
        self.begin(scratch, answers)?;
        loop {
            self.advance(walker, scratch, answers);
            if scratch.entries.is_empty() {
                return Ok(report);
            }
            scratch.entries.sort_unstable();
            report.entered += scratch.entries.len() as u64;
            let mut first = 0;
            while first < scratch.entries.len() {
                go_on()?;
                let batch = scratch.entries[first].batch();
                let others = &scratch.entries[first..];
                let length = others.partition_point(|entry| entry.batch() <= batch);
                self.answer_batch(scratch, first..first + length, answers, &mut report)?;
                report.batches += 1;
                first += length;
            }
        }
    }

    /// Makes the rays ready.
    fn begin<T: SceneAnswer>(
        &self,
        scratch: &mut BlockScratch,
        answers: &mut [T],
    ) -> Result<(), QueryError> {
        let (count, room) = (self.rays.len(), self.scene.top.stack());
        answers.fill(T::NONE);
        remake(&mut scratch.top_rays, count, None)?;
        remake(&mut scratch.tops, count, 0)?;
        // Stacks need not be cleared.
        if scratch.stacks.len() < count * room {
            remake(&mut scratch.stacks, count * room, TopStack::default())?;
        }
        remake(&mut scratch.active, count, 0)?;
        remake(&mut scratch.entries, 0, Entry { group: 0, ray: 0 })?;
        let bytes = (count * size_of::<Entry>()) as u64;
        scratch.entries.try_reserve(count).map_err(|_| refused(bytes))?;
        scratch.active.clear();
        for (index, ray) in self.rays.iter().enumerate() {
            scratch.top_rays[index] = TopRay::new(ray);
            if scratch.top_rays[index].is_some() {
                let stack = &mut scratch.stacks[index * room..][..room];
                scratch.tops[index] = self.scene.top.begin(stack);
                scratch.active.push(index as u32);
            }
        }
        Ok(())
    }

    /// Finds the next instance of each ray. Rays that have none are done.
    fn advance<T: SceneAnswer>(
        &self,
        walker: &mut impl TopWalker,
        scratch: &mut BlockScratch,
        answers: &[T],
    ) {
        let BlockScratch { top_rays: rays, stacks, tops, active, entries, .. } = scratch;
        entries.clear();
        let walk = TopWalk { tree: &self.scene.top, rays, stacks, tops, active };
        let t_max = |index: u32| {
            let at = index as usize;
            self.rays[at].t_max.min(answers[at].best().t)
        };
        walker.advance(walk, t_max, |index, name| {
            let instance = InstanceId(name);
            let Some(placement) = self.scene.placement(instance) else { return false };
            let Some(asked) = Asked::of(instance, placement, self.options) else { return false };
            entries.push(Entry::new(instance, placement, &asked, index));
            true
        });
    }

    /// Answers the rays that enter one geometry in one way.
    fn answer_batch<T: SceneAnswer>(
        &self,
        scratch: &mut BlockScratch,
        range: core::ops::Range<usize>,
        answers: &mut [T],
        report: &mut SceneReport,
    ) -> Result<(), QueryError> {
        let BlockScratch { tops, entries, rays, hits, any, .. } = scratch;
        let (scene, options) = (self.scene, self.options);
        let entries = &entries[range];
        let count = entries.len();
        let Some((geometry, asked)) = entries.first().and_then(|entry| {
            let placement = scene.placement(entry.instance())?;
            Some((placement.instance.geometry, Asked::of(entry.instance(), placement, options)?))
        }) else {
            return Ok(());
        };
        let Some(built) = scene.geometry(geometry) else { return Ok(()) };
        rays.clear();
        rays.try_reserve(count).map_err(|_| refused((count * size_of::<Ray>()) as u64))?;
        for run in entries.chunk_by(|one, next| one.group == next.group) {
            let Some(placement) = scene.placement(run[0].instance()) else { return Ok(()) };
            rays.extend(run.iter().map(|entry| {
                let ray = entry.ray as usize;
                seen_by(placement, &self.rays[ray], &answers[ray].best())
            }));
        }
        let accelerator = built.accelerator();
        let query = &options.of_geometry(asked.culling, asked.ignore, self.watch);
        // Where not all hits count it matters which triangle was hit.
        let all_count = options.filter.is_none() && built.opacity().is_none();
        if T::QUERY == Query::Any && all_count {
            remake(any, count, false)?;
            if count < self.singly_below {
                for (ray, any) in rays.iter().zip(&mut *any) {
                    *any = accelerator.any_hit(ray, query);
                }
            } else {
                report.geometries.append(accelerator.any_hits(rays, any, query)?, 0)?;
            }
            for (entry, _) in entries.iter().zip(any).filter(|(_, any)| **any) {
                answers[entry.ray as usize].take(SceneHit::MISS);
                tops[entry.ray as usize] = 0;
            }
            return Ok(());
        }
        remake(hits, count, Hit::MISS)?;
        if count < self.singly_below {
            for (ray, hit) in rays.iter().zip(&mut *hits) {
                *hit = accelerator.closest_hit(ray, query).unwrap_or(Hit::MISS);
            }
        } else {
            report.geometries.append(accelerator.closest_hits(rays, hits, query)?, 0)?;
        }
        for ((entry, ray), hit) in entries.iter().zip(&*rays).zip(hits) {
            let hit = match built.kept(geometry, entry.instance(), options) {
                Some(kept) => kept.next(built, ray, *hit, (query, T::QUERY), &mut report.rejected),
                None => *hit,
            };
            let found = SceneHit::of(&hit, geometry, entry.instance());
            let answer = &mut answers[entry.ray as usize];
            if found.is_hit() && found.precedes(&answer.best()) && answer.take(found) {
                tops[entry.ray as usize] = 0;
            }
        }
        Ok(())
    }
}

impl BuiltScene {
    /// Bytes of a block's stacks, by ray.
    pub fn stack_bytes(&self) -> usize {
        self.top.stack() * size_of::<TopStack>()
    }
}
