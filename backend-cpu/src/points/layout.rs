//! What a search reads: coordinates as columns, a line a block, and boxes around blocks and around one another.
//!
//! Boxes stand sixteen to a wide node, which is four levels of the tree. Those of wide level 0 hold blocks, and so on up
//! to one node. The child with the number i of wide node j is number 16 j + i of the level below.

use std::collections::TryReserveError;

use splitplane_core::points::tree::{BLOCK, PointTree};

use super::divide::ends;
use crate::simd::{Compiled, InstructionSet, Simd};

/// Children of a wide node, and points of a block.
pub(super) const WIDTH: usize = 16;
const _: () = assert!(WIDTH == BLOCK);

/// Most wide levels: 2^30 points are 2^26 blocks.
pub(super) const LEVELS: usize = 7;

/// Sixteen numbers, one cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Line(pub [f32; WIDTH]);

impl Line {
    /// Coordinates of no point: where everything else is less far.
    pub(super) const NOWHERE: Line = Line([f32::INFINITY; WIDTH]);
}

/// The numbers of lines.
pub(super) fn numbers(lines: &mut [Line]) -> &mut [f32] {
    let count = lines.len() * WIDTH;
    // SAFETY: a line is sixteen numbers and nothing else.
    unsafe { core::slice::from_raw_parts_mut(lines.as_mut_ptr().cast(), count) }
}

/// A wide node: lower and upper sides of children, an axis a line.
type WideNode<const N: usize> = [[Line; 2]; N];

#[derive(Debug)]
pub(super) struct PointLayout<const N: usize> {
    /// Points in all blocks; the last block may have places without one.
    pub points: usize,
    /// Blocks, and lines of a column.
    pub blocks: usize,
    /// N columns of coordinates; infinite ones in places without a point.
    pub lines: Vec<Line>,
    /// Wide levels, the one over the blocks first. None without points.
    pub levels: Vec<Vec<WideNode<N>>>,
}

/// A box without points: where everything else is less far.
fn nowhere<const N: usize>() -> WideNode<N> {
    [[Line([f32::INFINITY; WIDTH]), Line([f32::NEG_INFINITY; WIDTH])]; N]
}

impl<const N: usize> PointLayout<N> {
    /// The layout of a tree that is there.
    pub(super) fn new(
        tree: &PointTree<N>,
        set: InstructionSet,
    ) -> Result<PointLayout<N>, TryReserveError> {
        let blocks = tree.len().div_ceil(WIDTH);
        let mut lines = Vec::new();
        lines.try_reserve_exact(N * blocks)?;
        lines.resize(N * blocks, Line::NOWHERE);
        let all = numbers(&mut lines);
        for (place, point) in tree.points().iter().enumerate() {
            for axis in 0..N {
                all[axis * blocks * WIDTH + place] = point[axis];
            }
        }
        PointLayout::of_columns(tree.len(), lines, set)
    }

    /// The layout of columns in the order of a tree.
    pub(super) fn of_columns(
        points: usize,
        lines: Vec<Line>,
        set: InstructionSet,
    ) -> Result<PointLayout<N>, TryReserveError> {
        let blocks = points.div_ceil(WIDTH);
        let mut levels: Vec<Vec<WideNode<N>>> = Vec::new();
        let mut below = blocks;
        while below > 0 {
            let nodes = below.div_ceil(WIDTH);
            let mut level = Vec::new();
            level.try_reserve_exact(nodes)?;
            level.resize(nodes, nowhere());
            levels.push(level);
            below = if nodes == 1 { 0 } else { nodes };
        }
        let mut layout = PointLayout { points, blocks, lines, levels };
        // SAFETY: `set` was detected on this processor.
        unsafe { set.run(Boxes(&mut layout)) };
        Ok(layout)
    }

    /// Bytes of the layout of so many points.
    pub(super) fn bytes(points: usize) -> u64 {
        let blocks = points.div_ceil(WIDTH);
        let mut bytes = blocks * size_of::<[Line; N]>();
        let mut below = blocks;
        while below > 0 {
            let nodes = below.div_ceil(WIDTH);
            bytes += nodes * size_of::<WideNode<N>>();
            below = if nodes == 1 { 0 } else { nodes };
        }
        bytes as u64
    }
}

/// Makes the boxes.
struct Boxes<'a, const N: usize>(&'a mut PointLayout<N>);

impl<const N: usize> Compiled for Boxes<'_, N> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let PointLayout { points, blocks, lines, levels } = self.0;
        let Some((first, others)) = levels.split_first_mut() else { return };
        for (number, node) in first.iter_mut().enumerate() {
            for child in 0..WIDTH.min(*blocks - number * WIDTH) {
                let block = number * WIDTH + child;
                let count = (*points - block * WIDTH).min(WIDTH);
                for axis in 0..N {
                    let line = &lines[axis * *blocks + block];
                    // SAFETY: the caller's contract; a line is whole vectors.
                    let [lower, upper] = unsafe { ends::<S>(line.0.as_ptr(), count) };
                    node[axis][0].0[child] = lower;
                    node[axis][1].0[child] = upper;
                }
            }
        }
        let mut below = &*first;
        for level in others {
            for (number, children) in below.iter().enumerate() {
                for axis in 0..N {
                    // SAFETY: the caller's contract; a line is whole vectors. Sides of no child are beyond all others.
                    unsafe {
                        let [lower, upper] = &children[axis];
                        let [lowest, _] = ends::<S>(lower.0.as_ptr(), WIDTH);
                        let [_, highest] = ends::<S>(upper.0.as_ptr(), WIDTH);
                        level[number / WIDTH][axis][0].0[number % WIDTH] = lowest;
                        level[number / WIDTH][axis][1].0[number % WIDTH] = highest;
                    }
                }
            }
            below = level;
        }
    }
}
