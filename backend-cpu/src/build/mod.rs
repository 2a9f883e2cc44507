//! Builders of trees, each in a module named after its algorithm.
//!
//! - [`twin`] runs the schedule of [`splitplane_core::build::schedule`] kernel by kernel, as devices do.
//! - [`depth_first`] builds the same trees: it runs the upper levels on the twin and hands nodes of few references to tasks
//!   that build a subtree each, depth first, in cache.
//! - [`sweep`] is the offline builder of preset `best`.

pub(crate) mod depth_first;
pub(crate) mod sweep;
pub(crate) mod twin;

use splitplane_core::backend::BuildOptions;
use splitplane_core::build::schedule;
use splitplane_core::error::BuildError;
use splitplane_core::kernel::Counter;
use splitplane_core::mesh::Mesh;

use crate::cancel::ProgressMeter;
use crate::memory::Memory;
use crate::simd::InstructionSet;
use depth_first::DepthFirstExecutor;
use twin::buffers::Buffers;
use twin::executor::{CpuExecutor, StageCounts};

/// Most nodes of a tree: larger ones end in [`BuildError::TooLarge`].
pub(crate) const MOST_NODES: u32 = 1 << 28;

/// Bytes that are worth giving back. To make less anew takes small meshes as long as their trees.
const MUCH: u64 = 1 << 20;

/// What becomes of a builder's lists when the tree is finished.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Lists {
    /// They stay for the next build, which then makes none.
    Keep,
    /// They are freed before the layout is made.
    GiveBack,
}

/// Memory of all builders, kept between builds.
#[derive(Debug, Default)]
pub(crate) struct BuildScratch {
    /// Of the twin, with the finished tree in it.
    pub buffers: Buffers,
    depth_first: depth_first::DepthFirstScratch,
    sweep: sweep::SweepScratch,
}

impl BuildScratch {
    /// Bytes held.
    fn bytes(&self) -> u64 {
        self.buffers.bytes() + self.depth_first.bytes() + self.sweep.bytes()
    }

    /// Accounts for what is held, and for `beside`, which others hold meanwhile. Memory of a larger build before is given
    /// back where it exceeds the limit: what a limit allows must not depend on what was built earlier.
    ///
    /// # Errors
    /// More memory than the limit.
    fn begin(&mut self, limit: Option<u64>, beside: u64) -> Result<Memory, BuildError> {
        if limit.is_some_and(|limit| self.bytes() + beside > limit) {
            *self = BuildScratch::default();
        }
        let mut memory = Memory { held: 0, peak: 0, limit };
        memory.take(self.bytes() + beside)?;
        Ok(memory)
    }

    /// Frees what a layout does not read, where that is much: all but corners and the finished tree.
    pub(crate) fn give_back(&mut self, memory: &mut Memory) {
        let before = self.bytes();
        let few = self.buffers.finished_bytes() + MUCH;
        if before <= few {
            return;
        }
        self.buffers.keep_finished();
        self.depth_first.give_back();
        self.sweep = sweep::SweepScratch::default();
        memory.held -= before - self.bytes();
    }
}

/// A finished tree in [`BuildScratch::buffers`], and what its build has counted.
#[derive(Debug)]
pub(crate) struct Finished {
    /// How many nodes and references there are.
    pub nodes: usize,
    pub references: usize,
    /// Levels of the large-node stage, and small roots.
    pub stages: StageCounts,
    pub memory: Memory,
}

/// Builds the tree of a mesh by the builder of its preset, while others hold `beside` bytes. Lists that are given back are so
/// by the caller, but `best` gives back what it can before the tree is put together. `set` must be one that the
/// processor has.
///
/// # Errors
/// More memory than the limit allows, more nodes or references than the format can address, or a build that was
/// cancelled.
pub(crate) fn build(
    scratch: &mut BuildScratch,
    mesh: &Mesh<'_>,
    options: &BuildOptions<'_>,
    set: InstructionSet,
    meter: &ProgressMeter<'_>,
    (lists, beside): (Lists, u64),
) -> Result<Finished, BuildError> {
    let BuildOptions { config, max_memory, .. } = *options;
    if let Some(knobs) = config.sweep() {
        let memory = scratch.begin(max_memory, beside)?;
        let buffers = core::mem::take(&mut scratch.buffers);
        let mut twin = CpuExecutor::on(*mesh, config, set, buffers, memory).watched(meter);
        schedule::start::<CpuExecutor<'_>>(&mut twin)?;
        let (stages, mut memory) = (twin.stage_counts(), twin.memory());
        scratch.buffers = twin.finish();
        let BuildScratch { buffers, sweep, .. } = scratch;
        let (nodes, references) =
            sweep::build((&config, knobs), set, (buffers, sweep, lists), &mut memory, meter)?;
        return Ok(Finished { nodes, references, stages, memory });
    }
    let preset = config.preset();
    let planes = preset.planes().ok_or(BuildError::PresetNotOnDevice { preset })?;
    let mut memory = scratch.begin(max_memory, beside)?;
    let mut finished = None;
    if scratch.depth_first.is_promising(mesh.len() as u32, &config) {
        let buffers = core::mem::take(&mut scratch.buffers);
        let kept = core::mem::take(&mut scratch.depth_first);
        let twin = CpuExecutor::on(*mesh, config, set, buffers, memory).watched(meter);
        let mut executor: DepthFirstExecutor<'_> = DepthFirstExecutor::new(twin, kept);
        schedule::build(&mut executor, planes)?;
        let (stages, is_void) = (executor.stage_counts(), executor.is_void());
        memory = executor.memory();
        (scratch.buffers, scratch.depth_first) = executor.finish();
        if is_void {
            // A cap might have bound: the schedule itself determines where.
            memory = scratch.begin(max_memory, beside)?;
        } else {
            finished = Some((stages, memory));
        }
    }
    let (stages, memory) = match finished {
        Some(finished) => finished,
        None => {
            let buffers = core::mem::take(&mut scratch.buffers);
            let mut twin = CpuExecutor::on(*mesh, config, set, buffers, memory).watched(meter);
            schedule::build::<CpuExecutor<'_>>(&mut twin, planes)?;
            let counted = (twin.stage_counts(), twin.memory());
            scratch.buffers = twin.finish();
            counted
        }
    };
    let [nodes, references] = [Counter::Nodes, Counter::LeafReferences]
        .map(|counter| scratch.buffers.counters[counter] as usize);
    Ok(Finished { nodes, references, stages, memory })
}
