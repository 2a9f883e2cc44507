//! The buffers that kernels exchange, in host memory.

use alloc::format;
use alloc::vec::Vec;

use bytemuck::Pod;

use super::Budget;
use super::kernels::allocate_children_most;
use crate::aabb::Aabb;
use crate::build::middle::Region;
use crate::config::BuildConfig;
use crate::error::{BuildError, DeviceError};
use crate::kernel::{Buffer, Counter, Kernel, KernelSet, TreeBuilder};
use crate::layout::{
    Chunk, ChunkBins, ChunkBounds, ChunkSides, Counters, Decision, Extent, LargeNode, MiddleRoot,
    Reference, Sides, SmallRoot, TopNode,
};
use crate::tree::KdTree;
use crate::tree::node::KdNode;
use crate::triangle::Triangle;

/// A vector for each [`Buffer`] that has elements of its own. Vectors only grow: the counters say
/// how much of one is live, see [`Buffer::live`].
#[derive(Clone, Debug, Default)]
pub struct Buffers {
    /// [`Buffer::Triangles`].
    pub triangles: Vec<Triangle>,
    /// [`Buffer::References`].
    pub references: Vec<Reference>,
    /// [`Buffer::NextReferences`].
    pub next_references: Vec<Reference>,
    /// [`Buffer::SmallReferences`].
    pub small_references: Vec<Reference>,
    /// [`Buffer::ActiveNodes`].
    pub active_nodes: Vec<LargeNode>,
    /// [`Buffer::NextNodes`].
    pub next_nodes: Vec<LargeNode>,
    /// [`Buffer::NodeBounds`].
    pub node_bounds: Vec<Aabb>,
    /// [`Buffer::Chunks`].
    pub chunks: Vec<Chunk>,
    /// [`Buffer::ChunkCounts`].
    pub chunk_counts: Vec<Sides>,
    /// [`Buffer::ChunkBounds`].
    pub chunk_bounds: Vec<ChunkBounds>,
    /// [`Buffer::ReferenceSides`].
    pub reference_sides: Vec<ChunkSides>,
    /// [`Buffer::ChunkBins`].
    pub chunk_bins: Vec<ChunkBins>,
    /// [`Buffer::Decisions`].
    pub decisions: Vec<Decision>,
    /// [`Buffer::TopNodes`].
    pub top_nodes: Vec<TopNode>,
    /// [`Buffer::LevelStarts`].
    pub level_starts: Vec<u32>,
    /// [`Buffer::SmallRoots`].
    pub small_roots: Vec<SmallRoot>,
    /// [`Buffer::SmallSizes`].
    pub small_sizes: Vec<Extent>,
    /// [`Buffer::MiddleRoots`].
    pub middle_roots: Vec<MiddleRoot>,
    /// [`Buffer::MiddleReferences`].
    pub middle_references: Vec<Reference>,
    /// [`Buffer::MiddleNodes`].
    pub middle_nodes: Vec<TopNode>,
    /// [`Buffer::MiddleLeaves`].
    pub middle_leaves: Vec<SmallRoot>,
    /// [`Buffer::MiddleSizes`].
    pub middle_sizes: Vec<Extent>,
    /// [`Buffer::TopSizes`].
    pub top_sizes: Vec<Extent>,
    /// [`Buffer::TopAddresses`].
    pub top_addresses: Vec<Extent>,
    /// [`Buffer::SmallAddresses`].
    pub small_addresses: Vec<Extent>,
    /// [`Buffer::Nodes`].
    pub nodes: Vec<KdNode>,
    /// [`Buffer::LeafReferences`].
    pub leaf_references: Vec<u32>,
    /// [`Buffer::Counters`].
    pub counters: Counters,
}

impl Buffers {
    /// Only the counters that [`build::schedule::build`](crate::build::schedule::build) asks for, for a mesh of this many
    /// triangles.
    pub fn new(triangles: u32) -> Buffers {
        Buffers { counters: Counters::at_start(triangles), ..Buffers::default() }
    }

    /// A counter.
    pub fn count(&self, counter: Counter) -> usize {
        self.counters[counter] as usize
    }

    /// Makes space for everything that a kernel may write. Must be called just before the kernel,
    /// since the lengths follow from the counters.
    ///
    /// # Errors
    /// As for [`Budget::grow`]; and [`BuildError::TooLarge`] before [`Kernel::SubtreeSizes`], for a tree that
    /// the format of its nodes cannot address.
    pub fn make_room(&mut self, kernel: Kernel, budget: &mut Budget<'_>) -> Result<(), BuildError> {
        if kernel == Kernel::SubtreeSizes {
            self.check_size()?;
        }
        let mut result = Ok(());
        TreeBuilder::written(kernel, &mut |buffer| {
            if result.is_ok() {
                let length = self.length_after(kernel, buffer);
                result = self.list(buffer).map_or(Ok(()), |list| list.grow(length, budget));
            }
        });
        result
    }

    /// Sums sizes in 64 bits, before a kernel sums them in 32.
    fn check_size(&self) -> Result<(), BuildError> {
        let (mut nodes, mut references) = (self.count(Counter::TopNodes) as u64, 0);
        for root in &self.middle_roots[..self.count(Counter::MiddleRoots)] {
            nodes += u64::from(root.nodes);
        }
        for size in &self.small_sizes[..self.count(Counter::SmallRoots)] {
            nodes += u64::from(size.nodes);
            references += u64::from(size.references);
        }
        if nodes > u64::from(KdNode::MAX_INDEX) || references > u64::from(u32::MAX) {
            return Err(BuildError::TooLarge { nodes, references });
        }
        Ok(())
    }

    /// How long a buffer is after a kernel that writes it, at most.
    fn length_after(&self, kernel: Kernel, buffer: Buffer) -> usize {
        let live = buffer.live().map_or(0, |counter| self.count(counter));
        let handed = |counter| self.counters[counter];
        let regions =
            || Region::start(handed(Counter::SmallReferences), handed(Counter::SmallRoots));
        match (kernel, buffer) {
            // The regions of all that was handed over.
            (Kernel::BuildMiddle, Buffer::MiddleReferences) => regions().references as usize,
            (Kernel::BuildMiddle, Buffer::MiddleNodes) => regions().nodes as usize,
            (Kernel::BuildMiddle, Buffer::MiddleLeaves) => regions().leaves as usize,
            // The root, which it counts itself.
            (Kernel::ScanTriangles, Buffer::ActiveNodes | Buffer::TopNodes) => 1,
            (Kernel::AllocateChildren, _) => {
                let decisions = &self.decisions[..self.count(Counter::ActiveNodes)];
                let most = allocate_children_most(decisions);
                match buffer {
                    Buffer::NextNodes => most.children,
                    Buffer::SmallRoots => live + most.children,
                    Buffer::TopNodes => live + most.top_nodes,
                    Buffer::LevelStarts => live + 1,
                    _ => live,
                }
            }
            _ => live,
        }
    }

    /// The live bytes of a buffer; `None` for the input, and for buffers that stand for several.
    fn live(&mut self, buffer: Buffer) -> Option<&[u8]> {
        if buffer == Buffer::Counters {
            return Some(bytemuck::bytes_of(&self.counters));
        }
        let length = self.count(buffer.live()?);
        self.list(buffer)?.bytes(length)
    }

    /// A copy of the live bytes of a buffer, as [`build::lockstep::Inspect`](crate::build::lockstep::Inspect) asks for it. Empty for the
    /// input, and for buffers that stand for several.
    ///
    /// # Errors
    /// [`BuildError::OutOfMemory`] where the system has no memory for the copy.
    pub fn copy_live(&mut self, buffer: Buffer) -> Result<Vec<u8>, BuildError> {
        let bytes = self.live(buffer).unwrap_or_default();
        let (mut copy, needed) = (Vec::new(), bytes.len() as u64);
        let refused = |_| BuildError::OutOfMemory { needed, limit: needed };
        copy.try_reserve_exact(bytes.len()).map_err(refused)?;
        copy.extend_from_slice(bytes);
        Ok(copy)
    }

    /// As [`build::schedule::Executor::swap`](crate::build::schedule::Executor::swap).
    ///
    /// # Errors
    /// Buffers that the schedule does not exchange.
    pub fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), BuildError> {
        let counters = match (a, b) {
            (Buffer::ActiveNodes, Buffer::NextNodes) => {
                core::mem::swap(&mut self.active_nodes, &mut self.next_nodes);
                self.counters.words.swap(Counter::Chunks as usize, Counter::NextChunks as usize);
                [Counter::ActiveNodes, Counter::NextNodes]
            }
            (Buffer::References, Buffer::NextReferences) => {
                core::mem::swap(&mut self.references, &mut self.next_references);
                [Counter::ActiveReferences, Counter::NextReferences]
            }
            _ => {
                return Err(BuildError::Device(DeviceError::Failed(format!(
                    "{a:?} and {b:?} cannot be exchanged"
                ))));
            }
        };
        let [a, b] = counters.map(|counter| counter as usize);
        self.counters.words.swap(a, b);
        Ok(())
    }

    /// The tree that [`build::schedule::build`](crate::build::schedule::build) has left here. `bounds` are those of all triangles kept: the
    /// cell of the root that [`Kernel::ScanTriangles`] makes.
    pub fn into_tree(self, bounds: Aabb, config: BuildConfig) -> KdTree {
        let Buffers { mut nodes, leaf_references: mut references, counters, .. } = self;
        nodes.truncate(counters[Counter::Nodes] as usize);
        references.truncate(counters[Counter::LeafReferences] as usize);
        KdTree { nodes, references, bounds, triangles: counters[Counter::Triangles], config }
    }

    fn list(&mut self, buffer: Buffer) -> Option<&mut dyn List> {
        Some(match buffer {
            Buffer::Input
            | Buffer::Subtrees
            | Buffer::TopParents
            | Buffer::ChunkState
            | Buffer::Counters => return None,
            Buffer::Triangles => &mut self.triangles,
            Buffer::References => &mut self.references,
            Buffer::NextReferences => &mut self.next_references,
            Buffer::SmallReferences => &mut self.small_references,
            Buffer::ActiveNodes => &mut self.active_nodes,
            Buffer::NextNodes => &mut self.next_nodes,
            Buffer::NodeBounds => &mut self.node_bounds,
            Buffer::Chunks => &mut self.chunks,
            Buffer::ChunkCounts => &mut self.chunk_counts,
            Buffer::ChunkBounds => &mut self.chunk_bounds,
            Buffer::ReferenceSides => &mut self.reference_sides,
            Buffer::ChunkBins => &mut self.chunk_bins,
            Buffer::Decisions => &mut self.decisions,
            Buffer::TopNodes => &mut self.top_nodes,
            Buffer::LevelStarts => &mut self.level_starts,
            Buffer::SmallRoots => &mut self.small_roots,
            Buffer::SmallSizes => &mut self.small_sizes,
            Buffer::MiddleRoots => &mut self.middle_roots,
            Buffer::MiddleReferences => &mut self.middle_references,
            Buffer::MiddleNodes => &mut self.middle_nodes,
            Buffer::MiddleLeaves => &mut self.middle_leaves,
            Buffer::MiddleSizes => &mut self.middle_sizes,
            Buffer::TopSizes => &mut self.top_sizes,
            Buffer::TopAddresses => &mut self.top_addresses,
            Buffer::SmallAddresses => &mut self.small_addresses,
            Buffer::Nodes => &mut self.nodes,
            Buffer::LeafReferences => &mut self.leaf_references,
        })
    }
}

/// A vector of any records.
trait List {
    fn bytes(&self, length: usize) -> Option<&[u8]>;
    fn grow(&mut self, length: usize, budget: &mut Budget<'_>) -> Result<(), BuildError>;
}

impl<T: Pod> List for Vec<T> {
    fn bytes(&self, length: usize) -> Option<&[u8]> {
        self.get(..length).map(bytemuck::cast_slice)
    }

    fn grow(&mut self, length: usize, budget: &mut Budget<'_>) -> Result<(), BuildError> {
        budget.grow(self, length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trees_that_their_format_cannot_address_are_refused() {
        let mut buffers = Buffers::new(0);
        let mut room_for = |nodes: [u32; 2], references: [u32; 2]| {
            let size = |i: usize| Extent { nodes: nodes[i], references: references[i] };
            buffers.small_sizes = [size(0), size(1), size(0)].to_vec();
            // The third is not live.
            buffers.counters[Counter::SmallRoots] = 2;
            buffers.counters[Counter::TopNodes] = 3;
            buffers.make_room(Kernel::SubtreeSizes, &mut Budget::default())
        };
        let half = 1 << 29;
        assert_eq!(room_for([half, half - 4], [1 << 31, (1 << 31) - 1]), Ok(()));
        let too_large = |nodes, references| Err(BuildError::TooLarge { nodes, references });
        assert_eq!(room_for([half, half - 3], [1, 2]), too_large(1 << 30, 3));
        assert_eq!(room_for([1, 1], [1 << 31, 1 << 31]), too_large(5, 1 << 32));
    }
}
