use super::range;
use crate::aabb::Aabb;
use crate::arithmetic::Arithmetic;
use crate::build::bins::BinAxis;
use crate::config::{BuildConfig, MAX_BINS};
use crate::layout::{Chunk, ChunkBins, Reference};

/// Counts in which bins of its node's tight bounds the references of a chunk start and end, on each
/// axis: see [`BinAxis::range`]. All counts are zero on an axis on which the bounds are flat.
pub fn bin_references<A: Arithmetic>(
    config: &BuildConfig,
    chunk: usize,
    chunks: &[Chunk],
    node_bounds: &[Aabb],
    references: &[Reference],
) -> ChunkBins {
    let chunk = &chunks[chunk];
    let tight = &node_bounds[chunk.node as usize];
    let mut words = [[0; MAX_BINS as usize]; 3];
    for axis in 0..3 {
        let Some(bins) = BinAxis::of::<A>(tight, axis, config.bins()) else { continue };
        for reference in &references[range(chunk.first, chunk.count)] {
            let [start, end] = bins.range::<A>(reference.lo[axis], reference.hi[axis]);
            words[axis][start as usize] += 1;
            words[axis][end as usize] += 1 << 16;
        }
    }
    ChunkBins { words }
}
