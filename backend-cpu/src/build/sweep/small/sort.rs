//! Sorting the columns of rows, each for itself, by a network that exchanges whole rows.

use crate::simd::f32x16::{F32x16, Row16};

/// Rows that are sorted together: 16 references.
pub(super) const OCTET: usize = 8;

/// Where the number at a place in sorted order is: row and first lane of its column's half.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn place(sorted: usize) -> (usize, usize) {
    (sorted / (2 * OCTET) * OCTET + sorted % OCTET, sorted / OCTET % 2 * 8)
}

/// Sorts rows whose number is a multiple of [`OCTET`].
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn sort<V: F32x16>(rows: &mut [Row16]) {
    let octets = rows.as_chunks_mut::<OCTET>().0;
    for octet in octets.iter_mut() {
        sort_octet::<V>(octet);
    }
    // A network that sorts numbers sorts octets, where it exchanges what the lower and the upper half of
    // two belong to.
    for [one, other] in NETWORK {
        if other < octets.len() {
            let (low, high) = octets.split_at_mut(other);
            merge::<V>(&mut low[one], &mut high[0]);
        }
    }
}

/// A network that sorts eight numbers; without exchanges that involve the last ones, fewer.
const NETWORK: [[usize; 2]; 19] = [
    [0, 2],
    [1, 3],
    [4, 6],
    [5, 7],
    [0, 4],
    [1, 5],
    [2, 6],
    [3, 7],
    [0, 1],
    [2, 3],
    [4, 5],
    [6, 7],
    [2, 4],
    [3, 5],
    [1, 4],
    [3, 6],
    [1, 2],
    [3, 4],
    [5, 6],
];

/// Exchanges pairs of rows so that the former of each pair has what is less, column by column. A macro,
/// since compilers do not unroll loops of that length, and indices must be constants.
macro_rules! exchange {
    ($rows:ident: $($one:literal $other:literal),*) => {$(
        let (a, b) = ($rows[$one], $rows[$other]);
        ($rows[$one], $rows[$other]) = (a.least(b), a.greatest(b));
    )*};
}

/// Sorts eight rows: [`NETWORK`].
#[cfg_attr(not(unoptimised), inline(always))]
fn sort_rows<V: F32x16>(rows: &mut [V; OCTET]) {
    exchange!(rows: 0 2, 1 3, 4 6, 5 7, 0 4, 1 5, 2 6, 3 7, 0 1, 2 3, 4 5, 6 7, 2 4, 3 5, 1 4, 3 6,
        1 2, 3 4, 5 6);
}

/// Sorts eight rows that first rise and then fall, or the other way round.
#[cfg_attr(not(unoptimised), inline(always))]
fn sort_bitonic<V: F32x16>(rows: &mut [V; OCTET]) {
    exchange!(rows: 0 4, 1 5, 2 6, 3 7, 0 2, 1 3, 4 6, 5 7, 0 1, 2 3, 4 5, 6 7);
}

/// Sorts the columns of both halves, as one of 16: the upper half after the lower one.
#[cfg_attr(not(unoptimised), inline(always))]
fn sort_octet<V: F32x16>(octet: &mut [Row16; OCTET]) {
    let mut rows: [V; OCTET] = core::array::from_fn(|i| V::load(&octet[i]));
    sort_rows(&mut rows);
    rows = core::array::from_fn(|i| {
        let (one, other) = (rows[i], rows[OCTET - 1 - i].swapped());
        one.least(other).halves(one.greatest(other))
    });
    sort_bitonic(&mut rows);
    for i in 0..OCTET {
        rows[i].store(&mut octet[i]);
    }
}

/// Turns two sorted octets into one of the lesser and one of the greater numbers, both sorted.
#[cfg_attr(not(unoptimised), inline(always))]
fn merge<V: F32x16>(low: &mut [Row16; OCTET], high: &mut [Row16; OCTET]) {
    let one: [V; OCTET] = core::array::from_fn(|i| V::load(&low[i]));
    let other: [V; OCTET] = core::array::from_fn(|i| V::load(&high[OCTET - 1 - i]).swapped());
    let least = core::array::from_fn(|i| one[i].least(other[i]));
    let greatest = core::array::from_fn(|i| one[i].greatest(other[i]));
    for (mut rows, octet) in [(least, low), (greatest, high)] {
        rows = core::array::from_fn(|i| {
            let other = rows[i].swapped();
            rows[i].least(other).halves(rows[i].greatest(other))
        });
        sort_bitonic(&mut rows);
        for i in 0..OCTET {
            rows[i].store(&mut octet[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::MOST;
    use super::*;
    use crate::simd::f32x16::ArrayF32x16;
    use crate::simd::{InstructionSet, Simd, WIDTH};
    use splitplane_test_support::random::Random;

    #[test]
    fn columns_are_sorted() {
        fn check<V: F32x16>(random: &mut Random, octets: usize) {
            let mut rows = vec![[0.0; WIDTH]; octets * OCTET];
            // Few values, so that many are equal.
            rows.as_flattened_mut().fill_with(|| random.below(20) as f32);
            let column = |rows: &[Row16], column: usize| -> Vec<f32> {
                (0..rows.len() * 2).map(place).map(|(row, half)| rows[row][half + column]).collect()
            };
            let mut expected: Vec<Vec<f32>> = (0..8).map(|k| column(&rows, k)).collect();
            expected.iter_mut().for_each(|column| column.sort_by(f32::total_cmp));
            sort::<V>(&mut rows);
            let sorted: Vec<Vec<f32>> = (0..8).map(|k| column(&rows, k)).collect();
            assert_eq!(sorted, expected);
        }
        let mut random = Random::new(3);
        for octets in 1..=MOST / 16 {
            for _ in 0..50 {
                check::<ArrayF32x16>(&mut random, octets);
                #[cfg(target_arch = "x86_64")]
                if InstructionSet::available().contains(&InstructionSet::Avx512) {
                    check::<<crate::simd::avx512::Avx512 as Simd>::F32x16>(&mut random, octets);
                }
            }
        }
    }
}
