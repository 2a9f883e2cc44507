//! The typed arena that kernels work on, kept between builds.

use std::collections::TryReserveError;

use splitplane_core::aabb::Aabb;
use splitplane_core::backend::BuildError;
use splitplane_core::config::BuildConfig;
use splitplane_core::layout::{
    Chunk, ChunkBins, ChunkBounds, ChunkSides, Counters, Decision, Extent, LargeNode, Reference,
    Sides, SmallRoot, TopNode,
};
use splitplane_core::node::KdNode;
use splitplane_core::triangle::Triangle;

use crate::best::Scratch;
use crate::cached::build_cached::{Totals, Workers};
use crate::cached::small_root::Subtrees;
use crate::lookout::{Lookout, UNWATCHED, resize};

/// One vector for each of [`splitplane_core::kernel::Buffer`]. Vectors only grow; the live length is
/// in the counters.
#[derive(Debug, Default)]
pub struct Buffers {
    pub(crate) triangles: Vec<Triangle>,
    pub(crate) references: Vec<Reference>,
    pub(crate) next_references: Vec<Reference>,
    pub(crate) small_references: Vec<Reference>,
    pub(crate) active_nodes: Vec<LargeNode>,
    pub(crate) next_nodes: Vec<LargeNode>,
    pub(crate) node_bounds: Vec<Aabb>,
    pub(crate) chunks: Vec<Chunk>,
    pub(crate) chunk_counts: Vec<Sides>,
    pub(crate) chunk_bounds: Vec<ChunkBounds>,
    pub(crate) reference_sides: Vec<ChunkSides>,
    pub(crate) chunk_bins: Vec<ChunkBins>,
    pub(crate) decisions: Vec<Decision>,
    pub(crate) top_nodes: Vec<TopNode>,
    pub(crate) level_starts: Vec<u32>,
    pub(crate) small_roots: Vec<SmallRoot>,
    pub(crate) small_sizes: Vec<Extent>,
    pub(crate) top_sizes: Vec<Extent>,
    pub(crate) top_addresses: Vec<Extent>,
    pub(crate) nodes: Vec<KdNode>,
    pub(crate) leaf_references: Vec<u32>,
    pub(crate) counters: Counters,
    pub(crate) root_bounds: Aabb,
    /// Not part of the schedule: the subtrees that `build_small` measured, kept for `emit_small`.
    pub(crate) subtrees: Vec<Subtrees>,
    /// Not part of the schedule: how many references splits have added.
    pub(crate) growth: u64,
    /// Not part of the schedule: what each task of the cached stage counted, and their scratch.
    pub(crate) totals: Vec<Totals>,
    pub(crate) workers: Workers,
    /// The last mesh's length and configuration for which the cached stage was void: the next build of the
    /// kind does not try it again.
    pub(crate) voided: Option<(u32, BuildConfig)>,
    /// Scratch of preset `best`, which the schedule does not build.
    pub(crate) best: Scratch,
}

/// Counts bytes against a limit.
#[derive(Clone, Copy, Debug, Default)]
pub struct Memory {
    /// Bytes held now.
    pub held: u64,
    /// Most bytes held so far.
    pub peak: u64,
    /// The limit, if any.
    pub limit: Option<u64>,
}

impl Memory {
    /// Accounts for `bytes` more.
    ///
    /// # Errors
    /// More than the limit.
    pub fn take(&mut self, bytes: u64) -> Result<(), BuildError> {
        let needed = self.held + bytes;
        if let Some(limit) = self.limit
            && needed > limit
        {
            return Err(BuildError::OutOfMemory { needed, limit });
        }
        self.held = needed;
        self.peak = self.peak.max(needed);
        Ok(())
    }

    /// Makes a vector at least `length` long. What it held may be lost: callers write all they read.
    ///
    /// # Errors
    /// More memory than the limit allows, or than there is.
    pub fn grow<T: bytemuck::Zeroable + Clone + Send + Sync>(
        &mut self,
        vector: &mut Vec<T>,
        length: usize,
    ) -> Result<(), BuildError> {
        self.grow_watched(vector, length, &UNWATCHED)
    }

    /// As [`Memory::grow`]; new memory takes time to clear, and the lookout may end it.
    pub(crate) fn grow_watched<T: bytemuck::Zeroable + Clone + Send + Sync>(
        &mut self,
        vector: &mut Vec<T>,
        length: usize,
        lookout: &Lookout<'_>,
    ) -> Result<(), BuildError> {
        if vector.len() >= length {
            return Ok(());
        }
        self.make_room(vector, length)?;
        resize(lookout, vector, length, &T::zeroed());
        lookout.check()
    }

    /// Accounts for room for `length` elements in all, and makes it.
    ///
    /// # Errors
    /// More memory than the limit allows, or than there is; the vector is then what it was.
    pub(crate) fn make_room<T>(
        &mut self,
        vector: &mut Vec<T>,
        length: usize,
    ) -> Result<(), BuildError> {
        let more = length.saturating_sub(vector.capacity());
        self.take((more * size_of::<T>()) as u64)?;
        self.reserve(vector, length)
    }

    /// As [`Memory::make_room`], for lists that become longer from step to step: where there is not enough
    /// room, at least twice what there was.
    ///
    /// # Errors
    /// As for [`Memory::make_room`].
    pub(crate) fn double_room<T>(
        &mut self,
        vector: &mut Vec<T>,
        length: usize,
    ) -> Result<(), BuildError> {
        if length <= vector.capacity() {
            return Ok(());
        }
        self.make_room(vector, length.max(2 * vector.capacity()))
    }

    /// Makes room for `length` elements in all, and no more where it is made, which has been accounted for.
    ///
    /// # Errors
    /// More memory than there is; the vector is then what it was.
    pub(crate) fn reserve<T>(&self, vector: &mut Vec<T>, length: usize) -> Result<(), BuildError> {
        let more = length.saturating_sub(vector.len());
        vector.try_reserve_exact(more).map_err(|_| self.lacking())
    }

    /// The error where there is less memory than what is held and is to be.
    pub(crate) fn lacking(&self) -> BuildError {
        BuildError::OutOfMemory { needed: self.held, limit: self.held }
    }
}

/// As [`Box::new`], of what is not made where there is no memory for it.
///
/// # Errors
/// Less memory than that.
pub(crate) fn boxed<T>(make: impl FnOnce() -> T) -> Result<Box<T>, TryReserveError> {
    let mut one = Vec::new();
    one.try_reserve_exact(1)?;
    one.push(make());
    let one = Box::into_raw(one.into_boxed_slice());
    // SAFETY: a slice of one element has the layout of the element.
    Ok(unsafe { Box::from_raw(one.cast::<T>()) })
}

/// Bytes that a vector has room for.
pub(crate) fn bytes_of<T>(vector: &Vec<T>) -> u64 {
    (vector.capacity() * size_of::<T>()) as u64
}

impl Buffers {
    /// Bytes of all vectors.
    pub fn bytes(&self) -> u64 {
        use bytes_of as of;
        of(&self.triangles)
            + of(&self.references)
            + of(&self.next_references)
            + of(&self.small_references)
            + of(&self.active_nodes)
            + of(&self.next_nodes)
            + of(&self.node_bounds)
            + of(&self.chunks)
            + of(&self.chunk_counts)
            + of(&self.chunk_bounds)
            + of(&self.reference_sides)
            + of(&self.chunk_bins)
            + of(&self.decisions)
            + of(&self.top_nodes)
            + of(&self.level_starts)
            + of(&self.small_roots)
            + of(&self.small_sizes)
            + of(&self.top_sizes)
            + of(&self.top_addresses)
            + of(&self.nodes)
            + of(&self.leaf_references)
            + self.subtrees.iter().map(Subtrees::bytes).sum::<u64>()
            + of(&self.totals)
            + self.workers.bytes()
            + self.best.bytes()
    }
}
