//! Runs the tree builder's kernels on rayon's pool.

use core::marker::PhantomData;

use splitplane_core::arithmetic::{Arithmetic, Strict};
use splitplane_core::backend::BuildError;
use splitplane_core::config::BuildConfig;
use splitplane_core::kernel::{Buffer, Counter, Kernel, TreeBuilder};
use splitplane_core::layout::Counters;
use splitplane_core::lockstep::Inspect;
use splitplane_core::mesh::Mesh;
use splitplane_core::schedule::Executor;
use splitplane_core::watch::Stage;

use crate::buffers::{Buffers, Memory};
use crate::cached::build_cached::{self, Caps, Totals};
use crate::cached::small_root::Subtrees;
use crate::kernels::build_small::BATCH;
use crate::kernels::{self, allocate_children::Lists, scatter_references::Inputs};
use crate::lookout::{Lookout, UNWATCHED};
use crate::query::{InstructionSet, WalkNode};

/// The CPU executor: one build over one mesh, in the arithmetic `A`: [`Strict`] but in tests. Work runs in the
/// rayon pool of the calling thread.
#[derive(Debug)]
pub struct CpuExecutor<'a, A = Strict> {
    mesh: Mesh<'a>,
    config: BuildConfig,
    set: InstructionSet,
    buffers: Buffers,
    memory: Memory,
    lookout: &'a Lookout<'a>,
    /// T as the levels have it, where tasks build what has fewer references ([`crate::cached::build_cached`]).
    cached: Option<u32>,
    /// Whether the tree is void since a cap might have bound.
    void: bool,
    arithmetic: PhantomData<A>,
}

impl<'a, A: Arithmetic> CpuExecutor<'a, A> {
    /// An executor ready for [`splitplane_core::schedule::build`]. `buffers` may come from an
    /// earlier build; `set` must come from [`InstructionSet::available`], or the portable one serves.
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
        let set = if available { set } else { InstructionSet::Portable };
        CpuExecutor::on(mesh, config, set, buffers, limit)
    }

    /// As [`CpuExecutor::new`], for a set that the processor is known to have.
    ///
    /// # Errors
    /// As for [`CpuExecutor::new`].
    pub(crate) fn on(
        mesh: Mesh<'a>,
        config: BuildConfig,
        set: InstructionSet,
        mut buffers: Buffers,
        limit: Option<u64>,
    ) -> Result<CpuExecutor<'a, A>, BuildError> {
        buffers.counters = Counters::at_start(mesh.len() as u32);
        buffers.growth = 0;
        if limit.is_some_and(|limit| buffers.bytes() > limit) {
            // Memory of a larger build before: a limit must not depend on what was built earlier.
            buffers = Buffers { counters: buffers.counters, ..Buffers::default() };
        }
        let mut memory = Memory { held: 0, peak: 0, limit };
        memory.take(buffers.bytes())?;
        Ok(CpuExecutor {
            mesh,
            config,
            set,
            buffers,
            memory,
            lookout: &UNWATCHED,
            cached: None,
            void: false,
            arithmetic: PhantomData,
        })
    }

    /// The executor under a lookout, which may end the build.
    pub(crate) fn watched(self, lookout: &'a Lookout<'a>) -> CpuExecutor<'a, A> {
        CpuExecutor { lookout, ..self }
    }

    /// The executor with the lower levels built by tasks: the same tree, unless [`CpuExecutor::is_void`], and not
    /// where the last build of the kind was void. What buffers hold between dispatches is then not what other
    /// executors hold.
    pub(crate) fn cached(self) -> CpuExecutor<'a, A> {
        let triangles = self.mesh.len() as u32;
        let void_before = self.buffers.voided == Some((triangles, self.config));
        CpuExecutor { cached: (!void_before).then_some(0), ..self }
    }

    /// Whether a cap might have bound, so that the tree must be built by the schedule as it stands.
    pub(crate) fn is_void(&self) -> bool {
        self.void
    }

    /// Levels of the large-node stage, and small roots, wherever they were built.
    pub(crate) fn totals(&self) -> Totals {
        let mut totals = Totals {
            levels: self.buffers.counters[Counter::Levels],
            small_roots: self.buffers.counters[Counter::SmallRoots],
        };
        if self.cached.is_some() {
            totals.small_roots = 0;
            for task in &self.buffers.totals[..self.count(Counter::SmallRoots)] {
                totals.levels = totals.levels.max(task.levels);
                totals.small_roots += task.small_roots;
            }
        }
        totals
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
            Buffer::Input | Buffer::Subtrees | Buffer::ChunkState => None,
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
            Buffer::TopSizes => bytes(&b.top_sizes, length),
            Buffer::TopAddresses => bytes(&b.top_addresses, length),
            Buffer::Nodes => bytes(&b.nodes, length),
            Buffer::LeafReferences => bytes(&b.leaf_references, length),
        }
    }

    /// Gives the buffers back, with the finished tree in them.
    pub fn finish(self) -> Buffers {
        self.buffers
    }

    fn count(&self, counter: Counter) -> usize {
        self.buffers.counters[counter] as usize
    }

    /// The lower levels and all small roots, by tasks.
    fn build_cached(&mut self) -> Result<(), BuildError> {
        let Some(planes) = self.config.preset.planes() else { return Ok(()) };
        let roots = self.count(Counter::SmallRoots);
        let triangles = self.count(Counter::Triangles) as u32;
        let (b, m) = (&mut self.buffers, &mut self.memory);
        m.grow_watched(&mut b.small_sizes, roots, self.lookout)?;
        let before = b.bytes();
        m.reserve(&mut b.subtrees, roots)?;
        b.subtrees.resize_with(roots.max(b.subtrees.len()), Subtrees::default);
        m.reserve(&mut b.totals, roots)?;
        b.totals.resize(roots.max(b.totals.len()), Totals::default());
        b.workers.prepare(rayon::current_num_threads()).map_err(|_| m.lacking())?;
        let kept = u64::from(b.counters[Counter::Triangles] - b.counters[Counter::Dropped]);
        let caps = Caps::new(
            &self.config,
            triangles,
            kept + b.growth,
            u64::from(b.counters[Counter::TopNodes]),
        );
        let inputs = build_cached::Inputs {
            look: self.lookout,
            config: &self.config,
            planes,
            limit: self.cached.unwrap_or_default(),
            set: self.set,
            roots: &b.small_roots[..roots],
            references: &b.small_references,
            triangles: &b.triangles,
            level_starts: &b.level_starts,
            caps: &caps,
        };
        build_cached::run::<A>(
            &inputs,
            &b.workers,
            &mut b.small_sizes[..roots],
            &mut b.totals[..roots],
            &mut b.subtrees[..roots],
        )
        .map_err(|_| m.lacking())?;
        self.void = caps.exceeded();
        b.voided = self.void.then_some((triangles, self.config));
        b.workers.prepare(rayon::current_num_threads()).map_err(|_| m.lacking())?;
        m.take(b.bytes() - before)
    }

    /// Sums sizes in 64 bits before anything trusts the 32-bit ones.
    fn check_size(&self) -> Result<(), BuildError> {
        let b = &self.buffers;
        let small = &b.small_sizes[..self.count(Counter::SmallRoots)];
        let top = self.count(Counter::TopNodes) as u64;
        let nodes = top + small.iter().map(|size| u64::from(size.nodes)).sum::<u64>();
        let references = small.iter().map(|size| u64::from(size.references)).sum::<u64>();
        if nodes > u64::from(WalkNode::MOST) || references > u64::from(u32::MAX) {
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

impl<A: Arithmetic> Executor<TreeBuilder> for CpuExecutor<'_, A> {
    type Error = BuildError;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), BuildError> {
        use kernels as k;
        if self.void {
            return Ok(());
        }
        let triangles = self.count(Counter::Triangles);
        let input_chunks = self.count(Counter::InputChunks);
        let active = self.count(Counter::ActiveNodes);
        let references = self.count(Counter::ActiveReferences);
        let chunks = self.count(Counter::Chunks);
        let top = self.count(Counter::TopNodes);
        let small = self.count(Counter::SmallRoots);
        let b = &mut self.buffers;
        let m = &mut self.memory;
        let look = self.lookout;
        // The configuration as the levels have it.
        let mut levels = self.config;
        levels.small_node_limit = self.cached.unwrap_or(levels.small_node_limit);
        match kernel {
            Kernel::TriangleBounds => {
                // Their bounds, then their references.
                look.begin(Stage::Start, 2 * triangles as u64);
                m.grow_watched(&mut b.triangles, triangles, look)?;
                m.grow_watched(&mut b.chunk_counts, input_chunks, look)?;
                m.grow_watched(&mut b.chunk_bounds, input_chunks, look)?;
                k::triangle_bounds::run(
                    look,
                    &self.mesh,
                    &mut b.triangles[..triangles],
                    &mut b.chunk_counts[..input_chunks],
                    &mut b.chunk_bounds[..input_chunks],
                );
            }
            Kernel::ScanTriangles => {
                m.grow_watched(&mut b.active_nodes, 1, look)?;
                m.grow_watched(&mut b.top_nodes, 1, look)?;
                k::scan_triangles::run(
                    &mut b.chunk_counts[..input_chunks],
                    &b.chunk_bounds[..input_chunks],
                    &mut b.active_nodes[0],
                    &mut b.top_nodes[0],
                    &mut b.counters,
                );
                b.root_bounds = b.active_nodes[0].cell();
                let kept = b.active_nodes[0].count as usize;
                self.cached =
                    self.cached.map(|_| build_cached::limit(kept, rayon::current_num_threads()));
            }
            Kernel::GatherReferences => {
                m.grow_watched(&mut b.references, references, look)?;
                k::gather_references::run(
                    look,
                    &b.triangles[..triangles],
                    &b.chunk_counts[..input_chunks],
                    &mut b.references[..references],
                );
                look.finish();
            }
            Kernel::NodeBounds => {
                if b.counters[Counter::Levels] == 0 {
                    look.begin(Stage::LargeNodes, 0);
                }
                m.grow_watched(&mut b.node_bounds, active, look)?;
                k::node_bounds::run(
                    look,
                    &b.active_nodes[..active],
                    &b.chunk_bounds,
                    &mut b.node_bounds[..active],
                );
            }
            Kernel::SplitLarge => {
                m.grow_watched(&mut b.decisions, active, look)?;
                k::split_large::run::<A>(
                    look,
                    &levels,
                    &b.active_nodes[..active],
                    &b.node_bounds[..active],
                    &b.references[..references],
                    &mut b.decisions[..active],
                );
            }
            Kernel::BinReferences => {
                m.grow_watched(&mut b.chunk_bins, chunks, look)?;
                k::bin_references::run::<A>(
                    look,
                    self.set,
                    self.config.bins,
                    &b.chunks[..chunks],
                    &b.node_bounds[..active],
                    &b.references[..references],
                    &mut b.chunk_bins[..chunks],
                );
            }
            Kernel::SplitBinned => {
                m.grow_watched(&mut b.decisions, active, look)?;
                k::split_binned::run::<A>(
                    look,
                    &levels,
                    &b.active_nodes[..active],
                    &b.node_bounds[..active],
                    &b.chunk_bins[..chunks],
                    &mut b.decisions[..active],
                );
            }
            Kernel::ChunkNodes => {
                k::chunk_nodes::run(&mut b.active_nodes[..active], &mut b.counters);
            }
            Kernel::AssignChunks => {
                m.grow_watched(&mut b.chunks, chunks, look)?;
                k::assign_chunks::run(&b.active_nodes[..active], &mut b.chunks[..chunks]);
            }
            Kernel::ClassifyReferences => {
                m.grow_watched(&mut b.reference_sides, chunks, look)?;
                m.grow_watched(&mut b.chunk_counts, chunks, look)?;
                k::classify_references::run::<A>(
                    look,
                    self.config.clip,
                    &b.chunks[..chunks],
                    &b.decisions[..active],
                    &b.references[..references],
                    &b.triangles[..triangles],
                    &mut b.reference_sides[..chunks],
                    &mut b.chunk_counts[..chunks],
                );
            }
            Kernel::CountChildren => {
                k::count_children::run(
                    &b.active_nodes[..active],
                    &mut b.chunk_counts[..chunks],
                    &mut b.decisions[..active],
                );
            }
            Kernel::AllocateChildren => {
                // For all that the active nodes can become, since nothing can fail on the way.
                let [top, small, next] = k::allocate_children::most(&b.decisions[..active]);
                m.double_room(&mut b.top_nodes, b.counters[Counter::TopNodes] as usize + top)?;
                m.double_room(
                    &mut b.small_roots,
                    b.counters[Counter::SmallRoots] as usize + small,
                )?;
                m.double_room(&mut b.next_nodes, next)?;
                m.double_room(&mut b.level_starts, b.counters[Counter::Levels] as usize + 1)?;
                let mut lists = Lists {
                    next: &mut b.next_nodes,
                    small: &mut b.small_roots,
                    top: &mut b.top_nodes,
                    level_starts: &mut b.level_starts,
                    growth: &mut b.growth,
                };
                k::allocate_children::run(
                    &levels,
                    &b.active_nodes[..active],
                    &mut b.decisions[..active],
                    &mut lists,
                    &mut b.counters,
                );
                look.advance(1);
            }
            Kernel::ScatterReferences => {
                let next = b.counters[Counter::NextReferences] as usize;
                let small = b.counters[Counter::SmallReferences] as usize;
                m.grow_watched(&mut b.next_references, next, look)?;
                // The small references collect over all levels: room for more than this one.
                if b.small_references.len() < small {
                    m.grow_watched(&mut b.small_references, small + small / 4, look)?;
                }
                m.grow_watched(&mut b.chunk_bounds, chunks, look)?;
                let inputs = Inputs {
                    small_node_limit: levels.small_node_limit,
                    clip: self.config.clip,
                    chunks: &b.chunks[..chunks],
                    decisions: &b.decisions[..active],
                    references: &b.references[..references],
                    reference_sides: &b.reference_sides[..chunks],
                    chunk_counts: &b.chunk_counts[..chunks],
                    triangles: &b.triangles[..triangles],
                };
                k::scatter_references::run::<A>(
                    look,
                    &inputs,
                    &mut b.next_references[..next],
                    &mut b.small_references[..small],
                    &mut b.chunk_bounds[..chunks],
                );
            }
            Kernel::BuildSmall if self.cached.is_some() => {
                look.begin(Stage::SmallNodes, u64::from(b.counters[Counter::SmallReferences]));
                self.build_cached()?;
                look.finish();
                look.check()?;
                self.check_size()?;
            }
            Kernel::BuildSmall => {
                look.begin(Stage::SmallNodes, small as u64);
                m.grow_watched(&mut b.small_sizes, small, look)?;
                let batches = small.div_ceil(BATCH);
                m.reserve(&mut b.subtrees, batches)?;
                b.subtrees.resize_with(batches.max(b.subtrees.len()), Subtrees::default);
                let before: u64 = b.subtrees.iter().map(Subtrees::bytes).sum();
                k::build_small::run::<A>(
                    look,
                    &self.config,
                    self.set,
                    &b.small_roots[..small],
                    &b.small_references,
                    &mut b.small_sizes[..small],
                    &mut b.subtrees[..batches],
                )
                .map_err(|_| m.lacking())?;
                let after: u64 = b.subtrees.iter().map(Subtrees::bytes).sum();
                m.take(after - before)?;
                look.finish();
                look.check()?;
                self.check_size()?;
            }
            Kernel::SubtreeSizes => {
                look.begin(Stage::Output, small as u64);
                m.grow_watched(&mut b.top_sizes, top, look)?;
                k::subtree_sizes::run(
                    &b.top_nodes[..top],
                    &b.small_sizes[..small],
                    &mut b.top_sizes[..top],
                    &mut b.counters,
                );
            }
            Kernel::PreorderAddresses => {
                m.grow_watched(&mut b.top_addresses, top, look)?;
                k::preorder_addresses::run(
                    &b.top_nodes[..top],
                    &b.top_sizes[..top],
                    &mut b.top_addresses[..top],
                );
            }
            Kernel::EmitTop => {
                let nodes = b.counters[Counter::Nodes] as usize;
                m.grow_watched(&mut b.nodes, nodes, look)?;
                k::emit_top::run(
                    &b.top_nodes[..top],
                    &b.top_addresses[..top],
                    &mut b.nodes[..nodes],
                );
            }
            Kernel::EmitSmall => {
                let nodes = b.counters[Counter::Nodes] as usize;
                let leaf_references = b.counters[Counter::LeafReferences] as usize;
                m.grow_watched(&mut b.leaf_references, leaf_references, look)?;
                k::emit_small::run(
                    look,
                    if self.cached.is_some() { 1 } else { BATCH },
                    &b.small_roots[..small],
                    &b.small_sizes[..small],
                    &b.subtrees,
                    &b.top_addresses[..top],
                    &mut b.nodes[..nodes],
                    &mut b.leaf_references[..leaf_references],
                );
                look.finish();
            }
        }
        look.check()
    }

    fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), BuildError> {
        let buffers = &mut self.buffers;
        let (one, other) = match (a, b) {
            (Buffer::ActiveNodes, Buffer::NextNodes) => {
                core::mem::swap(&mut buffers.active_nodes, &mut buffers.next_nodes);
                (Counter::ActiveNodes, Counter::NextNodes)
            }
            (Buffer::References, Buffer::NextReferences) => {
                core::mem::swap(&mut buffers.references, &mut buffers.next_references);
                (Counter::ActiveReferences, Counter::NextReferences)
            }
            _ => return Err(BuildError::Device(format!("{a:?} and {b:?} cannot be exchanged"))),
        };
        buffers.counters.words.swap(one as usize, other as usize);
        Ok(())
    }

    fn pending(&mut self, counter: Counter, _rounds: u32) -> Result<bool, BuildError> {
        Ok(self.buffers.counters[counter] > 0)
    }
}
