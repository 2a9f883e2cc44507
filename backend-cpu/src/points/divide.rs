//! How this backend divides points: the bytes of [`Subtree::divide`](splitplane_core::points::build::Subtree::divide), in fewer
//! moves than a selection in place.
//!
//! Records always stand by index, so only coordinates are compared, and blocks need no sorting. A node's plane is found from a
//! sample, whose order brackets the plane: one pass counts the coordinates below the bracket and gathers those in it, among which the plane
//! is selected. A second pass moves the records to the other of two buffers: those below the plane to the left, those above to the
//! right, and of those on it as many to the left as have room there. A sample decides how much work that is, never the result.

use core::hint::select_unpredictable;

use splitplane_core::arithmetic::snap;
use splitplane_core::points::tree::{Axes, BLOCK, PointNode, Record, from_ordered};

use crate::simd::{Compiled, Simd};

/// Coordinates that are selected from at once: most of a sample, or of a bracket.
const ROOM: usize = 4096;
/// Nodes of fewer points are selected from without a sample.
const FEW: usize = 512;

/// Coordinates that are being selected from.
pub(super) type Keys = [u32; ROOM];

/// Space for them.
pub(super) const NO_KEYS: Keys = [0; ROOM];

/// A subtree that is to be built. Blocks count from its first.
#[derive(Debug)]
pub(super) struct Work<'a, const N: usize> {
    pub(super) axes: Axes,
    /// All blocks are below a node of this height.
    pub(super) height: u32,
    /// Nodes above.
    pub(super) level: u32,
    /// Where its records are, by index.
    pub(super) records: &'a mut [Record<N>],
    /// As much space.
    pub(super) spare: &'a mut [Record<N>],
    /// Whether finished records belong into `spare`.
    pub(super) moved: bool,
    pub(super) nodes: &'a mut [PointNode],
}

impl<'a, const N: usize> Work<'a, N> {
    /// Points in it.
    pub(super) fn len(&self) -> usize {
        self.records.len()
    }

    /// The height of the highest node that has two children.
    fn highest(&self) -> u32 {
        (self.nodes.len() + 1).next_power_of_two().trailing_zeros().min(self.height)
    }
}

/// Divides the points of a node among two children. There must be more than a block.
pub(super) struct Divide<'a, 'b, const N: usize>(pub(super) Work<'a, N>, pub(super) &'b mut Keys);

impl<'a, const N: usize> Compiled for Divide<'a, '_, N> {
    type Output = [Work<'a, N>; 2];

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> [Work<'a, N>; 2] {
        let Divide(work, keys) = self;
        let height = work.highest() - 1;
        let Work { axes, level, records, spare, moved, nodes, .. } = work;
        let half = 1 << height;
        let middle = half * BLOCK;
        let (left_nodes, rest) = nodes.split_at_mut(half - 1);
        let (node, right_nodes) = rest.split_at_mut(1);
        node[0] = divide(records, spare, middle, (axes, level), keys);
        let (left, right) = spare.split_at_mut(middle);
        let (left_spare, right_spare) = records.split_at_mut(middle);
        let child = |records, spare, nodes| Work {
            axes,
            height,
            level: level + 1,
            records,
            spare,
            moved: !moved,
            nodes,
        };
        [child(left, left_spare, left_nodes), child(right, right_spare, right_nodes)]
    }
}

/// Builds a whole subtree.
pub(super) struct Finish<'a, 'b, const N: usize>(pub(super) Work<'a, N>, pub(super) &'b mut Keys);

impl<const N: usize> Compiled for Finish<'_, '_, N> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let Finish(work, keys) = self;
        let (points, blocks) = (work.len(), work.nodes.len() + 1);
        let mut buffers = [work.records, work.spare];
        let (axes, nodes, home) = (work.axes, work.nodes, usize::from(work.moved));
        // A node that is to be divided: its first block, height, level, and the buffer with its records. A child of each
        // level waits.
        let mut waiting = [(0, 0, 0, 0); 32];
        waiting[0] = (0, work.height, work.level, 0);
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (first, mut height, level, buffer) = waiting[count];
            while height > 0 && first + (1 << (height - 1)) >= blocks {
                height -= 1;
            }
            let places = first * BLOCK..points.min((first + (1 << height)) * BLOCK);
            let [zeroth, other] = &mut buffers;
            let (from, to) = if buffer == 0 { (zeroth, other) } else { (other, zeroth) };
            if height == 0 {
                if buffer != home {
                    to[places.clone()].copy_from_slice(&from[places]);
                }
                continue;
            }
            let half = 1 << (height - 1);
            let (from, to) = (&from[places.clone()], &mut to[places]);
            nodes[first + half - 1] = divide(from, to, half * BLOCK, (axes, level), keys);
            for child in [first + half, first] {
                waiting[count] = (child, height - 1, level + 1, 1 - buffer);
                count += 1;
            }
        }
    }
}

/// Moves records to the children: so many to the left.
#[cfg_attr(not(unoptimised), inline(always))]
fn divide<const N: usize>(
    from: &[Record<N>],
    to: &mut [Record<N>],
    middle: usize,
    (axes, level): (Axes, u32),
    keys: &mut Keys,
) -> PointNode {
    let axis = match axes {
        Axes::Cycle => level as usize % N,
        _ => widest(from),
    };
    assert!(axis < N && from.len() == to.len(), "once, so that the loops need not ask");
    let (plane, below) = select(from, to, middle, axis, keys);
    // Of the records on the plane the first go to the left, as many as there is room for.
    let mut on_plane = middle - below;
    let mut cut = 0;
    while on_plane > 0 {
        on_plane -= usize::from(from[cut].bits[axis] == plane);
        cut += 1;
    }
    let (mut left, mut right) = (0, middle);
    let (first, rest) = from.split_at(cut);
    for record in first {
        let is_left = record.bits[axis] <= plane;
        to[select_unpredictable(is_left, left, right)] = *record;
        left += usize::from(is_left);
        right += usize::from(!is_left);
    }
    for record in rest {
        let is_left = record.bits[axis] < plane;
        to[select_unpredictable(is_left, left, right)] = *record;
        left += usize::from(is_left);
        right += usize::from(!is_left);
    }
    PointNode { plane: from_ordered(plane), axis: axis as u32 }
}

/// The axis along which records reach farthest, as the reference computes it.
#[cfg_attr(not(unoptimised), inline(always))]
fn widest<const N: usize>(records: &[Record<N>]) -> usize {
    let (mut lower, mut upper) = ([u32::MAX; N], [0; N]);
    for record in records {
        for axis in 0..N {
            lower[axis] = lower[axis].min(record.bits[axis]);
            upper[axis] = upper[axis].max(record.bits[axis]);
        }
    }
    let (mut best, mut most) = (0, -1.0);
    for axis in 0..N {
        let extent = snap(from_ordered(upper[axis]) - from_ordered(lower[axis]));
        if extent > most {
            (best, most) = (axis, extent);
        }
    }
    best
}

/// The coordinate that has the given rank, and how many are below it. May write to `spare`.
#[cfg_attr(not(unoptimised), inline(always))]
fn select<const N: usize>(
    records: &[Record<N>],
    spare: &mut [Record<N>],
    rank: usize,
    axis: usize,
    keys: &mut Keys,
) -> (u32, usize) {
    let count = records.len();
    assert!(axis < N && spare.len() == count, "once, so that the loops need not ask");
    if count < FEW {
        for (key, record) in keys.iter_mut().zip(records) {
            *key = record.bits[axis];
        }
        return select_key(&mut keys[..count], rank);
    }
    // The rank is expected at this place of the sample's order, and seldom more than two and a half deviations away.
    let (size, reach) = sample_of(count);
    for (key, place) in keys.iter_mut().zip(sampled(count).take(size)) {
        *key = records[place].bits[axis];
    }
    let sample = &mut keys[..size];
    // In 64 bits, since 32 are too few for the product where there are millions.
    let at = (rank as u64 * size as u64 / count as u64) as usize;
    let upper =
        if at + reach < size { *sample.select_nth_unstable(at + reach).1 } else { u32::MAX };
    let lower = if at >= reach { *sample.select_nth_unstable(at - reach).1 } else { 0 };
    let (mut below, mut within) = (0, 0);
    for record in records {
        let key = record.bits[axis];
        spare[within] = *record;
        below += usize::from(key < lower);
        within += usize::from(key.wrapping_sub(lower) <= upper - lower);
    }
    if (below..below + within).contains(&rank) {
        let rank = rank - below;
        if within <= ROOM {
            for (key, record) in keys.iter_mut().zip(&spare[..within]) {
                *key = record.bits[axis];
            }
            let (plane, less) = select_key(&mut keys[..within], rank);
            return (plane, below + less);
        }
        let (plane, less) = select_record(&mut spare[..within], rank, axis);
        return (plane, below + less);
    }
    spare.copy_from_slice(records);
    select_record(spare, rank, axis)
}

/// Numbers in a sample of so many records, and how far from its place in the sample's order a rank is looked for: two and a half
/// deviations, each half the root of the size.
#[cfg_attr(not(unoptimised), inline(always))]
fn sample_of(count: usize) -> (usize, usize) {
    let digits = count.ilog2() * 2 / 3;
    (ROOM.min(1 << digits), (5 << (digits / 2)) / 4)
}

/// Places that are sampled: neither in order nor at equal steps, since points often are (a linear congruential sequence).
#[cfg_attr(not(unoptimised), inline(always))]
fn sampled(count: usize) -> impl Iterator<Item = usize> {
    let mut state = count as u32;
    core::iter::repeat_with(move || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        ((u64::from(state) * count as u64) >> 32) as usize
    })
}

/// The number of a rank, and how many are below it.
fn select_key(keys: &mut [u32], rank: usize) -> (u32, usize) {
    let (first, &mut key, _) = keys.select_nth_unstable(rank);
    (key, first.iter().filter(|&&other| other < key).count())
}

/// The same of records' coordinates.
#[inline(never)]
fn select_record<const N: usize>(
    records: &mut [Record<N>],
    rank: usize,
    axis: usize,
) -> (u32, usize) {
    let (first, found, _) = records.select_nth_unstable_by_key(rank, |record| record.bits[axis]);
    let key = found.bits[axis];
    (key, first.iter().filter(|other| other.bits[axis] < key).count())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::CpuPointTree;
    use splitplane_core::points::build::{PointOptions, build};

    /// Numbers below one, the next of a sequence.
    fn next(state: &mut u32) -> f32 {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (*state >> 8) as f32 / 16_777_216.0
    }

    /// Clouds with nodes that are divided by samples, by whole brackets of records, and where all or half of a bracket is on the plane.
    #[test]
    fn trees_are_the_references() {
        let count = 20_011;
        let mut state = 7;
        let mut cloud = |of: &dyn Fn(usize, [f32; 3]) -> [f32; 3]| -> Vec<[f32; 3]> {
            (0..count).map(|i| of(i, [(); 3].map(|()| next(&mut state)))).collect()
        };
        let clouds = [
            ("uniform", cloud(&|_, at| at)),
            ("coincident", cloud(&|_, _| [0.3, -0.4, 0.5])),
            ("a line, backwards", cloud(&|i, _| [-(i as f32), 0.0, 0.0])),
            ("grid", cloud(&|i, _| [(i % 27) as f32, (i / 27 % 27) as f32, (i / 729) as f32])),
            ("few places", cloud(&|_, at| at.map(|x| (4.0 * x).floor()))),
            ("far apart", cloud(&|i, at| at.map(|x| x + if i % 3 == 0 { 1e6 } else { 0.0 }))),
            ("most in one place", cloud(&|i, at| if i % 5 > 0 { [0.5; 3] } else { at })),
            ("a comb", cloud(&|i, at| [(i % 64) as f32, at[1], at[2]])),
        ];
        for (name, points) in &clouds {
            for axes in [Axes::Widest, Axes::Cycle] {
                for count in [count, 513, 8192, 16_385] {
                    let options = PointOptions { axes, ..PointOptions::default() };
                    let tree = CpuPointTree::build(&points[..count], &options).unwrap();
                    let expected = build(&points[..count], &options).unwrap();
                    assert!(*tree.tree() == expected, "{name} {axes:?} {count}");
                }
            }
        }
    }

    /// The sample's order says nothing about the rest, so the bracket is in the wrong place: all are selected from.
    #[test]
    fn a_sample_may_mislead() {
        let mut keys = Box::new(NO_KEYS);
        for count in [600, 3000, 20_000] {
            let record = |i| Record { bits: [7 + i % 10], point: i };
            let mut records: Vec<Record<1>> = (0..count as u32).map(record).collect();
            for place in sampled(count).take(sample_of(count).0) {
                records[place].bits = [place as u32 % 5];
            }
            let mut sorted: Vec<u32> = records.iter().map(|record| record.bits[0]).collect();
            sorted.sort_unstable();
            let rank = count / 2;
            let below = sorted.partition_point(|&key| key < sorted[rank]);
            let found = select(&records, &mut records.clone(), rank, 0, &mut keys);
            assert_eq!(found, (sorted[rank], below));
            assert!(found.0 >= 7, "the sample has no such number");
        }
    }

    /// Every rank of lists with few and with many equal numbers, in each of the ways.
    #[test]
    fn ranks_are_those_of_sorted_numbers() {
        let mut keys = Box::new(NO_KEYS);
        let mut state = 3;
        for count in [17usize, 32, 33, 64, 65, 511, 512, 700, 5000] {
            for places in [1.0, 3.0, 50.0, 1e6] {
                let record = |i| Record { bits: [(places * next(&mut state)) as u32], point: i };
                let records: Vec<Record<1>> = (0..count as u32).map(record).collect();
                let mut sorted: Vec<u32> = records.iter().map(|record| record.bits[0]).collect();
                sorted.sort_unstable();
                for rank in (0..count).step_by(1 + count / 16).chain([count - 1]) {
                    let mut spare = records.clone();
                    let found = select(&records, &mut spare, rank, 0, &mut keys);
                    let below = sorted.partition_point(|&key| key < sorted[rank]);
                    assert_eq!(found, (sorted[rank], below), "{count} {places} {rank}");
                }
            }
        }
    }
}
