//! Which faces lie in a range of bins, eight references at a time.

use super::grid::FaceBins;
use crate::simd::Simd;

/// References that are processed together.
pub(super) const AT_ONCE: usize = 8;

/// A range of bins for each word of a reference.
#[derive(Clone, Debug)]
pub(super) struct Ranges {
    /// First bins, for eight references.
    first: [u8; 64],
    /// Last bins less first ones.
    span: [u8; 64],
    /// A bit for each word that has a range.
    there: u64,
}

impl Ranges {
    /// From the first and last bin of each axis that has a range; for lower and upper faces.
    pub(super) fn new(axes: [Option<[u8; 2]>; 3]) -> Ranges {
        let mut ranges = Ranges { first: [0; 64], span: [0; 64], there: 0 };
        for bit in 0..64 {
            if let Some(Some([first, last])) = axes.get(bit % 4) {
                (ranges.first[bit], ranges.span[bit]) = (*first, last - first);
                ranges.there |= 1 << bit;
            }
        }
        ranges
    }

    /// Calls `found` with every word that is in its range: its reference's number and its own.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn search<S: Simd>(&self, places: &[FaceBins], mut found: impl FnMut(usize, usize)) {
        for (block, chunk) in places.chunks(AT_ONCE).enumerate() {
            let mut bits = match chunk.first_chunk() {
                Some(chunk) => self.of::<S>(chunk),
                None => {
                    let mut whole = [[0; 8]; AT_ONCE];
                    whole[..chunk.len()].copy_from_slice(chunk);
                    self.of::<S>(&whole) & ((1 << (8 * chunk.len())) - 1)
                }
            };
            while bits != 0 {
                let bit = bits.trailing_zeros() as usize;
                bits &= bits - 1;
                found(block * AT_ONCE + bit / 8, bit % 8);
            }
        }
    }

    /// The words of eight references that are in their ranges, a bit each.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn of<S: Simd>(&self, places: &[FaceBins; AT_ONCE]) -> u64 {
        // SAFETY: code that is compiled for a set runs where the processor has it.
        unsafe { S::bytes_in_ranges(places, &self.first, &self.span, self.there) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::InstructionSet;
    use crate::simd::every_set::for_every_set;
    use splitplane_test_support::random::Random;

    for_every_set! {
        fn searched<S>(ranges: &Ranges, places: &[FaceBins]) -> Vec<(usize, usize)> {
            let mut found = Vec::new();
            ranges.search::<S>(places, |i, word| found.push((i, word)));
            found
        }
    }

    #[test]
    fn every_set_finds_what_is_in_range() {
        let mut random = Random::new(5);
        for round in 0..200 {
            let places: Vec<FaceBins> = (0..random.below(40))
                .map(|_| [0; 8].map(|_: u8| random.below(256) as u8))
                .collect();
            let axes = [0, 1, 2].map(|axis| {
                let (one, other) = (random.below(256) as u8, random.below(256) as u8);
                (round >> axis & 1 == 0).then_some([one.min(other), one.max(other)])
            });
            let mut expected = Vec::new();
            for (i, place) in places.iter().enumerate() {
                for word in [0, 1, 2, 4, 5, 6] {
                    if axes[word % 4]
                        .is_some_and(|[first, last]| first <= place[word] && place[word] <= last)
                    {
                        expected.push((i, word));
                    }
                }
            }
            for set in InstructionSet::available() {
                assert_eq!(searched(set, &Ranges::new(axes), &places), expected);
            }
        }
    }
}
