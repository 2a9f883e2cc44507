//! The number of a rank in a column, without branches that depend on its numbers.
//!
//! Sixteen numbers (256 of long columns) bracket the one that is looked for. One pass counts the numbers below the bracket and
//! gathers those in it, and they are the next column, until there are so few that each is compared with each. Where a bracket says too little, as
//! among equal numbers, it is a single number of the column. A sample decides how much work that is, never the result.

use crate::simd::{Compiled, Simd};

/// So few numbers are compared with each other.
const FEW: usize = 32;
/// Numbers of a sample.
const SAMPLE: usize = 16;
/// A rank is looked for so many places from its own in the sample's order: one and a half deviations, each half the root of the size.
const REACH: usize = 3;
/// Columns from this length on have a sample of [`LARGE_SAMPLE`] first.
const LONG: usize = 4096;
const LARGE_SAMPLE: usize = 256;
/// Two and a half deviations.
const LARGE_REACH: usize = 20;
/// Passes over a column before what is left is selected from otherwise, in a time that is bounded.
const MOST_PASSES: usize = 60;

/// Where a sample is taken, in parts of 2^32 of the column: neither in order nor at equal steps, since points often are.
const PLACES: [u32; SAMPLE] = [
    0x0851_2f31,
    0x9a3c_77d5,
    0x51e8_03ab,
    0xd27f_6e19,
    0x2bd4_9c47,
    0xb8f1_2d63,
    0x6d0b_58f7,
    0xf0a6_c18d,
    0x1943_e6bf,
    0xa96e_3b05,
    0x43c7_8d91,
    0xe35a_f42f,
    0x3a18_6ac3,
    0xc709_91eb,
    0x7c85_b457,
    0x8e2d_d079,
];

/// The number that has a rank in a column, and how many are below it. The column has `count` numbers, a multiple of sixteen of which none is
/// subnormal, -0 or no number; `spare` has room for as many and is overwritten.
///
/// # Safety
/// The processor must have the set, and both memories so many numbers; the rank must be less.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn select<S: Simd>(
    column: *const f32,
    count: usize,
    rank: usize,
    spare: *mut f32,
) -> (f32, usize) {
    let mut first = None;
    if count >= LONG {
        let mut sample = [0.0; LARGE_SAMPLE];
        let mut state = count as u32;
        for number in &mut sample {
            // A linear congruential sequence.
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            let place = ((u64::from(state) * count as u64) >> 32) as usize;
            // SAFETY: a place of the column.
            *number = unsafe { *column.add(place) };
        }
        // In 64 bits, since 32 are too few for the product where there are millions.
        let at = (rank as u64 * LARGE_SAMPLE as u64 / count as u64) as usize;
        // SAFETY: the caller's contract.
        let number = |rank| unsafe { S::call(OfSample { sample: &sample, rank }) };
        let lower = if at >= LARGE_REACH { number(at - LARGE_REACH) } else { f32::NEG_INFINITY };
        let upper =
            if at + LARGE_REACH < LARGE_SAMPLE { number(at + LARGE_REACH) } else { f32::INFINITY };
        first = Some([lower, upper]);
    }
    // SAFETY: the caller's contract.
    unsafe { narrow::<S>(column, count, rank, spare, first, MOST_PASSES) }
}

/// The number of a rank in a large sample.
struct OfSample<'a> {
    sample: &'a [f32; LARGE_SAMPLE],
    rank: usize,
}

impl Compiled for OfSample<'_> {
    type Output = f32;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> f32 {
        let mut spare = [0.0; LARGE_SAMPLE];
        let (sample, spare) = (self.sample.as_ptr(), spare.as_mut_ptr());
        // SAFETY: the caller's contract; both have as many numbers, and the rank is less.
        unsafe { narrow::<S>(sample, LARGE_SAMPLE, self.rank, spare, None, MOST_PASSES).0 }
    }
}

/// [`select`], with a first bracket if there is one, and by so many passes before what is left is selected from otherwise.
///
/// # Safety
/// As for [`select`].
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn narrow<S: Simd>(
    column: *const f32,
    count: usize,
    rank: usize,
    spare: *mut f32,
    mut first: Option<[f32; 2]>,
    most_passes: usize,
) -> (f32, usize) {
    // The list has the column's numbers from `lowest` to `highest`; `below` are less.
    let (mut list, mut length, mut below) = (column, count, 0);
    let (mut lowest, mut highest) = (f32::NEG_INFINITY, f32::INFINITY);
    let mut is_one = false;
    for _ in 0..most_passes {
        // SAFETY: the list is the column or in the spare memory, and not longer than either.
        unsafe {
            if length <= FEW {
                let (number, less) = of_few::<S>(list, length, rank - below);
                return (number, below + less);
            }
            let [lower, upper] = match first.take() {
                Some(bracket) => bracket,
                None => bracket::<S>(list, length, rank - below, is_one, [lowest, highest]),
            };
            let (less, within) = gather::<S>(list, length, [lower, upper], spare);
            let here = rank - below;
            if (less..less + within).contains(&here) {
                if lower == upper {
                    return (lower, below + less);
                }
                is_one = within > length / 4 * 3;
                (list, length, below) = (spare, within, below + less);
                (lowest, highest) = (lower, upper);
            } else {
                // The sample said something else. The list may be overwritten, so it is gathered anew.
                if here < less {
                    highest = lower.next_down();
                } else {
                    lowest = upper.next_up();
                }
                let (less, within) = gather::<S>(column, count, [lowest, highest], spare);
                is_one = within > length / 4 * 3;
                (list, length, below) = (spare, within, less);
            }
        }
    }
    // SAFETY: the spare memory has room for the list, which may be there already.
    let rest = unsafe {
        core::ptr::copy(list, spare, length);
        core::slice::from_raw_parts_mut(spare, length)
    };
    let (less, &mut number, _) = rest.select_nth_unstable_by(rank - below, f32::total_cmp);
    (number, below + less.iter().filter(|&&other| other < number).count())
}

/// How many numbers of a list are below a bracket, and how many in it: these are written to `to`, which may be the list.
///
/// # Safety
/// The processor must have the set. The list must be readable, and `to` writable, to whole vectors.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn gather<S: Simd>(
    list: *const f32,
    length: usize,
    [lower, upper]: [f32; 2],
    to: *mut f32,
) -> (usize, usize) {
    let (mut less, mut within) = (0, 0);
    // SAFETY: the caller's contract. No more is written than was read, and a vector is read before it is written.
    unsafe {
        let (low, high) = (S::splat(lower), S::splat(upper));
        let mut place = 0;
        while place < length {
            let numbers = S::load(list.add(place));
            let there = lanes(S::N.min(length - place));
            let not_less = S::bits(S::le(low, numbers));
            let inside = S::bits(S::le(numbers, high)) & not_less & there;
            S::compress(numbers, inside, to.add(within));
            less += (there & !not_less).count_ones() as usize;
            within += inside.count_ones() as usize;
            place += S::N;
        }
    }
    (less, within)
}

/// So many lanes.
#[cfg_attr(not(unoptimised), inline(always))]
fn lanes(count: usize) -> u32 {
    (1 << count) - 1
}

/// Numbers between which a rank is probably found, or one number of the list that is near.
///
/// # Safety
/// The processor must have the set, and the list so many numbers.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn bracket<S: Simd>(
    list: *const f32,
    length: usize,
    rank: usize,
    is_one: bool,
    [lowest, highest]: [f32; 2],
) -> [f32; 2] {
    let mut sample = [f32::INFINITY; FEW];
    for (number, part) in sample.iter_mut().zip(PLACES) {
        let place = (u64::from(part) * length as u64) >> 32;
        // SAFETY: a place of the list.
        *number = unsafe { *list.add(place as usize) };
    }
    let at = (rank as u64 * SAMPLE as u64 / length as u64) as usize;
    // SAFETY: the caller's contract.
    unsafe {
        let counts = counts::<S, SAMPLE>(&sample, SAMPLE);
        let number = |rank| of_rank::<S, SAMPLE>(&sample, &counts, SAMPLE, rank);
        if is_one {
            return [number(at); 2];
        }
        let lower = if at >= REACH { number(at - REACH) } else { lowest };
        let upper = if at + REACH < SAMPLE { number(at + REACH) } else { highest };
        [lower, upper]
    }
}

/// The number of a rank among few, and how many are below it.
///
/// # Safety
/// The processor must have the set, and the list so many numbers, which are more than the rank.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn of_few<S: Simd>(list: *const f32, length: usize, rank: usize) -> (f32, usize) {
    let mut row = [f32::INFINITY; FEW];
    // SAFETY: the caller's contract; the list has at most as many numbers as the row.
    unsafe {
        for place in 0..length.min(FEW) {
            row[place] = *list.add(place);
        }
        let number = if length <= SAMPLE {
            let counts = counts::<S, SAMPLE>(&row, length);
            of_rank::<S, SAMPLE>(&row, &counts, length, rank)
        } else {
            let counts = counts::<S, FEW>(&row, length);
            of_rank::<S, FEW>(&row, &counts, length, rank)
        };
        let mut not_less = 0;
        for place in (0..FEW).step_by(S::N) {
            let numbers = S::load(row.as_ptr().add(place));
            not_less += S::bits(S::le(S::splat(number), numbers)).count_ones();
        }
        (number, FEW - not_less as usize)
    }
}

/// Vectors of a row, at most.
const VECTORS: usize = FEW / 8;

/// Of each of the first `W` numbers of a row, how many of the first `length` are not less.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn counts<S: Simd, const W: usize>(row: &[f32; FEW], length: usize) -> [S::Floats; VECTORS] {
    // SAFETY: the caller's contract; `W` is at most the row's length.
    unsafe {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let mut counts = [zero; VECTORS];
        let mut own = counts;
        for vector in 0..W / S::N {
            own[vector] = S::load(row.as_ptr().add(vector * S::N));
        }
        for &number in &row[..length] {
            let number = S::splat(number);
            for vector in 0..W / S::N {
                let not_less = S::keep(S::le(own[vector], number), one);
                counts[vector] = S::add(counts[vector], not_less);
            }
        }
        counts
    }
}

/// The number of a rank among the first `length` of a row: the greatest one that no more than so many are less than.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn of_rank<S: Simd, const W: usize>(
    row: &[f32; FEW],
    counts: &[S::Floats; VECTORS],
    length: usize,
    rank: usize,
) -> f32 {
    // SAFETY: the caller's contract.
    unsafe {
        let nothing = S::splat(f32::NEG_INFINITY);
        let least = S::splat((length - rank) as f32);
        let mut greatest = nothing;
        for vector in 0..W / S::N {
            let own = S::load(row.as_ptr().add(vector * S::N));
            let counts = S::le(least, counts[vector]);
            greatest = S::max(greatest, S::select(counts, own, nothing));
        }
        S::highest(greatest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::InstructionSet;

    struct Selected<'a> {
        column: &'a [f32],
        rank: usize,
        passes: Option<usize>,
    }

    impl Compiled for Selected<'_> {
        type Output = (f32, usize);

        #[cfg_attr(not(unoptimised), inline(always))]
        unsafe fn run<S: Simd>(self) -> (f32, usize) {
            let (column, count) = (self.column.as_ptr(), self.column.len());
            let mut spare = vec![0.0; count];
            let spare = spare.as_mut_ptr();
            // SAFETY: the caller's contract; both have as many numbers.
            unsafe {
                match self.passes {
                    Some(passes) => narrow::<S>(column, count, self.rank, spare, None, passes),
                    None => select::<S>(column, count, self.rank, spare),
                }
            }
        }
    }

    fn selected(column: &[f32], rank: usize, passes: Option<usize>) -> (f32, usize) {
        let mut all = InstructionSet::available().into_iter().map(|set| {
            // SAFETY: the processor has it.
            unsafe { set.run(Selected { column, rank, passes }) }
        });
        let first = all.next().unwrap();
        assert!(all.all(|other| other == first), "{rank} of {}", column.len());
        first
    }

    fn expected(column: &[f32], rank: usize) -> (f32, usize) {
        let mut sorted = column.to_vec();
        sorted.sort_unstable_by(f32::total_cmp);
        (sorted[rank], sorted.partition_point(|&x| x < sorted[rank]))
    }

    fn next(state: &mut u32) -> f32 {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (*state >> 8) as f32 / 16_777_216.0
    }

    /// Every rank of columns with few and with many equal numbers, some of which end in places of no point; with no pass, few, and as many as it
    /// takes.
    #[test]
    fn ranks_are_those_of_sorted_numbers() {
        let mut state = 3;
        for count in [16, 32, 48, 64, 256, 512, 4096, 5008, 20_000] {
            for (places, none) in [(1.0, 0), (2.0, 5), (3.0, 0), (50.0, 15), (1e6, 7)] {
                let mut column: Vec<f32> =
                    (0..count).map(|_| (places * next(&mut state)).floor() - 1.0).collect();
                column[count - none..].fill(f32::INFINITY);
                for rank in (0..count - none).step_by(1 + count / 16).chain([count - none - 1]) {
                    for passes in [Some(0), Some(1), Some(2), None] {
                        let found = selected(&column, rank, passes);
                        let expected = expected(&column, rank);
                        assert_eq!(found, expected, "{count} {places} {rank} {passes:?}");
                    }
                }
            }
        }
    }

    /// Columns in order, backwards, and of numbers that grow by a factor.
    #[test]
    fn order_does_not_matter() {
        for count in [64, 1024, 8192] {
            let orders: [&dyn Fn(usize) -> f32; 3] = [&|i| i as f32, &|i| -(i as f32), &|i| {
                2.0f32.powi((i * 37 % 240) as i32 - 120) * (1 + i % 7) as f32
            }];
            for order in orders {
                let column: Vec<f32> = (0..count).map(order).collect();
                for rank in [0, 1, count / 3, count / 2, count - 1] {
                    assert_eq!(selected(&column, rank, None), expected(&column, rank));
                }
            }
        }
    }

    /// The samples say nothing about the rest, so all brackets are in the wrong place.
    #[test]
    fn samples_may_mislead() {
        for count in [64, 608, 3008, 20_000] {
            let mut column: Vec<f32> = (0..count).map(|i| (7 + i % 10) as f32).collect();
            for place in PLACES {
                column[((u64::from(place) * count as u64) >> 32) as usize] = 1.0;
            }
            let mut state = count as u32;
            for i in 0..if count >= LONG { LARGE_SAMPLE } else { 0 } {
                state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
                column[((u64::from(state) * count as u64) >> 32) as usize] = (i % 5) as f32;
            }
            let found = selected(&column, count / 2, None);
            assert_eq!(found, expected(&column, count / 2));
            assert!(found.0 >= 7.0, "the samples have no such number");
        }
    }
}
