//! How this backend divides points: the bytes of [`Subtree::divide`](splitplane_core::points::build::Subtree::divide), by vectors.
//!
//! Points always stand by index, so only coordinates are compared, and blocks need no sorting. A node's plane is selected
//! ([`select`](super::select)); then its columns move to the other of two buffers: points below the plane to the left, those above to the
//! right, and of those on it as many to the left as have room there.
//!
//! Whole vectors are written, so up to a vector's lanes behind the end of either child may be overwritten. A subtree of few blocks is
//! finished in buffers of its own, small enough for the nearest cache, where each block has as much room again behind it. Elsewhere the
//! last points of a child are written one by one.

use splitplane_core::arithmetic::snap;
use splitplane_core::points::tree::{Axes, BLOCK, PointNode};

use super::columns::{Columns, MOST_COLUMNS, Pointers, from_place};
use super::select::select;
use crate::simd::{Compiled, Simd, split_exactly};

/// Blocks of a subtree that has buffers of its own.
const SMALL: usize = 16;
/// Places of a block in such a buffer: as many again as it has points, at least a vector's lanes.
const ROOM: usize = 2 * BLOCK;

/// A subtree that is to be built. Blocks count from its first.
#[derive(Debug)]
pub(super) struct Work<'a, const N: usize> {
    pub(super) axes: Axes,
    /// All blocks are below a node of this height.
    pub(super) height: u32,
    /// Nodes above.
    pub(super) level: u32,
    /// Points in it; the places after them are of no points.
    pub(super) points: usize,
    /// Where its points are, by index.
    pub(super) columns: Columns<'a, N>,
    /// As much space.
    pub(super) spare: Columns<'a, N>,
    /// Whether finished points belong into `spare`.
    pub(super) moved: bool,
    pub(super) nodes: &'a mut [PointNode],
}

impl<const N: usize> Work<'_, N> {
    /// The height of the highest node that has two children.
    fn highest(&self) -> u32 {
        (self.nodes.len() + 1).next_power_of_two().trailing_zeros().min(self.height)
    }

    /// Checked once, so that no loop need ask.
    fn check(&self) {
        let places = (self.nodes.len() + 1) * BLOCK;
        assert!(self.points <= places && self.points + BLOCK > places);
        assert!(self.columns.len() == places && self.spare.len() == places);
    }
}

/// Divides the points of a node among two children. There must be more than a block.
pub(super) struct Divide<'a, const N: usize>(pub(super) Work<'a, N>);

impl<'a, const N: usize> Compiled for Divide<'a, N> {
    type Output = [Work<'a, N>; 2];

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> [Work<'a, N>; 2] {
        let Divide(work) = self;
        work.check();
        let height = work.highest() - 1;
        let Work { axes, level, points, mut columns, mut spare, moved, nodes, .. } = work;
        let (half, places) = (1 << height, columns.len());
        let middle = half * BLOCK;
        let (left_nodes, rest) = nodes.split_at_mut(half - 1);
        let (node, right_nodes) = rest.split_at_mut(1);
        let here = Node { points, places, middle, axis: (axes, level) };
        let rooms = Rooms { right: middle, ends: [middle, places] };
        // SAFETY: the caller's contract; columns have as many places.
        node[0] = unsafe { divide::<S, N>(&here, &columns.pointers(), &spare.pointers(), &rooms) };
        let [left, right] = spare.split_at(middle);
        let [left_spare, right_spare] = columns.split_at(middle);
        let child = |points, columns, spare, nodes| Work {
            axes,
            height,
            level: level + 1,
            points,
            columns,
            spare,
            moved: !moved,
            nodes,
        };
        [
            child(middle, left, left_spare, left_nodes),
            child(points - middle, right, right_spare, right_nodes),
        ]
    }
}

/// Builds a whole subtree.
pub(super) struct Finish<'a, const N: usize>(pub(super) Work<'a, N>);

/// A node that is to be divided.
#[derive(Clone, Copy)]
struct Waiting {
    /// Its first block.
    first: usize,
    height: u32,
    level: u32,
    /// The buffer with its points.
    buffer: usize,
}

/// One of the two small buffers.
type SmallBuffer = [[u32; SMALL * ROOM]; MOST_COLUMNS];

impl<const N: usize> Compiled for Finish<'_, N> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let Finish(mut work) = self;
        work.check();
        let (points, blocks) = (work.points, work.nodes.len() + 1);
        let (axes, nodes, home) = (work.axes, work.nodes, usize::from(work.moved));
        let mut small: [SmallBuffer; 2] = [[[0; SMALL * ROOM]; MOST_COLUMNS]; 2];
        let [near, other] = &mut small;
        let buffers = [
            work.columns.pointers(),
            work.spare.pointers(),
            near.each_mut().map(|column| column.as_mut_ptr()),
            other.each_mut().map(|column| column.as_mut_ptr()),
        ];
        // The first block of the subtree that is in the small buffers.
        let mut base = 0;
        let place = |buffer: usize, block: usize, base: usize| match buffer {
            0 | 1 => block * BLOCK,
            _ => (block - base) * ROOM,
        };
        // A child of each level waits.
        let mut waiting = [Waiting { first: 0, height: 0, level: 0, buffer: 0 }; 32];
        waiting[0].height = work.height;
        waiting[0].level = work.level;
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let Waiting { first, mut height, level, buffer } = waiting[count];
            while height > 0 && first + (1 << (height - 1)) >= blocks {
                height -= 1;
            }
            let own = blocks.min(first + (1 << height)) - first;
            // SAFETY: columns and buffers have these places, as `check` and the sizes of the small ones say: a subtree there has
            // at most `SMALL` blocks, and all that is overwritten behind a child is its own room.
            unsafe {
                let from = from_place::<N>(&buffers[buffer], place(buffer, first, base));
                if height == 0 {
                    if buffer != home {
                        let to = from_place::<N>(&buffers[home], first * BLOCK);
                        for column in 0..=N {
                            to[column].copy_from_nonoverlapping(from[column], BLOCK);
                        }
                    }
                    continue;
                }
                // The two large buffers take turns, and so do the two small ones.
                let next = if buffer >= 2 {
                    5 - buffer
                } else if own > SMALL {
                    1 - buffer
                } else {
                    2
                };
                if buffer < 2 && next == 2 {
                    base = first;
                }
                let half = 1 << (height - 1);
                let here = Node {
                    points: points.min((first + own) * BLOCK) - first * BLOCK,
                    places: own * BLOCK,
                    middle: half * BLOCK,
                    axis: (axes, level),
                };
                let rooms = match next {
                    0 | 1 => Rooms { right: here.middle, ends: [here.middle, here.places] },
                    _ => Rooms { right: half * ROOM, ends: [half * ROOM, own * ROOM] },
                };
                let to = from_place::<N>(&buffers[next], place(next, first, base));
                nodes[first + half - 1] = divide::<S, N>(&here, &from, &to, &rooms);
                for first in [first + half, first] {
                    waiting[count] =
                        Waiting { first, height: height - 1, level: level + 1, buffer: next };
                    count += 1;
                }
            }
        }
    }
}

/// A node.
struct Node {
    points: usize,
    /// Points, and the places after them that are of none.
    places: usize,
    /// Points of the left child.
    middle: usize,
    /// How the axis is chosen, and nodes above.
    axis: (Axes, u32),
}

/// Where children go. Those of the left child begin at place 0.
struct Rooms {
    /// Where those of the right child begin.
    right: usize,
    /// Up to where may be overwritten while there is more to come for the left and for the right child.
    ends: [usize; 2],
}

/// Moves points to the children.
///
/// # Safety
/// The processor must have the set. `from` must have the node's places, a multiple of sixteen, and `to` those that `rooms` says, and elsewhere.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn divide<S: Simd, const N: usize>(
    node: &Node,
    from: &Pointers,
    to: &Pointers,
    rooms: &Rooms,
) -> PointNode {
    // SAFETY: the caller's contract.
    unsafe {
        let axis = match node.axis {
            (Axes::Cycle, level) => level as usize % N,
            _ => widest::<S, N>(from, node.points),
        };
        let column = from[axis].cast::<f32>().cast_const();
        let (plane, below) = select::<S>(column, node.places, node.middle, to[0].cast());
        // Of the points on the plane the first go to the left, as many as there is room for.
        let mut on_plane = (node.middle - below) as u32;
        let at = S::splat(plane);
        let (mut left, mut right, mut place) = (0, rooms.right, 0);
        while place < node.places {
            let numbers = S::load(column.add(place));
            let not_less = S::bits(S::le(at, numbers));
            let mut lefts = !not_less & ((1 << S::N) - 1);
            if on_plane > 0 {
                let mut equal = not_less & S::bits(S::le(numbers, at));
                while equal.count_ones() > on_plane {
                    equal ^= 1 << equal.ilog2();
                }
                on_plane -= equal.count_ones();
                lefts |= equal;
            }
            let source = from_place::<N>(from, place);
            if left + S::N <= rooms.ends[0] && right + S::N <= rooms.ends[1] {
                S::split(lefts, &source[..=N], to, left, right);
            } else {
                split_exactly(S::N, lefts, &source[..=N], to, left, right);
            }
            let count = lefts.count_ones() as usize;
            left += count;
            right += S::N - count;
            place += S::N;
        }
        PointNode { plane, axis: axis as u32 }
    }
}

/// The axis along which points reach farthest, as the reference computes it.
///
/// # Safety
/// The processor must have the set, and columns so many points.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn widest<S: Simd, const N: usize>(columns: &Pointers, points: usize) -> usize {
    let (mut best, mut most) = (0, -1.0);
    for axis in 0..N {
        // SAFETY: the caller's contract; columns have whole vectors.
        unsafe {
            let [lower, upper] = ends::<S>(columns[axis].cast(), points);
            let extent = snap(upper - lower);
            if extent > most {
                (best, most) = (axis, extent);
            }
        }
    }
    best
}

/// The least and the greatest of the first numbers of a column.
///
/// # Safety
/// The processor must have the set, and the column whole vectors.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn ends<S: Simd>(column: *const f32, count: usize) -> [f32; 2] {
    // SAFETY: the caller's contract.
    unsafe {
        let first = S::splat(*column);
        let (mut lower, mut upper, mut place) = (first, first, 0);
        while place + S::N <= count {
            let numbers = S::load(column.add(place));
            lower = S::min(numbers, lower);
            upper = S::max(numbers, upper);
            place += S::N;
        }
        if place < count {
            let there = S::mask((1 << (count - place)) - 1);
            let numbers = S::select(there, S::load(column.add(place)), first);
            lower = S::min(numbers, lower);
            upper = S::max(numbers, upper);
        }
        [S::lowest(lower), S::highest(upper)]
    }
}

#[cfg(test)]
mod tests {
    use splitplane_core::points::tree::Axes;

    use crate::points::CpuPointTree;
    use crate::simd::InstructionSet;
    use splitplane_core::points::build::{PointOptions, build};

    /// Numbers below one, the next of a sequence.
    fn next(state: &mut u32) -> f32 {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (*state >> 8) as f32 / 16_777_216.0
    }

    /// Clouds with nodes that are divided by samples, large and small, and where all or half of a node's points are on the plane; with and without
    /// places of no point.
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
                for count in [count, 257, 513, 4096, 16_385] {
                    let options = PointOptions { axes, ..PointOptions::default() };
                    let expected = build(&points[..count], &options).unwrap();
                    for set in InstructionSet::available() {
                        let tree = CpuPointTree::build_on(&points[..count], &options, set).unwrap();
                        assert!(*tree.tree() == expected, "{name} {axes:?} {count} {set:?}");
                    }
                }
            }
        }
    }
}
