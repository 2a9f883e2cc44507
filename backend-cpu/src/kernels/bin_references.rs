//! `bin_references`: one workgroup a chunk, one invocation a reference.
//!
//! Reads: tight bounds of the chunk's node, references. Writes: how many of the chunk's references
//! start and end in each bin of each axis.

use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::bins::BinAxis;
use splitplane_core::config::MAX_BINS;
use splitplane_core::layout::{Chunk, ChunkBins, Reference};

use super::GRAIN;
use crate::lookout::Lookout;

/// Runs the kernel.
pub fn run<A: Arithmetic>(
    look: &Lookout<'_>,
    bins: u32,
    chunks: &[Chunk],
    node_bounds: &[Aabb],
    references: &[Reference],
    chunk_bins: &mut [ChunkBins],
) {
    chunks.par_iter().zip(chunk_bins).with_min_len(GRAIN).for_each(|(chunk, out)| {
        if look.worked(u64::from(chunk.count)) {
            return;
        }
        let tight = &node_bounds[chunk.node as usize];
        let (first, count) = (chunk.first as usize, chunk.count as usize);
        let references = &references[first..first + count];
        for axis in 0..3 {
            out.words[axis] = [0; MAX_BINS as usize];
            // A flat axis has no borders: its bins stay empty.
            if let Some(bins) = BinAxis::of::<A>(tight, axis, bins) {
                count_axis::<A>(&bins, axis, references, &mut out.words[axis]);
            }
        }
    });
}

#[inline]
fn count_axis<A: Arithmetic>(
    bins: &BinAxis,
    axis: usize,
    references: &[Reference],
    words: &mut [u32; MAX_BINS as usize],
) {
    for reference in references {
        let [start, end] = bins.range::<A>(reference.lo[axis], reference.hi[axis]);
        words[start as usize & 63] += 1;
        words[end as usize & 63] += 1 << 16;
    }
}
