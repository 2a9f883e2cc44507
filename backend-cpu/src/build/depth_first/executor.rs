//! The executor: it wraps the twin, which runs the levels until tasks take over.

use splitplane_core::arithmetic::{Arithmetic, Strict};
use splitplane_core::build::schedule::Executor;
use splitplane_core::config::BuildConfig;
use splitplane_core::error::BuildError;
use splitplane_core::kernel::{Buffer, Counter, Kernel, TreeBuilder};
use splitplane_core::watch::Stage;

use super::caps::{Caps, hand_over_limit};
use super::subtree;
use super::task_scratch::ScratchPool;
use crate::build::twin::buffers::Buffers;
use crate::build::twin::executor::{CpuExecutor, StageCounts};
use crate::build::twin::subtrees::Subtrees;
use crate::memory::{Memory, bytes_of};
use crate::span;

/// Memory of the executor, kept between builds.
#[derive(Debug, Default)]
pub(crate) struct DepthFirstScratch {
    /// What each task has counted.
    counts: Vec<StageCounts>,
    tasks: ScratchPool,
    /// The last mesh's length and configuration for which a build was void: the next build of the kind does not try
    /// again.
    voided: Option<(u32, BuildConfig)>,
}

impl DepthFirstScratch {
    /// Bytes held.
    pub(crate) fn bytes(&self) -> u64 {
        bytes_of(&self.counts) + self.tasks.bytes()
    }

    /// Frees all memory, but still knows of which mesh a build was void.
    pub(crate) fn give_back(&mut self) {
        let voided = self.voided;
        *self = DepthFirstScratch { voided, ..DepthFirstScratch::default() };
    }

    /// Whether the last void build was not of a mesh of `triangles` triangles by this configuration.
    pub(crate) fn is_promising(&self, triangles: u32, config: &BuildConfig) -> bool {
        self.voided != Some((triangles, *config))
    }
}

/// Runs the schedule on the twin until nodes have few references, and builds their subtrees by tasks in place of
/// `build_small`: the same tree, unless [`DepthFirstExecutor::is_void`]. What buffers hold between dispatches is not what
/// other executors hold.
#[derive(Debug)]
pub(crate) struct DepthFirstExecutor<'a, A = Strict> {
    twin: CpuExecutor<'a, A>,
    /// The configuration of the tree; the twin's has a larger T.
    config: BuildConfig,
    scratch: DepthFirstScratch,
    is_void: bool,
}

impl<'a, A: Arithmetic> DepthFirstExecutor<'a, A> {
    /// Wraps a twin that is ready for a schedule, and whose memory has accounted for the scratch too.
    pub(crate) fn new(
        twin: CpuExecutor<'a, A>,
        scratch: DepthFirstScratch,
    ) -> DepthFirstExecutor<'a, A> {
        let config = twin.config;
        DepthFirstExecutor { twin, config, scratch, is_void: false }
    }

    /// Whether a cap might have bound, so that the schedule itself must build the tree.
    pub(crate) fn is_void(&self) -> bool {
        self.is_void
    }

    /// Levels of the large-node stage, and small roots, wherever they were built.
    pub(crate) fn stage_counts(&self) -> StageCounts {
        let tasks = self.twin.count(Counter::SmallRoots);
        let mut total = StageCounts { small_roots: 0, ..self.twin.stage_counts() };
        for task in &self.scratch.counts[..tasks] {
            total.levels = total.levels.max(task.levels);
            total.small_roots += task.small_roots;
        }
        total
    }

    /// Bytes held, most bytes held so far, and their limit.
    pub(crate) fn memory(&self) -> Memory {
        self.twin.memory()
    }

    /// Returns the memory, with the finished tree in the buffers.
    pub(crate) fn finish(self) -> (Buffers, DepthFirstScratch) {
        (self.twin.finish(), self.scratch)
    }

    /// In place of `build_small`: the subtrees of all nodes that the levels handed over, a task each.
    fn build_subtrees(&mut self) -> Result<(), BuildError> {
        let Some(planes) = self.config.preset().planes() else { return Ok(()) };
        let roots = self.twin.count(Counter::SmallRoots);
        let triangles = self.twin.count(Counter::Triangles) as u32;
        let CpuExecutor { config: levels, buffers: b, memory: m, meter, set, .. } = &mut self.twin;
        let scratch = &mut self.scratch;
        meter.begin_stage(Stage::SmallNodes, u64::from(b.counters[Counter::SmallReferences]));
        m.grow_watched(&mut b.small_sizes, roots, meter)?;
        let before = b.bytes() + scratch.bytes();
        m.reserve(&mut b.subtrees, roots)?;
        b.subtrees.resize_with(roots.max(b.subtrees.len()), Subtrees::default);
        m.reserve(&mut scratch.counts, roots)?;
        scratch.counts.resize(roots.max(scratch.counts.len()), StageCounts::default());
        scratch.tasks.prepare(span::threads()).map_err(|_| m.lacking())?;
        let kept = u64::from(b.counters[Counter::Triangles] - b.counters[Counter::Dropped]);
        let caps = Caps::new(
            &self.config,
            triangles,
            kept + b.growth,
            u64::from(b.counters[Counter::TopNodes]),
        );
        let inputs = subtree::SubtreeInputs {
            meter,
            config: &self.config,
            planes,
            limit: levels.small_node_limit(),
            set: *set,
            roots: &b.small_roots[..roots],
            references: &b.small_references,
            triangles: &b.triangles,
            level_starts: &b.level_starts,
            caps: &caps,
        };
        subtree::run::<A>(
            &inputs,
            &scratch.tasks,
            &mut b.small_sizes[..roots],
            &mut scratch.counts[..roots],
            &mut b.subtrees[..roots],
        )
        .map_err(|_| m.lacking())?;
        self.is_void = caps.exceeded();
        scratch.voided = self.is_void.then_some((triangles, self.config));
        scratch.tasks.prepare(span::threads()).map_err(|_| m.lacking())?;
        m.take(b.bytes() + scratch.bytes() - before)?;
        meter.finish_stage();
        meter.check()?;
        self.twin.check_size()
    }
}

impl<A: Arithmetic> Executor<TreeBuilder> for DepthFirstExecutor<'_, A> {
    type Error = BuildError;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), BuildError> {
        if self.is_void {
            // What would follow is built anew.
            return Ok(());
        }
        match kernel {
            Kernel::ScanTriangles => {
                self.twin.dispatch(kernel)?;
                let references = self.twin.buffers.active_nodes[0].count as usize;
                self.twin.hand_over_at(hand_over_limit(references, span::threads()));
                Ok(())
            }
            Kernel::BuildSmall => self.build_subtrees(),
            Kernel::EmitSmall => self.twin.emit_small(1),
            _ => self.twin.dispatch(kernel),
        }
    }

    fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), BuildError> {
        self.twin.swap(a, b)
    }

    fn pending(&mut self, counter: Counter, rounds: u32) -> Result<bool, BuildError> {
        self.twin.pending(counter, rounds)
    }
}
