//! Runs the kernels one item at a time.

use core::marker::PhantomData;

use alloc::vec::Vec;

use super::kernels::{self as k, Lists};
use super::{Budget, Buffers};
use crate::aabb::Aabb;
use crate::arithmetic::{Arithmetic, Strict};
use crate::build::lockstep::Inspect;
use crate::build::middle::{LEVEL_REFERENCES, Region, hand_over_limit};
use crate::build::schedule::Executor;
use crate::config::{BuildConfig, Planes};
use crate::error::BuildError;
use crate::kernel::{Buffer, Counter, Kernel, TreeBuilder};
use crate::layout::{Extent, Reference};
use crate::mesh::Mesh;
use crate::report::BuildSummary;
use crate::tree::KdTree;
use crate::watch::Stage;

/// The reference executor: one build over one mesh, on the calling thread, in the arithmetic `A`:
/// [`Strict`] except in tests.
#[derive(Debug)]
pub struct ReferenceExecutor<'a, A = Strict> {
    mesh: Mesh<'a>,
    config: BuildConfig,
    /// Whether the levels hand nodes over to the middle stage.
    middle: bool,
    buffers: Buffers,
    budget: Budget<'a>,
    /// References of two levels of a middle root that is being finished.
    levels_of_middle_root: [Vec<Reference>; 2],
    /// Bounds of all triangles kept.
    bounds: Aabb,
    arithmetic: PhantomData<A>,
}

impl<'a> ReferenceExecutor<'a> {
    /// An executor ready for [`build::schedule::build`](crate::build::schedule::build).
    ///
    /// # Errors
    /// A configuration out of range.
    pub fn new(
        mesh: Mesh<'a>,
        config: BuildConfig,
        budget: Budget<'a>,
    ) -> Result<ReferenceExecutor<'a>, BuildError> {
        ReferenceExecutor::in_arithmetic(mesh, config, budget)
    }
}

impl<'a, A: Arithmetic> ReferenceExecutor<'a, A> {
    /// As [`ReferenceExecutor::new`], in any arithmetic: for tests of the rules themselves.
    ///
    /// # Errors
    /// A configuration out of range.
    pub fn in_arithmetic(
        mesh: Mesh<'a>,
        config: BuildConfig,
        budget: Budget<'a>,
    ) -> Result<ReferenceExecutor<'a, A>, BuildError> {
        config.validate()?;
        let buffers = Buffers::new(mesh.len() as u32);
        let (bounds, arithmetic) = (Aabb::EMPTY, PhantomData);
        Ok(ReferenceExecutor {
            mesh,
            config,
            middle: false,
            buffers,
            budget,
            levels_of_middle_root: Default::default(),
            bounds,
            arithmetic,
        })
    }

    /// With the middle stage: see [`build::middle`](crate::build::middle). The build may then turn out void, as
    /// [`ReferenceExecutor::is_void`] says.
    #[must_use]
    pub fn with_middle_stage(self) -> ReferenceExecutor<'a, A> {
        // Planes of bins have no such stage.
        let middle = self.config.preset().planes() == Some(Planes::Median);
        ReferenceExecutor { middle, ..self }
    }

    /// Whether the build is void, so that there is no tree: another one must do without the middle stage.
    pub fn is_void(&self) -> bool {
        self.buffers.counters[Counter::Overflow] != 0
    }

    /// The configuration with which levels run: with a middle stage T is what that takes.
    fn levels(&self) -> BuildConfig {
        let limit = hand_over_limit(&self.config);
        match self.middle {
            true => self.config.with_stages(|stages| stages.small_node_limit = limit),
            false => self.config,
        }
    }

    /// The buffers as the last kernel left them.
    pub fn buffers(&self) -> &Buffers {
        &self.buffers
    }

    /// The buffers, for callers that run a kernel by other means; [`ReferenceExecutor::make_room`] comes first.
    pub fn buffers_mut(&mut self) -> &mut Buffers {
        &mut self.buffers
    }

    /// Gives a kernel's buffers the room that it needs, within the budget. Dispatches do that themselves.
    ///
    /// # Errors
    /// [`BuildError::OutOfMemory`].
    pub fn make_room(&mut self, kernel: Kernel) -> Result<(), BuildError> {
        self.buffers.make_room(kernel, &mut self.budget)
    }

    /// What the build did with its input, once it is done.
    pub fn summary(&self) -> BuildSummary {
        let counters = &self.buffers.counters;
        BuildSummary {
            triangles: counters[Counter::Triangles],
            dropped: counters[Counter::Dropped],
            snapped: counters[Counter::Snapped],
            large_levels: counters[Counter::Levels].max(counters[Counter::MiddleLevels]),
            small_roots: counters[Counter::SmallRoots],
            peak_bytes: self.budget.peak(),
        }
    }

    /// The memory and the progress of the build.
    pub fn budget(&self) -> &Budget<'a> {
        &self.budget
    }

    /// The tree that [`build::schedule::build`](crate::build::schedule::build) has built.
    pub fn into_tree(self) -> KdTree {
        self.buffers.into_tree(self.bounds, self.config)
    }

    /// Begins the stage whose first kernel this is.
    fn begin(&mut self, kernel: Kernel) -> Result<(), BuildError> {
        let b = &self.buffers;
        let small_roots = b.count(Counter::SmallRoots) as u64;
        match kernel {
            // Their bounds, then their references.
            Kernel::TriangleBounds => self.budget.begin(Stage::Start, 2 * self.mesh.len() as u64),
            Kernel::SplitMedian | Kernel::NodeBounds if b.count(Counter::Levels) == 0 => {
                self.budget.begin(Stage::LargeNodes, 0)
            }
            Kernel::BuildSmall => self.budget.begin(Stage::SmallNodes, small_roots),
            Kernel::SubtreeSizes => self.budget.begin(Stage::Output, small_roots),
            _ => Ok(()),
        }
    }
}

impl<A: Arithmetic> Executor<TreeBuilder> for ReferenceExecutor<'_, A> {
    type Error = BuildError;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), BuildError> {
        if self.is_void() {
            return Ok(());
        }
        if k::is_of_middle_stage(kernel) && !self.middle {
            // What it would write has its room all the same, so that executors can be compared.
            return if kernel == Kernel::EmitMiddle { self.make_room(kernel) } else { Ok(()) };
        }
        self.begin(kernel)?;
        self.make_room(kernel)?;
        let levels = &self.levels();
        let (mesh, config, budget) = (&self.mesh, &self.config, &mut self.budget);
        let b = &mut self.buffers;
        let active = b.count(Counter::ActiveNodes);
        let chunks = b.count(Counter::Chunks);
        let input_chunks = b.count(Counter::InputChunks);
        let small = b.count(Counter::SmallRoots);
        let top = b.count(Counter::TopNodes);
        // While nodes are active more will be handed over.
        let middle = if active > 0 { 0 } else { b.count(Counter::MiddleRoots) };
        match kernel {
            Kernel::TriangleBounds => {
                for chunk in 0..input_chunks {
                    let triangles = &mut b.triangles[k::triangles_of(chunk, mesh.len())];
                    (b.chunk_counts[chunk], b.chunk_bounds[chunk]) =
                        k::triangle_bounds(chunk, mesh, triangles);
                    budget.advance(triangles.len() as u64);
                    budget.worked(triangles.len() as u64)?;
                }
            }
            Kernel::ScanTriangles => {
                (b.active_nodes[0], b.top_nodes[0]) = k::scan_triangles(
                    &b.chunk_bounds[..input_chunks],
                    &mut b.chunk_counts[..input_chunks],
                    &mut b.counters,
                );
                self.bounds = b.active_nodes[0].cell();
            }
            Kernel::GatherReferences => {
                let kept = b.count(Counter::ActiveReferences);
                for chunk in 0..input_chunks {
                    let own = k::gathered(chunk, &b.chunk_counts[..input_chunks], kept);
                    let triangles = &b.triangles[..mesh.len()];
                    k::gather_references(chunk, triangles, &mut b.references[own]);
                    let done = k::triangles_of(chunk, mesh.len()).len() as u64;
                    budget.advance(done);
                    budget.worked(done)?;
                }
                budget.finish()?;
            }
            Kernel::NodeBounds => {
                for node in 0..active {
                    let own = k::chunks_of(&b.active_nodes[node]);
                    k::name_chunks(node, &b.active_nodes, &mut b.chunks[own]);
                    b.node_bounds[node] = k::node_bounds(node, &b.active_nodes, &b.chunk_bounds);
                    budget.worked(u64::from(b.active_nodes[node].source_chunks))?;
                }
            }
            Kernel::SplitMedian => {
                for node in 0..active {
                    let own = k::chunks_of(&b.active_nodes[node]);
                    k::name_chunks(node, &b.active_nodes, &mut b.chunks[own]);
                    let tight = k::node_bounds(node, &b.active_nodes, &b.chunk_bounds);
                    let this = &b.active_nodes[node];
                    let mut asked = budget.worked(4 + u64::from(this.source_chunks));
                    let go_on = |work| {
                        if asked.is_ok() {
                            asked = budget.worked(work);
                        }
                        asked.is_ok()
                    };
                    b.decisions[node] =
                        k::split_median_while::<A>(levels, this, &tight, &b.references, go_on);
                    asked?;
                }
            }
            Kernel::BinReferences => {
                for chunk in 0..chunks {
                    b.chunk_bins[chunk] = k::bin_references::<A>(
                        config,
                        chunk,
                        &b.chunks,
                        &b.node_bounds,
                        &b.references,
                    );
                    budget.worked(u64::from(b.chunks[chunk].count))?;
                }
            }
            Kernel::SplitBinned => {
                for node in 0..active {
                    b.decisions[node] = k::split_binned::<A>(
                        config,
                        node,
                        &b.active_nodes,
                        &b.node_bounds,
                        &b.chunk_bins,
                    );
                    budget.worked(u64::from(b.active_nodes[node].count / 4))?;
                }
            }
            Kernel::ClassifyReferences => {
                for chunk in 0..chunks {
                    let (sides, counts) = k::classify_references::<A>(
                        config,
                        chunk,
                        &b.chunks,
                        &b.decisions,
                        &b.references,
                        &b.triangles,
                    );
                    k::count_children(chunk, counts, &mut b.chunks, &mut b.decisions);
                    (b.reference_sides[chunk], b.chunk_counts[chunk]) = (sides, counts);
                    budget.worked(u64::from(b.chunks[chunk].count))?;
                }
            }
            Kernel::AllocateChildren => {
                let mut lists = Lists {
                    next_nodes: &mut b.next_nodes,
                    small_roots: &mut b.small_roots,
                    top_nodes: &mut b.top_nodes,
                    level_starts: &mut b.level_starts,
                };
                k::allocate_children(
                    levels,
                    &b.active_nodes[..active],
                    &mut b.decisions[..active],
                    &mut lists,
                    &mut b.counters,
                );
                if self.middle {
                    b.counters[Counter::MiddleRoots] = b.counters[Counter::SmallRoots];
                }
                budget.advance(1);
                budget.worked(active as u64)?;
            }
            Kernel::ScatterReferences => {
                let children = k::destinations(
                    levels,
                    &b.chunks[..chunks],
                    &b.decisions,
                    &b.reference_sides,
                    &mut b.next_references,
                    &mut b.small_references,
                );
                for (chunk, children) in children.enumerate() {
                    b.chunk_bounds[chunk] = k::scatter_references::<A>(
                        config,
                        chunk,
                        &b.chunks,
                        &b.decisions,
                        &b.references,
                        &b.triangles,
                        &b.reference_sides,
                        children,
                    );
                    budget.worked(2 * u64::from(b.chunks[chunk].count))?;
                }
            }
            Kernel::BuildMiddle => {
                for list in &mut self.levels_of_middle_root {
                    budget.grow(list, LEVEL_REFERENCES as usize)?;
                }
                for root in 0..middle {
                    let this = &b.small_roots[root];
                    let (start, length) =
                        (Region::start(this.first, root as u32), Region::of(this.count));
                    let [one, other] = &mut self.levels_of_middle_root;
                    let mut region = k::MiddleRegion {
                        levels: [one, other],
                        references: &mut b.middle_references[start.references as usize..]
                            [..length.references as usize],
                        nodes: &mut b.middle_nodes[start.nodes as usize..][..length.nodes as usize],
                        leaves: &mut b.middle_leaves[start.leaves as usize..]
                            [..length.leaves as usize],
                    };
                    // Its levels are at most some twenty.
                    let work = 16 * u64::from(this.count.min(levels.small_node_limit()));
                    b.middle_roots[root] = k::build_middle::<A>(
                        config,
                        root,
                        &b.small_roots,
                        &b.small_references,
                        &b.triangles,
                        &mut region,
                    );
                    budget.worked(work)?;
                }
            }
            Kernel::ScanMiddle => {
                k::scan_middle(config, &mut b.middle_roots[..middle], &mut b.counters);
            }
            Kernel::PlaceMiddle => {
                for root in 0..middle {
                    let this = &b.middle_roots[root];
                    k::place_middle(
                        root,
                        &b.middle_roots,
                        &b.middle_references,
                        &b.middle_leaves,
                        &mut b.small_roots[this.first_leaf as usize..][..this.leaves as usize],
                        &mut b.small_references[this.first_reference as usize..]
                            [..this.references as usize],
                    );
                    budget.worked(u64::from(this.references))?;
                }
            }
            Kernel::BuildSmall => {
                for root in 0..small {
                    b.small_sizes[root] =
                        k::build_small::<A>(config, root, &b.small_roots, &b.small_references);
                    budget.advance(1);
                    budget.worked(small_work(config, b.small_roots[root].count))?;
                }
                budget.finish()?;
            }
            Kernel::MeasureMiddle => {
                for root in 0..middle {
                    b.middle_sizes[root] = k::measure_middle(root, &b.middle_roots, &b.small_sizes);
                }
            }
            Kernel::SubtreeSizes => k::subtree_sizes(
                &b.top_nodes[..top],
                if middle > 0 { &b.middle_sizes } else { &b.small_sizes },
                &mut b.top_sizes,
            ),
            Kernel::PreorderAddresses => {
                let (sizes, addresses) = (&b.top_sizes, &mut b.top_addresses);
                k::preorder_addresses(&b.top_nodes[..top], sizes, addresses, &mut b.counters);
            }
            Kernel::EmitMiddle => {
                for root in 0..middle {
                    let this = &b.middle_roots[root];
                    k::emit_middle(
                        root,
                        &b.middle_roots,
                        &b.middle_nodes,
                        &b.small_sizes,
                        &b.top_addresses,
                        &mut b.nodes,
                        &mut b.small_addresses[this.first_leaf as usize..][..this.leaves as usize],
                    );
                }
            }
            Kernel::EmitTop => {
                for node in 0..top {
                    if middle == 0
                        && let Some((small, address)) =
                            k::small_address(node, &b.top_nodes, &b.top_addresses)
                    {
                        b.small_addresses[small] = address;
                    }
                    if let Some((index, emitted)) =
                        k::emit_top(node, &b.top_nodes, &b.top_addresses)
                    {
                        b.nodes[index] = emitted;
                    }
                }
            }
            Kernel::EmitSmall => {
                for root in 0..small {
                    let this = b.small_roots[root];
                    let Extent { nodes, references } = b.small_addresses[root];
                    let size = b.small_sizes[root];
                    k::emit_small::<A>(
                        config,
                        root,
                        &b.small_roots,
                        &b.small_references,
                        &b.small_addresses,
                        &mut b.nodes[nodes as usize..][..size.nodes as usize],
                        &mut b.leaf_references[references as usize..][..size.references as usize],
                    );
                    budget.advance(1);
                    budget.worked(small_work(config, this.count))?;
                }
                budget.finish()?;
            }
        }
        Ok(())
    }

    fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), BuildError> {
        self.buffers.swap(a, b)
    }

    fn pending(&mut self, counter: Counter, _rounds: u32) -> Result<bool, BuildError> {
        Ok(self.buffers.counters[counter] > 0)
    }
}

/// The work of building the subtree of a small root, in references read and written: each of its
/// planes is compared with each of its references, on all levels. A leaf that is too large is
/// copied.
fn small_work(config: &BuildConfig, count: u32) -> u64 {
    if count > config.small_node_limit() { u64::from(count) } else { 2 * u64::from(count * count) }
}

impl<A: Arithmetic> Inspect<TreeBuilder> for ReferenceExecutor<'_, A> {
    fn live(&mut self, buffer: Buffer) -> Result<Vec<u8>, BuildError> {
        self.buffers.copy_live(buffer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two planes of each reference against every reference; what stays one leaf is copied, be it as large as it likes.
    #[test]
    fn the_work_of_small_roots() {
        let config = BuildConfig::default().with_stages(|stages| stages.small_node_limit = 64);
        for count in 0..=64u32 {
            let compared = (0..2 * count).map(|_| u64::from(count)).sum::<u64>();
            assert_eq!(small_work(&config, count), compared);
        }
        for count in [65, 1 << 16, 1 << 30] {
            assert_eq!(small_work(&config, count), u64::from(count));
        }
    }
}
