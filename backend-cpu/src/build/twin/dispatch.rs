//! The kernels of the schedule, dispatched over the executor's buffers.

use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::build::middle::Region;
use splitplane_core::build::reference::kernels::is_of_middle_stage;
use splitplane_core::build::schedule::Executor;
use splitplane_core::error::{BuildError, DeviceError};
use splitplane_core::kernel::{Buffer, Counter, Kernel, TreeBuilder};
use splitplane_core::watch::Stage;

use super::executor::CpuExecutor;
use super::kernels;
use super::subtrees::Subtrees;
use crate::build::twin::kernels::allocate_children::Lists;
use crate::build::twin::kernels::build_small::BATCH;
use crate::build::twin::kernels::scatter_references::Inputs;

impl<A: Arithmetic> CpuExecutor<'_, A> {
    /// Runs `emit_small`. The subtrees of `batch` roots each are in one element of the buffer.
    pub(in crate::build) fn emit_small(&mut self, batch: usize) -> Result<(), BuildError> {
        let small = self.count(Counter::SmallRoots);
        let (b, m, meter) = (&mut self.buffers, &mut self.memory, self.meter);
        let nodes = b.counters[Counter::Nodes] as usize;
        let leaf_references = b.counters[Counter::LeafReferences] as usize;
        m.grow_watched(&mut b.leaf_references, leaf_references, meter)?;
        kernels::emit_small::run(
            meter,
            batch,
            &b.small_roots[..small],
            &b.small_sizes[..small],
            &b.subtrees,
            &b.small_addresses[..small],
            &mut b.nodes[..nodes],
            &mut b.leaf_references[..leaf_references],
        );
        meter.finish_stage();
        meter.check()
    }
}

impl<A: Arithmetic> Executor<TreeBuilder> for CpuExecutor<'_, A> {
    type Error = BuildError;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), BuildError> {
        use kernels as k;
        // What `emit_middle` writes has its room even where it is left out, so that executors can be compared.
        let left_out = is_of_middle_stage(kernel) && !self.middle;
        if self.is_void() || (left_out && kernel != Kernel::EmitMiddle) {
            return Ok(());
        }
        let levels = self.levels();
        let triangles = self.count(Counter::Triangles);
        let input_chunks = self.count(Counter::InputChunks);
        let active = self.count(Counter::ActiveNodes);
        let references = self.count(Counter::ActiveReferences);
        let chunks = self.count(Counter::Chunks);
        let top = self.count(Counter::TopNodes);
        let small = self.count(Counter::SmallRoots);
        // While nodes are active more will be handed over.
        let middle = if active > 0 { 0 } else { self.count(Counter::MiddleRoots) };
        let b = &mut self.buffers;
        let m = &mut self.memory;
        let meter = self.meter;
        match kernel {
            Kernel::TriangleBounds => {
                // Their bounds, then their references.
                meter.begin_stage(Stage::Start, 2 * triangles as u64);
                m.grow_watched(&mut b.triangles, triangles, meter)?;
                m.grow_watched(&mut b.chunk_counts, input_chunks, meter)?;
                m.grow_watched(&mut b.chunk_bounds, input_chunks, meter)?;
                k::triangle_bounds::run(
                    meter,
                    &self.mesh,
                    &mut b.triangles[..triangles],
                    &mut b.chunk_counts[..input_chunks],
                    &mut b.chunk_bounds[..input_chunks],
                );
            }
            Kernel::ScanTriangles => {
                m.grow_watched(&mut b.active_nodes, 1, meter)?;
                m.grow_watched(&mut b.top_nodes, 1, meter)?;
                k::scan_triangles::run(
                    &mut b.chunk_counts[..input_chunks],
                    &b.chunk_bounds[..input_chunks],
                    &mut b.active_nodes[0],
                    &mut b.top_nodes[0],
                    &mut b.counters,
                );
                b.root_bounds = b.active_nodes[0].cell();
            }
            Kernel::GatherReferences => {
                m.grow_watched(&mut b.references, references, meter)?;
                k::gather_references::run(
                    meter,
                    &b.triangles[..triangles],
                    &b.chunk_counts[..input_chunks],
                    &mut b.references[..references],
                );
                meter.finish_stage();
            }
            Kernel::NodeBounds => {
                if b.counters[Counter::Levels] == 0 {
                    meter.begin_stage(Stage::LargeNodes, 0);
                }
                m.grow_watched(&mut b.chunks, chunks, meter)?;
                m.grow_watched(&mut b.node_bounds, active, meter)?;
                k::node_bounds::run(
                    meter,
                    &b.active_nodes[..active],
                    &b.chunk_bounds,
                    &mut b.chunks[..chunks],
                    &mut b.node_bounds[..active],
                );
            }
            Kernel::SplitMedian => {
                if b.counters[Counter::Levels] == 0 {
                    meter.begin_stage(Stage::LargeNodes, 0);
                }
                m.grow_watched(&mut b.chunks, chunks, meter)?;
                m.grow_watched(&mut b.decisions, active, meter)?;
                k::split_median::run::<A>(
                    meter,
                    &levels,
                    &b.active_nodes[..active],
                    &b.chunk_bounds,
                    &b.references[..references],
                    &mut b.chunks[..chunks],
                    &mut b.decisions[..active],
                );
            }
            Kernel::BinReferences => {
                m.grow_watched(&mut b.chunk_bins, chunks, meter)?;
                k::bin_references::run::<A>(
                    meter,
                    self.set,
                    self.config.bins(),
                    &b.chunks[..chunks],
                    &b.node_bounds[..active],
                    &b.references[..references],
                    &mut b.chunk_bins[..chunks],
                );
            }
            Kernel::SplitBinned => {
                m.grow_watched(&mut b.decisions, active, meter)?;
                k::split_binned::run::<A>(
                    meter,
                    &self.config,
                    &b.active_nodes[..active],
                    &b.node_bounds[..active],
                    &b.chunk_bins[..chunks],
                    &mut b.decisions[..active],
                );
            }
            Kernel::ClassifyReferences => {
                m.grow_watched(&mut b.reference_sides, chunks, meter)?;
                m.grow_watched(&mut b.chunk_counts, chunks, meter)?;
                k::classify_references::run::<A>(
                    meter,
                    self.config.clip,
                    &mut b.chunks[..chunks],
                    &mut b.decisions[..active],
                    &b.references[..references],
                    &b.triangles[..triangles],
                    &mut b.reference_sides[..chunks],
                    &mut b.chunk_counts[..chunks],
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
                if self.middle {
                    b.counters[Counter::MiddleRoots] = b.counters[Counter::SmallRoots];
                }
                meter.advance(1);
            }
            Kernel::ScatterReferences => {
                let next = b.counters[Counter::NextReferences] as usize;
                let small = b.counters[Counter::SmallReferences] as usize;
                m.grow_watched(&mut b.next_references, next, meter)?;
                // The small references collect over all levels: space for more than this one.
                if b.small_references.len() < small {
                    m.grow_watched(&mut b.small_references, small + small / 4, meter)?;
                }
                m.grow_watched(&mut b.chunk_bounds, chunks, meter)?;
                m.grow_watched(&mut b.chunk_offsets, chunks, meter)?;
                let inputs = Inputs {
                    small_node_limit: levels.small_node_limit(),
                    clip: self.config.clip,
                    chunks: &b.chunks[..chunks],
                    decisions: &b.decisions[..active],
                    references: &b.references[..references],
                    reference_sides: &b.reference_sides[..chunks],
                    chunk_counts: &b.chunk_counts[..chunks],
                    triangles: &b.triangles[..triangles],
                };
                k::scatter_references::run::<A>(
                    meter,
                    &inputs,
                    &mut b.next_references[..next],
                    &mut b.small_references[..small],
                    &mut b.chunk_bounds[..chunks],
                    &mut b.chunk_offsets[..chunks],
                );
            }
            Kernel::BuildMiddle => {
                let handed = b.counters[Counter::SmallReferences];
                let regions = Region::start(handed, small as u32);
                m.grow_watched(&mut b.middle_roots, middle, meter)?;
                m.grow_watched(&mut b.middle_references, regions.references as usize, meter)?;
                m.grow_watched(&mut b.middle_nodes, regions.nodes as usize, meter)?;
                m.grow_watched(&mut b.middle_leaves, regions.leaves as usize, meter)?;
                let scratch = k::build_middle::scratch();
                m.grow_watched(&mut b.middle_levels, scratch, meter)?;
                k::build_middle::run::<A>(
                    meter,
                    &self.config,
                    &b.small_roots[..middle],
                    &b.small_references,
                    &b.triangles,
                    &mut b.middle_levels[..scratch],
                    &mut k::build_middle::Regions {
                        references: &mut b.middle_references[..regions.references as usize],
                        nodes: &mut b.middle_nodes[..regions.nodes as usize],
                        leaves: &mut b.middle_leaves[..regions.leaves as usize],
                    },
                    &mut b.middle_roots[..middle],
                );
            }
            Kernel::ScanMiddle => {
                let roots = &mut b.middle_roots[..middle];
                k::scan_middle::run(&self.config, roots, &mut b.counters);
            }
            Kernel::PlaceMiddle => {
                let references = b.counters[Counter::SmallReferences] as usize;
                m.grow_watched(&mut b.small_roots, small, meter)?;
                m.grow_watched(&mut b.small_references, references, meter)?;
                k::place_middle::run(
                    &b.middle_roots[..middle],
                    &b.middle_references,
                    &b.middle_leaves,
                    &mut b.small_roots,
                    &mut b.small_references,
                );
            }
            Kernel::MeasureMiddle => {
                m.grow_watched(&mut b.middle_sizes, middle, meter)?;
                k::measure_middle::run(
                    &b.middle_roots[..middle],
                    &b.small_sizes[..small],
                    &mut b.middle_sizes[..middle],
                );
            }
            Kernel::BuildSmall => {
                meter.begin_stage(Stage::SmallNodes, small as u64);
                m.grow_watched(&mut b.small_sizes, small, meter)?;
                let batches = small.div_ceil(BATCH);
                m.reserve(&mut b.subtrees, batches)?;
                b.subtrees.resize_with(batches.max(b.subtrees.len()), Subtrees::default);
                let before: u64 = b.subtrees.iter().map(Subtrees::bytes).sum();
                k::build_small::run::<A>(
                    meter,
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
                meter.finish_stage();
                meter.check()?;
                self.check_size()?;
            }
            Kernel::SubtreeSizes => {
                meter.begin_stage(Stage::Output, small as u64);
                m.grow_watched(&mut b.top_sizes, top, meter)?;
                k::subtree_sizes::run(
                    &b.top_nodes[..top],
                    if middle > 0 { &b.middle_sizes[..middle] } else { &b.small_sizes[..small] },
                    &mut b.top_sizes[..top],
                );
            }
            Kernel::PreorderAddresses => {
                m.grow_watched(&mut b.top_addresses, top, meter)?;
                k::preorder_addresses::run(
                    &b.top_nodes[..top],
                    &b.top_sizes[..top],
                    &mut b.top_addresses[..top],
                    &mut b.counters,
                );
            }
            Kernel::EmitMiddle => {
                let nodes = b.counters[Counter::Nodes] as usize;
                m.grow_watched(&mut b.nodes, nodes, meter)?;
                m.grow_watched(&mut b.small_addresses, small, meter)?;
                k::emit_middle::run(
                    &b.middle_roots[..middle],
                    &b.middle_nodes,
                    &b.small_sizes[..small],
                    &b.top_addresses,
                    &mut b.nodes[..nodes],
                    &mut b.small_addresses[..small],
                );
            }
            Kernel::EmitTop => {
                let nodes = b.counters[Counter::Nodes] as usize;
                m.grow_watched(&mut b.nodes, nodes, meter)?;
                m.grow_watched(&mut b.small_addresses, small, meter)?;
                if middle == 0 {
                    k::emit_top::address_small_roots(
                        &b.top_nodes[..top],
                        &b.top_addresses[..top],
                        &mut b.small_addresses[..small],
                    );
                }
                k::emit_top::run(
                    &b.top_nodes[..top],
                    &b.top_addresses[..top],
                    &mut b.nodes[..nodes],
                );
            }
            Kernel::EmitSmall => return self.emit_small(BATCH),
        }
        meter.check()
    }

    fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), BuildError> {
        let buffers = &mut self.buffers;
        let (one, other) = match (a, b) {
            (Buffer::ActiveNodes, Buffer::NextNodes) => {
                core::mem::swap(&mut buffers.active_nodes, &mut buffers.next_nodes);
                let chunks = [Counter::Chunks as usize, Counter::NextChunks as usize];
                buffers.counters.words.swap(chunks[0], chunks[1]);
                (Counter::ActiveNodes, Counter::NextNodes)
            }
            (Buffer::References, Buffer::NextReferences) => {
                core::mem::swap(&mut buffers.references, &mut buffers.next_references);
                (Counter::ActiveReferences, Counter::NextReferences)
            }
            _ => {
                return Err(BuildError::Device(DeviceError::Failed(format!(
                    "{a:?} and {b:?} cannot be exchanged"
                ))));
            }
        };
        buffers.counters.words.swap(one as usize, other as usize);
        Ok(())
    }

    fn pending(&mut self, counter: Counter, _rounds: u32) -> Result<bool, BuildError> {
        Ok(self.buffers.counters[counter] > 0)
    }
}
