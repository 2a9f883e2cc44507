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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::Strict;
    use crate::config::Preset;
    use crate::random;

    /// Every reference starts once and ends once on every axis with an extent: bins of half a unit from 0 to 8, ends in
    /// quarters. What lies in a border goes to the left of it.
    #[test]
    fn references_start_and_end_once() {
        let config = Preset::Balanced.config().with_bins(16);
        let draw = |i: u64, what: u64| random::hash(i, &[what]) % 33;
        let references: [Reference; 50] = core::array::from_fn(|i| {
            let ends = [0, 1].map(|end| [0, 1, 2].map(|axis| draw(i as u64, 3 * end + axis)));
            let end = |pick: fn(u64, u64) -> u64| {
                [0, 1, 2]
                    .map(|k| if k == 2 { 1.0 } else { pick(ends[0][k], ends[1][k]) as f32 / 4.0 })
            };
            let mut reference = <Reference as bytemuck::Zeroable>::zeroed();
            (reference.lo, reference.hi) = (end(u64::min), end(u64::max));
            reference
        });
        let mut chunk = <Chunk as bytemuck::Zeroable>::zeroed();
        (chunk.first, chunk.count, chunk.node) = (3, 40, 1);
        // Flat on the last axis.
        let bounds = [Aabb::EMPTY, Aabb { lo: [0.0, 0.0, 1.0], hi: [8.0, 8.0, 1.0] }];
        let ChunkBins { words } =
            bin_references::<Strict>(&config, 0, &[chunk], &bounds, &references);
        let mut expected = [[0; MAX_BINS as usize]; 3];
        for reference in &references[3..43] {
            for axis in 0..2 {
                let (lo, hi) = (4.0 * reference.lo[axis], 4.0 * reference.hi[axis]);
                let last = (hi as usize).div_ceil(2).saturating_sub(1);
                let first = (lo as usize / 2).min(last);
                expected[axis][first] += 1;
                expected[axis][last] += 1 << 16;
            }
        }
        assert_eq!(words, expected);
    }
}
