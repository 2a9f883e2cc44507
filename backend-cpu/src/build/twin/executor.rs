//! Runs the tree builder's kernels on rayon's pool.

use core::marker::PhantomData;

use splitplane_core::arithmetic::{Arithmetic, Strict};
use splitplane_core::build::lockstep::Inspect;
use splitplane_core::build::middle::hand_over_limit;
use splitplane_core::config::{BuildConfig, Planes};
use splitplane_core::error::BuildError;
use splitplane_core::kernel::{Buffer, Counter, TreeBuilder};
use splitplane_core::layout::Counters;
use splitplane_core::mesh::Mesh;

use super::buffers::Buffers;
use crate::build::MOST_NODES;
use crate::cancel::{ProgressMeter, UNWATCHED};
use crate::memory::Memory;
use crate::simd::InstructionSet;

/// What a build counts for its summary.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StageCounts {
    /// Levels of the large-node stage.
    pub levels: u32,
    /// Small roots.
    pub small_roots: u32,
}

/// The CPU executor: one build over one mesh, in the arithmetic `A`: [`Strict`] but in tests. Work runs in the
/// rayon pool of the calling thread.
#[derive(Debug)]
pub struct CpuExecutor<'a, A = Strict> {
    pub(in crate::build) mesh: Mesh<'a>,
    pub(in crate::build) config: BuildConfig,
    /// Whether the levels hand nodes over to the middle stage.
    pub(in crate::build) middle: bool,
    pub(in crate::build) set: InstructionSet,
    pub(in crate::build) buffers: Buffers,
    pub(in crate::build) memory: Memory,
    pub(in crate::build) meter: &'a ProgressMeter<'a>,
    arithmetic: PhantomData<A>,
}

impl<'a, A: Arithmetic> CpuExecutor<'a, A> {
    /// An executor ready for [`splitplane_core::build::schedule::build`]. `buffers` may come from an
    /// earlier build; `set` must come from [`InstructionSet::available`], or the least one serves.
    ///
    /// # Errors
    /// More memory than `limit` allows.
    pub fn new(
        mesh: Mesh<'a>,
        config: BuildConfig,
        set: InstructionSet,
        buffers: Buffers,
        limit: Option<u64>,
    ) -> Result<CpuExecutor<'a, A>, BuildError> {
        let available = InstructionSet::available().contains(&set);
        let set = if available { set } else { InstructionSet::least() };
        let mut buffers = buffers;
        if limit.is_some_and(|limit| buffers.bytes() > limit) {
            // Memory of a larger build before: a limit must not depend on what was built earlier.
            buffers = Buffers::default();
        }
        let mut memory = Memory { held: 0, peak: 0, limit };
        memory.take(buffers.bytes())?;
        Ok(CpuExecutor::on(mesh, config, set, buffers, memory))
    }

    /// As [`CpuExecutor::new`], for a set that the processor is known to have, and for buffers that `memory` has
    /// accounted for.
    pub(crate) fn on(
        mesh: Mesh<'a>,
        config: BuildConfig,
        set: InstructionSet,
        mut buffers: Buffers,
        memory: Memory,
    ) -> CpuExecutor<'a, A> {
        buffers.counters = Counters::at_start(mesh.len() as u32);
        buffers.growth = 0;
        let (meter, arithmetic) = (&UNWATCHED, PhantomData);
        CpuExecutor { mesh, config, middle: false, set, buffers, memory, meter, arithmetic }
    }

    /// The executor with a meter that may cancel the build.
    pub(crate) fn watched(self, meter: &'a ProgressMeter<'a>) -> CpuExecutor<'a, A> {
        CpuExecutor { meter, ..self }
    }

    /// With the middle stage: see [`splitplane_core::build::middle`]. The build may then turn out void, as
    /// [`CpuExecutor::is_void`] says.
    #[must_use]
    pub fn with_middle_stage(self) -> CpuExecutor<'a, A> {
        // Planes of bins have no such stage.
        let middle = self.config.preset().planes() == Some(Planes::Median);
        CpuExecutor { middle, ..self }
    }

    /// Whether the build is void, so that there is no tree: another one must do without the middle stage.
    pub fn is_void(&self) -> bool {
        self.buffers.counters[Counter::Overflow] != 0
    }

    /// The configuration with which levels run: with a middle stage T is what that takes.
    pub(super) fn levels(&self) -> BuildConfig {
        let limit = hand_over_limit(&self.config);
        match self.middle {
            true => self.config.with_stages(|stages| stages.small_node_limit = limit),
            false => self.config,
        }
    }

    /// From now on nodes of at most `references` references go to the small list, whatever T the configuration has: for an
    /// executor that takes over there.
    pub(in crate::build) fn hand_over_at(&mut self, references: u32) {
        self.config = self.config.with_stages(|stages| stages.small_node_limit = references);
    }

    /// Levels of the large-node stage, and small roots.
    pub(crate) fn stage_counts(&self) -> StageCounts {
        StageCounts {
            levels: self.buffers.counters[Counter::Levels]
                .max(self.buffers.counters[Counter::MiddleLevels]),
            small_roots: self.buffers.counters[Counter::SmallRoots],
        }
    }

    /// The counters.
    pub fn counters(&self) -> &Counters {
        &self.buffers.counters
    }

    /// Bytes held, most bytes held so far, and their limit.
    pub fn memory(&self) -> Memory {
        self.memory
    }

    /// The live bytes of a buffer, for comparing executors; `None` for buffers that stand for
    /// several.
    pub fn live(&self, buffer: Buffer) -> Option<&[u8]> {
        let b = &self.buffers;
        let length = buffer.live().map_or(0, |counter| b.counters[counter] as usize);
        fn bytes<T: bytemuck::NoUninit>(vector: &[T], length: usize) -> Option<&[u8]> {
            Some(bytemuck::cast_slice(vector.get(..length)?))
        }
        match buffer {
            Buffer::Input
            | Buffer::Subtrees
            | Buffer::TopParents
            | Buffer::ChunkState
            | Buffer::MiddleReferences
            | Buffer::MiddleNodes
            | Buffer::MiddleLeaves => None,
            Buffer::Counters => Some(bytemuck::bytes_of(&b.counters)),
            Buffer::Triangles => bytes(b.triangles.as_flattened().as_flattened(), length * 9),
            Buffer::References => bytes(&b.references, length),
            Buffer::NextReferences => bytes(&b.next_references, length),
            Buffer::SmallReferences => bytes(&b.small_references, length),
            Buffer::ActiveNodes => bytes(&b.active_nodes, length),
            Buffer::NextNodes => bytes(&b.next_nodes, length),
            Buffer::NodeBounds => bytes(&b.node_bounds, length),
            Buffer::Chunks => bytes(&b.chunks, length),
            Buffer::ChunkCounts => bytes(&b.chunk_counts, length),
            Buffer::ChunkBounds => bytes(&b.chunk_bounds, length),
            Buffer::ReferenceSides => bytes(&b.reference_sides, length),
            Buffer::ChunkBins => bytes(&b.chunk_bins, length),
            Buffer::Decisions => bytes(&b.decisions, length),
            Buffer::TopNodes => bytes(&b.top_nodes, length),
            Buffer::LevelStarts => bytes(&b.level_starts, length),
            Buffer::SmallRoots => bytes(&b.small_roots, length),
            Buffer::SmallSizes => bytes(&b.small_sizes, length),
            Buffer::MiddleRoots => bytes(&b.middle_roots, length),
            Buffer::MiddleSizes => bytes(&b.middle_sizes, length),
            Buffer::SmallAddresses => bytes(&b.small_addresses, length),
            Buffer::TopSizes => bytes(&b.top_sizes, length),
            Buffer::TopAddresses => bytes(&b.top_addresses, length),
            Buffer::Nodes => bytes(&b.nodes, length),
            Buffer::LeafReferences => bytes(&b.leaf_references, length),
        }
    }

    /// Returns the buffers, with the finished tree in them.
    pub fn finish(self) -> Buffers {
        self.buffers
    }

    pub(in crate::build) fn count(&self, counter: Counter) -> usize {
        self.buffers.counters[counter] as usize
    }

    /// Sums sizes in 64 bits before anything trusts the 32-bit ones.
    pub(in crate::build) fn check_size(&self) -> Result<(), BuildError> {
        let b = &self.buffers;
        let small = &b.small_sizes[..self.count(Counter::SmallRoots)];
        let middle = &b.middle_roots[..self.count(Counter::MiddleRoots)];
        let middle = middle.iter().map(|root| u64::from(root.nodes)).sum::<u64>();
        let top = self.count(Counter::TopNodes) as u64 + middle;
        let nodes = top + small.iter().map(|size| u64::from(size.nodes)).sum::<u64>();
        let references = small.iter().map(|size| u64::from(size.references)).sum::<u64>();
        if nodes > u64::from(MOST_NODES) || references > u64::from(u32::MAX) {
            return Err(BuildError::TooLarge { nodes, references });
        }
        Ok(())
    }
}

impl<A: Arithmetic> Inspect<TreeBuilder> for CpuExecutor<'_, A> {
    /// Empty for the input, which is the caller's, and for buffers that stand for several.
    fn live(&mut self, buffer: Buffer) -> Result<Vec<u8>, BuildError> {
        let bytes = CpuExecutor::live(self, buffer).unwrap_or_default();
        let (mut copy, needed) = (Vec::new(), bytes.len() as u64);
        let refused = |_| BuildError::OutOfMemory { needed, limit: needed };
        copy.try_reserve_exact(bytes.len()).map_err(refused)?;
        copy.extend_from_slice(bytes);
        Ok(copy)
    }
}
