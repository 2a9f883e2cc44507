//! `bin_references`: one workgroup a chunk, one invocation a reference.
//!
//! Reads: tight bounds of the chunk's node, references. Writes: how many of the chunk's references
//! start and end in each bin of each axis.

use core::marker::PhantomData;

use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::build::bins::BinAxis;
use splitplane_core::config::{CHUNK, MAX_BINS};
use splitplane_core::layout::{Chunk, ChunkBins, Reference};

use super::GRAIN;
use crate::build::twin::count_bins::count_axis;
use crate::cancel::ProgressMeter;
use crate::parallel::{Parallel, ParallelSlice};
use crate::simd::{Compiled, InstructionSet, Simd};
use crate::span;

/// Runs the kernel.
pub(crate) fn run<A: Arithmetic>(
    meter: &ProgressMeter<'_>,
    set: InstructionSet,
    bins: u32,
    chunks: &[Chunk],
    node_bounds: &[Aabb],
    references: &[Reference],
    chunk_bins: &mut [ChunkBins],
) {
    let _loop = span::pieces_of(GRAIN);
    chunks.par_iter().zip(chunk_bins).with_min_len(GRAIN).for_each(|(chunk, out)| {
        let _piece = span::piece();
        if meter.record_work(u64::from(chunk.count)) {
            return;
        }
        let tight = &node_bounds[chunk.node as usize];
        let (first, count) = (chunk.first as usize, chunk.count as usize);
        let references = &references[first..first + count];
        let chunk = OneChunk::<A> { bins, tight, references, out, arithmetic: PhantomData };
        // SAFETY: the executor holds only sets that the processor has.
        unsafe { set.run(chunk) };
    });
}

/// The bins of one chunk.
struct OneChunk<'a, A> {
    bins: u32,
    tight: &'a Aabb,
    references: &'a [Reference],
    out: &'a mut ChunkBins,
    arithmetic: PhantomData<A>,
}

impl<A: Arithmetic> Compiled for OneChunk<'_, A> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        one_chunk::<A>(self.bins, self.tight, self.references, self.out);
    }
}

#[cfg_attr(not(unoptimised), inline(always))]
fn one_chunk<A: Arithmetic>(
    bins: u32,
    tight: &Aabb,
    references: &[Reference],
    out: &mut ChunkBins,
) {
    const ROOM: usize = CHUNK as usize;
    let count = references.len().min(ROOM);
    let (mut lo, mut hi) = ([[0.0; ROOM]; 3], [[0.0; ROOM]; 3]);
    for (i, reference) in references[..count].iter().enumerate() {
        for axis in 0..3 {
            lo[axis][i] = reference.lo[axis];
            hi[axis][i] = reference.hi[axis];
        }
    }
    for axis in 0..3 {
        out.words[axis] = [0; MAX_BINS as usize];
        // A flat axis has no borders: its bins stay empty.
        if let Some(bins) = BinAxis::of::<A>(tight, axis, bins) {
            let [starts, ends] = count_axis::<A>(&bins, &lo[axis][..count], &hi[axis][..count]);
            for (bin, word) in out.words[axis].iter_mut().enumerate() {
                *word = starts[bin] | ends[bin] << 16;
            }
        }
    }
}
