//! The built tree, ready for rays.

use core::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::all_hits::{AllHits, Collector, check_bytes};
use splitplane_core::backend::{Accelerator, BuildSummary, QueryError, QueryReport};
use splitplane_core::intersect::{Limits, SceneScale};
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::traverse::Query;
use splitplane_core::tree::{KdTree, KdTreeView};
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_core::watch::{Stage, Watch};

use super::blocks::Blocks;
use super::exact;
#[cfg(target_arch = "x86_64")]
use super::lanes;
use super::leaf::InstructionSet;
use super::prepare::prepare_one;
use super::single;
use crate::lookout::{DUE, Lookout, UNWATCHED};

/// Rays of one task: what one thread takes at a time.
const TASK: usize = 4096;
/// Rays of one task of all hits, which take longer and give more.
const FEW: usize = 256;

/// A tree over a mesh on the CPU.
#[derive(Debug)]
pub struct CpuAccelerator {
    tree: KdTree,
    summary: BuildSummary,
    scene: SceneScale,
    blocks: Blocks,
    set: InstructionSet,
}

impl CpuAccelerator {
    /// Bytes of tree and query layout, for a limit to be checked before they are made.
    pub(crate) fn bytes_for(tree: &KdTreeView<'_>) -> u64 {
        let tree_bytes = size_of_val(tree.nodes) + size_of_val(tree.references);
        tree_bytes as u64 + Blocks::bytes_for(tree)
    }

    /// Makes the query layout of a valid tree. `triangles` are the mesh's snapped corners; `set` must
    /// be one that the processor has. Of no use when the lookout has ended it.
    pub(crate) fn new(
        tree: KdTree,
        summary: BuildSummary,
        triangles: &[Triangle],
        set: InstructionSet,
        look: &Lookout<'_>,
    ) -> CpuAccelerator {
        let scene = scene_scale(tree.bounds, triangles, look);
        let blocks = Blocks::watched(&tree.view(), triangles, look);
        CpuAccelerator { tree, summary, scene, blocks, set }
    }

    /// Becomes the accelerator of another valid tree, in the same memory.
    pub(crate) fn replace(
        &mut self,
        tree: &KdTreeView<'_>,
        summary: BuildSummary,
        triangles: &[Triangle],
    ) {
        self.scene = scene_scale(tree.bounds, triangles, &UNWATCHED);
        self.blocks.fill(tree, triangles);
        self.tree.nodes.clear();
        self.tree.nodes.extend_from_slice(tree.nodes);
        self.tree.references.clear();
        self.tree.references.extend_from_slice(tree.references);
        self.tree.bounds = tree.bounds;
        self.tree.triangles = tree.triangles;
        self.tree.config = tree.config;
        self.summary = summary;
    }

    /// The instruction set of the wide test.
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
        options: &QueryOptions,
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
        options: &QueryOptions,
    ) -> Result<QueryReport, QueryError> {
        check(rays.len(), occluded.len())?;
        rays.par_chunks(TASK).zip(occluded.par_chunks_mut(TASK)).for_each(|(rays, occluded)| {
            for (ray, occluded) in rays.iter().zip(occluded) {
                *occluded = self.trace(ray, options, Query::Any).is_hit();
            }
        });
        Ok(QueryReport::default())
    }

    fn trace(&self, ray: &Ray, options: &QueryOptions, query: Query) -> Hit {
        if options.accuracy == Accuracy::Exact {
            // SAFETY: `set` was detected on this processor.
            return unsafe {
                exact::trace(self.set, &self.blocks, &self.scene, ray, options, query)
            };
        }
        let Some((ray, interval)) = prepare_one(ray, &self.scene) else { return Hit::MISS };
        // SAFETY: `set` was detected on this processor.
        unsafe { single::trace(self.set, &self.blocks, &ray, interval, options, query, None) }
    }

    /// Traces a batch by the best path there is; `answer` takes ray number and hit.
    fn trace_batch(
        &self,
        rays: &[Ray],
        options: &QueryOptions,
        query: Query,
        mut answer: impl FnMut(usize, Hit),
    ) {
        #[cfg(target_arch = "x86_64")]
        if self.set == InstructionSet::Avx512 && rays.len() >= lanes::WORTHWHILE {
            let (blocks, scene) = (&self.blocks, &self.scene);
            // SAFETY: `set` was detected on this processor.
            unsafe { lanes::trace(blocks, scene, rays, options, query, &mut answer) };
            return;
        }
        for (index, ray) in rays.iter().enumerate() {
            answer(index, self.trace(ray, options, query));
        }
    }

    /// Answers a batch under a lookout; `told` is what is told of a hit.
    fn answer<T: Send>(
        &self,
        rays: &[Ray],
        answers: &mut [T],
        options: &QueryOptions,
        query: Query,
        look: &Lookout<'_>,
        told: impl Fn(Hit) -> T + Sync,
    ) -> Result<QueryReport, QueryError> {
        check(rays.len(), answers.len())?;
        look.begin(Stage::Rays, rays.len() as u64);
        rays.par_chunks(TASK).zip(answers.par_chunks_mut(TASK)).for_each(|(rays, answers)| {
            if look.is_over() {
                return;
            }
            self.trace_batch(rays, options, query, |index, hit| answers[index] = told(hit));
            look.advance(rays.len() as u64);
            look.worked(DUE);
        });
        look.finish();
        look.check_batch().map(|()| QueryReport::default())
    }

    /// All hits of a batch under a lookout.
    fn all_hits_under(
        &self,
        rays: &[Ray],
        options: &QueryOptions,
        look: &Lookout<'_>,
    ) -> Result<AllHits, QueryError> {
        look.begin(Stage::Rays, rays.len() as u64);
        // What threads find is copied together in the end, so everything counts twice.
        let held = AtomicU64::new((2 * rays.len() * size_of::<usize>()) as u64);
        check_bytes(held.load(Relaxed), options)?;
        let parts = rays.par_chunks(FEW).map(|rays| {
            let mut part = AllHits::none();
            let mut collector = Collector::default();
            let (blocks, bounds) = (&self.blocks, &self.tree.bounds);
            for ray in rays {
                let before = part.crossings.len();
                let mut ended = Ok(());
                let go_on = |collector: &mut Collector| {
                    look.worked(DUE / 8);
                    ended = look
                        .check_batch()
                        .and_then(|()| collector.check_memory(held.load(Relaxed), options));
                    ended.is_ok()
                };
                let out = &mut part.crossings;
                exact::all_hits(blocks, bounds, ray, options, &mut collector, out, go_on);
                ended?;
                part.starts.push(part.crossings.len());
                let found = 2 * size_of_val(&part.crossings[before..]) as u64;
                check_bytes(held.fetch_add(found, Relaxed) + found, options)?;
            }
            part.crossings.shrink_to_fit();
            look.advance(rays.len() as u64);
            look.worked(DUE);
            look.check_batch().map(|()| part)
        });
        let parts = parts.collect::<Result<Vec<AllHits>, QueryError>>()?;
        let mut all = AllHits::none();
        all.starts.reserve_exact(rays.len());
        all.crossings.reserve_exact(parts.iter().map(|part| part.crossings.len()).sum());
        parts.into_iter().for_each(|part| all.append(part));
        look.finish();
        look.check_batch().map(|()| all)
    }
}

/// What queries need to know of all triangles. Dropped ones have no say.
fn scene_scale(bounds: Aabb, triangles: &[Triangle], look: &Lookout<'_>) -> SceneScale {
    let limits = triangles
        .par_chunks(4096)
        .map(|chunk| {
            if look.worked(chunk.len() as u64) {
                return Limits::NONE;
            }
            chunk
                .iter()
                .filter(|triangle| prepare(triangle).kept)
                .fold(Limits::NONE, |limits, t| limits.union(Limits::of(t)))
        })
        .reduce(|| Limits::NONE, Limits::union);
    SceneScale::new(bounds, &limits)
}

fn check(rays: usize, results: usize) -> Result<(), QueryError> {
    if rays == results { Ok(()) } else { Err(QueryError::LengthMismatch { rays, results }) }
}

impl Accelerator for CpuAccelerator {
    fn tree(&self) -> &KdTree {
        &self.tree
    }

    fn summary(&self) -> &BuildSummary {
        &self.summary
    }

    fn query_bytes(&self) -> u64 {
        self.blocks.bytes()
    }

    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions,
    ) -> Result<QueryReport, QueryError> {
        self.answer(rays, hits, options, Query::Closest, &UNWATCHED, |hit| hit)
    }

    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions,
    ) -> Result<QueryReport, QueryError> {
        self.answer(rays, occluded, options, Query::Any, &UNWATCHED, |hit| hit.is_hit())
    }

    /// Asks the watch after every 4,096 rays, one thread at a time.
    fn closest_hits_watched(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions,
        watch: &dyn Watch,
    ) -> Result<QueryReport, QueryError> {
        self.answer(rays, hits, options, Query::Closest, &Lookout::new(watch), |hit| hit)
    }

    /// Asks the watch after every 4,096 rays, one thread at a time.
    fn any_hits_watched(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions,
        watch: &dyn Watch,
    ) -> Result<QueryReport, QueryError> {
        let look = Lookout::new(watch);
        self.answer(rays, occluded, options, Query::Any, &look, |hit| hit.is_hit())
    }

    fn all_hits(&self, rays: &[Ray], options: &QueryOptions) -> Result<AllHits, QueryError> {
        self.all_hits_under(rays, options, &UNWATCHED)
    }

    fn all_hits_watched(
        &self,
        rays: &[Ray],
        options: &QueryOptions,
        watch: &dyn Watch,
    ) -> Result<AllHits, QueryError> {
        self.all_hits_under(rays, options, &Lookout::new(watch))
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions) -> Option<Hit> {
        self.trace(ray, options, Query::Closest).some()
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions) -> bool {
        self.trace(ray, options, Query::Any).is_hit()
    }
}
