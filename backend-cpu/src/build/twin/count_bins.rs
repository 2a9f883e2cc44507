//! Where references start and end by bins: what `bin_references` does for chunks and
//! [`build::depth_first`](crate::build::depth_first) for nodes.

use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::build::bins::BinAxis;
use splitplane_core::config::MAX_BINS;

use crate::simd::WIDTH;

const BINS: usize = MAX_BINS as usize;
/// Neighbours fall in the same bin more often than not, and a count must not wait for the one before.
const TABLES: usize = 4;

/// How many references start in each bin of one axis, and how many end there.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn count_axis<A: Arithmetic>(
    bins: &BinAxis,
    lo: &[f32],
    hi: &[f32],
) -> [[u32; BINS]; 2] {
    let mut tables = [[[0u32; BINS]; 2]; TABLES];
    let (mut lows, mut highs) = (lo.chunks_exact(WIDTH), hi.chunks_exact(WIDTH));
    for (lo, hi) in (&mut lows).zip(&mut highs) {
        let (mut starts, mut ends) = ([0u32; WIDTH], [0u32; WIDTH]);
        for lane in 0..WIDTH {
            [starts[lane], ends[lane]] = bins.range::<A>(lo[lane], hi[lane]);
        }
        for lane in 0..WIDTH {
            let table = &mut tables[lane % TABLES];
            table[0][starts[lane] as usize % BINS] += 1;
            table[1][ends[lane] as usize % BINS] += 1;
        }
    }
    for (&lo, &hi) in lows.remainder().iter().zip(highs.remainder()) {
        let [start, end] = bins.range::<A>(lo, hi);
        tables[0][0][start as usize % BINS] += 1;
        tables[1][1][end as usize % BINS] += 1;
    }
    let mut sum = [[0u32; BINS]; 2];
    for table in &tables {
        for end in 0..2 {
            for bin in 0..BINS {
                sum[end][bin] += table[end][bin];
            }
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane_core::aabb::Aabb;
    use splitplane_core::arithmetic::Strict;
    use splitplane_test_support::random::Random;

    /// The same counts as one by one, for lists that fill no block and lists that fill several.
    #[test]
    fn the_same_as_one_by_one() {
        let mut random = Random::new(7);
        let mut next = move || random.below(1 << 12) as f32 / 512.0;
        for count in (0..70).chain([255, 256, 1000]) {
            let lo: Vec<f32> = (0..count).map(|_| next()).collect();
            let hi: Vec<f32> = lo.iter().map(|lo| lo + next() / 8.0).collect();
            let tight = Aabb { lo: [0.0; 3], hi: [9.0; 3] };
            let bins = BinAxis::of::<Strict>(&tight, 0, 32).unwrap();
            let mut expected = [[0u32; BINS]; 2];
            for (&lo, &hi) in lo.iter().zip(&hi) {
                let [start, end] = bins.range::<Strict>(lo, hi);
                expected[0][start as usize] += 1;
                expected[1][end as usize] += 1;
            }
            assert_eq!(count_axis::<Strict>(&bins, &lo, &hi), expected);
        }
    }
}
